//! The top of the tree: over the treelets, from the root down by the surface area heuristic (SAH), evaluated at bins
//! (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007), a level at a time.
//!
//! A *task* is a node that is to be split. A level is two dispatches: [`choose`], a workgroup for each task in the level's
//! queue, and [`move_treelet`], an invocation for each treelet, which takes it to its side of its task's plane and adds
//! it to the bins of the task it finds there.
//!
//! A task over c treelets owns c consecutive numbers, its left child the first of them; so the split of its children has a
//! number of its own, and so has each task that lives at a level: half its first number. Bins hold integers only:
//! maxima and sums that come out alike in any order. Areas are fixed-point shares of the task's own box. Hence the same
//! treelets give the same tree everywhere.

use crate::aabb::Aabb;
use crate::bvh::header;
use crate::bvh::hlbvh::{MAX_TREELETS, SIZE, START, TREELET_WORDS, pair};
use crate::bvh::node::{Extent, center, half_size, load_node, node_word, normalized, put_node};
use crate::interface::{BuildStep, BvhNode};
use crate::parallel::{Word, Workgroup, phase, shared_at, shared_put, word};
use glam::Vec3;

/// Invocations of a workgroup of [`choose`]: one for each bin. Also of [`move_treelet`].
pub const GROUP_SIZE: u32 = AXES * BINS;
/// Most levels of the top.
pub const MOST_LEVELS: u32 = 24;
/// The levels that the top may have beyond those of a balanced one: room for uneven splits where they pay.
const UNEVEN_LEVELS: u32 = 8;

/// Along x, y and z, and along the order of the curve: there no two treelets are at the same place, so that some
/// plane always parts them.
const AXES: u32 = 4;
/// The last of these.
const CURVE: u32 = 3;
/// From 8 to 32 bins the SAH cost of our scenes differs by less than 2 %.
const BINS: u32 = 16;

/// Words of a bin: the extent of its treelets' boxes, that of their centres ...
const CENTERS: u32 = Extent::WORDS;
/// ... the complement of the least number of a treelet, one more than the greatest ...
const NUMBERS: u32 = 2 * Extent::WORDS;
/// ... how many treelets ...
const ITEMS: u32 = NUMBERS + 2;
/// ... and how many primitives. To unite bins, take maxima of the words in front of [`ITEMS`], sums of the others.
const WEIGHT: u32 = ITEMS + 1;
/// How many words.
const BIN_WORDS: u32 = WEIGHT + 1;
/// Words of a task's bins.
pub const TASK_BIN_WORDS: u32 = GROUP_SIZE * BIN_WORDS;

/// Words of a task: the first of its numbers, how many treelets it is over, its slot in the tree ...
const TASK_FIRST: u32 = 0;
const TASK_ITEMS: u32 = 1;
const TASK_SLOT: u32 = 2;
/// ... as in a bin, the extent of centres, then least and greatest numbers ...
const TASK_CENTERS: u32 = 3;
const TASK_NUMBERS: u32 = TASK_CENTERS + Extent::WORDS;
/// ... and, once chosen, the axis of its plane, the first bin behind it, the treelets in front of it, and the number of
/// its pair of children.
const TASK_AXIS: u32 = TASK_NUMBERS + 2;
const TASK_PLANE: u32 = TASK_AXIS + 1;
const TASK_LEFT: u32 = TASK_AXIS + 2;
const TASK_PAIR: u32 = TASK_AXIS + 3;
/// How many words, in two sets: those of a level are read while those of the next are written.
pub const TASK_WORDS: u32 = TASK_PAIR + 1;

/// The task of a treelet that stands in the tree.
const DONE: u32 = u32::MAX;

/// Shared memory of [`choose`]: the bins, then for each plane its cost (upper word, lower word), the treelets on its fuller
/// side and its number, then both children, summed up like bins.
pub type Shared = [u32; (TASK_BIN_WORDS + PLANE_WORDS * GROUP_SIZE + 2 * BIN_WORDS) as usize];
const PLANES: u32 = TASK_BIN_WORDS;
const PLANE_WORDS: u32 = 4;
const CHILDREN: u32 = PLANES + PLANE_WORDS * GROUP_SIZE;

