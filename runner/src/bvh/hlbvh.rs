//! The HLBVH's kernels run on the processor: see [`emboss_kernels::bvh`].

use super::scan::scan;
use super::{BuildTimes, Bvh, key_bits, sort};
use bytemuck::cast_slice;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::hlbvh::{
    MAX_TREELETS, NO_ARRIVAL, TREELET_WORDS, choose_threshold, emit_single, emit_treelet, flag_treelets,
    has_single_treelets,
};
use emboss_kernels::bvh::node::{BOX_FLOATS, NODE_WORDS};
use emboss_kernels::bvh::radix_sort::limbs;
use emboss_kernels::bvh::top::TopBuffers;
use emboss_kernels::bvh::{header, morton, refit, small, top};
use emboss_kernels::interface::{BuildStep, BvhNode, MAX_PRIMITIVES};
use emboss_kernels::parallel::{Word, Workgroup};
use rayon::prelude::*;
use std::time::Instant;

/// A tree, with what a refit of it needs.
#[derive(Clone, Debug)]
pub struct Hlbvh {
    count: u32,
    boxes: Vec<f32>,
    state: Vec<Word>,
    arrivals: Vec<Word>,
    parents: Vec<Word>,
    nodes: Vec<Word>,
    primitives: Vec<Word>,
    times: BuildTimes,
}

impl Hlbvh {
    /// Builds the tree over `boxes`. Those that are not [sound](emboss_kernels::bvh::node::is_sound) are left out.
    ///
    /// # Panics
    /// If there are more than [`MAX_PRIMITIVES`].
    pub fn build(boxes: &[Aabb]) -> Hlbvh {
        let count = u32::try_from(boxes.len()).unwrap_or(u32::MAX);
        assert!(count <= MAX_PRIMITIVES, "a BVH holds at most {MAX_PRIMITIVES} primitives");
        let pairs = count.max(1);
        let mut tree = Hlbvh {
            count,
            boxes: floats(boxes),
            state: words(header::WORDS, 0),
            arrivals: words(pairs, NO_ARRIVAL),
            parents: words(pairs, 0),
            nodes: words((2 * pairs - 1) * NODE_WORDS, 0),
            primitives: words(pairs, 0),
            times: BuildTimes::default(),
        };
        tree.times = tree.run();
        tree
    }

    /// Gives the nodes the boxes that the primitives have now. Returns whether all of those in the tree are sound: else
    /// it has to be built again, and also where one that was left out has become sound.
    ///
    /// # Panics
    /// If there are not as many boxes as before.
    pub fn refit(&mut self, boxes: &[Aabb]) -> bool {
        assert_eq!(boxes.len(), self.count as usize, "a refit keeps the primitives");
        self.boxes = floats(boxes);
        self.state[header::UNSOUND as usize].set(0);
        each(2 * self.count, |slot| {
            let Hlbvh { boxes, state, arrivals, parents, nodes, primitives, .. } = &*self;
            refit::refit(boxes, state, arrivals, parents, nodes, primitives, slot);
        });
        self.state[header::UNSOUND as usize].get() == 0
    }

    /// The tree as kernels read it.
    pub fn tree(&self) -> Bvh {
        if self.count == 0 {
            return Bvh::default();
        }
        let nodes = refit::node_count(self.sound()) * NODE_WORDS;
        let words: Vec<u32> = self.nodes[..nodes as usize].par_iter().map(Word::get).collect();
        Bvh {
            nodes: cast_slice::<u32, BvhNode>(&words).to_vec(),
            primitives: self.primitives.iter().map(Word::get).collect(),
        }
    }

    /// How many primitives are in the tree.
    pub fn sound(&self) -> u32 {
        self.state[header::SOUND as usize].get()
    }

    /// Its SAH cost, as [`BvhStats::sah_cost`](super::BvhStats::sah_cost) but in single precision.
    pub fn cost(&self) -> f64 {
        let blocks = refit::node_count(self.sound()).div_ceil(refit::BLOCK);
        let costs = words(blocks, 0);
        groups(blocks, |id| {
            let mut shared = [0; size_of::<refit::Shared>() / 4];
            refit::sum_costs(Workgroup::new(id), &mut shared, &self.state, &self.nodes, &costs);
        });
        costs.iter().map(|cost| f64::from(f32::from_bits(cost.get()))).sum()
    }

    /// Whether some treelet came out deeper than [`MAX_TREELET_DEPTH`](emboss_kernels::bvh::hlbvh::MAX_TREELET_DEPTH),
    /// and was built again by halving.
    pub fn has_deep_treelets(&self) -> bool {
        self.state[header::DEEP_GROUPS as usize].get() > 0
    }

    /// What the phases of its build took.
    pub fn times(&self) -> BuildTimes {
        self.times
    }

