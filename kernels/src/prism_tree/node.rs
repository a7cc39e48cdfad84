//! Nodes of four children, whose boxes are stored in bytes.
//!
//! A node has a corner, and for each axis a step, a power of two: a child's box reaches from corner + low * step to
//! corner + high * step. In words:
//!
//! | quarter | x | y | z | w |
//! |---|---|---|---|---|
//! | 0 | corner x | corner y | corner z | exponents of the steps, 8 bits each from x on; bits 24 to 27: the children |
//! | 1 | low x | high x | low y | high y |
//! | 2 | low z | high z | | |
//! | 3, above the triangles alone | link of child 0 | 1 | 2 | 3 |
//!
//! Words of quarters 1 and 2 have a byte a child, the first in the lowest one. An exponent is that of a float: 127 is a
//! step of 1, 120 one of 2^-7. A link is the number of a pair of siblings of the binary BVH, or a triangle's with
//! [`TRIANGLE`] set.

use crate::aabb::Aabb;
use crate::math::{MinMax, at, floor, mul_add4, put, to_u32};
use crate::prism_tree::frame::Slabs;
use glam::{UVec4, Vec3, Vec4};

/// Bit of a link to a triangle.
pub const TRIANGLE: u32 = 1 << 31;

/// The first three quarters of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node(pub [UVec4; 3]);

/// The least exponent of a step: 2^-100, so that a step and its reciprocal are normal numbers, also times what a ray
/// multiplies them by.
const LEAST_EXPONENT: u32 = 27;

/// The exponent of the least power of two that `extent` has at most 254 of. One of the 255 is left for what rounding
/// the corner takes.
#[inline]
fn exponent_of(extent: f32) -> u32 {
    let bits = (extent * (1.0 / 254.0)).to_bits();
    // Rounded up to a power of two.
    ((bits + 0x007f_ffff) >> 23).max(LEAST_EXPONENT)
}

#[inline]
fn power(exponent: u32) -> f32 {
    f32::from_bits(exponent << 23)
}

/// The four bytes of a word as floats.
#[inline]
fn bytes(word: u32) -> Vec4 {
    Vec4::new((word & 255) as f32, (word >> 8 & 255) as f32, (word >> 16 & 255) as f32, (word >> 24) as f32)
}

impl Node {
    /// A node around four boxes, rounded outward. Children with empty boxes are not there.
    #[inline]
    pub fn new(boxes: [Aabb; 4]) -> Node {
        let mut whole = Aabb::EMPTY;
        let mut i = 0;
        while i < 4 {
            whole = whole.joined(boxes[i]);
            i += 1;
        }
        let mut there = 0;
        let (mut low, mut high) = ([0; 3], [0; 3]);
        let is_empty = !(whole.min.x <= whole.max.x);
        let corner = if is_empty { Vec3::ZERO } else { whole.min };
        let extent = if is_empty { Vec3::ZERO } else { whole.max - whole.min };
        let exponents = [exponent_of(extent.x), exponent_of(extent.y), exponent_of(extent.z)];
        let mut i = 0;
        while i < 4 {
            if boxes[i].min.x <= boxes[i].max.x {
                there |= 1 << i;
                let (to_min, to_max) = (boxes[i].min - corner, boxes[i].max - corner);
                let shift = 8 * i as u32;
                low[0] |= lower(to_min.x, exponents[0]) << shift;
                low[1] |= lower(to_min.y, exponents[1]) << shift;
                low[2] |= lower(to_min.z, exponents[2]) << shift;
                high[0] |= upper(to_max.x, exponents[0]) << shift;
                high[1] |= upper(to_max.y, exponents[1]) << shift;
                high[2] |= upper(to_max.z, exponents[2]) << shift;
            }
            i += 1;
        }
        let steps = exponents[0] | exponents[1] << 8 | exponents[2] << 16 | there << 24;
        Node([
            UVec4::new(corner.x.to_bits(), corner.y.to_bits(), corner.z.to_bits(), steps),
            UVec4::new(low[0], high[0], low[1], high[1]),
            UVec4::new(low[2], high[2], 0, 0),
        ])
    }

    /// Reads the one from quarter `first` on.
    #[inline]
    pub fn load(quarters: &[UVec4], first: u32) -> Node {
        Node([at(quarters, first), at(quarters, first + 1), at(quarters, first + 2)])
    }

