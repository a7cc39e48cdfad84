//! A pipeline holds the code that its scene needs and no other: a committed module, specialised, once with a feature
//! and once without.

use emboss::backend::Backend;
use emboss::backend::vulkan::specialize::specialize;
use emboss::settings::{Method, Settings};
use emboss_kernels::interface::{
    binding, color_format, displacement_kind, filter, height_format, method, normals, shade, wrap,
};
use emboss_kernels::scene::Features;
use emboss_tests::scenes;
use emboss_tests::{finish, lavapipe};
use rspirv::binary::Assemble;
use rspirv::dr::{Module, Operand};
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
    bounds: 0,
};

/// What is left of an entry point.
#[derive(Debug)]
struct Code {
    instructions: usize,
    /// The bindings that it reads or writes.
    bindings: BTreeSet<u32>,
}

/// What is left of a committed module, and the first id that it did not have before.
fn left(entry_point: &str, features: Features) -> (Module, Word) {
    let committed = std::fs::read(workspace().join(module_path(entry_point))).unwrap();
    let words: Vec<u32> =
        committed.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    let module = rspirv::dr::load_words(specialize(&words, &features.to_array()).unwrap()).unwrap();
    // The header's fourth word is the bound of ids.
    (module, words[3])
}

/// The code of an entry point, which has all it calls inlined, specialised.
fn specialized(entry_point: &str, features: Features) -> Code {
    let (module, _) = left(entry_point, features);
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

/// Instructions keep their ids when a module is specialised, so that pipelines can be compared: each method has some
/// that no other's pipeline has, but `bump`, which is also the last step of `parallax`. And the exact method's pipeline
/// has hardly anything of what methods in image space have beside the code for no method: what reads a texel.
#[test]
fn methods_have_code_that_no_other_pipeline_has() {
    let all: Vec<BTreeSet<Word>> = (0..=method::SPHERE)
        .map(|method| {
            let (module, bound) = left("render", Features { method, ..ALL });
            let ids = module.functions[0].all_inst_iter().filter_map(|instruction| instruction.result_id);
            ids.filter(|&id| id < bound).collect()
        })
        .collect();
    for (method, own) in (0..).zip(&all) {
        let others = || all.iter().zip(0..).filter(|&(_, other)| other != method);
        let alone = own.iter().filter(|id| others().all(|(ids, _)| !ids.contains(id))).count();
        assert!(
            (alone > 0) == (method != method::BUMP),
            "method {method}: {alone} of {} instructions",
            own.len()
        );
        if method::is_image_space(method) {
            let added: Vec<_> = own.difference(&all[method::NONE as usize]).collect();
            let shared = added.iter().filter(|id| all[method::QUADTREE as usize].contains(id)).count();
            assert!(10 * shared < added.len(), "method {method}: {shared} of {}", added.len());
        }
    }
}

/// What a backend says of its pipelines is what is left for the features of the scene that it has now.
#[test]
fn backends_know_the_code_of_their_pipelines() {
    let mut backend = lavapipe();
    let mut instructions = [0; 2];
    for (method, counted) in [Method::Quadtree, Method::None].into_iter().zip(&mut instructions) {
        let settings = Settings { width: 4, height: 3, method, ..Settings::default() };
        let (scene, _) = scenes::builtin_scene("builtin:quilt", 2, 4, 3);
        let job = scenes::job(scene, &settings);
        backend.load(&job.buffers, &job.frame, job.features).unwrap();
        let pipelines = backend.pipelines();
        let of = |kernel| pipelines.iter().filter(|code| code.kernel == kernel).collect::<Vec<_>>();
        let [render] = of("render")[..] else { panic!("{pipelines:?}") };
        let (module, _) = left("render", job.features);
        assert_eq!(render.instructions as usize, module.functions[0].all_inst_iter().count());
        assert_eq!(render.bytes, 4 * module.assemble().len() as u64);
        let committed = std::fs::metadata(workspace().join(module_path("render"))).unwrap();
        assert_eq!(render.bytes_of_all, committed.len());
        assert!(of("tessellate").is_empty() && !of("height_pyramid").is_empty(), "{pipelines:?}");
        *counted = render.instructions;
    }
    // Far below: no search for the relief, none of its normals.
    assert!(2 * instructions[1] < instructions[0], "{instructions:?}");
    finish(backend);
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
