//! The entry points: bind, index, call, store; no logic.
//!
//! Each that needs a scene lists all bindings of one, and puts them into a [`SceneView`] by itself. A function in its
//! place would take as many lines for its arguments, since rust-gpu makes no empty slices for what a kernel does
//! without, and a macro does not see names that it is not given.
#![expect(
    clippy::too_many_arguments,
    reason = "an entry point takes one argument per binding and specialisation constant"
)]
#![allow(missing_docs, reason = "the spirv macro drops doc comments of entry points' parameters")]

pub mod bvh;
pub mod distances;
pub mod prism_tree;
pub mod tessellate;

use crate::bvh::radix_sort::{self, Pairs};
use crate::bvh::scan;
use crate::counters::Counts;
use crate::displacement::height_pyramid::{build_word, height_bounds};
use crate::displacement::seams;
use crate::displacement::surface::{self, HeightField};
use crate::interface::{
    Batch, BvhNode, Counter, Displacement, FilmPixel, Frame, Instance, Intersection, Material, PointLight,
    PyramidPart, Ray, SeamSide, Seams, SortPass, Tangent, TexelScale, Tiles, Triangle, Vertex, counter,
};
use crate::math::{add_to_counter, at, put, workgroup_barrier};
use crate::parallel::{Word, Workgroup};
use crate::scene::{Features, SceneView};
use crate::{film, probe, render};
use glam::{UVec3, UVec4, Vec4};
use spirv_std::{glam, spirv};

/// Adds one sample to each pixel of some tiles.
#[spirv(compute(threads(8, 8), entry_point_name = "render"))]
pub fn render(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(local_invocation_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut [Counter; counter::COUNT],
    #[spirv(push_constant)] tiles: &Tiles,
    #[spirv(spec_constant(id = 0, default = 3))] method: u32,
    #[spirv(spec_constant(id = 1, default = 0))] shade: u32,
    #[spirv(spec_constant(id = 2, default = 1))] shadows: u32,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 4, default = 0))] color_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 6, default = 0))] color_wrap: u32,
    #[spirv(spec_constant(id = 7, default = 0))] counting: u32,
    #[spirv(spec_constant(id = 8, default = 0))] normals: u32,
    #[spirv(spec_constant(id = 9, default = 0))] welded: u32,
    #[spirv(spec_constant(id = 10, default = 0))] smooth: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 12, default = 0))] filter: u32,
    #[spirv(spec_constant(id = 13, default = 0))] adaptive: u32,
    #[spirv(spec_constant(id = 14, default = 0))] placed: u32,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 12)] sums: &mut [FilmPixel],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 14)] counters: &mut [Counter],
) {
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
        prism_tree,
    };
    let features = Features {
        method,
        shade,
        shadows,
        height_format,
        color_format,
        height_wrap,
        color_wrap,
        counters: counting,
        normals,
        seams: welded,
        smooth,
        displacement,
        filter,
        adaptive,
        instances: placed,
        bounds: stored,
    };
    let mut counts = Counts::default();
    let (x, y, is_one) = film::pixel(frame, tiles, group.y * groups.x + group.x, id.x, id.y);
    if is_one {
        let sample = render::sample_pixel(&scene, features, x, y, tiles.sample, &mut counts);
        let pixel = y * frame.width + x;
        let sum = at(sums, pixel).plus(sample);
        put(sums, pixel, sum);
    }
    add_counts(counters, shared, local, counts, features);
}

/// Resolves each pixel of some tiles.
#[spirv(compute(threads(8, 8), entry_point_name = "resolve"))]
pub fn resolve(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(local_invocation_id)] id: UVec3,
    #[spirv(push_constant)] tiles: &Tiles,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 12)] sums: &[FilmPixel],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 13)] picture: &mut [Vec4],
) {
    let (x, y, is_one) = film::pixel(frame, tiles, group.y * groups.x + group.x, id.x, id.y);
    if is_one {
        let pixel = y * frame.width + x;
        put(picture, pixel, at(sums, pixel).resolve(frame));
    }
}

