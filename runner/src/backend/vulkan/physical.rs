//! The devices of a machine: which of them fit, what they can do, and which one is taken.

use super::Selection;
use super::build::MOST_SHARED_BYTES;
use super::instance::{API_VERSION, Instance, version_text};
use super::pipeline::MOST_BINDINGS;
use super::surface::Surface;
use crate::backend::{BackendError, DeviceInfo, DeviceKind};
use ash::vk;
use std::ffi::CStr;

/// A device that fits, not yet opened.
pub(super) struct PhysicalDevice {
    pub(super) raw: vk::PhysicalDevice,
    pub(super) info: DeviceInfo,
    /// What [`Selection::Named`] finds it by: its name, or its number where one before it is found by that name.
    pub(super) selector: String,
    pub(super) limits: Limits,
    /// The family of the queue that everything is submitted to: it can compute, hence also copy; where it
    /// [presents](Self::presents) it can do that too.
    pub(super) queue_family: u32,
    /// Whether it was examined for a window, and the queue presents to it and swapchains can be made.
    pub(super) presents: bool,
    /// Whether its driver gives statistics of pipelines.
    pub(super) has_pipeline_statistics: bool,
}

/// What a device allows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Longest storage buffer, in bytes.
    pub(super) storage_buffer_bytes: u64,
    /// Largest single allocation, in bytes.
    pub(super) allocation_bytes: u64,
    /// Size of the largest device-local heap, in bytes.
    pub(super) heap_bytes: u64,
    /// Nanoseconds of a timestamp's unit.
    pub(super) timestamp_period_ns: f64,
    /// How many bits of a timestamp count; 0 where the queue writes none.
    pub(super) timestamp_bits: u32,
}

impl Limits {
    /// The longest buffer that a kernel can have, in bytes.
    pub(super) fn buffer_bytes(&self) -> u64 {
        self.storage_buffer_bytes.min(self.allocation_bytes).min(self.heap_bytes)
    }
}

/// Every device that fits, in the loader's order, with whether it presents to `window`. What does not fit is logged.
pub(super) fn enumerate(
    instance: &Instance,
    window: Option<&Surface>,
) -> Result<Vec<PhysicalDevice>, BackendError> {
    // SAFETY: the instance lives through the call.
    let all = unsafe { instance.raw().enumerate_physical_devices() }
        .map_err(|source| BackendError::Vulkan { what: "listing the devices", source })?;
    let mut devices: Vec<_> = all.into_iter().filter_map(|raw| examine(instance, raw, window)).collect();
    let names: Vec<_> = devices.iter().map(|device| device.info.name.clone()).collect();
    for (number, device) in (0..).zip(&mut devices) {
        device.selector = selector(&names, number);
    }
    Ok(devices)
}

/// The name with that number, or the number where that name finds another device first.
fn selector(names: &[String], number: u32) -> String {
    let name = &names[number as usize];
    let first = names.iter().position(|other| contains_ignoring_case(other, name));
    // A name that is a number would be taken for one.
    let is_found = first == Some(number as usize) && name.parse::<u32>().is_err();
    if is_found { name.clone() } else { number.to_string() }
}

/// The device that `selection` means, of those that `enumerate` gives.
pub(super) fn select(
    mut devices: Vec<PhysicalDevice>,
    selection: &Selection,
) -> Result<PhysicalDevice, BackendError> {
    let infos: Vec<_> = devices.iter().map(|device| (&device.info, device.presents)).collect();
    match choose(&infos, selection) {
        Some(index) => Ok(devices.swap_remove(index)),
        None => Err(BackendError::NoDevice { reason: why_none(&infos, selection) }),
    }
}

