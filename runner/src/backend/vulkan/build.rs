//! The BVH's build on the device: [`emboss_kernels::bvh`], all of it in one submission.

use super::buffer::{Buffer, Label};
use super::commands::{Commands, Recorder};
use super::device::Device;
use super::pipeline::{Kernel, Pipeline};
use super::scan::{self, Scanner};
use super::sort::{self, SortBuffers, Sorter};
use super::transfers::Transfers;
use crate::backend::BackendError;
use crate::bvh::{BuildTimes, Bvh, key_bits};
use ash::vk;
use bytemuck::bytes_of;
use emboss_kernels::bvh::hlbvh::{MAX_TREELETS, TREELET_WORDS, has_single_treelets};
use emboss_kernels::bvh::node::{BOX_FLOATS, NODE_WORDS};
use emboss_kernels::bvh::radix_sort::{self, count_words, limbs};
use emboss_kernels::bvh::scan::Shared as ScanShared;
use emboss_kernels::bvh::{header, morton, refit, small, top};
use emboss_kernels::interface::{
    BATCH_GROUP_SIZE, BuildStep, Instance, MAX_PRIMITIVES, MOST_ROW_GROUPS, binding,
};
use emboss_kernels::scene::Features;
use std::sync::Arc;

/// Shared memory that the hungriest kernel of a workgroup needs, in bytes.
pub(super) const MOST_SHARED_BYTES: usize = {
    let sort = size_of::<radix_sort::Counters>() + size_of::<ScanShared>() + size_of::<radix_sort::Entries>();
    let small = size_of::<small::Shared>();
    if sort > small { sort } else { small }
};

const SMALLER_MODEL: &str = "use a model of fewer triangles, or --backend cpu";

/// A tree on the device: what is traced, and what else a refit needs.
#[derive(Clone, Copy)]
pub(super) struct Tree<'a> {
    /// [`BOX_FLOATS`] floats for each primitive.
    pub(super) boxes: &'a Buffer,
    /// Twice as many nodes, less one.
    pub(super) nodes: &'a Buffer,
    /// A word for each primitive.
    pub(super) primitives: &'a Buffer,
    pub(super) state: &'a TreeState,
}

/// The part of a tree that only its builder reads.
pub(super) struct TreeState {
    count: u32,
    header: Buffer,
    arrivals: Buffer,
    parents: Buffer,
    costs: Buffer,
}

/// A tree by itself.
pub(super) struct OwnTree {
    boxes: Buffer,
    nodes: Buffer,
    primitives: Buffer,
    state: TreeState,
}

/// What only a build needs.
pub(super) struct Scratch {
    keys: Buffer,
    values: Buffer,
    counts: Buffer,
    count_sums: Buffer,
    levels: Buffer,
    treelet_of: Buffer,
    treelet_sums: Buffer,
    treelets: Buffer,
    tasks: Buffer,
    bins: Buffer,
    treelet_tasks: Buffer,
    queues: Buffer,
    small_tasks: Buffer,
    lists: Buffer,
}

/// The pipelines of a build and of a refit.
pub(super) struct Builder {
    sorter: Sorter,
    scanner: Scanner,
    centers: Pipeline,
    codes: Pipeline,
    levels: Pipeline,
    threshold: Pipeline,
    singles: Pipeline,
    flags: Pipeline,
    treelets: Pipeline,
    start: Pipeline,
    choose: Pipeline,
    move_treelets: Pipeline,
    small: Pipeline,
    refit: Pipeline,
    costs: Pipeline,
}

/// Workgroups of a dispatch over many items, in rows.
fn rows(groups: u32) -> [u32; 2] {
    [groups.min(MOST_ROW_GROUPS), groups.div_ceil(MOST_ROW_GROUPS)]
}

/// A buffer of words for the builder.
fn words(device: &Arc<Device>, name: &'static str, count: u32) -> Result<Buffer, BackendError> {
    let bytes = u64::from(count) * size_of::<u32>() as u64;
    Buffer::for_kernels(device, Label { name, remedy: SMALLER_MODEL }, bytes)
}

impl OwnTree {
    /// Room for a tree over `count` primitives.
    pub(super) fn new(device: &Arc<Device>, count: u32) -> Result<Self, BackendError> {
        let pairs = count.max(1);
        Ok(OwnTree {
            boxes: words(device, "the boxes of prisms", pairs * BOX_FLOATS)?,
            nodes: words(device, "the BVH", (2 * pairs - 1) * NODE_WORDS)?,
            primitives: words(device, "the BVH's primitives", pairs)?,
            state: TreeState::new(device, count)?,
        })
    }

