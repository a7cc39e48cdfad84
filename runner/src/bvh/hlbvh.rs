//! The HLBVH's kernels run on the processor: see [`emboss_kernels::bvh`].

use super::{Bvh, sort};
use bytemuck::cast_slice;
use emboss_kernels::bvh::hlbvh::{NO_ARRIVAL, TREELET_WORDS, choose_threshold, emit_treelet, flag_treelets};
use emboss_kernels::bvh::node::{BOX_FLOATS, NODE_WORDS};
use emboss_kernels::bvh::{header, morton, refit, top};
use emboss_kernels::interface::{BuildStep, BvhNode, MAX_PRIMITIVES};
use emboss_kernels::parallel::{Word, Workgroup};
use rayon::prelude::*;

/// Up to so many primitives one word of key, ten bits along each axis, tells neighbours apart.
const NARROW: u32 = 1 << 20;

/// How the keys of `count` primitives are made: words of a key, and bits that are sorted by.
pub(crate) fn key_shape(count: u32) -> (u32, u32) {
    if count <= NARROW { (1, 32) } else { (2, 64) }
}

/// A tree, and what a refit of it needs.
pub(crate) struct HlbvhBuilder {
    count: u32,
    boxes: Vec<f32>,
    state: Vec<Word>,
    arrivals: Vec<Word>,
    parents: Vec<Word>,
    nodes: Vec<Word>,
    primitives: Vec<Word>,
}

fn words(count: u32, value: u32) -> Vec<Word> {
    (0..count).into_par_iter().map(|_| Word::new(value)).collect()
}

/// Runs `kernel` for each index below `count`.
fn each(count: u32, kernel: impl Fn(u32) + Sync + Send) {
    (0..count).into_par_iter().with_min_len(1024).for_each(kernel);
}

impl HlbvhBuilder {
    /// Builds the tree over boxes of [`BOX_FLOATS`] floats each.
    pub(crate) fn build(boxes: Vec<f32>) -> HlbvhBuilder {
        let count = u32::try_from(boxes.len() / BOX_FLOATS as usize).expect("at most MAX_PRIMITIVES boxes");
        assert!(count <= MAX_PRIMITIVES, "a BVH holds at most {MAX_PRIMITIVES} primitives");
        let pairs = count.max(1);
        let tree = HlbvhBuilder {
            count,
            boxes,
            state: words(header::WORDS, 0),
            arrivals: words(pairs, NO_ARRIVAL),
            parents: words(pairs, 0),
            nodes: words((2 * pairs - 1) * NODE_WORDS, 0),
            primitives: words(pairs, 0),
        };
        tree.run();
        tree
    }

