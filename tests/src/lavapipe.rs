//! The software Vulkan device that tests dispatch on, under the validation layers.

use emboss::backend::vulkan::{Selection, VulkanBackend};

/// Part of the name that lavapipe gives itself.
const NAME: &str = "llvmpipe";

/// A backend of its own on lavapipe, under the validation layers. To be handed to [`finish`].
///
/// Any number can be open at a time: each has its own instance and device.
///
/// # Panics
/// Where lavapipe or the layers are missing. A test that is skipped proves nothing.
#[must_use = "a test passes on to `finish`, which looks at the validation messages"]
pub fn lavapipe() -> VulkanBackend {
    match VulkanBackend::new(&Selection::Named(NAME.to_owned()), true) {
        Ok(backend) => backend,
        Err(error) => panic!(
            "this test needs lavapipe and the Vulkan validation layers, which `cargo xtask test` installs: {error}"
        ),
    }
}

/// Drops the backend, and fails where the validation layers had anything to say of its life or its end.
///
/// # Panics
/// With their messages.
pub fn finish(backend: VulkanBackend) {
    let log = backend.validation_log();
    drop(backend);
    let messages = log.messages();
    assert!(messages.is_empty(), "the validation layers say:\n{}", messages.join("\n"));
}
