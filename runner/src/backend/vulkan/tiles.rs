//! How a frame is cut into tiles.

use emboss_kernels::interface::{TILE_GROUP_SIZE, Tile};

/// Longest edge of a tile in pixels: every Vulkan device runs at least 65535 workgroups along an axis.
const MOST_EDGE: u32 = 65_535 * TILE_GROUP_SIZE;

/// Walks over a film from top to bottom, in tiles of whatever size is asked for next.
///
/// A tile is a band of whole rows where the asked size allows, else a piece of a band that is one workgroup high.
/// Both are rectangles aligned to workgroups, so that only the film's own edges leave threads idle; and what is left
/// to do is always the rows from some row on, less a piece of the first band, so that tiles of changing sizes cover
/// the film without overlap.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    width: u32,
    height: u32,
    /// Left edge of the next tile; above 0 within a band.
    x: u32,
    /// Top edge of the next tile.
    y: u32,
}

impl Tiles {
    /// All of a film of `width` x `height` pixels, either of which may be 0.
    pub(super) fn new(width: u32, height: u32) -> Self {
        Tiles { width, height, x: 0, y: if width == 0 { height } else { 0 } }
    }

    /// The next tile, of at most `pixels` pixels but at least one workgroup, for sample number `sample`. `None` once
    /// the film is covered.
    pub(super) fn next(&mut self, pixels: u32, sample: u32) -> Option<Tile> {
        if self.y >= self.height {
            return None;
        }
        let whole_rows = whole_groups(pixels / self.width, self.height - self.y);
        let fits = self.x == 0 && self.width <= MOST_EDGE && whole_rows > 0;
        Some(if fits { self.next_band(whole_rows, sample) } else { self.next_piece(pixels, sample) })
    }

    /// Share of the film's rows that is covered, 0 to 1; 1 for a film without pixels.
    pub(super) fn share_done(&self) -> f32 {
        if self.y >= self.height { 1.0 } else { self.y as f32 / self.height as f32 }
    }

    fn next_band(&mut self, rows: u32, sample: u32) -> Tile {
        let height = rows.min(MOST_EDGE).min(self.height - self.y);
        let tile = Tile { x: 0, y: self.y, width: self.width, height, sample };
        self.y += height;
        tile
    }

    fn next_piece(&mut self, pixels: u32, sample: u32) -> Tile {
        let height = TILE_GROUP_SIZE.min(self.height - self.y);
        let columns = whole_groups(pixels / height, self.width - self.x).max(TILE_GROUP_SIZE);
        let width = columns.min(MOST_EDGE).min(self.width - self.x);
        let tile = Tile { x: self.x, y: self.y, width, height, sample };
        self.x += width;
        if self.x == self.width {
            self.x = 0;
            self.y += height;
        }
        tile
    }
}

/// Workgroups along x and y that cover a tile.
pub(super) fn groups(tile: Tile) -> [u32; 2] {
    [tile.width.div_ceil(TILE_GROUP_SIZE), tile.height.div_ceil(TILE_GROUP_SIZE)]
}

/// All that is left of an edge if `pixels` reach that far, else a multiple of a workgroup's edge.
fn whole_groups(pixels: u32, left: u32) -> u32 {
    if pixels >= left { left } else { pixels / TILE_GROUP_SIZE * TILE_GROUP_SIZE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::sampler::pcg4d;
    use glam::UVec4;

    /// How often each pixel is in a tile, where tile i may have `pixels(i)` pixels.
    fn cover(width: u32, height: u32, pixels: impl Fn(u32) -> u32) -> Vec<u32> {
        let mut tiles = Tiles::new(width, height);
        let mut counts = vec![0; (width * height) as usize];
        let mut i = 0;
        while let Some(tile) = tiles.next(pixels(i), 0) {
            assert!(tile.width * tile.height <= pixels(i).max(64), "{tile:?} of {}", pixels(i));
            for y in tile.y..tile.y + tile.height {
                for x in tile.x..tile.x + tile.width {
                    counts[(y * width + x) as usize] += 1;
                }
            }
            i += 1;
        }
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
    fn a_large_budget_takes_the_film_in_one_tile() {
        let mut tiles = Tiles::new(1920, 1080);
        let tile = tiles.next(u32::MAX, 5);
        assert_eq!(tile, Some(Tile { x: 0, y: 0, width: 1920, height: 1080, sample: 5 }));
        assert_eq!(tiles.next(u32::MAX, 5), None);
        assert_eq!(tiles.share_done(), 1.0);
    }

    #[test]
    fn what_is_left_is_one_tile_if_it_fits() {
        // 13 rows: a band of 8, then one of 5, in one tile or in pieces of 16 columns and of the other 7.
        for (asked, expected) in [(23 * 5, vec![[23, 5]]), (23 * 5 - 1, vec![[16, 5], [7, 5]])] {
            let mut tiles = Tiles::new(23, 13);
            assert_eq!(tiles.next(23 * 8, 0).map(|tile| [tile.width, tile.height]), Some([23, 8]));
            let sizes: Vec<_> =
                std::iter::from_fn(|| tiles.next(asked, 0)).map(|tile| [tile.width, tile.height]).collect();
            assert_eq!(sizes, expected);
        }
    }

    #[test]
    fn films_without_pixels_have_no_tiles() {
        for (width, height) in [(0, 0), (0, 5), (5, 0)] {
            let mut tiles = Tiles::new(width, height);
            assert_eq!(tiles.next(100, 0), None);
            assert_eq!(tiles.share_done(), 1.0);
        }
    }

    #[test]
    fn no_tile_exceeds_the_workgroups_of_a_device() {
        for (width, height) in [(1_000_000, 9), (9, 1_000_000)] {
            let mut tiles = Tiles::new(width, height);
            let (mut pixels, mut last) = (0, 0.0);
            while let Some(tile) = tiles.next(u32::MAX, 0) {
                assert!(groups(tile).iter().all(|&n| n <= 65_535), "{tile:?}");
                pixels += tile.width * tile.height;
                assert!(tiles.share_done() >= last);
                last = tiles.share_done();
            }
            assert_eq!(pixels, width * height);
        }
    }
}
