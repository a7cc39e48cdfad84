//! Treelets: the subtrees of primitives that share the leading bits of their codes, built from the bottom up in one
//! pass (Apetrei, "Fast and Simple Agglomerative LBVH Construction", CGVC 2014).
//!
//! How many leading bits is chosen from the data: as many as leave at most [`MAX_TREELETS`] treelets. In scenes of no
//! more primitives each is a treelet, the SAH decides everything, and nothing is sorted.

use crate::bvh::header;
use crate::bvh::morton::{LEVELS, position_level};
use crate::bvh::node::{is_sound, load_bounds, load_box, node_word, put_node, union};
use crate::bvh::top::{self, TopBuffers};
use crate::interface::{BATCH_GROUP_SIZE, BuildStep, BvhNode, MOST_ROW_GROUPS};
use crate::parallel::{Word, word};

/// Most treelets of a tree. Twice as many make a tree of 10^6 primitives 2 % cheaper to traverse, by SAH cost, and its
/// top take twice as long to build.
pub const MAX_TREELETS: u32 = 1 << 14;
/// Words of a treelet: its root as a node, then [`LAST`], [`SIZE`] and whether it is deep.
pub const TREELET_WORDS: u32 = 11;
/// Word of a treelet: the position of its last primitive, which no other treelet has.
pub const LAST: u32 = 8;
/// Word of a treelet: how many primitives it has.
pub const SIZE: u32 = 9;
/// Word of a treelet: 1 where it came out deeper than [`MAX_TREELET_DEPTH`].
const DEEP: u32 = 10;
/// Treelets deeper than this are built again by halving, which makes them at most 26 deep: with the top's levels that
/// keeps [`MAX_BVH_DEPTH`](crate::interface::MAX_BVH_DEPTH).
pub const MAX_TREELET_DEPTH: u32 = 30;
/// [`split_level`](crate::bvh::morton::split_level) of a border of a treelet.
const BORDER: u32 = u32::MAX;
/// An arrival of no one.
pub const NO_ARRIVAL: u32 = u32::MAX;
/// Bits of a position in an arrival; above them is a height.
const POSITION_BITS: u32 = 26;
/// Greater heights count as this: it is above [`MAX_TREELET_DEPTH`], and no arrival is [`NO_ARRIVAL`].
const MOST_HEIGHT: u32 = 62;

/// Whether each primitive is a treelet, so that their order on the curve does not matter.
#[inline]
pub fn has_single_treelets(count: u32) -> bool {
    count <= MAX_TREELETS
}

/// Makes primitive `i` a treelet of its own, of size 0 where it is not sound.
#[inline]
pub fn emit_single(boxes: &[f32], treelets: &[Word], primitives: &[Word], i: u32) {
    let bounds = load_box(boxes, i);
    let treelet = i * TREELET_WORDS;
    word(primitives, i).set(i);
    word(treelets, treelet + LAST).set(i);
    word(treelets, treelet + SIZE).set(is_sound(bounds) as u32);
    put_node(treelets, treelet, BvhNode { min: bounds.min, first: i, max: bounds.max, count: 1 });
}

/// Chooses the level from which on splits are between treelets, and sets up the top's first task. One invocation.
#[inline]
pub fn choose_threshold(step: &BuildStep, buffers: &TopBuffers<'_>) {
    let state = buffers.state;
    let sound = word(state, header::SOUND).get();
    let mut treelets = sound.min(1);
    if has_single_treelets(step.count) {
        treelets = step.count;
    } else {
        let mut level = LEVELS;
        let mut going = sound > 0;
        while going {
            let more = word(state, header::LEVEL_COUNTS + level - 1).get();
            going = treelets + more <= MAX_TREELETS;
            if going {
                treelets += more;
                level -= 1;
                going = level > 0;
            }
        }
        word(state, header::THRESHOLD).set(level);
    }
    let mut i = 1;
    while i < 3 {
        word(state, header::DEEP_GROUPS + i).set(1);
        word(state, header::SMALL_GROUPS + i).set(1);
        i += 1;
    }
    let items = if has_single_treelets(step.count) { sound } else { treelets };
    top::put_first_task(buffers, step, treelets, items);
}

