//! A pipeline holds the code that its scene needs and no other: a committed module, specialised as a driver does it,
//! once with a feature and once without. `spirv-opt` stands in for the driver: it folds the constants and takes
//! out what cannot be reached.

use emboss_kernels::interface::{
    binding, color_format, displacement_kind, filter, height_format, method, normals, shade, wrap,
};
use emboss_kernels::scene::Features;
use rspirv::dr::Operand;
use rspirv::spirv::{Decoration, Word};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::{module, module_path, workspace};

/// Lit, with all that a picture can have.
const ALL: Features = Features {
    method: method::QUADTREE,
    shade: shade::LIT,
    shadows: 1,
    height_format: height_format::UNORM8,
    color_format: color_format::SRGB8,
    height_wrap: 0,
    color_wrap: 0,
    counters: 1,
    normals: normals::NORMALIZED,
    seams: 1,
    smooth: 1,
    displacement: displacement_kind::HEIGHT,
    filter: filter::TRILINEAR,
    adaptive: 0,
    instances: 1,
};

/// What is left of an entry point.
#[derive(Debug)]
struct Code {
    instructions: usize,
    /// The bindings that it reads or writes.
    bindings: BTreeSet<u32>,
}

/// The committed module of an entry point.
fn committed(entry_point: &str) -> PathBuf {
    workspace().join(module_path(entry_point))
}

/// The code of an entry point, specialised.
fn specialized(entry_point: &str, features: Features) -> Code {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("specialized.spv");
    let constants: Vec<String> =
        features.to_array().iter().enumerate().map(|(id, value)| format!("{id}:{value}")).collect();
    let passes = [
        "--freeze-spec-const",
        "--fold-spec-const-op-composite",
        "--ccp",
        "--eliminate-dead-branches",
        "--eliminate-dead-code-aggressive",
    ];
    let mut command = Command::new("spirv-opt");
    command.arg(format!("--set-spec-const-default-value={}", constants.join(" "))).args(passes);
    let ran = command.arg(committed(entry_point)).arg("-o").arg(&output).output();
    let ran = ran.expect("this test needs spirv-opt, which `cargo xtask test packages` installs");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    code(&output)
}

/// The code of a module's entry point, which has all it calls inlined.
fn code(path: &Path) -> Code {
    let module = module::parse(&std::fs::read(path).unwrap()).unwrap();
    let entry = &module.entry_points[0];
    let is_entry = |id: Option<Word>| id == Some(entry.operands[1].unwrap_id_ref());
    let function = module.functions.iter().find(|function| is_entry(function.def_id())).unwrap();
    let read: BTreeSet<Word> = function
        .all_inst_iter()
        .flat_map(|instruction| &instruction.operands)
        .filter_map(|operand| match operand {
            Operand::IdRef(id) => Some(*id),
            _ => None,
        })
        .collect();
    let bound =
        module::decorated(&module, Decoration::Binding).filter(|(variable, _)| read.contains(variable));
    Code {
        instructions: function.all_inst_iter().count(),
        bindings: bound.map(|(_, binding)| binding).collect(),
    }
}

/// Asserts that `with` reads `unread`, and `without` does not.
fn assert_unread(with: &Code, without: &Code, unread: &[u32]) {
    for binding in unread {
        let needed = with.bindings.contains(binding) && !without.bindings.contains(binding);
        assert!(needed, "binding {binding}: {with:?}, {without:?}");
    }
}

#[test]
fn scenes_without_seams_have_no_code_for_them() {
    for method in [method::QUADTREE, method::GRID_WALK, method::BRUTE_FORCE] {
        for entry_point in ["render", "trace_rays"] {
            let [with, without] =
                [1, 0].map(|seams| specialized(entry_point, Features { method, seams, ..ALL }));
            assert_unread(&with, &without, &[binding::SEAMS, binding::SEAM_SIDES]);
            assert!(without.instructions < with.instructions, "{entry_point}: {with:?}, {without:?}");
        }
    }
}

