//! Float and memory helpers: the only file in which the two targets differ.

use crate::interface::Counter;

/// `buffer[i]`. The caller guarantees `i < buffer.len()`: CPU builds check it, the SPIR-V build does not, since a
/// bounds check on every load costs a quarter of a ray tracer's time and a failed one would end the invocation
/// without a word.
#[inline]
pub fn at<T: Copy>(buffer: &[T], i: u32) -> T {
    #[cfg(not(target_arch = "spirv"))]
    {
        buffer[i as usize]
    }
    #[cfg(target_arch = "spirv")]
    #[expect(
        unsafe_code,
        reason = "unchecked load; the CPU build of the same source checks the index"
    )]
    // SAFETY: the CPU build of the same source checks this index, and the parity tests run both on the same input.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked(buffer, i as usize)
    }
}

/// `a * b + c`, rounded once. On SPIR-V the explicit `Fma` instruction: no driver may contract it differently in
/// another copy of the code, which is what two triangles at an edge rely on.
#[inline]
pub fn fma(a: f32, b: f32, c: f32) -> f32 {
    use spirv_std::num_traits::Float;
    Float::mul_add(a, b, c)
}

/// `buffer[i] = value`, checked like [`at`].
#[inline]
pub fn put<T: Copy>(buffer: &mut [T], i: u32, value: T) {
    #[cfg(not(target_arch = "spirv"))]
    {
        buffer[i as usize] = value;
    }
    #[cfg(target_arch = "spirv")]
    #[expect(
        unsafe_code,
        reason = "unchecked store; the CPU build of the same source checks the index"
    )]
    // SAFETY: as in `at`.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked_mut(buffer, i as usize) = value;
    }
}

/// Adds `value` to a 64-bit counter that all invocations share: atomically on SPIR-V, where the upper word counts
/// the lower one's overflows. On the CPU the caller holds the buffer alone.
#[inline]
pub fn add_counter(counters: &mut [Counter], i: u32, value: u32) {
    let counter = &mut counters[i as usize];
    let old = add_atomically(&mut counter.low, value);
    if old.wrapping_add(value) < old {
        add_atomically(&mut counter.high, 1);
    }
}

/// Adds to a word, returns its old value.
#[inline]
fn add_atomically(word: &mut u32, value: u32) -> u32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        let old = *word;
        *word = old.wrapping_add(value);
        old
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "atomics are unsafe in spirv-std")]
    // SAFETY: every access to the counters goes through this function.
    unsafe {
        use spirv_std::memory::{Scope, Semantics};
        spirv_std::arch::atomic_i_add::<u32, { Scope::QueueFamily as u32 }, { Semantics::NONE.bits() }>(
            word, value,
        )
    }
}
