//! Every struct that host and kernels share has one layout: sizes, offsets and strides that the compiled modules
//! state are those of the host's structs, and the numbers in attributes of `entry.rs` are the interface's constants.
//!
//! The modules carry no names, so a struct is found by the binding or the entry point that uses it, and compared
//! number by number: what lies at which offset, a float or an integer.

use emboss_kernels::bvh::scan::GROUP_SIZE;
use emboss_kernels::bvh::{morton, refit, small, top};
use emboss_kernels::interface::{
    BATCH_GROUP_SIZE, Batch, BuildStep, BvhNode, Camera, Counter, Displacement, FilmPixel, Frame, Instance,
    Intersection, Material, PointLight, PyramidPart, Ray, SeamSide, Seams, SortPass, TILE_GROUP_SIZE,
    Tangent, TexelScale, Tiles, Triangle, Vertex, binding, spec,
};
use glam::{UVec4, Vec3, Vec4};
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};
use std::collections::{BTreeMap, BTreeSet};
use std::mem::offset_of;
use xtask::module::Contents;
use xtask::{MODULES_PATH, REMEDY, module, workspace};

/// Push constants that every Vulkan device has room for, in bytes.
const PUSH_CONSTANTS_GUARANTEED: usize = 128;

/// What a word of a buffer is read as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Float,
    Unsigned,
}

/// A 32-bit number in a struct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Number {
    offset: usize,
    kind: Kind,
}

/// The numbers of a struct in the order of its fields, and its size in an array.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Layout {
    numbers: Vec<Number>,
    /// Distance of neighbours in an array; none where there is only one.
    stride: Option<usize>,
}

// --- The host's side -------------------------------------------------------------------------------------------

/// A type that host and kernels share.
trait Shared: Sized {
    /// Its numbers in the order of its fields.
    fn numbers() -> Vec<Number>;

    /// The layout of a buffer that holds one.
    fn one() -> Layout {
        Layout { numbers: Self::numbers(), stride: None }
    }

    /// The layout of a buffer that holds many.
    fn many() -> Layout {
        Layout { numbers: Self::numbers(), stride: Some(size_of::<Self>()) }
    }
}

impl Shared for f32 {
    fn numbers() -> Vec<Number> {
        vec![Number { offset: 0, kind: Kind::Float }]
    }
}

impl Shared for u32 {
    fn numbers() -> Vec<Number> {
        vec![Number { offset: 0, kind: Kind::Unsigned }]
    }
}

impl<T: Shared, const N: usize> Shared for [T; N] {
    fn numbers() -> Vec<Number> {
        (0..N).flat_map(|i| shifted(T::numbers(), i * size_of::<T>())).collect()
    }
}

impl Shared for Vec3 {
    fn numbers() -> Vec<Number> {
        <[f32; 3]>::numbers()
    }
}

impl Shared for Vec4 {
    fn numbers() -> Vec<Number> {
        <[f32; 4]>::numbers()
    }
}

impl Shared for UVec4 {
    fn numbers() -> Vec<Number> {
        <[u32; 4]>::numbers()
    }
}

/// Implements [`Shared`] for a struct from the names of its fields; one left out does not compile.
macro_rules! shared {
    ($($name:ident { $($field:ident),* })*) => {$(
        impl Shared for $name {
            fn numbers() -> Vec<Number> {
                let _every_field_is_named = |$name { $($field: _),* }: $name| ();
                [$(field(offset_of!($name, $field), |whole: $name| whole.$field)),*].concat()
            }
        }
    )*};
}

