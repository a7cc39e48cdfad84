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
    /// Whether the newest picture is to be shown.
    pub(super) is_stale: bool,
    /// Before when it is not tried again, where it could not be shown.
    pub(super) retry: Option<Instant>,
}

impl Screen {
    pub(super) fn new() -> Screen {
        Screen { size: None, is_hidden: false, is_stale: true, retry: None }
    }

    /// The window takes pictures of another size, or none. Returns whether others are to be rendered: not for a window
    /// that comes back as it was.
    pub(super) fn takes(&mut self, size: Option<(u32, u32)>) -> bool {
        self.is_hidden = size.is_none();
        let is_other = size.is_some() && self.size != size;
        self.size = size.or(self.size);
        is_other
    }

    /// When a picture is to be shown, where one is. Of a hidden window the system says when it is seen again.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        (self.is_stale && !self.is_hidden).then(|| self.retry.map_or(now, |retry| retry.max(now)))
    }

    /// The picture was shown, or could not be.
    pub(super) fn shown(&mut self, is_shown: bool, now: Instant) {
        self.is_stale = !is_shown;
        self.retry = (!is_shown).then_some(now + RETRY);
    }
}

/// How promptly the window answers: what its thread takes from an event until it can hear the next.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Answers {
    pub(super) longest: Duration,
    /// How many took longer than [`PROMPT`].
    pub(super) late: u32,
}

impl Answers {
    pub(super) fn add(&mut self, since: Instant) {
        let took = since.elapsed();
        self.longest = self.longest.max(took);
        self.late += u32::from(took > PROMPT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neither is a minimised window redrawn again and again, nor are its samples lost.
    #[test]
    fn hidden_window_waits_and_comes_back_as_it_was() {
        let (mut screen, now) = (Screen::new(), Instant::now());
        assert!(screen.due(now) == Some(now) && screen.takes(Some((40, 30))));
        assert!(!screen.takes(None) && screen.due(now).is_none());
        assert!(!screen.takes(Some((40, 30))) && screen.due(now) == Some(now));
        assert!(screen.takes(Some((41, 30))));
    }

    #[test]
    fn what_could_not_be_shown_is_tried_again_later() {
        let (mut screen, now) = (Screen::new(), Instant::now());
        screen.shown(false, now);
        assert_eq!(screen.due(now), Some(now + RETRY));
        screen.shown(true, now);
        assert_eq!(screen.due(now), None);
    }
}
