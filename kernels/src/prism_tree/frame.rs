//! The affine frame of a base triangle, and rays in it.
//!
//! Along the frame's axes lie two edges of the triangle and its normal, so that boxes there fit the triangle's relief,
//! however the triangle leans in the world. Coordinates are M (x - P0). Any matrix M gives bounds that hold: what
//! rounding does is counted for whatever M is.

use crate::displacement::surface::BaseTriangle;
use crate::math::{MinMax, UNIT_ROUNDOFF, at, cross, dot, max_abs, put, sqrt, sum_abs};
use crate::ray::TraversalRay;
use glam::{UVec4, Vec3};

/// Where an affine frame lies, as it is stored.
#[derive(Clone, Copy, Debug)]
pub struct AffineFrame {
    /// Rows of M: how much each local coordinate grows along x, y and z.
    pub rows: [Vec3; 3],
    /// P0, the triangle's first vertex.
    pub origin: Vec3,
    /// A bound on the distance of every micro-vertex from P0, in each coordinate.
    pub reach: f32,
}

/// Two edges of a triangle whose angle has a smaller squared sine than this are taken for parallel: such a triangle
/// has the world's axes. Above it the entries of M stay below 10^4 over the longer edge.
const LEAST_SQUARED_SINE: f32 = 1e-8;

impl AffineFrame {
    /// The frame of a triangle, micro-vertices of which are displaced by at most `height` along each of three axes.
    #[inline]
    pub fn new(base: &BaseTriangle, height: f32) -> AffineFrame {
        let (e1, e2) = (base.p1 - base.p0, base.p2 - base.p0);
        let length = max_abs(e1).max_num(max_abs(e2)).max_num(height);
        let per_length = if length > 0.0 { 1.0 / length } else { 1.0 };
        // Brought to size first: areas of small triangles are less than a float can hold.
        let (a, b) = (e1 * per_length, e2 * per_length);
        let n = cross(a, b);
        let area_squared = dot(n, n);
        let is_flat = !(area_squared > LEAST_SQUARED_SINE * dot(a, a) * dot(b, b)) || !(area_squared > 1e-30);
        let per_area = if is_flat { 1.0 } else { 1.0 / area_squared };
        let rows = if is_flat {
            [Vec3::X, Vec3::Y, Vec3::Z]
        } else {
            [cross(b, n) * per_area, cross(n, a) * per_area, n * (1.0 / sqrt(area_squared))]
        };
        AffineFrame {
            rows: [rows[0] * per_length, rows[1] * per_length, rows[2] * per_length],
            origin: base.p0,
            // Three axes of a vector may add up.
            reach: (max_abs(e1).max_num(max_abs(e2)) + 3.0 * height) * (1.0 + 16.0 * UNIT_ROUNDOFF),
        }
    }

    /// Reads the frame that begins at quarter `first`.
    #[inline]
    pub fn load(quarters: &[UVec4], first: u32) -> AffineFrame {
        let (a, b, c) = (at(quarters, first), at(quarters, first + 1), at(quarters, first + 2));
        AffineFrame {
            rows: [vector_of(a), vector_of(b), vector_of(c)],
            origin: Vec3::new(f32::from_bits(a.w), f32::from_bits(b.w), f32::from_bits(c.w)),
            reach: f32::from_bits(at(quarters, first + 3).x),
        }
    }

    /// Writes it: quarter e holds row e and component e of P0, the fourth one the reach.
    #[inline]
    pub fn store(&self, quarters: &mut [UVec4], first: u32) {
        put(quarters, first, quarter(self.rows[0], self.origin.x));
        put(quarters, first + 1, quarter(self.rows[1], self.origin.y));
        put(quarters, first + 2, quarter(self.rows[2], self.origin.z));
        put(quarters, first + 3, quarter(Vec3::new(self.reach, 0.0, 0.0), 0.0));
    }

    /// A point in the frame: each coordinate is off by 4 u |row| reach, |row| the sum of its magnitudes.
    #[inline]
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.vector(p - self.origin)
    }

    #[inline]
    fn vector(&self, v: Vec3) -> Vec3 {
        Vec3::new(dot(self.rows[0], v), dot(self.rows[1], v), dot(self.rows[2], v))
    }
}

