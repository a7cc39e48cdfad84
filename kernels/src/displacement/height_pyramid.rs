//! The min/max pyramid of a height map: bounds on heights over any box of texels in a single read.
//!
//! Entry (x, y) of level l holds the least and the greatest texel of the square that begins at texel (x 2^l, y 2^l) and
//! is 2^(l+1) texels wide: twice the entries' spacing, so that any box no larger than 2^l + 1 texels lies in the entry at
//! its first texel, wherever that is. Squares go on beyond the map as the map itself does where it repeats; where it is
//! clamped or mirrored they are cut off, since boxes are folded into the map before they are asked for.
//!
//! Level 0, the four texels of a bilinear filter, is read from the map. Levels 1 to [`top_level`] are stored, each
//! entry in the format of the texels, so that ranges are exact: a third of a map's texels, twice. In words, from
//! [`Displacement::first_range`] on: [`HEADER`] words with the first word of each level, then level 1, level 2, ...

use crate::displacement::surface::HeightField;
use crate::interface::{Displacement, Triangle, Vertex, height_format, wrap};
use crate::math::{UNIT_ROUNDOFF, at, floor, put};
use crate::texture::{height_texel, unorm8, unorm16};
use glam::Vec2;

/// Words before level 1: word l is where level l begins, counted from word 0; word 0 is not used. Maps of 2^31 texels a
/// side have 31 levels.
pub const HEADER: u32 = 32;

/// The level whose one entry is the whole map; 0 where the map is a single texel.
#[inline]
pub fn top_level(width: u32, height: u32) -> u32 {
    ceil_log2(width.max(height))
}

/// The least l with 2^l >= x, for x > 0.
#[inline]
fn ceil_log2(x: u32) -> u32 {
    if x <= 1 { 0 } else { 32 - (x - 1).leading_zeros() }
}

/// Entries of level `level` along a side of `size` texels.
#[inline]
fn entries(size: u32, level: u32) -> u32 {
    ((size - 1) >> level) + 1
}

/// Words of level `level`, at least 1, which are also the items that [`build_word`] is called for.
#[inline]
pub fn level_words(format: u32, width: u32, height: u32, level: u32) -> u32 {
    let count = entries(width, level) * entries(height, level);
    if format == height_format::UNORM8 {
        count.div_ceil(2)
    } else if format == height_format::UNORM16 {
        count
    } else {
        2 * count
    }
}

/// First word of a level, counted from the pyramid's own; of the level behind the last: the pyramid's length.
#[inline]
pub fn level_offset(format: u32, width: u32, height: u32, level: u32) -> u32 {
    let mut offset = HEADER;
    let mut below = 1;
    while below < level {
        offset += level_words(format, width, height, below);
        below += 1;
    }
    offset
}

/// Words of a map's pyramid.
pub fn pyramid_words(format: u32, width: u32, height: u32) -> u32 {
    level_offset(format, width, height, top_level(width, height) + 1)
}

/// The least and the greatest of some texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexelRange {
    /// Least texel.
    pub min: f32,
    /// Greatest texel.
    pub max: f32,
}

impl TexelRange {
    /// Of no texel.
    pub const EMPTY: TexelRange = TexelRange { min: f32::INFINITY, max: f32::NEG_INFINITY };

    #[inline]
    fn including(self, other: TexelRange) -> TexelRange {
        TexelRange { min: self.min.min(other.min), max: self.max.max(other.max) }
    }
}

/// Word `item` of level `level`, at least 1; the levels below must be built.
///
/// Cost: nine reads an entry, sixteen at a repeated border.
#[inline]
pub fn level_word(
    texels: &[u32],
    ranges: &[u32],
    map: &Displacement,
    format: u32,
    mode: u32,
    level: u32,
    item: u32,
) -> u32 {
    let count = entries(map.map_width, level) * entries(map.map_height, level);
    // A word holds two entries of bytes, one of halves, or half of one of floats.
    let (first, last) = if format == height_format::UNORM8 {
        (2 * item, (2 * item + 1).min(count - 1))
    } else if format == height_format::UNORM16 {
        (item, item)
    } else {
        (item >> 1, item >> 1)
    };
    let mut word = 0;
    let mut entry = first;
    while entry <= last {
        let range = below(texels, ranges, map, format, mode, level, entry);
        word |= if format == height_format::UNORM8 {
            ((range.min * 255.0 + 0.5) as u32 | ((range.max * 255.0 + 0.5) as u32) << 8)
                << (16 * (entry - first))
        } else if format == height_format::UNORM16 {
            (range.min * 65535.0 + 0.5) as u32 | ((range.max * 65535.0 + 0.5) as u32) << 16
        } else {
            (if item & 1 == 0 { range.min } else { range.max }).to_bits()
        };
        entry += 1;
    }
    word
}

