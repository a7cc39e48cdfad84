//! The Vulkan loader and the instance.

use super::validation::{self, Messenger, ValidationLog};
use crate::backend::BackendError;
use ash::vk;
use std::ffi::{CStr, c_char};
use std::path::Path;

/// The version that the kernels are compiled for and that a device must have.
pub(super) const API_VERSION: u32 = vk::API_VERSION_1_2;

/// An instance, with the layers that check it where they were asked for.
pub(super) struct Instance {
    /// Dropped before the instance it listens to.
    _messenger: Option<Messenger>,
    handle: InstanceHandle,
    log: ValidationLog,
}

/// Destroys the instance when dropped.
pub(super) struct InstanceHandle {
    raw: ash::Instance,
    /// The loaded library, which holds the code of every call: dropped last.
    entry: ash::Entry,
}

impl Instance {
    /// Loads Vulkan from the system's library, with `extensions`: those for surfaces of windows, or none.
    pub(super) fn new(validate: bool, extensions: &[*const c_char]) -> Result<Self, BackendError> {
        Self::from_entry(load_entry(None)?, validate, extensions)
    }

    fn from_entry(
        entry: ash::Entry,
        validate: bool,
        extensions: &[*const c_char],
    ) -> Result<Self, BackendError> {
        require_version(&entry)?;
        let log = ValidationLog::default();
        if !validate {
            let info = vk::InstanceCreateInfo::default().enabled_extension_names(extensions);
            let handle = create(entry, &info)?;
            return Ok(Instance { _messenger: None, handle, log });
        }
        require_validation_layer(&entry)?;
        let handle = create_validated(entry, extensions)?;
        let messenger = Messenger::new(&handle, &log)?;
        Ok(Instance { _messenger: Some(messenger), handle, log })
    }

    pub(super) fn raw(&self) -> &ash::Instance {
        &self.handle.raw
    }

    pub(super) fn entry(&self) -> &ash::Entry {
        &self.handle.entry
    }

    pub(super) fn log(&self) -> &ValidationLog {
        &self.log
    }
}

impl InstanceHandle {
    pub(super) fn raw(&self) -> &ash::Instance {
        &self.raw
    }

    pub(super) fn entry(&self) -> &ash::Entry {
        &self.entry
    }
}

impl Drop for InstanceHandle {
    fn drop(&mut self) {
        // SAFETY: made in `create`, destroyed once; devices and the messenger are dropped before.
        unsafe { self.raw.destroy_instance(None) };
    }
}

/// Loads the Vulkan loader, from `library` instead of the system's usual place where one is given.
fn load_entry(library: Option<&Path>) -> Result<ash::Entry, BackendError> {
    let entry = match library {
        // SAFETY: the library's initialisers run; it is trusted like every library that the process links.
        Some(path) => unsafe { ash::Entry::load_from(path) },
        // SAFETY: as above.
        None => unsafe { ash::Entry::load() },
    };
    entry.map_err(|error| BackendError::NoDevice {
        reason: format!("the Vulkan loader could not be loaded ({error})"),
    })
}

fn require_version(entry: &ash::Entry) -> Result<(), BackendError> {
    // SAFETY: takes no handle; `entry` holds the loaded library.
    let version = unsafe { entry.try_enumerate_instance_version() }
        .map_err(|source| BackendError::Vulkan { what: "asking for the loader's version", source })?
        .unwrap_or(vk::API_VERSION_1_0);
    if version >= API_VERSION {
        return Ok(());
    }
    Err(BackendError::NoDevice {
        reason: format!("the Vulkan loader is of version {}, older than 1.2", version_text(version)),
    })
}

fn require_validation_layer(entry: &ash::Entry) -> Result<(), BackendError> {
    // SAFETY: takes no handle; `entry` holds the loaded library.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }
        .map_err(|source| BackendError::Vulkan { what: "listing the layers", source })?;
    find_validation_layer(&layers)
}

fn find_validation_layer(layers: &[vk::LayerProperties]) -> Result<(), BackendError> {
    if layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(validation::LAYER)) {
        Ok(())
    } else {
        Err(BackendError::NoValidation)
    }
}

/// An instance under the validation layers, with synchronisation validation where the layers have it.
fn create_validated(entry: ash::Entry, extensions: &[*const c_char]) -> Result<InstanceHandle, BackendError> {
    // SAFETY: takes no handle; `entry` holds the loaded library.
    let offered = unsafe { entry.enumerate_instance_extension_properties(Some(validation::LAYER)) }
        .map_err(|source| BackendError::Vulkan { what: "listing the layers' extensions", source })?;
    let offers = |name: &CStr| offered.iter().any(|one| one.extension_name_as_c_str() == Ok(name));
    let layers = [validation::LAYER.as_ptr()];
    let mut extensions = extensions.to_vec();
    extensions.push(ash::ext::debug_utils::NAME.as_ptr());
    let mut features = vk::ValidationFeaturesEXT::default()
        .enabled_validation_features(&[vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION]);
    let mut info = vk::InstanceCreateInfo::default().enabled_layer_names(&layers);
    if offers(ash::ext::validation_features::NAME) {
        extensions.push(ash::ext::validation_features::NAME.as_ptr());
        info = info.push_next(&mut features);
    }
    create(entry, &info.enabled_extension_names(&extensions))
}

/// An instance as `info` describes it, for our version of Vulkan.
fn create(entry: ash::Entry, info: &vk::InstanceCreateInfo<'_>) -> Result<InstanceHandle, BackendError> {
    let application = vk::ApplicationInfo::default().application_name(c"emboss").api_version(API_VERSION);
    let info = info.application_info(&application);
    // SAFETY: `info` and what it points to live through the call; the handle destroys it.
    match unsafe { entry.create_instance(&info, None) } {
        Ok(raw) => Ok(InstanceHandle { raw, entry }),
        Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => {
            Err(BackendError::NoDevice { reason: "no Vulkan driver is installed".to_owned() })
        }
        Err(vk::Result::ERROR_EXTENSION_NOT_PRESENT) => {
            let reason = "no driver does so in windows of this system".to_owned();
            Err(BackendError::CannotPresent { reason })
        }
        Err(source) => Err(BackendError::Vulkan { what: "creating the instance", source }),
    }
}

/// `1.2.131` for a packed version.
pub(super) fn version_text(version: u32) -> String {
    format!(
        "{}.{}.{}",
        vk::api_version_major(version),
        vk::api_version_minor(version),
        vk::api_version_patch(version)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_loader_is_no_device() {
        let error = load_entry(Some(Path::new("no-such-vulkan-loader.so"))).err().expect("no such library");
        assert!(matches!(error, BackendError::NoDevice { .. }), "{error}");
        assert!(error.to_string().contains("no-such-vulkan-loader.so"), "{error}");
        assert!(error.to_string().contains("--backend cpu"), "{error}");
    }

    #[test]
    fn missing_layer_names_the_package_to_install() {
        let other = vk::LayerProperties::default().layer_name(c"VK_LAYER_MESA_overlay").unwrap();
        let wanted = vk::LayerProperties::default().layer_name(validation::LAYER).unwrap();
        let message = find_validation_layer(&[other]).unwrap_err().to_string();
        assert!(message.contains("vulkan-validationlayers"), "{message}");
        assert!(find_validation_layer(&[other, wanted]).is_ok());
    }

    #[test]
    fn version_reads_as_numbers() {
        assert_eq!(version_text(vk::make_api_version(0, 1, 3, 230)), "1.3.230");
    }
}
