//! What the Vulkan loader calls: the interface between loader and layers, version 2, and the functions that fail.

use crate::plan::{ALLOCATE, answer};
use ash::vk;
use std::ffi::{CStr, c_char, c_void};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

// From `vk_layer.h`, which is no part of Vulkan's registry.

/// Which part of the chain an info of the loader holds: the next layer.
const LINK_INFO: i32 = 0;

/// `VkNegotiateLayerInterface`.
#[repr(C)]
struct Negotiation {
    s_type: i32,
    p_next: *mut c_void,
    version: u32,
    get_instance_proc_addr: Option<vk::PFN_vkGetInstanceProcAddr>,
    get_device_proc_addr: Option<vk::PFN_vkGetDeviceProcAddr>,
    get_physical_device_proc_addr: Option<vk::PFN_vkGetInstanceProcAddr>,
}

/// `VkLayerInstanceCreateInfo`, of which one of a device differs in its link alone.
#[repr(C)]
struct ChainInfo<Link> {
    s_type: vk::StructureType,
    p_next: *mut c_void,
    function: i32,
    link: *mut Link,
}

/// `VkLayerInstanceLink`.
#[repr(C)]
struct InstanceLink {
    next: *mut InstanceLink,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    get_physical_device_proc_addr: Option<vk::PFN_vkGetInstanceProcAddr>,
}

/// `VkLayerDeviceLink`.
#[repr(C)]
struct DeviceLink {
    next: *mut DeviceLink,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
}

/// Takes its link from the chain that begins at `p_next`, and leaves the next layer's there.
///
/// # Safety
/// It is the chain that the loader made, and `Link` is what infos of this type hold.
unsafe fn take_link<Link>(
    mut p_next: *const c_void,
    s_type: vk::StructureType,
    next: impl Fn(&Link) -> *mut Link,
) -> Option<*mut Link> {
    loop {
        let info = p_next.cast_mut().cast::<ChainInfo<Link>>();
        // SAFETY: every structure of a chain begins with its type and the next one; null ends it.
        let (found, behind) = unsafe { info.as_ref().map(|info| (info.s_type, info.p_next))? };
        // SAFETY: it is an info of the loader, by its type.
        if found == s_type && unsafe { (*info).function } == LINK_INFO {
            // SAFETY: links point to links, as the loader promises, and it wants this one replaced.
            unsafe {
                let link = (*info).link;
                (*info).link = next(&*link);
                return Some(link);
            }
        }
        p_next = behind;
    }
}

/// What is below the layer. A program has the same driver throughout, so that what was made last stands for all.
#[derive(Clone)]
struct Below {
    instance: vk::Instance,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    device: Option<Arc<DeviceBelow>>,
}

struct DeviceBelow {
    get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
    functions: ash::DeviceFnV1_0,
    swapchain: ash::khr::swapchain::DeviceFn,
}

static BELOW: RwLock<Option<Below>> = RwLock::new(None);
/// Held by those who use the queue.
static QUEUE: Mutex<()> = Mutex::new(());

fn below() -> Option<Below> {
    BELOW.read().unwrap_or_else(PoisonError::into_inner).clone()
}

fn device_below() -> Arc<DeviceBelow> {
    below().and_then(|below| below.device).expect("a device was made")
}

fn set_below(below: Below) {
    *BELOW.write().unwrap_or_else(PoisonError::into_inner) = Some(below);
}

fn queue() -> MutexGuard<'static, ()> {
    QUEUE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The loader's first call.
///
/// # Safety
/// `negotiation` is null, or points to what the loader wants filled in.
#[unsafe(no_mangle)]
unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(
    negotiation: *mut Negotiation,
) -> vk::Result {
    // SAFETY: the loader's promise.
    let Some(negotiation) = (unsafe { negotiation.as_mut() }) else {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    };
    negotiation.version = negotiation.version.min(2);
    negotiation.get_instance_proc_addr = Some(get_instance_proc_addr);
    negotiation.get_device_proc_addr = Some(get_device_proc_addr);
    negotiation.get_physical_device_proc_addr = None;
    vk::Result::SUCCESS
}

