//! Pacing by what the last pass took, stretch by stretch.

use super::{FEWEST_ITEMS, TAIL_SHARE, TARGET_MS, TELLING_PART};
use std::collections::VecDeque;

/// What a submission may be expected to take while it is not known whether its time is work or tail: a fifth less
/// than the 50 ms that none should exceed.
const TRIAL_MS: f64 = 40.0;
/// How much longer than its tail a submission may become by taking cheap neighbours along.
const TAIL_COMPANY: f64 = 1.25;
/// Measurements within this factor of an expectation confirm it; passes differ by their random samples and by the
/// device's clock.
const NOISE: f64 = 1.5;
/// Expectations for work and for tails that differ by less than this factor cannot be told apart.
const TELLING_FACTOR: f64 = 1.3;
/// Most that one measurement can raise the expectations for the next submission.
const MOST_DRIFT: f64 = 16.0;
/// Shorter submissions are mostly overhead, and exceeding less than this says nothing of the device.
const TELLING_MS: f64 = 1.0;

/// What decides how long a stretch takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Bound {
    /// Not known.
    Unknown,
    /// The number of its items: half of them take half the time, and neighbours' times add up.
    Work,
    /// Its slowest item: cutting is in vain, and neighbours run alongside.
    Tail {
        /// What it took in milliseconds when that was found.
        proven_ms: f64,
    },
}

/// Successive items that were one submission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    /// How many.
    pub(super) items: u32,
    /// What they took, in milliseconds.
    pub(super) ms: f64,
    /// Why so long.
    pub(super) bound: Bound,
}

/// Number of items in a profile.
pub(super) fn items_of(profile: &[Stretch]) -> u64 {
    profile.iter().map(|stretch| u64::from(stretch.items)).sum()
}

/// What a pass over `total` items would be if its parts were as dear as those of a profile: the same picture with other
/// numbers of pixels. Empty where that is.
pub(super) fn scaled(profile: &[Stretch], total: u32) -> Vec<Stretch> {
    let all = items_of(profile);
    let (mut stretches, mut before, mut done, mut ms) = (Vec::new(), 0, 0, 0.0);
    for stretch in profile {
        before += u64::from(stretch.items);
        // At most `total`.
        let end = u32::try_from(before * u64::from(total) / all.max(1)).unwrap_or(total);
        ms += stretch.ms * f64::from(total) / all as f64;
        if end > done {
            let bound = if stretch.bound == Bound::Work { Bound::Work } else { Bound::Unknown };
            stretches.push(Stretch { items: end - done, ms, bound });
            (done, ms) = (end, 0.0);
        }
    }
    stretches
}

/// Cuts a pass by the profile of the one before it.
///
/// Stretches are joined while the sum of their times is within the target, and beyond it where tails are known to
/// overlap or, two at a time, where nobody tried; dear ones are cut, unless that was found to be in vain. What comes
/// of it is the next profile. So passes approach few submissions of the target's length, and of tails.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// What is left to do of the last pass's stretches, in sweep order.
    ahead: VecDeque<Ahead>,
    /// How many times dearer than expected the last submission was, 1 if it was as expected: the next one's
    /// expectation is raised so. A tail that appears somewhere thus costs one small submission.
    drift: f64,
}

/// The rest of a stretch.
#[derive(Clone, Copy, Debug)]
struct Ahead {
    whole: Stretch,
    left: u32,
}

/// Stretches that are about to become one submission.
#[derive(Clone, Copy, Debug)]
struct Joined {
    count: u32,
    items: u32,
    /// Sum of their times.
    ms: f64,
    /// The longest of them.
    longest_ms: f64,
    /// What bounds the longest.
    bound: Bound,
}

/// What a submission was to take.
#[derive(Clone, Copy, Debug)]
struct Expected {
    /// If times are work: each stretch's by the share of its items.
    work_ms: f64,
    /// If times are tails: the longest of the stretches, though but a part of it is done.
    tail_ms: f64,
    /// What is known of the longest stretch.
    bound: Bound,
}

impl Plan {
    /// A plan after `profile`.
    pub(super) fn new(profile: &[Stretch]) -> Self {
        let ahead = |&whole: &Stretch| Ahead { whole, left: whole.items };
        Plan { ahead: profile.iter().map(ahead).collect(), drift: 1.0 }
    }

