//! How much work one submission gets.
//!
//! Drivers kill submissions that run too long (two seconds on Windows, ten on Linux), and a long one keeps the
//! desktop from drawing. None should take more than 50 ms: the pacer aims at 20, so that a tile may be two and a
//! half times as dear as the measured ones before it.

/// What a submission should take, in milliseconds. Overhead is some 0.05 ms each: 0.3 %.
const TARGET_MS: f64 = 20.0;
/// Items (pixels, rays) of the first submission: even at 10 µs each, what a brute-force search over a thousand
/// micro-triangles takes on a slow device, it stays under 50 ms.
const FIRST_ITEMS: u32 = 4096;
/// Fewest items of a submission, a workgroup's worth.
const FEWEST_ITEMS: u32 = 64;
/// In the first pass over unknown work no submission gets more than this part of it: cheap background may be
/// followed by a surface of a hundred times its cost.
const FIRST_PASS_PARTS: u32 = 32;
/// Largest growth from one submission to the next.
const MOST_GROWTH: f64 = 2.0;
/// Largest shrinking: one stray measurement (a device that woke up) must not break the work into crumbs.
const MOST_SHRINKING: f64 = 16.0;

/// Adapts the number of items of a submission to what the last ones took.
#[derive(Clone, Debug)]
pub(super) struct Pacer {
    /// How many items the next submission gets.
    items: f64,
    /// Upper limit of `items` in this pass.
    ceiling: f64,
    /// Milliseconds per item of this pass's dearest submission so far.
    dearest_ms: f64,
    /// False until the first submission, which pays for what drivers put off until then: code generation, clocks.
    warm: bool,
}

impl Pacer {
    /// A pacer that knows nothing.
    pub(super) fn new() -> Self {
        Pacer { items: f64::from(FIRST_ITEMS), ceiling: 0.0, dearest_ms: 0.0, warm: false }
    }

    /// Begins a pass over `total` items. Where an earlier pass was measured, this one is expected to be no dearer
    /// anywhere than the other was at its dearest.
    pub(super) fn begin_pass(&mut self, total: u32) {
        if self.dearest_ms > 0.0 {
            self.ceiling = TARGET_MS / self.dearest_ms;
            self.items = self.ceiling;
        } else {
            self.ceiling = f64::from(total / FIRST_PASS_PARTS);
        }
        self.ceiling = self.ceiling.max(f64::from(FEWEST_ITEMS));
        self.items = self.items.min(self.ceiling);
        self.dearest_ms = 0.0;
    }

