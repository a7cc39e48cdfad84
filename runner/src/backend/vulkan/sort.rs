//! The radix sort on the device: [`emboss_kernels::bvh::radix_sort`], recorded between other dispatches.

use super::buffer::Buffer;
use super::commands::Recorder;
use super::device::Device;
use super::pipeline::{Kernel, Pipeline};
use super::scan::{self, MOST_ITEMS, Scanner};
use crate::backend::BackendError;
use bytemuck::bytes_of;
use emboss_kernels::bvh::radix_sort::{count_words, pass, passes};
use emboss_kernels::bvh::scan::blocks;
use emboss_kernels::interface::binding;
use emboss_kernels::scene::Features;
use std::sync::Arc;

/// The buffers that a sort works in.
#[derive(Clone, Copy)]
pub(super) struct SortBuffers<'a> {
    /// Two halves of keys, each of [`limbs`](emboss_kernels::bvh::radix_sort::limbs) words a pair.
    pub(super) keys: &'a Buffer,
    /// Two halves of values, each of a word a pair.
    pub(super) values: &'a Buffer,
    /// [`count_words`].
    pub(super) counts: &'a Buffer,
    /// [`sum_words`].
    pub(super) sums: &'a Buffer,
}

/// The pipelines of a sort, bound to its buffers.
pub(super) struct Sorter {
    count_digits: Pipeline,
    scanner: Scanner,
    scatter_pairs: Pipeline,
}

/// How many words the sums of the counts of `count` pairs take.
pub(super) fn sum_words(count: u32) -> u32 {
    scan::sum_words(count_words(count))
}

impl Sorter {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, BackendError> {
        let pipeline = |kernel| Pipeline::new(device, kernel, Features::default());
        Ok(Sorter {
            count_digits: pipeline(Kernel::CountDigits)?,
            scanner: Scanner::new(device)?,
            scatter_pairs: pipeline(Kernel::ScatterPairs)?,
        })
    }

    /// What scans the counts; may be bound to other words between two sorts.
    pub(super) fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    pub(super) fn bind(&self, buffers: SortBuffers<'_>) {
        for pipeline in [&self.count_digits, &self.scatter_pairs] {
            pipeline.bind(|at| match at {
                binding::SORT_KEYS => buffers.keys,
                binding::SORT_VALUES => buffers.values,
                _ => buffers.counts,
            });
        }
        self.scanner.bind(buffers.counts, buffers.sums);
    }

    /// Sorts `count` pairs, which stand in half 0 of the buffers, by keys of `bits` bits, 1 to 64; they end in half
    /// [`result_half(bits)`](emboss_kernels::bvh::radix_sort::result_half). Ends with a barrier. One must stand in
    /// front of it, too, behind what wrote the pairs.
    ///
    /// # Panics
    /// Where there are more than [`MOST_ITEMS`] pairs, or keys have more bits.
    pub(super) fn record(&self, recorder: &Recorder<'_>, count: u32, bits: u32) {
        assert!(count <= MOST_ITEMS, "a sort takes at most {MOST_ITEMS} pairs");
        assert!(bits <= 64, "keys have at most two limbs");
        for pass in (0..passes(bits)).map(|index| pass(count, bits, index)) {
            let groups = [blocks(count), 1];
            recorder.dispatch(&self.count_digits, bytes_of(&pass), groups);
            recorder.barrier();
            self.scanner.record(recorder, count_words(count));
            recorder.dispatch(&self.scatter_pairs, bytes_of(&pass), groups);
            recorder.barrier();
        }
    }
}
