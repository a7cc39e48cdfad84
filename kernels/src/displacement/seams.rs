//! What the triangles at a seam or at a decided corner share of heights: see [`Seams`].

use crate::displacement::height_pyramid::uv_box_bounds;
use crate::displacement::surface::{HeightField, Pixel, component};
use crate::interface::Seams;
use crate::math::{MinMax, Sum, UNIT_ROUNDOFF};
use glam::Vec2;

/// `seams` with its heights decided by the maps of `field`: at each decided corner the mean of its readings, along each
/// seam the range of its micro-vertices' heights. Those of other corners and edges stay as they are. Of vector
/// displacement bounds on lengths at both.
///
/// Every entry at a corner reads the same sides in the same order, so that all have the same bits. Where maps are
/// filtered by their levels corners are read by each view for itself, and their heights here are those of the maps
/// themselves.
pub fn decide_seams(field: &HeightField<'_>, seams: Seams) -> Seams {
    let mut decided = seams;
    let mut e = 0;
    while e < 3 {
        if seams.flags >> e & 1 != 0 {
            let (first, count) = (component(seams.first_reading, e), component(seams.reading_count, e));
            let height = if field.is_vector() {
                height_range(field, first, count).1
            } else {
                mean_height(field, first, count)
            };
            decided.heights = with_component(decided.heights, e, height);
        }
        if seams.flags >> (3 + e) & 1 != 0 {
            let (first, count) = (component(seams.first_side, e), component(seams.side_count, e));
            let (low, high) = height_range(field, first, count);
            decided.height_min = with_component(decided.height_min, e, low);
            decided.height_max = with_component(decided.height_max, e, high);
        }
        e += 1;
    }
    decided
}

/// The mean of what `count` sides, at least one, read at their starts.
fn mean_height(field: &HeightField<'_>, first: u32, count: u32) -> f32 {
    let mut sum = Sum::ZERO;
    let mut i = 0;
    while i < count {
        let side = field.seam_side(first + i);
        let map = field.displacement(side.displacement);
        sum = sum.plus(field.height(&map, Vec2::from_array(side.start), Pixel::NONE));
        i += 1;
    }
    sum.mean(count)
}

/// Bounds on the mean of what `count` sides, at least one, read at the same share of their lengths.
fn height_range(field: &HeightField<'_>, first: u32, count: u32) -> (f32, f32) {
    let (mut low, mut high, mut magnitude) = (Sum::ZERO, Sum::ZERO, 0.0_f32);
    let mut i = 0;
    while i < count {
        let side = field.seam_side(first + i);
        let (start, end) = (Vec2::from_array(side.start), Vec2::from_array(side.end));
        let span = field.span(side.vertices[0]).max_num(field.span(side.vertices[1]));
        let range = uv_box_bounds(field, side.displacement, start.min_num(end), start.max_num(end), span);
        (low, high) = (low.plus(range.0), high.plus(range.1));
        magnitude = magnitude.max_num(range.0.abs()).max_num(range.1.abs());
        i += 1;
    }
    // A micro-vertex's mean takes a rounding for each side and 2.5 ulp, 5 roundings, for the division; then the means
    // here.
    let roundings = 5 + count + Sum::mean_roundings(count);
    let error = magnitude * UNIT_ROUNDOFF * roundings as f32;
    (low.mean(count) - error, high.mean(count) + error)
}

/// `v` with another component 0, 1 or 2.
#[inline]
fn with_component(v: [f32; 3], i: u32, x: f32) -> [f32; 3] {
    if i == 0 {
        [x, v[1], v[2]]
    } else if i == 1 {
        [v[0], x, v[2]]
    } else {
        [v[0], v[1], x]
    }
}