    /// Copies its boxes, from box number `first` on, out of those of a scene.
    pub(super) fn take_boxes(
        &self,
        commands: &Commands,
        boxes: &Buffer,
        first: u64,
    ) -> Result<(), BackendError> {
        let one = u64::from(BOX_FLOATS) * size_of::<f32>() as u64;
        let size = u64::from(self.state.count) * one;
        let region = vk::BufferCopy { src_offset: first * one, dst_offset: 0, size };
        commands.run("copying boxes", |recorder| recorder.copy(boxes, &self.boxes, region)).map(drop)
    }

    /// Copies nodes and primitives to where `mesh` has them in a scene.
    pub(super) fn give(
        &self,
        commands: &Commands,
        scene: Tree<'_>,
        mesh: &Instance,
    ) -> Result<(), BackendError> {
        let word = size_of::<u32>() as u64;
        let nodes = vk::BufferCopy {
            src_offset: 0,
            dst_offset: u64::from(mesh.first_node) * u64::from(NODE_WORDS) * word,
            size: u64::from((2 * self.state.count - 1) * NODE_WORDS) * word,
        };
        let primitives = vk::BufferCopy {
            src_offset: 0,
            dst_offset: u64::from(mesh.first_triangle) * word,
            size: u64::from(self.state.count) * word,
        };
        commands
            .run("copying a mesh's BVH", |recorder| {
                recorder.copy(&self.nodes, scene.nodes, nodes);
                recorder.copy(&self.primitives, scene.primitives, primitives);
            })
            .map(drop)
    }

    pub(super) fn tree(&self) -> Tree<'_> {
        Tree { boxes: &self.boxes, nodes: &self.nodes, primitives: &self.primitives, state: &self.state }
    }
}

impl TreeState {
    /// For a tree over `count` primitives.
    pub(super) fn new(device: &Arc<Device>, count: u32) -> Result<Self, BackendError> {
        let pairs = count.max(1);
        Ok(TreeState {
            count,
            header: words(device, "the state of the BVH's build", header::WORDS)?,
            arrivals: words(device, "the BVH's arrivals", pairs)?,
            parents: words(device, "the BVH's parents", pairs)?,
            costs: words(device, "the BVH's costs", (2 * pairs - 1).div_ceil(refit::BLOCK))?,
        })
    }

    /// How many primitives there are.
    pub(super) fn count(&self) -> u32 {
        self.count
    }

    /// How many primitives are in the tree: the others have no sound box.
    pub(super) fn sound(&self, commands: &Commands, transfers: &Transfers) -> Result<u32, BackendError> {
        self.header_word(commands, transfers, header::SOUND)
    }

    /// How many primitives of the tree a refit found without a sound box.
    pub(super) fn unsound(&self, commands: &Commands, transfers: &Transfers) -> Result<u32, BackendError> {
        self.header_word(commands, transfers, header::UNSOUND)
    }

    fn header_word(
        &self,
        commands: &Commands,
        transfers: &Transfers,
        place: u32,
    ) -> Result<u32, BackendError> {
        let header: Vec<u32> = transfers.read(commands, &self.header, header::WORDS as usize)?;
        Ok(header[place as usize])
    }
}

impl<'a> Tree<'a> {
    fn at(self, binding: u32) -> Option<&'a Buffer> {
        match binding {
            binding::BOXES => Some(self.boxes),
            binding::NODES => Some(self.nodes),
            binding::PRIMITIVES => Some(self.primitives),
            binding::BUILD_STATE => Some(&self.state.header),
            binding::ARRIVALS => Some(&self.state.arrivals),
            binding::PARENTS => Some(&self.state.parents),
            binding::COSTS => Some(&self.state.costs),
            _ => None,
        }
    }

    /// The tree, copied to the host.
    pub(super) fn read(self, commands: &Commands, transfers: &Transfers) -> Result<Bvh, BackendError> {
        if self.state.count == 0 {
            return Ok(Bvh::default());
        }
        let sound = self.state.sound(commands, transfers)?;
        Ok(Bvh {
            nodes: transfers.read(commands, self.nodes, refit::node_count(sound) as usize)?,
            primitives: transfers.read(commands, self.primitives, self.state.count as usize)?,
        })
    }
}

