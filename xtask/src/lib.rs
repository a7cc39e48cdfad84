//! What the build steps and the tests both know: what decides the bytes of the SPIR-V modules in `assets/kernels`,
//! and what the modules say of themselves.
#![forbid(unsafe_code)]

pub mod contraction;
pub mod manifest;
pub mod module;
pub mod settings;
pub mod sources;

use std::path::PathBuf;

/// The folder of the kernels' SPIR-V modules, one for each entry point, relative to the workspace.
pub const MODULES_PATH: &str = "assets/kernels";
/// Their manifest.
pub const MANIFEST_PATH: &str = "assets/kernels.json";
/// What to run where the modules are not what the sources give.
pub const REMEDY: &str = "run `cargo xtask spirv` and commit assets/kernels and its manifest";

/// Where the module of an entry point lies, relative to the workspace.
pub fn module_path(entry_point: &str) -> String {
    format!("{MODULES_PATH}/{entry_point}.spv")
}

/// The workspace's folder, as it was when this crate was compiled.
pub fn workspace() -> PathBuf {
    // Cargo says where it runs this. What it said when it compiled it is of another copy of the workspace where two
    // share a target directory.
    let here = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    let mut folder = PathBuf::from(here);
    folder.pop();
    folder
}