    /// How many items the next submission should get, at least a workgroup's worth.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the range of u32"
    )]
    pub(super) fn items(&self) -> u32 {
        self.items.clamp(f64::from(FEWEST_ITEMS), f64::from(u32::MAX)) as u32
    }

    /// Takes note of what a submission of `items` items took.
    pub(super) fn record(&mut self, items: u32, ms: f64) {
        let ms_per_item = ms / f64::from(items.max(1));
        // A remainder at an edge is mostly overhead and says little of its items, unless it took long.
        if ms < TARGET_MS && f64::from(items) < self.items * 0.5 {
            return;
        }
        if self.warm {
            self.dearest_ms = self.dearest_ms.max(ms_per_item);
        }
        self.warm = true;
        // A clock too coarse to see the submission gives 0: then the growth is the largest.
        let wanted = if ms_per_item > 0.0 { TARGET_MS / ms_per_item } else { f64::INFINITY };
        let bounded = wanted.clamp(self.items / MOST_SHRINKING, self.items * MOST_GROWTH);
        self.items = bounded.clamp(f64::from(FEWEST_ITEMS), self.ceiling);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets a pass over `total` items run on a device where item i takes `cost_ms(i)`; returns the longest
    /// submission in milliseconds and how many there were.
    fn run_pass(pacer: &mut Pacer, total: u32, cost_ms: impl Fn(u32) -> f64) -> (f64, usize) {
        pacer.begin_pass(total);
        let (mut done, mut longest, mut submissions) = (0, 0.0_f64, 0);
        while done < total {
            let items = pacer.items().min(total - done);
            let ms = 0.05 + (done..done + items).map(&cost_ms).sum::<f64>();
            pacer.record(items, ms);
            longest = longest.max(ms);
            submissions += 1;
            done += items;
        }
        (longest, submissions)
    }

    #[test]
    fn even_work_ends_in_submissions_of_the_target() {
        let mut pacer = Pacer::new();
        // 2 million pixels of 0.1 µs: 200 ms, ten submissions of 20 ms.
        let (longest, _) = run_pass(&mut pacer, 2_000_000, |_| 1e-4);
        assert!(longest < TARGET_MS * 1.1, "{longest} ms in the first pass");
        let (longest, submissions) = run_pass(&mut pacer, 2_000_000, |_| 1e-4);
        assert!(longest < TARGET_MS * 1.1, "{longest} ms");
        assert!((10..=12).contains(&submissions), "{submissions}");
    }

    #[test]
    fn a_hundred_times_dearer_half_stays_under_50_ms() {
        let mut pacer = Pacer::new();
        let cost_ms = |i| if i < 1_000_000 { 5e-6 } else { 5e-4 };
        for pass in 0..3 {
            let (longest, _) = run_pass(&mut pacer, 2_000_000, cost_ms);
            assert!(longest < 50.0, "pass {pass}: {longest} ms");
        }
    }

    #[test]
    fn dear_work_is_cut_to_the_target_in_the_first_pass() {
        let mut pacer = Pacer::new();
        // A slow device: 10 µs a pixel, so that the first 4096 take 41 ms.
        pacer.begin_pass(1_000_000);
        pacer.record(pacer.items(), f64::from(pacer.items()) * 1e-2);
        assert_eq!(pacer.items(), 2000);
    }

    #[test]
    fn fast_devices_soon_get_whole_pictures() {
        let mut pacer = Pacer::new();
        // A pass of 1 ms. The first one's small submissions are mostly overhead, which makes pixels look dear.
        assert!(run_pass(&mut pacer, 2_000_000, |_| 5e-7).1 >= 32);
        assert!(run_pass(&mut pacer, 2_000_000, |_| 5e-7).1 <= 2);
        assert_eq!(run_pass(&mut pacer, 2_000_000, |_| 5e-7).1, 1);
    }

    #[test]
    fn slow_first_submission_does_not_slow_the_second_pass() {
        let mut pacer = Pacer::new();
        pacer.begin_pass(1_000_000);
        pacer.record(pacer.items(), 100.0);
        for _ in 0..10 {
            pacer.record(pacer.items(), f64::from(pacer.items()) * 1e-6);
        }
        pacer.begin_pass(1_000_000);
        assert!(pacer.items() >= 1_000_000, "{}", pacer.items());
    }

    #[test]
    fn growth_and_shrinking_are_bounded() {
        let mut pacer = Pacer::new();
        pacer.begin_pass(u32::MAX);
        pacer.record(pacer.items(), 0.0);
        assert_eq!(pacer.items(), 2 * FIRST_ITEMS);
        pacer.record(pacer.items(), 1e9);
        assert_eq!(pacer.items(), 2 * FIRST_ITEMS / 16);
    }

    #[test]
    fn a_cheap_remainder_changes_nothing_but_a_dear_one_does() {
        let mut pacer = Pacer::new();
        pacer.begin_pass(u32::MAX);
        pacer.record(10, 0.05);
        assert_eq!(pacer.items(), FIRST_ITEMS);
        pacer.record(10, 100.0);
        assert!(pacer.items() < FIRST_ITEMS);
    }

    #[test]
    fn a_submission_never_falls_below_a_workgroup() {
        let mut pacer = Pacer::new();
        pacer.begin_pass(1);
        assert_eq!(pacer.items(), 64);
        for _ in 0..10 {
            pacer.record(pacer.items(), 1e9);
        }
        assert_eq!(pacer.items(), 64);
    }
}
