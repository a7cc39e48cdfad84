//! What the build steps and the tests both know: what decides the bytes of `assets/kernels.spv`, and what the
//! module beside it says of itself.
#![forbid(unsafe_code)]

pub mod manifest;
pub mod module;
pub mod settings;
pub mod sources;

use std::path::PathBuf;

/// The SPIR-V module of all kernels, relative to the workspace.
pub const MODULE_PATH: &str = "assets/kernels.spv";
/// Its manifest.
pub const MANIFEST_PATH: &str = "assets/kernels.json";
/// What to run where the module is not what the sources give.
pub const REMEDY: &str = "run `cargo xtask spirv` and commit both files";

/// The workspace's folder, as it was when this crate was compiled.
pub fn workspace() -> PathBuf {
    let mut folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    folder.pop();
    folder
}
