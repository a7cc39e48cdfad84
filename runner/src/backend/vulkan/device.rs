//! The opened device, its queue and its memory, and handles that destroy themselves.

use super::instance::Instance;
use super::physical::{Limits, PhysicalDevice};
use super::turns::{Turn, Turns};
use crate::backend::{BackendError, DeviceInfo};
use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An open device. Everything made on it holds an `Arc` of it, so it is dropped last.
///
/// The fields are dropped in the order in which they stand: the allocator frees its blocks on the device, and the
/// device is destroyed before the instance that its handle holds.
///
/// The thread that renders and the one that shows pictures share it. Vulkan wants them one after the other where they
/// use the queue, for which there are [turns](Self::queue), and waits for the idle device have one too; memory is
/// behind a lock. All else they use side by side: each makes, records, waits for and destroys what it alone has.
pub(super) struct Device {
    allocator: Mutex<Allocator>,
    handle: DeviceHandle,
    queue: vk::Queue,
    /// Of what is submitted: the thread that renders and the one that shows pictures share the queue.
    turns: Turns,
    physical: PhysicalDevice,
    /// The functions for statistics of pipelines, where the device has them.
    executable_properties: Option<ash::khr::pipeline_executable_properties::Device>,
}

/// Destroys the device when dropped.
struct DeviceHandle {
    raw: ash::Device,
    instance: Arc<Instance>,
}

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // SAFETY: made in `open`, destroyed once, after everything made on it: each holds the `Device`.
        unsafe { self.raw.destroy_device(None) };
    }
}

impl Device {
    /// Opens a device with one queue and the two features that the kernels need; with swapchains where it
    /// [presents](PhysicalDevice::presents).
    pub(super) fn new(instance: Arc<Instance>, physical: PhysicalDevice) -> Result<Arc<Self>, BackendError> {
        let handle = open(instance, &physical)?;
        // SAFETY: the device was opened with one queue of this family.
        let queue = unsafe { handle.raw.get_device_queue(physical.queue_family, 0) };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: handle.instance.raw().clone(),
            device: handle.raw.clone(),
            physical_device: physical.raw,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: false,
            allocation_sizes: gpu_allocator::AllocationSizes::default(),
        })
        .map_err(|error| BackendError::Allocation {
            name: "the memory allocator",
            bytes: 0,
            reason: error.to_string(),
        })?;
        let executable_properties = physical.has_pipeline_statistics.then(|| {
            ash::khr::pipeline_executable_properties::Device::new(handle.instance.raw(), &handle.raw)
        });
        let turns = Turns::default();
        let allocator = Mutex::new(allocator);
        Ok(Arc::new(Device { allocator, handle, queue, turns, physical, executable_properties }))
    }

    pub(super) fn raw(&self) -> &ash::Device {
        &self.handle.raw
    }

    pub(super) fn instance(&self) -> &Instance {
        &self.handle.instance
    }

    /// The queue, which no one else submits to until the turn is dropped.
    pub(super) fn queue(&self) -> (vk::Queue, Turn<'_>) {
        let turn = self.turns.take();
        (self.queue, turn)
    }

    /// Waits until nothing runs on the device.
    pub(super) fn wait_idle(&self) -> ash::prelude::VkResult<()> {
        let (_queue, _turn) = self.queue();
        // SAFETY: the device lives, and no one submits to its queue meanwhile.
        unsafe { self.handle.raw.device_wait_idle() }
    }

    pub(super) fn physical(&self) -> &PhysicalDevice {
        &self.physical
    }

    pub(super) fn executable_properties(&self) -> Option<&ash::khr::pipeline_executable_properties::Device> {
        self.executable_properties.as_ref()
    }

    pub(super) fn queue_family(&self) -> u32 {
        self.physical.queue_family
    }

    pub(super) fn info(&self) -> &DeviceInfo {
        &self.physical.info
    }

    pub(super) fn limits(&self) -> &Limits {
        &self.physical.limits
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The error of a call that failed while doing `what`.
    pub(super) fn error(&self, what: &'static str, source: vk::Result) -> BackendError {
        match source {
            vk::Result::ERROR_DEVICE_LOST => {
                BackendError::DeviceLost { device: self.physical.info.name.clone(), what }
            }
            source => BackendError::Vulkan { what, source },
        }
    }
}

fn open(instance: Arc<Instance>, physical: &PhysicalDevice) -> Result<DeviceHandle, BackendError> {
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(physical.queue_family)
        .queue_priorities(&[1.0])];
    let mut features12 = vk::PhysicalDeviceVulkan12Features::default()
        .vulkan_memory_model(true)
        .vulkan_memory_model_device_scope(true);
    let mut executables =
        vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
    let mut extensions = Vec::new();
    if physical.presents {
        extensions.push(ash::khr::swapchain::NAME.as_ptr());
    }
    let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut features12);
    if physical.has_pipeline_statistics {
        extensions.push(ash::khr::pipeline_executable_properties::NAME.as_ptr());
        info = info.push_next(&mut executables);
    }
    let info = info.enabled_extension_names(&extensions);
    // SAFETY: the physical device is of this instance and has the features and the queue; the handle destroys it.
    let raw = unsafe { instance.raw().create_device(physical.raw, &info, None) }
        .map_err(|source| BackendError::Vulkan { what: "opening the device", source })?;
    Ok(DeviceHandle { raw, instance })
}

