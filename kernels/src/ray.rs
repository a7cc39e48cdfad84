//! Rays as the kernels trace them.

use crate::hit::Hit;
use crate::interface::{MISS, Ray};
use crate::math::{fma, max_abs};
use glam::Vec3;

/// A ray with what the box and triangle tests need computed once. Its direction is a unit vector, so that `t` is a
/// distance and error bounds need no further scale.
#[derive(Clone, Copy, Debug)]
pub struct TraversalRay {
    /// Where it starts.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Reciprocal of the direction; infinite where a component is zero.
    pub inv_direction: Vec3,
    /// Hits up to this distance count.
    pub t_max: f32,
    /// Axis along which the direction is longest: 0, 1 or 2.
    pub major_axis: u32,
    /// Shear that takes the direction to the major axis, and the reciprocal of its length along it: S of Woop,
    /// Benthin and Wald 2013, section 3.1.
    pub shear: Vec3,
    /// Base triangle and packed cell that the ray leaves and cannot hit again, since a micro-triangle is flat;
    /// [`MISS`] where it starts elsewhere.
    pub left_primitive: u32,
    /// See `left_primitive`.
    pub left_cell: u32,
    /// The instance whose triangle that is.
    pub left_instance: u32,
    /// Unit normal of the plane that the ray leaves, on the side that it leaves to. What lies in that plane within
    /// rounding, or wholly behind it, the ray cannot hit: see [`triangle`](crate::triangle).
    pub left_normal: Vec3,
    /// A bound on the coordinates that the ray's start was computed from; negative where it leaves no plane.
    pub left_reach: f32,
}

impl TraversalRay {
    /// The ray from `origin` along the unit vector `direction`, up to the distance `t_max`.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3, t_max: f32) -> Self {
        let a = direction.abs();
        let major_axis = if a.x > a.y {
            if a.x > a.z { 0 } else { 2 }
        } else if a.y > a.z {
            1
        } else {
            2
        };
        let d = permute(direction, major_axis);
        TraversalRay {
            origin,
            direction,
            inv_direction: Vec3::new(1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z),
            t_max,
            major_axis,
            shear: Vec3::new(d.x / d.z, d.y / d.z, 1.0 / d.z),
            left_primitive: MISS,
            left_cell: 0,
            left_instance: 0,
            left_normal: Vec3::ZERO,
            left_reach: -1.0,
        }
    }

    /// The same ray for `trace_rays`: normalised, with the length of the given direction, by which distances are
    /// divided on the way back.
    #[inline]
    pub fn from_ray(ray: Ray) -> (Self, f32) {
        // Scaled by the greatest component first, so that squares neither overflow nor vanish.
        let scale = crate::math::max_abs(ray.direction);
        let scaled = ray.direction / scale;
        let length = scaled.length();
        (Self::new(ray.origin, scaled / length, ray.t_max * (length * scale)), length * scale)
    }

    /// The same ray, which leaves the micro-triangle of `hit` to the side of the unit vector `normal`, the normal of
    /// its plane: it cannot hit that micro-triangle, nor what is in its plane within rounding.
    #[inline]
    pub fn leaving(self, hit: Hit, normal: Vec3) -> Self {
        TraversalRay {
            left_primitive: hit.primitive,
            left_cell: hit.cell,
            left_instance: hit.instance,
            left_normal: normal,
            left_reach: max_abs(self.origin),
            ..self
        }
    }

    /// `p` relative to the origin, sheared so that the ray runs along the third axis: what all triangles of a
    /// vertex compute alike.
    #[inline]
    pub fn shear_point(&self, p: Vec3) -> Vec3 {
        let p = permute(p - self.origin, self.major_axis);
        Vec3::new(fma(-self.shear.x, p.z, p.x), fma(-self.shear.y, p.z, p.y), p.z * self.shear.z)
    }
}

/// The components in the cyclic order that puts `axis` third.
#[inline]
pub(crate) fn permute(v: Vec3, axis: u32) -> Vec3 {
    if axis == 0 {
        Vec3::new(v.y, v.z, v.x)
    } else if axis == 1 {
        Vec3::new(v.z, v.x, v.y)
    } else {
        v
    }
}
