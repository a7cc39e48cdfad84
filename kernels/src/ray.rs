//! Rays as the kernels trace them.

use crate::hit::Hit;
use crate::interface::{MISS, Ray};
use crate::math::{fma, max_abs, times_power_of_two, to_size};
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

/// The length of a direction, from the least to the greatest that floats hold, and what it makes of a ray's parameter.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    /// The length over 2^exponent: from 1 to the root of 12.
    length: f32,
    /// The exponent of the greatest component.
    exponent: i32,
}

impl Stretch {
    /// The distance at a parameter.
    #[inline]
    pub fn distance(self, t: f32) -> f32 {
        times_power_of_two(t, self.exponent) * self.length
    }

    /// The parameter at a distance.
    #[inline]
    pub fn parameter(self, distance: f32) -> f32 {
        times_power_of_two(distance / self.length, -self.exponent)
    }

    /// The length itself; infinite, or as small as 0, where a float does not hold it.
    #[inline]
    pub fn length(self) -> f32 {
        self.distance(1.0)
    }
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
    /// divided on the way back. The direction may have any length but 0: see [`to_size`].
    #[inline]
    pub fn from_ray(ray: Ray) -> (Self, Stretch) {
        let (scaled, exponent) = to_size(ray.direction);
        let stretch = Stretch { length: scaled.length(), exponent };
        (Self::new(ray.origin, scaled / stretch.length, stretch.distance(ray.t_max)), stretch)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::tests::Numbers;

    /// Directions from the least floats to the greatest: the same line, with distances in its own lengths.
    #[test]
    fn rays_of_any_length_are_the_same_lines() {
        let mut numbers = Numbers::new(21);
        for exponent in -149..=127 {
            // Few bits, so that each length has the same direction.
            let direction = Vec3::new(1.0, -0.5, 0.25);
            let longer = (exponent as f32).exp2();
            let v = direction * longer;
            let t_max = 1.0 + numbers.unit();
            let (ray, stretch) = TraversalRay::from_ray(Ray { direction: v, t_max, ..Ray::default() });
            if exponent >= -147 {
                let (unit, _) = TraversalRay::from_ray(Ray { direction, t_max, ..Ray::default() });
                assert_eq!(ray.direction, unit.direction, "2^{exponent}");
            }
            assert!((ray.direction.length() - 1.0).abs() < 1e-6 && ray.shear.is_finite());
            let exact = f64::from(t_max) * v.as_dvec3().length();
            let (least, greatest) = (f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX));
            if exact > least && exact < greatest {
                assert!(
                    (f64::from(ray.t_max) - exact).abs() < 1e-6 * exact,
                    "2^{exponent}: {} {exact}",
                    ray.t_max
                );
                assert!((stretch.parameter(ray.t_max) - t_max).abs() < 1e-6 * t_max);
            }
        }
        let (_, stretch) = TraversalRay::from_ray(Ray { direction: Vec3::splat(f32::MAX), ..Ray::default() });
        assert!(stretch.parameter(1.0) > 0.0 && stretch.length().is_infinite());
    }
}
