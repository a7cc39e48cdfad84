//! The top of the tree: over the treelets, from the root down by the surface area heuristic (SAH), evaluated at bins
//! (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007), a level at a time.
//!
//! A *task* is a node that is to be split. A level is two dispatches: [`choose`], a workgroup for each task in the
//! level's queue, and [`move_treelet`], an invocation for each treelet, which takes it to its side of its task's plane
//! and adds it to the bins of the task it finds there. Tasks of few treelets leave the levels for [`small`].
//!
//! A task over c treelets owns c consecutive numbers, its left child the first of them; so the split of its children
//! has a number of its own, and so has each task: see `task_number`. Bins hold integers only: maxima and sums that come
//! out alike in any order. Areas are fixed-point shares of the task's own box. Hence the same treelets give the same
//! tree everywhere.

use crate::aabb::Aabb;
use crate::bvh::header;
use crate::bvh::hlbvh::{LAST, MAX_TREELET_DEPTH, MAX_TREELETS, SIZE, TREELET_WORDS, pair};
use crate::bvh::node::{Extent, center, half_size, load_node, node_word, normalized, put_node};
use crate::bvh::small::{self, MOST_SMALL};
use crate::interface::{BuildStep, BvhNode, MAX_BVH_DEPTH};
use crate::parallel::{Word, Workgroup, phase, shared_at, shared_put, word};
use glam::Vec3;

/// Invocations of a workgroup of [`choose`]: at least as many as planes and as words of two children. More of them read
/// the copies of bins sooner.
pub const GROUP_SIZE: u32 = 128;
const _: () = assert!(GROUP_SIZE >= PLANES && GROUP_SIZE >= 2 * BIN_WORDS);
/// Invocations of a workgroup of [`start_treelet`] and of [`move_treelet`].
pub const MOVE_GROUP_SIZE: u32 = 64;
/// Most levels of tasks.
pub const MOST_LEVELS: u32 = level_limit(MAX_TREELETS);
const _: () = assert!(MOST_LEVELS + small::LEVEL_LIMIT + MAX_TREELET_DEPTH <= MAX_BVH_DEPTH);
/// The levels that the top may have beyond twice those of a balanced one: room for uneven splits where they pay. Half
/// of all are kept for halving where treelets are in no order on a curve, since there only halving narrows their
/// numbers.
const UNEVEN_LEVELS: u32 = 3;

/// From 8 to 32 bins the SAH cost of our scenes differs by less than 2 %.
const BINS: u32 = 16;
/// Along x, y and z [`BINS`] each, then two along the order of the curve: there no two treelets are at the same place,
/// so that the plane between the halves always parts some.
const TASK_BINS: u32 = CURVE * BINS + 2;
/// The axis along the curve's order, behind x, y and z.
const CURVE: u32 = 3;

/// Words of a bin: the extent of its treelets, the complement of the least number of a treelet, one more than the
/// greatest ...
const NUMBERS: u32 = Extent::WORDS;
/// ... how many treelets ...
const ITEMS: u32 = NUMBERS + 2;
/// ... and how many primitives. To unite bins, take maxima of the words in front of [`ITEMS`], sums of the others.
const WEIGHT: u32 = ITEMS + 1;
/// How many words.
const BIN_WORDS: u32 = WEIGHT + 1;
/// Words of a task's bins.
const TASK_BIN_WORDS: u32 = TASK_BINS * BIN_WORDS;
/// The root's bins are there so many times, those of a level's tasks half as many times as those of the level before,
/// down to once: treelets take turns, since atomics on few addresses wait for each other.
const ROOT_COPIES: u32 = 16;

/// Words of a task: the first of its numbers, how many treelets it is over, its slot in the tree ...
const TASK_FIRST: u32 = 0;
const TASK_ITEMS: u32 = 1;
const TASK_SLOT: u32 = 2;
/// ... as in a bin, what its bins cover, then least and greatest numbers ...
const TASK_EXTENT: u32 = 3;
const TASK_NUMBERS: u32 = TASK_EXTENT + Extent::WORDS;
/// ... the task's place in its level's queue, which decides where its bins are ...
const TASK_PLACE: u32 = TASK_NUMBERS + 2;
/// ... and, once chosen, the axis of its plane, the first bin behind it, the treelets in front of it, and the number of
/// its pair of children.
const TASK_AXIS: u32 = TASK_PLACE + 1;
const TASK_PLANE: u32 = TASK_AXIS + 1;
const TASK_LEFT: u32 = TASK_AXIS + 2;
const TASK_PAIR: u32 = TASK_AXIS + 3;
/// How many words, in two sets: those of a level are read while those of the next are written.
pub const TASK_WORDS: u32 = TASK_PAIR + 1;

