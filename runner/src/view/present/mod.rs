//! How pictures get into the window.

mod software;
mod vulkan;

use super::ViewError;
use super::canvas::Canvas;
use crate::backend::cpu::{self, CpuBackend};
use crate::backend::select::{BackendChoice, can_be_replaced, selection};
use crate::backend::vulkan::{OpenDevice, Shown, Swapchain, VulkanBackend};
use crate::backend::{Backend, BackendError};
use software::Software;
use std::sync::Arc;
use winit::window::Window;

/// Shows pictures in a window.
pub(super) trait Presenter {
    /// Width and height that a picture should have now; `None` where the window shows none, as when it is minimised.
    fn size(&mut self) -> Result<Option<(u32, u32)>, PresentError>;

    /// Shows a picture of that size, or says that it is to be tried again.
    fn show(&mut self, canvas: &Canvas) -> Result<Shown, PresentError>;
}

/// Why a picture cannot be shown.
#[derive(Debug)]
pub(super) enum PresentError {
    Backend(BackendError),
    Window(String),
}

/// What renders: a backend is made by the thread that uses it.
pub(super) enum Engine {
    Cpu,
    Vulkan(OpenDevice),
}

impl Engine {
    pub(super) fn device_name(&self) -> String {
        match self {
            Engine::Cpu => cpu::device_info().name,
            Engine::Vulkan(device) => device.info().name.clone(),
        }
    }

    pub(super) fn start(self) -> Result<Box<dyn Backend>, BackendError> {
        Ok(match self {
            Engine::Cpu => Box::new(CpuBackend::new()),
            Engine::Vulkan(device) => Box::new(VulkanBackend::on(device)?),
        })
    }
}

/// What shows pictures in `window`, and what renders them.
pub(super) fn open(
    window: &Arc<Window>,
    choice: BackendChoice,
    device: Option<&str>,
    validate: bool,
) -> Result<(Box<dyn Presenter>, Engine), ViewError> {
    if choice == BackendChoice::Cpu {
        return on_cpu(window);
    }
    let for_surface: Arc<dyn crate::backend::vulkan::Window> = Arc::<Window>::clone(window);
    match Swapchain::open(for_surface, &selection(device), validate) {
        Ok((swapchain, device)) => {
            let presenter = vulkan::OnSwapchain { swapchain, window: Arc::clone(window) };
            Ok((Box::new(presenter), Engine::Vulkan(device)))
        }
        Err(error) if choice == BackendChoice::Auto && device.is_none() && can_be_replaced(&error) => {
            tracing::info!("rendering on the CPU: {error}");
            on_cpu(window)
        }
        Err(source @ BackendError::NoDevice { .. }) => Err(ViewError::CannotPresent { source }),
        Err(error) => Err(error.into()),
    }
}

fn on_cpu(window: &Arc<Window>) -> Result<(Box<dyn Presenter>, Engine), ViewError> {
    match Software::new(Arc::clone(window)) {
        Ok(presenter) => Ok((Box::new(presenter), Engine::Cpu)),
        Err(reason) => Err(ViewError::Window { reason: reason.to_string() }),
    }
}
