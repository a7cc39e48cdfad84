//! Render space: the coordinates that kernels compute in.
//!
//! Kernels compute in `f32`, whose numbers are 2^-24 of themselves apart: far from the origin that is more than a
//! relief is high, and the squares of very small or large lengths leave the range that devices compute in. A scene
//! therefore has a space of its own (pbrt-v4, section 5.1, does the same with its camera): its origin, in doubles, is
//! subtracted from all that is read, and the difference multiplied by a power of two, before anything is rounded to
//! `f32`. A power of two changes no bit of what follows.

use glam::DVec3;

/// From the units of models to those of the kernels: render = (world - origin) 2^exponent.
///
/// The default leaves coordinates as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSpace {
    /// What stands at the origin of render space, in world units.
    pub origin: DVec3,
    /// Lengths are 2 to the power of this times as long in render space, -500 to 500.
    pub exponent: i32,
}

impl RenderSpace {
    /// How many times as long lengths are in render space, exactly.
    pub fn scale(&self) -> f64 {
        2_f64.powi(self.exponent)
    }

    /// A point of the world in render space. Rounded where the difference has more than 53 bits.
    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.origin) * self.scale()
    }

    /// A point of render space in the world.
    pub fn world(&self, render: DVec3) -> DVec3 {
        self.origin + render * 2_f64.powi(-self.exponent)
    }

    /// A length of the world in render space.
    pub fn length(&self, world: f64) -> f64 {
        world * self.scale()
    }

    /// A length of render space in the world.
    pub fn world_length(&self, render: f64) -> f64 {
        render * 2_f64.powi(-self.exponent)
    }

    /// The space with its origin moved to where a point of the world is, in steps so long in render space, and not at
    /// all within half a step. An infinite step, or one of no length, leaves it.
    pub fn moved_to(&self, world: DVec3, step: f64) -> RenderSpace {
        if !step.is_normal() {
            return *self;
        }
        let steps = (self.point(world) / step).map(f64::round);
        let moved = RenderSpace { origin: self.origin + steps * self.world_length(step), ..*self };
        if moved.origin.is_finite() { moved } else { *self }
    }

    /// The intensity of a light, irradiance times squared distance, in render space.
    pub fn intensity(&self, world: f64) -> f64 {
        world * self.scale() * self.scale()
    }

    /// An intensity of render space in the world.
    pub fn world_intensity(&self, render: f64) -> f64 {
        render / (self.scale() * self.scale())
    }
}

/// The origin of a mesh, or a scene, whose box reaches from `min` to `max`: its middle, rounded to multiples of the
/// least power of two that is greater than the box.
///
/// What lies around it has coordinates of at most one and a half times the box's greatest side. What reaches the
/// world's origin from one side or stands around it has its origin there, so that nothing of it is rounded; and what
/// is moved by such a multiple keeps its bits. Of a box without extent it is where it
/// stands, of one that is not finite the world's.
pub fn origin_of(min: DVec3, max: DVec3) -> DVec3 {
    let extent = (max - min).max_element();
    let middle = min * 0.5 + max * 0.5;
    if !(extent.is_normal() && middle.is_finite()) {
        return if middle.is_finite() && extent == 0.0 { middle } else { DVec3::ZERO };
    }
    let grid = 2_f64.powi(exponent_of(extent) + 1);
    // Beyond 2^53 multiples all numbers are.
    (middle / grid).map(f64::round) * grid
}

/// The exponent of the greatest power of two that is no more than `x`, which is above 0 and finite.
pub(crate) fn exponent_of(x: f64) -> i32 {
    // Of normal numbers it stands in their bits, less 1023; denormal ones count as the least normal one.
    let biased = i32::try_from(x.to_bits() >> 52 & 0x7ff).unwrap_or(0);
    biased.max(1) - 1023
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lengths_and_intensities_come_back() {
        let space = RenderSpace { origin: DVec3::new(4e5, 0.0, -5e6), exponent: -37 };
        let p = DVec3::new(4e5 + 0.25, 7.0, -5e6 - 3.0);
        assert_eq!(space.point(p), DVec3::new(0.25, 7.0, -3.0) * 2_f64.powi(-37));
        assert_eq!(space.world(space.point(p)), p);
        assert_eq!(space.world_length(space.length(0.3)), 0.3);
        assert_eq!(space.world_intensity(space.intensity(0.3)), 0.3);
        // Irradiance is the same in both: intensity over squared distance.
        assert_eq!(space.intensity(5.0) / space.length(3.0).powi(2), 5.0 / 9.0);
        assert_eq!(RenderSpace::default().point(p), p);
    }

    #[test]
    fn origins_follow_points_in_steps() {
        let space = RenderSpace { origin: DVec3::X, exponent: 2 };
        let moved = |x: f64, step: f64| space.moved_to(DVec3::X * (1.0 + x), step).origin.x - 1.0;
        assert_eq!(
            [0.0, 0.9, -0.9, 1.1, 2.9, 3.1, 1e9].map(|x| moved(x, 8.0)),
            [0.0, 0.0, 0.0, 2.0, 2.0, 4.0, 1e9]
        );
        assert_eq!([0.0, f64::INFINITY].map(|step| moved(1e9, step)), [0.0, 0.0]);
    }

    #[test]
    fn exponents() {
        for (x, exponent) in [(1.0, 0), (1.99, 0), (2.0, 1), (0.75, -1), (1e12, 39), (1e-12, -40)] {
            assert_eq!(exponent_of(x), exponent, "{x}");
        }
    }

    #[test]
    fn what_stands_at_the_origin_stays_there() {
        let at = |min: DVec3, extent: f64| origin_of(min, min + DVec3::new(extent, 0.5 * extent, 0.0));
        for extent in [1e-9, 1.0, 20.0, 1e7] {
            assert_eq!(at(DVec3::ZERO, extent), DVec3::ZERO);
            assert_eq!(at(DVec3::splat(-0.5 * extent), extent), DVec3::ZERO);
        }
    }

    /// Moved by a multiple of its grid, a box has its origin moved by as much, and lies around it.
    #[test]
    fn origins_move_with_their_boxes() {
        let (min, max) = (DVec3::new(3.1, -0.2, 7.0), DVec3::new(6.3, 0.9, 8.0));
        let offset = DVec3::new(4e9, -8e6, 4e3);
        assert_eq!(origin_of(min + offset, max + offset), origin_of(min, max) + offset);
        for far in [0.0, 1e3, 1e9] {
            let (min, max) = (min + far, max + far);
            let origin = origin_of(min, max);
            let reach = (max - origin).abs().max((min - origin).abs()).max_element();
            assert!(reach <= 1.5 * 3.2 + 1e-6, "{reach}");
        }
    }
}
