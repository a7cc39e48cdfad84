//! How much work one submission gets.
//!
//! Drivers kill submissions that run too long (two seconds on Windows, ten on Linux), and a long one keeps the
//! desktop from drawing. None should take more than 50 ms where cutting achieves it at little cost: the pacer aims at
//! 20, so that a submission may be two and a half times as dear as expected.
//!
//! Cutting does not achieve it everywhere. A submission takes as long as its slowest item, however few items are beside
//! it: its *tail*. Each part of a cut one takes as long, so that on a device that runs 10^5 items side by side a pass
//! in thirty parts takes thirty times as long as in one. What cutting shortens is what comes on top: the *work*, in
//! proportion to the items. Two submissions of different sizes tell one from the other, and a submission gets as many
//! items as make [`TARGET_MS`] of work, or as much work as tail where that is longer: to cut further would more than
//! double what a pass takes. Where a window waits it is cut all the same.
//!
//! Items are taken to be alike wherever in the pass they stand. Those of a film are [made so](super::tiles::Parts).

/// What a submission's work should take, in milliseconds. Overhead is some 0.05 to 0.3 ms each: 1.5 % at most.
const TARGET_MS: f64 = 20.0;
/// The same where a window waits for submissions. Each picture that it shows waits for at most two, that which is under
/// way and the one whose turn is next: these are done within 50 ms where they take two and a half times as long as
/// expected.
const TARGET_MS_OF_WINDOW: f64 = 10.0;
/// The most that it should take where the tail is longer: with a tail of as much a submission stays well within what
/// drivers allow.
const MOST_MS: f64 = 250.0;
/// Items of the first submission: at 20 µs each, what a slow device takes for a thousand micro-triangles by brute
/// force, they are the target.
const FIRST_ITEMS: f64 = 1024.0;
/// The same where a window waits: at 100 µs each, what lavapipe takes on two cores for pixels full of relief, they are
/// 25 ms.
const FIRST_ITEMS_OF_WINDOW: f64 = 256.0;
/// Fewest items of a submission, a workgroup's worth.
const FEWEST_ITEMS: u32 = 64;
/// Largest growth from one submission to the next. A pass of half a million cheap items has three submissions by it,
/// each of which takes a tail; with a growth of 8 it had four.
const MOST_GROWTH: f64 = 64.0;
/// Largest shrinkage: one submission may be long by chance, or because it is the first one of all, which pays for what
/// drivers put off until then (code generation, clocks).
const MOST_SHRINKAGE: f64 = 4.0;
/// Submissions whose sizes differ by less do not tell work from tails.
const TELLING_FACTOR: f64 = 1.5;
/// By how much sizes are changed to find out: more, since parts of a pass are equal and of whole workgroups.
const TRIAL_FACTOR: f64 = 2.0;
/// What part of the usual size the first submission gets after a change that may make items as many times dearer.
const CAUTION: f64 = 4.0;

/// Decides how many items (pixels, rays) each submission of a pass gets, and learns from what they took.
#[derive(Clone, Debug)]
pub(super) struct Pacer {
    /// Whether a window waits for submissions.
    is_for_window: bool,
    /// How many items make the target, as far as is known.
    items: f64,
    /// What the last submission takes however few its items are, as far as is known.
    tail_ms: f64,
    /// Whether that was found out by two submissions.
    is_told: bool,
    /// The last submission.
    last: Option<Submission>,
    /// Items of the present pass that are left.
    left: u32,
}

/// What a submission took.
#[derive(Clone, Copy, Debug)]
struct Submission {
    items: f64,
    ms: f64,
}

impl Pacer {
    /// A pacer that knows nothing. `is_for_window`: whether a window waits for submissions.
    pub(super) fn new(is_for_window: bool) -> Self {
        let items = first_items(is_for_window);
        Pacer { is_for_window, items, tail_ms: 0.0, is_told: false, last: None, left: 0 }
    }

    /// The same, knowing nothing.
    pub(super) fn forgotten(&self) -> Self {
        Pacer::new(self.is_for_window)
    }

    /// Begins a pass over `total` items.
    pub(super) fn begin_pass(&mut self, total: u32) {
        self.left = total;
    }

    /// Takes note that items may be dearer than they were: what is seen has changed.
    pub(super) fn beware(&mut self) {
        self.items = (self.items / CAUTION).max(self.items.min(first_items(self.is_for_window)));
        self.last = None;
    }

    /// The most items that the next submission should get: equal parts of what is left, in whole workgroups, as
    /// submissions are. Parts that were not would be cut to whole ones, and what that leaves would be one more.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a part of a u32, and at least 1"
    )]
    pub(super) fn items(&self) -> u32 {
        let left = f64::from(self.left.div_ceil(FEWEST_ITEMS));
        let most = (self.items / f64::from(FEWEST_ITEMS)).floor().max(1.0);
        let parts = (left / most).ceil().max(1.0);
        ((left / parts).ceil() as u32).max(1).saturating_mul(FEWEST_ITEMS)
    }

    /// What the work of the next submission should take.
    fn wanted_ms(&self) -> f64 {
        if self.is_for_window { TARGET_MS_OF_WINDOW } else { self.tail_ms.clamp(TARGET_MS, MOST_MS) }
    }

    /// Takes note of what a submission of `items` items took.
    pub(super) fn record(&mut self, items: u32, ms: f64) {
        self.left = self.left.saturating_sub(items);
        let now = Submission { items: f64::from(items.max(1)), ms };
        let told = self.last.and_then(|last| now.work_against(last));
        // A shorter time of as many items says that the tail was shorter rather than that they take no work.
        let expected_ms = now.items * self.wanted_ms() / self.items;
        let work_ms = told.unwrap_or((ms - self.tail_ms).max(expected_ms / TRIAL_FACTOR)).clamp(0.0, ms);
        self.is_told |= told.is_some();
        self.tail_ms = ms - work_ms;
        self.last = Some(now);
        // A clock too coarse to see it gives 0 ms.
        let wanted = if work_ms > 0.0 { self.wanted_ms() / work_ms } else { f64::INFINITY };
        // As long as nothing is told the next submission is to tell it.
        let wanted = match (self.is_told, wanted < 1.0) {
            (true, _) => wanted,
            (false, true) => wanted.min(1.0 / TRIAL_FACTOR),
            (false, false) => wanted.max(TRIAL_FACTOR),
        };
        let least = (now.items / MOST_SHRINKAGE).max(f64::from(FEWEST_ITEMS));
        // A pass of few items does not unlearn what larger ones may have.
        let most = (now.items * MOST_GROWTH).max(self.items).max(least);
        self.items = (now.items * wanted).clamp(least, most);
    }
}

/// Items of the first submission.
fn first_items(is_for_window: bool) -> f64 {
    if is_for_window { FIRST_ITEMS_OF_WINDOW } else { FIRST_ITEMS }
}

impl Submission {
    /// How much of its time was work, by what another one before it took; `None` where that does not tell.
    fn work_against(self, before: Submission) -> Option<f64> {
        let grew = self.items > before.items;
        let (few, many) = if grew { (before, self) } else { (self, before) };
        // More items in less time tell nothing: the others were dearer, or paid for what drivers put off until then.
        let tells = many.items >= few.items * TELLING_FACTOR && many.ms >= few.ms;
        tells.then(|| (many.ms - few.ms) / (many.items - few.items) * self.items)
    }
}

#[cfg(test)]
mod tests;
