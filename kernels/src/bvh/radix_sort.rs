//! Stable sort of pairs of a key and a value by key: least significant digit first, four bits a pass.
//!
//! A pass is that of Satish, Harris and Garland ("Designing Efficient Sorting Algorithms for Manycore GPUs", 2009):
//! [`count_digits`] counts each block's digits, a [`scan`] of the counts, digit by digit and within a digit block by
//! block, says where each block's pairs of each digit go, and [`scatter_pairs`] takes them there. It sorts a
//! block in shared memory first, so that neighbours in a workgroup write neighbours in memory.
//!
//! Keys and values stand in two halves of their buffers, between which the passes go back and forth. A key of more than
//! 32 bits has two *limbs*, the lower first, each in an array of its own: limb l of half h begins at word
//! `(h * limbs + l) * count`. The values of half h begin at word `h * count`.

use super::scan::{self, BLOCK, GROUP_SIZE, ITEMS, blocks, first_item, scan_shared};
use crate::interface::SortPass;
use crate::parallel::{Word, Workgroup, phase, shared_at, shared_put, word};

/// Bits of a digit.
const DIGIT_BITS: u32 = 4;
/// How many values a digit has.
const DIGITS: u32 = 1 << DIGIT_BITS;
/// Most limbs of a key.
const MOST_LIMBS: u32 = 2;

/// Rows of counters: each word holds two, of the digits `row` and `row + ROWS`. A block has at most 1024 pairs, so
/// that no count and no sum of counts of a block leaves its 16 bits.
const ROWS: u32 = DIGITS / 2;

/// Shared memory of a workgroup: eight rows of one word for each invocation, two counters in each word.
pub type Counters = [u32; (ROWS * GROUP_SIZE) as usize];
/// Shared memory of a workgroup: the limbs of a block's keys, then its values.
pub type Staged = [u32; ((MOST_LIMBS + 1) * BLOCK) as usize];

/// The buffers that a sort works in.
#[derive(Clone, Copy)]
pub struct Pairs<'a> {
    /// The keys' limbs, in two halves.
    pub keys: &'a [Word],
    /// The values, in two halves.
    pub values: &'a [Word],
}

/// Limbs of keys of `bits` bits, 1 to 64.
pub fn limbs(bits: u32) -> u32 {
    bits.div_ceil(32)
}

/// How many passes sort keys of `bits` bits.
pub fn passes(bits: u32) -> u32 {
    bits.div_ceil(DIGIT_BITS)
}

/// Pass number `index` of those that sort `count` pairs, which stand in half 0 at first, by keys of `bits` bits. Higher
/// bits of the keys are 0.
pub fn pass(count: u32, bits: u32, index: u32) -> SortPass {
    SortPass { count, limbs: limbs(bits), shift: index * DIGIT_BITS, from: index % 2 }
}

/// The half in which the sorted pairs stand after all [`passes`].
pub fn result_half(bits: u32) -> u32 {
    passes(bits) % 2
}

/// How many words the counts of `count` pairs take.
pub fn count_words(count: u32) -> u32 {
    DIGITS * blocks(count)
}

/// First dispatch of a pass, with [`blocks`] workgroups: how many pairs of each digit each block has, to
/// `counts[digit * blocks + block]`.
#[inline]
pub fn count_digits(
    group: Workgroup<GROUP_SIZE>,
    counters: &mut Counters,
    pass: &SortPass,
    keys: &[Word],
    counts: &[Word],
) {
    count_items(group, counters, pass, keys);
    // Each row's sum in two steps: of every `parts`th word, by `parts` invocations, then of what these found.
    let parts = GROUP_SIZE / ROWS;
    phase!(group, |local| {
        let first = local / parts * GROUP_SIZE + local % parts;
        let sum = sum_words(counters, first, parts, ROWS);
        shared_put(counters, first, sum);
    });
    phase!(group, |local| {
        if local < DIGITS {
            let sum = sum_words(counters, row(local) * GROUP_SIZE, 1, parts);
            word(counts, local * blocks(pass.count) + group.id).set(half_of(sum, local));
        }
    });
}

