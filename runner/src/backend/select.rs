//! Which backend renders.

use super::cpu::{self, CpuBackend};
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

/// Everything that can render, Vulkan devices first; there is always the CPU.
pub fn devices() -> Vec<DeviceInfo> {
    vec![cpu::device_info()]
}

/// The backend of a choice. `device` names a Vulkan device by number or part of its name: with it, `Auto` takes
/// that device or fails, since silently rendering on another is not what was asked for.
pub fn open_backend(
    choice: BackendChoice,
    device: Option<&str>,
    validate: bool,
) -> Result<Box<dyn Backend>, BackendError> {
    if choice == BackendChoice::Cpu {
        return Ok(Box::new(CpuBackend::new()));
    }
    match open_vulkan(device, validate) {
        Err(BackendError::NoDevice { reason }) if choice == BackendChoice::Auto && device.is_none() => {
            tracing::info!("no graphics card to use ({reason}): rendering on the CPU");
            Ok(Box::new(CpuBackend::new()))
        }
        opened => opened,
    }
}

/// To be connected with the Vulkan backend.
fn open_vulkan(_device: Option<&str>, _validate: bool) -> Result<Box<dyn Backend>, BackendError> {
    Err(BackendError::NoDevice { reason: "this build has no Vulkan backend".to_owned() })
}