impl Scratch {
    /// For a tree over `count` primitives.
    ///
    /// # Errors
    /// [`BackendError::TooManyTriangles`], or [`BackendError::TooLarge`] where there is no room.
    pub(super) fn new(device: &Arc<Device>, count: u32) -> Result<Self, BackendError> {
        if count > MAX_PRIMITIVES {
            return Err(BackendError::TooManyTriangles { count: count as usize });
        }
        let treelets = count.min(MAX_TREELETS);
        let (tasks, small_tasks) = (top::most_tasks(count), small::most_small_tasks(count));
        // Nothing is sorted where each primitive is a treelet.
        let sorted = if has_single_treelets(count) { 0 } else { count };
        let room = |name, count| words(device, name, count);
        Ok(Scratch {
            keys: room("the BVH's keys", 2 * limbs(key_bits(count)) * sorted)?,
            values: room("the BVH's sorted primitives", 2 * sorted)?,
            counts: room("the counts of a sort", count_words(sorted))?,
            count_sums: room("the sums of a sort", sort::sum_words(sorted))?,
            levels: room("the BVH's splits", sorted)?,
            treelet_of: room("the treelets' numbers", sorted)?,
            treelet_sums: room("the sums of a scan", scan::sum_words(sorted))?,
            treelets: room("the treelets", treelets * TREELET_WORDS)?,
            tasks: room("the tasks of a BVH's build", 2 * tasks * top::TASK_WORDS)?,
            bins: room("the bins of a BVH's build", top::bin_words(count))?,
            treelet_tasks: room("the treelets' tasks", treelets)?,
            queues: room("the queues of a BVH's build", 2 * tasks + small_tasks)?,
            small_tasks: room("the small tasks of a BVH's build", small_tasks * small::SMALL_TASK_WORDS)?,
            lists: room("the lists of a BVH's build", treelets)?,
        })
    }

    fn at(&self, binding: u32) -> &Buffer {
        match binding {
            binding::SORT_KEYS => &self.keys,
            binding::SORT_VALUES => &self.values,
            binding::SPLIT_LEVELS => &self.levels,
            binding::SCAN_VALUES => &self.treelet_of,
            binding::TREELETS => &self.treelets,
            binding::TASKS => &self.tasks,
            binding::BINS => &self.bins,
            binding::TREELET_TASKS => &self.treelet_tasks,
            binding::SMALL_TASKS => &self.small_tasks,
            binding::TREELET_LISTS => &self.lists,
            _ => &self.queues,
        }
    }
}

impl Builder {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, BackendError> {
        let pipeline = |kernel| Pipeline::new(device, kernel, Features::default());
        Ok(Builder {
            sorter: Sorter::new(device)?,
            scanner: Scanner::new(device)?,
            centers: pipeline(Kernel::BvhCenters)?,
            codes: pipeline(Kernel::BvhCodes)?,
            levels: pipeline(Kernel::BvhLevels)?,
            threshold: pipeline(Kernel::BvhThreshold)?,
            singles: pipeline(Kernel::BvhSingles)?,
            flags: pipeline(Kernel::BvhFlags)?,
            treelets: pipeline(Kernel::BvhTreelets)?,
            start: pipeline(Kernel::BvhStart)?,
            choose: pipeline(Kernel::BvhChoose)?,
            move_treelets: pipeline(Kernel::BvhMove)?,
            small: pipeline(Kernel::BvhSmall)?,
            refit: pipeline(Kernel::BvhRefit)?,
            costs: pipeline(Kernel::BvhCosts)?,
        })
    }

    /// What sorts the keys, for other pairs between two builds.
    pub(super) fn sorter(&self) -> &Sorter {
        &self.sorter
    }

    /// Builds the tree over its boxes in a scratch for as many. Returns what each phase took.
    pub(super) fn build(
        &self,
        commands: &Commands,
        tree: Tree<'_>,
        scratch: &Scratch,
    ) -> Result<BuildTimes, BackendError> {
        let count = tree.state.count;
        self.bind(tree, scratch);
        let bits = key_bits(count);
        let step = BuildStep { count, limbs: limbs(bits), level: 0, level_limit: top::level_limit(count) };
        let marks = commands.run_marked("building the BVH", |recorder| {
            self.record(recorder, tree, scratch, &step, bits);
        })?;
        let &[codes, sort, treelets, top] = &marks[..] else {
            unreachable!("a build has three marks");
        };
        Ok(BuildTimes { codes, sort, treelets, top })
    }

    fn bind(&self, tree: Tree<'_>, scratch: &Scratch) {
        self.sorter.bind(SortBuffers {
            keys: &scratch.keys,
            values: &scratch.values,
            counts: &scratch.counts,
            sums: &scratch.count_sums,
        });
        self.scanner.bind(&scratch.treelet_of, &scratch.treelet_sums);
        for pipeline in [
            &self.centers,
            &self.codes,
            &self.levels,
            &self.threshold,
            &self.singles,
            &self.flags,
            &self.treelets,
            &self.start,
            &self.choose,
            &self.move_treelets,
            &self.small,
        ] {
            pipeline.bind(|at| tree.at(at).unwrap_or_else(|| scratch.at(at)));
        }
    }

