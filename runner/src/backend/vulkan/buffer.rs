//! Buffers and their memory.

use super::device::{Device, Owned};
use crate::backend::BackendError;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// Size of the smallest buffer, in bytes. Vulkan has no empty buffers: where the host's is empty, zeros of this
/// length are bound. A multiple of 4, as `vkCmdFillBuffer` asks, and longer than the longest element of an array.
pub(super) const LEAST_BYTES: u64 = 64;

/// What a buffer is called in errors, and what a user can do where it is too large.
#[derive(Clone, Copy, Debug)]
pub(super) struct Label {
    pub(super) name: &'static str,
    pub(super) remedy: &'static str,
}

/// A buffer with memory of its own.
///
/// Each has its own allocation: there are about twenty of them, Vulkan allows at least 4096, and a scene that is
/// dropped then gives its memory back at once.
pub(super) struct Buffer {
    /// Destroyed before its memory is freed.
    raw: Owned<vk::Buffer>,
    memory: Memory,
    bytes: u64,
}

/// Frees the memory when dropped.
struct Memory {
    /// `None` once it is freed.
    allocation: Option<Allocation>,
    device: Arc<Device>,
}

impl Drop for Memory {
    fn drop(&mut self) {
        if let Some(allocation) = self.allocation.take()
            && let Err(error) = self.device.allocator().free(allocation)
        {
            tracing::warn!("device memory could not be freed: {error}");
        }
    }
}

impl Buffer {
    /// A buffer that kernels read or write, in the device's memory; what it holds is undefined.
    pub(super) fn for_kernels(device: &Arc<Device>, label: Label, bytes: u64) -> Result<Self, BackendError> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        Self::new(device, label, bytes, usage, MemoryLocation::GpuOnly)
    }

    /// A mapped buffer that the host fills and the device copies from.
    pub(super) fn for_upload(device: &Arc<Device>, bytes: u64) -> Result<Self, BackendError> {
        let label = Label { name: "the upload buffer", remedy: "use --backend cpu" };
        Self::new(device, label, bytes, vk::BufferUsageFlags::TRANSFER_SRC, MemoryLocation::CpuToGpu)
    }

    /// A mapped buffer that the device copies to and the host reads.
    pub(super) fn for_download(device: &Arc<Device>, bytes: u64) -> Result<Self, BackendError> {
        let label = Label { name: "the download buffer", remedy: "use --backend cpu" };
        Self::new(device, label, bytes, vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu)
    }

    fn new(
        device: &Arc<Device>,
        label: Label,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self, BackendError> {
        let bytes = bytes.max(LEAST_BYTES);
        require_room(device, label, bytes, device.limits().buffer_bytes())?;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: `info` is complete and the device lives.
        let made = unsafe { device.raw().create_buffer(&info, None) };
        let raw = Owned::new(device, "creating a buffer", made)?;
        let memory = allocate(&raw, label, bytes, location)?;
        let buffer = Buffer { raw, memory, bytes };
        if location != MemoryLocation::GpuOnly && buffer.mapped().is_empty() {
            let reason = "the driver does not map it".to_owned();
            return Err(BackendError::Allocation { name: label.name, bytes, reason });
        }
        Ok(buffer)
    }

    pub(super) fn raw(&self) -> vk::Buffer {
        self.raw.raw()
    }

    /// Its size in bytes, at least [`LEAST_BYTES`].
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What the host sees of it; empty where it is not mapped.
    pub(super) fn mapped(&self) -> &[u8] {
        self.memory.allocation.as_ref().and_then(Allocation::mapped_slice).unwrap_or_default()
    }

    /// As [`mapped`](Self::mapped), to be written.
    pub(super) fn mapped_mut(&mut self) -> &mut [u8] {
        self.memory.allocation.as_mut().and_then(Allocation::mapped_slice_mut).unwrap_or_default()
    }
}

/// `TooLarge` where `bytes` are more than `limit`.
pub(super) fn require_room(
    device: &Device,
    label: Label,
    bytes: u64,
    limit: u64,
) -> Result<(), BackendError> {
    if bytes <= limit {
        return Ok(());
    }
    Err(BackendError::TooLarge {
        name: label.name,
        bytes,
        limit,
        device: device.info().name.clone(),
        remedy: label.remedy,
    })
}

/// Memory for a buffer, bound to it.
fn allocate(
    buffer: &Owned<vk::Buffer>,
    label: Label,
    bytes: u64,
    location: MemoryLocation,
) -> Result<Memory, BackendError> {
    let device = buffer.device();
    // SAFETY: the buffer is of this device.
    let requirements = unsafe { device.raw().get_buffer_memory_requirements(buffer.raw()) };
    let allocation = device
        .allocator()
        .allocate(&AllocationCreateDesc {
            name: label.name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::DedicatedBuffer(buffer.raw()),
        })
        .map_err(|error| BackendError::Allocation { name: label.name, bytes, reason: error.to_string() })?;
    // SAFETY: the handle is only passed on to the bind below, while the allocation lives.
    let handle = unsafe { allocation.memory() };
    let offset = allocation.offset();
    let memory = Memory { allocation: Some(allocation), device: Arc::clone(device) };
    // SAFETY: the memory meets the buffer's requirements, and the buffer has none yet.
    unsafe { device.raw().bind_buffer_memory(buffer.raw(), handle, offset) }
        .map_err(|source| device.error("binding memory to a buffer", source))?;
    Ok(memory)
}