/// How many tasks can live at a level of a tree over `count` primitives.
#[inline]
pub fn most_tasks(count: u32) -> u32 {
    (count.min(MAX_TREELETS) / 2).max(1)
}

/// How many levels the top of a tree over `count` primitives may have: see [`BuildStep::level_limit`].
pub fn level_limit(count: u32) -> u32 {
    rounded_up_log2(count.clamp(1, MAX_TREELETS)) + UNEVEN_LEVELS
}

/// Sets up the task over all treelets, or the root of a tree without any.
#[inline]
pub fn put_first_task(state: &[Word], tasks: &[Word], queues: &[Word], nodes: &[Word], treelets: u32) {
    if treelets == 0 {
        // No ray enters it.
        put_node(nodes, 0, BvhNode { min: Vec3::INFINITY, first: 0, max: Vec3::NEG_INFINITY, count: 0 });
    }
    if treelets > 1 {
        word(tasks, TASK_FIRST).set(0);
        word(tasks, TASK_ITEMS).set(treelets);
        word(tasks, TASK_SLOT).set(0);
        // The middle of a box around boxes lies between their middles, also when rounded.
        let mut i = 0;
        while i < Extent::WORDS {
            word(tasks, TASK_CENTERS + i).set(word(state, header::CENTERS + i).get());
            i += 1;
        }
        word(tasks, TASK_NUMBERS).set(!0);
        word(tasks, TASK_NUMBERS + 1).set(treelets);
        word(queues, 0).set(0);
        word(state, header::CHOOSE_GROUPS).set(1);
    }
}

/// Adds treelet number `t` to the bins of the first task; a single treelet is the tree.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the buffers of a build")]
pub fn start_treelet(
    state: &[Word],
    treelets: &[Word],
    treelet_tasks: &[Word],
    tasks: &[Word],
    bins: &[Word],
    nodes: &[Word],
    parents: &[Word],
    t: u32,
) {
    let count = word(state, header::TREELETS).get();
    if t < count {
        if count == 1 {
            place(treelets, nodes, parents, t, 0);
        } else {
            word(treelet_tasks, t).set(0);
            add_to_bins(treelets, tasks, bins, 0, 0, t);
        }
    }
}

/// Splits task number `group.id` of a level's queue: writes its node, its plane, and its children where they are tasks.
/// Leaves its bins empty.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the buffers of a build")]
pub fn choose(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    step: &BuildStep,
    state: &[Word],
    treelets: &[Word],
    tasks: &[Word],
    queues: &[Word],
    bins: &[Word],
    nodes: &[Word],
    parents: &[Word],
) {
    let set = step.level % 2 * most_tasks(step.count);
    let next_set = most_tasks(step.count) - set;
    let number = word(queues, set + group.id).get();
    let task = (set + number) * TASK_WORDS;
    phase!(group, |local| {
        let mut i = local;
        while i < TASK_BIN_WORDS {
            let bin_word = word(bins, number * TASK_BIN_WORDS + i);
            shared_put(shared, i, bin_word.get());
            bin_word.set(0);
            i += GROUP_SIZE;
        }
    });
    // Two treelets, half of all tasks, are parted by any plane.
    let two = word(tasks, task + TASK_ITEMS).get() == 2;
    phase!(group, |local| {
        if two && local == 0 {
            shared_put(shared, PLANES + 3, CURVE * BINS + BINS / 2);
        } else if !two {
            evaluate_plane(shared, local, must_halve(step, tasks, task));
        }
    });
    let mut distance = if two { 0 } else { GROUP_SIZE / 2 };
    while distance > 0 {
        phase!(group, |local| {
            if local < distance {
                keep_better_plane(shared, local, local + distance);
            }
        });
        distance /= 2;
    }
    phase!(group, |local| {
        if local < 2 * BIN_WORDS {
            sum_child(shared, local);
        }
    });
    phase!(group, |local| {
        if local < 2 {
            let first = word(tasks, task + TASK_FIRST).get();
            let left_items = shared_at(shared, CHILDREN + ITEMS);
            // Any treelet but the last has a split behind it: that of this number lends its pair.
            let lender = (first + left_items - 1) * TREELET_WORDS;
            let pair = word(treelets, lender + START).get() + word(treelets, lender + SIZE).get() - 1;
            if local == 0 {
                put_split(shared, tasks, task, pair, nodes, parents);
                let groups = word(state, header::TREELETS).get().div_ceil(GROUP_SIZE);
                word(state, header::MOVE_GROUPS + 3 * step.level).max(groups);
            }
            let child = CHILDREN + local * BIN_WORDS;
            let items = shared_at(shared, child + ITEMS);
            if items > 1 {
                let first = first + local * left_items;
                let number = first / 2;
                let task = (next_set + number) * TASK_WORDS;
                word(tasks, task + TASK_FIRST).set(first);
                word(tasks, task + TASK_ITEMS).set(items);
                word(tasks, task + TASK_SLOT).set(1 + 2 * pair + local);
                let mut i = 0;
                while i < ITEMS - CENTERS {
                    word(tasks, task + TASK_CENTERS + i).set(shared_at(shared, child + CENTERS + i));
                    i += 1;
                }
                let place = word(state, header::CHOOSE_GROUPS + 3 * (step.level + 1)).add(1);
                word(queues, next_set + place).set(number);
            }
        }
    });
}

