//! The radix sort and the scan on lavapipe: bit for bit the CPU's, which for both is the standard library's.

use emboss::backend::vulkan::VulkanBackend;
use emboss::bvh::sort::sort_pairs;
use emboss_kernels::bvh::radix_sort::{limbs, result_half};
use emboss_kernels::parallel::Word;
use emboss_tests::{Numbers, finish, lavapipe};

/// Elements of a workgroup of scan and sort.
const BLOCK: usize = 1024;

/// The lower words of keys, then, where they have them, the upper ones.
fn split(keys: &[u64], bits: u32) -> Vec<u32> {
    let word = |key: u64, limb: u32| u32::try_from(key >> (32 * limb) & u64::from(u32::MAX)).unwrap();
    (0..limbs(bits)).flat_map(|limb| keys.iter().map(move |&key| word(key, limb))).collect()
}

/// The CPU's sort.
fn sort_on_cpu(keys: &[u32], values: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
    let two_halves =
        |words: &[u32]| -> Vec<Word> { words.iter().chain(words).map(|&word| Word::new(word)).collect() };
    let (key_words, value_words) = (two_halves(keys), two_halves(values));
    sort_pairs(&key_words, &value_words, values.len().try_into().unwrap(), bits);
    let result = |words: Vec<Word>, length: usize| {
        words
            .into_iter()
            .skip(result_half(bits) as usize * length)
            .take(length)
            .map(Word::into_inner)
            .collect()
    };
    (result(key_words, keys.len()), result(value_words, values.len()))
}

/// Fails unless keys of `bits` bits are sorted with values that tell where each stood.
fn check(backend: &mut VulkanBackend, name: &str, keys: &[u64], bits: u32) {
    let count = u32::try_from(keys.len()).unwrap();
    let values: Vec<u32> = (0..count).collect();
    let mut order = values.clone();
    order.sort_by_key(|&i| keys[i as usize]);
    let sorted: Vec<u64> = order.iter().map(|&i| keys[i as usize]).collect();
    let expected = (split(&sorted, bits), order);
    let unsorted = split(keys, bits);
    let what = format!("{count} {name} keys of {bits} bits");
    assert!(sort_on_cpu(&unsorted, &values, bits) == expected, "{what} on the CPU");
    assert!(backend.sort_pairs(&unsorted, &values, bits).unwrap() == expected, "{what} on the device");
}

#[test]
fn pairs_are_sorted_and_equal_keys_keep_their_order() {
    let mut backend = lavapipe();
    let mut numbers = Numbers::new(1);
    // Around every boundary: of an invocation's items, of a round of a workgroup, of a block.
    for count in [0, 1, 2, 7, 8, 9, 127, 128, 129, 1023, 1024, 1025, 2047, 2048, 2049] {
        for bits in [30, 32, 63, 64] {
            let random: Vec<u64> = (0..count).map(|_| numbers.bits() >> (64 - bits)).collect();
            check(&mut backend, "random", &random, bits);
        }
        for bits in [32, 63] {
            let mut sorted: Vec<u64> = (0..count).map(|_| numbers.bits() >> (64 - bits)).collect();
            sorted.sort_unstable();
            check(&mut backend, "sorted", &sorted, bits);
            let reversed: Vec<u64> = sorted.iter().rev().copied().collect();
            check(&mut backend, "reversed", &reversed, bits);
            check(&mut backend, "constant", &vec![u64::MAX >> (64 - bits); count], bits);
            // No more than two bits set, in one of three places.
            let mut few = || u64::from(numbers.below(4)) << (numbers.below(3) * (bits - 2) / 2);
            let few: Vec<u64> = (0..count).map(|_| few()).collect();
            check(&mut backend, "few", &few, bits);
        }
    }
    // 64 blocks have as many counts as a block has elements: counts of one block, of as many as one workgroup scans
    // alone, and of more.
    for count in [64 * BLOCK, 64 * BLOCK + 1, 256 * BLOCK, 256 * BLOCK + 1, 300_000] {
        for bits in [30, 63] {
            let random: Vec<u64> = (0..count).map(|_| numbers.bits() >> (64 - bits)).collect();
            check(&mut backend, "random", &random, bits);
        }
        let few: Vec<u64> = (0..count).map(|_| u64::from(numbers.below(3))).collect();
        check(&mut backend, "few", &few, 4);
    }
    finish(backend);
}

#[test]
fn each_element_becomes_the_sum_of_those_in_front() {
    let mut backend = lavapipe();
    let mut numbers = Numbers::new(3);
    // Around every boundary: of an invocation's elements, of a block, of what one workgroup scans alone, of a block of
    // sums.
    let counts =
        [0, 1, 2, 7, 8, 9, 127, 1023, 1024, 1025, 4 * BLOCK, 4 * BLOCK + 1, BLOCK * BLOCK, BLOCK * BLOCK + 1];
    for count in counts {
        // Of the whole range, so that sums wrap.
        let random: Vec<u32> = (0..count).map(|_| numbers.word()).collect();
        let add = |sum: &mut u32, value: &u32| Some(std::mem::replace(sum, sum.wrapping_add(*value)));
        for (name, values) in [("random", random), ("equal", vec![1; count])] {
            let expected: Vec<u32> = values.iter().scan(0, add).collect();
            assert!(backend.scan(&values).unwrap() == expected, "{count} {name} words");
        }
    }
    finish(backend);
}
