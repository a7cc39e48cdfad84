//! How a pass over a film is cut into dispatches.

use emboss_kernels::film::spread_tiles;
use emboss_kernels::interface::{TILE_GROUP_SIZE, Tiles};

/// Pixels of a tile.
const PIXELS: u32 = TILE_GROUP_SIZE * TILE_GROUP_SIZE;
/// Workgroups that every Vulkan device runs along an axis.
const MOST_ALONG: u32 = 65_535;

/// A pass over a film, in parts of whatever size is asked for next.
///
/// One part that is all of it takes the tiles as they lie: neighbours read the same memory. Several are spread over the
/// film, each one over all of it, so that what one takes says what the next one will.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    columns: u32,
    rows: u32,
    /// Number of the next tile.
    next: u32,
    /// Behind the last one's.
    end: u32,
}

impl Parts {
    /// All of a film of `width` x `height` pixels, either of which may be 0.
    pub(super) fn new(width: u32, height: u32) -> Self {
        let (columns, rows) = (width.div_ceil(TILE_GROUP_SIZE), height.div_ceil(TILE_GROUP_SIZE));
        let end = if columns == 0 || rows == 0 { 0 } else { spread_tiles(columns, rows) };
        Parts { columns, rows, next: 0, end }
    }

    /// Pixels of the whole pass, where tiles that lie beyond the film count: what sizes are reckoned in.
    pub(super) fn pixels(&self) -> u32 {
        self.end.saturating_mul(PIXELS)
    }

    /// The next part, of at most `pixels` such pixels but at least one tile, for sample number `sample`; and how many
    /// pixels it is. `None` once the film is covered.
    pub(super) fn next(&mut self, pixels: u32, sample: u32) -> Option<(Tiles, u32)> {
        let count = (pixels / PIXELS).clamp(1, MOST_ALONG * MOST_ALONG).min(self.end - self.next);
        if count == 0 {
            return None;
        }
        let tiles = if count == self.end {
            Tiles { first: 0, count: self.columns * self.rows, spread: 0, sample }
        } else {
            Tiles { first: self.next, count, spread: 1, sample }
        };
        self.next += count;
        Some((tiles, count.saturating_mul(PIXELS)))
    }

    /// Share of the film that is covered, 0 to 1; 1 for a film without pixels.
    pub(super) fn share_done(&self) -> f32 {
        if self.next >= self.end { 1.0 } else { self.next as f32 / self.end as f32 }
    }
}

/// Workgroups along x and y for some tiles.
pub(super) fn groups(tiles: Tiles) -> [u32; 2] {
    [tiles.count.min(MOST_ALONG), tiles.count.div_ceil(MOST_ALONG)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::film::pixel;
    use emboss_kernels::interface::Frame;
    use emboss_kernels::sampler::pcg4d;
    use glam::UVec4;

    /// How often each pixel of a film is covered, where part i may have `pixels(i)` pixels.
    fn cover(width: u32, height: u32, pixels: impl Fn(u32) -> u32) -> Vec<u32> {
        let frame = Frame { width, height, ..Frame::default() };
        let mut parts = Parts::new(width, height);
        let mut counts = vec![0; (width * height) as usize];
        let (mut i, mut share, mut all) = (0, 0.0, 0);
        while let Some((tiles, counted)) = parts.next(pixels(i), 0) {
            assert!(counted <= pixels(i).max(PIXELS), "{tiles:?} of {}", pixels(i));
            assert!(parts.share_done() > share);
            share = parts.share_done();
            let [x_groups, y_groups] = groups(tiles);
            for invocation in 0..x_groups * y_groups * PIXELS {
                let (group, i) = (invocation / PIXELS, invocation % PIXELS);
                let (x, y, is_one) = pixel(&frame, &tiles, group, i % TILE_GROUP_SIZE, i / TILE_GROUP_SIZE);
                if is_one {
                    counts[(y * width + x) as usize] += 1;
                }
            }
            all += counted;
            i += 1;
        }
        assert_eq!(all, parts.pixels());
        counts
    }

    #[test]
    fn every_pixel_is_covered_once_whatever_the_sizes() {
        for (width, height) in [(1, 1), (7, 3), (8, 8), (9, 17), (257, 129), (1000, 3), (3, 1000)] {
            for seed in 0..20 {
                let pixels = |i| 1 + pcg4d(UVec4::new(width, height, seed, i)).x % (1 << (6 + seed % 12));
                assert!(
                    cover(width, height, pixels).iter().all(|&n| n == 1),
                    "{width}x{height}, seed {seed}"
                );
            }
        }
    }

    #[test]
    fn a_large_budget_takes_the_film_in_one_part_as_it_lies() {
        let mut parts = Parts::new(1920, 1080);
        let tiles = parts.next(u32::MAX, 5).map(|(tiles, _)| tiles);
        assert_eq!(tiles, Some(Tiles { first: 0, count: 240 * 135, spread: 0, sample: 5 }));
        assert_eq!(parts.next(u32::MAX, 5), None);
        assert_eq!(parts.share_done(), 1.0);
    }

    #[test]
    fn films_without_pixels_have_no_tiles() {
        for (width, height) in [(0, 0), (0, 5), (5, 0)] {
            let mut parts = Parts::new(width, height);
            assert_eq!(parts.next(100, 0), None);
            assert_eq!(parts.share_done(), 1.0);
        }
    }

    #[test]
    fn no_part_exceeds_the_workgroups_of_a_device() {
        for (width, height) in [(16_384, 16_384), (1_000_000, 9), (9, 1_000_000)] {
            let mut parts = Parts::new(width, height);
            while let Some((tiles, _)) = parts.next(u32::MAX, 0) {
                let [x, y] = groups(tiles);
                assert!(x <= MOST_ALONG && y <= MOST_ALONG && x * y >= tiles.count, "{tiles:?}");
            }
        }
    }
}