/// Last dispatch of a pass, with [`blocks`] workgroups: takes each pair from half `pass.from` to its place in the other
/// one. `counts` is what a scan made of those that [`count_digits`] wrote.
#[inline]
pub fn scatter_pairs(
    group: Workgroup<GROUP_SIZE>,
    counters: &mut Counters,
    sums: &mut scan::Shared,
    staged: &mut Staged,
    pass: &SortPass,
    pairs: Pairs<'_>,
    counts: &[Word],
) {
    count_items(group, counters, pass, pairs.keys);
    scan_counters(group, counters, sums);
    let first_value = pass.limbs * BLOCK;
    phase!(group, |local| {
        let first = first_item(group, local);
        let mut i = 0;
        while i < ITEMS {
            let from = first + i;
            if from < pass.count {
                let rank = count_one(counters, digit_at(pass, pairs.keys, from), local);
                let mut limb = 0;
                while limb < pass.limbs {
                    let key = word(pairs.keys, key_index(pass, pass.from, limb, from)).get();
                    shared_put(staged, limb * BLOCK + rank, key);
                    limb += 1;
                }
                let value = word(pairs.values, pass.from * pass.count + from).get();
                shared_put(staged, first_value + rank, value);
            }
            i += 1;
        }
    });
    let half = 1 - pass.from;
    phase!(group, |local| {
        let mut i = 0;
        while i < ITEMS {
            let rank = i * GROUP_SIZE + local;
            if group.id * BLOCK + rank < pass.count {
                let digit = digit_of(pass, shared_at(staged, pass.shift / 32 * BLOCK + rank));
                let first = word(counts, digit * blocks(pass.count) + group.id).get();
                let to = first + rank - end_of_lower(counters, digit);
                let mut limb = 0;
                while limb < pass.limbs {
                    let key = shared_at(staged, limb * BLOCK + rank);
                    word(pairs.keys, key_index(pass, half, limb, to)).set(key);
                    limb += 1;
                }
                let value = shared_at(staged, first_value + rank);
                word(pairs.values, half * pass.count + to).set(value);
            }
            i += 1;
        }
    });
}

/// The counters of each invocation's own items.
#[inline]
fn count_items(group: Workgroup<GROUP_SIZE>, counters: &mut Counters, pass: &SortPass, keys: &[Word]) {
    phase!(group, |local| {
        let mut i = 0;
        while i < ROWS {
            shared_put(counters, i * GROUP_SIZE + local, 0);
            i += 1;
        }
        let first = first_item(group, local);
        let mut i = 0;
        while i < ITEMS {
            if first + i < pass.count {
                count_one(counters, digit_at(pass, keys, first + i), local);
            }
            i += 1;
        }
    });
}

/// Turns each counter into the sum of those in front of it, in the order of digits and within a digit of invocations.
#[inline]
fn scan_counters(group: Workgroup<GROUP_SIZE>, counters: &mut Counters, sums: &mut scan::Shared) {
    // As many consecutive words an invocation as there are rows.
    phase!(group, |local| {
        shared_put(sums, local, sum_words(counters, local * ROWS, 1, ROWS));
    });
    let end = scan_shared(group, sums);
    phase!(group, |local| {
        // All digits in the lower halves stand in front of all in the upper ones.
        let mut sum = shared_at(sums, end + GROUP_SIZE - 1) << 16;
        if local > 0 {
            sum += shared_at(sums, end + local - 1);
        }
        let mut i = local * ROWS;
        while i < (local + 1) * ROWS {
            let counter = shared_at(counters, i);
            shared_put(counters, i, sum);
            sum += counter;
            i += 1;
        }
    });
}

/// Adds 1 to an invocation's counter of a digit; returns what was there.
#[inline]
fn count_one(counters: &mut Counters, digit: u32, local: u32) -> u32 {
    let i = row(digit) * GROUP_SIZE + local;
    let old = shared_at(counters, i);
    shared_put(counters, i, old + (1 << (digit / ROWS * 16)));
    half_of(old, digit)
}

/// Where a block's pairs of the digits below `digit` end in its sorted order, once all its pairs have taken their ranks
/// from the scanned counters: what the last invocation's counter has grown to.
#[inline]
fn end_of_lower(counters: &Counters, digit: u32) -> u32 {
    if digit == 0 {
        return 0;
    }
    let lower = digit - 1;
    half_of(shared_at(counters, row(lower) * GROUP_SIZE + GROUP_SIZE - 1), lower)
}

/// The row of a digit's counters.
#[inline]
fn row(digit: u32) -> u32 {
    digit % ROWS
}

/// A digit's half of a word of counters.
#[inline]
fn half_of(counters: u32, digit: u32) -> u32 {
    (counters >> (digit / ROWS * 16)) & 0xffff
}

/// Sum of `count` words, each `step` from the one before.
#[inline]
fn sum_words(counters: &Counters, first: u32, step: u32, count: u32) -> u32 {
    let mut sum = 0;
    let mut i = 0;
    while i < count {
        sum += shared_at(counters, first + i * step);
        i += 1;
    }
    sum
}

/// The digit that a pass sorts by, of pair `i`.
#[inline]
fn digit_at(pass: &SortPass, keys: &[Word], i: u32) -> u32 {
    digit_of(pass, word(keys, key_index(pass, pass.from, pass.shift / 32, i)).get())
}

/// The digit that a pass sorts by, of the limb that has it.
#[inline]
fn digit_of(pass: &SortPass, limb: u32) -> u32 {
    (limb >> (pass.shift % 32)) % DIGITS
}

