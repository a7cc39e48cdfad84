//! What is shown: texels of 8 bits a channel, into which pictures are scaled and text is set.

use crate::picture::{linear_from_srgb, srgb_from_linear};
use glam::{Vec3, Vec4};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use rayon::prelude::*;
use std::path::Path;

/// What is behind a model without a background, an sRGB code: dark, so that neither white nor black relief gets lost.
const BACKDROP: f32 = 48.0 / 255.0;

/// Texels `0x00RRGGBB` in sRGB, row by row from the top.
#[derive(Clone, Debug, Default)]
pub(super) struct Canvas {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) texels: Vec<u32>,
}

/// How large letters are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Font(RasterHeight);

impl Font {
    /// For a screen whose pixels are to be taken `scale` times.
    pub(super) fn for_scale(scale: f64) -> Font {
        Font(if scale < 1.5 { RasterHeight::Size16 } else { RasterHeight::Size32 })
    }

    pub(super) fn width(self) -> usize {
        get_raster_width(FontWeight::Regular, self.0)
    }

    pub(super) fn height(self) -> usize {
        self.0.val()
    }
}

impl Canvas {
    /// A picture as PNG has it, over the backdrop: linear RGB premultiplied by alpha.
    pub(super) fn of_picture(width: u32, height: u32, pixels: &[Vec4]) -> Canvas {
        let backdrop = Vec3::splat(linear_from_srgb(BACKDROP));
        let texel = |pixel: &Vec4| packed(pixel.truncate() + (1.0 - pixel.w) * backdrop);
        Canvas { width, height, texels: pixels.par_iter().map(texel).collect() }
    }

    /// The same with other numbers of columns and rows, each texel the nearest one.
    pub(super) fn scaled(&self, width: u32, height: u32) -> Canvas {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let mut texels = Vec::with_capacity(width as usize * height as usize);
        if self.texels.is_empty() {
            texels.resize(width as usize * height as usize, packed(Vec3::splat(linear_from_srgb(BACKDROP))));
        } else {
            let place = |i: u32, from: u32, to: u32| i as usize * from as usize / to as usize;
            for y in 0..height {
                let row = place(y, self.height, height) * self.width as usize;
                texels.extend((0..width).map(|x| self.texels[row + place(x, self.width, width)]));
            }
        }
        Canvas { width, height, texels }
    }

    /// Saves it as a PNG.
    pub(super) fn save(&self, path: &Path) -> image::ImageResult<()> {
        let channels = |texel: &u32| {
            let [blue, green, red, _] = texel.to_le_bytes();
            [red, green, blue]
        };
        let bytes: Vec<u8> = self.texels.iter().flat_map(channels).collect();
        image::save_buffer(path, &bytes, self.width, self.height, image::ExtendedColorType::Rgb8)
    }

    /// Sets a line of text; what is beyond the canvas is left out. Letters that the font has not are blanks.
    pub(super) fn text(&mut self, left: usize, top: usize, font: Font, text: &str, color: [u8; 3]) {
        for (i, letter) in text.chars().enumerate() {
            let Some(raster) = get_raster(letter, FontWeight::Regular, font.0) else { continue };
            for (y, row) in raster.raster().iter().enumerate() {
                for (x, &coverage) in row.iter().enumerate() {
                    self.blend(left + i * font.width() + x, top + y, coverage, color);
                }
            }
        }
    }

    /// Darkens a rectangle, so that text can be read on it.
    pub(super) fn shade(&mut self, left: usize, top: usize, width: usize, height: usize) {
        for y in top..top + height {
            for x in left..left + width {
                self.blend(x, y, 190, [16, 16, 20]);
            }
        }
    }

    fn blend(&mut self, x: usize, y: usize, coverage: u8, color: [u8; 3]) {
        let (width, height) = (self.width as usize, self.height as usize);
        if x >= width || y >= height || coverage == 0 {
            return;
        }
        let texel = &mut self.texels[y * width + x];
        let [blue, green, red, _] = texel.to_le_bytes();
        let mix = |under: u8, over: u8| {
            let coverage = u32::from(coverage);
            ((u32::from(over) * coverage + u32::from(under) * (255 - coverage) + 127) / 255) & 0xFF
        };
        *texel = mix(red, color[0]) << 16 | mix(green, color[1]) << 8 | mix(blue, color[2]);
    }
}

/// The nearest code of each channel, as [`PictureFormat::Png8`](crate::picture::PictureFormat::Png8) has it.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
fn packed(linear: Vec3) -> u32 {
    let code = |channel: f32| u32::from((srgb_from_linear(channel) * 255.0 + 0.5) as u8);
    code(linear.x) << 16 | code(linear.y) << 8 | code(linear.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_seen_before_the_backdrop() {
        let pixels =
            [Vec4::ONE, Vec4::ZERO, Vec4::new(0.0, 0.0, 1.0, 1.0), Vec4::new(0.215_861, 0.0, 0.0, 1.0)];
        let canvas = Canvas::of_picture(2, 2, &pixels);
        assert_eq!(canvas.texels, [0xFF_FFFF, 0x30_3030, 0x00_00FF, 0x80_0000]);
    }

    #[test]
    fn scaling_takes_the_nearest_texel() {
        let small = Canvas { width: 2, height: 1, texels: vec![1, 2] };
        assert_eq!(small.scaled(4, 2).texels, [1, 1, 2, 2, 1, 1, 2, 2]);
        assert_eq!(small.scaled(3, 1).texels, [1, 1, 2]);
        assert_eq!(small.scaled(1, 1).texels, [1]);
        assert_eq!(Canvas::default().scaled(1, 2).texels, [0x30_3030; 2]);
    }

    #[test]
    fn text_stays_on_the_canvas() {
        let mut canvas = Canvas { width: 20, height: 20, texels: vec![0; 400] };
        canvas.text(2, 2, Font::for_scale(1.0), "MMMM", [255, 255, 255]);
        assert!(canvas.texels.iter().any(|&texel| texel > 0x80_0000));
        assert!(canvas.texels[..40].iter().all(|&texel| texel == 0));
        canvas.shade(10, 10, 100, 100);
        canvas.text(0, 0, Font::for_scale(2.0), "\u{7}", [255, 0, 0]);
    }
}
