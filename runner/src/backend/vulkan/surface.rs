//! The surface of a window, which swapchains present to.

use super::device::Device;
use super::instance::Instance;
use super::window::Window;
use crate::backend::BackendError;
use ash::prelude::VkResult;
use ash::vk;
use raw_window_handle::HandleError;
use std::ffi::c_char;
use std::sync::Arc;

/// Destroys the surface when dropped.
pub(super) struct Surface {
    raw: vk::SurfaceKHR,
    functions: ash::khr::surface::Instance,
    instance: Arc<Instance>,
    /// Outlives the surface: fields are dropped after `drop`.
    window: Arc<dyn Window>,
}

/// The instance's extensions that a window of this display needs.
pub(super) fn extensions(window: &dyn Window) -> Result<&'static [*const c_char], BackendError> {
    let display = window.display_handle().map_err(no_handle)?;
    ash_window::enumerate_required_extensions(display.as_raw())
        .map_err(|source| BackendError::Vulkan { what: "asking for the window's system", source })
}

fn no_handle(error: HandleError) -> BackendError {
    BackendError::CannotPresent { reason: format!("the window cannot be drawn in ({error})") }
}

impl Surface {
    /// Needs an instance with the window's [`extensions`].
    pub(super) fn new(instance: &Arc<Instance>, window: Arc<dyn Window>) -> Result<Self, BackendError> {
        let functions = ash::khr::surface::Instance::new(instance.entry(), instance.raw());
        let mut surface =
            Surface { raw: vk::SurfaceKHR::null(), functions, instance: Arc::clone(instance), window };
        surface.renew()?;
        Ok(surface)
    }

    /// Makes it anew, for where it is lost. Nothing may use it any more.
    pub(super) fn renew(&mut self) -> Result<(), BackendError> {
        self.destroy();
        let display = self.window.display_handle().map_err(no_handle)?.as_raw();
        let handle = self.window.window_handle().map_err(no_handle)?.as_raw();
        let (entry, instance) = (self.instance.entry(), self.instance.raw());
        // SAFETY: the instance has the extensions; it and the window are held until the surface is destroyed.
        self.raw = unsafe { ash_window::create_surface(entry, instance, display, handle, None) }
            .map_err(|source| BackendError::Vulkan { what: "making the window's surface", source })?;
        Ok(())
    }

    fn destroy(&mut self) {
        let raw = std::mem::replace(&mut self.raw, vk::SurfaceKHR::null());
        // SAFETY: made in `renew` or null, destroyed once; swapchains for it are destroyed before.
        unsafe { self.functions.destroy_surface(raw, None) };
    }

    pub(super) fn raw(&self) -> vk::SurfaceKHR {
        self.raw
    }

    /// Whether queues of a family can present to it.
    pub(super) fn is_presented_by(&self, physical: vk::PhysicalDevice, family: u32) -> VkResult<bool> {
        let functions = &self.functions;
        // SAFETY: the device and the surface are of one instance, and the device has the family.
        unsafe { functions.get_physical_device_surface_support(physical, family, self.raw) }
    }

    /// Its present size, and what swapchains for it may have.
    pub(super) fn capabilities(&self, device: &Device) -> Result<vk::SurfaceCapabilitiesKHR, BackendError> {
        let physical = device.physical().raw;
        // SAFETY: the device and the surface are of one instance.
        unsafe { self.functions.get_physical_device_surface_capabilities(physical, self.raw) }
            .map_err(|source| device.error("asking for the window's size", source))
    }

    pub(super) fn formats(&self, device: &Device) -> Result<Vec<vk::SurfaceFormatKHR>, BackendError> {
        let physical = device.physical().raw;
        // SAFETY: as above.
        unsafe { self.functions.get_physical_device_surface_formats(physical, self.raw) }
            .map_err(|source| device.error("asking for the window's formats", source))
    }

    pub(super) fn present_modes(&self, device: &Device) -> Result<Vec<vk::PresentModeKHR>, BackendError> {
        let physical = device.physical().raw;
        // SAFETY: as above.
        unsafe { self.functions.get_physical_device_surface_present_modes(physical, self.raw) }
            .map_err(|source| device.error("asking for the ways to present", source))
    }

    pub(super) fn instance(&self) -> &Arc<Instance> {
        &self.instance
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        self.destroy();
    }
}
