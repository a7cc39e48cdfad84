//! The height map in f64, and how far an f32 evaluation of it may be off.

use super::rounding::{Rounding, UNIT_ROUNDOFF};
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{Displacement, height_format, wrap};
use glam::DVec2;

/// A height map with its texels unpacked, and those of its levels where there are any.
pub(super) struct Relief {
    /// The map itself, then what stands behind it.
    levels: Vec<Level>,
    scale: f64,
    zero: f64,
    /// Greatest magnitude of a texel.
    magnitude: f64,
    /// Greatest difference of two texels.
    spread: f64,
    /// What the host found that levels differ by.
    roughness: f64,
}

/// A level of a map.
struct Level {
    width: i64,
    height: i64,
    texels: Vec<f64>,
    wrap: u32,
    /// Greatest difference between neighbours in a row, and in a column.
    steepest: DVec2,
}

/// How many texels a side a pixel covers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cover {
    pub(super) texels: f64,
    /// How far an f32 evaluation of it may be off.
    pub(super) error: f64,
}

impl Cover {
    /// That of a map that is not filtered.
    pub(super) const ONE: Cover = Cover { texels: 1.0, error: 0.0 };
}

impl Level {
    fn new(width: u32, height: u32, wrap: u32, texels: Vec<f64>) -> Level {
        let (width, height) = (i64::from(width), i64::from(height));
        let mut level = Level { width, height, texels, wrap, steepest: DVec2::ZERO };
        level.steepest = level.measured_steepest();
        level
    }

    /// The bilinearly filtered texel: centres at half-integers, v upwards, the first row at the top.
    fn filtered(&self, uv: DVec2) -> f64 {
        let x = uv.x * self.width as f64 - 0.5;
        let y = (1.0 - uv.y) * self.height as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        #[expect(clippy::cast_possible_truncation, reason = "texture coordinates of tests are small")]
        let (i, j) = (left as i64, top as i64);
        let upper = (1.0 - s) * self.at(i, j) + s * self.at(i + 1, j);
        let lower = (1.0 - s) * self.at(i, j + 1) + s * self.at(i + 1, j + 1);
        (1.0 - t) * upper + t * lower
    }

    /// By how much of u the filtered texel is off since its place is, in u of texture coordinates up to `uv` in
    /// magnitude.
    fn shift_error(&self, uv: DVec2, rounding: Rounding) -> f64 {
        let shift = self.size() * (rounding.interpolation() * uv + DVec2::splat(3.0 + rounding.product));
        shift.dot(self.steepest)
    }

    fn size(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64)
    }

    /// The texel in column `i` from the left and row `j` from the top of the map that goes on without end.
    fn at(&self, i: i64, j: i64) -> f64 {
        let (i, j) = (wrapped(i, self.width, self.wrap), wrapped(j, self.height, self.wrap));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the map")]
        self.texels[(j * self.width + i) as usize]
    }

    fn measured_steepest(&self) -> DVec2 {
        let mut steepest = DVec2::ZERO;
        for j in 0..self.height {
            for i in 0..self.width {
                let steps = DVec2::new(self.at(i + 1, j), self.at(i, j + 1)) - DVec2::splat(self.at(i, j));
                steepest = steepest.max(steps.abs());
            }
        }
        steepest
    }
}

