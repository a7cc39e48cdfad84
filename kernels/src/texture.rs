//! Texture maps in storage buffers: bilinear filter, wrap modes, packed texel formats.

use crate::interface::{color_format, height_format, wrap};
use crate::math::{at, clamp, floor, fma, log2};
use glam::{Vec2, Vec3};

/// The four texels around a point and their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Footprint {
    /// Indices of the texels: top left, top right, bottom left, bottom right.
    pub(crate) texels: [u32; 4],
    /// Weight of the right texels.
    pub(crate) fx: f32,
    /// Weight of the bottom texels.
    pub(crate) fy: f32,
}

/// A texture coordinate brought into [0, 1]: repeat keeps the fraction, mirror folds, clamp clamps.
#[inline]
fn reduce(x: f32, mode: u32) -> f32 {
    if mode == wrap::REPEAT {
        x - floor(x)
    } else if mode == wrap::MIRROR {
        let folded = x - 2.0 * floor(x * 0.5);
        if folded > 1.0 { 2.0 - folded } else { folded }
    } else {
        clamp(x, 0.0, 1.0)
    }
}

/// How fast [`reduce`]d coordinates grow with the given ones: 1, or -1 in a mirrored copy, or 0 beyond a clamped
/// border.
#[inline]
fn reduce_slope(x: f32, mode: u32) -> f32 {
    if mode == wrap::REPEAT {
        1.0
    } else if mode == wrap::MIRROR {
        if x - 2.0 * floor(x * 0.5) > 1.0 { -1.0 } else { 1.0 }
    } else if x >= 0.0 && x <= 1.0 {
        1.0
    } else {
        0.0
    }
}

/// A texel index in [-1, n] brought into [0, n): at the border repeat goes to the other side, the others stay.
#[inline]
fn wrap_index(i: i32, n: i32, mode: u32) -> u32 {
    let inside = if i < 0 {
        if mode == wrap::REPEAT { n - 1 } else { 0 }
    } else if i >= n {
        if mode == wrap::REPEAT { 0 } else { n - 1 }
    } else {
        i
    };
    inside as u32
}

/// The footprint of (u, v) in a map of `width` x `height` texels, texel centres at half-integers, v upwards, the
/// first row at the top.
#[inline]
pub(crate) fn footprint(uv: Vec2, width: u32, height: u32, mode: u32) -> Footprint {
    let x = fma(reduce(uv.x, mode), width as f32, -0.5);
    let y = fma(-reduce(uv.y, mode), height as f32, height as f32 - 0.5);
    let (left, top) = (floor(x), floor(y));
    let x0 = wrap_index(left as i32, width as i32, mode);
    let x1 = wrap_index(left as i32 + 1, width as i32, mode);
    let y0 = wrap_index(top as i32, height as i32, mode) * width;
    let y1 = wrap_index(top as i32 + 1, height as i32, mode) * width;
    Footprint { texels: [y0 + x0, y0 + x1, y1 + x0, y1 + x1], fx: x - left, fy: y - top }
}

/// From `a` to `b` by `s` in [0, 1]; leaves [a,b] by at most an ulp of the larger.
#[inline]
fn lerp(s: f32, a: f32, b: f32) -> f32 {
    fma(s, b - a, a)
}

/// Texel `i` of a height map whose texels begin at word `first`.
#[inline]
pub fn height_texel(texels: &[u32], format: u32, first: u32, i: u32) -> f32 {
    if format == height_format::UNORM8 {
        unorm8(at(texels, first + (i >> 2)), i & 3)
    } else if format == height_format::UNORM16 {
        unorm16(at(texels, first + (i >> 1)), i & 1)
    } else {
        f32::from_bits(at(texels, first + i))
    }
}

/// Byte `lane` of a word as a number in [0, 1].
#[inline]
pub fn unorm8(word: u32, lane: u32) -> f32 {
    ((word >> (lane * 8)) & 0xff) as f32 / 255.0
}

/// Half `lane` of a word as a number in [0, 1].
#[inline]
pub fn unorm16(word: u32, lane: u32) -> f32 {
    ((word >> (lane * 16)) & 0xffff) as f32 / 65535.0
}

/// One of a map's levels: itself, or one of the ever smaller ones behind it.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    /// Texels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Index of its first texel in the map.
    pub first: u32,
}

