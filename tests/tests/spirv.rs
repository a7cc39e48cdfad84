//! The committed SPIR-V module is the one that its manifest describes, and was made from the present sources.
//! (`cargo xtask spirv --check` compiles it anew and compares the bytes; that needs the SPIR-V toolchain.)

use xtask::manifest::Manifest;
use xtask::{MANIFEST_PATH, MODULE_PATH, REMEDY, module, settings, sources, workspace};

/// The manifest in `assets`.
fn manifest() -> Manifest {
    Manifest::read(&workspace().join(MANIFEST_PATH)).unwrap_or_else(|error| panic!("{error}"))
}

/// The module in `assets`.
fn module_bytes() -> Vec<u8> {
    std::fs::read(workspace().join(MODULE_PATH))
        .unwrap_or_else(|error| panic!("{MODULE_PATH}: {error}; {REMEDY}"))
}

#[test]
fn the_module_was_made_from_the_present_sources() {
    let hash = sources::source_hash(&workspace()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(manifest().source_hash, hash, "{MODULE_PATH} is older than the kernels; {REMEDY}");
}

#[test]
fn the_manifest_describes_the_module() {
    let bytes = module_bytes();
    let manifest = manifest();
    let module = module::parse(&bytes).unwrap_or_else(|error| panic!("{MODULE_PATH}: {error}; {REMEDY}"));
    assert_eq!(manifest.size_bytes, bytes.len(), "{REMEDY}");
    assert_eq!(manifest.contents, module::contents(&module), "{REMEDY}");
    assert_eq!(manifest.rust_gpu, settings::RUST_GPU, "{REMEDY}");
    assert_eq!(manifest.target, settings::TARGET, "{REMEDY}");
}

#[test]
fn the_module_names_no_file_of_the_machine_that_made_it() {
    let module = module::parse(&module_bytes()).unwrap_or_else(|error| panic!("{error}"));
    assert!(module.debug_string_source.is_empty(), "{MODULE_PATH} holds debug information; {REMEDY}");
}

#[test]
fn the_rust_gpu_version_is_the_one_that_cargo_takes() {
    let lock = std::fs::read_to_string(workspace().join("Cargo.lock")).unwrap();
    for package in ["spirv-std", "spirv-builder"] {
        let entry = format!("name = \"{package}\"\nversion = \"{}\"\n", settings::RUST_GPU);
        assert!(
            lock.replace("\r\n", "\n").contains(&entry),
            "settings::RUST_GPU is not Cargo.lock's {package}"
        );
    }
}