/// Writes a task's node, whose children are pair number `pair`, and its plane.
#[inline]
fn put_split(shared: &Shared, tasks: &[Word], task: u32, pair: u32, nodes: &[Word], parents: &[Word]) {
    let plane = shared_at(shared, PLANES + 3);
    let slot = word(tasks, task + TASK_SLOT).get();
    let (left, right) =
        (Extent::shared_load(shared, CHILDREN), Extent::shared_load(shared, CHILDREN + BIN_WORDS));
    let bounds = left.union(right).bounds();
    put_node(
        nodes,
        node_word(slot),
        BvhNode { min: bounds.min, first: 1 + 2 * pair, max: bounds.max, count: 0 },
    );
    word(parents, pair).set(slot);
    word(tasks, task + TASK_AXIS).set(plane / BINS);
    word(tasks, task + TASK_PLANE).set(plane % BINS);
    word(tasks, task + TASK_LEFT).set(shared_at(shared, CHILDREN + ITEMS));
    word(tasks, task + TASK_PAIR).set(pair);
}

/// Takes treelet number `t` to its side of its task's plane: to its place in the tree where it is alone there, else to the
/// bins of the task there.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the buffers of a build")]
pub fn move_treelet(
    step: &BuildStep,
    state: &[Word],
    treelets: &[Word],
    treelet_tasks: &[Word],
    tasks: &[Word],
    bins: &[Word],
    nodes: &[Word],
    parents: &[Word],
    t: u32,
) {
    if t < word(state, header::TREELETS).get() {
        let number = word(treelet_tasks, t).get();
        if number != DONE {
            let set = step.level % 2 * most_tasks(step.count);
            let next_set = most_tasks(step.count) - set;
            let task = (set + number) * TASK_WORDS;
            let axis = word(tasks, task + TASK_AXIS).get();
            let middle = center(bounds_of(treelets, t));
            let bin = bin_of(tasks, task, axis, middle, t);
            let right = (bin >= word(tasks, task + TASK_PLANE).get()) as u32;
            let left_items = word(tasks, task + TASK_LEFT).get();
            let items =
                if right == 0 { left_items } else { word(tasks, task + TASK_ITEMS).get() - left_items };
            if items == 1 {
                let slot = 1 + 2 * word(tasks, task + TASK_PAIR).get() + right;
                place(treelets, nodes, parents, t, slot);
                word(treelet_tasks, t).set(DONE);
            } else {
                let number = (word(tasks, task + TASK_FIRST).get() + right * left_items) / 2;
                word(treelet_tasks, t).set(number);
                add_to_bins(treelets, tasks, bins, next_set, number, t);
            }
        }
    }
}

