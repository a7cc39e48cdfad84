//! Seeded random numbers.

use emboss_kernels::sampler::{pcg4d, unit_float};
use glam::{UVec4, Vec3};

/// A sequence of random numbers that its seed determines.
pub struct Numbers(UVec4);

impl Numbers {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u32) -> Numbers {
        Numbers(UVec4::new(seed, 0, 0, 0))
    }

    /// Any word.
    pub fn word(&mut self) -> u32 {
        self.0.y = self.0.y.wrapping_add(1);
        pcg4d(self.0).x
    }

    /// Uniform in [0,1).
    pub fn unit(&mut self) -> f32 {
        unit_float(self.word())
    }

    /// Uniform in [-1,1)³.
    pub fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - Vec3::ONE
    }

    /// A unit vector: the direction of a point of the cube [-1,1)³.
    pub fn direction(&mut self) -> Vec3 {
        self.vec3().try_normalize().unwrap_or(Vec3::Z)
    }

    /// Of either sign, of a magnitude between 2^-20 and 2^20.
    pub fn wide(&mut self) -> f32 {
        (self.unit() * 2.0 - 1.0) * (self.unit() * 40.0 - 20.0).exp2()
    }
}
