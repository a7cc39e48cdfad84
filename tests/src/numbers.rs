//! Random numbers for tests: the same on every machine and in every run.

use glam::Vec3;

/// A sequence of random numbers that its seed decides: SplitMix64 (Steele, Lea and Flood, "Fast Splittable
/// Pseudorandom Number Generators", 2014). It is not the kernels' generator, which is itself under test.
#[derive(Clone, Debug)]
pub struct Numbers(u64);

impl Numbers {
    /// The sequence of that seed.
    pub fn new(seed: u64) -> Self {
        Numbers(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// The next 32 bits.
    pub fn word(&mut self) -> u32 {
        (self.bits() >> 32) as u32
    }

    /// A multiple of 2^-24 in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// A number in [`low`, `high`].
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// An integer in [0, `n`), `n` above 0; the bias is below n / 2^32.
    pub fn below(&mut self, n: u32) -> u32 {
        (((self.bits() >> 32) * u64::from(n)) >> 32) as u32
    }

    /// Of either sign, of a magnitude between 2^-20 and 2^20.
    pub fn wide(&mut self) -> f32 {
        self.between(-1.0, 1.0) * self.between(-20.0, 20.0).exp2()
    }

    /// A point of the cube [-1, 1]³.
    pub fn in_cube(&mut self) -> Vec3 {
        Vec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }

    /// A unit vector, every direction equally likely.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.in_cube();
            if (0.01..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    /// Barycentric coordinates of a point of a triangle, each point equally likely.
    pub fn barycentric(&mut self) -> Vec3 {
        let (b, c) = (self.unit(), self.unit());
        let (b, c) = if b + c > 1.0 { (1.0 - b, 1.0 - c) } else { (b, c) };
        Vec3::new(1.0 - b - c, b, c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first numbers of seed 1234567, as the authors' own program gives them.
    #[test]
    fn sequence_is_the_published_one() {
        let mut numbers = Numbers::new(1_234_567);
        let first = [numbers.bits(), numbers.bits(), numbers.bits()];
        assert_eq!(first, [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]);
    }

    #[test]
    fn numbers_keep_their_ranges() {
        let mut numbers = Numbers::new(1);
        for _ in 0..10_000 {
            assert!((0.0..1.0).contains(&numbers.unit()) && numbers.below(7) < 7);
            assert!(numbers.direction().is_normalized());
            assert!(numbers.barycentric().min_element() >= -1e-7);
        }
    }
}
