//! The min/max pyramid of a height map: bounds on heights over any box of texels in a few reads.
//!
//! Entry (x, y) of level l holds the least and the greatest texel of the square that begins at texel (x 2^l, y 2^l) and
//! is 2^(l+1) texels wide: twice the entries' spacing, so that any box no larger than 2^l + 1 texels lies in the entry
//! at its first texel, wherever that is. Squares go on beyond the map as the map itself does where it repeats; where it
//! is clamped or mirrored they are cut off, since boxes are folded into the map before they are asked for.
//!
//! Level 0, the four texels of a bilinear filter, is read from the map. Levels 1 to [`top_level`] are stored, each
//! entry in the format of the texels, so that ranges are exact: a third of a map's texels, twice. In words, from
//! [`Displacement::first_range`] on: [`HEADER`] words with the first word of each level, then level 1, level 2, ...

use crate::displacement::surface::HeightField;
use crate::interface::{Displacement, Triangle, Vertex, height_format, wrap};
use crate::math::{MinMax, UNIT_ROUNDOFF, at, ceil_log2, floor, fma, put, to_u32};
use crate::texture::{height_texel, unorm8, unorm16};
use glam::Vec2;

/// Most texels along a side of a map: two of its periods are counted in floats, exactly.
pub const MAX_MAP_SIDE: u32 = 1 << 22;

/// Words before level 1: word l is where level l begins, counted from word 0; word 0 is not used. No map has as many
/// levels.
pub const HEADER: u32 = 32;

/// The level whose one entry is the whole map; 0 where the map is a single texel.
#[inline]
pub fn top_level(width: u32, height: u32) -> u32 {
    ceil_log2(width.max(height))
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
        TexelRange { min: self.min.min_num(other.min), max: self.max.max_num(other.max) }
    }
}

/// A height map with its pyramid, or with as many of its levels as are built.
#[derive(Clone, Copy)]
pub struct Pyramid<'a> {
    /// The texels of all maps.
    pub texels: &'a [u32],
    /// The pyramids of all maps.
    pub ranges: &'a [u32],
    /// Which map, and where it begins in both. Its own copy: a reference would keep what it is a part of in memory, and
    /// drivers then find less of it constant.
    pub map: Displacement,
    /// How texels are stored: see [`height_format`].
    pub format: u32,
    /// How the map goes on beyond its borders: see [`wrap`].
    pub wrap: u32,
}

