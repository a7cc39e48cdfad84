//! The parts of the tree's top over few treelets: a workgroup makes all nodes of one, in shared memory.
//!
//! Each plane behind a treelet, along each axis, is tried: a full sweep of the surface area heuristic, cheap since
//! treelets are so few. They are ordered along an axis by their middles, equal ones by number, so that every plane but
//! the last parts some.

use crate::bvh::header;
use crate::bvh::hlbvh::{MAX_TREELETS, SIZE, TREELET_WORDS};
use crate::bvh::node::{Extent, center, ordered};
use crate::bvh::top::{
    Cost, Side, TopBuffers, bounds_of, most_tasks, pair_of_split, place, put_inner, rounded_up_log2,
};
use crate::interface::BuildStep;
use crate::parallel::{Word, Workgroup, phase, shared_add, shared_at, shared_put, word};

/// Invocations of a workgroup: one for each treelet and axis.
pub const GROUP_SIZE: u32 = 3 * MOST_SMALL;
/// Most treelets of a small task. What a sweep costs grows with the square: of twice as many it takes longer than
/// binning them once more.
pub const MOST_SMALL: u32 = 32;
/// Most levels of a small task's nodes: 5 and some for uneven splits.
pub const LEVEL_LIMIT: u32 = 10;

/// Words of a small task: the first of its numbers, how many treelets, its slot, and how many of them are in its list.
const FIRST: u32 = 0;
const ITEMS: u32 = 1;
const SLOT: u32 = 2;
const LISTED: u32 = 3;
/// How many words.
pub const SMALL_TASK_WORDS: u32 = 4;

/// Shared memory: for each treelet `ITEM_WORDS`, for each position `PLACE_WORDS`, twice, and `BEST_WORDS`, thrice; then
/// a word for each level, of how many positions are still to be split; then for each split the pair of siblings that it
/// lends.
pub type Shared = [u32; (PAIRS + MOST_SMALL) as usize];
/// Words of a treelet: its extent, its middle as ordered words, how many primitives, its number.
const MIDDLE: u32 = Extent::WORDS;
const WEIGHT: u32 = MIDDLE + 3;
const NUMBER: u32 = WEIGHT + 1;
const ITEM_WORDS: u32 = NUMBER + 1;
/// Words of a position: the treelet there (among the task's), the first position of its part, how many there are, the
/// part's slot. Parts of one are in the tree.
const ITEM: u32 = 0;
const PART_FIRST: u32 = 1;
const PART_ITEMS: u32 = 2;
const PART_SLOT: u32 = 3;
const PLACE_WORDS: u32 = 4;
const PLACES: u32 = ITEM_WORDS * MOST_SMALL;
/// Words of a plane behind a position's treelet: its cost and its axis. First those along x of all positions, then y,
/// then z; then the best of each position in place of that along x.
const AXIS: u32 = Cost::WORDS;
const BEST_WORDS: u32 = AXIS + 1;
const BEST: u32 = PLACES + 2 * PLACE_WORDS * MOST_SMALL;
const PENDING: u32 = BEST + 3 * BEST_WORDS * MOST_SMALL;
const PAIRS: u32 = PENDING + LEVEL_LIMIT;

/// How many small tasks there can be in a tree over `count` primitives.
#[inline]
pub fn most_small_tasks(count: u32) -> u32 {
    count.min(MAX_TREELETS) / 2 + 1
}

/// Queues the task over `items` treelets, 2 to [`MOST_SMALL`], that owns the numbers from `first` on. No two such tasks
/// have the same half of that.
#[inline]
pub fn put_task(buffers: &TopBuffers<'_>, step: &BuildStep, first: u32, items: u32, slot: u32) {
    let task = first / 2 * SMALL_TASK_WORDS;
    word(buffers.small_tasks, task + FIRST).set(first);
    word(buffers.small_tasks, task + ITEMS).set(items);
    word(buffers.small_tasks, task + SLOT).set(slot);
    word(buffers.small_tasks, task + LISTED).set(0);
    let place = word(buffers.state, header::SMALL_GROUPS).add(1);
    word(buffers.queues, 2 * most_tasks(step.count) + place).set(first / 2);
}

/// Lists treelet number `t` with the small task that owns the numbers from `first` on.
#[inline]
pub fn add_treelet(buffers: &TopBuffers<'_>, first: u32, t: u32) {
    let listed = word(buffers.small_tasks, first / 2 * SMALL_TASK_WORDS + LISTED).add(1);
    word(buffers.lists, first + listed).set(t);
}