impl Level {
    /// The map itself.
    #[inline]
    pub fn finest(width: u32, height: u32) -> Level {
        Level { width, height, first: 0 }
    }

    /// The next one, half as wide and high. The last one, a single texel, is followed by itself.
    #[inline]
    fn next(self) -> Level {
        let last = self.width == 1 && self.height == 1;
        Level {
            width: (self.width / 2).max(1),
            height: (self.height / 2).max(1),
            first: if last { self.first } else { self.first + self.width * self.height },
        }
    }

    /// Level `number`, counted from this one.
    #[inline]
    fn number(self, number: u32) -> Level {
        let mut level = self;
        let mut i = 0;
        while i < number {
            level = level.next();
            i += 1;
        }
        level
    }
}

/// Between which levels of a map a pixel is read.
#[derive(Clone, Copy, Debug)]
pub struct LevelOfDetail {
    /// The finer one, counted from the map itself.
    number: u32,
    /// The share of the next one.
    share: f32,
}

impl LevelOfDetail {
    /// The map itself.
    pub const FINEST: LevelOfDetail = LevelOfDetail { number: 0, share: 0.0 };

    /// For heights where a pixel covers `side` texels: 2^l (1 + s) are read from level l, and by the share s from the
    /// next. Unlike a logarithm that is computed alike everywhere, and what the levels differ by, if that grows no
    /// faster than their texels, grows no faster than `side`. The map itself where `side` is not above 1, or NaN.
    #[inline]
    pub fn new(side: f32) -> LevelOfDetail {
        let bits = if side > 1.0 { side.min(MOST_TEXELS).to_bits() } else { 1.0_f32.to_bits() };
        LevelOfDetail {
            number: (bits >> 23) - 127,
            share: f32::from_bits(bits & 0x7f_ffff | 1.0_f32.to_bits()) - 1.0,
        }
    }
}

/// No map has more than 32 levels.
const MOST_TEXELS: f32 = 2_147_483_648.0;

/// A height map in its buffer.
#[derive(Clone, Copy)]
pub struct HeightTexels<'a> {
    /// The texels of all maps.
    pub texels: &'a [u32],
    /// See [`height_format`].
    pub format: u32,
    /// See [`wrap`].
    pub wrap: u32,
    /// First word of the map.
    pub first_word: u32,
}

impl HeightTexels<'_> {
    /// The texels of a footprint in a level, in its order.
    #[inline]
    fn around(&self, level: Level, f: &Footprint) -> [f32; 4] {
        let first = level.first;
        [
            height_texel(self.texels, self.format, self.first_word, first + f.texels[0]),
            height_texel(self.texels, self.format, self.first_word, first + f.texels[1]),
            height_texel(self.texels, self.format, self.first_word, first + f.texels[2]),
            height_texel(self.texels, self.format, self.first_word, first + f.texels[3]),
        ]
    }

    /// The filtered value at (u, v), which must be finite, of a map whose levels stand one behind the other; those that
    /// are not read need not be there. Of the last level alone beyond it. The value leaves the range of the texels by
    /// at most 4 ulp of the greatest magnitude among them, of a single level by 3.
    #[inline]
    pub fn sample(&self, finest: Level, uv: Vec2, detail: LevelOfDetail) -> f32 {
        let mut level = finest.number(detail.number);
        let count = if detail.share > 0.0 { 2 } else { 1 };
        let mut value = 0.0;
        // A loop, so that the code of the filter stands in a kernel once; left from its end, so that where `detail` is
        // constant a compiler sees that there is no second turn.
        let mut i = 0;
        loop {
            let f = footprint(uv, level.width, level.height, self.wrap);
            let t = self.around(level, &f);
            let of_level = lerp(f.fy, lerp(f.fx, t[0], t[1]), lerp(f.fx, t[2], t[3]));
            value = if i == 0 { of_level } else { lerp(detail.share, value, of_level) };
            level = level.next();
            i += 1;
            if i >= count {
                break;
            }
        }
        value
    }

    /// The gradient of [`sample`](Self::sample) at (u, v), which must be finite: its growth for a unit of u, and of v.
    /// On the lines through texel centres, where the filter has a kink, it is that of the texels to the right and
    /// below.
    #[inline]
    pub fn gradient(&self, finest: Level, uv: Vec2, detail: LevelOfDetail) -> Vec2 {
        let mut level = finest.number(detail.number);
        let count = if detail.share > 0.0 { 2 } else { 1 };
        let mut gradient = Vec2::ZERO;
        let mut i = 0;
        loop {
            let f = footprint(uv, level.width, level.height, self.wrap);
            let t = self.around(level, &f);
            let along_row = lerp(f.fy, t[1] - t[0], t[3] - t[2]);
            let down = lerp(f.fx, t[2] - t[0], t[3] - t[1]);
            // Rows are counted downwards, v upwards.
            let of_level = Vec2::new(
                along_row * (level.width as f32 * reduce_slope(uv.x, self.wrap)),
                -down * (level.height as f32 * reduce_slope(uv.y, self.wrap)),
            );
            gradient = if i == 0 { of_level } else { gradient + (of_level - gradient) * detail.share };
            level = level.next();
            i += 1;
            if i >= count {
                break;
            }
        }
        gradient
    }
}

