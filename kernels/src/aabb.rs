//! Axis-aligned boxes.

use crate::math::{MinMax, gamma, put};
use crate::ray::TraversalRay;
use glam::Vec3;

/// An axis-aligned box; empty where `min > max` in some component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Aabb {
    /// The box of no point.
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that holds this one and `p`.
    #[inline]
    pub fn including(self, p: Vec3) -> Aabb {
        Aabb { min: self.min.min_num(p), max: self.max.max_num(p) }
    }

    /// The smallest box that holds both.
    #[inline]
    pub fn joined(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min_num(other.min), max: self.max.max_num(other.max) }
    }

    /// This box grown by `margin` on every side.
    #[inline]
    pub fn padded(self, margin: f32) -> Aabb {
        Aabb { min: self.min - Vec3::splat(margin), max: self.max + Vec3::splat(margin) }
    }

    /// What both boxes hold.
    #[inline]
    pub fn intersection(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.max_num(other.min), max: self.max.min_num(other.max) }
    }

    /// Writes it as box number `i` of a buffer of six floats each, the lower corner first.
    #[inline]
    pub fn store(self, boxes: &mut [f32], i: u32) {
        let first = 6 * i;
        put(boxes, first, self.min.x);
        put(boxes, first + 1, self.min.y);
        put(boxes, first + 2, self.min.z);
        put(boxes, first + 3, self.max.x);
        put(boxes, first + 4, self.max.y);
        put(boxes, first + 5, self.max.z);
    }

    /// Distance at which the ray enters the box, at least 0; infinite where it misses it within `t_max`.
    ///
    /// Never misses a box that the exact ray touches: the far distance is enlarged by twice the error of a slab's
    /// distance (Ize, "Robust BVH Ray Traversal", JCGT 2(2), 2013, section 3; pbrt-v4, section 6.1.2), which is
    /// gamma(3) in the paper and gamma(7) here, since Vulkan's division may be off by 2.5 ulp. A component of direction
    /// zero gives 0 x infinity = NaN for an origin on a face, which the order of the comparisons below lets pass.
    #[inline]
    pub fn entry_distance(&self, ray: &TraversalRay, t_max: f32) -> f32 {
        let (x0, x1) = slab(self.min.x, self.max.x, ray.origin.x, ray.inv_direction.x);
        let (y0, y1) = slab(self.min.y, self.max.y, ray.origin.y, ray.inv_direction.y);
        let (z0, z1) = slab(self.min.z, self.max.z, ray.origin.z, ray.inv_direction.z);
        let near = later(later(later(0.0, x0), y0), z0);
        let far = sooner(sooner(sooner(t_max, x1), y1), z1);
        if near <= far { near } else { f32::INFINITY }
    }
}

/// Where a ray enters and leaves a slab, the latter enlarged.
#[inline]
fn slab(min: f32, max: f32, origin: f32, inv_direction: f32) -> (f32, f32) {
    let a = (min - origin) * inv_direction;
    let b = (max - origin) * inv_direction;
    let backwards = inv_direction < 0.0;
    let near = if backwards { b } else { a };
    let far = if backwards { a } else { b };
    (near, far * (1.0 + 2.0 * gamma(7)))
}

/// The greater of two distances, the first where the second is NaN.
#[inline]
fn later(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The smaller of two distances, the first where the second is NaN.
#[inline]
fn sooner(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Aabb = Aabb { min: Vec3::ZERO, max: Vec3::ONE };

    fn entry(origin: [f32; 3], direction: [f32; 3]) -> f32 {
        UNIT.entry_distance(&TraversalRay::new(origin.into(), direction.into(), 1e30), 1e30)
    }

    #[test]
    fn ray_towards_the_box_enters_at_its_face() {
        assert_eq!(entry([-2.0, 0.5, 0.5], [1.0, 0.0, 0.0]), 2.0);
        assert_eq!(entry([0.5, 3.0, 0.5], [0.0, -1.0, 0.0]), 2.0);
    }

    #[test]
    fn ray_that_starts_inside_enters_at_once() {
        assert_eq!(entry([0.5, 0.5, 0.5], [0.0, 0.0, -1.0]), 0.0);
    }

    #[test]
    fn ray_away_from_the_box_or_beside_it_misses() {
        assert_eq!(entry([-2.0, 0.5, 0.5], [-1.0, 0.0, 0.0]), f32::INFINITY);
        assert_eq!(entry([-2.0, 1.5, 0.5], [1.0, 0.0, 0.0]), f32::INFINITY);
    }

    #[test]
    fn flat_box_is_hit_from_its_own_plane() {
        let flat = Aabb { min: Vec3::ZERO, max: Vec3::new(1.0, 1.0, 0.0) };
        let ray = TraversalRay::new(Vec3::new(0.5, 0.5, 0.0), Vec3::Z, 1.0);
        assert_eq!(flat.entry_distance(&ray, 1.0), 0.0);
    }

    #[test]
    fn box_beyond_t_max_is_missed() {
        let ray = TraversalRay::new(Vec3::new(-2.0, 0.5, 0.5), Vec3::X, 1.0);
        assert_eq!(UNIT.entry_distance(&ray, 1.0), f32::INFINITY);
    }

    #[test]
    fn ray_along_a_face_edge_or_through_a_corner_hits() {
        assert_eq!(entry([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]), 1.0);
        assert_eq!(entry([-1.0, 1.0, 1.0], [1.0, 0.0, 0.0]), 1.0);
        let d = Vec3::ONE.normalize();
        assert!(entry([-1.0, -1.0, -1.0], d.into()).is_finite());
    }

    /// Rays aimed in f64 at points of random flat boxes, which plain slab tests lose to rounding.
    #[test]
    fn ray_aimed_at_a_point_of_a_flat_box_never_misses_it() {
        let mut numbers = crate::math::tests::Numbers::new(1);
        for _ in 0..200_000 {
            let a = numbers.vec3() * 100.0;
            let mut b = a + numbers.vec3();
            b.x = a.x;
            let bounds = Aabb { min: a.min(b), max: a.max(b) };
            let s = numbers.vec3() * 0.5 + Vec3::splat(0.5);
            let target = bounds.min + (bounds.max - bounds.min) * s;
            let origin = numbers.vec3() * 1000.0;
            let d = target.as_dvec3() - origin.as_dvec3();
            let ray = TraversalRay::new(origin, d.normalize().as_vec3(), f32::INFINITY);
            // The rounded direction misses the target by up to u |d|: pad by that, and nothing else.
            let padded = bounds.padded(d.length() as f32 * f32::EPSILON);
            assert!(padded.entry_distance(&ray, f32::INFINITY).is_finite(), "{ray:?} {bounds:?}");
        }
    }
}