/// A handle that a device destroys.
pub(super) trait Destroy: Copy {
    /// Destroys the handle.
    ///
    /// # Safety
    /// The handle comes from `device`, no submission that uses it is pending, and it is not used again.
    unsafe fn destroy(self, device: &ash::Device);
}

/// Implements [`Destroy`] by the device's function for each type.
macro_rules! destroy_by {
    ($($handle:ty => $function:ident),* $(,)?) => {$(
        impl Destroy for $handle {
            unsafe fn destroy(self, device: &ash::Device) {
                // SAFETY: the caller's promise.
                unsafe { device.$function(self, None) };
            }
        }
    )*};
}

destroy_by! {
    vk::Buffer => destroy_buffer,
    vk::CommandPool => destroy_command_pool,
    vk::DescriptorPool => destroy_descriptor_pool,
    vk::DescriptorSetLayout => destroy_descriptor_set_layout,
    vk::Fence => destroy_fence,
    vk::Pipeline => destroy_pipeline,
    vk::PipelineLayout => destroy_pipeline_layout,
    vk::QueryPool => destroy_query_pool,
    vk::Semaphore => destroy_semaphore,
    vk::ShaderModule => destroy_shader_module,
}

/// A handle that is destroyed when dropped. Wrapped on the line that makes it, so that no later error leaks it.
///
/// Whoever submits waits before anything that the submission uses is dropped, hence nothing is pending then:
/// `Commands` wait for each submission, also for one that they cannot wait for by its fence; a `Swapchain` for its last
/// copy before it replaces what that reads, and for the idle device before it drops images or itself.
pub(super) struct Owned<H: Destroy> {
    raw: H,
    device: Arc<Device>,
}

impl<H: Destroy> Owned<H> {
    /// Takes a handle just made by `device`, or the error that it made instead while doing `what`.
    pub(super) fn new(
        device: &Arc<Device>,
        what: &'static str,
        made: ash::prelude::VkResult<H>,
    ) -> Result<Self, BackendError> {
        let raw = made.map_err(|source| device.error(what, source))?;
        Ok(Owned { raw, device: Arc::clone(device) })
    }

    pub(super) fn raw(&self) -> H {
        self.raw
    }

    pub(super) fn device(&self) -> &Arc<Device> {
        &self.device
    }
}

impl<H: Destroy> Drop for Owned<H> {
    fn drop(&mut self) {
        // SAFETY: it comes from this device, this type alone destroys it, and submissions are waited for.
        unsafe { self.raw.destroy(self.device.raw()) };
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::{Selection, physical};
    use super::*;

    /// Lavapipe under the validation layers.
    pub(in super::super) fn validated_lavapipe() -> Arc<Device> {
        let needs = "needs lavapipe and the validation layers, which `cargo xtask test` installs";
        let instance = Arc::new(Instance::new(true, &[]).expect(needs));
        let found = physical::enumerate(&instance, None).expect(needs);
        let lavapipe = physical::select(found, &Selection::Named("llvmpipe".to_owned())).expect(needs);
        Device::new(instance, lavapipe).expect(needs)
    }

    /// What every test on lavapipe relies on: the silence of the layers means something.
    #[test]
    fn leaked_handle_is_reported_when_the_device_is_dropped() {
        let device = validated_lavapipe();
        let log = device.instance().log().clone();
        // SAFETY: the device lives.
        let made = unsafe { device.raw().create_fence(&vk::FenceCreateInfo::default(), None) };
        let fence = Owned::new(&device, "creating a fence", made).unwrap();
        // The device's `Arc` must not be leaked with the fence.
        let leaked = fence.raw();
        std::mem::forget(fence);
        // SAFETY: the forgotten fence held one of the counts.
        unsafe { Arc::decrement_strong_count(Arc::as_ptr(&device)) };
        assert!(log.messages().is_empty(), "{:?}", log.messages());
        drop(device);
        let messages = log.messages();
        assert!(messages.iter().any(|message| message.contains("VkFence")), "{leaked:?}: {messages:?}");
    }

    #[test]
    fn broken_rule_is_reported_at_once() {
        let device = validated_lavapipe();
        let info = vk::BufferCreateInfo::default().size(0).usage(vk::BufferUsageFlags::STORAGE_BUFFER);
        // SAFETY: none: a buffer of size 0 breaks a rule, on purpose; the layers keep it from the driver.
        let made = unsafe { device.raw().create_buffer(&info, None) };
        let _made = made.map(|raw| Owned::new(&device, "creating a buffer", Ok(raw)));
        let messages = device.instance().log().messages();
        assert!(
            messages.iter().any(|message| message.contains("VUID-VkBufferCreateInfo-size")),
            "{messages:?}"
        );
    }

    #[test]
    fn lost_device_is_told_from_other_errors() {
        let device = validated_lavapipe();
        let lost = device.error("rendering", vk::Result::ERROR_DEVICE_LOST).to_string();
        assert!(lost.contains("llvmpipe") && lost.contains("was lost while rendering"), "{lost}");
        let other = device.error("rendering", vk::Result::ERROR_OUT_OF_HOST_MEMORY);
        assert!(matches!(other, BackendError::Vulkan { what: "rendering", .. }), "{other}");
    }
}
