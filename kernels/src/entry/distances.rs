//! Entry points of distance maps, in the order in which they are dispatched.

use crate::displacement::surface::HeightField;
use crate::interface::{
    Batch, BvhNode, Displacement, Frame, Instance, Material, PointLight, SeamSide, Seams, Tangent,
    TexelScale, Triangle, Vertex,
};
use crate::math::{at, put};
use crate::relief::distance_map;
use crate::scene::{Features, SceneView};
use glam::UVec3;
use spirv_std::{glam, spirv};

/// Computes some columns of distance maps. The height maps' pyramids must be built.
#[spirv(compute(threads(64), entry_point_name = "distance_columns"))]
pub fn distance_columns(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] vertices: &[Vertex],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] triangles: &[Triangle],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[BvhNode],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] displacements: &[Displacement],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] height_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] height_ranges: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 8)] seams: &[Seams],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 9)] seam_sides: &[SeamSide],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 10)] color_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 11)] lights: &[PointLight],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 37)] materials: &[Material],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 38)] tangents: &[Tangent],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 39)] texel_scales: &[TexelScale],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 40)] instances: &[Instance],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 41)] normal_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 42)] micro_vertices: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &mut [f32],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features { height_format, height_wrap, ..Features::default() };
        let scene = SceneView {
            frame,
            vertices,
            tangents,
            texel_scales,
            triangles,
            nodes,
            primitives,
            displacements,
            height_texels,
            height_ranges,
            seams,
            seam_sides,
            color_texels,
            materials,
            lights,
            normal_texels,
            instances,
            micro_vertices,
            distances: &*distances,
        };
        let (map, column) = (i / distance_map::COLUMNS, i % distance_map::COLUMNS);
        let height = distance_map::column(&HeightField::new(&scene, features), map, column);
        put(distances, map * distance_map::WORDS + column, height);
    }
}

/// Computes some cells of distance maps from the columns.
#[spirv(compute(threads(64), entry_point_name = "distance_map"))]
pub fn distance_map(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] displacements: &[Displacement],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &mut [f32],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let (map, cell) = (i / distance_map::CELLS, i % distance_map::CELLS);
        let mode = at(displacements, map).known_wrap(height_wrap);
        let first = map * distance_map::WORDS;
        let distance = distance_map::distance(&*distances, first, mode, cell);
        put(distances, first + distance_map::COLUMNS + cell, distance);
    }
}