/// The layer's own functions.
fn own(name: &CStr) -> vk::PFN_vkVoidFunction {
    macro_rules! address {
        ($function:path as $type:ty) => {{
            let function: $type = $function;
            // SAFETY: functions are told by their names, and callers call them as what those name.
            Some(unsafe { std::mem::transmute::<$type, unsafe extern "system" fn()>(function) })
        }};
    }
    match name.to_bytes() {
        b"vkGetInstanceProcAddr" => address!(get_instance_proc_addr as vk::PFN_vkGetInstanceProcAddr),
        b"vkGetDeviceProcAddr" => address!(get_device_proc_addr as vk::PFN_vkGetDeviceProcAddr),
        b"vkCreateInstance" => address!(create_instance as vk::PFN_vkCreateInstance),
        b"vkCreateDevice" => address!(create_device as vk::PFN_vkCreateDevice),
        b"vkAllocateMemory" => address!(allocate_memory as vk::PFN_vkAllocateMemory),
        b"vkQueueSubmit" => address!(queue_submit as vk::PFN_vkQueueSubmit),
        b"vkWaitForFences" => address!(wait_for_fences as vk::PFN_vkWaitForFences),
        b"vkDeviceWaitIdle" => address!(device_wait_idle as vk::PFN_vkDeviceWaitIdle),
        b"vkAcquireNextImageKHR" => address!(acquire_next_image as vk::PFN_vkAcquireNextImageKHR),
        b"vkQueuePresentKHR" => address!(queue_present as vk::PFN_vkQueuePresentKHR),
        _ => None,
    }
}

unsafe extern "system" fn get_instance_proc_addr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: names are strings.
    own(unsafe { CStr::from_ptr(name) }).or_else(|| {
        // SAFETY: as the caller calls it.
        unsafe { (below()?.get_instance_proc_addr)(instance, name) }
    })
}

unsafe extern "system" fn get_device_proc_addr(
    device: vk::Device,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: as the caller calls it. What a device has not been made with it has not.
    let found = unsafe { (below()?.device?.get_device_proc_addr)(device, name) };
    // SAFETY: names are strings.
    found.and_then(|found| own(unsafe { CStr::from_ptr(name) }).or(Some(found)))
}

unsafe extern "system" fn create_instance(
    info: *const vk::InstanceCreateInfo<'_>,
    callbacks: *const vk::AllocationCallbacks<'_>,
    instance: *mut vk::Instance,
) -> vk::Result {
    let s_type = vk::StructureType::LOADER_INSTANCE_CREATE_INFO;
    // SAFETY: the loader's chain.
    let link = unsafe { take_link((*info).p_next, s_type, |link: &InstanceLink| link.next) };
    let Some(link) = link else { return vk::Result::ERROR_INITIALIZATION_FAILED };
    // SAFETY: links point to links.
    let get_instance_proc_addr = unsafe { (*link).get_instance_proc_addr };
    // SAFETY: this one is there without an instance.
    let create = unsafe { get_instance_proc_addr(vk::Instance::null(), c"vkCreateInstance".as_ptr()) };
    // SAFETY: it is of that name.
    let create =
        unsafe { std::mem::transmute::<vk::PFN_vkVoidFunction, Option<vk::PFN_vkCreateInstance>>(create) };
    let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
    // SAFETY: as the caller calls it, with the chain of the next layer.
    let result = unsafe { create(info, callbacks, instance) };
    if result == vk::Result::SUCCESS {
        // SAFETY: it was made.
        set_below(Below { instance: unsafe { *instance }, get_instance_proc_addr, device: None });
    }
    result
}