shared! {
    Vertex { position, u, normal, v }
    Triangle { vertices, flags, height_min, height_max, displacement, seams }
    Seams {
        directions, heights, flags, first_side, side_count, height_min, height_max, first_reading, reading_count
    }
    SeamSide { start, end, displacement, vertices }
    Tangent { direction, sign }
    TexelScale { size, span }
    BvhNode { min, first, max, count }
    PointLight { position, intensity, color, padding }
    Camera { eye, padding0, right, padding1, up, padding2, forward, padding3 }
    Material { albedo, color_format, color_width, color_height, color_wrap, first_word }
    Displacement {
        scale, zero, map_width, map_height, height_min, height_max, first_word, first_range, format, wrap,
        roughness
    }
    Frame {
        camera, width, height, seed, light_count, background, background_alpha, ambient, triangle_count, steps_scale,
        subdivisions, height_min, height_max, detail, padding
    }
    Tiles { first, count, spread, sample }
    Batch { first, count, kernel }
    PyramidPart { displacement, level, first, count }
    BuildStep { count, limbs, level, level_limit }
    SortPass { count, limbs, shift, from }
    FilmPixel { radiance, alpha, samples }
    Counter { low, high }
    Ray { origin, t_max, direction, padding }
    Intersection { point, t, normal, primitive, point_error, cell, b1, b2, u, v, instance, padding }
    Instance { world_from_object, object_from_world, first_node, first_triangle, triangle_count, stretch }
}

/// The numbers of a field; its type is that of what `_read` returns.
fn field<S, T: Shared>(offset: usize, _read: fn(S) -> T) -> Vec<Number> {
    shifted(T::numbers(), offset)
}

/// Numbers moved by an offset.
fn shifted(mut numbers: Vec<Number>, by: usize) -> Vec<Number> {
    for number in &mut numbers {
        number.offset += by;
    }
    numbers
}

/// What the host binds, by the constants of the interface.
fn host_buffers() -> [(u32, Layout); binding::COUNT as usize] {
    [
        (binding::FRAME, Frame::one()),
        (binding::VERTICES, Vertex::many()),
        (binding::TRIANGLES, Triangle::many()),
        (binding::NODES, BvhNode::many()),
        (binding::PRIMITIVES, u32::many()),
        (binding::DISPLACEMENTS, Displacement::many()),
        (binding::HEIGHT_TEXELS, u32::many()),
        (binding::HEIGHT_RANGES, u32::many()),
        (binding::SEAMS, Seams::many()),
        (binding::SEAM_SIDES, SeamSide::many()),
        (binding::COLOR_TEXELS, u32::many()),
        (binding::LIGHTS, PointLight::many()),
        (binding::FILM, FilmPixel::many()),
        (binding::PICTURE, Vec4::many()),
        (binding::COUNTERS, Counter::many()),
        (binding::RAYS, Ray::many()),
        (binding::INTERSECTIONS, Intersection::many()),
        (binding::PROBE_IN, u32::many()),
        (binding::PROBE_OUT, u32::many()),
        (binding::SORT_KEYS, u32::many()),
        (binding::SORT_VALUES, u32::many()),
        (binding::SORT_COUNTS, u32::many()),
        (binding::SCAN_VALUES, u32::many()),
        (binding::SCAN_SUMS, u32::many()),
        (binding::BOXES, f32::many()),
        (binding::BUILD_STATE, u32::many()),
        (binding::SPLIT_LEVELS, u32::many()),
        (binding::ARRIVALS, u32::many()),
        (binding::PARENTS, u32::many()),
        (binding::TREELETS, u32::many()),
        (binding::TASKS, u32::many()),
        (binding::BINS, u32::many()),
        (binding::TREELET_TASKS, u32::many()),
        (binding::TASK_QUEUES, u32::many()),
        (binding::SMALL_TASKS, u32::many()),
        (binding::TREELET_LISTS, u32::many()),
        // Floats, which the kernel writes as words.
        (binding::COSTS, u32::many()),
        (binding::MATERIALS, Material::many()),
        (binding::TANGENTS, Tangent::many()),
        (binding::TEXEL_SCALES, TexelScale::many()),
        (binding::INSTANCES, Instance::many()),
        (binding::NORMAL_TEXELS, u32::many()),
        (binding::MICRO_VERTICES, f32::many()),
        (binding::DISTANCES, f32::many()),
        (binding::PRISM_TREE, UVec4::many()),
    ]
}

/// The layout that a kernel gives what the host binds. Those of the BVH's build write nodes word by word.
fn expected_layout(entry_point: &str, (number, host): (u32, Layout)) -> Layout {
    if number == binding::NODES && entry_point.starts_with("bvh_") { u32::many() } else { host }
}

// --- The modules' side -----------------------------------------------------------------------------------------

