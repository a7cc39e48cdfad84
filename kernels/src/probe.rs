//! Elementary kernels one by one, on words in and words out, so that tests can compare every one of them between
//! the CPU and a device. Nothing that renders calls this module.

use crate::math::{at, put};
use crate::sampler::pcg4d;
use glam::UVec4;

/// [`pcg4d`]: 4 words in, 4 words out.
pub const PCG4D: u32 = 0;
/// Words that each item reads.
pub const IN_STRIDE: u32 = 32;
/// Words that each item writes.
pub const OUT_STRIDE: u32 = 8;

/// Runs kernel `kernel` on item `i`: input words `i * IN_STRIDE ..`, output words `i * OUT_STRIDE ..`.
pub fn run(kernel: u32, input: &[u32], output: &mut [u32], i: u32) {
    let (a, b) = (i * IN_STRIDE, i * OUT_STRIDE);
    if kernel == PCG4D {
        let v = pcg4d(UVec4::new(at(input, a), at(input, a + 1), at(input, a + 2), at(input, a + 3)));
        put(output, b, v.x);
        put(output, b + 1, v.y);
        put(output, b + 2, v.z);
        put(output, b + 3, v.w);
    }
}