/// Finds the nearest hit of each ray of a batch.
#[spirv(compute(threads(64), entry_point_name = "trace_rays"))]
pub fn trace_rays(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut [Counter; counter::COUNT],
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 0, default = 3))] method: u32,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 7, default = 0))] counting: u32,
    #[spirv(spec_constant(id = 8, default = 0))] normals: u32,
    #[spirv(spec_constant(id = 9, default = 0))] welded: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 12, default = 0))] filter: u32,
    #[spirv(spec_constant(id = 13, default = 0))] adaptive: u32,
    #[spirv(spec_constant(id = 14, default = 0))] placed: u32,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 15)] rays: &[Ray],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 16)] intersections: &mut [Intersection],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 14)] counters: &mut [Counter],
) {
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
        prism_tree,
    };
    let features = Features {
        method,
        height_format,
        height_wrap,
        counters: counting,
        normals,
        seams: welded,
        displacement,
        filter,
        adaptive,
        instances: placed,
        bounds: stored,
        ..Features::default()
    };
    let mut counts = Counts::default();
    if id.x < batch.count {
        let i = batch.first + id.x;
        put(intersections, i, render::trace_ray(&scene, features, at(rays, i), &mut counts));
    }
    add_counts(counters, shared, local, counts, features);
}

/// Builds some words of a level of a height map's pyramid.
#[spirv(compute(threads(64), entry_point_name = "height_pyramid"))]
pub fn height_pyramid(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] part: &PyramidPart,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] displacements: &[Displacement],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] height_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] height_ranges: &mut [u32],
) {
    if id.x < part.count {
        let map = at(displacements, part.displacement);
        let item = part.first + id.x;
        build_word(height_texels, height_ranges, &map, height_format, height_wrap, part.level, item);
    }
}

/// Bounds the heights over some triangles.
#[spirv(compute(threads(64), entry_point_name = "bound_heights"))]
pub fn bound_heights(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 12, default = 0))] filter: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] vertices: &[Vertex],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] triangles: &mut [Triangle],
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features { height_format, height_wrap, displacement, filter, ..Features::default() };
        let scene = SceneView {
            frame,
            vertices,
            tangents,
            texel_scales,
            triangles: &*triangles,
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
            prism_tree,
        };
        let mut triangle = at(scene.triangles, i);
        let (low, high) = height_bounds(&HeightField::new(&scene, features), vertices, triangle);
        (triangle.height_min, triangle.height_max) = (low, high);
        put(triangles, i, triangle);
    }
}

/// Decides the heights of some seams.
#[spirv(compute(threads(64), entry_point_name = "decide_seams"))]
pub fn decide_seams(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 12, default = 0))] filter: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] frame: &Frame,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] vertices: &[Vertex],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] triangles: &[Triangle],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[BvhNode],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] displacements: &[Displacement],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] height_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] height_ranges: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 8)] seams: &mut [Seams],
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features { height_format, height_wrap, displacement, filter, ..Features::default() };
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
            seams: &*seams,
            seam_sides,
            color_texels,
            materials,
            lights,
            normal_texels,
            instances,
            micro_vertices,
            distances,
            prism_tree,
        };
        let decided = seams::decide_seams(&HeightField::new(&scene, features), at(scene.seams, i));
        put(seams, i, decided);
    }
}

/// Computes the boxes of some prisms. Their heights must be bounded and their seams decided.
#[spirv(compute(threads(64), entry_point_name = "prism_bounds"))]
pub fn prism_bounds(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 0, default = 3))] method: u32,
    #[spirv(spec_constant(id = 1, default = 0))] shade: u32,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(spec_constant(id = 8, default = 0))] normals: u32,
    #[spirv(spec_constant(id = 9, default = 0))] welded: u32,
    #[spirv(spec_constant(id = 11, default = 0))] displacement: u32,
    #[spirv(spec_constant(id = 12, default = 0))] filter: u32,
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 44)] prism_tree: &[UVec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &mut [f32],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let features = Features {
            method,
            shade,
            height_format,
            height_wrap,
            normals,
            seams: welded,
            displacement,
            filter,
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
            prism_tree,
        };
        surface::prism_bounds(&scene, features, i).store(boxes, i);
    }
}

