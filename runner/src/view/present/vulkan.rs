//! By a swapchain of the device that renders, on a thread of its own: to present may be to wait for the device, and
//! a driver that presents by the host waits for all that the renderer has submitted.

use super::super::canvas::Canvas;
use super::{PresentError, Presenter, Progress};
use crate::backend::BackendError;
use crate::backend::vulkan::{Shown, Swapchain};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use winit::window::Window;

type Size = (u32, u32);

pub(super) struct OnSwapchain {
    window: Arc<Window>,
    /// `None` when it is to end.
    orders: Option<Sender<Order>>,
    outcomes: Receiver<Result<Outcome, BackendError>>,
    /// Of a size of the window: what its images have instead.
    decided: Option<(Size, Option<Size>)>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread is to do.
enum Order {
    /// Show a picture that was made for this size of the window.
    Show(Canvas, Size),
    Renew,
}

/// What became of a picture.
enum Outcome {
    Shown(Shown),
    /// With this size of the window pictures are to have another, or none can be seen.
    Size(Size, Option<Size>),
}

impl OnSwapchain {
    /// `wake` is called whenever there is an outcome.
    pub(super) fn new(swapchain: Swapchain, window: Arc<Window>, wake: impl Fn() + Send + 'static) -> Self {
        let (orders, to_do) = channel();
        let (sender, outcomes) = channel();
        let thread = std::thread::spawn(move || follow(swapchain, &to_do, &sender, &wake));
        OnSwapchain { window, orders: Some(orders), outcomes, decided: None, thread: Some(thread) }
    }

    fn window_size(&self) -> Size {
        let size = self.window.inner_size();
        (size.width, size.height)
    }

    fn order(&self, order: Order) -> Result<(), PresentError> {
        let sent = self.orders.as_ref().map(|orders| orders.send(order));
        let ended = || PresentError::Window("the thread that shows pictures has ended".to_owned());
        if matches!(sent, Some(Ok(()))) { Ok(()) } else { Err(ended()) }
    }
}

impl Presenter for OnSwapchain {
    fn size(&mut self) -> Result<Option<Size>, PresentError> {
        let size = self.window_size();
        Ok(match self.decided {
            Some((of, taken)) if of == size => taken,
            _ => (size.0 > 0 && size.1 > 0).then_some(size),
        })
    }

    fn show(&mut self, canvas: Canvas) -> Result<Progress, PresentError> {
        self.order(Order::Show(canvas, self.window_size()))?;
        Ok(Progress::UnderWay)
    }

    fn outcome(&mut self) -> Result<Option<Progress>, PresentError> {
        Ok(match self.outcomes.try_recv() {
            Err(_) => None,
            Ok(Err(error)) => return Err(PresentError::Backend(error)),
            Ok(Ok(Outcome::Shown(Shown::Yes))) => Some(Progress::Shown),
            Ok(Ok(Outcome::Shown(Shown::NotYet))) => Some(Progress::NotYet),
            Ok(Ok(Outcome::Size(of, taken))) => {
                // A window that takes none is about to have no size; when it has this one again it takes pictures.
                self.decided = taken.map(|_| (of, taken));
                Some(Progress::NotYet)
            }
        })
    }

    fn renew(&mut self) -> Result<(), PresentError> {
        self.order(Order::Renew)
    }
}

impl Drop for OnSwapchain {
    fn drop(&mut self) {
        self.orders = None;
        // A panic was said already.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Does what is ordered until nobody orders any more.
fn follow(
    mut swapchain: Swapchain,
    orders: &Receiver<Order>,
    outcomes: &Sender<Result<Outcome, BackendError>>,
    wake: &dyn Fn(),
) {
    for order in orders {
        match order {
            Order::Renew => swapchain.lose_surface(),
            Order::Show(canvas, of) => {
                // The window may be about to close.
                let _ = outcomes.send(show(&mut swapchain, &canvas, of));
                wake();
            }
        }
    }
}

fn show(swapchain: &mut Swapchain, canvas: &Canvas, of: Size) -> Result<Outcome, BackendError> {
    let (size, taken) = ((canvas.width, canvas.height), swapchain.size(of)?);
    if taken != Some(size) {
        return Ok(Outcome::Size(of, taken));
    }
    swapchain.show(size, &canvas.texels).map(Outcome::Shown)
}
