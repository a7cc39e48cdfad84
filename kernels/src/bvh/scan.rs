//! Exclusive prefix sums: element i becomes the sum of all elements in front of it, modulo 2^32.
//!
//! Reduce, then scan (Sengupta, Harris, Zhang and Owens, "Scan Primitives for GPU Computing", 2007): a workgroup
//! sums each block, one workgroup scans the sums, and each block is scanned from its sum on. 12 bytes move a word.

use crate::parallel::{Word, Workgroup, phase, shared_at, shared_put, word};

/// Invocations of a workgroup.
pub const GROUP_SIZE: u32 = 128;
/// Consecutive elements of an invocation.
pub(super) const ITEMS: u32 = 8;
/// Elements of a workgroup.
pub const BLOCK: u32 = GROUP_SIZE * ITEMS;

/// Shared memory of a workgroup: one value an invocation, twice.
pub type Shared = [u32; 2 * GROUP_SIZE as usize];

/// How many blocks hold `count` elements.
#[inline]
pub fn blocks(count: u32) -> u32 {
    count.div_ceil(BLOCK)
}

/// First of three dispatches, with [`blocks`] workgroups: the sum of each block of `values[..count]`, to
/// `sums[block]`.
#[inline]
pub fn sum_blocks(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    values: &[Word],
    count: u32,
    sums: &[Word],
) {
    phase!(group, |local| {
        shared_put(shared, local, sum_items(values, first_item(group, local), count));
    });
    let end = scan_shared(group, shared);
    phase!(group, |local| {
        if local == 0 {
            word(sums, group.id).set(shared_at(shared, end + GROUP_SIZE - 1));
        }
    });
}

/// Second dispatch, a single workgroup: scans `values[..count]` in place, block after block. Right for any count; meant
/// for sums of blocks, some thousands.
#[inline]
pub fn scan_serially(group: Workgroup<GROUP_SIZE>, shared: &mut Shared, values: &[Word], count: u32) {
    let mut carry = 0u32;
    let mut block = 0;
    while block < blocks(count) {
        carry = carry.wrapping_add(scan_one(group.at(block), shared, values, count, carry));
        block += 1;
    }
}

/// Third dispatch, with [`blocks`] workgroups: scans each block of `values[..count]` in place, starting at
/// `sums[block]`.
#[inline]
pub fn scan_blocks(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    values: &[Word],
    count: u32,
    sums: &[Word],
) {
    scan_one(group, shared, values, count, word(sums, group.id).get());
}

/// Scans block `group.id` of `values[..count]` in place, from `carry` on; returns the block's sum.
#[inline]
fn scan_one(
    group: Workgroup<GROUP_SIZE>,
    shared: &mut Shared,
    values: &[Word],
    count: u32,
    carry: u32,
) -> u32 {
    phase!(group, |local| {
        shared_put(shared, local, sum_items(values, first_item(group, local), count));
    });
    let end = scan_shared(group, shared);
    let total = shared_at(shared, end + GROUP_SIZE - 1);
    phase!(group, |local| {
        let mut sum = carry;
        if local > 0 {
            sum = sum.wrapping_add(shared_at(shared, end + local - 1));
        }
        let first = first_item(group, local);
        let mut i = 0;
        while i < ITEMS {
            if first + i < count {
                let element = word(values, first + i);
                let value = element.get();
                element.set(sum);
                sum = sum.wrapping_add(value);
            }
            i += 1;
        }
    });
    total
}

/// The inclusive prefix sums of the first half of `shared`; returns where they start.
///
/// In ceil(log2) steps (Hillis and Steele, "Data Parallel Algorithms", 1986), between the two halves.
#[inline]
pub fn scan_shared(group: Workgroup<GROUP_SIZE>, shared: &mut Shared) -> u32 {
    let mut from = 0;
    let mut distance = 1;
    while distance < GROUP_SIZE {
        let to = GROUP_SIZE - from;
        phase!(group, |local| {
            let mut sum = shared_at(shared, from + local);
            if local >= distance {
                sum = sum.wrapping_add(shared_at(shared, from + local - distance));
            }
            shared_put(shared, to + local, sum);
        });
        from = to;
        distance *= 2;
    }
    from
}

/// First element of an invocation.
#[inline]
fn first_item(group: Workgroup<GROUP_SIZE>, local: u32) -> u32 {
    group.id * BLOCK + local * ITEMS
}

/// Sum of an invocation's elements.
#[inline]
fn sum_items(values: &[Word], first: u32, count: u32) -> u32 {
    let mut sum = 0u32;
    let mut i = 0;
    while i < ITEMS {
        if first + i < count {
            sum = sum.wrapping_add(word(values, first + i).get());
        }
        i += 1;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::pcg4d;
    use glam::UVec4;

    /// The three dispatches, on this thread.
    fn scan(values: &[u32]) -> Vec<u32> {
        let words: Vec<Word> = values.iter().map(|&value| Word::new(value)).collect();
        let count = values.len() as u32;
        let sums: Vec<Word> = (0..blocks(count)).map(|_| Word::new(0)).collect();
        let mut shared = [0; 2 * GROUP_SIZE as usize];
        for id in 0..blocks(count) {
            sum_blocks(Workgroup::new(id), &mut shared, &words, count, &sums);
        }
        scan_serially(Workgroup::new(0), &mut shared, &sums, blocks(count));
        for id in 0..blocks(count) {
            scan_blocks(Workgroup::new(id), &mut shared, &words, count, &sums);
        }
        words.into_iter().map(Word::into_inner).collect()
    }

    fn expected(values: &[u32]) -> Vec<u32> {
        let sum = |sum: &mut u32, value: &u32| Some(std::mem::replace(sum, sum.wrapping_add(*value)));
        values.iter().scan(0, sum).collect()
    }

    #[test]
    fn each_element_becomes_the_sum_of_those_in_front() {
        // Around every boundary: of an invocation's elements, of a block, of two blocks, of a block of sums.
        let sizes =
            [0, 1, 2, 7, 8, 9, 127, 1023, 1024, 1025, 2047, 2048, 2049, BLOCK * BLOCK - 1, BLOCK * BLOCK + 1];
        for size in sizes {
            let random = |i: u32| pcg4d(UVec4::new(i, size, 0, 0)).x;
            for values in [
                (0..size).map(|i| random(i) % 5).collect::<Vec<_>>(),
                vec![1; size as usize],
                // Sums wrap.
                (0..size).map(random).collect(),
            ] {
                assert!(scan(&values) == expected(&values), "{size} elements");
            }
        }
    }
}