/// Writes word `item` of level `level` to the pyramid, and with the first one where the level begins. What the entry
/// point `height_pyramid` does, level by level.
#[inline]
pub fn build_word(
    texels: &[u32],
    ranges: &mut [u32],
    map: &Displacement,
    format: u32,
    mode: u32,
    level: u32,
    item: u32,
) {
    let first = level_offset(format, map.map_width, map.map_height, level);
    let word = level_word(texels, ranges, map, format, mode, level, item);
    put(ranges, map.first_range + first + item, word);
    if item == 0 {
        put(ranges, map.first_range + level, first);
    }
}

/// Entry number `entry` of `level`, from the level below.
///
/// Its square is twice as wide as those below: four of their spacings, which the entries at the first three spacings
/// cover. Where the third one has gone round a repeated border, its square begins before what it has to cover
/// and ends as much too early, and a fourth is needed.
#[inline]
fn below(
    texels: &[u32],
    ranges: &[u32],
    map: &Displacement,
    format: u32,
    mode: u32,
    level: u32,
    entry: u32,
) -> TexelRange {
    let (width, height) = (map.map_width, map.map_height);
    let across = entries(width, level);
    let (x, y) = ((entry % across) << level, (entry / across) << level);
    let spacing = 1 << (level - 1);
    let mut range = TexelRange::EMPTY;
    let mut i = 0;
    while i < 16 {
        let (sx, sy) = (x + (i & 3) * spacing, y + (i >> 2) * spacing);
        let needed = (i & 3 < 3 || sx - spacing >= width) && (i >> 2 < 3 || sy - spacing >= height);
        let inside = sx < width && sy < height;
        if needed && (inside || mode == wrap::REPEAT) {
            range =
                range.including(read(texels, ranges, map, format, mode, level - 1, sx % width, sy % height));
        }
        i += 1;
    }
    range
}

/// The entry of `level` at texel (x, y).
#[inline]
#[expect(clippy::too_many_arguments, reason = "a read names the map, the level and the place")]
fn read(
    texels: &[u32],
    ranges: &[u32],
    map: &Displacement,
    format: u32,
    mode: u32,
    level: u32,
    x: u32,
    y: u32,
) -> TexelRange {
    if level == 0 {
        let (x1, y1) = (next_texel(x, map.map_width, mode), next_texel(y, map.map_height, mode));
        let (top, bottom) = (y * map.map_width, y1 * map.map_width);
        let texel = |i: u32| height_texel(texels, format, map.first_word, i);
        let (a, b, c, d) = (texel(top + x), texel(top + x1), texel(bottom + x), texel(bottom + x1));
        return TexelRange { min: a.min(b).min(c.min(d)), max: a.max(b).max(c.max(d)) };
    }
    let entry = (y >> level) * entries(map.map_width, level) + (x >> level);
    let first = map.first_range + at(ranges, map.first_range + level);
    if format == height_format::UNORM8 {
        let word = at(ranges, first + (entry >> 1));
        let lane = 2 * (entry & 1);
        TexelRange { min: unorm8(word, lane), max: unorm8(word, lane + 1) }
    } else if format == height_format::UNORM16 {
        let word = at(ranges, first + entry);
        TexelRange { min: unorm16(word, 0), max: unorm16(word, 1) }
    } else {
        let word = first + 2 * entry;
        TexelRange { min: f32::from_bits(at(ranges, word)), max: f32::from_bits(at(ranges, word + 1)) }
    }
}

/// The texel after `x` in a row, as the filter reads on.
#[inline]
fn next_texel(x: u32, size: u32, mode: u32) -> u32 {
    if x + 1 < size {
        x + 1
    } else if mode == wrap::REPEAT {
        0
    } else {
        x
    }
}

/// A stretch of texels along an axis: the first, and how many more there are. Of the endless map; `fold` brings
/// it into the map.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    first: u32,
    more: u32,
}

/// Texel coordinates of texture coordinates, texel centres at integers, rows downwards, in the endless map.
#[inline]
pub fn texel_coordinates(map: &Displacement, uv: Vec2) -> Vec2 {
    let (width, height) = (map.map_width as f32, map.map_height as f32);
    Vec2::new(uv.x * width - 0.5, height - uv.y * height - 0.5)
}