/// Runs one elementary kernel on each item of a batch.
#[spirv(compute(threads(64), entry_point_name = "probe"))]
pub fn probe(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 17)] input: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 18)] output: &mut [u32],
) {
    if id.x < batch.count {
        probe::run(batch.kernel, input, output, batch.first + id.x);
    }
}

/// First dispatch of a scan: sums each block.
#[spirv(compute(threads(128), entry_point_name = "sum_blocks"))]
pub fn sum_blocks(
    #[spirv(workgroup_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut scan::Shared,
    #[spirv(push_constant)] count: &u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 22)] values: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 23)] sums: &[Word],
) {
    scan::sum_blocks(Workgroup::of_invocation(id.x, local), shared, values, *count, sums);
}

/// Second dispatch of a scan, or all of a short one: a single workgroup scans block after block.
#[spirv(compute(threads(128), entry_point_name = "scan_serially"))]
pub fn scan_serially(
    #[spirv(workgroup_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut scan::Shared,
    #[spirv(push_constant)] count: &u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 22)] values: &[Word],
) {
    scan::scan_serially(Workgroup::of_invocation(id.x, local), shared, values, *count);
}

/// Third dispatch of a scan: scans each block from its sum on.
#[spirv(compute(threads(128), entry_point_name = "scan_blocks"))]
pub fn scan_blocks(
    #[spirv(workgroup_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut scan::Shared,
    #[spirv(push_constant)] count: &u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 22)] values: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 23)] sums: &[Word],
) {
    scan::scan_blocks(Workgroup::of_invocation(id.x, local), shared, values, *count, sums);
}

/// First dispatch of a pass of a sort: counts each block's digits.
#[spirv(compute(threads(128), entry_point_name = "count_digits"))]
pub fn count_digits(
    #[spirv(workgroup_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] histogram: &mut radix_sort::Histogram,
    #[spirv(push_constant)] pass: &SortPass,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 19)] keys: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 21)] counts: &[Word],
) {
    radix_sort::count_digits(Workgroup::of_invocation(id.x, local), histogram, pass, keys, counts);
}

/// Last dispatch of a pass of a sort: takes each pair to its place.
#[spirv(compute(threads(128), entry_point_name = "scatter_pairs"))]
pub fn scatter_pairs(
    #[spirv(workgroup_id)] id: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] counters: &mut radix_sort::Counters,
    #[spirv(workgroup)] sums: &mut scan::Shared,
    #[spirv(workgroup)] entries: &mut radix_sort::Entries,
    #[spirv(push_constant)] pass: &SortPass,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 19)] keys: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 20)] values: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 21)] counts: &[Word],
) {
    let group = Workgroup::of_invocation(id.x, local);
    radix_sort::scatter_pairs(group, counters, sums, entries, pass, Pairs { keys, values }, counts);
}

/// Adds an invocation's counts to the totals: cap hits always, the rest where counting is compiled in. Then a
/// workgroup sums its own first: one address that every invocation of a device adds to costs more than the tracing.
/// Every invocation of the workgroup must come here.
fn add_counts(
    counters: &mut [Counter],
    shared: &mut [Counter; counter::COUNT],
    local: u32,
    counts: Counts,
    features: Features,
) {
    if features.counters != 0 {
        if local < counter::COUNT as u32 {
            shared[local as usize] = Counter { low: 0, high: 0 };
        }
        workgroup_barrier();
        let values = counts.to_array();
        let mut i = 0;
        while i < counter::COUNT {
            if values[i] != 0 {
                add_to_counter(&mut shared[i], Counter { low: values[i], high: 0 });
            }
            i += 1;
        }
        workgroup_barrier();
        if local < counter::COUNT as u32 {
            add_to_counter(&mut counters[local as usize], shared[local as usize]);
        }
    } else if counts.cap_hits != 0 {
        let cap_hits = Counter { low: counts.cap_hits, high: 0 };
        add_to_counter(&mut counters[counter::CAP_HITS as usize], cap_hits);
    }
}
