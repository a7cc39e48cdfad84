//! A pipeline holds the code that its scene needs and no other: a committed module, specialised, once with a feature and
//! once without.

use emboss::backend::vulkan::specialize::specialize;
use emboss_kernels::interface::{
    binding, color_format, displacement_kind, filter, height_format, method, normals, shade, wrap,
};
use emboss_kernels::scene::Features;
use rspirv::dr::Operand;
use rspirv::spirv::{Decoration, Word};
use std::collections::BTreeSet;
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

/// The code of an entry point, which has all it calls inlined, specialised.
fn specialized(entry_point: &str, features: Features) -> Code {
    let committed = std::fs::read(workspace().join(module_path(entry_point))).unwrap();
    let words: Vec<u32> =
        committed.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    let module = rspirv::dr::load_words(specialize(&words, &features.to_array()).unwrap()).unwrap();
    let function = &module.functions[0];
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
    let committed = module::parse(&std::fs::read(workspace().join(module_path("render"))).unwrap()).unwrap();
    let all = committed.functions[0].all_inst_iter().count();
    let own = |method: &Code| method.instructions - none.instructions;
    let sum = own(&quadtree) + own(&grid_walk) + own(&brute_force) + none.instructions;
    assert!(all > sum, "{all} instructions before, {sum} together");
    for method in 0..=method::SPHERE {
        let one = specialized("render", Features { method, ..ALL }).instructions;
        assert!(3 * one < all, "method {method}: {one} of {all} instructions");
    }
}

/// What a method stores is read by its own pipelines alone.
#[test]
fn other_methods_stores_are_not_read() {
    let [quadtree, tessellate, sphere, inverse] =
        [method::QUADTREE, method::TESSELLATE, method::SPHERE, method::INVERSE]
            .map(|method| specialized("render", Features { method, ..ALL }));
    assert_unread(&tessellate, &quadtree, &[binding::MICRO_VERTICES]);
    assert_unread(&sphere, &quadtree, &[binding::DISTANCES]);
    assert_unread(&quadtree, &inverse, &[binding::HEIGHT_RANGES]);
    let [normal_map, steep] =
        [method::NORMAL_MAP, method::STEEP].map(|method| specialized("render", Features { method, ..ALL }));
    assert_unread(&normal_map, &quadtree, &[binding::NORMAL_TEXELS]);
    assert_unread(&quadtree, &steep, &[binding::HEIGHT_RANGES]);
}
