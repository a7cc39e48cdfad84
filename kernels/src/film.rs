//! The film: sums of samples, and the picture resolved from them.

use crate::interface::{FilmPixel, Frame, TILE_GROUP_SIZE, Tiles};
use crate::math::ceil_log2;
use glam::{Vec3, Vec4};

/// Column and row of tile number `number` of a film of `columns` x `rows` tiles.
///
/// As they lie, or `spread`: then the bits of the number, the lowest first, are those of column and row, the highest
/// first. So any 2^k successive tiles are one of each of 2^k parts of the film, and what a part of the film takes says
/// what all of it will. Numbers go up to the [`spread_tiles`], of which some lie beyond the film.
#[inline]
pub fn tile(number: u32, spread: bool, columns: u32, rows: u32) -> (u32, u32) {
    let (mut column, mut row) = (number % columns, number / columns);
    if spread {
        (column, row) = (0, 0);
        let (mut column_bits, mut row_bits) = (ceil_log2(columns), ceil_log2(rows));
        let mut rest = number;
        while column_bits + row_bits > 0 {
            if column_bits >= row_bits {
                column_bits -= 1;
                column |= (rest & 1) << column_bits;
            } else {
                row_bits -= 1;
                row |= (rest & 1) << row_bits;
            }
            rest >>= 1;
        }
    }
    (column, row)
}

/// How many numbers spread tiles have: those of a film with sides of powers of two.
#[inline]
pub fn spread_tiles(columns: u32, rows: u32) -> u32 {
    1 << (ceil_log2(columns) + ceil_log2(rows))
}

/// The pixel that invocation (`x`, `y`) of workgroup `group` of a dispatch over `tiles` is for, and whether there is
/// one. The film must have pixels.
#[inline]
pub fn pixel(frame: &Frame, tiles: &Tiles, group: u32, x: u32, y: u32) -> (u32, u32, bool) {
    let columns = frame.width.div_ceil(TILE_GROUP_SIZE);
    let rows = frame.height.div_ceil(TILE_GROUP_SIZE);
    let (column, row) = tile(tiles.first + group, tiles.spread != 0, columns, rows);
    let (x, y) = (column * TILE_GROUP_SIZE + x, row * TILE_GROUP_SIZE + y);
    (x, y, group < tiles.count && x < frame.width && y < frame.height)
}

/// What one sample of a pixel brings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Linear RGB, 0 where nothing was hit.
    pub radiance: Vec3,
    /// 1 where something was hit, else 0.
    pub alpha: f32,
}

impl FilmPixel {
    /// This sum with `sample` added.
    #[inline]
    pub fn plus(self, sample: Sample) -> Self {
        FilmPixel {
            radiance: [
                self.radiance[0] + sample.radiance.x,
                self.radiance[1] + sample.radiance.y,
                self.radiance[2] + sample.radiance.z,
            ],
            alpha: self.alpha + sample.alpha,
            samples: self.samples + 1,
        }
    }

    /// The mean of the samples over the frame's background: linear RGB premultiplied by alpha, and alpha. A pixel
    /// without samples shows the background.
    #[inline]
    pub fn resolve(self, frame: &Frame) -> Vec4 {
        let scale = if self.samples == 0 { 0.0 } else { 1.0 / self.samples as f32 };
        let radiance = Vec3::new(self.radiance[0], self.radiance[1], self.radiance[2]) * scale;
        let behind = (1.0 - self.alpha * scale) * frame.background_alpha;
        (radiance + frame.background * behind).extend(self.alpha * scale + behind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_one_invocations_whatever_the_order() {
        for (width, height) in [(1, 1), (7, 3), (8, 8), (9, 17), (257, 129), (1000, 3), (3, 1000)] {
            let frame = Frame { width, height, ..Frame::default() };
            let (columns, rows) = (width.div_ceil(8), height.div_ceil(8));
            for (spread, end) in [(0, columns * rows), (1, spread_tiles(columns, rows))] {
                let mut counts = vec![0; (width * height) as usize];
                // Two dispatches, the first one with groups to spare.
                for tiles in [
                    Tiles { first: 0, count: end / 3, spread, sample: 0 },
                    Tiles { first: end / 3, count: end - end / 3, spread, sample: 0 },
                ] {
                    for group in 0..end {
                        for i in 0..64 {
                            let (x, y, is_one) = pixel(&frame, &tiles, group, i % 8, i / 8);
                            if is_one {
                                counts[(y * width + x) as usize] += 1;
                            }
                        }
                    }
                }
                assert!(counts.iter().all(|&n| n == 1), "{width}x{height}, {spread}");
            }
        }
    }

    #[test]
    fn any_power_of_two_of_spread_tiles_is_one_of_each_part_of_the_film() {
        let (columns, rows) = (256, 64);
        for (count, wide, high) in [(2, 128, 64), (4, 64, 64), (8, 32, 64), (64, 16, 16)] {
            for first in [0, 5, 1000, columns * rows - count] {
                let mut seen: Vec<_> = (first..first + count)
                    .map(|number| tile(number, true, columns, rows))
                    .map(|(column, row)| (column / wide, row / high))
                    .collect();
                seen.sort_unstable();
                seen.dedup();
                assert_eq!(seen.len(), count as usize, "{count} from {first} on");
            }
        }
    }

    const RED: Sample = Sample { radiance: Vec3::new(2.0, 0.0, 0.0), alpha: 1.0 };

    #[test]
    fn resolved_pixel_is_the_mean_over_the_background() {
        let half = FilmPixel::default().plus(RED).plus(Sample::default());
        let mut frame = Frame { background: Vec3::new(0.0, 0.0, 0.5), ..Frame::default() };
        assert_eq!(half.resolve(&frame), Vec4::new(1.0, 0.0, 0.0, 0.5));
        frame.background_alpha = 1.0;
        assert_eq!(half.resolve(&frame), Vec4::new(1.0, 0.0, 0.25, 1.0));
    }

    #[test]
    fn pixel_without_samples_is_the_background() {
        let mut frame = Frame { background: Vec3::ONE, ..Frame::default() };
        assert_eq!(FilmPixel::default().resolve(&frame), Vec4::ZERO);
        frame.background_alpha = 1.0;
        assert_eq!(FilmPixel::default().resolve(&frame), Vec4::ONE);
    }
}