/// The task of a treelet that stands in the tree, or waits for [`small`].
const DONE: u32 = u32::MAX;

/// Planes that a task is evaluated at, some of which are none: see [`evaluate_plane`].
const PLANES: u32 = TASK_BINS.next_power_of_two();

/// Shared memory of [`choose`]: the bins, then for each plane its cost and its number, then both children, summed up
/// like bins, then what it needs of the task: the first of its numbers, its slot, and whether it is to be halved.
pub type Shared = [u32; (HEAD + HEAD_WORDS) as usize];
const PLANE: u32 = TASK_BIN_WORDS;
const PLANE_NUMBER: u32 = Cost::WORDS;
const PLANE_WORDS: u32 = PLANE_NUMBER + 1;
const CHILDREN: u32 = PLANE + PLANE_WORDS * PLANES;
const HEAD: u32 = CHILDREN + 2 * BIN_WORDS;
const HEAD_FIRST: u32 = HEAD;
const HEAD_SLOT: u32 = HEAD + 1;
const HEAD_HALVE: u32 = HEAD + 2;
const HEAD_WORDS: u32 = 3;
/// The number of the plane along the curve; those along the axes have that of the bin behind.
const CURVE_PLANE: u32 = CURVE * BINS + 1;

/// How many tasks can live at a level of a tree over `count` primitives.
#[inline]
pub const fn most_tasks(count: u32) -> u32 {
    let treelets = if count < MAX_TREELETS { count } else { MAX_TREELETS };
    treelets / MOST_SMALL + 1
}

/// Words of the bins of a tree over `count` primitives. A level has at most twice as many tasks as the one before.
pub const fn bin_words(count: u32) -> u32 {
    let tasks = most_tasks(count);
    TASK_BIN_WORDS * if tasks < ROOT_COPIES { ROOT_COPIES } else { tasks }
}

/// How many copies of its bins a task of a level has.
#[inline]
fn bin_copies(level: u32) -> u32 {
    (ROOT_COPIES >> level.min(31)).max(1)
}

/// What no other task at its level has, nor any number above: each owns more than [`MOST_SMALL`] numbers from `first`
/// on.
#[inline]
fn task_number(first: u32) -> u32 {
    first / MOST_SMALL
}

/// How many levels of tasks the top of a tree over `count` primitives may have: see [`BuildStep::level_limit`].
pub const fn level_limit(count: u32) -> u32 {
    2 * rounded_up_log2(most_tasks(count)) + UNEVEN_LEVELS
}

/// Sets up the task over `items` treelets of `treelets`, or the root of a tree without any.
#[inline]
pub fn put_first_task(buffers: &TopBuffers<'_>, step: &BuildStep, treelets: u32, items: u32) {
    word(buffers.state, header::TREELETS).set(treelets);
    word(buffers.state, header::ITEMS).set(items);
    if items == 0 {
        // No ray enters it.
        let root = BvhNode { min: Vec3::INFINITY, first: 0, max: Vec3::NEG_INFINITY, count: 0 };
        put_node(buffers.nodes, 0, root);
    } else if items > MOST_SMALL {
        let tasks = buffers.tasks;
        word(tasks, TASK_FIRST).set(0);
        word(tasks, TASK_ITEMS).set(items);
        word(tasks, TASK_SLOT).set(0);
        // The middle of a box around boxes lies between their middles, also when rounded.
        let mut i = 0;
        while i < Extent::WORDS {
            word(tasks, TASK_EXTENT + i).set(word(buffers.state, header::CENTERS + i).get());
            i += 1;
        }
        word(tasks, TASK_NUMBERS).set(!0);
        word(tasks, TASK_NUMBERS + 1).set(treelets);
        word(tasks, TASK_PLACE).set(0);
        word(buffers.queues, 0).set(0);
        word(buffers.state, header::TASK_COUNTS).set(1);
    } else if items > 1 {
        small::put_task(buffers, step, 0, items, 0);
    }
}

