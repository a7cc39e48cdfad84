//! The radix sort on the CPU: its kernels, with the workgroups of a dispatch spread over rayon's threads.

use super::scan::scan;
use emboss_kernels::bvh::radix_sort::{
    Counters, Entries, Histogram, Pairs, count_digits, count_words, limbs, pass, passes, scatter_pairs,
};
use emboss_kernels::bvh::scan::{Shared, blocks};
use emboss_kernels::parallel::{Word, Workgroup};
use rayon::prelude::*;

/// What a workgroup shares. Threads keep one for all workgroups that they run: it need not be cleared between them.
struct Scratch {
    histogram: Histogram,
    counters: Counters,
    sums: Shared,
    entries: Entries,
}

impl Scratch {
    fn new() -> Scratch {
        Scratch { histogram: [0; _], counters: [0; _], sums: [0; _], entries: [0; _] }
    }
}

/// Sorts `count` pairs by keys of `bits` bits, stably: see [`radix_sort`](emboss_kernels::bvh::radix_sort). They stand
/// in the first halves of `keys` and `values`, and in the end in half
/// [`result_half(bits)`](emboss_kernels::bvh::radix_sort::result_half).
///
/// # Panics
/// Where keys have more than 64 bits, or the buffers are too short for two halves.
pub fn sort_pairs(keys: &[Word], values: &[Word], count: u32, bits: u32) {
    assert!(bits <= 64, "keys have at most two limbs");
    let two_halves = 2 * count as usize;
    assert!(keys.len() >= two_halves * limbs(bits) as usize && values.len() >= two_halves);
    let counts: Vec<Word> = (0..count_words(count)).map(|_| Word::default()).collect();
    let groups = || (0..blocks(count)).into_par_iter();
    for pass in (0..passes(bits)).map(|index| pass(count, bits, index)) {
        groups().for_each_init(Scratch::new, |scratch, id| {
            count_digits(Workgroup::new(id), &mut scratch.histogram, &pass, keys, &counts);
        });
        scan(&counts);
        groups().for_each_init(Scratch::new, |scratch, id| {
            let Scratch { counters, sums, entries, .. } = scratch;
            let pairs = Pairs { keys, values };
            scatter_pairs(Workgroup::new(id), counters, sums, entries, &pass, pairs, &counts);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::bvh::radix_sort::result_half;
    use emboss_kernels::sampler::pcg4d;
    use glam::UVec4;

    /// The kernels' own tests say more of the sort; this one is of what runs them on threads.
    #[test]
    fn workgroups_on_threads_sort_as_one_thread_does() {
        const COUNT: u32 = 100_001;
        for bits in [32, 63] {
            // Upper limbs from a few values, so that both decide.
            let limb = |limb: u32, i: u32| pcg4d(UVec4::new(i, limb, bits, 0)).x >> (29 * limb);
            let room = |words: u32| (0..words).map(|_| Word::default());
            let of_limb = |l: u32| (0..COUNT).map(move |i| Word::new(limb(l, i)));
            let keys: Vec<Word> =
                (0..limbs(bits)).flat_map(of_limb).chain(room(limbs(bits) * COUNT)).collect();
            let values: Vec<Word> = (0..COUNT).map(Word::new).chain(room(COUNT)).collect();
            sort_pairs(&keys, &values, COUNT, bits);
            let mut expected: Vec<u32> = (0..COUNT).collect();
            expected.sort_by_key(|&i| if bits > 32 { (limb(1, i), limb(0, i)) } else { (0, limb(0, i)) });
            let first = (result_half(bits) * COUNT) as usize;
            let sorted = values[first..][..COUNT as usize].iter().map(Word::get);
            assert!(sorted.eq(expected), "{bits} bits");
        }
    }
}
