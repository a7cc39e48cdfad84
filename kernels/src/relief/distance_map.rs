//! Distance maps: how far at least the relief is from each cell of a grid of boxes over a height map.
//!
//! Donnelly, "Per-Pixel Displacement Mapping with Distance Functions", GPU Gems 2, chapter 8, 2005, who computes them
//! with Danielsson's transform. Space is that of the map, one side of it [`SIDE`] units, its range of heights
//! [`DEPTH`] units, so that a cell is a unit cube and the map does not depend on zero and scale but for the sign of
//! that. The relief is taken for columns, each as high as the highest texel that is read in it; so distances are
//! exact between a cell (any point of it) and the columns, and never more than what is between the cell and the
//! relief.
//!
//! A map takes [`WORDS`] floats: the columns' heights in cells, row by row downwards, then the distances in layers of
//! such rows, the lowest first. 272 KiB a map, whatever its size.

use crate::displacement::height_pyramid::Pyramid;
use crate::interface::{Displacement, wrap};
use crate::math::{at, clamp, floor, sqrt};
use glam::{Vec2, Vec3};

/// Cells along each side of a map.
pub const SIDE: u32 = 64;
/// Cells from the least height to the greatest.
pub const DEPTH: u32 = 16;
/// Columns of a map.
pub const COLUMNS: u32 = SIDE * SIDE;
/// Cells of a map.
pub const CELLS: u32 = COLUMNS * DEPTH;
/// Floats of a map.
pub const WORDS: u32 = COLUMNS + CELLS;

/// Height of column number `i` of a map in cells, 0 to [`DEPTH`]. The pyramid must be built.
///
/// It is a share of the range of texels, so that all zeros and all scales of one sign have the same. Heights over a
/// zero far outside that range are rounded more coarsely, and may be higher by as much.
#[inline]
pub fn column(pyramid: &Pyramid<'_>, i: u32) -> f32 {
    let map = pyramid.map;
    let (x, y) = (i % SIDE, i / SIDE);
    let size = Vec2::new(map.map_width as f32, map.map_height as f32);
    let texels = size / SIDE as f32;
    let low = Vec2::new(x as f32, y as f32) * texels - Vec2::splat(0.5);
    let range = pyramid.range_between(low, low + texels);
    let whole = pyramid.range_between(Vec2::NEG_ONE, size);
    let rise = if is_turned(&map) { whole.max - range.min } else { range.max - whole.min };
    let cells = rise / (whole.max - whole.min) * DEPTH as f32;
    // Of a flat map that is no number.
    if cells >= 0.0 { cells.min(DEPTH as f32) } else { 0.0 }
}

/// Whether great texels are low. Distances depend on that, on the map and on its wrap alone.
#[inline]
pub fn is_turned(map: &Displacement) -> bool {
    map.scale < 0.0
}

/// Distance from cell number `i` of a map to the nearest of its `columns`, which go on beyond the map as `mode` says,
/// in cells; at most [`DEPTH`].
///
/// Columns are looked at in rings around the cell's own, until a ring is no nearer than what was found.
#[inline]
pub fn distance(distances: &[f32], first: u32, mode: u32, i: u32) -> f32 {
    let layer = (i / COLUMNS) as f32;
    let (x, y) = ((i % SIDE) as i32, (i / SIDE % SIDE) as i32);
    let mut nearest = DEPTH as f32;
    let mut ring = 0;
    while ring <= DEPTH as i32 && gap(ring) < nearest {
        let mut dy = -ring;
        while dy <= ring {
            // All of the first and the last row, the two ends of the others.
            let step = if dy == -ring || dy == ring { 1 } else { (2 * ring).max(1) };
            let mut dx = -ring;
            while dx <= ring {
                let column = wrapped(y + dy, mode) * SIDE + wrapped(x + dx, mode);
                let below = (layer - at(distances, first + column)).max(0.0);
                let to = Vec3::new(gap(dx), gap(dy), below);
                nearest = nearest.min(sqrt(to.x * to.x + to.y * to.y + to.z * to.z));
                dx += step;
            }
            dy += 1;
        }
        ring += 1;
    }
    nearest
}