/// Index of the device that `selection` means, in a list as `enumerate` gives it, with whether each presents to the
/// window. Where the best is wanted, one that presents goes before one that does not, but never software before
/// hardware; the name of a device means the same one with a window and without.
fn choose(devices: &[(&DeviceInfo, bool)], selection: &Selection) -> Option<usize> {
    match selection {
        Selection::Auto => (0..devices.len())
            .filter(|&index| devices[index].0.kind < DeviceKind::Software)
            .min_by_key(|&index| (!devices[index].1, devices[index].0.kind)),
        Selection::Named(wanted) => wanted
            .parse::<usize>()
            .ok()
            .filter(|&wanted| wanted < devices.len())
            // A number of none may be a part of a name: "4090".
            .or_else(|| devices.iter().position(|(device, _)| contains_ignoring_case(&device.name, wanted))),
    }
}

fn contains_ignoring_case(name: &str, part: &str) -> bool {
    name.to_lowercase().contains(&part.to_lowercase())
}

fn why_none(devices: &[(&DeviceInfo, bool)], selection: &Selection) -> String {
    let list: Vec<_> = (0..)
        .zip(devices)
        .map(|(number, (device, _)): (u32, _)| format!("{number}: {}", device.name))
        .collect();
    let list = list.join(", ");
    match selection {
        _ if devices.is_empty() => {
            "no driver offers a device with Vulkan 1.2 and its memory model".to_owned()
        }
        Selection::Auto => format!("none is hardware; --device can ask for a software one ({list})"),
        Selection::Named(wanted) => format!("none matches --device {wanted} ({list})"),
    }
}

/// The device with its limits, or nothing where it does not fit.
fn examine(instance: &Instance, raw: vk::PhysicalDevice, window: Option<&Surface>) -> Option<PhysicalDevice> {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut maintenance3 = vk::PhysicalDeviceMaintenance3Properties::default();
    let version = api_version(instance, raw);
    let mut properties = vk::PhysicalDeviceProperties2::default();
    // Structures of a version that the device does not have must not be asked for.
    if version >= API_VERSION {
        properties = properties.push_next(&mut driver).push_next(&mut maintenance3);
    }
    // SAFETY: `raw` comes from this instance, which has version 1.2.
    unsafe { instance.raw().get_physical_device_properties2(raw, &mut properties) };
    let properties = properties.properties;
    let name = text(properties.device_name_as_c_str());
    let queue = compute_queue(instance, raw, window);
    let lack = what_lacks(instance, raw, &properties, queue.is_some());
    if let Some(lack) = lack {
        tracing::debug!("{name} is not used: it lacks {lack}");
        return None;
    }
    let queue = queue?;
    Some(PhysicalDevice {
        raw,
        // The list's business.
        selector: String::new(),
        info: DeviceInfo {
            backend: "vulkan",
            kind: kind(properties.device_type),
            details: details(version, &driver),
            name,
        },
        limits: Limits {
            storage_buffer_bytes: u64::from(properties.limits.max_storage_buffer_range),
            allocation_bytes: maintenance3.max_memory_allocation_size,
            heap_bytes: largest_device_heap(instance, raw),
            timestamp_period_ns: f64::from(properties.limits.timestamp_period),
            timestamp_bits: queue.timestamp_bits,
        },
        queue_family: queue.family,
        presents: queue.presents && offers(instance, raw, ash::khr::swapchain::NAME),
        has_pipeline_statistics: has_pipeline_statistics(instance, raw),
    })
}

/// Whether the device has an extension.
fn offers(instance: &Instance, raw: vk::PhysicalDevice, extension: &CStr) -> bool {
    // SAFETY: `raw` comes from this instance.
    let offered = unsafe { instance.raw().enumerate_device_extension_properties(raw) }.unwrap_or_default();
    offered.iter().any(|one| one.extension_name_as_c_str() == Ok(extension))
}

/// Whether the device has the extension for statistics of pipelines, and the feature.
fn has_pipeline_statistics(instance: &Instance, raw: vk::PhysicalDevice) -> bool {
    if !offers(instance, raw, ash::khr::pipeline_executable_properties::NAME) {
        return false;
    }
    let mut executables = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut executables);
    // SAFETY: `raw` comes from this instance, which is of Vulkan 1.2, and the device has the extension.
    unsafe { instance.raw().get_physical_device_features2(raw, &mut features) };
    executables.pipeline_executable_info == vk::TRUE
}

