//! The committed SPIR-V modules are those that their manifest describes, and were made from the present sources.
//! (`cargo xtask spirv --check` compiles them anew and compares the bytes; that needs the SPIR-V toolchain.)

use rspirv::dr::{Instruction, Operand};
use rspirv::spirv::{Decoration, Op, Word};
use std::collections::{BTreeMap, HashMap, HashSet};
use xtask::manifest::{Manifest, describe};
use xtask::{MANIFEST_PATH, MODULES_PATH, REMEDY, contraction, module, settings, sources, workspace};

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

/// No driver may fuse a product with a sum or difference: bits would depend on what else uses the product. Counted
/// without the build's own code.
#[test]
fn no_product_feeds_a_sum_that_a_driver_may_fuse() {
    let mut sums_of_products = 0;
    for (entry_point, bytes) in modules() {
        let module = module::parse(&bytes).unwrap_or_else(|error| panic!("{entry_point}: {error}"));
        let no_contraction = Operand::Decoration(Decoration::NoContraction);
        let kept: HashSet<Word> = module
            .annotations
            .iter()
            .filter(|annotation| annotation.operands.contains(&no_contraction))
            .filter_map(|annotation| annotation.operands[0].id_ref_any())
            .collect();
        let by_id: HashMap<Word, &Instruction> =
            module.all_inst_iter().filter_map(|i| Some((i.result_id?, i))).collect();
        // A product, also one whose sign is changed or that is one of several by the way that was taken.
        let is_product = |id: Word| {
            let (mut waiting, mut seen) = (vec![id], HashSet::new());
            while let Some(id) = waiting.pop() {
                let Some(instruction) = by_id.get(&id).filter(|_| seen.insert(id)) else { continue };
                match instruction.class.opcode {
                    Op::FMul | Op::FDiv | Op::VectorTimesScalar => return true,
                    Op::FNegate | Op::Phi | Op::Select | Op::CopyObject | Op::CompositeExtract => {
                        waiting.extend(instruction.operands.iter().filter_map(Operand::id_ref_any));
                    }
                    _ => {}
                }
            }
            false
        };
        for instruction in module.all_inst_iter() {
            let is_sum = matches!(instruction.class.opcode, Op::FAdd | Op::FSub);
            let mut operands = instruction.operands.iter().filter_map(Operand::id_ref_any);
            if is_sum && operands.any(is_product) {
                sums_of_products += 1;
                let id = instruction.result_id.unwrap();
                assert!(kept.contains(&id), "{entry_point}: {instruction:?} may be fused; {REMEDY}");
            }
        }
        assert!(contraction::contractible(&module).is_empty(), "{entry_point}; {REMEDY}");
    }
    assert!(sums_of_products > 500, "{sums_of_products} sums of products");
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