/// Writes a treelet's root into a slot of the tree.
#[inline]
fn place(treelets: &[Word], nodes: &[Word], parents: &[Word], t: u32, slot: u32) {
    let root = load_node(treelets, t * TREELET_WORDS);
    put_node(nodes, node_word(slot), root);
    if root.count == 0 {
        word(parents, pair(root.first)).set(slot);
    }
}

#[inline]
fn bounds_of(treelets: &[Word], t: u32) -> Aabb {
    let root = load_node(treelets, t * TREELET_WORDS);
    Aabb { min: root.min, max: root.max }
}

/// Adds treelet number `t` to its bins along each axis of task `number` of a set.
#[inline]
fn add_to_bins(treelets: &[Word], tasks: &[Word], bins: &[Word], set: u32, number: u32, t: u32) {
    let bounds = bounds_of(treelets, t);
    let weight = word(treelets, t * TREELET_WORDS + SIZE).get();
    let middle = center(bounds);
    let mut axis = 0;
    while axis < AXES {
        let bin = bin_of(tasks, (set + number) * TASK_WORDS, axis, middle, t);
        let first = number * TASK_BIN_WORDS + (axis * BINS + bin) * BIN_WORDS;
        Extent::of(bounds).widen(bins, first);
        Extent::of(Aabb { min: middle, max: middle }).widen(bins, first + CENTERS);
        word(bins, first + NUMBERS).max(!t);
        word(bins, first + NUMBERS + 1).max(t + 1);
        word(bins, first + ITEMS).add(1);
        word(bins, first + WEIGHT).add(weight);
        axis += 1;
    }
}

/// The bin of a treelet along an axis of a task: 16 of equal width cover what its treelets do.
#[inline]
fn bin_of(tasks: &[Word], task: u32, axis: u32, middle: Vec3, t: u32) -> u32 {
    if axis == CURVE {
        let least = !word(tasks, task + TASK_NUMBERS).get();
        let width = word(tasks, task + TASK_NUMBERS + 1).get() - least;
        (t - least) * BINS / width
    } else {
        let centers = Extent::load(tasks, task + TASK_CENTERS).bounds();
        let (low, high, at) = if axis == 0 {
            (centers.min.x, centers.max.x, middle.x)
        } else if axis == 1 {
            (centers.min.y, centers.max.y, middle.y)
        } else {
            (centers.min.z, centers.max.z, middle.z)
        };
        // In 2^16 steps of the next power of two, so that nothing is rounded but downwards.
        let size = high * 0.5 - low * 0.5;
        let offset = (normalized(at * 0.5 - low * 0.5, size) * 65536.0) as u32;
        let width = (normalized(size, size) * 65536.0) as u32 + 1;
        offset * BINS / width
    }
}

/// Whether a task has to be split in the middle of the curve's order, so that the top keeps its limit on levels.
///
/// Let s be how far its treelets' numbers spread, and levels(s) = ceil(log2 s). The invariant is level + levels(s) <=
/// limit; it holds at the root. Children spread no further than s, so any plane keeps it where level + 1 + levels(s)
/// is within the limit; halving makes levels one less. As s >= 2, level < limit for every task.
#[inline]
fn must_halve(step: &BuildStep, tasks: &[Word], task: u32) -> bool {
    let least = !word(tasks, task + TASK_NUMBERS).get();
    let spread = word(tasks, task + TASK_NUMBERS + 1).get() - least;
    step.level + 1 + rounded_up_log2(spread) > step.level_limit
}

/// ceil(log2 n), n at least 1.
#[inline]
fn rounded_up_log2(n: u32) -> u32 {
    32 - (n - 1).leading_zeros()
}