/// Adds treelet number `t` to the first task; a single treelet is the tree.
#[inline]
pub fn start_treelet(buffers: &TopBuffers<'_>, t: u32) {
    if t < word(buffers.state, header::TREELETS).get() {
        let items = word(buffers.state, header::ITEMS).get();
        let mut task = DONE;
        if word(buffers.treelets, t * TREELET_WORDS + SIZE).get() > 0 {
            if items > MOST_SMALL {
                task = 0;
                add_to_bins(buffers, 0, 0, t);
            } else if items > 1 {
                small::add_treelet(buffers, 0, t);
            } else {
                place(buffers, t, 0);
            }
        }
        word(buffers.treelet_tasks, t).set(task);
    }
}

/// How many tasks a level has.
#[inline]
pub fn task_count(step: &BuildStep, state: &[Word]) -> u32 {
    word(state, header::TASK_COUNTS + step.level).get()
}

/// Splits task number `group.id` of a level's queue: writes its node, its plane, and its children where they are tasks.
/// Leaves its bins empty.
#[inline]
pub fn choose(group: Workgroup<GROUP_SIZE>, shared: &mut Shared, step: &BuildStep, buffers: &TopBuffers<'_>) {
    let tasks = buffers.tasks;
    let set = step.level % 2 * most_tasks(step.count);
    let next_set = most_tasks(step.count) - set;
    let number = word(buffers.queues, set + group.id).get();
    let task = (set + number) * TASK_WORDS;
    phase!(group, |local| {
        if local == 0 {
            shared_put(shared, HEAD_FIRST, word(tasks, task + TASK_FIRST).get());
            shared_put(shared, HEAD_SLOT, word(tasks, task + TASK_SLOT).get());
            shared_put(shared, HEAD_HALVE, must_halve(step, tasks, task) as u32);
        }
        let mut i = local;
        while i < TASK_BIN_WORDS {
            shared_put(shared, i, take_bin_word(buffers.bins, step.level, group.id, i));
            i += GROUP_SIZE;
        }
    });
    phase!(group, |local| {
        if local < PLANES {
            evaluate_plane(shared, local);
        }
    });
    let mut distance = PLANES / 2;
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
            let first = shared_at(shared, HEAD_FIRST);
            let left_items = shared_at(shared, CHILDREN + ITEMS);
            let pair = pair_of_split(buffers.treelets, first + left_items - 1);
            if local == 0 {
                put_split(shared, buffers, task, pair);
            }
            let child = CHILDREN + local * BIN_WORDS;
            let items = shared_at(shared, child + ITEMS);
            let first = first + local * left_items;
            let slot = 1 + 2 * pair + local;
            if items > MOST_SMALL {
                let number = task_number(first);
                let task = (next_set + number) * TASK_WORDS;
                word(tasks, task + TASK_FIRST).set(first);
                word(tasks, task + TASK_ITEMS).set(items);
                word(tasks, task + TASK_SLOT).set(slot);
                let mut i = 0;
                while i < ITEMS {
                    word(tasks, task + TASK_EXTENT + i).set(shared_at(shared, child + i));
                    i += 1;
                }
                let place = word(buffers.state, header::TASK_COUNTS + step.level + 1).add(1);
                word(tasks, task + TASK_PLACE).set(place);
                word(buffers.queues, next_set + place).set(number);
            } else if items > 1 {
                small::put_task(buffers, step, first, items, slot);
            }
        }
    });
}

/// Word `i` of the bins of the task at `place` in a level's queue, of all copies; they are left empty.
#[inline]
fn take_bin_word(bins: &[Word], level: u32, place: u32, i: u32) -> u32 {
    let copies = bin_copies(level);
    let first = place * copies * TASK_BIN_WORDS + i;
    let mut total = 0;
    let mut copy = 0;
    while copy < copies {
        // Four at a time, so that they are on their way together.
        let (a, b) = (copy_of(bins, first, copy, copies), copy_of(bins, first, copy + 1, copies));
        let (c, d) = (copy_of(bins, first, copy + 2, copies), copy_of(bins, first, copy + 3, copies));
        total = united(i, total, united(i, united(i, a, b), united(i, c, d)));
        copy += 4;
    }
    let mut copy = 0;
    while copy < copies {
        word(bins, first + copy * TASK_BIN_WORDS).set(0);
        copy += 1;
    }
    total
}

/// The word of a copy, 0 where there are no more.
#[inline]
fn copy_of(bins: &[Word], first: u32, copy: u32, copies: u32) -> u32 {
    if copy < copies { word(bins, first + copy * TASK_BIN_WORDS).get() } else { 0 }
}

