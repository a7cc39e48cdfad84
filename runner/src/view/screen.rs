//! What the window shows, and what is still to be done for that.

use std::time::{Duration, Instant};

/// Longer than this the window may not keep a user waiting.
pub(super) const PROMPT: Duration = Duration::from_millis(50);

/// How soon a picture that could not be shown is tried again.
pub(super) const RETRY: Duration = Duration::from_millis(5);

/// Of what size pictures are, and whether one is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Screen {
    /// Width and height of pictures, once they are known. It stays while none can be seen.
    pub(super) size: Option<(u32, u32)>,
    /// Whether none can be seen, as when the window is minimised.
    pub(super) is_hidden: bool,
    /// Since when there is something to show that is not under way.
    stale: Option<Instant>,
    /// The picture that is under way.
    under_way: Option<UnderWay>,
    /// Before when it is not tried again, where it could not be shown.
    retry: Option<Instant>,
}

/// A picture on its way to the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UnderWay {
    /// When what it shows was asked for first.
    pub(super) asked: Instant,
    /// Whether it shows the model.
    pub(super) is_of_model: bool,
}

impl Screen {
    pub(super) fn new() -> Screen {
        Screen { size: None, is_hidden: false, stale: None, under_way: None, retry: None }
    }

    /// The window takes pictures of another size, or none. Returns whether others are to be rendered: not for a window
    /// that comes back as it was.
    pub(super) fn takes(&mut self, size: Option<(u32, u32)>) -> bool {
        self.is_hidden = size.is_none();
        let is_other = size.is_some() && self.size != size;
        self.size = size.or(self.size);
        is_other
    }

    /// There is something to show that was not shown yet.
    pub(super) fn ask(&mut self, now: Instant) {
        self.stale.get_or_insert(now);
    }

    /// Whether the newest picture is on the screen.
    pub(super) fn is_up_to_date(&self) -> bool {
        self.stale.is_none() && self.under_way.is_none()
    }

    pub(super) fn is_busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// When a picture is to be shown, where one is. Of a hidden window the system says when it is seen again, and of a
    /// picture that is under way what shows it.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        let is_due = self.stale.is_some() && !self.is_hidden && !self.is_busy();
        is_due.then(|| self.retry.map_or(now, |retry| retry.max(now)))
    }

    /// A picture is handed over to be shown.
    pub(super) fn hand_over(&mut self, is_of_model: bool, now: Instant) {
        let asked = self.stale.take().unwrap_or(now);
        self.under_way = Some(UnderWay { asked, is_of_model });
    }

    /// It was shown; or it could not be, and is to be tried again. Returns what was shown.
    pub(super) fn arrived(&mut self, is_shown: bool, now: Instant) -> Option<UnderWay> {
        let arrived = self.under_way.take()?;
        self.retry = (!is_shown).then_some(now + RETRY);
        if !is_shown {
            self.stale = Some(arrived.asked);
        }
        is_shown.then_some(arrived)
    }
}

/// How long something took, again and again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Delays {
    pub(super) longest: Duration,
    /// How many took longer than [`PROMPT`].
    pub(super) late: u32,
    pub(super) count: u32,
}

impl Delays {
    pub(super) fn add(&mut self, took: Duration) {
        self.longest = self.longest.max(took);
        self.late += u32::from(took > PROMPT);
        self.count += 1;
    }
}

impl std::fmt::Display for Delays {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1} ms at most, {} of {} late", 1e3 * self.longest.as_secs_f64(), self.late, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neither is a minimised window redrawn again and again, nor are its samples lost.
    #[test]
    fn hidden_window_waits_and_comes_back_as_it_was() {
        let (mut screen, now) = (Screen::new(), Instant::now());
        screen.ask(now);
        assert!(screen.due(now) == Some(now) && screen.takes(Some((40, 30))));
        assert!(!screen.takes(None) && screen.due(now).is_none());
        assert!(!screen.takes(Some((40, 30))) && screen.due(now) == Some(now));
        assert!(screen.takes(Some((41, 30))));
    }

    /// It is late since it was asked for, not since it was tried again.
    #[test]
    fn what_could_not_be_shown_is_tried_again_later() {
        let (mut screen, now) = (Screen::new(), Instant::now());
        screen.ask(now);
        screen.hand_over(true, now + RETRY);
        assert_eq!(screen.arrived(false, now + RETRY), None);
        assert_eq!(screen.due(now), Some(now + 2 * RETRY));
        screen.hand_over(true, now + 2 * RETRY);
        assert_eq!(screen.arrived(true, now), Some(UnderWay { asked: now, is_of_model: true }));
        assert!(screen.due(now).is_none() && screen.is_up_to_date());
    }

    /// One after the other: what comes meanwhile is due when the first has arrived.
    #[test]
    fn one_picture_is_under_way_at_a_time() {
        let (mut screen, now) = (Screen::new(), Instant::now());
        screen.ask(now);
        screen.hand_over(false, now);
        screen.ask(now + RETRY);
        assert!(screen.due(now).is_none() && !screen.is_up_to_date());
        assert_eq!(screen.arrived(true, now), Some(UnderWay { asked: now, is_of_model: false }));
        assert_eq!(screen.due(now), Some(now));
        screen.hand_over(true, now);
        assert_eq!(screen.arrived(true, now).map(|arrived| arrived.asked), Some(now + RETRY));
    }
}
