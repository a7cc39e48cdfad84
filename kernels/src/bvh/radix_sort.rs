//! Stable sort of pairs of a key and a value by key: least significant digit first, eight bits a pass.
//!
//! A pass is that of Satish, Harris and Garland ("Designing Efficient Sorting Algorithms for Manycore GPUs", 2009):
//! [`count_digits`] counts each block's digits, a [`scan`] of the counts, digit by digit and within a digit block by
//! block, says where each block's pairs of each digit go, and [`scatter_pairs`] takes them there. It sorts a
//! block in shared memory first, by half a digit at a time, so that neighbours in a workgroup write neighbours in
//! memory.
//!
//! Keys and values stand in two halves of their buffers, between which the passes go back and forth. A key of more than
//! 32 bits has two *limbs*, the lower first, each in an array of its own: limb l of half h begins at word
//! `(h * limbs + l) * count`. The values of half h begin at word `h * count`.

use super::scan::{self, BLOCK, GROUP_SIZE, ITEMS, blocks, scan_shared};
use crate::interface::SortPass;
use crate::parallel::{Word, Workgroup, phase, shared_add, shared_at, shared_put, word};

/// Bits of a digit. A pass of eight takes about as long as one of four: what it waits for is memory and barriers
/// between dispatches.
const DIGIT_BITS: u32 = 8;
/// How many values a digit has.
const DIGITS: u32 = 1 << DIGIT_BITS;
/// Bits of half a digit.
const NIBBLE_BITS: u32 = DIGIT_BITS / 2;
/// How many values half a digit has.
const NIBBLES: u32 = 1 << NIBBLE_BITS;

/// Rows of counters: each word holds two, of the nibbles `row` and `row + ROWS`. A block has 1024 pairs, so
/// that no count and no sum of counts of a block leaves its 16 bits.
const ROWS: u32 = NIBBLES / 2;

