//! How pictures get into the window.

mod software;
mod vulkan;

use super::canvas::Canvas;
use super::renderer::Start;
use super::{Engine, ViewError};
use crate::backend::BackendError;
use crate::backend::cpu::{self, CpuBackend};
use crate::backend::select::{BackendChoice, can_be_replaced, selection};
use crate::backend::vulkan::{Shown, Swapchain, VulkanBackend};
use software::Software;
use std::sync::Arc;
use winit::window::Window;

/// Shows pictures in a window.
pub(super) trait Presenter {
    /// Width and height that a picture should have now; `None` where the window shows none, as when it is minimised.
    fn size(&mut self) -> Result<Option<(u32, u32)>, PresentError>;

    /// Shows a picture of that size, or says that it is to be tried again.
    fn show(&mut self, canvas: &Canvas) -> Result<Shown, PresentError>;

    /// Makes anew what it has of the window's system, as where that is lost.
    fn renew(&mut self) -> Result<(), PresentError>;
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

/// Opens what shows pictures in `window`, and what renders them.
pub(super) fn open(
    window: &Arc<Window>,
    choice: BackendChoice,
    device: Option<&str>,
    validate: bool,
) -> Result<Opened, ViewError> {
    if choice == BackendChoice::Cpu {
        return on_cpu(window);
    }
    let for_surface: Arc<dyn crate::backend::vulkan::Window> = Arc::<Window>::clone(window);
    match Swapchain::open(for_surface, &selection(device), validate) {
        Ok((swapchain, opened)) => {
            let presenter = Box::new(vulkan::OnSwapchain { swapchain, window: Arc::clone(window) });
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
    let failed = |reason: softbuffer::SoftBufferError| ViewError::Window { reason: reason.to_string() };
    Ok(Opened {
        presenter: Box::new(Software::new(Arc::clone(window)).map_err(failed)?),
        start: Box::new(|| Ok(Box::new(CpuBackend::new()))),
        engine: Engine::CPU,
        device: cpu::device_info().name,
    })
}