/// Makes the nodes of task number `group.id` of the queue.
#[inline]
pub fn split_small_task(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    step: &BuildStep,
    buffers: &TopBuffers<'_>,
) {
    let task = word(buffers.queues, 2 * most_tasks(step.count) + group.id).get() * SMALL_TASK_WORDS;
    let first = word(buffers.small_tasks, task + FIRST).get();
    let items = word(buffers.small_tasks, task + ITEMS).get();
    let slot = word(buffers.small_tasks, task + SLOT).get();
    phase!(group, |local| {
        if local < items {
            load_item(shared, buffers.treelets, local, word(buffers.lists, first + local).get());
            shared_put(shared, PAIRS + local, pair_of_split(buffers.treelets, first + local));
        }
        if local < LEVEL_LIMIT {
            shared_put(shared, PENDING + local, 0);
        }
    });
    // Lists are in no order; numbers are.
    phase!(group, |local| {
        if local < items {
            let number = shared_at(shared, local * ITEM_WORDS + NUMBER);
            let mut rank = 0;
            let mut other = 0;
            while other < items {
                rank += (shared_at(shared, other * ITEM_WORDS + NUMBER) < number) as u32;
                other += 1;
            }
            put_place(shared, 0, rank, local, 0, items, slot);
        }
    });
    let mut level = 0;
    let mut going = true;
    while going {
        let set = level % 2;
        phase!(group, |local| {
            if local % MOST_SMALL < items {
                evaluate_plane(shared, set, local % MOST_SMALL, local / MOST_SMALL, level);
            }
        });
        phase!(group, |local| {
            if local < items {
                keep_best_axis(shared, local);
            }
        });
        phase!(group, |local| {
            if local < items {
                split_part(shared, buffers, set, local, level);
            }
        });
        going = shared_at(shared, PENDING + level) > 0;
        level += 1;
    }
    phase!(group, |local| {
        if local < items {
            let at = place_word(level % 2, local);
            let t = shared_at(shared, shared_at(shared, at + ITEM) * ITEM_WORDS + NUMBER);
            place(buffers, t, shared_at(shared, at + PART_SLOT));
        }
    });
}

/// Reads treelet number `t` as the task's item number `i`.
#[inline]
fn load_item(shared: &mut Shared, treelets: &[Word], i: u32, t: u32) {
    let bounds = bounds_of(treelets, t);
    let middle = center(bounds);
    let item = i * ITEM_WORDS;
    Extent::of(bounds).shared_store(shared, item);
    shared_put(shared, item + MIDDLE, ordered(middle.x));
    shared_put(shared, item + MIDDLE + 1, ordered(middle.y));
    shared_put(shared, item + MIDDLE + 2, ordered(middle.z));
    shared_put(shared, item + WEIGHT, word(treelets, t * TREELET_WORDS + SIZE).get());
    shared_put(shared, item + NUMBER, t);
}

/// Writes what is at a position.
#[inline]
fn put_place(shared: &mut Shared, set: u32, position: u32, item: u32, first: u32, items: u32, slot: u32) {
    let place = place_word(set, position);
    shared_put(shared, place + ITEM, item);
    shared_put(shared, place + PART_FIRST, first);
    shared_put(shared, place + PART_ITEMS, items);
    shared_put(shared, place + PART_SLOT, slot);
}

#[inline]
fn place_word(set: u32, position: u32) -> u32 {
    PLACES + (set * MOST_SMALL + position) * PLACE_WORDS
}

/// An item's middle along an axis, then its number: what items are ordered by.
#[inline]
fn order_along(shared: &Shared, axis: u32, item: u32) -> (u32, u32) {
    let item = item * ITEM_WORDS;
    (shared_at(shared, item + MIDDLE + axis), shared_at(shared, item + NUMBER))
}

/// Whether an item is in front of the plane behind another: not beyond it in their order along an axis.
#[inline]
fn is_in_front(item: (u32, u32), plane: (u32, u32)) -> bool {
    item.0 < plane.0 || (item.0 == plane.0 && item.1 <= plane.1)
}

/// Word of the plane behind a position's item along an axis.
#[inline]
fn plane_word(position: u32, axis: u32) -> u32 {
    BEST + (axis * MOST_SMALL + position) * BEST_WORDS
}

