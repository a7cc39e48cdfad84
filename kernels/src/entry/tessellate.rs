//! Entry points of a tessellation, in the order in which they are dispatched; the BVH's build follows.

use crate::displacement::tessellate;
use crate::interface::{
    Batch, BvhNode, Displacement, Frame, Instance, Material, PointLight, SeamSide, Seams, Tangent,
    TexelScale, Triangle, Vertex,
};
use crate::scene::{Features, SceneView};
use glam::{UVec3, UVec4};
use spirv_std::{glam, spirv};

/// Computes some micro-vertices of a tessellation. Heights must be bounded and seams decided.
#[spirv(compute(threads(64), entry_point_name = "tessellate"))]
pub fn tessellate(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 8, default = 0))] normals: u32,
    #[spirv(spec_constant(id = 9, default = 0))] welded: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 42)] micro_vertices: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features {
            height_format,
            height_wrap,
            normals,
            seams: welded,
            displacement,
            ..Features::default()
        };
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
            micro_vertices: &*micro_vertices,
            distances,
            prism_tree,
        };
        let p = tessellate::micro_vertex(&scene, features, i);
        tessellate::store(micro_vertices, i, p);
    }
}

/// Computes the boxes of some micro-triangles of a tessellation.
#[spirv(compute(threads(64), entry_point_name = "tessellate_bounds"))]
pub fn tessellate_bounds(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 42)] micro_vertices: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &mut [f32],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        tessellate::bounds(micro_vertices, frame.subdivisions, i).store(boxes, i);
    }
}
