//! How the kernels are compiled. Everything here goes into the source hash, so that a changed setting makes the
//! committed modules stale just as a changed source does.

use rspirv::spirv::Decoration;

/// Version of rust-gpu: of `spirv-builder`, `spirv-std` and the code generator `rustc_codegen_spirv`.
pub const RUST_GPU: &str = "0.10.0-alpha.1";

/// SPIR-V 1.5 for Vulkan 1.2, with its memory model.
pub const TARGET: &str = "spirv-unknown-vulkan1.2";

/// Capabilities beyond those of the target. The counters are atomics of device scope.
pub const CAPABILITIES: &[&str] = &["VulkanMemoryModelDeviceScope"];

/// What the build decorates all arithmetic of floats with: see [`contraction`](crate::contraction).
pub const DECORATION: Decoration = Decoration::NoContraction;

/// Environment of the compiler that makes the committed modules. The profile is pinned here rather than taken from
/// the workspace, since the host's release profile keeps line tables: rust-gpu would put the text of every source
/// file, and the names of folders of the machine, into the modules (350 KB instead of 12 KB).
pub const RELEASE: &[(&str, &str)] =
    &[("CARGO_PROFILE_RELEASE_OPT_LEVEL", "3"), ("CARGO_PROFILE_RELEASE_DEBUG", "0")];

/// The same for modules with names and lines, to be read in a disassembly or a debugger and never committed.
pub const DEBUG: &[(&str, &str)] =
    &[("CARGO_PROFILE_RELEASE_OPT_LEVEL", "3"), ("CARGO_PROFILE_RELEASE_DEBUG", "2")];