impl Pyramid<'_> {
    /// Word `item` of level `level`, at least 1; the levels below must be built.
    ///
    /// Cost: nine reads an entry, sixteen at a repeated border.
    #[inline]
    pub fn level_word(&self, level: u32, item: u32) -> u32 {
        let count = entries(self.map.map_width, level) * entries(self.map.map_height, level);
        // A word holds two entries of bytes, one of halves, or half of one of floats.
        let (first, last) = if self.format == height_format::UNORM8 {
            (2 * item, (2 * item + 1).min(count - 1))
        } else if self.format == height_format::UNORM16 {
            (item, item)
        } else {
            (item >> 1, item >> 1)
        };
        let mut word = 0;
        let mut entry = first;
        while entry <= last {
            let range = self.below(level, entry);
            word |= if self.format == height_format::UNORM8 {
                ((range.min * 255.0 + 0.5) as u32 | ((range.max * 255.0 + 0.5) as u32) << 8)
                    << (16 * (entry - first))
            } else if self.format == height_format::UNORM16 {
                (range.min * 65535.0 + 0.5) as u32 | ((range.max * 65535.0 + 0.5) as u32) << 16
            } else {
                (if item & 1 == 0 { range.min } else { range.max }).to_bits()
            };
            entry += 1;
        }
        word
    }

    /// Entry number `entry` of `level`, from the level below.
    ///
    /// Its square is twice as wide as those below: four of their spacings, which the entries at the first three
    /// spacings cover. Where the third one has gone round a repeated border, its square begins before what it has to
    /// cover and ends as much too early, and a fourth is needed.
    #[inline]
    fn below(&self, level: u32, entry: u32) -> TexelRange {
        let (width, height) = (self.map.map_width, self.map.map_height);
        let across = entries(width, level);
        let (x, y) = ((entry % across) << level, (entry / across) << level);
        let spacing = 1 << (level - 1);
        let mut range = TexelRange::EMPTY;
        let mut i = 0;
        while i < 16 {
            let (sx, sy) = (x + (i & 3) * spacing, y + (i >> 2) * spacing);
            let needed = (i & 3 < 3 || sx - spacing >= width) && (i >> 2 < 3 || sy - spacing >= height);
            let inside = sx < width && sy < height;
            if needed && (inside || self.wrap == wrap::REPEAT) {
                range = range.including(self.entry(level - 1, sx % width, sy % height));
            }
            i += 1;
        }
        range
    }

    /// The entry of `level` at texel (x, y).
    #[inline]
    fn entry(&self, level: u32, x: u32, y: u32) -> TexelRange {
        let Displacement { map_width, map_height, first_range, .. } = self.map;
        if level == 0 {
            let (x1, y1) = (next_texel(x, map_width, self.wrap), next_texel(y, map_height, self.wrap));
            let (top, bottom) = (y * map_width, y1 * map_width);
            let (a, b) = (self.texel(top + x), self.texel(top + x1));
            let (c, d) = (self.texel(bottom + x), self.texel(bottom + x1));
            return TexelRange {
                min: a.min_num(b).min_num(c.min_num(d)),
                max: a.max_num(b).max_num(c.max_num(d)),
            };
        }
        let entry = (y >> level) * entries(map_width, level) + (x >> level);
        self.stored(first_range + at(self.ranges, first_range + level), entry)
    }

    /// Entry number `entry` of a stored level whose first word is `first`.
    #[inline]
    fn stored(&self, first: u32, entry: u32) -> TexelRange {
        if self.format == height_format::UNORM8 {
            let word = at(self.ranges, first + (entry >> 1));
            let lane = 2 * (entry & 1);
            TexelRange { min: unorm8(word, lane), max: unorm8(word, lane + 1) }
        } else if self.format == height_format::UNORM16 {
            let word = at(self.ranges, first + entry);
            TexelRange { min: unorm16(word, 0), max: unorm16(word, 1) }
        } else {
            let word = first + 2 * entry;
            TexelRange {
                min: f32::from_bits(at(self.ranges, word)),
                max: f32::from_bits(at(self.ranges, word + 1)),
            }
        }
    }
}

