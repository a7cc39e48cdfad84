//! How the thread that renders is started, told what to do, and ended.

use super::{Report, Wanted, run};
use crate::backend::{Backend, BackendError};
use crate::picture::Destination;
use crate::render::RenderError;
use crate::view::{Engine, Failure, Loaded, Source, Unread, ViewError};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often a thread that waits for the scene looks whether it still has to.
const LOOK: Duration = Duration::from_millis(20);

/// What the other threads ask for.
#[derive(Default)]
pub(super) struct Orders {
    pub(super) wanted: Option<Wanted>,
    /// The scene, since its files have changed.
    pub(super) read: Option<Read>,
    pub(super) save: bool,
    pub(super) quit: bool,
}

/// A scene as it was read.
pub(super) struct Read {
    pub(super) loaded: Loaded,
    /// The tuned zero that it was read with.
    pub(super) zero: Option<f32>,
}

impl Read {
    /// Whether it would be another with this zero: texels that are no numbers are zeros.
    pub(super) fn is_other_with(&self, zero: Option<f32>) -> bool {
        zero != self.zero && self.loaded.scene.reliefs.iter().any(|relief| relief.map.replaced > 0)
    }
}

/// What all threads see.
#[derive(Default)]
pub(super) struct Shared {
    orders: Mutex<Orders>,
    arrived: Condvar,
    /// Whether something came that the pass under way is not for. Changed while the orders are locked.
    pub(super) is_interrupted: AtomicBool,
    is_quitting: AtomicBool,
    /// Whether no one sees anything, so that no sample is added.
    is_hidden: AtomicBool,
    /// The tuned zero that was wanted last.
    zero: Mutex<Option<f32>>,
}

impl Shared {
    pub(super) fn order(&self, interrupts: bool, change: impl FnOnce(&mut Orders)) {
        let mut orders = self.lock();
        change(&mut orders);
        if interrupts {
            self.is_interrupted.store(true, Ordering::Relaxed);
        }
        drop(orders);
        self.arrived.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn zero(&self) -> MutexGuard<'_, Option<f32>> {
        self.zero.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_quitting(&self) -> bool {
        self.is_quitting.load(Ordering::Relaxed)
    }

    /// What has come. Waits for something where `is_idle`, or where no one sees anything.
    pub(super) fn take(&self, is_idle: bool) -> Orders {
        let nothing = |orders: &mut Orders| {
            (is_idle || self.is_hidden.load(Ordering::Relaxed))
                && orders.wanted.is_none()
                && orders.read.is_none()
                && !orders.save
                && !orders.quit
        };
        let waited = self.arrived.wait_while(self.lock(), nothing);
        let mut orders = waited.unwrap_or_else(PoisonError::into_inner);
        self.is_interrupted.store(false, Ordering::Relaxed);
        std::mem::take(&mut *orders)
    }
}

/// The thread, as the window's thread has it.
pub(in crate::view) struct Handle {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// Makes a backend, on the thread that uses it.
pub(in crate::view) type Start = Box<dyn FnOnce() -> Result<Box<dyn Backend>, BackendError> + Send>;

/// What the thread is started with.
pub(in crate::view) struct Setup {
    pub(in crate::view) start: Start,
    pub(in crate::view) engine: Engine,
    /// Whether the CPU renders where that device cannot.
    pub(in crate::view) is_replaceable: bool,
    pub(in crate::view) source: Arc<dyn Source>,
    /// The scene, which is being read.
    pub(in crate::view) reading: Reading,
    /// After how many samples a picture is left as it is.
    pub(in crate::view) samples: u32,
    /// Where pictures are saved.
    pub(in crate::view) output: Destination,
    pub(in crate::view) report: Arc<dyn Fn(Report) + Send + Sync>,
}

/// A scene that another thread reads.
pub(in crate::view) struct Reading(Receiver<Result<Loaded, Unread>>);

impl Reading {
    /// Begins to read it as nobody has tuned it.
    pub(in crate::view) fn start(source: &Arc<dyn Source>) -> Reading {
        let (sender, receiver) = channel();
        let source = Arc::clone(source);
        std::thread::spawn(move || {
            // No one waits for it any more where the viewer has ended.
            let _ = sender.send(source.read(None));
        });
        Reading(receiver)
    }

    /// What was read; nothing where the viewer is to end before that.
    pub(super) fn wait(&self, shared: &Shared) -> Result<Option<Loaded>, Ended> {
        while !shared.is_quitting() {
            match self.0.recv_timeout(LOOK) {
                Ok(read) => return read.map(Some).map_err(|error| Ended::Refused(ViewError::Source(error))),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Ended::Lost(Failure::Defect { what: "reading the scene".to_owned() }));
                }
            }
        }
        Ok(None)
    }
}

/// Why the thread ends that was not told to.
pub(super) enum Ended {
    Refused(ViewError),
    Lost(Failure),
}

impl From<BackendError> for Ended {
    fn from(error: BackendError) -> Self {
        Ended::Lost(error.into())
    }
}

impl From<RenderError> for Ended {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Backend(error @ BackendError::DeviceLost { .. }) => error.into(),
            error => Ended::Refused(error.into()),
        }
    }
}

impl Handle {
    pub(in crate::view) fn start(setup: Setup) -> Handle {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            let report = Arc::clone(&setup.report);
            // Nothing of what it breaks off is used again.
            let ended = catch_unwind(AssertUnwindSafe(|| run(setup, &of_thread)));
            let ended = ended
                .unwrap_or_else(|panic| Err(Ended::Lost(Failure::Defect { what: said_by(panic.as_ref()) })));
            match ended {
                Ok(()) => {}
                Err(Ended::Refused(error)) => report(Report::Refused(Box::new(error))),
                Err(Ended::Lost(failure)) => report(Report::Lost(Box::new(failure))),
            }
        });
        Handle { shared, thread: Some(thread) }
    }

    pub(in crate::view) fn want(&self, wanted: Wanted) {
        *self.shared.zero() = wanted.tuning.zero;
        self.shared.order(true, |orders| orders.wanted = Some(wanted));
    }

    pub(in crate::view) fn save(&self) {
        self.shared.order(false, |orders| orders.save = true);
    }

    /// Says whether anyone sees anything.
    pub(in crate::view) fn hide(&self, is_hidden: bool) {
        self.shared.order(false, |_| self.shared.is_hidden.store(is_hidden, Ordering::Relaxed));
    }

    /// Has the thread end as soon as it can; dropping the handle waits for that.
    pub(in crate::view) fn quit(&self) {
        self.shared.is_quitting.store(true, Ordering::Relaxed);
        self.shared.order(true, |orders| orders.quit = true);
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.quit();
        // It catches its panics.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// What a panic said.
fn said_by(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic".to_owned())
}
