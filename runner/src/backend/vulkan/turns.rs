//! Whose turn it is.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A lock that those who wait get in the order in which they came. A mutex may give it again and again to the thread
/// that lets it go, while another waits: the renderer's submissions follow each other without a pause.
#[derive(Default)]
pub(super) struct Turns {
    numbers: Mutex<Numbers>,
    changed: Condvar,
}

#[derive(Default)]
struct Numbers {
    /// What the next one to come draws.
    next: u64,
    /// Whose turn it is.
    called: u64,
}

/// One's turn, until it is dropped.
pub(super) struct Turn<'a>(&'a Turns);

impl Turns {
    /// Waits until everyone who came before has had their turn.
    pub(super) fn take(&self) -> Turn<'_> {
        let mut numbers = self.lock();
        let own = numbers.next;
        numbers.next += 1;
        let waited = self.changed.wait_while(numbers, |numbers| numbers.called != own);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        Turn(self)
    }

    fn lock(&self) -> MutexGuard<'_, Numbers> {
        self.numbers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.lock().called += 1;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// Two threads that want it without a pause: neither has it twice while the other waits.
    #[test]
    fn who_came_first_goes_first() {
        let (turns, other) = (Turns::default(), AtomicU32::new(0));
        let held = turns.take();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let _turn = turns.take();
                other.store(1, Ordering::Relaxed);
            });
            while turns.lock().next < 2 {
                std::thread::yield_now();
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
            assert_eq!(other.load(Ordering::Relaxed), 0, "it is not the other's turn yet");
            drop(held);
            let _turn = turns.take();
            assert_eq!(other.load(Ordering::Relaxed), 1);
        });
    }
}