/// The modules in `assets` by their entry points.
fn compiled() -> BTreeMap<String, Module> {
    let files = module::read_all(&workspace().join(MODULES_PATH));
    let files = files.unwrap_or_else(|error| panic!("{error}; {REMEDY}"));
    let parse = |(entry_point, bytes): (String, Vec<u8>)| match module::parse(&bytes) {
        Ok(module) => (entry_point, module),
        Err(error) => panic!("{entry_point}: {error}; {REMEDY}"),
    };
    files.into_iter().map(parse).collect()
}

/// What each module says of itself.
fn contents() -> BTreeMap<String, Contents> {
    let of = |(entry_point, module): (String, Module)| match module::contents(&module, &entry_point) {
        Ok(contents) => (entry_point, contents),
        Err(error) => panic!("{error}; {REMEDY}"),
    };
    compiled().into_iter().map(of).collect()
}

/// The type, constant or variable with an id.
fn global(module: &Module, id: Word) -> &Instruction {
    let mut globals = module.types_global_values.iter();
    globals.find(|global| global.result_id == Some(id)).unwrap_or_else(|| panic!("%{id} is not declared"))
}

/// The id in an instruction's operand.
fn id(instruction: &Instruction, operand: usize) -> Word {
    instruction.operands[operand].unwrap_id_ref()
}

/// The number in an instruction's operand.
fn literal(instruction: &Instruction, operand: usize) -> usize {
    instruction.operands[operand].unwrap_literal_bit32() as usize
}

/// The layout of the block that a variable points to.
fn layout_of_variable(module: &Module, variable: &Instruction) -> Layout {
    let pointer = global(module, variable.result_type.unwrap());
    let block = global(module, id(pointer, 1));
    // rust-gpu wraps what a binding holds in a block of one member.
    assert_eq!(block.operands.len(), 1, "a block of one member");
    assert_eq!(member_offset(module, block.result_id.unwrap(), 0), 0);
    let content = global(module, id(block, 0));
    match content.class.opcode {
        Op::TypeRuntimeArray => {
            Layout { numbers: numbers(module, id(content, 0)), stride: Some(array_stride(module, content)) }
        }
        _ => Layout { numbers: numbers(module, content.result_id.unwrap()), stride: None },
    }
}

/// The numbers of a type in the order of its members.
fn numbers(module: &Module, type_id: Word) -> Vec<Number> {
    let declared = global(module, type_id);
    let repeated = |count: usize, stride: usize| {
        let element = numbers(module, id(declared, 0));
        (0..count).flat_map(|i| shifted(element.clone(), i * stride)).collect()
    };
    match (declared.class.opcode, &declared.operands[..]) {
        (Op::TypeFloat, [Operand::LiteralBit32(32), ..]) => f32::numbers(),
        (Op::TypeInt, [Operand::LiteralBit32(32), Operand::LiteralBit32(0)]) => u32::numbers(),
        (Op::TypeVector, _) => repeated(literal(declared, 1), size_of::<f32>()),
        (Op::TypeArray, _) => {
            repeated(literal(global(module, id(declared, 1)), 0), array_stride(module, declared))
        }
        (Op::TypeStruct, members) => (0..members.len())
            .flat_map(|i| shifted(numbers(module, id(declared, i)), member_offset(module, type_id, i)))
            .collect(),
        (other, operands) => panic!("a buffer holds {other:?} {operands:?}, which no host struct has"),
    }
}

/// The decorated stride of an array.
fn array_stride(module: &Module, array: &Instruction) -> usize {
    let mut strides = module::decorated(module, Decoration::ArrayStride);
    let (_, stride) =
        strides.find(|(target, _)| Some(*target) == array.result_id).expect("arrays have a stride");
    stride as usize
}

/// The decorated offset of a struct's member.
fn member_offset(module: &Module, structure: Word, member: usize) -> usize {
    let offset = module.annotations.iter().find_map(|annotation| match annotation.operands[..] {
        [
            Operand::IdRef(target),
            Operand::LiteralBit32(index),
            Operand::Decoration(Decoration::Offset),
            Operand::LiteralBit32(offset),
        ] if target == structure && index as usize == member => Some(offset),
        _ => None,
    });
    offset.expect("members of blocks have an offset") as usize
}