unsafe extern "system" fn create_device(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'_>,
    callbacks: *const vk::AllocationCallbacks<'_>,
    device: *mut vk::Device,
) -> vk::Result {
    let s_type = vk::StructureType::LOADER_DEVICE_CREATE_INFO;
    // SAFETY: the loader's chain.
    let link = unsafe { take_link((*info).p_next, s_type, |link: &DeviceLink| link.next) };
    let (Some(link), Some(below)) = (link, below()) else {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    };
    // SAFETY: links point to links.
    let DeviceLink { get_instance_proc_addr, get_device_proc_addr, .. } = unsafe { link.read() };
    // SAFETY: the instance was made.
    let create = unsafe { get_instance_proc_addr(below.instance, c"vkCreateDevice".as_ptr()) };
    // SAFETY: it is of that name.
    let create =
        unsafe { std::mem::transmute::<vk::PFN_vkVoidFunction, Option<vk::PFN_vkCreateDevice>>(create) };
    let Some(create) = create else { return vk::Result::ERROR_INITIALIZATION_FAILED };
    // SAFETY: as the caller calls it, with the chain of the next layer.
    let result = unsafe { create(physical, info, callbacks, device) };
    if result == vk::Result::SUCCESS {
        // SAFETY: it was made.
        let made = unsafe { *device };
        // SAFETY: the device lives.
        let load = |name: &CStr| unsafe {
            get_device_proc_addr(made, name.as_ptr())
                .map_or(std::ptr::null(), |function| function as *const c_void)
        };
        let functions = ash::DeviceFnV1_0::load(load);
        let swapchain = ash::khr::swapchain::DeviceFn::load(load);
        let device = Some(Arc::new(DeviceBelow { get_device_proc_addr, functions, swapchain }));
        set_below(Below { device, ..below });
    }
    result
}

unsafe extern "system" fn allocate_memory(
    device: vk::Device,
    info: *const vk::MemoryAllocateInfo<'_>,
    callbacks: *const vk::AllocationCallbacks<'_>,
    memory: *mut vk::DeviceMemory,
) -> vk::Result {
    answer(ALLOCATE).unwrap_or_else(|| {
        // SAFETY: as the caller calls it.
        unsafe { (device_below().functions.allocate_memory)(device, info, callbacks, memory) }
    })
}

unsafe extern "system" fn queue_submit(
    to: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo<'_>,
    fence: vk::Fence,
) -> vk::Result {
    let _queue = queue();
    answer("vkQueueSubmit").unwrap_or_else(|| {
        // SAFETY: as the caller calls it.
        unsafe { (device_below().functions.queue_submit)(to, count, submits, fence) }
    })
}

unsafe extern "system" fn wait_for_fences(
    device: vk::Device,
    count: u32,
    fences: *const vk::Fence,
    wait_all: vk::Bool32,
    timeout: u64,
) -> vk::Result {
    if let Some(error) = answer("vkWaitForFences") {
        // SAFETY: the device lives. On one that is lost nothing runs any more.
        let _ = unsafe { idle(device) };
        return error;
    }
    // SAFETY: as the caller calls it.
    unsafe { (device_below().functions.wait_for_fences)(device, count, fences, wait_all, timeout) }
}

unsafe extern "system" fn device_wait_idle(device: vk::Device) -> vk::Result {
    // SAFETY: the device lives.
    let result = unsafe { idle(device) };
    answer("vkDeviceWaitIdle").unwrap_or(result)
}

/// Waits for the driver, whatever the program is told.
///
/// # Safety
/// The device lives.
unsafe fn idle(device: vk::Device) -> vk::Result {
    let _queue = queue();
    // SAFETY: no one else uses the queue.
    unsafe { (device_below().functions.device_wait_idle)(device) }
}

unsafe extern "system" fn acquire_next_image(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    timeout: u64,
    semaphore: vk::Semaphore,
    fence: vk::Fence,
    index: *mut u32,
) -> vk::Result {
    answer("vkAcquireNextImageKHR").unwrap_or_else(|| {
        let acquire = device_below().swapchain.acquire_next_image_khr;
        // SAFETY: as the caller calls it.
        unsafe { acquire(device, swapchain, timeout, semaphore, fence, index) }
    })
}

unsafe extern "system" fn queue_present(to: vk::Queue, info: *const vk::PresentInfoKHR<'_>) -> vk::Result {
    let _queue = queue();
    let answer = answer("vkQueuePresentKHR");
    if answer == Some(vk::Result::ERROR_DEVICE_LOST) {
        return vk::Result::ERROR_DEVICE_LOST;
    }
    // Whatever it answers, it waits for its semaphores.
    // SAFETY: as the caller calls it.
    let result = unsafe { (device_below().swapchain.queue_present_khr)(to, info) };
    answer.unwrap_or(result)
}