/// A vector and a number as a quarter.
#[inline]
pub(super) fn quarter(v: Vec3, w: f32) -> UVec4 {
    UVec4::new(v.x.to_bits(), v.y.to_bits(), v.z.to_bits(), w.to_bits())
}

/// The vector of a quarter.
#[inline]
pub(super) fn vector_of(q: UVec4) -> Vec3 {
    Vec3::new(f32::from_bits(q.x), f32::from_bits(q.y), f32::from_bits(q.z))
}

/// By how much of |row| D boxes are grown for a ray, |row| the sum of the magnitudes of the axis's row, D the ray's
/// origin's distance from P0 in the 1-norm, and twice the frame's reach.
///
/// In units of u |row| D, which is no less than u |row| times the distance from the ray's origin to any micro-vertex: 4
/// for the ray's origin in the frame, 3 for its direction times a hit's distance, and 2 for micro-vertices there; in a
/// slab's distance q (step / d) + (corner - o) / d, two divisions of 2.5 ulp (5 u) each, and 4 operations: 14, of the
/// sum of both terms' magnitudes; 1 for the corner's and the byte's rounding. The triangle test moves vertices as seen
/// along the ray by less than 11 (6 sqrt(3) of the distance), and its t is off by 12 of the distance. 47 in all.
///
/// The 1-norm is at most sqrt(3) times any distance that it stands for, and the distance is not less than half of D.
const MARGIN: f32 = 64.0 * UNIT_ROUNDOFF;

/// The smallest component of a direction, relative to its axis's row. A ray that runs along a slab more nearly leaves
/// it by so little, 2^-30 of |row| D, that the margin has room for it; and no reciprocal is infinite.
const LEAST_DIRECTION: f32 = 1.0 / (1 << 30) as f32;

/// A ray in a frame, as slabs take it.
#[derive(Clone, Copy, Debug)]
pub struct Slabs {
    /// The origin, moved so that slabs begin a margin nearer.
    pub near: Vec3,
    /// The origin, moved so that slabs end a margin farther away.
    pub far: Vec3,
    /// Reciprocals of the direction's components, none of them infinite.
    pub inv_direction: Vec3,
}

impl Slabs {
    /// A ray of the world in a triangle's frame.
    #[inline]
    pub fn in_frame(frame: &AffineFrame, ray: &TraversalRay) -> Slabs {
        let to_origin = ray.origin - frame.origin;
        let distance = sum_abs(to_origin) + 2.0 * frame.reach;
        let rows = Vec3::new(sum_abs(frame.rows[0]), sum_abs(frame.rows[1]), sum_abs(frame.rows[2]));
        Slabs::new(frame.vector(to_origin), frame.vector(ray.direction), rows, distance)
    }

    /// A ray in the world itself, boxes in which have no coordinate beyond `reach`.
    #[inline]
    pub fn in_world(ray: &TraversalRay, reach: f32) -> Slabs {
        Slabs::new(ray.origin, ray.direction, Vec3::ONE, sum_abs(ray.origin) + 2.0 * reach)
    }

    #[inline]
    fn new(origin: Vec3, direction: Vec3, rows: Vec3, distance: f32) -> Slabs {
        let away = |d: f32, row: f32| {
            let least = LEAST_DIRECTION * row;
            let magnitude = d.abs().max_num(least);
            if d < 0.0 { -magnitude } else { magnitude }
        };
        let d = Vec3::new(away(direction.x, rows.x), away(direction.y, rows.y), away(direction.z, rows.z));
        let margin = rows * (MARGIN * distance);
        let along = |d: f32, margin: f32| if d < 0.0 { -margin } else { margin };
        let margin = Vec3::new(along(d.x, margin.x), along(d.y, margin.y), along(d.z, margin.z));
        Slabs {
            near: origin + margin,
            far: origin - margin,
            inv_direction: Vec3::new(1.0 / d.x, 1.0 / d.y, 1.0 / d.z),
        }
    }
}