impl Relief {
    /// One of a scene's height maps; with its levels, those that `filtered` maps have behind them.
    pub(super) fn new(buffers: &SceneBuffers, displacement: &Displacement, filtered: bool) -> Self {
        let words = &buffers.height_texels[displacement.first_word as usize..];
        let (mut width, mut height, mut first) = (displacement.map_width, displacement.map_height, 0);
        let mut levels = Vec::new();
        loop {
            let count = width as usize * height as usize;
            let texels = (first..first + count).map(|i| texel(words, displacement.format, i)).collect();
            levels.push(Level::new(width, height, displacement.wrap, texels));
            if !filtered || count == 1 {
                break;
            }
            (width, height, first) = ((width / 2).max(1), (height / 2).max(1), first + count);
        }
        let texels = &levels[0].texels;
        let (low, high) =
            texels.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &t| (a.min(t), b.max(t)));
        Relief {
            scale: f64::from(displacement.scale),
            zero: f64::from(displacement.zero),
            magnitude: low.abs().max(high.abs()),
            spread: high - low,
            roughness: f64::from(displacement.roughness),
            levels,
        }
    }

    /// Height in model units.
    pub(super) fn height(&self, uv: DVec2) -> f64 {
        self.scale * (self.levels[0].filtered(uv) - self.zero)
    }

    /// The same where a pixel covers many texels: 2^l (1 + s) of them are read from level l, and by the share s from
    /// the next.
    pub(super) fn height_seen(&self, uv: DVec2, cover: Cover) -> f64 {
        let (level, share) = self.level(cover);
        let next = (level + 1).min(self.levels.len() - 1);
        let texel = (1.0 - share) * self.levels[level].filtered(uv) + share * self.levels[next].filtered(uv);
        self.scale * (texel - self.zero)
    }

    /// Which level a pixel is read from, and by what share from the next.
    fn level(&self, cover: Cover) -> (usize, f64) {
        let mut texels = cover.texels.max(1.0);
        let mut level = 0;
        while texels >= 2.0 && level + 1 < self.levels.len() {
            texels /= 2.0;
            level += 1;
        }
        // Beyond the last level there is nothing.
        (level, (texels - 1.0).min(1.0))
    }

    /// Bound on the error of a height computed in f32 from texture coordinates that are interpolated on the grid, the
    /// magnitudes of their terms adding up to `uv`.
    ///
    /// Reducing the coordinates to [0,1] adds 2 u, scaling to texels the product and 1 u of the map's size, and a shift
    /// of x texels changes the bilinear value by at most x times the steepest step. Subtracting zero and scaling add
    /// two roundings.
    pub(super) fn height_error(&self, uv: DVec2, rounding: Rounding) -> f64 {
        let filter = rounding.bilinear() * self.magnitude;
        let offset = 2.0 * (self.magnitude + self.zero.abs());
        UNIT_ROUNDOFF * self.scale.abs() * (self.levels[0].shift_error(uv, rounding) + filter + offset)
    }

    /// The same for [`height_seen`](Self::height_seen): the greatest of both levels' errors, the mean of the two, and
    /// what the error of the share makes: a share of 1 changes the value by no more than the spread of texels.
    pub(super) fn height_seen_error(&self, uv: DVec2, cover: Cover, rounding: Rounding) -> f64 {
        let (level, _) = self.level(cover);
        let next = (level + 1).min(self.levels.len() - 1);
        let shift =
            self.levels[level].shift_error(uv, rounding).max(self.levels[next].shift_error(uv, rounding));
        let filter = (rounding.bilinear() + 3.0 + rounding.product) * self.magnitude;
        let offset = 2.0 * (self.magnitude + self.zero.abs());
        // Shares below a power of two are of texels half as large.
        let share =
            if cover.texels + cover.error > 1.0 { 2.0 * cover.error / cover.texels.max(1.0) } else { 0.0 };
        self.scale.abs() * (UNIT_ROUNDOFF * (shift + filter + offset) + share * self.spread)
    }

    /// The side of a pixel, in model units, from which on levels are read: that of a texel of `size`, or 2.2 times what
    /// the host found that levels differ by.
    pub(super) fn finest(&self, size: f64) -> f64 {
        size.max(2.2 * (self.scale * self.roughness).abs())
    }

    /// Sides in texels.
    pub(super) fn size(&self) -> DVec2 {
        self.levels[0].size()
    }

    /// Height of a texel step from 0 to 1.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// Greatest difference between neighbours in a row, and in a column.
    pub(super) fn steepest(&self) -> DVec2 {
        self.levels[0].steepest
    }

    /// Distances, in texels, from the nearest line through the centres of a column, and of a row.
    pub(super) fn distance_to_lines(&self, uv: DVec2) -> DVec2 {
        let texel = uv * self.size() - DVec2::splat(0.5);
        (texel - texel.round()).abs()
    }
}

