//! Boxes and nodes as words, for builders whose invocations share them.

use crate::aabb::Aabb;
use crate::interface::BvhNode;
use crate::math::at;
use crate::parallel::{Word, shared_at, shared_put, word};
use glam::{UVec3, Vec3};

/// Words of a [`BvhNode`].
pub const NODE_WORDS: u32 = 8;
/// Floats of a box in the buffer of boxes: its lower corner, then its upper one.
pub const BOX_FLOATS: u32 = 6;

/// The box of a primitive.
#[inline]
pub fn load_box(boxes: &[f32], primitive: u32) -> Aabb {
    let i = primitive * BOX_FLOATS;
    Aabb {
        min: Vec3::new(at(boxes, i), at(boxes, i + 1), at(boxes, i + 2)),
        max: Vec3::new(at(boxes, i + 3), at(boxes, i + 4), at(boxes, i + 5)),
    }
}

/// Coordinates of boxes beyond this are as good as none: 2^122. It leaves room for powers of two that scale what lies
/// between into [0, 1), in whatever order a driver multiplies.
pub const LARGEST: f32 = 5.316_912e36;

/// Whether a primitive with this box is part of the tree: its box holds something, and nothing beyond [`LARGEST`]. NaN
/// is not.
#[inline]
pub fn is_sound(bounds: Aabb) -> bool {
    let lowest = Vec3::splat(-LARGEST);
    let highest = Vec3::splat(LARGEST);
    bounds.min.cmpge(lowest).all() && bounds.max.cmple(highest).all() && bounds.min.cmple(bounds.max).all()
}

/// The middle of a sound box: finite, and never denormal, since devices may take denormal numbers for zero and all must
/// build the same tree.
#[inline]
pub fn center(bounds: Aabb) -> Vec3 {
    // The sum is within a float's range, and halving it is exact unless the result is denormal.
    let middle = (bounds.min + bounds.max) * 0.5;
    Vec3::new(normal_or_zero(middle.x), normal_or_zero(middle.y), normal_or_zero(middle.z))
}

#[inline]
fn normal_or_zero(x: f32) -> f32 {
    if x.abs() < f32::MIN_POSITIVE { 0.0 } else { x }
}

/// A word whose order as an unsigned integer is that of finite floats, and which is never 0 for one: the neutral
/// element of [`Word::max`] stands for no float at all.
#[inline]
pub fn ordered(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 0 { bits | 0x8000_0000 } else { !bits }
}

/// The float of a word that [`ordered`] gave.
#[inline]
pub fn from_ordered(word: u32) -> f32 {
    f32::from_bits(if word >> 31 == 1 { word & 0x7FFF_FFFF } else { !word })
}

/// A box as words of which the greater is the larger box on each side: to unite boxes is to take maxima, and all zero
/// is the box of nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extent {
    low: UVec3,
    high: UVec3,
}

impl Extent {
    /// Words of an extent in a buffer.
    pub const WORDS: u32 = 6;

    /// The extent of a sound box.
    #[inline]
    pub fn of(bounds: Aabb) -> Extent {
        let (min, max) = (bounds.min, bounds.max);
        Extent {
            low: UVec3::new(!ordered(min.x), !ordered(min.y), !ordered(min.z)),
            high: UVec3::new(ordered(max.x), ordered(max.y), ordered(max.z)),
        }
    }

    /// Its box.
    #[inline]
    pub fn bounds(self) -> Aabb {
        let (low, high) = (self.low, self.high);
        Aabb {
            min: Vec3::new(from_ordered(!low.x), from_ordered(!low.y), from_ordered(!low.z)),
            max: Vec3::new(from_ordered(high.x), from_ordered(high.y), from_ordered(high.z)),
        }
    }

    /// The extent of both.
    #[inline]
    pub fn union(self, other: Extent) -> Extent {
        Extent { low: self.low.max(other.low), high: self.high.max(other.high) }
    }

    /// Reads the extent whose first word is number `i`.
    #[inline]
    pub fn load(words: &[Word], i: u32) -> Extent {
        Extent {
            low: UVec3::new(word(words, i).get(), word(words, i + 1).get(), word(words, i + 2).get()),
            high: UVec3::new(word(words, i + 3).get(), word(words, i + 4).get(), word(words, i + 5).get()),
        }
    }

    /// Widens the extent whose first word is number `i`, atomically.
    #[inline]
    pub fn widen(self, words: &[Word], i: u32) {
        word(words, i).max(self.low.x);
        word(words, i + 1).max(self.low.y);
        word(words, i + 2).max(self.low.z);
        word(words, i + 3).max(self.high.x);
        word(words, i + 4).max(self.high.y);
        word(words, i + 5).max(self.high.z);
    }