/// Writes word `item` of level `level` to the pyramid, and with the first one where the next level begins. What the
/// entry point `height_pyramid` does, level by level. `format` and `wrap` are what is known of all maps.
#[inline]
pub fn build_word(
    texels: &[u32],
    ranges: &mut [u32],
    map: &Displacement,
    format: u32,
    wrap: u32,
    level: u32,
    item: u32,
) {
    let (format, wrap) = (map.known_format(format), map.known_wrap(wrap));
    let word = Pyramid { texels, ranges, map: *map, format, wrap }.level_word(level, item);
    let header = map.first_range;
    let first = if level == 1 { HEADER } else { at(ranges, header + level) };
    put(ranges, header + first + item, word);
    if item == 0 && level == 1 {
        put(ranges, header + 1, HEADER);
    }
    if item == 0 && level < top_level(map.map_width, map.map_height) {
        let next = first + level_words(format, map.map_width, map.map_height, level);
        put(ranges, header + level + 1, next);
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

/// A stretch of texels along an axis: the first, and how many more there are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    first: u32,
    more: u32,
    /// Whether it is of two neighbours in the endless map, so that a filter is linear along it.
    is_pair: bool,
    /// Whether it runs backwards in the map: in a mirrored copy.
    reversed: bool,
}

/// Texel coordinates of texture coordinates, texel centres at integers, rows downwards, in the endless map.
#[inline]
pub fn texel_coordinates(map: &Displacement, uv: Vec2) -> Vec2 {
    let (width, height) = (map.map_width as f32, map.map_height as f32);
    Vec2::new(uv.x * width - 0.5, height - uv.y * height - 0.5)
}

/// How far texel coordinates, computed from texture coordinates up to `uv` in magnitude by some linear function of the
/// grid, can lie from those that a micro-vertex reads: u = 2^-24 for each of the 4 roundings of the interpolated
/// coordinate and 5 of its weights (Vulkan's division), 2 for its reduction, 2 for its scale; for this side's linear
/// function 5 of 1/N times differences of twice the magnitude, and 6 of its own: below 32, all of magnitude |uv| + 1.
#[inline]
pub fn texel_error(map: &Displacement, uv: Vec2) -> Vec2 {
    let error = (uv.abs() + Vec2::ONE) * (32.0 * UNIT_ROUNDOFF);
    Vec2::new(error.x * map.map_width as f32, error.y * map.map_height as f32)
}

/// Largest distance from texel 0 at which texel coordinates are computed with; beyond it they are rounded to more than
/// a quarter of a texel.
const FARTHEST: f32 = 4_194_304.0;

/// The texels that filters between coordinates `low` and `high` read: all of them where that is more than the map, or
/// too far out.
#[inline]
fn fold(low: f32, high: f32, size: u32, mode: u32) -> Stretch {
    let n = size as f32;
    let (first, last) = (floor(low), floor(high) + 1.0);
    // NaN is not near either. No lazy operators and no branches but of constants: on a GPU each would be one.
    let near = (first >= -FARTHEST) & (last <= FARTHEST);
    let length = last - first;
    let (from, to, reversed, whole);
    if mode == wrap::CLAMP {
        from = first.max_num(0.0).min_num(n - 1.0);
        to = last.max_num(0.0).min_num(n - 1.0);
        (reversed, whole) = (false, !near);
    } else if mode == wrap::REPEAT {
        from = remainder(first, n);
        to = from + length;
        (reversed, whole) = (false, !near | (length >= n));
    } else {
        // Two copies make a period, the second one mirrored. A stretch shorter than a copy crosses one fold at the
        // most: what is beyond it lies on what is before.
        let start = remainder(first, 2.0 * n);
        let end = start + length;
        let (mirrored_start, mirrored_end) = (2.0 * n - 1.0 - start, 2.0 * n - 1.0 - end);
        (from, to) = if end < n {
            (start, end)
        } else if start < n {
            (start.min_num(mirrored_end), n - 1.0)
        } else if end < 2.0 * n {
            (mirrored_end, mirrored_start)
        } else {
            (0.0, mirrored_start.max_num(end - 2.0 * n))
        };
        reversed = (start >= n) & (end < 2.0 * n);
        whole = !near | (length >= n);
    }
    let (from, more) = if whole { (0.0, n - 1.0) } else { (from, to - from) };
    Stretch {
        first: to_u32(from),
        more: to_u32(more),
        is_pair: (length == 1.0) & !whole,
        reversed: reversed & !whole,
    }
}

/// The integer `i` modulo the integer n, not negative: for |i| up to [`FARTHEST`], n from 2 to twice
/// [`MAX_MAP_SIDE`]. On a GPU that is
/// shorter than a division of integers.
#[inline]
fn remainder(i: f32, n: f32) -> f32 {
    rest(i, n, i / n)
}

/// The same with the quotient, which may be off by 2.5 ulp, as Vulkan's division is: it is no more than 2^21, so that
/// its floor is at most one off. Products and differences are of integers below 2^24, and exact.
#[inline]
fn rest(i: f32, n: f32, quotient: f32) -> f32 {
    let rest = i - floor(quotient) * n;
    let rest = if rest < 0.0 { rest + n } else { rest };
    if rest >= n { rest - n } else { rest }
}

impl Pyramid<'_> {
    /// Texel `i` of the map, the first at the top left.
    #[inline]
    fn texel(&self, i: u32) -> f32 {
        height_texel(self.texels, self.format, self.map.first_word, i)
    }

    /// A range that holds what a filter gives between texel coordinates `low` and `high`, to within the rounding that
    /// [`Displacement::height_range`] allows for; that of coordinates ([`texel_error`]) is already added to them. Read
    /// are at most nine texels, or one to four entries of the lowest level at which two an axis hold them all; always
    /// as many as that, some of them twice. That range is of a box less than twice as long as the one asked for. A
    /// single entry of the next level would do too; a descent that reads one visits a third more micro-triangles and
    /// takes longer.
    #[inline]
    pub fn range_between(&self, low: Vec2, high: Vec2) -> TexelRange {
        let Displacement { map_width: width, map_height: height, first_range, .. } = self.map;
        let x = fold(low.x, high.x, width, self.wrap);
        let y = fold(low.y, high.y, height, self.wrap);
        // An entry at a texel reaches at least a spacing beyond it, so that two reach twice as far.
        let longest = x.more.max(y.more);
        let level = if longest > 2 { ceil_log2(longest) - 1 } else { 0 };
        if level == 0 {
            return self.texel_range(low, high, x, y);
        }
        let spacing = 1 << level;
        let (across, down) = (x.more.max(spacing) - spacing, y.more.max(spacing) - spacing);
        let first = first_range + at(self.ranges, first_range + level);
        let columns = entries(width, level);
        let (left, right) = (x.first >> level, wrapped(x.first + across, width) >> level);
        let (top, bottom) = (y.first >> level, wrapped(y.first + down, height) >> level);
        let (top, bottom) = (top * columns, bottom * columns);
        // Where one an axis is enough it is read twice: on a GPU a branch that leaves out a read costs more, since the
        // reads behind it wait for that before it.
        let (a, b) = (self.stored(first, top + left), self.stored(first, top + right));
        let (c, d) = (self.stored(first, bottom + left), self.stored(first, bottom + right));
        a.including(b).including(c.including(d))
    }

    /// The same of at most 3 x 3 texels, which are fewer reads than four entries of level 0 would take.
    ///
    /// A filter that reads the same four texels everywhere between `low` and `high` is bilinear there, so that its
    /// extremes are at the corners of the box. However small the box, the range is as small; that of the texels would
    /// not be.
    #[inline]
    fn texel_range(&self, low: Vec2, high: Vec2, x: Stretch, y: Stretch) -> TexelRange {
        let Displacement { map_width: width, map_height: height, .. } = self.map;
        let (left, middle, right) =
            (x.first, wrapped(x.first + x.more.min(1), width), wrapped(x.first + x.more, width));
        let (top, center, bottom) =
            (y.first, wrapped(y.first + y.more.min(1), height), wrapped(y.first + y.more, height));
        let (top, center, bottom) = (top * width, center * width, bottom * width);
        // All nine, some of them twice where there are fewer, since none waits for another.
        let (a, b, c) = (self.texel(top + left), self.texel(top + middle), self.texel(top + right));
        let (d, e, f) = (self.texel(center + left), self.texel(center + middle), self.texel(center + right));
        let (g, h, i) = (self.texel(bottom + left), self.texel(bottom + middle), self.texel(bottom + right));
        if x.is_pair && y.is_pair {
            let (a, c) = if x.reversed { (c, a) } else { (a, c) };
            let (g, i) = if x.reversed { (i, g) } else { (g, i) };
            let (a, c, g, i) = if y.reversed { (g, i, a, c) } else { (a, c, g, i) };
            let origin = Vec2::new(floor(low.x), floor(low.y));
            let (from, to) = (low - origin, high - origin);
            let (top_from, top_to) = (fma(from.x, c - a, a), fma(to.x, c - a, a));
            let (bottom_from, bottom_to) = (fma(from.x, i - g, g), fma(to.x, i - g, g));
            let (p, q) =
                (fma(from.y, bottom_from - top_from, top_from), fma(from.y, bottom_to - top_to, top_to));
            let (r, s) = (fma(to.y, bottom_from - top_from, top_from), fma(to.y, bottom_to - top_to, top_to));
            TexelRange { min: p.min_num(q).min_num(r.min_num(s)), max: p.max_num(q).max_num(r.max_num(s)) }
        } else {
            let (least, greatest) = (a.min_num(b).min_num(c), a.max_num(b).max_num(c));
            let (least, greatest) =
                (least.min_num(d).min_num(e).min_num(f), greatest.max_num(d).max_num(e).max_num(f));
            TexelRange {
                min: least.min_num(g).min_num(h).min_num(i),
                max: greatest.max_num(g).max_num(h).max_num(i),
            }
        }
    }
}