/// What is between two cells that are `d` apart along an axis.
#[inline]
fn gap(d: i32) -> f32 {
    let d = if d < 0 { -d } else { d };
    if d > 1 { (d - 1) as f32 } else { 0.0 }
}

/// The cell along a side of the map where it goes on at `i`.
#[inline]
fn wrapped(i: i32, mode: u32) -> u32 {
    let side = SIDE as i32;
    if mode == wrap::CLAMP {
        i.clamp(0, side - 1) as u32
    } else {
        // Not negative, since Vulkan leaves remainders of such undefined; cells are within 2^22 of the map.
        let period = if mode == wrap::REPEAT { side } else { 2 * side };
        let i = ((i + (1 << 23)) as u32 % period as u32) as i32;
        (if i < side { i } else { 2 * side - 1 - i }) as u32
    }
}

/// Distance of the cell at `p` in units of cells. Beyond the greatest height it is that of the last layer, beyond the
/// least one that of the first, which is 0. Cells farther than 2^22 from the map count as those there.
#[inline]
pub fn distance_at(distances: &[f32], map: u32, mode: u32, p: Vec3) -> f32 {
    const FARTHEST: f32 = 4_194_304.0;
    let (x, y) = (clamp(p.x, -FARTHEST, FARTHEST), clamp(p.y, -FARTHEST, FARTHEST));
    let (x, y) = (wrapped(floor(x) as i32, mode), wrapped(floor(y) as i32, mode));
    let layer = (p.z.max(0.0) as u32).min(DEPTH - 1);
    at(distances, map * WORDS + COLUMNS + layer * COLUMNS + y * SIDE + x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::surface::HeightField;
    use crate::math::tests::Numbers;
    use crate::relief::test_ramp::{ramp, with_pyramid};
    use crate::test_scene::{FLAT, TestScene};

    /// Against all columns of three copies of the map each way, for each wrap.
    #[test]
    fn distances_are_those_to_the_nearest_column() {
        let mut numbers = Numbers::new(3);
        for mode in [wrap::REPEAT, wrap::CLAMP, wrap::MIRROR] {
            let mut distances: Vec<f32> = (0..COLUMNS).map(|_| numbers.unit().powi(4) * 16.0).collect();
            distances.resize(WORDS as usize, 0.0);
            for _ in 0..60 {
                let i = (numbers.unit() * CELLS as f32) as u32;
                let (x, y, z) = (i % SIDE, i / SIDE % SIDE, i / COLUMNS);
                let mut nearest = f64::from(DEPTH);
                for cy in -(SIDE as i32)..2 * SIDE as i32 {
                    for cx in -(SIDE as i32)..2 * SIDE as i32 {
                        let fold = |c: i32| {
                            let side = SIDE as i32;
                            let inside = (0..side).contains(&c);
                            match mode {
                                _ if inside => c,
                                wrap::CLAMP => c.clamp(0, side - 1),
                                wrap::REPEAT => c.rem_euclid(side),
                                _ if c < 0 => -1 - c,
                                _ => 2 * side - 1 - c,
                            }
                        };
                        let top = f64::from(distances[(fold(cy) * SIDE as i32 + fold(cx)) as usize]);
                        let apart = |a: i32, b: u32| f64::from((a.abs_diff(b as i32)).max(1) - 1);
                        let below = (f64::from(z) - top).max(0.0);
                        let squared = apart(cx, x).powi(2) + apart(cy, y).powi(2) + below.powi(2);
                        nearest = nearest.min(squared.sqrt());
                    }
                }
                let found = f64::from(distance(&distances, 0, mode, i));
                assert!((found - nearest).abs() < 1e-5, "{mode} {i}: {found} {nearest}");
            }
        }
    }

    /// Sixteen texels in a row, four columns from each to the next. Whatever zero and scale, the highest place of a
    /// column is at one of its ends, in steps of the texels' range; where the scale turns heights round that is the
    /// texels' lowest one.
    #[test]
    fn columns_are_the_highest_places_whatever_zero_and_scale() {
        let mut numbers = Numbers::new(4);
        let texels: Vec<f32> = (0..16).map(|_| numbers.unit() * 3.0 - 1.0).collect();
        let mut scene = ramp(1);
        // Two rows, which are alike: of one the filter is not taken for linear.
        (scene.displacements[0].map_width, scene.displacements[0].map_height) = (16, 2);
        scene.height_texels = [&texels[..], &texels].concat().into_iter().map(f32::to_bits).collect();
        let mut scene = with_pyramid(scene);
        let texel = |i: i32| f64::from(texels[i.rem_euclid(16) as usize]);
        let at = |x: f64| {
            let (i, s) = (x.floor() as i32, x - x.floor());
            texel(i) * (1.0 - s) + texel(i + 1) * s
        };
        let least = texels.iter().copied().fold(f32::INFINITY, f32::min);
        let greatest = texels.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let range = f64::from(greatest) - f64::from(least);
        let columns = |scene: &TestScene| {
            let view = scene.view();
            let field = HeightField::new(&view, FLAT);
            let pyramid = field.pyramid(field.displacement(0));
            (0..SIDE).map(|i| column(&pyramid, i)).collect::<Vec<_>>()
        };
        for sign in [1.0, -1.0] {
            let expected = (0..SIDE).map(|i| {
                let (low, high) = (f64::from(i) * 0.25 - 0.5, f64::from(i + 1) * 0.25 - 0.5);
                let (i, j) = (low.floor() as i32, high.floor() as i32);
                // Where a column ends at a texel that one is read too, and the next.
                let (a, b, c) =
                    if i == j { (at(low), at(high), at(low)) } else { (texel(i), texel(j), texel(j + 1)) };
                let rise = if sign > 0.0 {
                    a.max(b).max(c) - f64::from(least)
                } else {
                    f64::from(greatest) - a.min(b).min(c)
                };
                rise / range * f64::from(DEPTH)
            });
            let mut first: Option<Vec<f32>> = None;
            for (scale, zero) in [(0.25, 0.0), (3.0, 0.5), (1e-3, -40.0)] {
                let map = &mut scene.displacements[0];
                (map.scale, map.zero) = (sign * scale, zero);
                (map.height_min, map.height_max) =
                    Displacement::height_range(least, greatest, zero, map.scale);
                let found = columns(&scene);
                assert_eq!(*first.get_or_insert_with(|| found.clone()), found, "{scale} {zero}");
            }
            for (found, expected) in first.expect("three").into_iter().zip(expected) {
                // Of values up to 16, some ten roundings.
                assert!((f64::from(found) - expected).abs() < 1e-5, "{sign}: {found} {expected}");
            }
        }
    }

    #[test]
    fn cells_are_found_wherever_the_map_goes_on() {
        let mut distances = vec![0.0; WORDS as usize];
        let cell = COLUMNS + 3 * COLUMNS + 5 * SIDE + 7;
        distances[cell as usize] = 9.0;
        let at = |mode, x: f32, y: f32, z: f32| distance_at(&distances, 0, mode, Vec3::new(x, y, z));
        assert_eq!(at(wrap::REPEAT, 7.5, 5.5, 3.5), 9.0);
        assert_eq!(at(wrap::REPEAT, 7.5 - 64.0, 5.5 + 128.0, 3.5), 9.0);
        assert_eq!(at(wrap::MIRROR, -7.5, 128.0 - 5.5, 3.5), 9.0);
        assert_eq!(at(wrap::MIRROR, 8.5, 5.5, 3.5), 0.0);
        assert_eq!(at(wrap::CLAMP, 7.5, 5.5, 3.5), 9.0);
        assert_eq!(at(wrap::REPEAT, 7.5, 5.5, -1.0), 0.0);
    }
}
