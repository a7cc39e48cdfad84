//! How much work one submission gets.
//!
//! Drivers kill submissions that run too long (two seconds on Windows, ten on Linux), and a long one keeps the
//! desktop from drawing. None should take more than 50 ms where cutting can achieve it: the pacer aims at 20, so
//! that a submission may be two and a half times as dear as expected.
//!
//! Cutting cannot achieve it everywhere. A submission takes as long as its slowest item, however few items are
//! beside it: such a *tail* is no reason to cut, and an item of more than 50 ms takes what it takes. Hence cost is
//! never modelled as time per item alone. The first pass over unknown work feels its way ([`FirstPass`]); each
//! later one is planned stretch by stretch from what the one before it took ([`Plan`]).

mod first_pass;
mod plan;

use first_pass::FirstPass;
use plan::{Plan, Stretch};

/// What a submission should take, in milliseconds. Overhead is some 0.05 to 0.3 ms each: 1.5 % at most.
const TARGET_MS: f64 = 20.0;
/// Share of a whole's time from which on a part of it is said to be bound by its tail: half the items of even work
/// take half the time, those with the slowest item all of it.
const TAIL_SHARE: f64 = 0.7;
/// The part of a whole that proves a tail of any length: other pixels can be dearer, but seldom as much dearer as a
/// quarter must be that takes [`TAIL_SHARE`] of the whole.
const TELLING_PART: f64 = 0.25;
/// Fewest items of a submission, a workgroup's worth.
const FEWEST_ITEMS: u32 = 64;
/// Half the items of the first submission of all: even at 10 µs each, what a brute-force search over a thousand
/// micro-triangles takes on a slow device, it stays under 50 ms.
const CAUTIOUS: u32 = 2048;
/// The same where a window waits for it. At 100 µs each, what lavapipe takes on two cores for pixels full of relief, it
/// takes half as long.
const CAUTIOUS_OF_WINDOW: u32 = 128;
/// How many times longer than they take submissions are said to take where the device shows pictures in a window. Each
/// of these waits for at most two submissions, that which is under way and the one whose turn is next: with halves of
/// what is aimed at, 10 ms, and of what is not to be exceeded, 25 ms, both are done within 50 ms.
const HASTE: f64 = 2.0;

/// Decides how many items (pixels, rays) each submission of a pass gets, and learns from what they took.
#[derive(Clone, Debug)]
pub(super) struct Pacer {
    /// Whether a window waits for submissions.
    is_for_window: bool,
    /// Items of this pass.
    total: u32,
    /// What the last complete pass took, in sweep order. Empty before.
    profile: Vec<Stretch>,
    /// What this pass took so far.
    measured: Vec<Stretch>,
    pace: Pace,
}

/// Where the sizes of this pass come from.
#[derive(Clone, Debug)]
enum Pace {
    Unknown(FirstPass),
    Planned(Plan),
}

impl Pacer {
    /// A pacer that knows nothing.
    pub(super) fn new(is_for_window: bool) -> Self {
        let pace = Pace::Unknown(FirstPass::new(0, 0));
        Pacer { is_for_window, total: 0, profile: Vec::new(), measured: Vec::new(), pace }
    }

    /// The same, knowing nothing.
    pub(super) fn forgotten(&self) -> Self {
        Pacer::new(self.is_for_window)
    }

    /// Begins a pass over `total` items. It is planned where a complete pass over as many was measured last; a pass
    /// that was broken off teaches nothing. For a window also passes over other numbers do: they are over the same
    /// picture with other numbers of pixels, whose first submissions would else run from cheap background into dear
    /// relief.
    pub(super) fn begin_pass(&mut self, total: u32) {
        let measured = std::mem::take(&mut self.measured);
        if plan::items_of(&measured) == u64::from(self.total) {
            self.profile = measured;
        }
        if self.is_for_window && self.total != total {
            self.profile = plan::scaled(&self.profile, total);
        }
        self.total = total;
        self.pace = if total > 0 && plan::items_of(&self.profile) == u64::from(total) {
            Pace::Planned(Plan::new(&self.profile))
        } else {
            let cautious = if self.is_for_window { CAUTIOUS_OF_WINDOW } else { CAUTIOUS };
            Pace::Unknown(FirstPass::new(total, cautious))
        };
    }

    /// The most items that the next submission should get, at least a workgroup's worth. It may get fewer, as
    /// rounding to whole tiles demands.
    pub(super) fn items(&self) -> u32 {
        let items = match &self.pace {
            Pace::Unknown(first_pass) => first_pass.items(),
            Pace::Planned(plan) => plan.next_items(),
        };
        items.max(FEWEST_ITEMS)
    }

    /// Takes note of what a submission of `items` items took.
    pub(super) fn record(&mut self, items: u32, ms: f64) {
        let ms = if self.is_for_window { HASTE * ms } else { ms };
        let bound = match &mut self.pace {
            Pace::Unknown(first_pass) => first_pass.record(items, ms),
            Pace::Planned(plan) => plan.record(items, ms),
        };
        self.measured.push(Stretch { items, ms, bound });
    }
}

#[cfg(test)]
mod tests;
