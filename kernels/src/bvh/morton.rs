//! Morton codes: primitives in the order of a space-filling curve (Lauterbach et al., "Fast BVH Construction on GPUs",
//! 2009), and where that order splits.

use crate::aabb::Aabb;
use crate::bvh::header;
use crate::bvh::node::{Extent, center, half_size, is_sound, load_box, normalized};
use crate::interface::BuildStep;
use crate::parallel::{Word, Workgroup, phase, shared_add, shared_at, shared_put, word};

/// Invocations of a workgroup.
pub const GROUP_SIZE: u32 = 128;
/// Primitives of an invocation of [`center_bounds`].
const ITEMS: u32 = 8;
/// Primitives of a workgroup of [`center_bounds`].
pub const BLOCK: u32 = GROUP_SIZE * ITEMS;
/// Words that [`center_bounds`] reduces: the extent of centres, and how many primitives are sound.
const REDUCED: u32 = SOUND + 1;
/// Which of them is the latter.
const SOUND: u32 = Extent::WORDS;
/// Shared memory of [`center_bounds`].
pub type BoundsShared = [u32; (REDUCED * GROUP_SIZE) as usize];
/// How many levels there are: see [`split_level`].
pub const LEVELS: u32 = 96;
/// Shared memory of [`split_levels`].
pub type LevelsShared = [u32; LEVELS as usize];

/// Bits of a code along each axis where keys have one word.
const BITS: u32 = 10;
/// The same where keys have two.
const WIDE_BITS: u32 = 21;

/// Reduces the boxes of a block of primitives to the box of their centres and the number of sound ones, in the header.
#[inline]
pub fn center_bounds(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut BoundsShared,
    step: &BuildStep,
    boxes: &[f32],
    state: &[Word],
) {
    phase!(group, |local| {
        let (mut extent, mut sound) = (Extent::default(), 0);
        let mut i = 0;
        while i < ITEMS {
            let primitive = group.id * BLOCK + i * GROUP_SIZE + local;
            if primitive < step.count {
                let bounds = load_box(boxes, primitive);
                if is_sound(bounds) {
                    let middle = center(bounds);
                    extent = extent.union(Extent::of(Aabb { min: middle, max: middle }));
                    sound += 1;
                }
            }
            i += 1;
        }
        extent.shared_store(shared, local * REDUCED);
        shared_put(shared, local * REDUCED + SOUND, sound);
    });
    let mut distance = GROUP_SIZE / 2;
    while distance > 0 {
        phase!(group, |local| {
            if local < distance {
                let (one, other) = (local * REDUCED, (local + distance) * REDUCED);
                let extent = Extent::shared_load(shared, one).union(Extent::shared_load(shared, other));
                extent.shared_store(shared, one);
                let sound = shared_at(shared, one + SOUND) + shared_at(shared, other + SOUND);
                shared_put(shared, one + SOUND, sound);
            }
        });
        distance /= 2;
    }
    phase!(group, |local| {
        if local == 0 {
            Extent::shared_load(shared, 0).widen(state, header::CENTERS);
            word(state, header::SOUND).add(shared_at(shared, SOUND));
        }
    });
}

/// Writes the key of primitive `i` and its index. Primitives that are not sound get the greatest key: they come last.
///
/// The grid of codes is cubic, with a cell's side a power of two times the longest side of the box of centres, so that
/// codes are computed without rounding and are the same everywhere.
#[inline]
pub fn encode(step: &BuildStep, boxes: &[f32], state: &[Word], keys: &[Word], values: &[Word], i: u32) {
    let bounds = load_box(boxes, i);
    let (mut low, mut high) = (u32::MAX, u32::MAX);
    if is_sound(bounds) {
        let centers = Extent::load(state, header::CENTERS).bounds();
        let size = half_size(centers).max_element();
        let offset = center(bounds) * 0.5 - centers.min * 0.5;
        let bits = if step.limbs == 1 { BITS } else { WIDE_BITS };
        let (x, y, z) = (cell(offset.x, size, bits), cell(offset.y, size, bits), cell(offset.z, size, bits));
        if step.limbs == 1 {
            low = interleave(x) << 2 | interleave(y) << 1 | interleave(z);
        } else {
            // The lower 10 bits of each, then the upper 11.
            let mask = (1 << BITS) - 1;
            low = interleave(x & mask) << 2 | interleave(y & mask) << 1 | interleave(z & mask);
            let (x, y, z) = (x >> BITS, y >> BITS, z >> BITS);
            // 11 bits of each are 33: the upper word has those above the second of x.
            let upper = interleave(x & mask) << 2 | interleave(y & mask) << 1 | interleave(z & mask);
            let top = (x >> BITS) << 2 | (y >> BITS) << 1 | z >> BITS;
            low |= upper << 30;
            high = upper >> 2 | top << 28;
        }
    }
    word(keys, i).set(low);
    if step.limbs == 2 {
        word(keys, step.count + i).set(high);
    }
    word(values, i).set(i);
}

/// The cell of an offset within `size`, of `2^bits` that cover the power of two above `size`.
#[inline]
fn cell(offset: f32, size: f32, bits: u32) -> u32 {
    (normalized(offset, size) * (1u32 << bits) as f32) as u32
}

/// The lower ten bits of `x`, two zeros between each.
#[inline]
fn interleave(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00FF;
    let x = (x | x << 8) & 0x0300_F00F;
    let x = (x | x << 4) & 0x030C_30C3;
    (x | x << 2) & 0x0924_9249
}

/// Where the order splits between sorted positions `i` and `i + 1`: the number of the highest bit in which the keys
/// differ, 32 and above, or, for equal keys, in which the positions do, below 32. Splits of higher levels are further
/// up in the tree; within a subtree no two have the same level.
#[inline]
pub fn split_level(step: &BuildStep, keys: &[Word], i: u32) -> u32 {
    if step.limbs == 2 {
        let high = word(keys, step.count + i).get() ^ word(keys, step.count + i + 1).get();
        if high != 0 {
            return 95 - high.leading_zeros();
        }
    }
    let low = word(keys, i).get() ^ word(keys, i + 1).get();
    if low != 0 { 63 - low.leading_zeros() } else { position_level(i) }
}

/// [`split_level`] by positions alone.
#[inline]
pub fn position_level(i: u32) -> u32 {
    31 - (i ^ (i + 1)).leading_zeros()
}

/// Writes the [`split_level`] behind each position of a block, and counts each level in the header.
#[inline]
pub fn split_levels(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut LevelsShared,
    step: &BuildStep,
    keys: &[Word],
    levels: &[Word],
    state: &[Word],
) {
    phase!(group, |local| {
        if local < LEVELS {
            shared_put(shared, local, 0);
        }
    });
    phase!(group, |local| {
        let sound = word(state, header::SOUND).get();
        let mut i = 0;
        while i < ITEMS {
            let position = group.id * BLOCK + i * GROUP_SIZE + local;
            if position + 1 < sound {
                let level = split_level(step, keys, position);
                word(levels, position).set(level);
                shared_add(shared, level, 1);
            }
            i += 1;
        }
    });
    phase!(group, |local| {
        if local < LEVELS && shared_at(shared, local) > 0 {
            word(state, header::LEVEL_COUNTS + local).add(shared_at(shared, local));
        }
    });
}