    /// How many items the next submission should get; 0 when none are left.
    pub(super) fn next_items(&self) -> u32 {
        let Some(first) = self.ahead.front() else { return 0 };
        let part = self.part_items(&first.whole);
        if part < first.left {
            return part;
        }
        let mut joined = Joined::new(first);
        for next in self.ahead.iter().skip(1) {
            if !self.may_join(&joined, next) {
                break;
            }
            joined.add(next);
        }
        joined.items
    }

    /// Takes note of what a submission took, and says what bound it.
    pub(super) fn record(&mut self, items: u32, ms: f64) -> Bound {
        let within_one = self.ahead.front().is_some_and(|first| items < first.left);
        let expected = self.take(items).times(self.drift);
        let bound = expected.judge(ms);
        if let (true, Some(rest)) = (within_one, self.ahead.front_mut()) {
            rest.whole.bound = bound;
        }
        self.drift = self.drift_after(expected, ms);
        bound
    }

    /// Items of the equal parts that a stretch should be cut into; all of them where it should not.
    fn part_items(&self, whole: &Stretch) -> u32 {
        let ms = whole.ms * self.drift;
        let parts = if ms <= TARGET_MS {
            1.0
        } else if self.drift > 1.0 {
            (ms / TARGET_MS).ceil()
        } else {
            match whole.bound {
                Bound::Tail { .. } => 1.0,
                // Few parts, for it may be a tail: cutting a 200 ms one costs 1 ms of overhead, once.
                Bound::Unknown if ms <= TRIAL_MS => 2.0,
                Bound::Unknown => (ms / TRIAL_MS).ceil().max(1.0 / TELLING_PART),
                Bound::Work => (ms / TARGET_MS).ceil(),
            }
        };
        part(whole.items, parts).max(FEWEST_ITEMS)
    }

    /// Whether a submission may take the next stretch along.
    fn may_join(&self, joined: &Joined, next: &Ahead) -> bool {
        if self.part_items(&next.whole) < next.left {
            return false;
        }
        let sum = joined.ms + next.ms();
        let (longest_ms, bound) = joined.longest_with(next);
        let fits = sum * self.drift <= TARGET_MS;
        let is_company = matches!(bound, Bound::Tail { .. }) && sum <= longest_ms * TAIL_COMPANY;
        fits || self.drift <= 1.0 && (is_company || joined.may_try(next))
    }

    /// Takes items off the front, and says what they should take.
    fn take(&mut self, mut items: u32) -> Expected {
        let mut expected = Expected { work_ms: 0.0, tail_ms: 0.0, bound: Bound::Unknown };
        while items > 0
            && let Some(first) = self.ahead.front_mut()
        {
            let taken = items.min(first.left);
            expected.add(&first.whole, taken);
            first.left -= taken;
            items -= taken;
            if first.left == 0 {
                self.ahead.pop_front();
            }
        }
        expected
    }

    /// How many times dearer than it should have been a submission was, 1 if that is noise.
    fn drift_after(&self, expected: Expected, ms: f64) -> f64 {
        // Where a cut because of drift takes what it should, the drift is real: it is not over.
        let undrifted_ms =
            if self.drift > 1.0 { expected.work_ms / self.drift } else { expected.longest_ms() };
        let ratio = ms / undrifted_ms.max(TELLING_MS);
        if ratio < NOISE { 1.0 } else { ratio.min(MOST_DRIFT) }
    }
}

impl Ahead {
    /// What the rest should take: its share of the whole.
    fn ms(&self) -> f64 {
        self.whole.share_ms(self.left)
    }
}

impl Stretch {
    /// What `items` of its items take if they are all alike.
    fn share_ms(&self, items: u32) -> f64 {
        self.ms * f64::from(items) / f64::from(self.items.max(1))
    }
}

impl Joined {
    fn new(first: &Ahead) -> Self {
        let ms = first.ms();
        Joined { count: 1, items: first.left, ms, longest_ms: ms, bound: first.whole.bound }
    }