/// A texel less than two periods from the map's first one.
#[inline]
fn wrapped(i: u32, size: u32) -> u32 {
    if i >= size { i - size } else { i }
}

/// Along each axis [`height_bounds`] reads some 2^FINENESS entries.
const FINENESS: u32 = 3;

/// Bounds on the height of every micro-vertex of `triangle` that its own field decides, whatever N is: the range of the
/// texels in the box of its texture coordinates, bilinear support included, rounded outward by
/// [`Displacement::height_range`]. Read from a level so fine that the box overlaps some 2^FINENESS entries a side: what
/// it adds to the box is little.
pub fn height_bounds(field: &HeightField<'_>, vertices: &[Vertex], triangle: Triangle) -> (f32, f32) {
    let a = uv_of(vertices, triangle.vertices[0]);
    let b = uv_of(vertices, triangle.vertices[1]);
    let c = uv_of(vertices, triangle.vertices[2]);
    let [i, j, k] = triangle.vertices;
    let span = field.span(i).max_num(field.span(j)).max_num(field.span(k));
    uv_box_bounds(field, triangle.displacement, a.min_num(b).min_num(c), a.max_num(b).max_num(c), span)
}

/// Texture coordinates of vertex `i`.
#[inline]
fn uv_of(vertices: &[Vertex], i: u32) -> Vec2 {
    let vertex = at(vertices, i);
    Vec2::new(vertex.u, vertex.v)
}