/// The variables that are bound to a binding.
fn bound(module: &Module, binding: u32) -> impl Iterator<Item = &Instruction> {
    let bound = module::decorated(module, Decoration::Binding).filter(move |(_, number)| *number == binding);
    bound.map(|(variable, _)| global(module, variable))
}

/// The push constants that the entry point reads, if it does.
fn push_constants(module: &Module) -> Option<Layout> {
    let entry = &module.entry_points[0];
    let mut interface = (3..entry.operands.len()).map(|i| global(module, id(entry, i)));
    let block = interface.find(|variable| {
        variable.operands.first() == Some(&Operand::StorageClass(StorageClass::PushConstant))
    })?;
    Some(layout_of_variable(module, block))
}

/// Bindings of entry points whose layout is not the host's, with what it is and what it should be.
fn differing_bindings(modules: &BTreeMap<String, Module>) -> Vec<(&str, u32, Layout, Layout)> {
    let mut differing = Vec::new();
    for (entry_point, module) in modules {
        for buffer in host_buffers() {
            let number = buffer.0;
            let expected = expected_layout(entry_point, buffer);
            for variable in bound(module, number) {
                let layout = layout_of_variable(module, variable);
                if layout != expected {
                    differing.push((entry_point.as_str(), number, layout, expected.clone()));
                }
            }
        }
    }
    differing
}

// --- The tests -------------------------------------------------------------------------------------------------

#[test]
fn buffers_have_the_layout_of_the_hosts_structs() {
    assert_eq!(differing_bindings(&compiled()), []);
}

#[test]
fn every_binding_of_the_interface_is_used_and_no_other() {
    let expected: BTreeSet<u32> = (0..binding::COUNT).collect();
    let used: BTreeSet<u32> = contents().into_values().flat_map(|contents| contents.bindings).collect();
    assert_eq!(used, expected);
    for module in compiled().values() {
        assert!(module::decorated(module, Decoration::DescriptorSet).all(|(_, set)| set == 0));
    }
    assert_eq!(host_buffers().map(|(number, _)| number).into_iter().collect::<BTreeSet<_>>(), expected);
}

#[test]
fn every_specialisation_constant_of_the_interface_is_used_and_no_other() {
    let used = contents().into_values().flat_map(|contents| contents.spec_constants.into_keys());
    assert_eq!(used.collect::<BTreeSet<_>>(), (0..spec::COUNT).collect());
}

#[test]
fn push_constants_have_the_layout_of_the_hosts_structs() {
    let expected = [
        ("bound_heights", Some(Batch::one())),
        ("bvh_centers", Some(BuildStep::one())),
        ("bvh_choose", Some(BuildStep::one())),
        ("bvh_codes", Some(BuildStep::one())),
        ("bvh_costs", None),
        ("bvh_flags", Some(BuildStep::one())),
        ("bvh_levels", Some(BuildStep::one())),
        ("bvh_move", Some(BuildStep::one())),
        ("bvh_refit", None),
        ("bvh_singles", Some(BuildStep::one())),
        ("bvh_small", Some(BuildStep::one())),
        ("bvh_start", None),
        ("bvh_threshold", Some(BuildStep::one())),
        ("bvh_treelets", Some(BuildStep::one())),
        ("count_digits", Some(SortPass::one())),
        ("decide_seams", Some(Batch::one())),
        ("distance_columns", Some(Batch::one())),
        ("distance_map", Some(Batch::one())),
        ("height_pyramid", Some(PyramidPart::one())),
        ("prism_bounds", Some(Batch::one())),
        ("probe", Some(Batch::one())),
        ("render", Some(Tiles::one())),
        ("resolve", Some(Tiles::one())),
        ("scan_blocks", Some(u32::one())),
        ("scan_serially", Some(u32::one())),
        ("scatter_pairs", Some(SortPass::one())),
        ("sum_blocks", Some(u32::one())),
        ("tessellate", Some(Batch::one())),
        ("tessellate_bounds", Some(Batch::one())),
        ("trace_rays", Some(Batch::one())),
        ("tree_blocks", Some(Batch::one())),
        ("tree_frames", Some(Batch::one())),
        ("tree_micro_vertices", Some(Batch::one())),
        ("tree_nodes", Some(Batch::one())),
        ("tree_upper_nodes", Some(Batch::one())),
    ];
    let modules = compiled();
    let found: Vec<_> =
        modules.iter().map(|(name, module)| (name.as_str(), push_constants(module))).collect();
    assert_eq!(found, expected);
    let sizes = [
        size_of::<Tiles>(),
        size_of::<Batch>(),
        size_of::<PyramidPart>(),
        size_of::<SortPass>(),
        size_of::<BuildStep>(),
    ];
    assert!(sizes.into_iter().all(|bytes| bytes <= PUSH_CONSTANTS_GUARANTEED));
}