/// Texel `i` of a colour map that begins at word `first`, linear RGB.
#[inline]
fn color_texel(texels: &[u32], format: u32, first: u32, i: u32) -> Vec3 {
    if format == color_format::SRGB8 {
        let code = at(texels, first + 256 + i);
        Vec3::new(
            f32::from_bits(at(texels, first + (code & 0xff))),
            f32::from_bits(at(texels, first + (code >> 8 & 0xff))),
            f32::from_bits(at(texels, first + (code >> 16 & 0xff))),
        )
    } else {
        let first = first + 3 * i;
        Vec3::new(
            f32::from_bits(at(texels, first)),
            f32::from_bits(at(texels, first + 1)),
            f32::from_bits(at(texels, first + 2)),
        )
    }
}

/// A colour map in its buffer.
#[derive(Clone, Copy, Debug)]
pub struct ColorTexels<'a> {
    /// The words of all maps.
    pub texels: &'a [u32],
    /// See [`color_format`].
    pub format: u32,
    /// See [`wrap`].
    pub wrap: u32,
    /// First word of the map, its table's where it has one.
    pub first_word: u32,
}

impl ColorTexels<'_> {
    /// The bilinearly filtered linear RGB of a level at (u, v), which must be finite.
    #[inline]
    pub fn sample(&self, level: Level, uv: Vec2) -> Vec3 {
        let f = footprint(uv, level.width, level.height, self.wrap);
        let texel =
            |i: usize| color_texel(self.texels, self.format, self.first_word, level.first + f.texels[i]);
        texel(0).lerp(texel(1), f.fx).lerp(texel(2).lerp(texel(3), f.fx), f.fy)
    }

    /// The linear RGB of a map whose levels stand one behind the other, around (u, v), which must be finite: between
    /// the two levels whose texels are next in size to `side` texels of the first level. That one alone where `side` is
    /// not above 1 (or NaN), the last one alone where it is beyond the map.
    #[inline]
    pub fn sample_levels(&self, finest: Level, uv: Vec2, side: f32) -> Vec3 {
        let lod = if side > 1.0 { log2(side.min(MOST_TEXELS)) } else { 0.0 };
        let below = floor(lod);
        let mut level = finest.number(below as u32);
        let mut colors = [Vec3::ZERO; 2];
        let mut i = 0;
        while i < 2 {
            colors[i] = self.sample(level, uv);
            level = level.next();
            i += 1;
        }
        colors[0].lerp(colors[1], lod - below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 4x2 map; row 0 is the top.
    const MAP: [f32; 8] = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0];

    fn sample(mode: u32, u: f32, v: f32) -> f32 {
        floats(&MAP.map(f32::to_bits), mode).sample(
            Level::finest(4, 2),
            Vec2::new(u, v),
            LevelOfDetail::FINEST,
        )
    }

    /// A map of floats at the beginning of its buffer.
    fn floats(texels: &[u32], wrap: u32) -> HeightTexels<'_> {
        HeightTexels { texels, format: height_format::FLOAT32, wrap, first_word: 0 }
    }

    #[test]
    fn texel_centres_give_the_texels_top_row_at_v_near_1() {
        for (i, want) in MAP.iter().enumerate() {
            let (x, y) = ((i % 4) as f32, (i / 4) as f32);
            for mode in [wrap::REPEAT, wrap::CLAMP, wrap::MIRROR] {
                assert_eq!(sample(mode, (x + 0.5) / 4.0, 1.0 - (y + 0.5) / 2.0), *want);
            }
        }
    }

    #[test]
    fn between_centres_the_value_is_bilinear() {
        assert_eq!(sample(wrap::CLAMP, 0.25, 0.75), 0.5);
        assert_eq!(sample(wrap::CLAMP, 0.25, 0.5), 5.5);
    }

    #[test]
    fn border_repeats_clamps_or_mirrors() {
        // u = 0 lies between the last and the first texel of a repeated row.
        assert_eq!(sample(wrap::REPEAT, 0.0, 0.75), 1.5);
        assert_eq!(sample(wrap::CLAMP, 0.0, 0.75), 0.0);
        assert_eq!(sample(wrap::MIRROR, 0.0, 0.75), 0.0);
        assert_eq!(sample(wrap::CLAMP, 7.0, 0.75), 3.0);
        assert_eq!(sample(wrap::MIRROR, 1.125, 0.75), 3.0);
        assert_eq!(sample(wrap::MIRROR, -0.375, 0.75), sample(wrap::MIRROR, 0.375, 0.75));
    }

    #[test]
    fn gradient_is_the_growth_for_a_unit_of_u_and_of_v() {
        let texels = MAP.map(f32::to_bits);
        let gradient = |mode, u, v| {
            floats(&texels, mode)
                .gradient(Level::finest(4, 2), Vec2::new(u, v), LevelOfDetail::FINEST)
                .to_array()
        };
        // A texel to the right is 1 more and 1/4 of the map on; one upwards is 10 less and 1/2 on.
        assert_eq!(gradient(wrap::CLAMP, 0.25, 0.5), [4.0, -20.0]);
        assert_eq!(gradient(wrap::REPEAT, 3.25, -1.5), [4.0, -20.0]);
        // In the mirrored copy to the right the map runs back; in the one above too.
        assert_eq!(gradient(wrap::MIRROR, 1.75, 0.5), [-4.0, -20.0]);
        assert_eq!(gradient(wrap::MIRROR, 0.25, 1.5), [4.0, 20.0]);
        // Between the last column, 3, and the first one, 0, on the other side.
        assert_eq!(gradient(wrap::REPEAT, 0.0, 0.75)[0], -12.0);
        // Nothing changes beyond the centres of clamped border texels, nor beyond the map.
        assert_eq!(gradient(wrap::CLAMP, 0.0625, 0.5), [0.0, -20.0]);
        assert_eq!(gradient(wrap::CLAMP, -3.0, 7.0), [0.0, 0.0]);
    }

    #[test]
    fn repeat_has_the_same_bits_at_both_sides_of_the_seam() {
        for v in [0.0, 0.3, 0.75, 1.0] {
            assert_eq!(sample(wrap::REPEAT, 0.0, v).to_bits(), sample(wrap::REPEAT, 1.0, v).to_bits());
            assert_eq!(sample(wrap::REPEAT, -3.0, v).to_bits(), sample(wrap::REPEAT, 5.0, v).to_bits());
        }
    }

    #[test]
    fn one_texel_is_constant_everywhere() {
        let texels = [0.25_f32.to_bits()];
        for mode in [wrap::REPEAT, wrap::CLAMP, wrap::MIRROR] {
            for u in [-1e6, -0.5, -1e-8, 0.0, 0.3, 1.0, 1e9] {
                assert_eq!(
                    floats(&texels, mode).sample(Level::finest(1, 1), Vec2::new(u, u), LevelOfDetail::FINEST),
                    0.25
                );
            }
        }
    }

    /// The host refuses maps with greater texels than these, whose differences a filter can take.
    #[test]
    fn filter_of_the_greatest_texels_stays_between_them() {
        let texels = [-1e30_f32, 1e30, 1e30, -1e30].map(f32::to_bits);
        for i in 0..400_u16 {
            let uv = Vec2::new(f32::from(i % 20), f32::from(i / 20)) / 19.0;
            let value = floats(&texels, wrap::REPEAT).sample(Level::finest(2, 2), uv, LevelOfDetail::FINEST);
            assert!(value.abs() <= 1e30 * (1.0 + 3.0 * f32::EPSILON), "{value} at {uv}");
        }
    }

    #[test]
    fn packed_formats_give_the_code_over_its_greatest() {
        let eight = [u32::from_le_bytes([0, 51, 255, 102])];
        let sixteen = [0x0000_ffff_u32, 0x8000_3333];
        for (i, want) in [0.0, 0.2, 1.0, 0.4].into_iter().enumerate() {
            assert_eq!(height_texel(&eight, height_format::UNORM8, 0, i as u32), want);
        }
        for (i, want) in [1.0, 0.0, 0.2, 32768.0 / 65535.0].into_iter().enumerate() {
            assert_eq!(height_texel(&sixteen, height_format::UNORM16, 0, i as u32), want);
        }
    }

    #[test]
    fn colours_come_through_the_table_or_as_floats() {
        // The float map first, so that the other's table and texels begin behind it.
        let mut texels = [0.5_f32, 0.25, 4.0].map(f32::to_bits).to_vec();
        texels.extend((0..256).map(|code| (code as f32 * 2.0).to_bits()));
        texels.push(u32::from_le_bytes([1, 2, 3, 255]));
        let sample = |format, first_word| {
            let map = ColorTexels { texels: &texels, format, wrap: wrap::REPEAT, first_word };
            map.sample(Level::finest(1, 1), Vec2::splat(0.5))
        };
        assert_eq!(sample(color_format::SRGB8, 3), Vec3::new(2.0, 4.0, 6.0));
        assert_eq!(sample(color_format::FLOAT32, 0), Vec3::new(0.5, 0.25, 4.0));
    }

    /// Levels of 5x2, 2x1 and 1x1 texels, each of one grey: 1, 2 and 4; behind a word of another map.
    #[test]
    fn levels_follow_the_side_and_end_with_the_last() {
        let greys = [1.0_f32; 10].into_iter().chain([2.0; 2]).chain([4.0]);
        let texels: Vec<u32> = std::iter::once(0).chain(greys.flat_map(|grey| [grey.to_bits(); 3])).collect();
        let map =
            ColorTexels { texels: &texels, format: color_format::FLOAT32, wrap: wrap::MIRROR, first_word: 1 };
        let grey = |side| map.sample_levels(Level::finest(5, 2), Vec2::new(0.3, 0.8), side).x;
        for (side, want) in [(f32::NAN, 1.0), (0.0, 1.0), (1.0, 1.0), (2.0, 2.0), (4.0, 4.0)] {
            assert_eq!(grey(side), want, "{side}");
        }
        assert!((grey(2.0_f32.sqrt()) - 1.5).abs() < 1e-6 && (grey(8.0_f32.sqrt()) - 3.0).abs() < 1e-6);
        assert_eq!((grey(1e30), grey(f32::INFINITY)), (4.0, 4.0));
    }

    /// The same of heights, whose levels are mixed linearly in the side.
    #[test]
    fn levels_of_heights_follow_the_side_and_end_with_the_last() {
        let greys: Vec<u32> =
            [1.0_f32; 10].into_iter().chain([2.0; 2]).chain([4.0]).map(f32::to_bits).collect();
        let map = floats(&greys, wrap::CLAMP);
        let sample = |side| map.sample(Level::finest(5, 2), Vec2::new(0.3, 0.8), LevelOfDetail::new(side));
        let expected = [(f32::NAN, 1.0), (0.0, 1.0), (1.0, 1.0), (1.25, 1.25), (2.0, 2.0), (3.5, 3.5)];
        for (side, want) in expected.into_iter().chain([(4.0, 4.0), (1e30, 4.0), (f32::INFINITY, 4.0)]) {
            assert_eq!(sample(side), want, "{side}");
        }
    }

    /// Of the map of the tests above with a second level of means: a texel to the right is 4 more at half the distance.
    #[test]
    fn gradient_of_levels_is_between_theirs() {
        let texels: Vec<u32> = MAP.into_iter().chain([5.5, 7.5]).map(f32::to_bits).collect();
        let map = floats(&texels, wrap::CLAMP);
        let gradient = |side| {
            map.gradient(Level::finest(4, 2), Vec2::new(0.5, 0.5), LevelOfDetail::new(side)).to_array()
        };
        assert_eq!((gradient(1.0), gradient(2.0)), ([4.0, -20.0], [4.0, 0.0]));
        assert_eq!(gradient(1.25), [4.0, -15.0]);
    }
}
