//! How pictures get into the window.

mod software;
mod vulkan;

use super::canvas::Canvas;
use super::renderer::Start;
use super::{Engine, Options, ViewError};
use crate::backend::cpu::{self, CpuBackend};
use crate::backend::select::{BackendChoice, can_be_replaced, selection};
use crate::backend::vulkan::{OpenDevice, VulkanBackend};
use crate::backend::{BackendError, DeviceKind};
use software::Software;
use std::sync::Arc;
use vulkan::OnSwapchain;
use winit::window::Window;

/// Shows pictures in a window, and lets the thread that has the window go on meanwhile: nothing here waits for a
/// device.
pub(super) trait Presenter {
    /// Width and height that a picture should have now; `None` where the window shows none, as when it is minimised.
    fn size(&mut self) -> Result<Option<(u32, u32)>, PresentError>;

    /// Shows a picture of that size. While one is under way there is to be no other.
    fn show(&mut self, canvas: Canvas) -> Result<Progress, PresentError>;

    /// What became of the picture that is under way, once that is known: the window's loop is woken then.
    fn outcome(&mut self) -> Result<Option<Progress>, PresentError>;

    /// Makes anew what it has of the window's system, as where that is lost.
    fn renew(&mut self) -> Result<(), PresentError>;
}

/// How far a picture has got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// It is on the screen, or on its way there.
    Shown,
    /// The window has changed its size, or it could not be shown so soon: to be tried again.
    NotYet,
    /// What becomes of it will be told.
    UnderWay,
}

/// Why a picture cannot be shown.
#[derive(Debug)]
pub(super) enum PresentError {
    Backend(BackendError),
    Window(String),
}

/// What a window is opened with.
pub(super) struct Opened {
    /// What shows pictures in it.
    pub(super) presenter: Box<dyn Presenter>,
    /// What renders them: a backend is made by the thread that uses it.
    pub(super) start: Start,
    /// By what names users know it.
    pub(super) engine: Engine,
    /// The device's own name.
    pub(super) device: String,
}

/// Opens what shows pictures in `window`, and what renders them. `wake` wakes the window's loop.
///
/// A device need not present to the window to render for it: where it does not, as a card without a screen whose window
/// is seen from elsewhere, the window's system takes pictures as they are. So it does where the device is software,
/// whose swapchain would put each picture behind the submission under way, and have the processor copy it three times.
/// For tests swapchains may be asked for nevertheless.
pub(super) fn open(
    window: &Arc<Window>,
    options: &Options,
    wake: impl Fn() + Send + 'static,
) -> Result<Opened, ViewError> {
    let &Options { backend: choice, ref device, validate, by_swapchain, .. } = options;
    let device = device.as_deref();
    if choice == BackendChoice::Cpu {
        return on_cpu(window);
    }
    let for_surface: Arc<dyn crate::backend::vulkan::Window> = Arc::<Window>::clone(window);
    let (opened, swapchain) = match OpenDevice::for_window(for_surface, &selection(device), validate) {
        Ok(opened) => opened,
        Err(error) if is_replaceable(choice, device) && can_be_replaced(&error) => {
            tracing::info!("rendering on the CPU: {error}");
            return on_cpu(window);
        }
        Err(source @ BackendError::NoDevice { .. }) => return Err(ViewError::NoDevice { source }),
        Err(error) => return Err(error.into()),
    };
    let wants_swapchain = by_swapchain || opened.info().kind != DeviceKind::Software;
    let presenter: Box<dyn Presenter> = match swapchain {
        Ok(swapchain) if wants_swapchain => Box::new(OnSwapchain::new(swapchain, Arc::clone(window), wake)),
        Err(error) if wants_swapchain => instead_of_swapchain(window, &error)?,
        _ => by_system(window)?,
    };
    let device = Some(device.map_or_else(|| opened.selector().to_owned(), str::to_owned));
    Ok(Opened {
        presenter,
        engine: Engine { backend: BackendChoice::Vulkan, device },
        device: opened.info().name.clone(),
        start: Box::new(move || Ok(Box::new(VulkanBackend::on(opened)?))),
    })
}

/// Whether the CPU may stand for what was asked for: not for a device that has a name.
pub(super) fn is_replaceable(choice: BackendChoice, device: Option<&str>) -> bool {
    choice == BackendChoice::Auto && device.is_none()
}

/// The same without Vulkan.
pub(super) fn on_cpu(window: &Arc<Window>) -> Result<Opened, ViewError> {
    Ok(Opened {
        presenter: by_system(window)?,
        start: Box::new(|| Ok(Box::new(CpuBackend::new()))),
        engine: Engine::CPU,
        device: cpu::device_info().name,
    })
}

/// What shows pictures where a swapchain does not, and says why.
pub(super) fn instead_of_swapchain(
    window: &Arc<Window>,
    error: &BackendError,
) -> Result<Box<dyn Presenter>, ViewError> {
    tracing::info!("pictures are shown by the window's system: {error}");
    by_system(window)
}

fn by_system(window: &Arc<Window>) -> Result<Box<dyn Presenter>, ViewError> {
    let opened = Software::new(Arc::clone(window));
    Ok(Box::new(opened.map_err(|reason| ViewError::Window { reason: reason.to_string() })?))
}