    fn record(
        &self,
        recorder: &Recorder<'_>,
        tree: Tree<'_>,
        scratch: &Scratch,
        step: &BuildStep,
        bits: u32,
    ) {
        let count = step.count;
        let dispatch = |pipeline: &Pipeline, step: &BuildStep, groups: u32| {
            recorder.dispatch(pipeline, bytes_of(step), rows(groups));
            recorder.barrier();
        };
        // Never more workgroups than a device takes in a row: see `MAX_PRIMITIVES`.
        let over_blocks = |pipeline: &Pipeline| {
            recorder.dispatch(pipeline, bytes_of(step), [count.div_ceil(morton::BLOCK), 1]);
            recorder.barrier();
        };
        let indirect = |pipeline: &Pipeline, step: &BuildStep, word: u32| {
            recorder.dispatch_indirect(pipeline, bytes_of(step), &tree.state.header, word);
            recorder.barrier();
        };
        recorder.fill(&tree.state.header, 0);
        recorder.fill(&tree.state.arrivals, u32::MAX);
        recorder.fill(&scratch.treelets, 0);
        recorder.fill(&scratch.bins, 0);
        recorder.barrier();
        over_blocks(&self.centers);
        if has_single_treelets(count) {
            dispatch(&self.singles, step, count.div_ceil(BATCH_GROUP_SIZE));
            recorder.mark();
            recorder.mark();
            dispatch(&self.threshold, step, 1);
        } else {
            dispatch(&self.codes, step, count.div_ceil(BATCH_GROUP_SIZE));
            recorder.mark();
            self.sorter.record(recorder, count, bits);
            recorder.mark();
            over_blocks(&self.levels);
            dispatch(&self.threshold, step, 1);
            dispatch(&self.flags, step, count.div_ceil(BATCH_GROUP_SIZE));
            self.scanner.record(recorder, count);
            dispatch(&self.treelets, step, count.div_ceil(BATCH_GROUP_SIZE));
            recorder.barrier_for_arguments();
            indirect(&self.treelets, &BuildStep { level: 1, ..*step }, header::DEEP_GROUPS);
        }
        recorder.mark();
        recorder.dispatch(&self.start, &[], [count.min(MAX_TREELETS).div_ceil(top::MOVE_GROUP_SIZE), 1]);
        recorder.barrier();
        for level in 0..step.level_limit {
            let step = BuildStep { level, ..*step };
            // Of so few workgroups that those without a task cost less than to read how many have one.
            dispatch(&self.choose, &step, top::most_tasks(count));
            dispatch(&self.move_treelets, &step, count.min(MAX_TREELETS).div_ceil(top::MOVE_GROUP_SIZE));
        }
        recorder.barrier_for_arguments();
        indirect(&self.small, step, header::SMALL_GROUPS);
    }

    /// Gives the tree the boxes that its primitives have now. Returns the device's time in milliseconds.
    pub(super) fn refit(&self, commands: &Commands, tree: Tree<'_>) -> Result<f64, BackendError> {
        self.refit.bind(|at| tree.at(at).unwrap_or(tree.nodes));
        let nodes = 2 * tree.state.count.max(1) - 1;
        commands.run("refitting the BVH", |recorder| {
            recorder.put_word(&tree.state.header, header::UNSOUND, 0);
            recorder.barrier();
            recorder.dispatch(&self.refit, &[], rows(nodes.div_ceil(BATCH_GROUP_SIZE)));
        })
    }

    /// The tree's SAH cost, as [`BvhStats::sah_cost`](crate::bvh::BvhStats) but in single precision.
    pub(super) fn cost(
        &self,
        commands: &Commands,
        transfers: &Transfers,
        tree: Tree<'_>,
    ) -> Result<f64, BackendError> {
        self.costs.bind(|at| tree.at(at).unwrap_or(tree.nodes));
        let groups = (2 * tree.state.count.max(1) - 1).div_ceil(refit::BLOCK);
        commands.run("measuring the BVH", |recorder| {
            recorder.dispatch(&self.costs, &[], [groups, 1]);
        })?;
        let costs: Vec<f32> = transfers.read(commands, &tree.state.costs, groups as usize)?;
        Ok(costs.into_iter().map(f64::from).sum())
    }
}
