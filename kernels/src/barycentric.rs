//! Barycentric coordinates.

use crate::math::{fma, fma3};
use glam::{Vec2, Vec3};

/// Weight m/n of a grid line: exactly 0 and 1 at the ends, also where division is not correctly rounded (Vulkan
/// allows 2.5 ulp), so that micro-vertices at corners are the corners; and exact where n is a power of two.
#[inline]
pub fn grid_weight(m: u32, n: u32) -> f32 {
    if n & (n - 1) == 0 {
        exact_weight(m, n)
    } else if m == n {
        1.0
    } else {
        m as f32 / n as f32
    }
}

/// m/n, n a power of two: exact on every device, which a division need not be.
#[inline]
pub fn exact_weight(m: u32, n: u32) -> f32 {
    // The exponent of 1/n is that of n with the other sign.
    m as f32 * f32::from_bits((254 << 23) - (n as f32).to_bits())
}

/// Barycentric coordinates (alpha, beta, gamma) of grid point (j, k) of a triangle whose sides have n parts.
#[inline]
pub fn grid_point(j: u32, k: u32, n: u32) -> Vec3 {
    Vec3::new(grid_weight(n - j - k, n), grid_weight(j, n), grid_weight(k, n))
}

/// `w.x a + w.y b + w.z c` in a fixed order of fused operations. A zero weight leaves no trace in the result: along
/// an edge the value depends on the edge's two vertices and weights alone, taken in order, whichever place the
/// third vertex has. With vertices in ascending order both triangles at an edge get the same bits.
#[inline]
pub fn interpolate(w: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    fma3(w.z, c, fma3(w.y, b, a * w.x))
}

/// [`interpolate`] for texture coordinates.
#[inline]
pub fn interpolate2(w: Vec3, a: Vec2, b: Vec2, c: Vec2) -> Vec2 {
    Vec2::new(fma(w.z, c.x, fma(w.y, b.x, a.x * w.x)), fma(w.z, c.y, fma(w.y, b.y, a.y * w.x)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::tests::Numbers;

    #[test]
    fn corners_of_the_grid_are_the_corners() {
        for n in 1..=4096 {
            assert_eq!(grid_point(0, 0, n), Vec3::X);
            assert_eq!(grid_point(n, 0, n), Vec3::Y);
            assert_eq!(grid_point(0, n, n), Vec3::Z);
        }
    }

    #[test]
    fn both_triangles_at_an_edge_interpolate_to_the_same_bits() {
        let mut numbers = Numbers::new(11);
        for _ in 0..10_000 {
            let (a, b) = (numbers.vec3() * numbers.wide(), numbers.vec3() * numbers.wide());
            let third = numbers.vec3() * 1e6;
            let n = 1 + (numbers.unit() * 100.0) as u32;
            let m = (numbers.unit() * n as f32) as u32;
            let (wa, wb) = (grid_weight(n - m, n), grid_weight(m, n));
            let last = interpolate(Vec3::new(wa, wb, 0.0), a, b, third);
            let middle = interpolate(Vec3::new(wa, 0.0, wb), a, third, b);
            let first = interpolate(Vec3::new(0.0, wa, wb), third, a, b);
            assert_eq!(last.to_array().map(f32::to_bits), middle.to_array().map(f32::to_bits));
            assert_eq!(last.to_array().map(f32::to_bits), first.to_array().map(f32::to_bits));
        }
    }
}
