//! The exclusive scan on the CPU: its kernels, with the workgroups of a dispatch spread over rayon's threads.

use emboss_kernels::bvh::scan::{Shared, blocks, scan_blocks, scan_serially, sum_blocks};
use emboss_kernels::parallel::{Word, Workgroup};
use rayon::prelude::*;

/// Scans the values in place: see [`scan`](emboss_kernels::bvh::scan).
///
/// # Panics
/// Where there are 2^32 or more.
pub fn scan(values: &[Word]) {
    let count = u32::try_from(values.len()).expect("positions are words");
    let sums: Vec<Word> = (0..blocks(count)).map(|_| Word::default()).collect();
    let groups = || (0..blocks(count)).into_par_iter();
    let shared = || -> Shared { [0; _] };
    groups().for_each_init(shared, |shared, id| {
        sum_blocks(Workgroup::new(id), shared, values, count, &sums);
    });
    scan_serially(Workgroup::new(0), &mut shared(), &sums, blocks(count));
    groups().for_each_init(shared, |shared, id| {
        scan_blocks(Workgroup::new(id), shared, values, count, &sums);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_becomes_the_sum_of_those_in_front_of_it() {
        for count in [0, 1, 1023, 1024, 1025, 100_001] {
            let value = |i: u32| i.wrapping_mul(0x9e37_79b1);
            let values: Vec<Word> = (0..count).map(|i| Word::new(value(i))).collect();
            scan(&values);
            let mut sum = 0_u32;
            for (i, got) in (0..count).zip(&values) {
                assert_eq!(got.get(), sum, "{i} of {count}");
                sum = sum.wrapping_add(value(i));
            }
        }
    }
}