#[test]
fn scenes_without_instances_have_no_code_for_them() {
    let [with, without] = [1, 0].map(|instances| specialized("render", Features { instances, ..ALL }));
    assert_unread(&with, &without, &[binding::INSTANCES]);
    assert!(without.instructions < with.instructions, "{with:?}, {without:?}");
}

#[test]
fn scenes_of_heights_have_no_code_for_vectors() {
    let [vectors, heights] = [displacement_kind::TANGENT, displacement_kind::HEIGHT]
        .map(|displacement| specialized("render", Features { displacement, ..ALL }));
    assert_unread(&vectors, &heights, &[binding::TANGENTS]);
}

#[test]
fn features_that_are_off_leave_no_code() {
    let with = specialized("render", ALL);
    let off: [(Features, &[u32]); 7] = [
        (Features { shadows: 0, ..ALL }, &[]),
        (Features { color_format: color_format::NONE, ..ALL }, &[binding::COLOR_TEXELS]),
        (Features { normals: normals::LINEAR, ..ALL }, &[]),
        (Features { shade: shade::NORMAL, ..ALL }, &[binding::LIGHTS, binding::COLOR_TEXELS]),
        (Features { counters: 0, ..ALL }, &[]),
        (Features { smooth: 0, ..ALL }, &[]),
        (Features { filter: filter::BILINEAR, ..ALL }, &[]),
    ];
    for (features, unread) in off {
        let without = specialized("render", features);
        assert_unread(&with, &without, unread);
        assert!(without.instructions < with.instructions, "{features:?}: {without:?}, {with:?}");
    }
}

/// Where maps are alike a pipeline has no code that asks which of them is how.
#[test]
fn alike_materials_leave_no_code_for_others() {
    let mixed: [Features; 4] = [
        Features { height_format: height_format::PER_MAP, ..ALL },
        Features { height_wrap: wrap::PER_MAP, ..ALL },
        Features { color_format: color_format::PER_MATERIAL, ..ALL },
        Features { color_wrap: wrap::PER_MAP, ..ALL },
    ];
    let alike = specialized("render", ALL).instructions;
    for features in mixed {
        let instructions = specialized("render", features).instructions;
        assert!(alike < instructions, "{features:?}: {alike} {instructions}");
    }
}

/// Of the methods a pipeline holds one.
#[test]
fn methods_that_are_not_chosen_leave_no_code() {
    let [quadtree, grid_walk, brute_force, none] =
        [method::QUADTREE, method::GRID_WALK, method::BRUTE_FORCE, method::NONE]
            .map(|method| specialized("render", Features { method, ..ALL }));
    assert_unread(&quadtree, &grid_walk, &[binding::HEIGHT_RANGES]);
    assert_unread(&quadtree, &none, &[binding::HEIGHT_RANGES, binding::SEAMS, binding::SEAM_SIDES]);
    let all = code(&committed("render")).instructions;
    let own = |method: &Code| method.instructions - none.instructions;
    let sum = own(&quadtree) + own(&grid_walk) + own(&brute_force) + none.instructions;
    assert!(all > sum, "{all} instructions before, {sum} together");
}

/// What a method stores is read by its own pipelines alone.
#[test]
fn other_methods_stores_are_not_read() {
    let [quadtree, tessellate, sphere, inverse, pyramid] =
        [method::QUADTREE, method::TESSELLATE, method::SPHERE, method::INVERSE, method::PYRAMID]
            .map(|method| specialized("render", Features { method, ..ALL }));
    assert_unread(&tessellate, &quadtree, &[binding::MICRO_VERTICES]);
    assert_unread(&sphere, &quadtree, &[binding::DISTANCES]);
    assert_unread(&quadtree, &inverse, &[binding::HEIGHT_RANGES]);
    for (name, code) in
        [("tessellate", &tessellate), ("sphere", &sphere), ("inverse", &inverse), ("pyramid", &pyramid)]
    {
        println!("{name}: {} instructions of {}", code.instructions, quadtree.instructions);
    }
}
