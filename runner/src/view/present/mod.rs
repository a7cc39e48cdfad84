//! How pictures get into the window.

mod software;
mod vulkan;

use super::canvas::Canvas;
use super::renderer::Start;
use super::{Engine, Options, ViewError};
use crate::backend::cpu::{self, CpuBackend};
use crate::backend::select::{BackendChoice, can_be_replaced, selection};
use crate::backend::vulkan::{Swapchain, VulkanBackend};
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
/// A swapchain of a device that is software would put each picture behind the submission under way, and have the
/// processor copy it three times: there the window's system takes pictures as they are. For tests swapchains may be
/// asked for nevertheless.
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
    match Swapchain::open(for_surface, &selection(device), validate) {
        Ok((swapchain, opened)) => {
            let presenter: Box<dyn Presenter> = if by_swapchain || opened.info().kind != DeviceKind::Software
            {
                Box::new(OnSwapchain::new(swapchain, Arc::clone(window), wake))
            } else {
                Box::new(software(window)?)
            };
            let device = Some(device.map_or_else(|| opened.selector().to_owned(), str::to_owned));
            Ok(Opened {
                presenter,
                engine: Engine { backend: BackendChoice::Vulkan, device },
                device: opened.info().name.clone(),
                start: Box::new(move || Ok(Box::new(VulkanBackend::on(opened)?))),
            })
        }
        Err(error) if is_replaceable(choice, device) && can_be_replaced(&error) => {
            tracing::info!("rendering on the CPU: {error}");
            on_cpu(window)
        }
        Err(error @ BackendError::NoValidation) => Err(error.into()),
        Err(source) => Err(ViewError::CannotPresent { source }),
    }
}

/// Whether the CPU may stand for what was asked for: not for a device that has a name.
pub(super) fn is_replaceable(choice: BackendChoice, device: Option<&str>) -> bool {
    choice == BackendChoice::Auto && device.is_none()
}

/// The same without Vulkan.
pub(super) fn on_cpu(window: &Arc<Window>) -> Result<Opened, ViewError> {
    Ok(Opened {
        presenter: Box::new(software(window)?),
        start: Box::new(|| Ok(Box::new(CpuBackend::new()))),
        engine: Engine::CPU,
        device: cpu::device_info().name,
    })
}

fn software(window: &Arc<Window>) -> Result<Software, ViewError> {
    Software::new(Arc::clone(window)).map_err(|reason| ViewError::Window { reason: reason.to_string() })
}