/// Word `i` of a bin, or of several in a row, for two sets of treelets together.
#[inline]
fn united(i: u32, one: u32, other: u32) -> u32 {
    if i % BIN_WORDS < ITEMS { one.max(other) } else { one + other }
}

/// The pair of siblings that split number `split` of the top lends: that of the split behind the treelet of that
/// number.
#[inline]
pub fn pair_of_split(treelets: &[Word], split: u32) -> u32 {
    word(treelets, split * TREELET_WORDS + LAST).get()
}

/// Writes a task's node, whose children are pair number `pair`, and its plane.
#[inline]
fn put_split(shared: &Shared, buffers: &TopBuffers<'_>, task: u32, pair: u32) {
    let tasks = buffers.tasks;
    let plane = shared_at(shared, PLANE + PLANE_NUMBER);
    let slot = shared_at(shared, HEAD_SLOT);
    let (left, right) =
        (Extent::shared_load(shared, CHILDREN), Extent::shared_load(shared, CHILDREN + BIN_WORDS));
    put_inner(buffers, slot, left.union(right).bounds(), pair);
    word(tasks, task + TASK_AXIS).set(plane / BINS);
    word(tasks, task + TASK_PLANE).set(plane % BINS);
    word(tasks, task + TASK_LEFT).set(shared_at(shared, CHILDREN + ITEMS));
    word(tasks, task + TASK_PAIR).set(pair);
}

/// Writes an inner node whose children are pair number `pair`.
#[inline]
pub fn put_inner(buffers: &TopBuffers<'_>, slot: u32, bounds: Aabb, pair: u32) {
    let node = BvhNode { min: bounds.min, first: 1 + 2 * pair, max: bounds.max, count: 0 };
    put_node(buffers.nodes, node_word(slot), node);
    word(buffers.parents, pair).set(slot);
}

/// Takes treelet number `t` to its side of its task's plane: to its place in the tree where it is alone there, else to
/// the task there.
#[inline]
pub fn move_treelet(step: &BuildStep, buffers: &TopBuffers<'_>, t: u32) {
    if t < word(buffers.state, header::TREELETS).get() {
        let number = word(buffers.treelet_tasks, t).get();
        if number != DONE {
            let tasks = buffers.tasks;
            let set = step.level % 2 * most_tasks(step.count);
            let next_set = most_tasks(step.count) - set;
            let task = (set + number) * TASK_WORDS;
            let axis = word(tasks, task + TASK_AXIS).get();
            let middle = center(bounds_of(buffers.treelets, t));
            let bin = bin_of(tasks, task, axis, middle, t);
            let right = (bin >= word(tasks, task + TASK_PLANE).get()) as u32;
            let left_items = word(tasks, task + TASK_LEFT).get();
            let items =
                if right == 0 { left_items } else { word(tasks, task + TASK_ITEMS).get() - left_items };
            let first = word(tasks, task + TASK_FIRST).get() + right * left_items;
            let mut next = DONE;
            if items > MOST_SMALL {
                next = task_number(first);
                add_to_bins(buffers, step.level + 1, (next_set + next) * TASK_WORDS, t);
            } else if items > 1 {
                small::add_treelet(buffers, first, t);
            } else {
                place(buffers, t, 1 + 2 * word(tasks, task + TASK_PAIR).get() + right);
            }
            word(buffers.treelet_tasks, t).set(next);
        }
    }
}

/// Writes a treelet's root into a slot of the tree.
#[inline]
pub fn place(buffers: &TopBuffers<'_>, t: u32, slot: u32) {
    let root = load_node(buffers.treelets, t * TREELET_WORDS);
    put_node(buffers.nodes, node_word(slot), root);
    if root.count == 0 {
        word(buffers.parents, pair(root.first)).set(slot);
    }
}

/// The box of treelet number `t`.
#[inline]
pub fn bounds_of(treelets: &[Word], t: u32) -> Aabb {
    let root = load_node(treelets, t * TREELET_WORDS);
    Aabb { min: root.min, max: root.max }
}

