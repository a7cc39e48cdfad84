//! Entry points of distance maps, in the order in which they are dispatched.

use crate::displacement::height_pyramid::Pyramid;
use crate::interface::{Batch, Displacement};
use crate::math::{at, put};
use crate::relief::distance_map;
use glam::UVec3;
use spirv_std::{glam, spirv};

/// Computes some columns of distance maps. The height maps' pyramids must be built.
#[spirv(compute(threads(64), entry_point_name = "distance_columns"))]
pub fn distance_columns(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] batch: &Batch,
    #[spirv(spec_constant(id = 3, default = 2))] height_format: u32,
    #[spirv(spec_constant(id = 5, default = 0))] height_wrap: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] displacements: &[Displacement],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] height_texels: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] height_ranges: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 43)] distances: &mut [f32],
) {
    if id.x < batch.count {
        let i = batch.first + id.x;
        let (map, column) = (i / distance_map::COLUMNS, i % distance_map::COLUMNS);
        let displacement = at(displacements, map);
        let pyramid = Pyramid {
            texels: height_texels,
            ranges: height_ranges,
            map: displacement,
            format: displacement.known_format(height_format),
            wrap: displacement.known_wrap(height_wrap),
        };
        put(distances, map * distance_map::WORDS + column, distance_map::column(&pyramid, column));
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