fn api_version(instance: &Instance, raw: vk::PhysicalDevice) -> u32 {
    // SAFETY: `raw` comes from this instance.
    unsafe { instance.raw().get_physical_device_properties(raw) }.api_version
}

/// What the kernels need and the device has not, or `None` where it fits.
fn what_lacks(
    instance: &Instance,
    raw: vk::PhysicalDevice,
    properties: &vk::PhysicalDeviceProperties,
    computes: bool,
) -> Option<&'static str> {
    if properties.api_version < API_VERSION {
        Some("Vulkan 1.2")
    } else if !has_memory_model(instance, raw) {
        Some("the features vulkanMemoryModel and vulkanMemoryModelDeviceScope")
    } else if !computes {
        Some("a queue for compute")
    } else if properties.limits.max_per_stage_descriptor_storage_buffers < MOST_BINDINGS {
        Some("enough storage buffers for a kernel")
    } else if (properties.limits.max_compute_shared_memory_size as usize) < MOST_SHARED_BYTES {
        Some("enough shared memory for a kernel")
    } else {
        None
    }
}

/// Needs a device of version 1.2.
fn has_memory_model(instance: &Instance, raw: vk::PhysicalDevice) -> bool {
    let mut features12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut features12);
    // SAFETY: `raw` comes from this instance and knows the structure of version 1.2.
    unsafe { instance.raw().get_physical_device_features2(raw, &mut features) };
    features12.vulkan_memory_model == vk::TRUE && features12.vulkan_memory_model_device_scope == vk::TRUE
}

/// What everything is submitted to.
struct Queue {
    family: u32,
    /// How many bits its timestamps have.
    timestamp_bits: u32,
    /// Whether it presents to the window.
    presents: bool,
}

/// The first queue family that computes and presents to the window, or else the first that computes.
fn compute_queue(instance: &Instance, raw: vk::PhysicalDevice, window: Option<&Surface>) -> Option<Queue> {
    // SAFETY: `raw` comes from this instance.
    let families = unsafe { instance.raw().get_physical_device_queue_family_properties(raw) };
    let computing = (0u32..)
        .zip(families)
        .filter(|(_, family)| family.queue_flags.contains(vk::QueueFlags::COMPUTE) && family.queue_count > 0);
    let queues = computing.map(|(index, family)| Queue {
        family: index,
        timestamp_bits: family.timestamp_valid_bits,
        // A driver that does not tell does not present.
        presents: window.is_some_and(|window| window.is_presented_by(raw, index).unwrap_or(false)),
    });
    queues.min_by_key(|queue| !queue.presents)
}

fn largest_device_heap(instance: &Instance, raw: vk::PhysicalDevice) -> u64 {
    // SAFETY: `raw` comes from this instance.
    let memory = unsafe { instance.raw().get_physical_device_memory_properties(raw) };
    let heaps = memory.memory_heaps_as_slice().iter();
    let local = heaps.filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
    local.map(|heap| heap.size).max().unwrap_or(0)
}

/// A type that Vulkan does not name counts as software: then it is used only when asked for.
fn kind(device_type: vk::PhysicalDeviceType) -> DeviceKind {
    match device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
        _ => DeviceKind::Software,
    }
}

/// `Vulkan 1.3.230, llvmpipe Mesa 22.3.6`.
fn details(version: u32, driver: &vk::PhysicalDeviceDriverProperties<'_>) -> String {
    format!(
        "Vulkan {}, {} {}",
        version_text(version),
        text(driver.driver_name_as_c_str()),
        text(driver.driver_info_as_c_str())
    )
}