    fn run(&self) {
        let (count, state) = (self.count, &self.state[..]);
        let (limbs, bits) = key_shape(count);
        let step = BuildStep { count, limbs, level: 0, level_limit: top::level_limit(count) };
        (0..count.div_ceil(morton::BLOCK)).into_par_iter().for_each(|id| {
            let mut shared = [0; size_of::<morton::BoundsShared>() / 4];
            morton::center_bounds(Workgroup::new(id), &mut shared, &step, &self.boxes, state);
        });
        let (keys, order) = (words(2 * limbs * count, 0), words(2 * count, 0));
        each(count, |i| morton::encode(&step, &self.boxes, state, &keys, &order, i));
        sort::sort_pairs(&keys, &order, limbs, count, bits);
        let levels = words(count, 0);
        (0..count.div_ceil(morton::BLOCK)).into_par_iter().for_each(|id| {
            let mut shared = [0; size_of::<morton::LevelsShared>() / 4];
            morton::split_levels(Workgroup::new(id), &mut shared, &step, &keys, &levels, state);
        });
        let most_tasks = top::most_tasks(count);
        let tasks = words(2 * most_tasks * top::TASK_WORDS, 0);
        let bins = words(most_tasks * top::TASK_BIN_WORDS, 0);
        let queues = words(2 * most_tasks, 0);
        choose_threshold(state, &tasks, &queues, &self.nodes);
        let treelet_of = words(count, 0);
        each(count, |i| flag_treelets(state, &levels, &treelet_of, i));
        sort::scan(&treelet_of, count);
        let most_treelets = count.min(emboss_kernels::bvh::hlbvh::MAX_TREELETS);
        let treelets = words(most_treelets * TREELET_WORDS, 0);
        let emit = |step: &BuildStep| {
            each(count, |i| {
                emit_treelet(
                    step, &self.boxes, state, &order, &levels, &treelet_of, &self.arrivals, &self.parents,
                    &treelets, &self.nodes, &self.primitives, i,
                );
            });
        };
        emit(&step);
        if state[header::DEEP_GROUPS as usize].get() > 0 {
            emit(&BuildStep { level: 1, ..step });
        }
        let treelet_tasks = words(most_treelets, 0);
        each(most_treelets, |t| {
            top::start_treelet(state, &treelets, &treelet_tasks, &tasks, &bins, &self.nodes, &self.parents, t);
        });
        for level in 0..step.level_limit {
            let step = BuildStep { level, ..step };
            let groups = state[(header::CHOOSE_GROUPS + 3 * level) as usize].get();
            (0..groups).into_par_iter().for_each(|id| {
                let mut shared = [0; size_of::<top::Shared>() / 4];
                top::choose(
                    Workgroup::new(id), &mut shared, &step, state, &treelets, &tasks, &queues, &bins,
                    &self.nodes, &self.parents,
                );
            });
            let groups = state[(header::MOVE_GROUPS + 3 * level) as usize].get();
            each(groups * top::GROUP_SIZE, |t| {
                top::move_treelet(
                    &step, state, &treelets, &treelet_tasks, &tasks, &bins, &self.nodes, &self.parents, t,
                );
            });
        }
    }

    /// Takes over new boxes, of as many primitives.
    pub(crate) fn refit(&mut self, boxes: Vec<f32>) {
        assert_eq!(boxes.len(), self.boxes.len());
        self.boxes = boxes;
        each(2 * self.count, |slot| {
            refit::refit(
                &self.boxes, &self.state, &self.arrivals, &self.parents, &self.nodes, &self.primitives, slot,
            );
        });
    }

    /// The tree as kernels read it.
    pub(crate) fn tree(&self) -> Bvh {
        let sound = self.state[header::SOUND as usize].get();
        let nodes = refit::node_count(sound) * NODE_WORDS;
        let words: Vec<u32> = self.nodes[..nodes as usize].par_iter().map(Word::get).collect();
        let nodes: &[BvhNode] = cast_slice(&words);
        Bvh {
            nodes: if self.count == 0 { Vec::new() } else { nodes.to_vec() },
            primitives: self.primitives[..sound as usize].iter().map(Word::get).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::aabb::Aabb;
    use emboss_kernels::sampler::{pcg4d, unit_float};
    use glam::{UVec4, Vec3};

    fn floats(boxes: &[Aabb]) -> Vec<f32> {
        boxes.iter().flat_map(|b| [b.min, b.max]).flat_map(|p| p.to_array()).collect()
    }

    fn random(count: u32, scale: f32) -> Vec<Aabb> {
        (0..count)
            .map(|i| {
                let bits = pcg4d(UVec4::new(i, 1, 2, 3));
                let min = Vec3::new(unit_float(bits.x), unit_float(bits.y), unit_float(bits.z));
                Aabb { min: min * scale, max: (min + 0.02 * unit_float(bits.w)) * scale }
            })
            .collect()
    }

    #[test]
    fn quick() {
        for count in [0, 1, 2, 3, 7, 255, 256, 257, 1000, 10_000, 100_000, 1_200_000] {
            for scale in [1.0, 1e-30, 1e30] {
                let boxes = random(count, scale);
                let start = std::time::Instant::now();
                let tree = HlbvhBuilder::build(floats(&boxes)).tree();
                let took = start.elapsed();
                let stats = tree.validate(&boxes).expect("valid");
                if count < 20_000 || scale == 1.0 {
                    let host = Bvh::build(&boxes).validate(&boxes).unwrap();
                    println!("{count} {scale}: {stats:?} {took:?} host {} {}", host.sah_cost, host.depth);
                }
            }
        }
    }
}
