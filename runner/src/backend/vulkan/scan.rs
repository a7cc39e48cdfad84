//! The exclusive scan on the device: [`emboss_kernels::bvh::scan`], recorded between other dispatches.

use super::buffer::Buffer;
use super::commands::Recorder;
use super::device::Device;
use super::pipeline::{Kernel, Pipeline};
use crate::backend::BackendError;
use bytemuck::bytes_of;
use emboss_kernels::bvh::scan::{BLOCK, blocks};
use emboss_kernels::interface::binding;
use emboss_kernels::scene::Features;
use std::sync::Arc;

/// Most workgroups of a dispatch on every Vulkan device, each of which takes a block.
const MOST_BLOCKS: u32 = 65_535;
/// Most words that a scan takes, and most pairs that a sort takes.
pub(super) const MOST_ITEMS: u32 = MOST_BLOCKS * BLOCK;

/// Up to so many blocks are scanned by one workgroup in one dispatch instead of three. Estimated, not measured: a block
/// takes that workgroup nine barriers and a trip to memory, about as long as a dispatch takes to begin behind a
/// barrier, so that the ways cross at a few blocks. A wrong number costs some microseconds a scan.
const MOST_SERIAL_BLOCKS: u32 = 4;

/// The pipelines of a scan, bound to a buffer of values and one of sums.
pub(super) struct Scanner {
    sum_blocks: Pipeline,
    scan_sums: Pipeline,
    scan_blocks: Pipeline,
    /// All of a short scan.
    scan_values: Pipeline,
}

/// How many words the sums of `count` words take.
pub(super) fn sum_words(count: u32) -> u32 {
    blocks(count)
}

impl Scanner {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, BackendError> {
        let pipeline = |kernel| Pipeline::new(device, kernel, Features::default());
        Ok(Scanner {
            sum_blocks: pipeline(Kernel::SumBlocks)?,
            scan_sums: pipeline(Kernel::ScanSerially)?,
            scan_blocks: pipeline(Kernel::ScanBlocks)?,
            scan_values: pipeline(Kernel::ScanSerially)?,
        })
    }

    /// Binds the words to scan, and [`sum_words`] more.
    pub(super) fn bind(&self, values: &Buffer, sums: &Buffer) {
        for pipeline in [&self.sum_blocks, &self.scan_blocks] {
            pipeline.bind(|at| if at == binding::SCAN_VALUES { values } else { sums });
        }
        self.scan_values.bind(|_| values);
        self.scan_sums.bind(|_| sums);
    }

    /// Scans the first `count` values in place, and ends with a barrier. One must stand in front of it, too, behind
    /// what wrote them.
    ///
    /// # Panics
    /// Where there are more than [`MOST_ITEMS`].
    pub(super) fn record(&self, recorder: &Recorder<'_>, count: u32) {
        assert!(count <= MOST_ITEMS, "a scan takes at most {MOST_ITEMS} words");
        let blocks = blocks(count);
        let dispatch = |pipeline: &Pipeline, count: u32, groups: u32| {
            recorder.dispatch(pipeline, bytes_of(&count), [groups, 1]);
            recorder.barrier();
        };
        if blocks <= MOST_SERIAL_BLOCKS {
            dispatch(&self.scan_values, count, 1);
        } else {
            dispatch(&self.sum_blocks, count, blocks);
            dispatch(&self.scan_sums, blocks, 1);
            dispatch(&self.scan_blocks, count, blocks);
        }
    }
}
