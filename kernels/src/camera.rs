//! The pinhole camera.

use crate::interface::Camera;
use glam::{Vec2, Vec3};

impl Camera {
    /// Unit direction of the ray through film coordinates `film` in [0, 1]², x to the right, y down.
    #[inline]
    pub fn ray_direction(&self, film: Vec2) -> Vec3 {
        (self.forward + self.right * (2.0 * film.x - 1.0) + self.up * (1.0 - 2.0 * film.y)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn film_centre_is_forward_and_corners_are_its_half_axes_away() {
        let camera =
            Camera { right: Vec3::X * 2.0, up: Vec3::Y * 0.5, forward: -Vec3::Z, ..Camera::default() };
        assert_eq!(camera.ray_direction(Vec2::splat(0.5)), -Vec3::Z);
        let top_left = camera.ray_direction(Vec2::ZERO);
        assert!((top_left - Vec3::new(-2.0, 0.5, -1.0).normalize()).length() < 1e-7);
        let bottom_right = camera.ray_direction(Vec2::ONE);
        assert!((bottom_right - Vec3::new(2.0, -0.5, -1.0).normalize()).length() < 1e-7);
    }
}