#[test]
fn entry_points_have_the_workgroups_of_the_interface() {
    let contents = contents();
    let workgroups: Vec<_> =
        contents.iter().map(|(name, contents)| (name.as_str(), contents.workgroup)).collect();
    let tile = [TILE_GROUP_SIZE, TILE_GROUP_SIZE, 1];
    let batch = [BATCH_GROUP_SIZE, 1, 1];
    let block = [GROUP_SIZE, 1, 1];
    let morton = [morton::GROUP_SIZE, 1, 1];
    let top = [top::GROUP_SIZE, 1, 1];
    let moves = [top::MOVE_GROUP_SIZE, 1, 1];
    let refit = [refit::GROUP_SIZE, 1, 1];
    let expected = [
        ("bound_heights", batch),
        ("bvh_centers", morton),
        ("bvh_choose", top),
        ("bvh_codes", batch),
        ("bvh_costs", refit),
        ("bvh_flags", batch),
        ("bvh_levels", morton),
        ("bvh_move", moves),
        ("bvh_refit", batch),
        ("bvh_singles", batch),
        ("bvh_small", [small::GROUP_SIZE, 1, 1]),
        ("bvh_start", moves),
        ("bvh_threshold", [1, 1, 1]),
        ("bvh_treelets", batch),
        ("count_digits", block),
        ("decide_seams", batch),
        ("distance_columns", batch),
        ("distance_map", batch),
        ("height_pyramid", batch),
        ("prism_bounds", batch),
        ("probe", batch),
        ("render", tile),
        ("resolve", tile),
        ("scan_blocks", block),
        ("scan_serially", block),
        ("scatter_pairs", block),
        ("sum_blocks", block),
        ("tessellate", batch),
        ("tessellate_bounds", batch),
        ("trace_rays", batch),
        ("tree_blocks", batch),
        ("tree_frames", batch),
        ("tree_micro_vertices", batch),
        ("tree_nodes", batch),
        ("tree_upper_nodes", batch),
    ];
    assert_eq!(workgroups, expected);
}

/// The compiled modules with another value for every decoration for which `change` returns one.
fn changed(change: impl Fn(&[Operand]) -> Option<u32>) -> BTreeMap<String, Module> {
    let mut modules = compiled();
    for annotation in modules.values_mut().flat_map(|module| &mut module.annotations) {
        if let Some(value) = change(&annotation.operands) {
            annotation.operands.pop();
            annotation.operands.push(Operand::LiteralBit32(value));
        }
    }
    modules
}

/// Whether `trace_rays` is among the entry points whose rays lie differently than the host's.
fn rays_differ(modules: &BTreeMap<String, Module>) -> bool {
    let differing = differing_bindings(modules);
    differing.iter().any(|&(entry_point, number, ..)| (entry_point, number) == ("trace_rays", binding::RAYS))
}

/// The comparison above can fail: a member that moves, and a stride that grows, are noticed.
#[test]
fn a_moved_member_and_a_changed_stride_are_noticed() {
    assert!(!rays_differ(&compiled()));
    let moved = changed(|operands| match operands {
        [_, Operand::LiteralBit32(1), Operand::Decoration(Decoration::Offset), Operand::LiteralBit32(12)] => {
            Some(16)
        }
        _ => None,
    });
    assert!(rays_differ(&moved));
    let stretched = changed(|operands| match operands {
        [_, Operand::Decoration(Decoration::ArrayStride), Operand::LiteralBit32(32)] => Some(48),
        _ => None,
    });
    assert!(rays_differ(&stretched));
}