/// How far texel coordinates, computed from texture coordinates up to `uv` in magnitude by some linear function of the
/// grid, can lie from those that a micro-vertex reads: u = 2^-24 for each of the 4 roundings of the interpolated
/// coordinate, 2 for its reduction, 2 for its scale, and 8 of this side's own linear function, all of magnitude |uv| + 1.
#[inline]
pub fn texel_error(map: &Displacement, uv: Vec2) -> Vec2 {
    let error = (uv.abs() + Vec2::ONE) * (16.0 * UNIT_ROUNDOFF);
    Vec2::new(error.x * map.map_width as f32, error.y * map.map_height as f32)
}

/// Largest distance from texel 0 at which texel coordinates are computed with; beyond it they are rounded to more than a
/// quarter of a texel.
const FARTHEST: f32 = 4_194_304.0;

/// The texels that filters between coordinates `low` and `high` read: all of them where that is more than the map, or too
/// far out.
#[inline]
fn fold(low: f32, high: f32, size: u32, mode: u32) -> Stretch {
    let (first, last) = (floor(low), floor(high) + 1.0);
    let whole = Stretch { first: 0, more: size - 1 };
    // Negated so that NaN takes it too.
    if !(first >= -FARTHEST && last <= FARTHEST) {
        return whole;
    }
    let n = size as i32;
    let (first, last) = (first as i32, last as i32);
    if mode == wrap::CLAMP {
        let first = first.clamp(0, n - 1);
        return Stretch { first: first as u32, more: (last.clamp(0, n - 1) - first) as u32 };
    }
    if last - first >= n {
        return whole;
    }
    if mode == wrap::REPEAT {
        return Stretch { first: remainder(first, n) as u32, more: (last - first) as u32 };
    }
    // Two copies make a period, the second one mirrored. A stretch shorter than a copy crosses one fold at the most:
    // what is beyond it lies on what is before.
    let start = remainder(first, 2 * n);
    let end = start + (last - first);
    let (from, to) = if end < n {
        (start, end)
    } else if start < n {
        (start.min(2 * n - 1 - end), n - 1)
    } else if end < 2 * n {
        (2 * n - 1 - end, 2 * n - 1 - start)
    } else {
        (0, (2 * n - 1 - start).max(end - 2 * n))
    };
    Stretch { first: from as u32, more: (to - from) as u32 }
}

/// i modulo n, not negative.
#[inline]
fn remainder(i: i32, n: i32) -> i32 {
    let r = i % n;
    if r < 0 { r + n } else { r }
}

/// The range of the texels that a filter reads between texel coordinates `low` and `high`, which rounding is already
/// added to ([`texel_error`]): from the lowest level with an entry that holds them all. A single read.
#[inline]
pub fn range_between(field: &HeightField<'_>, map: &Displacement, low: Vec2, high: Vec2) -> TexelRange {
    let (width, height) = (map.map_width, map.map_height);
    let x = fold(low.x, high.x, width, field.wrap);
    let y = fold(low.y, high.y, height, field.wrap);
    let top = top_level(width, height);
    let longest = x.more.max(y.more);
    // 2^l >= longest is enough wherever the box begins; one level less where it begins well.
    let enough = if longest >= 1 << top { top } else { ceil_log2(longest.max(1)) };
    let less = if enough > 0 { enough - 1 } else { 0 };
    let fits = ends_within(x, less) && ends_within(y, less);
    let level = if fits { less } else { enough };
    read(field.texels, field.ranges, map, field.format, field.wrap, level, x.first, y.first)
}

/// Whether a stretch ends within the entry of `level` at its first texel.
#[inline]
fn ends_within(stretch: Stretch, level: u32) -> bool {
    let offset = stretch.first & ((1 << level) - 1);
    stretch.more < (2 << level) - offset
}

/// Along each axis [`height_bounds`] reads some 2^FINENESS entries.
const FINENESS: u32 = 3;

/// Bounds on the height of every micro-vertex of `triangle` that its own field decides, whatever N is: the range of the
/// texels in the box of its texture coordinates, bilinear support included, rounded outward by
/// [`Displacement::height_range`]. Read from a level so fine that the box overlaps some 2^FINENESS entries a side: what it
/// adds to the box is little.
pub fn height_bounds(field: &HeightField<'_>, vertices: &[Vertex], triangle: Triangle) -> (f32, f32) {
    let uv = |i: usize| {
        let vertex = at(vertices, triangle.vertices[i]);
        Vec2::new(vertex.u, vertex.v)
    };
    uv_box_bounds(field, triangle.displacement, &[uv(0), uv(1), uv(2)])
}

