//! Pipelines made when they are needed, each with the pace that it runs at.

use super::commands::Commands;
use super::device::Device;
use super::pacer::Pacer;
use super::pipeline::{Kernel, Pipeline};
use super::tiles::{self, Parts};
use crate::backend::{BackendError, PipelineCode};
use crate::heights;
use bytemuck::{Pod, bytes_of};
use emboss_kernels::displacement::height_pyramid::{level_words, top_level};
use emboss_kernels::interface::{BATCH_GROUP_SIZE, Batch, Displacement, PyramidPart};
use emboss_kernels::scene::Features;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Most items of one batch dispatch: every Vulkan device runs at least 65535 workgroups along an axis.
const MOST_BATCH_ITEMS: u32 = 65_535 * BATCH_GROUP_SIZE;

/// The pipelines of a backend: at most one for each kernel, for the features of the present scene.
#[derive(Default)]
pub(super) struct Programs {
    /// Whether a window waits for submissions.
    is_for_window: bool,
    /// Whether drivers may fuse products with sums.
    contracts: bool,
    features: Features,
    made: Vec<Program>,
    /// How long it took to make them and those before.
    compile_time: Duration,
}

/// A pipeline, and how much work its submissions get.
pub(super) struct Program {
    pipeline: Pipeline,
    kernel: Kernel,
    features: Features,
    pacer: Pacer,
}

/// How a pass over a film went.
pub(super) struct Pass {
    /// `Break` where it was ended early.
    pub(super) flow: ControlFlow<()>,
    /// Sum of what its submissions took on the device, in milliseconds.
    pub(super) device_ms: f64,
}

impl Programs {
    /// None yet, of a backend whose pictures a window shows: submissions are short.
    pub(super) fn for_window() -> Self {
        Programs { is_for_window: true, ..Programs::default() }
    }

    /// From now on pipelines are made such that the driver may fuse products with sums, or not.
    pub(super) fn let_contract(&mut self, contracts: bool) {
        if self.contracts != contracts {
            self.contracts = contracts;
            self.made.clear();
        }
    }

    /// From now on pipelines are made for `features`. Those that hold other code are dropped, and the others forget
    /// what they measured, since the scene changes.
    pub(super) fn set_features(&mut self, features: Features) {
        self.features = features;
        self.made.retain(|program| program.kernel.is_alike(program.features, features));
        for program in &mut self.made {
            program.pacer = program.pacer.forgotten();
        }
    }

    /// Takes note that what is seen has changed.
    pub(super) fn beware(&mut self) {
        for program in &mut self.made {
            program.pacer.beware();
        }
    }

    /// How long pipelines were made.
    pub(super) fn compile_time(&self) -> Duration {
        self.compile_time
    }

    /// The code of all that were made.
    pub(super) fn codes(&self) -> Vec<PipelineCode> {
        self.made.iter().map(|program| program.pipeline.code()).collect()
    }

    /// The program of a kernel, compiled now if this is the first time that it is needed.
    pub(super) fn get(&mut self, device: &Arc<Device>, kernel: Kernel) -> Result<&mut Program, BackendError> {
        let index = match self.made.iter().position(|program| program.kernel == kernel) {
            Some(index) => index,
            None => {
                let features = self.features;
                let start = Instant::now();
                let make = if self.contracts { Pipeline::contractible } else { Pipeline::new };
                let pipeline = make(device, kernel, features)?;
                let pacer = Pacer::new(self.is_for_window);
                self.compile_time += start.elapsed();
                self.made.push(Program { pipeline, kernel, features, pacer });
                self.made.len() - 1
            }
        };
        Ok(&mut self.made[index])
    }
}

impl Program {
    pub(super) fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// Runs over a film of `width` x `height` pixels. Calls `progress` with the share done after each submission;
    /// `Break` ends the pass there.
    pub(super) fn run_film(
        &mut self,
        commands: &Commands,
        [width, height]: [u32; 2],
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<Pass, BackendError> {
        let mut parts = Parts::new(width, height);
        let mut pass = Pass { flow: ControlFlow::Continue(()), device_ms: 0.0 };
        self.pacer.begin_pass(parts.pixels());
        while pass.flow.is_continue()
            && let Some((tiles, pixels)) = parts.next(self.pacer.items(), sample)
        {
            let ms = commands.run(self.kernel.activity(), |recorder| {
                recorder.dispatch(&self.pipeline, bytes_of(&tiles), tiles::groups(tiles));
            })?;
            self.pacer.record(pixels, ms);
            tracing::trace!("{tiles:?}: {ms:.3} ms");
            pass.device_ms += ms;
            pass.flow = progress(parts.share_done());
        }
        Ok(pass)
    }

    /// Runs over some items; `kernel` is which elementary kernel `probe` runs.
    pub(super) fn run_batches(
        &mut self,
        commands: &Commands,
        items: Range<u32>,
        kernel: u32,
    ) -> Result<(), BackendError> {
        let (start, count) = (items.start, items.end - items.start);
        self.pacer.begin_pass(count);
        self.run_items(commands, count, |first, count| Batch { first: start + first, count, kernel })
    }

    /// Builds the pyramids of height maps. A level is made from the one below it, which the submissions before it
    /// wrote.
    pub(super) fn build_pyramids(
        &mut self,
        commands: &Commands,
        maps: &[Displacement],
    ) -> Result<(), BackendError> {
        let levels = levels(maps);
        self.pacer.begin_pass(levels.iter().fold(0, |sum: u32, level| sum.saturating_add(level.count)));
        for level in levels {
            self.run_items(commands, level.count, |first, count| PyramidPart { first, count, ..level })?;
        }
        Ok(())
    }

    /// Runs over items 0 to `count`, which are part of a pass; `push_constants` makes those of a dispatch from its
    /// first item and how many it has.
    fn run_items<P: Pod>(
        &mut self,
        commands: &Commands,
        count: u32,
        push_constants: impl Fn(u32, u32) -> P,
    ) -> Result<(), BackendError> {
        let mut first = 0;
        while first < count {
            let items = self.pacer.items().min(MOST_BATCH_ITEMS).min(count - first);
            let constants = push_constants(first, items);
            let groups = [items.div_ceil(BATCH_GROUP_SIZE), 1];
            let ms = commands.run(self.kernel.activity(), |recorder| {
                recorder.dispatch(&self.pipeline, bytes_of(&constants), groups);
            })?;
            self.pacer.record(items, ms);
            first += items;
        }
        Ok(())
    }
}

/// All words of each level of the pyramids of `maps`, map by map and from the lowest level up.
fn levels(maps: &[Displacement]) -> Vec<PyramidPart> {
    let of_map = |(displacement, map): (u32, &Displacement)| {
        let (format, width, height) = (map.format, map.map_width, map.map_height);
        (1..=top_level(width, height)).map(move |level| PyramidPart {
            displacement,
            level,
            first: 0,
            count: level_words(format, width, height, level),
        })
    };
    heights::pyramids(maps).flat_map(of_map).collect()
}