/// Shared memory of [`count_digits`]: how often each digit occurs.
pub type Histogram = [u32; DIGITS as usize];
/// Shared memory of [`scatter_pairs`]: eight rows of one word for each invocation, two counters in each word; then, for
/// each digit, where its pairs begin in the sorted block.
pub type Counters = [u32; (ROWS * GROUP_SIZE) as usize];
const _: () = assert!(DIGITS <= ROWS * GROUP_SIZE);
/// Shared memory of [`scatter_pairs`]: a block's entries in two orders, between which sorting by nibbles goes back and
/// forth. An entry is the number of a pair in the block and, above it, its digit.
pub type Entries = [u32; 2 * BLOCK as usize];
const PLACE_BITS: u32 = BLOCK.trailing_zeros();
const _: () = assert!(BLOCK.is_power_of_two());

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
    histogram: &mut Histogram,
    pass: &SortPass,
    keys: &[Word],
    counts: &[Word],
) {
    phase!(group, |local| {
        let mut digit = local;
        while digit < DIGITS {
            shared_put(histogram, digit, 0);
            digit += GROUP_SIZE;
        }
    });
    phase!(group, |local| {
        let mut i = 0;
        while i < ITEMS {
            let from = group.id * BLOCK + i * GROUP_SIZE + local;
            if from < pass.count {
                shared_add(histogram, digit_at(pass, keys, from), 1);
            }
            i += 1;
        }
    });
    phase!(group, |local| {
        let mut digit = local;
        while digit < DIGITS {
            word(counts, digit * blocks(pass.count) + group.id).set(shared_at(histogram, digit));
            digit += GROUP_SIZE;
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
    entries: &mut Entries,
    pass: &SortPass,
    pairs: Pairs<'_>,
    counts: &[Word],
) {
    phase!(group, |local| {
        let mut i = 0;
        while i < ITEMS {
            let place = i * GROUP_SIZE + local;
            let from = group.id * BLOCK + place;
            // Behind the last pair are entries of the greatest digit, which stay behind it.
            let digit = if from < pass.count { digit_at(pass, pairs.keys, from) } else { DIGITS - 1 };
            shared_put(entries, place, digit << PLACE_BITS | place);
            i += 1;
        }
    });
    let mut nibble = 0;
    while nibble < 2 {
        count_nibbles(group, counters, entries, nibble);
        scan_counters(group, counters, sums);
        phase!(group, |local| {
            let mut i = local * ITEMS;
            while i < (local + 1) * ITEMS {
                let entry = shared_at(entries, nibble * BLOCK + i);
                let rank = count_one(counters, nibble_of(entry, nibble), local);
                shared_put(entries, (1 - nibble) * BLOCK + rank, entry);
                i += 1;
            }
        });
        nibble += 1;
    }
    phase!(group, |local| {
        let mut i = 0;
        while i < ITEMS {
            let rank = i * GROUP_SIZE + local;
            let digit = shared_at(entries, rank) >> PLACE_BITS;
            if rank == 0 || shared_at(entries, rank - 1) >> PLACE_BITS != digit {
                shared_put(counters, digit, rank);
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
                let entry = shared_at(entries, rank);
                let digit = entry >> PLACE_BITS;
                let from = group.id * BLOCK + entry % BLOCK;
                let first = word(counts, digit * blocks(pass.count) + group.id).get();
                let to = first + rank - shared_at(counters, digit);
                let mut limb = 0;
                while limb < pass.limbs {
                    let key = word(pairs.keys, key_index(pass, pass.from, limb, from)).get();
                    word(pairs.keys, key_index(pass, half, limb, to)).set(key);
                    limb += 1;
                }
                let value = word(pairs.values, pass.from * pass.count + from).get();
                word(pairs.values, half * pass.count + to).set(value);
            }
            i += 1;
        }
    });
}

/// The counters of each invocation's own entries, [`ITEMS`] consecutive ones of order number `nibble`.
#[inline]
fn count_nibbles(group: Workgroup<GROUP_SIZE>, counters: &mut Counters, entries: &Entries, nibble: u32) {
    phase!(group, |local| {
        let mut i = 0;
        while i < ROWS {
            shared_put(counters, i * GROUP_SIZE + local, 0);
            i += 1;
        }
        let mut i = local * ITEMS;
        while i < (local + 1) * ITEMS {
            count_one(counters, nibble_of(shared_at(entries, nibble * BLOCK + i), nibble), local);
            i += 1;
        }
    });
}

/// Turns each counter into the sum of those in front of it, in the order of nibbles and within a nibble of invocations.
#[inline]
fn scan_counters(group: Workgroup<GROUP_SIZE>, counters: &mut Counters, sums: &mut scan::Shared) {
    // As many consecutive words an invocation as there are rows.
    phase!(group, |local| {
        let mut sum = 0;
        let mut i = local * ROWS;
        while i < (local + 1) * ROWS {
            sum += shared_at(counters, i);
            i += 1;
        }
        shared_put(sums, local, sum);
    });
    let end = scan_shared(group, sums);
    phase!(group, |local| {
        // All nibbles in the lower halves stand in front of all in the upper ones.
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

/// Adds 1 to an invocation's counter of a nibble; returns what was there.
#[inline]
fn count_one(counters: &mut Counters, nibble: u32, local: u32) -> u32 {
    let i = nibble % ROWS * GROUP_SIZE + local;
    let shift = nibble / ROWS * 16;
    let old = shared_at(counters, i);
    shared_put(counters, i, old + (1 << shift));
    old >> shift & 0xffff
}

/// The lower (0) or upper (1) half of an entry's digit.
#[inline]
fn nibble_of(entry: u32, nibble: u32) -> u32 {
    entry >> (PLACE_BITS + nibble * NIBBLE_BITS) & (NIBBLES - 1)
}

/// The digit that a pass sorts by, of pair `i`.
#[inline]
fn digit_at(pass: &SortPass, keys: &[Word], i: u32) -> u32 {
    let limb = word(keys, key_index(pass, pass.from, pass.shift / 32, i)).get();
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
        let mut histogram: Histogram = [RUBBISH; _];
        let mut counters: Counters = [RUBBISH; _];
        let mut sums: scan::Shared = [RUBBISH; _];
        let mut entries: Entries = [RUBBISH; _];
        let pairs = Pairs { keys: &key_words, values: &value_words };
        for index in 0..passes(bits) {
            let pass = pass(count, bits, index);
            for id in (0..blocks(count)).rev() {
                count_digits(Workgroup::new(id), &mut histogram, &pass, pairs.keys, &counts);
            }
            scan::scan_serially(Workgroup::new(0), &mut sums, &counts, count_words(count));
            for id in (0..blocks(count)).rev() {
                let group = Workgroup::new(id);
                scatter_pairs(group, &mut counters, &mut sums, &mut entries, &pass, pairs, &counts);
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
            for bits in [1, 4, 8, 9, 30, 32, 33, 63, 64] {
                check(count, bits);
            }
        }
    }

    #[test]
    fn sorts_where_the_counts_take_several_blocks() {
        // 4 blocks have as many counters as a scan has elements in a block.
        for count in [4 * BLOCK, 4 * BLOCK + 1, 9 * BLOCK - 1, 129 * BLOCK - 1] {
            for bits in [30, 63] {
                check(count, bits);
            }
        }
    }
}
