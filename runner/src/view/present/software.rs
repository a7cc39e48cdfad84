//! By the window's system, without Vulkan.

use super::super::canvas::Canvas;
use super::{PresentError, Presenter, Progress};
use softbuffer::{Context, SoftBufferError, Surface};
use std::num::NonZeroU32;
use std::sync::Arc;
use winit::window::Window;

pub(super) struct Software {
    surface: Surface<Arc<Window>, Arc<Window>>,
    /// The size that the surface has.
    size: Option<(u32, u32)>,
    window: Arc<Window>,
}

impl Software {
    pub(super) fn new(window: Arc<Window>) -> Result<Self, SoftBufferError> {
        Ok(Software { surface: surface(&window)?, size: None, window })
    }

    fn try_show(&mut self, canvas: &Canvas) -> Result<Progress, SoftBufferError> {
        let (Some(width), Some(height)) = (NonZeroU32::new(canvas.width), NonZeroU32::new(canvas.height))
        else {
            return Ok(Progress::NotYet);
        };
        if self.size != Some((canvas.width, canvas.height)) {
            self.surface.resize(width, height)?;
            self.size = Some((canvas.width, canvas.height));
        }
        let mut buffer = self.surface.buffer_mut()?;
        buffer.copy_from_slice(&canvas.texels);
        buffer.present()?;
        Ok(Progress::Shown)
    }
}

fn surface(window: &Arc<Window>) -> Result<Surface<Arc<Window>, Arc<Window>>, SoftBufferError> {
    Surface::new(&Context::new(Arc::clone(window))?, Arc::clone(window))
}

impl Presenter for Software {
    fn size(&mut self) -> Result<Option<(u32, u32)>, PresentError> {
        let size = self.window.inner_size();
        Ok((size.width > 0 && size.height > 0).then_some((size.width, size.height)))
    }

    fn show(&mut self, canvas: Canvas) -> Result<Progress, PresentError> {
        self.try_show(&canvas).map_err(|error| PresentError::Window(error.to_string()))
    }

    fn outcome(&mut self) -> Result<Option<Progress>, PresentError> {
        Ok(None)
    }

    fn renew(&mut self) -> Result<(), PresentError> {
        self.surface = surface(&self.window).map_err(|error| PresentError::Window(error.to_string()))?;
        self.size = None;
        Ok(())
    }
}
