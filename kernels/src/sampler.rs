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

#[cfg(test)]
mod tests {
    use super::*;

    /// The listing of the paper, in 64-bit arithmetic cut to 32 bits.
    fn reference(v: [u64; 4]) -> [u64; 4] {
        const MASK: u64 = 0xffff_ffff;
        let mut v = v.map(|x| (x * 1_664_525 + 1_013_904_223) & MASK);
        for round in 0..2 {
            for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
                v[to] = (v[to] + v[a] * v[b] % (1 << 32)) & MASK;
            }
            if round == 0 {
                v = v.map(|x| x ^ (x >> 16));
            }
        }
        v
    }

    #[test]
    fn hash_is_that_of_the_paper() {
        for i in 0..1000_u32 {
            let v = UVec4::new(i, i.wrapping_mul(77_777), u32::MAX - i, i << 20);
            let expected = reference(v.to_array().map(u64::from));
            assert_eq!(pcg4d(v).to_array().map(u64::from), expected);
        }
    }

    #[test]
    fn unit_float_stays_below_one() {
        assert_eq!(unit_float(0), 0.0);
        assert_eq!(unit_float(u32::MAX), 1.0 - f32::EPSILON * 0.5);
    }

    /// Chi-square over a 16x16 grid for neighbouring pixels and samples: 255 degrees of freedom, whose quantile of
    /// 1e-6 on either side is 157 and 380.
    #[test]
    fn samples_fill_the_square_evenly() {
        let mut bins = [0u32; 256];
        let count = 256 * 400;
        for i in 0..count {
            let p = sample_2d(i % 40, i / 40 % 40, i / 1600, 1);
            bins[(p.x * 16.0) as usize * 16 + (p.y * 16.0) as usize] += 1;
        }
        let chi2: f64 = bins.iter().map(|&b| (f64::from(b) - 400.0).powi(2) / 400.0).sum();
        assert!((157.0..380.0).contains(&chi2), "{chi2}");
    }

    #[test]
    fn every_coordinate_changes_the_sample() {
        let base = sample_2d(1, 2, 3, 4);
        for other in
            [sample_2d(2, 2, 3, 4), sample_2d(1, 3, 3, 4), sample_2d(1, 2, 4, 4), sample_2d(1, 2, 3, 5)]
        {
            assert_ne!(base, other);
        }
    }
}
