//! Counter-based random numbers: the value depends on pixel, sample, seed and dimension alone, not on who asked
//! before, so that pictures are the same whatever the order of tiles and whatever the backend.

use glam::{UVec4, Vec2};

/// The 4-dimensional PCG hash of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020, listing
/// `pcg4d`. Integer arithmetic only: identical on every target.
#[inline]
pub fn pcg4d(v: UVec4) -> UVec4 {
    let mut x = v.x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut y = v.y.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut z = v.z.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut w = v.w.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    w ^= w >> 16;
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    UVec4::new(x, y, z, w)
}

/// Uniform in [0,1): the upper 24 bits, which a float holds exactly.
#[inline]
pub fn unit_float(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Two uniform numbers in [0,1) for sample number `sample` of pixel (x, y).
#[inline]
pub fn sample_2d(x: u32, y: u32, sample: u32, seed: u32) -> Vec2 {
    let bits = pcg4d(UVec4::new(x, y, sample, seed));
    Vec2::new(unit_float(bits.x), unit_float(bits.y))
}
