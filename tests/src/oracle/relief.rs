//! The height map in f64, and how far an f32 evaluation of it may be off.

use super::rounding::{Rounding, UNIT_ROUNDOFF};
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{Displacement, height_format, wrap};
use glam::DVec2;

/// A height map with its texels unpacked.
pub(super) struct Relief {
    width: i64,
    height: i64,
    texels: Vec<f64>,
    wrap: u32,
    scale: f64,
    zero: f64,
    /// Greatest difference between neighbours in a row, and in a column.
    steepest: DVec2,
    /// Greatest magnitude of a texel.
    magnitude: f64,
}

impl Relief {
    /// One of a scene's height maps.
    pub(super) fn new(buffers: &SceneBuffers, displacement: &Displacement) -> Self {
        let count = displacement.map_width as usize * displacement.map_height as usize;
        let words = &buffers.height_texels[displacement.first_word as usize..];
        let texels: Vec<f64> = (0..count).map(|i| texel(words, displacement.format, i)).collect();
        let magnitude = texels.iter().fold(0.0, |most, texel| texel.abs().max(most));
        let mut relief = Relief {
            width: i64::from(displacement.map_width),
            height: i64::from(displacement.map_height),
            texels,
            wrap: displacement.wrap,
            scale: f64::from(displacement.scale),
            zero: f64::from(displacement.zero),
            steepest: DVec2::ZERO,
            magnitude,
        };
        relief.steepest = relief.measured_steepest();
        relief
    }

    /// Height in model units: texel centres at half-integers, v upwards, the first row at the top.
    pub(super) fn height(&self, uv: DVec2) -> f64 {
        let x = uv.x * self.width as f64 - 0.5;
        let y = (1.0 - uv.y) * self.height as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        #[expect(clippy::cast_possible_truncation, reason = "texture coordinates of tests are small")]
        let (i, j) = (left as i64, top as i64);
        let upper = (1.0 - s) * self.at(i, j) + s * self.at(i + 1, j);
        let lower = (1.0 - s) * self.at(i, j + 1) + s * self.at(i + 1, j + 1);
        self.scale * ((1.0 - t) * upper + t * lower - self.zero)
    }

    /// Bound on the error of a height computed in f32 from texture coordinates that are interpolated on the grid, the
    /// magnitudes of their terms adding up to `uv`.
    ///
    /// Reducing the coordinates to [0,1] adds 2 u, scaling to texels the product and 1 u of the map's size, and a shift of
    /// x texels changes the bilinear value by at most x times the steepest step. Subtracting zero and scaling add two
    /// roundings.
    pub(super) fn height_error(&self, uv: DVec2, rounding: Rounding) -> f64 {
        let shift = self.size() * (rounding.interpolation() * uv + DVec2::splat(3.0 + rounding.product));
        let filter = rounding.bilinear() * self.magnitude;
        let offset = 2.0 * (self.magnitude + self.zero.abs());
        UNIT_ROUNDOFF * self.scale.abs() * (shift.dot(self.steepest) + filter + offset)
    }

    /// Sides in texels.
    pub(super) fn size(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64)
    }

    /// Height of a texel step from 0 to 1.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// Greatest difference between neighbours in a row, and in a column.
    pub(super) fn steepest(&self) -> DVec2 {
        self.steepest
    }

    /// Distances, in texels, from the nearest line through the centres of a column, and of a row.
    pub(super) fn distance_to_lines(&self, uv: DVec2) -> DVec2 {
        let texel = uv * self.size() - DVec2::splat(0.5);
        (texel - texel.round()).abs()
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
        Relief::new(&buffers, &displacement)
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
}