/// [`height_bounds`] for all texture coordinates between `uv_low` and `uv_high`, read for pixels of up to `span`
/// texels. Of vector displacement minus and plus the sum of its components' greatest magnitudes: the vector is no
/// longer than that, whatever unit vectors it is along.
pub fn uv_box_bounds(
    field: &HeightField<'_>,
    displacement: u32,
    uv_low: Vec2,
    uv_high: Vec2,
    span: f32,
) -> (f32, f32) {
    let count = if field.is_vector() { 3 } else { 1 };
    let (mut bounds, mut length) = ((0.0, 0.0), 0.0);
    let mut axis = 0;
    while axis < count {
        bounds = map_bounds(field, displacement + axis, uv_low, uv_high, span);
        length += bounds.0.abs().max_num(bounds.1.abs());
        axis += 1;
    }
    if field.is_vector() {
        // Two sums that may have been rounded down.
        let length = length * (1.0 + 4.0 * UNIT_ROUNDOFF);
        bounds = (-length, length);
    }
    bounds
}

/// Bounds on the heights of one map.
fn map_bounds(
    field: &HeightField<'_>,
    displacement: u32,
    uv_low: Vec2,
    uv_high: Vec2,
    span: f32,
) -> (f32, f32) {
    let map = field.displacement(displacement);
    let pyramid = field.pyramid(map);
    // Rows of a map run downwards.
    let (a, b) = (texel_coordinates(&map, uv_low), texel_coordinates(&map, uv_high));
    let (low, high) = (a.min_num(b), a.max_num(b));
    let greatest = uv_low.abs().max_num(uv_high.abs());
    let error = texel_error(&map, greatest);
    let error = if field.is_filtered() { error + level_support(&map, span) } else { error };
    let (low, high) = (low - error, high + error);
    let x = fold(low.x, high.x, map.map_width, pyramid.wrap);
    let y = fold(low.y, high.y, map.map_height, pyramid.wrap);
    let (across, down) = (x.more, y.more);
    // rust-gpu has no saturating subtraction.
    let level = ceil_log2(across.max(down).max(1)).max(FINENESS) - FINENESS;
    // An entry at a texel reaches at least a spacing beyond it.
    let stride = 1 << level;
    let mut range = TexelRange::EMPTY;
    let mut j = 0;
    while j <= down {
        let mut i = 0;
        while i <= across {
            let (tx, ty) = ((x.first + i) % map.map_width, (y.first + j) % map.map_height);
            range = range.including(pyramid.entry(level, tx, ty));
            i += stride;
        }
        j += stride;
    }
    Displacement::height_range(range.min, range.max, map.zero, map.scale)
}

