//! What the host asks of boxes beyond what kernels do.

use emboss_kernels::aabb::Aabb;
use glam::{DVec3, Vec3};

/// Operations on boxes that only the host needs.
pub trait HostAabb {
    /// The smallest box around both.
    fn union(self, other: Aabb) -> Aabb;

    /// Whether `other` lies inside, touching allowed.
    fn contains(self, other: Aabb) -> bool;

    /// Its middle. Finite also where the box is not: an unbounded side counts as the largest float, so that a box
    /// unbounded on both sides has its middle at 0.
    fn center(self) -> Vec3;

    /// Half its surface area, in `f64`, where no finite box overflows; 0 for an empty box.
    fn half_area(self) -> f64;

    /// Its eight corners.
    fn corners(self) -> [Vec3; 8];
}

impl HostAabb for Aabb {
    fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn contains(self, other: Aabb) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }

    fn center(self) -> Vec3 {
        let bound = Vec3::splat(f32::MAX);
        0.5 * self.min.clamp(-bound, bound) + 0.5 * self.max.clamp(-bound, bound)
    }

    fn half_area(self) -> f64 {
        let size = (self.max.as_dvec3() - self.min.as_dvec3()).max(DVec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    fn corners(self) -> [Vec3; 8] {
        let side = |bit: bool| if bit { self.max } else { self.min };
        std::array::from_fn(|i| Vec3::new(side(i & 1 != 0).x, side(i & 2 != 0).y, side(i & 4 != 0).z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centers_are_finite() {
        let unbounded = Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
        assert_eq!(unbounded.center(), Vec3::ZERO);
        assert!(Aabb { min: Vec3::ZERO, max: Vec3::INFINITY }.center().is_finite());
        assert_eq!(
            Aabb { min: Vec3::ZERO, max: Vec3::new(2.0, 4.0, 6.0) }.center(),
            Vec3::new(1.0, 2.0, 3.0)
        );
    }

    #[test]
    fn areas_do_not_overflow() {
        let bounds = Aabb { min: Vec3::ZERO, max: Vec3::new(1.0, 2.0, 3.0) };
        assert_eq!(bounds.half_area(), 11.0);
        assert_eq!(Aabb::EMPTY.half_area(), 0.0);
        let huge = Aabb { min: Vec3::splat(-f32::MAX), max: Vec3::splat(f32::MAX) };
        assert!(huge.half_area().is_finite());
    }

    #[test]
    fn corners_span_the_box() {
        let bounds = Aabb { min: Vec3::ZERO, max: Vec3::new(1.0, 2.0, 3.0) };
        let corners = bounds.corners();
        assert_eq!(corners.iter().fold(Aabb::EMPTY, |b, &p| b.including(p)), bounds);
        assert!((0..8).all(|i| (0..i).all(|j| corners[i] != corners[j])));
    }
}