/// Writes the cost of the plane in front of bin `local`: for both sides area times number of primitives. There is none in
/// front of an axis' first bin, nor where a side is empty: such a plane costs more than any.
#[inline]
fn evaluate_plane(shared: &mut Shared, local: u32, must_halve: bool) {
    let (axis, plane) = (local / BINS, local % BINS);
    let (mut left, mut right) = (Extent::default(), Extent::default());
    let (mut left_weight, mut right_weight) = (0u32, 0u32);
    let (mut left_items, mut right_items) = (0, 0);
    let mut bin = 0;
    while bin < BINS {
        let first = (axis * BINS + bin) * BIN_WORDS;
        let extent = Extent::shared_load(shared, first);
        let (items, weight) = (shared_at(shared, first + ITEMS), shared_at(shared, first + WEIGHT));
        if bin < plane {
            left = left.union(extent);
            left_weight += weight;
            left_items += items;
        } else {
            right = right.union(extent);
            right_weight += weight;
            right_items += items;
        }
        bin += 1;
    }
    let (mut high, mut low, mut larger) = (u32::MAX, u32::MAX, u32::MAX);
    let middle = axis == CURVE && plane == BINS / 2;
    if left_items > 0 && right_items > 0 && (!must_halve || middle) {
        let size = half_size(left.union(right).bounds()).max_element();
        let (left_high, left_low) = wide_product(area(left, size), left_weight);
        let (right_high, right_low) = wide_product(area(right, size), right_weight);
        low = left_low.wrapping_add(right_low);
        high = left_high + right_high + (low < left_low) as u32;
        larger = left_items.max(right_items);
    }
    let entry = PLANES + local * PLANE_WORDS;
    shared_put(shared, entry, high);
    shared_put(shared, entry + 1, low);
    shared_put(shared, entry + 2, larger);
    shared_put(shared, entry + 3, local);
}

/// Half the surface of a box in units of 2^-30 of the square of twice `size`, the longest half side of a box around it:
/// each face rounded down.
#[inline]
fn area(extent: Extent, size: f32) -> u32 {
    let half = half_size(extent.bounds());
    let (x, y, z) = (normalized(half.x, size), normalized(half.y, size), normalized(half.z, size));
    let unit = (1u32 << 30) as f32;
    // Each below 2^30; summed as integers, since a driver may contract a sum of products, or not.
    (x * y * unit) as u32 + (y * z * unit) as u32 + (z * x * unit) as u32
}

/// The upper and the lower word of a product.
#[inline]
fn wide_product(a: u32, b: u32) -> (u32, u32) {
    let (a1, a0, b1, b0) = (a >> 16, a & 0xFFFF, b >> 16, b & 0xFFFF);
    let low = a0 * b0;
    // Neither sum overflows: (2^16 - 1)^2 + 2 (2^16 - 1) = 2^32 - 1.
    let middle = a1 * b0 + (low >> 16);
    let middle_low = (middle & 0xFFFF) + a0 * b1;
    (a1 * b1 + (middle >> 16) + (middle_low >> 16), middle_low << 16 | low & 0xFFFF)
}

/// Keeps the better of two planes in the first one's place: the cheaper, or as cheap and more even (boxes in a line have
/// no area, so that all their costs are 0), or the first.
#[inline]
fn keep_better_plane(shared: &mut Shared, one: u32, other: u32) {
    let (one, other) = (PLANES + one * PLANE_WORDS, PLANES + other * PLANE_WORDS);
    let mut better = false;
    let mut i = 0;
    while i < PLANE_WORDS {
        let (a, b) = (shared_at(shared, one + i), shared_at(shared, other + i));
        if a != b {
            better = b < a;
            i = PLANE_WORDS;
        }
        i += 1;
    }
    if better {
        let mut i = 0;
        while i < PLANE_WORDS {
            shared_put(shared, one + i, shared_at(shared, other + i));
            i += 1;
        }
    }
}

/// Sums up word `local % BIN_WORDS` of the left (`local < BIN_WORDS`) or right child of the best plane.
#[inline]
fn sum_child(shared: &mut Shared, local: u32) {
    let plane = shared_at(shared, PLANES + 3);
    let (axis, plane) = (plane / BINS, plane % BINS);
    let (side, i) = (local / BIN_WORDS, local % BIN_WORDS);
    let mut sum = 0;
    let mut bin = if side == 0 { 0 } else { plane };
    let end = if side == 0 { plane } else { BINS };
    while bin < end {
        let value = shared_at(shared, (axis * BINS + bin) * BIN_WORDS + i);
        sum = if i < ITEMS { sum.max(value) } else { sum + value };
        bin += 1;
    }
    shared_put(shared, CHILDREN + local, sum);
}
