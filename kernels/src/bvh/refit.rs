//! New boxes for a tree whose primitives have moved, and what the tree costs.

use crate::aabb::Aabb;
use crate::bvh::header;
use crate::bvh::hlbvh::NO_ARRIVAL;
use crate::bvh::node::{
    half_size, is_sound, load_bounds, load_box, load_node, node_link, node_word, store_bounds, union,
};
use crate::parallel::{Word, Workgroup, phase, shared_at, shared_put, word};
use glam::Vec3;

/// Invocations of a workgroup of [`sum_costs`].
pub const GROUP_SIZE: u32 = 128;
/// Nodes of an invocation of [`sum_costs`].
const ITEMS: u32 = 8;
/// Nodes of a workgroup of [`sum_costs`].
pub const BLOCK: u32 = GROUP_SIZE * ITEMS;
/// Shared memory of [`sum_costs`].
pub type Shared = [u32; GROUP_SIZE as usize];

/// How many nodes a tree over `sound` primitives has: without any, a root that no ray enters.
#[inline]
pub fn node_count(sound: u32) -> u32 {
    if sound == 0 { 1 } else { 2 * sound - 1 }
}

/// Climbs from the node in `slot`, if it is a leaf, towards the root, as far as this invocation is the second to
/// arrive: each inner node gets its box when both its children have theirs. A leaf whose primitive has no sound box any
/// more is counted: such a tree has to be built again.
#[inline]
pub fn refit(
    boxes: &[f32],
    state: &[Word],
    arrivals: &[Word],
    parents: &[Word],
    nodes: &[Word],
    primitives: &[Word],
    slot: u32,
) {
    let sound = word(state, header::SOUND).get();
    if sound == 0 || slot >= node_count(sound) {
        return;
    }
    // Not the whole node: an inner one's box may be written at this moment.
    let (first, count) = node_link(nodes, node_word(slot));
    if count == 0 {
        return;
    }
    let mut bounds = load_box(boxes, word(primitives, first).get());
    if !is_sound(bounds) {
        word(state, header::UNSOUND).add(1);
        bounds = Aabb::EMPTY;
    }
    let mut slot = slot;
    let mut climbing = true;
    while climbing {
        store_bounds(nodes, node_word(slot), bounds);
        climbing = slot > 0;
        if climbing {
            let pair = (slot - 1) / 2;
            climbing = word(arrivals, pair).hand_over(slot) != NO_ARRIVAL;
            if climbing {
                word(arrivals, pair).set(NO_ARRIVAL);
                // Siblings are 1 + 2q and 2 + 2q.
                let sibling = if slot % 2 == 1 { slot + 1 } else { slot - 1 };
                bounds = union(bounds, load_bounds(nodes, node_word(sibling)));
                slot = word(parents, pair).get();
            }
        }
    }
}

/// Sums what a block of nodes adds to the tree's SAH cost: of each its share of the root's surface, times the tests it
/// takes (1, or as many as a leaf has primitives). To `costs[group.id]`. 0 where the root has no surface.
#[inline]
pub fn sum_costs(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    state: &[Word],
    nodes: &[Word],
    costs: &[Word],
) {
    phase!(group, |local| {
        let count = node_count(word(state, header::SOUND).get());
        let root = load_node(nodes, 0);
        let root = half_size(Aabb { min: root.min, max: root.max });
        // In shares of the root's longest side, whose square is within a float's range.
        let size = root.max_element();
        let whole = if size > 0.0 { surface(root / size) } else { 0.0 };
        let mut sum = 0.0;
        let mut i = 0;
        while i < ITEMS {
            let slot = group.id * BLOCK + i * GROUP_SIZE + local;
            if slot < count && whole > 0.0 {
                let node = load_node(nodes, node_word(slot));
                let area = surface(half_size(Aabb { min: node.min, max: node.max }) / size);
                sum += area / whole * node.count.max(1) as f32;
            }
            i += 1;
        }
        shared_put(shared, local, sum.to_bits());
    });
    let mut distance = GROUP_SIZE / 2;
    while distance > 0 {
        phase!(group, |local| {
            if local < distance {
                let sum = f32::from_bits(shared_at(shared, local))
                    + f32::from_bits(shared_at(shared, local + distance));
                shared_put(shared, local, sum.to_bits());
            }
        });
        distance /= 2;
    }
    phase!(group, |local| {
        if local == 0 {
            word(costs, group.id).set(shared_at(shared, 0));
        }
    });
}

#[inline]
fn surface(size: Vec3) -> f32 {
    size.x * size.y + size.y * size.z + size.z * size.x
}
