//! Devices and windows that fail under the whole program, by a [layer](emboss_faults) between it and lavapipe: what it
//! says, what it keeps, and how it ends.
#![cfg(target_os = "linux")]

#[path = "../viewer/harness.rs"]
#[expect(dead_code, reason = "it is for the tests of the viewer too")]
mod harness;
mod vulkan;