/// A column or row of the endless map as one of the map's `n`.
fn wrapped(i: i64, n: i64, mode: u32) -> i64 {
    match mode {
        wrap::REPEAT => i.rem_euclid(n),
        wrap::MIRROR => {
            let folded = i.rem_euclid(2 * n);
            folded.min(2 * n - 1 - folded)
        }
        _ => i.clamp(0, n - 1),
    }
}

/// Texel number `i` of a packed map.
fn texel(words: &[u32], format: u32, i: usize) -> f64 {
    match format {
        height_format::UNORM8 => f64::from(words[i / 4].to_le_bytes()[i % 4]) / 255.0,
        height_format::UNORM16 => {
            let word = words[i / 2];
            f64::from([word & 0xffff, word >> 16][i % 2]) / 65535.0
        }
        _ => f64::from(f32::from_bits(words[i])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 3x2 map without displacement's offset, 0 1 2 over 10 11 12, behind another map.
    fn relief(wrap: u32) -> Relief {
        let before = [7.0_f32, 7.0];
        let texels = before.into_iter().chain([0.0, 1.0, 2.0, 10.0, 11.0, 12.0]).map(f32::to_bits).collect();
        let buffers = SceneBuffers { height_texels: texels, ..SceneBuffers::default() };
        let displacement = Displacement {
            scale: 1.0,
            map_width: 3,
            map_height: 2,
            first_word: 2,
            format: height_format::FLOAT32,
            wrap,
            ..Displacement::default()
        };
        Relief::new(&buffers, &displacement, false)
    }

    #[test]
    fn maps_go_on_as_their_wrap_says() {
        // Texel centres of the top row, from two columns left of the map to two right of it.
        let row = |wrap| {
            [-2, -1, 0, 1, 2, 3, 4].map(|i| {
                let u = (f64::from(i) + 0.5) / 3.0;
                (relief(wrap).height(DVec2::new(u, 0.75)) * 1e9).round() / 1e9
            })
        };
        assert_eq!(row(wrap::REPEAT), [1.0, 2.0, 0.0, 1.0, 2.0, 0.0, 1.0]);
        assert_eq!(row(wrap::CLAMP), [0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0]);
        assert_eq!(row(wrap::MIRROR), [1.0, 0.0, 0.0, 1.0, 2.0, 2.0, 1.0]);
    }

    #[test]
    fn values_between_texels_are_bilinear() {
        // Halfway between 0 and 1, a quarter of the way down to 10 and 11.
        let height = relief(wrap::CLAMP).height(DVec2::new(1.0 / 3.0, 0.625));
        assert!((height - 3.0).abs() < 1e-12, "{height}");
    }

    #[test]
    fn packed_texels_are_codes_over_their_greatest() {
        let bytes = [u32::from_le_bytes([0, 51, 255, 102])];
        assert_eq!([0, 1, 2, 3].map(|i| texel(&bytes, height_format::UNORM8, i)), [0.0, 0.2, 1.0, 0.4]);
        let halves = [0x3333_ffff_u32];
        assert_eq!([0, 1].map(|i| texel(&halves, height_format::UNORM16, i)), [1.0, 0.2]);
    }

    #[test]
    fn steepest_step_counts_the_seam() {
        assert_eq!(relief(wrap::REPEAT).steepest(), DVec2::new(2.0, 10.0));
        assert_eq!(relief(wrap::CLAMP).steepest(), DVec2::new(1.0, 10.0));
    }

    /// A 4x1 map and its levels 2x1 and 1x1.
    #[test]
    fn pixels_are_read_between_levels() {
        let texels = [0.0_f32, 2.0, 4.0, 6.0, 10.0, 50.0, 300.0].map(f32::to_bits).into();
        let buffers = SceneBuffers { height_texels: texels, ..SceneBuffers::default() };
        let map = Displacement {
            scale: 1.0,
            map_width: 4,
            map_height: 1,
            format: height_format::FLOAT32,
            wrap: wrap::CLAMP,
            ..Displacement::default()
        };
        let relief = Relief::new(&buffers, &map, true);
        let seen = |texels| relief.height_seen(DVec2::new(0.25, 0.5), Cover { texels, error: 0.0 });
        assert_eq!([0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 1e9].map(seen), [1.0, 1.0, 5.5, 10.0, 155.0, 300.0, 300.0]);
    }
}
