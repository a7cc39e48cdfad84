//! Entry points of a stored tree's build, in the order in which they are dispatched.

use crate::interface::{
    Batch, BvhNode, Displacement, Frame, Instance, Material, PointLight, SeamSide, Seams, Tangent,
    TexelScale, Triangle, Vertex,
};
use crate::math::put;
use crate::prism_tree::build;
use crate::prism_tree::layout::{Layout, heap_nodes, levels};
use crate::scene::{Features, SceneView};
use glam::{UVec3, UVec4};
use spirv_std::{glam, spirv};

/// Stores some micro-vertices of a tree. Heights must be bounded and seams decided.
#[spirv(compute(threads(64), entry_point_name = "tree_micro_vertices"))]
pub fn tree_micro_vertices(
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
        build::store_micro_vertex(&scene, features, i).store(micro_vertices);
    }
}

/// Computes the frames of some triangles. Heights must be bounded and seams decided.
#[spirv(compute(threads(64), entry_point_name = "tree_frames"))]
pub fn tree_frames(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 42)] micro_vertices: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &mut [UVec4],
) {
    if id.x < batch.count {
        let triangle = batch.first + id.x;
        let features = Features { seams: welded, displacement, ..Features::default() };
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
            distances,
            prism_tree: &*prism_tree,
        };
        let layout = Layout::new(frame.triangle_count, frame.subdivisions);
        let record = build::frame(&scene, features, triangle);
        build::store_record(record, prism_tree, layout.record(triangle));
    }
}

/// Bounds the blocks under some of the lowest nodes. Frames and micro-vertices must be stored.
#[spirv(compute(threads(64), entry_point_name = "tree_blocks"))]
pub fn tree_blocks(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 8, default = 0))] normals: u32,
    #[spirv(spec_constant(id = 9, default = 0))] welded: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 15, default = 0))] stored: u32,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &mut [UVec4],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features {
            height_format,
            height_wrap,
            normals,
            seams: welded,
            displacement,
            bounds: stored,
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
            micro_vertices,
            distances,
            prism_tree: &*prism_tree,
        };
        let (n, layout) = (frame.subdivisions, Layout::new(frame.triangle_count, frame.subdivisions));
        let of_heap = build::lowest_nodes(n);
        let node = build::lowest_node(&scene, features, i);
        let place = heap_nodes(levels(n) - 1) + i % of_heap;
        node.store(prism_tree, layout.heap_node(i / of_heap, place));
    }
}

/// Bounds some nodes of a level of all heaps, whose number is the batch's `kernel`: from the level below.
#[spirv(compute(threads(64), entry_point_name = "tree_nodes"))]
pub fn tree_nodes(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &mut [UVec4],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let layout = Layout::new(frame.triangle_count, frame.subdivisions);
        let (of_heap, level) = (2 * batch.kernel, batch.kernel);
        let (triangle, place) = (i >> of_heap, heap_nodes(level) + (i & ((1 << of_heap) - 1)));
        let node = build::inner_node(&*prism_tree, &layout, triangle, place);
        node.store(prism_tree, layout.heap_node(triangle, place));
    }
}

/// Collapses some pairs of siblings of the BVH, which must be built.
#[spirv(compute(threads(64), entry_point_name = "tree_upper_nodes"))]
pub fn tree_upper_nodes(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[BvhNode],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &mut [UVec4],
) {
    if id.x < batch.count {
        let pair = batch.first + id.x;
        let layout = Layout::new(frame.triangle_count, frame.subdivisions);
        let first = layout.upper_node(pair);
        let (node, links) = build::collapse(nodes, primitives, pair);
        node.store(prism_tree, first);
        put(prism_tree, first + 3, links);
    }
}