/// Writes 1 to `flags[i]` where a treelet ends behind sorted position `i`, else 0: scanned, the number of `i`'s
/// treelet.
#[inline]
pub fn flag_treelets(state: &[Word], levels: &[Word], flags: &[Word], i: u32) {
    let mut flag = 0;
    if i + 1 < word(state, header::SOUND).get() {
        flag = (word(levels, i).get() >= word(state, header::THRESHOLD).get()) as u32;
    }
    word(flags, i).set(flag);
}

/// Climbs from the leaf at sorted position `i` to the root of its treelet, as far as this invocation is the second to
/// arrive at each node: so each node is made once, when both its children are there.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the buffers of a build")]
pub fn emit_treelet(
    step: &BuildStep,
    boxes: &[f32],
    state: &[Word],
    order: &[Word],
    levels: &[Word],
    treelet_of: &[Word],
    arrivals: &[Word],
    parents: &[Word],
    treelets: &[Word],
    nodes: &[Word],
    primitives: &[Word],
    i: u32,
) {
    let sound = word(state, header::SOUND).get();
    if i < step.count {
        word(primitives, i).set(word(order, i).get());
    }
    if i >= sound {
        return;
    }
    let threshold = word(state, header::THRESHOLD).get();
    let treelet = word(treelet_of, i).get() * TREELET_WORDS;
    let by_halves = step.level == 1;
    if by_halves && word(treelets, treelet + DEEP).get() == 0 {
        return;
    }
    let mut bounds = load_box(boxes, word(order, i).get());
    // The node at hand: the primitives at positions `left` to `right`, `height` levels above its deepest leaf.
    let (mut first, mut count, mut height) = (i, 1, 0u32);
    let (mut left, mut right) = (i, i);
    let mut climbing = true;
    while climbing {
        let before = if left == 0 { BORDER } else { level_behind(levels, threshold, by_halves, left - 1) };
        let behind =
            if right + 1 == sound { BORDER } else { level_behind(levels, threshold, by_halves, right) };
        let node = BvhNode { min: bounds.min, first, max: bounds.max, count };
        if before == BORDER && behind == BORDER {
            climbing = false;
            put_node(treelets, treelet, node);
            word(treelets, treelet + LAST).set(right);
            word(treelets, treelet + SIZE).set(right + 1 - left);
            if height > MAX_TREELET_DEPTH && !by_halves {
                word(treelets, treelet + DEEP).set(1);
                let groups = step.count.div_ceil(BATCH_GROUP_SIZE);
                word(state, header::DEEP_GROUPS).max(groups.min(MOST_ROW_GROUPS));
                word(state, header::DEEP_GROUPS + 1).max(groups.div_ceil(MOST_ROW_GROUPS));
            }
        } else {
            // The lower of the two splits beside it is its parent's.
            let is_left = behind < before;
            let split = if is_left { right } else { left - 1 };
            let slot = 1 + 2 * split + !is_left as u32;
            put_node(nodes, node_word(slot), node);
            if count == 0 {
                word(parents, pair(first)).set(slot);
            }
            let end = if is_left { left } else { right };
            let other = word(arrivals, split).hand_over(height << POSITION_BITS | end);
            climbing = other != NO_ARRIVAL;
            if climbing {
                // For the next build, or a refit.
                word(arrivals, split).set(NO_ARRIVAL);
                let sibling = 1 + 2 * split + is_left as u32;
                bounds = union(bounds, load_bounds(nodes, node_word(sibling)));
                let end = other & ((1 << POSITION_BITS) - 1);
                if is_left {
                    right = end;
                } else {
                    left = end;
                }
                height = MOST_HEIGHT.min(1 + height.max(other >> POSITION_BITS));
                (first, count) = (1 + 2 * split, 0);
            }
        }
    }
}

/// The number of the pair of siblings whose first stands in slot `first`.
#[inline]
pub fn pair(first: u32) -> u32 {
    (first - 1) / 2
}

/// The level of the split behind a position, [`BORDER`] where it is between treelets.
#[inline]
fn level_behind(levels: &[Word], threshold: u32, by_halves: bool, position: u32) -> u32 {
    let level = word(levels, position).get();
    if level >= threshold {
        BORDER
    } else if by_halves {
        position_level(position)
    } else {
        level
    }
}
