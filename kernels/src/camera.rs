//! The pinhole camera.

use crate::interface::Camera;
use glam::{Vec2, Vec3};

impl Camera {
    /// Unit direction of the ray through film coordinates `film` in [0,1]², x to the right, y down.
    #[inline]
    pub fn ray_direction(&self, film: Vec2) -> Vec3 {
        (self.forward + self.right * (2.0 * film.x - 1.0) + self.up * (1.0 - 2.0 * film.y)).normalize()
    }
}