/// Adds treelet number `t` to its bins along each axis of a task of a level, which begins at word `task`.
#[inline]
fn add_to_bins(buffers: &TopBuffers<'_>, level: u32, task: u32, t: u32) {
    let bounds = bounds_of(buffers.treelets, t);
    let extent = Extent::of(bounds);
    let weight = word(buffers.treelets, t * TREELET_WORDS + SIZE).get();
    let middle = center(bounds);
    let copies = bin_copies(level);
    let copy = word(buffers.tasks, task + TASK_PLACE).get() * copies + t % copies;
    let mut axis = 0;
    while axis <= CURVE {
        let bin = bin_of(buffers.tasks, task, axis, middle, t);
        let first = copy * TASK_BIN_WORDS + (axis * BINS + bin) * BIN_WORDS;
        extent.widen(buffers.bins, first);
        word(buffers.bins, first + NUMBERS).max(!t);
        word(buffers.bins, first + NUMBERS + 1).max(t + 1);
        word(buffers.bins, first + ITEMS).add(1);
        word(buffers.bins, first + WEIGHT).add(weight);
        axis += 1;
    }
}

/// The bin of a treelet along an axis of a task: those of equal width cover its box, along the curve two its numbers.
#[inline]
fn bin_of(tasks: &[Word], task: u32, axis: u32, middle: Vec3, t: u32) -> u32 {
    if axis == CURVE {
        let least = !word(tasks, task + TASK_NUMBERS).get();
        let spread = word(tasks, task + TASK_NUMBERS + 1).get() - least;
        ((t - least) * 2 >= spread) as u32
    } else {
        let bounds = Extent::load(tasks, task + TASK_EXTENT).bounds();
        let (low, high, at) = if axis == 0 {
            (bounds.min.x, bounds.max.x, middle.x)
        } else if axis == 1 {
            (bounds.min.y, bounds.max.y, middle.y)
        } else {
            (bounds.min.z, bounds.max.z, middle.z)
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
/// Let s be how far its treelets' numbers spread, in units of [`MOST_SMALL`] rounded up, and levels(s) = ceil(log2 s).
/// The invariant is level + levels(s) <= limit; it holds at the root. A task has s >= 2, so that level < limit.
/// Children spread no further than s, so any plane keeps it where level + 1 + levels(s) is within the limit; halving
/// makes levels one less.
#[inline]
fn must_halve(step: &BuildStep, tasks: &[Word], task: u32) -> bool {
    let least = !word(tasks, task + TASK_NUMBERS).get();
    let spread = word(tasks, task + TASK_NUMBERS + 1).get() - least;
    step.level + 1 + rounded_up_log2(spread.div_ceil(MOST_SMALL)) > step.level_limit
}

/// ceil(log2 n), n at least 1.
#[inline]
pub const fn rounded_up_log2(n: u32) -> u32 {
    32 - (n - 1).leading_zeros()
}

/// Writes the cost of the plane in front of bin `local`: for both sides area times number of primitives. There is none
/// in front of an axis' first bin, nor where a side is empty: such a plane costs more than any.
#[inline]
fn evaluate_plane(shared: &mut Shared, local: u32) {
    let along_curve = local == CURVE_PLANE;
    let mut cost = Cost::NONE;
    if local < TASK_BINS && (along_curve || shared_at(shared, HEAD_HALVE) == 0) {
        let axis = local / BINS;
        let (mut left, mut right) = (Side::default(), Side::default());
        let mut bin = axis * BINS;
        let end = TASK_BINS.min(bin + BINS);
        while bin < end {
            let first = bin * BIN_WORDS;
            let side = Side {
                extent: Extent::shared_load(shared, first),
                items: shared_at(shared, first + ITEMS),
                weight: shared_at(shared, first + WEIGHT),
            };
            if bin < local {
                left = left.union(side);
            } else {
                right = right.union(side);
            }
            bin += 1;
        }
        cost = Cost::of(left, right);
    }
    let entry = PLANE + local * PLANE_WORDS;
    cost.shared_store(shared, entry);
    shared_put(shared, entry + PLANE_NUMBER, local);
}

/// What is on one side of a plane.
#[derive(Clone, Copy, Default)]
pub struct Side {
    /// The box of its treelets.
    pub extent: Extent,
    /// How many treelets.
    pub items: u32,
    /// How many primitives.
    pub weight: u32,
}

impl Side {
    /// Both together.
    #[inline]
    pub fn union(self, other: Side) -> Side {
        Side {
            extent: self.extent.union(other.extent),
            items: self.items + other.items,
            weight: self.weight + other.weight,
        }
    }
}

/// What a plane costs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Cost {
    /// Upper word of the sum over both sides of area times number of primitives.
    pub high: u32,
    /// Lower word.
    pub low: u32,
    /// Treelets on the fuller side: boxes in a line have no area, so that all their costs are 0.
    pub larger: u32,
}

impl Cost {
    /// Words of a cost in shared memory.
    pub const WORDS: u32 = 3;

    /// Of a plane that parts nothing.
    pub const NONE: Cost = Cost { high: u32::MAX, low: u32::MAX, larger: u32::MAX };

    /// Of a plane between two sides.
    #[inline]
    pub fn of(left: Side, right: Side) -> Cost {
        if left.items == 0 || right.items == 0 {
            return Cost::NONE;
        }
        let size = half_size(left.extent.union(right.extent).bounds()).max_element();
        let (left_high, left_low) = wide_product(area(left.extent, size), left.weight);
        let (right_high, right_low) = wide_product(area(right.extent, size), right.weight);
        let low = left_low.wrapping_add(right_low);
        let high = left_high + right_high + (low < left_low) as u32;
        Cost { high, low, larger: left.items.max(right.items) }
    }

    /// Reads a cost from shared memory.
    #[inline]
    pub fn shared_load<const N: usize>(shared: &[u32; N], i: u32) -> Cost {
        Cost { high: shared_at(shared, i), low: shared_at(shared, i + 1), larger: shared_at(shared, i + 2) }
    }

    /// Writes it to shared memory.
    #[inline]
    pub fn shared_store<const N: usize>(self, shared: &mut [u32; N], i: u32) {
        shared_put(shared, i, self.high);
        shared_put(shared, i + 1, self.low);
        shared_put(shared, i + 2, self.larger);
    }

    /// Whether it is cheaper, or as cheap and more even.
    #[inline]
    pub fn is_below(self, other: Cost) -> bool {
        if self.high != other.high {
            self.high < other.high
        } else if self.low != other.low {
            self.low < other.low
        } else {
            self.larger < other.larger
        }
    }
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

/// Keeps the better of two planes in the first one's place; of equal ones that of the lower number.
#[inline]
fn keep_better_plane(shared: &mut Shared, one: u32, other: u32) {
    let (one, other) = (PLANE + one * PLANE_WORDS, PLANE + other * PLANE_WORDS);
    let (cost, other_cost) = (Cost::shared_load(shared, one), Cost::shared_load(shared, other));
    let number = shared_at(shared, one + PLANE_NUMBER);
    let other_number = shared_at(shared, other + PLANE_NUMBER);
    if other_cost.is_below(cost) || (other_cost == cost && other_number < number) {
        other_cost.shared_store(shared, one);
        shared_put(shared, one + PLANE_NUMBER, other_number);
    }
}

/// Sums up word `local % BIN_WORDS` of the left (`local < BIN_WORDS`) or right child of the best plane.
#[inline]
fn sum_child(shared: &mut Shared, local: u32) {
    let plane = shared_at(shared, PLANE + PLANE_NUMBER);
    let (side, i) = (local / BIN_WORDS, local % BIN_WORDS);
    let begin = plane / BINS * BINS;
    let mut sum = 0;
    let mut bin = if side == 0 { begin } else { plane };
    let end = if side == 0 { plane } else { TASK_BINS.min(begin + BINS) };
    while bin < end {
        sum = united(i, sum, shared_at(shared, bin * BIN_WORDS + i));
        bin += 1;
    }
    shared_put(shared, CHILDREN + local, sum);
}

/// The buffers of the top's build.
#[derive(Clone, Copy)]
pub struct TopBuffers<'a> {
    /// See [`header`].
    pub state: &'a [Word],
    /// See [`hlbvh`](super::hlbvh).
    pub treelets: &'a [Word],
    /// The number of each treelet's task.
    pub treelet_tasks: &'a [Word],
    /// The tasks, in two sets of [`most_tasks`].
    pub tasks: &'a [Word],
    /// Numbers of tasks: two sets, then those of [`small`].
    pub queues: &'a [Word],
    /// The bins of a level's tasks, in several copies: [`bin_words`].
    pub bins: &'a [Word],
    /// See [`small`].
    pub small_tasks: &'a [Word],
    /// The treelets of small tasks, each at one of its task's numbers.
    pub lists: &'a [Word],
    /// The tree.
    pub nodes: &'a [Word],
    /// The node above each pair of siblings.
    pub parents: &'a [Word],
}