/// [`height_bounds`] for the convex hull of any texture coordinates.
pub fn uv_box_bounds(field: &HeightField<'_>, displacement: u32, uvs: &[Vec2]) -> (f32, f32) {
    let map = field.displacement(displacement);
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    let mut greatest = Vec2::ZERO;
    for &uv in uvs {
        let t = texel_coordinates(&map, uv);
        (low, high, greatest) = (low.min(t), high.max(t), greatest.max(uv.abs()));
    }
    let error = texel_error(&map, greatest);
    let (low, high) = (low - error, high + error);
    let x = fold(low.x, high.x, map.map_width, field.wrap);
    let y = fold(low.y, high.y, map.map_height, field.wrap);
    let (across, down) = (x.more, y.more);
    let level = ceil_log2(across.max(down).max(1)).saturating_sub(FINENESS);
    // An entry at a texel reaches at least a spacing beyond it.
    let stride = 1 << level;
    let mut range = TexelRange::EMPTY;
    let mut j = 0;
    while j <= down {
        let mut i = 0;
        while i <= across {
            let (tx, ty) = ((x.first + i) % map.map_width, (y.first + j) % map.map_height);
            range = range.including(read(
                field.texels,
                field.ranges,
                &map,
                field.format,
                field.wrap,
                level,
                tx,
                ty,
            ));
            i += stride;
        }
        j += stride;
    }
    Displacement::height_range(range.min, range.max, map.zero, map.scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::barycentric::grid_point;
    use crate::displacement::surface::BaseTriangle;
    use crate::math::tests::Numbers;
    use crate::scene::Features;
    use crate::test_scene::{FLAT, TestScene};

    /// A map of random texels with a few peaks, and a triangle with texture coordinates of up to `reach`.
    fn random_scene(numbers: &mut Numbers, reach: f32) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let (width, height) = (1 + (numbers.unit() * 40.0) as u32, 1 + (numbers.unit() * 40.0) as u32);
        scene.height_texels = (0..width * height)
            .map(|_| if numbers.unit() < 0.05 { numbers.unit() } else { 0.01 * numbers.unit() })
            .map(f32::to_bits)
            .collect();
        let origin = numbers.vec3() * 3.0;
        for vertex in &mut scene.vertices {
            let offset = numbers.vec3() * reach;
            (vertex.u, vertex.v) = (origin.x + offset.x, origin.y + offset.y);
        }
        let d = &mut scene.displacements[0];
        (d.map_width, d.map_height, d.scale, d.zero) = (width, height, 1.0, 0.25);
        (d.height_min, d.height_max) = Displacement::height_range(0.0, 1.0, d.zero, d.scale);
        scene
    }

    #[test]
    fn bounds_hold_every_height_over_the_triangle() {
        let mut numbers = Numbers::new(31);
        let mut tighter = 0;
        for round in 0..6_000 {
            let mut scene = random_scene(&mut numbers, [0.02, 0.2, 1.0][round % 3]);
            let features = Features { height_wrap: round as u32 / 3 % 3, ..FLAT };
            scene.build_pyramids(features);
            let view = scene.view();
            let field = HeightField::new(&view, features);
            let (low, high) = height_bounds(&field, &scene.vertices, scene.triangles[0]);
            tighter += u32::from(high - low < 0.9);
            let base = BaseTriangle::load(&view, 0);
            for j in 0..=24 {
                for k in 0..=24 - j {
                    let h = field.height(&scene.displacements[0], base.uv(grid_point(j, k, 24)));
                    assert!(
                        h >= low && h <= high,
                        "{h} outside [{low}, {high}], wrap {}",
                        features.height_wrap
                    );
                }
            }
        }
        assert!(tighter > 1_000, "the bounds are no better than the map's: {tighter}");
    }

    #[test]
    fn small_footprint_does_not_see_a_far_peak() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.height_texels = vec![0; 64 * 64];
        scene.height_texels[64 * 32 + 32] = 1.0_f32.to_bits();
        for vertex in &mut scene.vertices {
            (vertex.u, vertex.v) = (0.1 + 0.01 * vertex.position.x, 0.1 + 0.01 * vertex.position.y);
        }
        let d = &mut scene.displacements[0];
        (d.map_width, d.map_height, d.scale, d.height_max) = (64, 64, 1.0, 1.0);
        scene.build_pyramids(FLAT);
        let view = scene.view();
        let field = HeightField::new(&view, FLAT);
        assert_eq!(height_bounds(&field, &scene.vertices, scene.triangles[0]), (0.0, 0.0));
    }
}