    fn add(&mut self, next: &Ahead) {
        (self.longest_ms, self.bound) = self.longest_with(next);
        self.count += 1;
        self.items = self.items.saturating_add(next.left);
        self.ms += next.ms();
    }

    /// Milliseconds and bound of the longest, `next` among them.
    fn longest_with(&self, next: &Ahead) -> (f64, Bound) {
        if next.ms() > self.longest_ms {
            (next.ms(), next.whole.bound)
        } else {
            (self.longest_ms, self.bound)
        }
    }

    /// Whether to find out if the times of a pair overlap. Only of a pair, and not where they are known to add up.
    fn may_try(&self, next: &Ahead) -> bool {
        let limit_ms = match (self.bound, next.whole.bound) {
            (Bound::Work, _) | (_, Bound::Work) => return false,
            (Bound::Tail { .. }, Bound::Tail { .. }) => {
                TRIAL_MS.max(2.0 * self.longest_ms).max(2.0 * next.ms())
            }
            _ => TRIAL_MS,
        };
        self.count == 1 && self.ms + next.ms() <= limit_ms
    }
}

impl Expected {
    fn add(&mut self, whole: &Stretch, items: u32) {
        self.work_ms += whole.share_ms(items);
        if whole.ms >= self.tail_ms {
            (self.tail_ms, self.bound) = (whole.ms, whole.bound);
        }
    }

    /// The same on a device that is `drift` times slower.
    fn times(self, drift: f64) -> Self {
        Expected { work_ms: self.work_ms * drift, tail_ms: self.tail_ms * drift, ..self }
    }

    fn longest_ms(&self) -> f64 {
        self.work_ms.max(self.tail_ms)
    }

    fn shortest_ms(&self) -> f64 {
        self.work_ms.min(self.tail_ms)
    }

    /// What bounds a submission that took `ms`.
    fn judge(&self, ms: f64) -> Bound {
        let (shortest, longest) = (self.shortest_ms(), self.longest_ms());
        if ms > longest * NOISE || ms * NOISE < shortest {
            return Bound::Unknown;
        }
        if longest < shortest * TELLING_FACTOR {
            return self.bound.confirmed(ms);
        }
        if self.work_ms < self.tail_ms { self.judge_part(ms) } else { self.judge_joined(ms) }
    }

    /// What bounds a part of a stretch. A long time is called a tail only on good evidence: such stretches are not
    /// cut.
    fn judge_part(&self, ms: f64) -> Bound {
        if ms < TAIL_SHARE * self.tail_ms {
            Bound::Work
        } else if ms <= TRIAL_MS || self.work_ms <= TELLING_PART * self.tail_ms * TELLING_FACTOR {
            Bound::Tail { proven_ms: ms }
        } else {
            Bound::Unknown
        }
    }

    /// What bounds stretches that were joined: whether the time is nearer to their longest or to their sum.
    fn judge_joined(&self, ms: f64) -> Bound {
        if ms - self.tail_ms < self.work_ms - ms { Bound::Tail { proven_ms: ms } } else { Bound::Work }
    }
}

impl Bound {
    /// What stays known of a stretch that now took `ms`. Tails that were short when they were found say nothing of
    /// longer times, even if these come little by little.
    fn confirmed(self, ms: f64) -> Bound {
        match self {
            Bound::Tail { proven_ms } if ms > proven_ms * NOISE => Bound::Unknown,
            bound => bound,
        }
    }
}

/// One of `parts` equal parts of `items`, rounded up.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a part of a u32, at least 1 part"
)]
fn part(items: u32, parts: f64) -> u32 {
    (f64::from(items) / parts).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_tails_take_more_proof_than_short_ones() {
        let part =
            |share: f64, tail_ms| Expected { work_ms: share * tail_ms, tail_ms, bound: Bound::Unknown };
        // A half that takes most of the whole: enough to leave 25 ms alone, not 60.
        assert_eq!(part(0.5, 30.0).judge(25.0), Bound::Tail { proven_ms: 25.0 });
        assert_eq!(part(0.5, 70.0).judge(60.0), Bound::Unknown);
        assert_eq!(part(0.25, 70.0).judge(60.0), Bound::Tail { proven_ms: 60.0 });
        assert_eq!(part(0.25, 70.0).judge(40.0), Bound::Work);
    }
}
