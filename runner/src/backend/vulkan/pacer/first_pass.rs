//! Pacing over work that nothing is known of.

use super::plan::Bound;
use super::{FEWEST_ITEMS, TAIL_SHARE, TARGET_MS, TELLING_PART};

/// No submission gets more than this part of the work (or the cautious size, where the part is smaller): cheap
/// background may be followed by a surface of a hundred times its cost.
const PARTS: u32 = 32;
/// Largest growth from one submission to the next.
const MOST_GROWTH: f64 = 2.0;
/// A submission that takes this many times what a larger one took is over dearer items: tails do not grow.
const DEARER: f64 = 1.2;

/// Adapts the size of submissions to the last one: growing from a small start, shrinking where it took too long,
/// but not for the sake of tails, which shrinking does not shorten.
#[derive(Clone, Debug)]
pub(super) struct FirstPass {
    /// How many items the next submission gets.
    items: f64,
    /// Upper limit of `items`.
    ceiling: f64,
    /// Items and milliseconds of the submission that took too long and since which sizes shrink, if they do.
    too_long: Option<(f64, f64)>,
    /// The longest tail seen in milliseconds: what submissions may take without being too large.
    tail_ms: f64,
    /// One long submission does not push the size below this: it may be a tail, or the first one of all, which pays for
    /// what drivers put off until then (code generation, clocks). If so few items again take too long, they are dear.
    cautious: f64,
}

impl FirstPass {
    /// The pace at the start of `total` items; the first submission has twice the `cautious` ones.
    pub(super) fn new(total: u32, cautious: u32) -> Self {
        let ceiling = f64::from((total / PARTS).max(cautious));
        let cautious = f64::from(cautious);
        FirstPass { items: (2.0 * cautious).min(ceiling), ceiling, too_long: None, tail_ms: 0.0, cautious }
    }

    /// How many items the next submission should get.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most the ceiling, which is a u32, and at least a workgroup"
    )]
    pub(super) fn items(&self) -> u32 {
        self.items as u32
    }

    /// Takes note of what a submission took, and says what bound it.
    pub(super) fn record(&mut self, items: u32, ms: f64) -> Bound {
        let items = f64::from(items.max(1));
        // A remainder at an edge is mostly overhead and says little of its items, unless it took long.
        if ms < TARGET_MS && items < self.items * 0.5 {
            return Bound::Unknown;
        }
        if ms <= TARGET_MS {
            self.items = self.grown(items, ms).min(self.ceiling);
            self.too_long = None;
            return Bound::Unknown;
        }
        if let Some(larger) = self.shrunk_in_vain(items, ms) {
            self.tail_ms = self.tail_ms.max(ms);
            self.items = larger.min(items * MOST_GROWTH);
            self.too_long = None;
        }
        if ms <= self.tail_ms / TAIL_SHARE {
            return Bound::Tail { proven_ms: ms };
        }
        if self.too_long.is_none_or(|(_, before_ms)| ms > before_ms * DEARER) {
            self.too_long = Some((items, ms));
        }
        self.items = self.shrunk(items, ms);
        Bound::Unknown
    }

    /// The size since which shrinking has hardly shortened submissions, if it has shrunk enough to tell.
    fn shrunk_in_vain(&self, items: f64, ms: f64) -> Option<f64> {
        let (larger, before_ms) = self.too_long?;
        let in_vain = ms >= TAIL_SHARE * before_ms && ms <= DEARER * before_ms;
        (in_vain && items <= TELLING_PART * larger).then_some(larger)
    }

    /// The next size after a submission that was not too long. A clock too coarse to see it gives 0 ms: then the
    /// growth is the largest.
    fn grown(&self, items: f64, ms: f64) -> f64 {
        let wanted = if ms > 0.0 { items * TARGET_MS / ms } else { f64::INFINITY };
        wanted.clamp(self.items, self.items * MOST_GROWTH)
    }

    /// The next size after a submission that was too long: in proportion.
    fn shrunk(&self, items: f64, ms: f64) -> f64 {
        let fewest = if items > self.cautious { self.cautious } else { f64::from(FEWEST_ITEMS) };
        (items * TARGET_MS / ms).max(fewest)
    }
}

#[cfg(test)]
mod tests {
    use super::super::CAUTIOUS;
    use super::*;

    #[test]
    fn the_start_is_small_and_growth_bounded() {
        let mut pass = FirstPass::new(u32::MAX, CAUTIOUS);
        assert_eq!(pass.items(), 2 * CAUTIOUS);
        pass.record(pass.items(), 0.0);
        assert_eq!(pass.items(), 4 * CAUTIOUS);
        pass.record(pass.items(), TARGET_MS / 1.5);
        assert_eq!(pass.items(), 6 * CAUTIOUS);
    }

    #[test]
    fn nothing_grows_beyond_its_part_of_the_work() {
        let mut pass = FirstPass::new(32 * 10_000, CAUTIOUS);
        for _ in 0..5 {
            pass.record(pass.items(), 0.1);
        }
        assert_eq!(pass.items(), 10_000);
    }

    #[test]
    fn one_long_submission_shrinks_to_the_cautious_size_at_most_and_two_further() {
        let mut pass = FirstPass::new(u32::MAX, CAUTIOUS);
        pass.record(pass.items(), 500.0);
        assert_eq!(pass.items(), CAUTIOUS);
        pass.record(pass.items(), 250.0);
        assert_eq!(pass.items(), 163, "2048 items of 250 ms, of which 20 are wanted");
        pass.record(pass.items(), 1e9);
        assert!(pass.items() >= FEWEST_ITEMS);
    }

    #[test]
    fn shrinking_in_vain_is_undone() {
        let mut pass = FirstPass { items: 15_000.0, ..FirstPass::new(32 * 15_000, CAUTIOUS) };
        assert_eq!(pass.record(15_000, 100.0), Bound::Unknown);
        assert_eq!(pass.items(), 3000);
        assert_eq!(pass.record(3000, 95.0), Bound::Tail { proven_ms: 95.0 });
        assert_eq!(pass.items(), 6000);
        // The tail is known now, and not taken for dear work; what takes longer is.
        assert_eq!(pass.record(6000, 100.0), Bound::Tail { proven_ms: 100.0 });
        assert_eq!(pass.items(), 6000);
        assert_eq!(pass.record(6000, 200.0), Bound::Unknown);
        assert_eq!(pass.items(), CAUTIOUS);
    }

    #[test]
    fn items_that_become_dearer_are_no_tail() {
        let mut pass = FirstPass { items: 15_000.0, ..FirstPass::new(32 * 15_000, CAUTIOUS) };
        assert_eq!(pass.record(15_000, 70.0), Bound::Unknown);
        // Dearer by more than a tail of 70 ms explains, and dearer by little while hardly fewer.
        assert_eq!(pass.record(3000, 100.0), Bound::Unknown);
        assert_eq!(pass.items(), CAUTIOUS);
        assert_eq!(pass.record(2048, 100.0), Bound::Unknown);
        assert_eq!(pass.items(), 409);
        // Compared with the dearer ones, not with the first: 60 ms are less than 70 % of theirs.
        assert_eq!(pass.record(409, 60.0), Bound::Unknown);
    }

    #[test]
    fn a_cheap_remainder_changes_nothing_but_a_dear_one_does() {
        let mut pass = FirstPass::new(u32::MAX, CAUTIOUS);
        pass.record(100, 0.05);
        assert_eq!(pass.items(), 2 * CAUTIOUS);
        pass.record(10, 100.0);
        assert!(pass.items() < 2 * CAUTIOUS);
    }
}