/// Where a limb of key `i` of a half stands.
#[inline]
fn key_index(pass: &SortPass, half: u32, limb: u32, i: u32) -> u32 {
    (half * pass.limbs + limb) * pass.count + i
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::pcg4d;
    use glam::UVec4;

    /// The dispatches of all passes, on this thread: keys and values of the result. Workgroups run from the last to the
    /// first, since their order must not matter; the half that is written first, the counts and shared memory hold
    /// rubbish before.
    fn sort(keys: &[u64], values: &[u32], bits: u32) -> (Vec<u64>, Vec<u32>) {
        const RUBBISH: u32 = 0xdead_beef;
        let count = values.len() as u32;
        let rubbish = |words: u32| (0..words).map(|_| Word::new(RUBBISH));
        let lower = keys.iter().map(|&key| Word::new(key as u32));
        let upper = keys.iter().map(|&key| Word::new((key >> 32) as u32));
        let upper = upper.take(if limbs(bits) == 2 { keys.len() } else { 0 });
        let key_words: Vec<Word> = lower.chain(upper).chain(rubbish(limbs(bits) * count)).collect();
        let value_words: Vec<Word> =
            values.iter().map(|&value| Word::new(value)).chain(rubbish(count)).collect();
        let counts: Vec<Word> = rubbish(count_words(count)).collect();
        let mut counters = [RUBBISH; (ROWS * GROUP_SIZE) as usize];
        let mut sums = [RUBBISH; 2 * GROUP_SIZE as usize];
        let mut staged = [RUBBISH; (3 * BLOCK) as usize];
        let pairs = Pairs { keys: &key_words, values: &value_words };
        for index in 0..passes(bits) {
            let pass = pass(count, bits, index);
            for id in (0..blocks(count)).rev() {
                count_digits(Workgroup::new(id), &mut counters, &pass, pairs.keys, &counts);
            }
            scan::scan_serially(Workgroup::new(0), &mut sums, &counts, count_words(count));
            for id in (0..blocks(count)).rev() {
                let group = Workgroup::new(id);
                scatter_pairs(group, &mut counters, &mut sums, &mut staged, &pass, pairs, &counts);
            }
        }
        let half = result_half(bits);
        let limb = |limb: u32, i: u32| -> u64 {
            if limb < limbs(bits) {
                word(&key_words, (half * limbs(bits) + limb) * count + i).get().into()
            } else {
                0
            }
        };
        let keys = (0..count).map(|i| limb(1, i) << 32 | limb(0, i)).collect();
        let values = (0..count).map(|i| word(&value_words, half * count + i).get()).collect();
        (keys, values)
    }

    /// Keys of `bits` bits in every order that a sort might stumble over.
    fn key_sets(count: u32, bits: u32) -> Vec<(&'static str, Vec<u64>)> {
        let mask = u64::MAX >> (64 - bits);
        let random = |i: u32| {
            let words = pcg4d(UVec4::new(i, count, bits, 0));
            (u64::from(words.x) << 32 | u64::from(words.y)) & mask
        };
        let unsorted: Vec<u64> = (0..count).map(random).collect();
        let mut sorted = unsorted.clone();
        sorted.sort_unstable();
        let reversed = sorted.iter().rev().copied().collect();
        // No more than two bits set, in one of five places from the lowest to the highest.
        let few = |i: u32| (random(i) % 4) << ((random(i) >> 2) % 5 * u64::from(bits - 1) / 4) & mask;
        let few = (0..count).map(few).collect();
        vec![
            ("random", unsorted),
            ("sorted", sorted),
            ("reversed", reversed),
            ("constant", vec![mask; count as usize]),
            ("few", few),
        ]
    }

    /// Equal to the standard library's stable sort: sorted, a permutation, and pairs of equal keys in their old order,
    /// which their values tell.
    fn check(count: u32, bits: u32) {
        for (name, keys) in key_sets(count, bits) {
            let values: Vec<u32> = (0..count).map(|i| i.wrapping_mul(0x9e37_79b1)).collect();
            let mut expected: Vec<(u64, u32)> = keys.iter().copied().zip(values.iter().copied()).collect();
            expected.sort_by_key(|pair| pair.0);
            let expected: (Vec<u64>, Vec<u32>) = expected.into_iter().unzip();
            assert!(sort(&keys, &values, bits) == expected, "{count} {name} keys of {bits} bits");
        }
    }

    #[test]
    fn pairs_are_sorted_and_equal_keys_keep_their_order() {
        // Around every boundary: of an invocation's items, of a round of a workgroup, of a block.
        for count in [0, 1, 2, 7, 8, 9, 127, 128, 129, 1023, 1024, 1025, 2047, 2048, 2049] {
            for bits in [1, 4, 5, 30, 32, 33, 63, 64] {
                check(count, bits);
            }
        }
    }

    #[test]
    fn sorts_where_the_counts_take_several_blocks() {
        // 64 blocks have as many counters as a scan has elements in a block.
        for count in [64 * BLOCK, 64 * BLOCK + 1, 129 * BLOCK - 1] {
            for bits in [30, 63] {
                check(count, bits);
            }
        }
    }
}
