//! Items for the elementary kernels of [`probe`], and random numbers for them.

use crate::backend::{Backend, BackendError};
use emboss_kernels::probe;
use emboss_kernels::sampler::pcg4d;
use glam::{UVec4, Vec3};

/// Runs elementary kernels: a backend, and in tests one with faults that no device at hand has.
pub(super) trait Prober {
    /// See [`Backend::probe`].
    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError>;

    /// See [`Backend::let_contract`].
    fn let_contract(&mut self, contracts: bool);
}

impl Prober for dyn Backend + '_ {
    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError> {
        Backend::probe(self, kernel, input, count)
    }

    fn let_contract(&mut self, contracts: bool) {
        Backend::let_contract(self, contracts);
    }
}

/// Words that a kernel writes for an item.
pub(super) type Output = [u32; probe::OUT_STRIDE as usize];

/// The outputs of kernel `kernel` of [`probe`] for items whose words are given as floats.
pub(super) fn run<const N: usize>(
    prober: &mut (impl Prober + ?Sized),
    kernel: u32,
    items: &[[f32; N]],
) -> Result<Vec<Output>, BackendError> {
    let words: Vec<[u32; N]> = items.iter().map(|item| item.map(f32::to_bits)).collect();
    run_words(prober, kernel, &words)
}

/// The same of items that are given as words.
pub(super) fn run_words<const N: usize>(
    prober: &mut (impl Prober + ?Sized),
    kernel: u32,
    items: &[[u32; N]],
) -> Result<Vec<Output>, BackendError> {
    let stride = probe::IN_STRIDE as usize;
    let mut words = vec![0; items.len() * stride];
    for (padded, item) in words.chunks_exact_mut(stride).zip(items) {
        padded[..N].copy_from_slice(item);
    }
    let count = u32::try_from(items.len()).unwrap_or(u32::MAX);
    let outputs = prober.probe(kernel, &words, count)?;
    let (outputs, _) = outputs.as_chunks();
    Ok(outputs.to_vec())
}

/// Seeded random numbers.
pub(super) struct Numbers(UVec4);

impl Numbers {
    pub(super) fn new(seed: u32) -> Self {
        Numbers(UVec4::new(seed, 0, 0, 0))
    }

    pub(super) fn word(&mut self) -> u32 {
        self.0.y = self.0.y.wrapping_add(1);
        pcg4d(self.0).x
    }

    /// Below 1.
    pub(super) fn unit(&mut self) -> f32 {
        (self.word() >> 8) as f32 / 16_777_216.0
    }

    /// A number of either sign, of a magnitude from 2^-`reach` to 2^`reach`.
    pub(super) fn wide(&mut self, reach: f32) -> f32 {
        let magnitude = (1.0 + self.unit()) * ((2.0 * self.unit() - 1.0) * (reach - 1.0)).floor().exp2();
        if self.word() & 1 == 0 { magnitude } else { -magnitude }
    }

    /// In the cube [-1, 1]³.
    pub(super) fn in_cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - Vec3::ONE
    }
}
