//! By a swapchain of the device that renders.

use super::super::canvas::Canvas;
use super::{PresentError, Presenter};
use crate::backend::vulkan::{Shown, Swapchain};
use std::sync::Arc;
use winit::window::Window;

pub(super) struct OnSwapchain {
    pub(super) swapchain: Swapchain,
    pub(super) window: Arc<Window>,
}

impl Presenter for OnSwapchain {
    fn size(&mut self) -> Result<Option<(u32, u32)>, PresentError> {
        let usual = self.window.inner_size();
        self.swapchain.size((usual.width, usual.height)).map_err(PresentError::Backend)
    }

    fn show(&mut self, canvas: &Canvas) -> Result<Shown, PresentError> {
        let size = (canvas.width, canvas.height);
        self.window.pre_present_notify();
        self.swapchain.show(size, &canvas.texels).map_err(PresentError::Backend)
    }

    fn renew(&mut self) -> Result<(), PresentError> {
        self.swapchain.lose_surface();
        Ok(())
    }
}