/// A driver's text; empty where it breaks the rule that a zero ends it.
fn text<E>(text: Result<&CStr, E>) -> String {
    text.map(|text| text.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, kind: DeviceKind) -> DeviceInfo {
        DeviceInfo { backend: "vulkan", name: name.to_owned(), kind, details: String::new() }
    }

    fn without_window<'a>(devices: &[&'a DeviceInfo]) -> Vec<(&'a DeviceInfo, bool)> {
        devices.iter().map(|&device| (device, false)).collect()
    }

    fn named(wanted: &str) -> Selection {
        Selection::Named(wanted.to_owned())
    }

    #[test]
    fn auto_prefers_discrete_then_integrated_then_virtual_then_the_first() {
        let software = device("llvmpipe", DeviceKind::Software);
        let share = device("Share", DeviceKind::Virtual);
        let chip = device("Chip", DeviceKind::Integrated);
        let card = device("Card", DeviceKind::Discrete);
        let chosen = |devices: &[&DeviceInfo]| choose(&without_window(devices), &Selection::Auto);
        assert_eq!(chosen(&[&software, &share, &chip, &card, &card]), Some(3));
        assert_eq!(chosen(&[&software, &share, &chip]), Some(2));
        assert_eq!(chosen(&[&software, &share]), Some(1));
    }

    /// A card without a screen renders where nothing else is hardware; a name means what it means without a window.
    #[test]
    fn device_that_presents_goes_first_among_hardware() {
        let software = device("llvmpipe", DeviceKind::Software);
        let chip = device("Chip", DeviceKind::Integrated);
        let card = device("Card", DeviceKind::Discrete);
        let chosen = |presents: [bool; 3], selection: &Selection| {
            choose(&[(&card, presents[0]), (&chip, presents[1]), (&software, presents[2])], selection)
        };
        assert_eq!(chosen([true, true, true], &Selection::Auto), Some(0));
        assert_eq!(chosen([false, true, true], &Selection::Auto), Some(1));
        assert_eq!(chosen([false, false, true], &Selection::Auto), Some(0));
        for wanted in ["card", "0"] {
            assert_eq!(chosen([false, true, true], &named(wanted)), Some(0));
        }
    }

    #[test]
    fn auto_never_takes_software_and_names_it() {
        let software = device("llvmpipe", DeviceKind::Software);
        let devices = [(&software, true)];
        assert_eq!(choose(&devices, &Selection::Auto), None);
        let message = why_none(&devices, &Selection::Auto);
        assert!(message.contains("--device can ask for a software one (0: llvmpipe)"), "{message}");
    }

    #[test]
    fn name_matches_in_part_whatever_the_case_and_numbers_are_those_of_the_list() {
        let (card, software) =
            (device("Card", DeviceKind::Discrete), device("llvmpipe", DeviceKind::Software));
        let devices = without_window(&[&card, &software]);
        assert_eq!(choose(&devices, &named("LLVM")), Some(1));
        assert_eq!(choose(&devices, &named("1")), Some(1));
        assert_eq!(choose(&devices, &named("car")), Some(0));
        // A number of none is a part of a name.
        let numbered = device("Card 7", DeviceKind::Discrete);
        assert_eq!(choose(&without_window(&[&software, &numbered]), &named("7")), Some(1));
    }

    #[test]
    fn selector_finds_its_device() {
        let names = ["Card", "Card 2", "card", "7"].map(str::to_owned);
        let selectors = [0, 1, 2, 3].map(|number| selector(&names, number));
        assert_eq!(selectors, ["Card", "Card 2", "2", "3"]);
    }

    #[test]
    fn unknown_name_and_index_list_what_there_is() {
        let software = device("llvmpipe", DeviceKind::Software);
        for wanted in ["radeon", "1"] {
            let devices = without_window(&[&software]);
            assert_eq!(choose(&devices, &named(wanted)), None);
            let message = why_none(&devices, &named(wanted));
            assert!(message.contains(&format!("--device {wanted} (0: llvmpipe)")), "{message}");
        }
    }

    #[test]
    fn no_device_at_all_is_said() {
        let message = why_none(&[], &named("0"));
        assert!(message.contains("no driver offers a device"), "{message}");
    }

    #[test]
    fn device_types_map_to_kinds() {
        assert_eq!(kind(vk::PhysicalDeviceType::DISCRETE_GPU), DeviceKind::Discrete);
        assert_eq!(kind(vk::PhysicalDeviceType::CPU), DeviceKind::Software);
        assert_eq!(kind(vk::PhysicalDeviceType::OTHER), DeviceKind::Software);
    }
}
