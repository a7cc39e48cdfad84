//! A device that renders for a window, with what shows pictures there where it can.

use super::Selection;
use super::device::Device;
use super::instance::Instance;
use super::physical;
use super::surface::{Surface, extensions};
use super::swapchain::Swapchain;
use super::validation::ValidationLog;
use crate::backend::{BackendError, DeviceInfo};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};
use std::sync::Arc;

/// A window, with the connection to its display. The thread that shows pictures in it need not be the one that has it.
pub trait Window: HasDisplayHandle + HasWindowHandle + Send + Sync {}
impl<W: HasDisplayHandle + HasWindowHandle + Send + Sync> Window for W {}

/// A device that is open, which the thread that renders makes its backend [on](super::VulkanBackend::on).
#[derive(Clone)]
pub struct OpenDevice(pub(super) Arc<Device>);

impl OpenDevice {
    /// Opens the selected device to render for `window`, under the validation layers where `validate` is true. Where it
    /// presents to the window there is a swapchain too, else why there is none: as of a card without a screen whose
    /// window is seen from elsewhere. The best device is looked for among hardware that presents, and then among other
    /// hardware.
    ///
    /// # Errors
    /// [`BackendError::NoDevice`] where nothing matches `selection`, [`BackendError::NoValidation`] where the layers
    /// are asked for and are not installed; else an error of the driver.
    pub fn for_window(
        window: Arc<dyn Window>,
        selection: &Selection,
        validate: bool,
    ) -> Result<(Self, Result<Swapchain, BackendError>), BackendError> {
        let (instance, surface) = match surface(window, validate) {
            Ok(surface) => (Arc::clone(surface.instance()), Ok(surface)),
            Err(error @ BackendError::NoValidation) => return Err(error),
            Err(error) => (Arc::new(Instance::new(validate, &[])?), Err(error)),
        };
        let found = physical::enumerate(&instance, surface.as_ref().ok())?;
        let device = Device::new(instance, physical::select(found, selection)?)?;
        let swapchain = surface.and_then(|surface| {
            if device.physical().presents {
                return Swapchain::new(&device, surface);
            }
            let reason = format!("{} does not present to it", device.info().name);
            Err(BackendError::CannotPresent { reason })
        });
        Ok((OpenDevice(device), swapchain))
    }

    /// What it is.
    pub fn info(&self) -> &DeviceInfo {
        self.0.info()
    }

    /// What [`Selection::Named`] finds it by, on this machine and as long as it has no other devices.
    pub fn selector(&self) -> &str {
        &self.0.physical().selector
    }

    /// What the validation layers say of it.
    pub fn validation_log(&self) -> ValidationLog {
        self.0.instance().log().clone()
    }
}

/// The window's surface, of an instance that has what it needs.
fn surface(window: Arc<dyn Window>, validate: bool) -> Result<Surface, BackendError> {
    let instance = Arc::new(Instance::new(validate, extensions(window.as_ref())?)?);
    Surface::new(&instance, window)
}

#[cfg(test)]
mod tests {
    use super::super::VulkanBackend;
    use super::*;
    use raw_window_handle::{DisplayHandle, HandleError, WindowHandle};

    /// A window of a system that no driver for Linux has surfaces of.
    struct OfAnotherSystem;

    impl HasDisplayHandle for OfAnotherSystem {
        fn display_handle(&self) -> Result<DisplayHandle<'_>, HandleError> {
            Ok(DisplayHandle::windows())
        }
    }

    impl HasWindowHandle for OfAnotherSystem {
        fn window_handle(&self) -> Result<WindowHandle<'_>, HandleError> {
            Err(HandleError::NotSupported)
        }
    }

    /// Nor does it ask for an extension of swapchains that the device may not have: the layers are silent.
    #[test]
    fn device_that_cannot_present_renders_all_the_same() {
        let lavapipe = Selection::Named("llvmpipe".to_owned());
        let (device, swapchain) = OpenDevice::for_window(Arc::new(OfAnotherSystem), &lavapipe, true)
            .expect("lavapipe and the validation layers, which `cargo xtask test` installs");
        let error = swapchain.err().expect("no surface");
        assert!(matches!(error, BackendError::CannotPresent { .. }), "{error}");
        assert!(!device.0.physical().presents);
        let log = device.validation_log();
        let mut backend = VulkanBackend::on(device).expect("it renders");
        let (keys, values) = backend.sort_pairs(&[3, 1, 2], &[30, 10, 20], 32).expect("it computes");
        assert_eq!((keys, values), (vec![1, 2, 3], vec![10, 20, 30]));
        drop(backend);
        assert!(log.messages().is_empty(), "{:?}", log.messages());
    }
}