/// How far, in texels, the levels up to the one whose texels are `span` wide, a power of two, reach beyond the point
/// that a filter reads. A texel of theirs is r texels of the map wide, and the filter reads those up to 1.5 r away.
/// Where sides are odd, a texel is made of parts of such ones of the level before that reach beyond it, these by less
/// than half of r, and so on: r more in all.
#[inline]
fn level_support(map: &Displacement, span: f32) -> Vec2 {
    let level = (span.max(1.0).to_bits() >> 23) - 127;
    // No map has more than 32 levels.
    let level = level.min(31);
    let width = map.map_width as f32 / (map.map_width >> level).max(1) as f32;
    let height = map.map_height as f32 / (map.map_height >> level).max(1) as f32;
    Vec2::new(width, height) * 2.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::barycentric::grid_point;
    use crate::displacement::surface::{BaseTriangle, Pixel};
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
    fn remainders_are_exact_whatever_division_errs_by() {
        let ulp = f32::EPSILON;
        for n in [2_i32, 3, 5, 7, 64, 1000, 1023, 16_384, 1 << 22] {
            for i in (0..30_000_i32).flat_map(|i| [i, 4_194_304 - i, -i, i - 4_194_304]) {
                let (x, y) = (i as f32, n as f32);
                for error in [0.0, 2.5 * ulp, -2.5 * ulp] {
                    assert_eq!(rest(x, y, x / y * (1.0 + error)), i.rem_euclid(n) as f32, "{i} {n} {error}");
                }
            }
        }
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
                    let h = field.height(&scene.displacements[0], base.uv(grid_point(j, k, 24)), Pixel::NONE);
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

    /// A map of random codes in each format, with its pyramid.
    fn random_map(numbers: &mut Numbers, format: u32, mode: u32, width: u32, height: u32) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let words = (width * height).div_ceil([4, 2, 1][format as usize]);
        let mut word = || (numbers.unit() * 65_536.0) as u32 | ((numbers.unit() * 65_536.0) as u32) << 16;
        scene.height_texels = (0..words).map(|_| word()).collect();
        if format == height_format::FLOAT32 {
            scene.height_texels = scene.height_texels.iter().map(|&w| (w as f32 - 2e9).to_bits()).collect();
        }
        (scene.displacements[0].map_width, scene.displacements[0].map_height) = (width, height);
        // A second map, so that the first one's ends are not the buffers'.
        scene.displacements.push(scene.displacements[0]);
        scene.build_pyramids(Features { height_format: format, height_wrap: mode, ..FLAT });
        scene
    }

    /// The texel at an index of the endless map: `wrap` as its definition says it, one period after the other.
    fn endless(field: &HeightField<'_>, map: &Displacement, x: i32, y: i32) -> f32 {
        let folded = |i: i32, size: u32| {
            let n = size as i32;
            match field.pyramid(*map).wrap {
                wrap::REPEAT => i.rem_euclid(n),
                wrap::MIRROR if i.div_euclid(n) % 2 == 0 => i.rem_euclid(n),
                wrap::MIRROR => n - 1 - i.rem_euclid(n),
                _ => i.clamp(0, n - 1),
            }
        };
        let (x, y) = (folded(x, map.map_width), folded(y, map.map_height));
        field.pyramid(*map).texel(y as u32 * map.map_width + x as u32)
    }

    fn sizes() -> [(u32, u32); 9] {
        [(1, 1), (1, 7), (9, 1), (2, 2), (3, 5), (8, 8), (13, 37), (64, 16), (31, 33)]
    }

    #[test]
    fn entries_are_the_ranges_of_their_squares() {
        let mut numbers = Numbers::new(32);
        for (format, mode, (width, height)) in cases() {
            let scene = random_map(&mut numbers, format, mode, width, height);
            let view = scene.view();
            let features = Features { height_format: format, height_wrap: mode, ..FLAT };
            let field = HeightField::new(&view, features);
            let map = &scene.displacements[1];
            for level in 0..=top_level(width, height) {
                let (columns, rows) = (((width - 1) >> level) + 1, ((height - 1) >> level) + 1);
                for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x << level, y << level))) {
                    let entry = field.pyramid(*map).entry(level, x, y);
                    let last = 2 << level;
                    let mut expected = TexelRange::EMPTY;
                    // Where the map does not repeat squares end with it.
                    let end = |first: u32, size: u32| {
                        let cut = if mode == wrap::REPEAT { first + last } else { size.min(first + last) };
                        first as i32..cut as i32
                    };
                    for (tx, ty) in end(y, height).flat_map(|ty| end(x, width).map(move |tx| (tx, ty))) {
                        let texel = endless(&field, map, tx, ty);
                        expected = expected.including(TexelRange { min: texel, max: texel });
                    }
                    // Round a repeated border entries may hold more: their neighbours' squares.
                    let around = mode == wrap::REPEAT && (x + last > width || y + last > height);
                    let holds = entry.min <= expected.min && entry.max >= expected.max;
                    assert!(
                        holds && (around || entry == expected),
                        "{entry:?} {expected:?}, level {level} at ({x}, {y}) of {width}x{height}, wrap {mode}"
                    );
                }
            }
        }
    }

    fn cases() -> impl Iterator<Item = (u32, u32, (u32, u32))> {
        (0..9).flat_map(|i| sizes().map(|size| (i % 3, i / 3, size)))
    }

    #[test]
    fn ranges_hold_what_filters_give_and_little_more() {
        let mut numbers = Numbers::new(33);
        let (mut asked, mut whole) = (0, 0);
        for (format, mode, (width, height)) in cases() {
            let scene = random_map(&mut numbers, format, mode, width, height);
            let view = scene.view();
            let features = Features { height_format: format, height_wrap: mode, ..FLAT };
            let field = HeightField::new(&view, features);
            let map = &scene.displacements[1];
            for _ in 0..2_000 {
                let size = Vec2::new(numbers.unit(), numbers.unit()) * (numbers.unit() * 7.0).exp2();
                let centre = numbers.vec3().truncate() * 100.0;
                let (low, high) = (centre - size * 0.5, centre + size * 0.5);
                let range = field.pyramid(*map).range_between(low, high);
                let (from, to) = (low.floor().as_ivec2(), high.floor().as_ivec2() + glam::IVec2::ONE);
                // What a filter gives in the box, from the definition of the endless map.
                for _ in 0..8 {
                    let p = low + (high - low) * Vec2::new(numbers.unit(), numbers.unit());
                    let (i, f) = (p.floor(), (p - p.floor()).as_dvec2());
                    let at = |dx, dy| f64::from(endless(&field, map, i.x as i32 + dx, i.y as i32 + dy));
                    let upper = at(0, 0) + f.x * (at(1, 0) - at(0, 0));
                    let lower = at(0, 1) + f.x * (at(1, 1) - at(0, 1));
                    let value = upper + f.y * (lower - upper);
                    // The range is rounded six times; `height_range` adds that.
                    let error = 12.0 * f64::from(UNIT_ROUNDOFF * range.min.abs().max(range.max.abs()));
                    assert!(
                        value >= f64::from(range.min) - error && value <= f64::from(range.max) + error,
                        "{value} {range:?} at {p} in [{low}, {high}] of {width}x{height}, wrap {mode}"
                    );
                }
                let between_neighbours = to - from == glam::IVec2::ONE;
                // Twice as long a box and a texel more on either side bounds what else may be in it.
                let more = (to - from) + glam::IVec2::ONE;
                let mut wide = TexelRange::EMPTY;
                for y in from.y - more.y..=to.y + more.y {
                    for x in from.x - more.x..=to.x + more.x {
                        let texel = endless(&field, map, x, y);
                        wide = wide.including(TexelRange { min: texel, max: texel });
                        let inside = x >= from.x && x <= to.x && y >= from.y && y <= to.y;
                        assert!(
                            !inside || between_neighbours || range.min <= texel && texel <= range.max,
                            "{texel} {range:?} [{low}, {high}] of {width}x{height}, wrap {mode}"
                        );
                    }
                }
                asked += 1;
                whole += u32::from(range.min < wide.min || range.max > wide.max);
            }
        }
        // Long thin boxes are read at the level of their length, and so are those around a border.
        assert!(whole * 4 < asked, "{whole} of {asked} ranges are of more than the box's surroundings");
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