    /// Writes it from quarter `first` on.
    #[inline]
    pub fn store(&self, quarters: &mut [UVec4], first: u32) {
        put(quarters, first, self.0[0]);
        put(quarters, first + 1, self.0[1]);
        put(quarters, first + 2, self.0[2]);
    }

    /// Which children there are: bit c is for child c.
    #[inline]
    pub fn children(&self) -> u32 {
        self.0[0].w >> 24
    }

    #[inline]
    fn corner(&self) -> Vec3 {
        let q = self.0[0];
        Vec3::new(f32::from_bits(q.x), f32::from_bits(q.y), f32::from_bits(q.z))
    }

    #[inline]
    fn steps(&self) -> Vec3 {
        let w = self.0[0].w;
        Vec3::new(power(w & 255), power(w >> 8 & 255), power(w >> 16 & 255))
    }

    /// The box around all children, which holds the boxes that the node was made of; the empty one where there are
    /// none.
    #[inline]
    pub fn bounds(&self) -> Aabb {
        let [_, xy, z] = self.0;
        let there = self.children();
        let (corner, steps) = (self.corner(), self.steps());
        let mut bounds = Aabb::EMPTY;
        let mut i = 0;
        while i < 4 {
            if there >> i & 1 != 0 {
                let shift = 8 * i;
                let byte = |word: u32| (word >> shift & 255) as f32;
                let low = Vec3::new(byte(xy.x), byte(xy.z), byte(z.x));
                let high = Vec3::new(byte(xy.y), byte(xy.w), byte(z.y));
                bounds = bounds.including(corner + low * steps).including(corner + high * steps);
            }
            i += 1;
        }
        bounds
    }

    /// Where a ray enters the children's boxes, at least 0; infinite where it misses one before `t_max`, and of
    /// children that are not there. No distance is greater than that of a hit on what the box holds:
    /// [`frame`](super::frame).
    #[inline]
    pub fn entry_distances(&self, slabs: &Slabs, t_max: f32) -> Vec4 {
        let [_, xy, z] = self.0;
        let (corner, steps) = (self.corner(), self.steps());
        let inv = slabs.inv_direction;
        let rate = steps * inv;
        let to_near = (corner - slabs.near) * inv;
        let to_far = (corner - slabs.far) * inv;
        let (near_x, far_x) = if inv.x < 0.0 { (xy.y, xy.x) } else { (xy.x, xy.y) };
        let (near_y, far_y) = if inv.y < 0.0 { (xy.w, xy.z) } else { (xy.z, xy.w) };
        let (near_z, far_z) = if inv.z < 0.0 { (z.y, z.x) } else { (z.x, z.y) };
        let near = mul_add4(bytes(near_x), rate.x, to_near.x)
            .max_num(mul_add4(bytes(near_y), rate.y, to_near.y))
            .max_num(mul_add4(bytes(near_z), rate.z, to_near.z).max_num(Vec4::ZERO));
        let far = mul_add4(bytes(far_x), rate.x, to_far.x)
            .min_num(mul_add4(bytes(far_y), rate.y, to_far.y))
            .min_num(mul_add4(bytes(far_z), rate.z, to_far.z).min_num(Vec4::splat(t_max)));
        let there = self.children();
        let entry = |near: f32, far: f32, child: u32| {
            if near <= far && there >> child & 1 != 0 { near } else { f32::INFINITY }
        };
        Vec4::new(
            entry(near.x, far.x, 0),
            entry(near.y, far.y, 1),
            entry(near.z, far.z, 2),
            entry(near.w, far.w, 3),
        )
    }
}

/// The byte below a coordinate, counted from the corner. Coordinates beyond what floats hold, whose triangles the BVH
/// leaves out, have some byte.
#[inline]
fn lower(from_corner: f32, exponent: u32) -> u32 {
    to_u32(floor(from_corner * power(254 - exponent)).max_num(0.0).min_num(255.0))
}

/// The byte above it.
#[inline]
fn upper(from_corner: f32, exponent: u32) -> u32 {
    to_u32((-floor(-(from_corner * power(254 - exponent)))).max_num(0.0).min_num(255.0))
}
