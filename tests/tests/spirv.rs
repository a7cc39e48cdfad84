//! The committed SPIR-V modules are those that their manifest describes, and were made from the present sources.
//! (`cargo xtask spirv --check` compiles them anew and compares the bytes; that needs the SPIR-V toolchain.)

use std::collections::BTreeMap;
use xtask::manifest::{Manifest, describe};
use xtask::{MANIFEST_PATH, MODULES_PATH, REMEDY, module, settings, sources, workspace};

/// The manifest in `assets`.
fn manifest() -> Manifest {
    Manifest::read(&workspace().join(MANIFEST_PATH)).unwrap_or_else(|error| panic!("{error}"))
}

/// The modules in `assets` by their entry points.
fn modules() -> BTreeMap<String, Vec<u8>> {
    module::read_all(&workspace().join(MODULES_PATH)).unwrap_or_else(|error| panic!("{error}; {REMEDY}"))
}

#[test]
fn the_modules_were_made_from_the_present_sources() {
    let hash = sources::source_hash(&workspace()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(manifest().source_hash, hash, "{MODULES_PATH} is older than the kernels; {REMEDY}");
    // The program reads it by itself, and knows by it what it has kept from other kernels.
    assert_eq!(emboss::backend::kernels_hash(), hash);
}

#[test]
fn the_manifest_describes_the_modules() {
    let manifest = manifest();
    let described = describe(&modules()).unwrap_or_else(|error| panic!("{error}; {REMEDY}"));
    assert_eq!(manifest.modules, described, "{REMEDY}");
    assert_eq!(manifest.rust_gpu, settings::RUST_GPU, "{REMEDY}");
    assert_eq!(manifest.target, settings::TARGET, "{REMEDY}");
}

#[test]
fn the_modules_name_no_file_of_the_machine_that_made_them() {
    for (entry_point, bytes) in modules() {
        let module = module::parse(&bytes).unwrap_or_else(|error| panic!("{entry_point}: {error}"));
        assert!(module.debug_string_source.is_empty(), "{entry_point} holds debug information; {REMEDY}");
    }
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