/// Writes what the plane behind a position's item costs along an axis, in its part.
#[inline]
fn evaluate_plane(shared: &mut Shared, set: u32, position: u32, axis: u32, level: u32) {
    let place = place_word(set, position);
    let item = shared_at(shared, place + ITEM);
    let first = shared_at(shared, place + PART_FIRST);
    let items = shared_at(shared, place + PART_ITEMS);
    let mut cost = Cost::NONE;
    if items > 1 {
        let plane = order_along(shared, axis, item);
        let (mut left, mut right) = (Side::default(), Side::default());
        let mut other = first;
        while other < first + items {
            let other_item = shared_at(shared, place_word(set, other) + ITEM);
            let side = Side {
                extent: Extent::shared_load(shared, other_item * ITEM_WORDS),
                items: 1,
                weight: shared_at(shared, other_item * ITEM_WORDS + WEIGHT),
            };
            if is_in_front(order_along(shared, axis, other_item), plane) {
                left = left.union(side);
            } else {
                right = right.union(side);
            }
            other += 1;
        }
        cost = Cost::of(left, right);
        // So that its nodes keep their limit on levels: halving leaves ceil(log2) more.
        if level + 1 + rounded_up_log2(items - 1) > LEVEL_LIMIT && cost != Cost::NONE {
            cost = Cost { high: 0, low: 0, ..cost };
        }
    }
    let entry = plane_word(position, axis);
    cost.shared_store(shared, entry);
    shared_put(shared, entry + AXIS, axis);
}

/// Keeps the best of the planes behind a position's item.
#[inline]
fn keep_best_axis(shared: &mut Shared, position: u32) {
    let entry = plane_word(position, 0);
    let mut best = Cost::shared_load(shared, entry);
    let mut axis = 1;
    while axis < 3 {
        let cost = Cost::shared_load(shared, plane_word(position, axis));
        if cost.is_below(best) {
            best = cost;
            shared_put(shared, entry + AXIS, axis);
        }
        axis += 1;
    }
    best.shared_store(shared, entry);
}

/// Splits the part of a position by the best of its planes; takes the position's item to its new position. The first
/// position of a part writes its node.
#[inline]
fn split_part(shared: &mut Shared, buffers: &TopBuffers<'_>, set: u32, position: u32, level: u32) {
    let at = place_word(set, position);
    let item = shared_at(shared, at + ITEM);
    let first = shared_at(shared, at + PART_FIRST);
    let items = shared_at(shared, at + PART_ITEMS);
    let slot = shared_at(shared, at + PART_SLOT);
    let next = 1 - set;
    if items == 1 {
        put_place(shared, next, position, item, first, items, slot);
        return;
    }
    let (mut best, mut best_position) = (Cost::NONE, first);
    let mut other = first;
    while other < first + items {
        let cost = Cost::shared_load(shared, plane_word(other, 0));
        if cost.is_below(best) {
            best = cost;
            best_position = other;
        }
        other += 1;
    }
    let axis = shared_at(shared, plane_word(best_position, 0) + AXIS);
    let plane = order_along(shared, axis, shared_at(shared, place_word(set, best_position) + ITEM));
    // How many are in front of the plane, and of these and of the others how many stand in front of this position.
    let (mut left_items, mut left_before) = (0, 0);
    let mut whole = Extent::default();
    let mut other = first;
    while other < first + items {
        let other_item = shared_at(shared, place_word(set, other) + ITEM);
        let in_front = is_in_front(order_along(shared, axis, other_item), plane) as u32;
        left_items += in_front;
        left_before += in_front * (other < position) as u32;
        whole = whole.union(Extent::shared_load(shared, other_item * ITEM_WORDS));
        other += 1;
    }
    let pair = shared_at(shared, PAIRS + first + left_items - 1);
    if position == first {
        put_inner(buffers, slot, whole.bounds(), pair);
    }
    let right = !is_in_front(order_along(shared, axis, item), plane) as u32;
    let part_first = first + right * left_items;
    let part_items = if right == 0 { left_items } else { items - left_items };
    let before = if right == 0 { left_before } else { position - first - left_before };
    let part_slot = 1 + 2 * pair + right;
    put_place(shared, next, part_first + before, item, part_first, part_items, part_slot);
    if part_items > 1 {
        shared_add(shared, PENDING + level, 1);
    }
}
