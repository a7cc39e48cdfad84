//! Which backend renders.

use super::cpu::{self, CpuBackend};
use super::vulkan::{self, Selection, VulkanBackend};
use super::{Backend, BackendError, DeviceInfo};

/// What the user asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BackendChoice {
    /// A graphics card where there is one, else the CPU
    Auto,
    /// A Vulkan device, or an error where there is none
    Vulkan,
    /// The processor
    Cpu,
}

/// Everything that can render, Vulkan devices first and in the order of their numbers; there is always the CPU.
pub fn devices() -> Vec<DeviceInfo> {
    let vulkan = vulkan::devices().unwrap_or_else(|error| {
        tracing::info!("{error}");
        Vec::new()
    });
    vulkan.into_iter().chain([cpu::device_info()]).collect()
}

/// The backend of a choice. `device` names a Vulkan device by number or part of its name: with it, `Auto` takes
/// that device or fails, since silently rendering on another is not what was asked for. Without it, `Auto` takes the
/// CPU where no device can be opened, and says so; validation layers that were asked for and are missing are an error.
pub fn open_backend(
    choice: BackendChoice,
    device: Option<&str>,
    validate: bool,
) -> Result<Box<dyn Backend>, BackendError> {
    if choice == BackendChoice::Cpu {
        return Ok(Box::new(CpuBackend::new()));
    }
    match open_vulkan(device, validate) {
        Err(error) if choice == BackendChoice::Auto && device.is_none() && can_be_replaced(&error) => {
            tracing::info!("rendering on the CPU: {error}");
            Ok(Box::new(CpuBackend::new()))
        }
        opened => opened,
    }
}

/// Whether the CPU is a fair answer to an error. It has no validation layers.
pub(crate) fn can_be_replaced(error: &BackendError) -> bool {
    !matches!(error, BackendError::NoValidation)
}

fn open_vulkan(device: Option<&str>, validate: bool) -> Result<Box<dyn Backend>, BackendError> {
    Ok(Box::new(VulkanBackend::new(&selection(device), validate)?))
}

/// The device that a user names, or the best.
pub(crate) fn selection(device: Option<&str>) -> Selection {
    device.map_or(Selection::Auto, |device| Selection::Named(device.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cpu_is_always_listed_last() {
        let devices = devices();
        assert_eq!(devices.last().map(|device| device.backend), Some("cpu"));
        assert_eq!(devices.iter().filter(|device| device.backend == "cpu").count(), 1);
    }

    /// Whatever this machine has: a device of this name it has not.
    #[test]
    fn a_device_asked_for_is_not_replaced() {
        for choice in [BackendChoice::Auto, BackendChoice::Vulkan] {
            let error = open_backend(choice, Some("no such device"), false).err();
            assert!(matches!(error, Some(BackendError::NoDevice { .. })), "{choice:?}: {error:?}");
        }
    }

    #[test]
    fn auto_always_has_an_answer() {
        assert!(open_backend(BackendChoice::Auto, None, false).is_ok());
        let cpu = open_backend(BackendChoice::Cpu, None, false).expect("there is always the CPU");
        assert_eq!(cpu.device().backend, "cpu");
    }
}