    fn run(&self) -> BuildTimes {
        let Hlbvh { count, boxes, state, arrivals, parents, nodes, primitives, .. } = self;
        let (count, bits) = (*count, key_bits(*count));
        let step = BuildStep { count, limbs: limbs(bits), level: 0, level_limit: top::level_limit(count) };
        let mut clock = Clock(Instant::now());
        let blocks = count.div_ceil(morton::BLOCK);
        groups(blocks, |id| {
            let mut shared = [0; size_of::<morton::BoundsShared>() / 4];
            morton::center_bounds(Workgroup::new(id), &mut shared, &step, boxes, state);
        });
        let most_treelets = count.min(MAX_TREELETS);
        let most_tasks = top::most_tasks(count);
        let treelets = words(most_treelets * TREELET_WORDS, 0);
        let buffers = TopBuffers {
            state,
            treelets: &treelets,
            treelet_tasks: &words(most_treelets, 0),
            tasks: &words(2 * most_tasks * top::TASK_WORDS, 0),
            queues: &words(2 * most_tasks + small::most_small_tasks(count), 0),
            bins: &words(top::bin_words(count), 0),
            small_tasks: &words(small::most_small_tasks(count) * small::SMALL_TASK_WORDS, 0),
            lists: &words(most_treelets, 0),
            nodes,
            parents,
        };
        let mut times = BuildTimes::default();
        if has_single_treelets(count) {
            each(count, |i| emit_single(boxes, &treelets, primitives, i));
            choose_threshold(&step, &buffers);
            times.codes = clock.lap();
        } else {
            let (keys, order) = (words(2 * step.limbs * count, 0), words(2 * count, 0));
            each(count, |i| morton::encode(&step, boxes, state, &keys, &order, i));
            times.codes = clock.lap();

            sort::sort_pairs(&keys, &order, count, bits);
            times.sort = clock.lap();

            let levels = words(count, 0);
            groups(blocks, |id| {
                let mut shared = [0; size_of::<morton::LevelsShared>() / 4];
                morton::split_levels(Workgroup::new(id), &mut shared, &step, &keys, &levels, state);
            });
            choose_threshold(&step, &buffers);
            let treelet_of = words(count, 0);
            each(count, |i| flag_treelets(state, &levels, &treelet_of, i));
            scan(&treelet_of);
            let emit = |level: u32| {
                let step = BuildStep { level, ..step };
                each(count, |i| {
                    emit_treelet(
                        &step,
                        boxes,
                        state,
                        &order,
                        &levels,
                        &treelet_of,
                        arrivals,
                        parents,
                        &treelets,
                        nodes,
                        primitives,
                        i,
                    );
                });
            };
            emit(0);
            if state[header::DEEP_GROUPS as usize].get() > 0 {
                emit(1);
            }
            times.treelets = clock.lap();
        }
        each(most_treelets, |t| top::start_treelet(&buffers, t));
        for level in 0..step.level_limit {
            let step = BuildStep { level, ..step };
            let tasks = top::task_count(&step, state);
            if tasks == 0 {
                break;
            }
            groups(tasks, |id| {
                let mut shared = [0; size_of::<top::Shared>() / 4];
                top::choose(Workgroup::new(id), &mut shared, &step, &buffers);
            });
            each(most_treelets, |t| top::move_treelet(&step, &buffers, t));
        }
        groups(state[header::SMALL_GROUPS as usize].get(), |id| {
            let mut shared = [0; size_of::<small::Shared>() / 4];
            small::split_small_task(Workgroup::new(id), &mut shared, &step, &buffers);
        });
        times.top = clock.lap();
        times
    }
}

/// Milliseconds since it was last asked.
struct Clock(Instant);

impl Clock {
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        now.duration_since(std::mem::replace(&mut self.0, now)).as_secs_f64() * 1e3
    }
}

/// Boxes as the kernels read them.
fn floats(boxes: &[Aabb]) -> Vec<f32> {
    let mut floats = vec![0.0; boxes.len() * BOX_FLOATS as usize];
    floats.par_chunks_exact_mut(BOX_FLOATS as usize).zip(boxes).for_each(|(floats, bounds)| {
        floats[..3].copy_from_slice(bounds.min.as_ref());
        floats[3..].copy_from_slice(bounds.max.as_ref());
    });
    floats
}

fn words(count: u32, value: u32) -> Vec<Word> {
    (0..count).into_par_iter().map(|_| Word::new(value)).collect()
}

/// Runs a kernel without phases for each index below `count`.
fn each(count: u32, kernel: impl Fn(u32) + Sync + Send) {
    (0..count).into_par_iter().with_min_len(256).for_each(kernel);
}

/// Runs `count` workgroups.
fn groups(count: u32, kernel: impl Fn(u32) + Sync + Send) {
    (0..count).into_par_iter().for_each(kernel);
}