    /// Reads an extent from shared memory.
    #[inline]
    pub fn shared_load<const N: usize>(shared: &[u32; N], i: u32) -> Extent {
        Extent {
            low: UVec3::new(shared_at(shared, i), shared_at(shared, i + 1), shared_at(shared, i + 2)),
            high: UVec3::new(shared_at(shared, i + 3), shared_at(shared, i + 4), shared_at(shared, i + 5)),
        }
    }

    /// Writes it to shared memory.
    #[inline]
    pub fn shared_store<const N: usize>(self, shared: &mut [u32; N], i: u32) {
        shared_put(shared, i, self.low.x);
        shared_put(shared, i + 1, self.low.y);
        shared_put(shared, i + 2, self.low.z);
        shared_put(shared, i + 3, self.high.x);
        shared_put(shared, i + 4, self.high.y);
        shared_put(shared, i + 5, self.high.z);
    }
}

/// First word of the node in a slot.
#[inline]
pub fn node_word(slot: u32) -> u32 {
    slot * NODE_WORDS
}

/// Writes the node whose first word is number `i`.
#[inline]
pub fn put_node(words: &[Word], i: u32, node: BvhNode) {
    store_bounds(words, i, Aabb { min: node.min, max: node.max });
    word(words, i + 3).set(node.first);
    word(words, i + 7).set(node.count);
}

/// What the node whose first word is number `i` points to, its `first` and `count`, as an earlier dispatch left it.
#[inline]
pub fn node_link(words: &[Word], i: u32) -> (u32, u32) {
    (word(words, i + 3).get(), word(words, i + 7).get())
}

/// The node whose first word is number `i`, as an earlier dispatch left it.
#[inline]
pub fn load_node(words: &[Word], i: u32) -> BvhNode {
    BvhNode {
        min: Vec3::new(float(words, i), float(words, i + 1), float(words, i + 2)),
        first: word(words, i + 3).get(),
        max: Vec3::new(float(words, i + 4), float(words, i + 5), float(words, i + 6)),
        count: word(words, i + 7).get(),
    }
}

#[inline]
fn float(words: &[Word], i: u32) -> f32 {
    f32::from_bits(word(words, i).get())
}

/// Replaces a node's box, for later dispatches and for the invocation to which [`Word::hand_over`] passes it on.
#[inline]
pub fn store_bounds(words: &[Word], i: u32, bounds: Aabb) {
    word(words, i).store(bounds.min.x.to_bits());
    word(words, i + 1).store(bounds.min.y.to_bits());
    word(words, i + 2).store(bounds.min.z.to_bits());
    word(words, i + 4).store(bounds.max.x.to_bits());
    word(words, i + 5).store(bounds.max.y.to_bits());
    word(words, i + 6).store(bounds.max.z.to_bits());
}

/// A node's box as the invocation left it that handed it over.
#[inline]
pub fn load_bounds(words: &[Word], i: u32) -> Aabb {
    Aabb {
        min: Vec3::new(
            f32::from_bits(word(words, i).load()),
            f32::from_bits(word(words, i + 1).load()),
            f32::from_bits(word(words, i + 2).load()),
        ),
        max: Vec3::new(
            f32::from_bits(word(words, i + 4).load()),
            f32::from_bits(word(words, i + 5).load()),
            f32::from_bits(word(words, i + 6).load()),
        ),
    }
}

/// The smallest box around both.
#[inline]
pub fn union(a: Aabb, b: Aabb) -> Aabb {
    Aabb { min: a.min.min(b.min), max: a.max.max(b.max) }
}

/// Half of each side of a box.
#[inline]
pub fn half_size(bounds: Aabb) -> Vec3 {
    bounds.max * 0.5 - bounds.min * 0.5
}

/// `x` times a power of two so that `size` would come to lie in [1/2, 1), without rounding: 0 where `size` is so small,
/// below 2^-104, that differences within it might be denormal. `0 <= x <= size`, at most [`LARGEST`].
#[inline]
pub fn normalized(x: f32, size: f32) -> f32 {
    let exponent = size.to_bits() >> 23;
    // Two steps, since the factor itself may be beyond a float's range.
    if exponent < 23 {
        0.0
    } else if exponent < 190 {
        x * f32::from_bits((253 - exponent) << 23)
    } else {
        x * f32::from_bits(64 << 23) * f32::from_bits((316 - exponent) << 23)
    }
}
