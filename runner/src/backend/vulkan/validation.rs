//! What the validation layers say.

use super::instance::InstanceHandle;
use crate::backend::BackendError;
use ash::vk;
use std::borrow::Cow;
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, PoisonError};

/// The layer that checks every call against the specification.
pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// The warnings and errors of the validation layers, in the order in which they came. Clones share one list, so
/// that what is said while a backend is dropped can be read afterwards.
#[derive(Clone, Debug, Default)]
pub struct ValidationLog {
    messages: Arc<Mutex<Vec<String>>>,
}

impl ValidationLog {
    /// What has been said so far; empty where validation is off.
    pub fn messages(&self) -> Vec<String> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn push(&self, message: String) {
        tracing::error!("Vulkan validation: {message}");
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).push(message);
    }
}

/// Sends the layers' messages to a [`ValidationLog`] until it is dropped.
pub(super) struct Messenger {
    functions: ash::ext::debug_utils::Instance,
    raw: vk::DebugUtilsMessengerEXT,
    /// What the callback's user data points to: boxed, so that it stays where it is, and dropped after `drop` has
    /// ended the callbacks.
    _log: Box<ValidationLog>,
}

impl Messenger {
    /// Needs an instance with `VK_EXT_debug_utils`, and must be dropped before it.
    pub(super) fn new(instance: &InstanceHandle, log: &ValidationLog) -> Result<Self, BackendError> {
        let functions = ash::ext::debug_utils::Instance::new(instance.entry(), instance.raw());
        let log = Box::new(log.clone());
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            // The loader reports other machines' drivers as `GENERAL`; only rules that we broke are of interest.
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(on_message))
            .user_data((&raw const *log).cast_mut().cast());
        // SAFETY: the instance has the extension, and `log` outlives the messenger that points to it.
        let raw = unsafe { functions.create_debug_utils_messenger(&info, None) }
            .map_err(|source| BackendError::Vulkan { what: "listening to the validation layers", source })?;
        Ok(Messenger { functions, raw, _log: log })
    }
}

impl Drop for Messenger {
    fn drop(&mut self) {
        // SAFETY: made in `new`, destroyed once; the instance still lives, see `Instance`.
        unsafe { self.functions.destroy_debug_utils_messenger(self.raw, None) };
    }
}

/// Receives one message. Returns `FALSE`: the call that it is about goes on.
///
/// # Safety
/// `data` points to a message and `user_data` to a [`ValidationLog`], both for as long as the call lasts.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the caller's promise; `Messenger` keeps the log that it registered.
    let log = unsafe { user_data.cast::<ValidationLog>().as_ref() };
    // SAFETY: the caller's promise.
    let data = unsafe { data.as_ref() };
    if let (Some(log), Some(data)) = (log, data) {
        // SAFETY: Vulkan's messages are null or end with a zero.
        let message = unsafe { data.message_as_c_str() };
        log.push(message.map_or(Cow::Borrowed("(no text)"), CStr::to_string_lossy).into_owned());
    }
    vk::FALSE
}
