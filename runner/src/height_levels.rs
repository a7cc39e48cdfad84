//! What height maps need to be filtered by their levels: the levels, how much these differ from the map, and how large
//! texels are on the base mesh.

use crate::heights::Heights;
use crate::scene::mip_levels::{covered, sizes, texels};
use crate::scene::{HeightMap, Mesh};
use emboss_kernels::interface::{TexelScale, Vertex, height_format, wrap};
use emboss_kernels::texture::height_texel;
use glam::Vec2;
use rayon::prelude::*;
use std::collections::HashMap;

/// The texels of a level, row by row.
struct Level {
    width: u32,
    height: u32,
    texels: Vec<f32>,
}

/// How many words a map takes with its levels behind it.
pub fn words(map: &HeightMap) -> u64 {
    let texels = texels(map.width, map.height);
    match map.format {
        height_format::UNORM8 => texels.div_ceil(4),
        height_format::UNORM16 => texels.div_ceil(2),
        _ => texels,
    }
}

/// The words of a map with those of its other levels behind them, in its format, and its roughness under each of
/// `wraps`: see [`Displacement::roughness`](emboss_kernels::interface::Displacement::roughness).
///
/// Each texel is the mean of what it covers of the level before, and lies within the range of that.
pub fn with_levels(map: &HeightMap, wraps: &[u32]) -> (Vec<u32>, Vec<f32>) {
    let count = map.width * map.height;
    let mut finer = Level {
        width: map.width,
        height: map.height,
        texels: (0..count).into_par_iter().map(|i| height_texel(&map.texels, map.format, 0, i)).collect(),
    };
    let mut packer = Packer { format: map.format, words: map.texels.clone(), count: count as usize };
    let mut roughness = vec![Roughness::default(); wraps.len()];
    for (width, height) in sizes(map.width, map.height).skip(1) {
        let mut coarser = finer.halved(width, height);
        packer.append(&mut coarser.texels);
        for (roughness, &wrap) in roughness.iter_mut().zip(wraps) {
            roughness.add(greatest_difference(&finer, &coarser, wrap));
        }
        finer = coarser;
    }
    (packer.words, roughness.into_iter().map(|roughness| roughness.greatest).collect())
}

/// What the levels so far differ from the map by.
#[derive(Clone, Copy, Default)]
struct Roughness {
    level: i32,
    /// A bound on what the last level differs by: it differs from the one before, that from the map.
    difference: f32,
    /// The greatest of these over 2^level.
    greatest: f32,
}

impl Roughness {
    /// Counts one more level, which differs so much from the one before.
    fn add(&mut self, difference: f32) {
        self.level += 1;
        self.difference += difference;
        self.greatest = self.greatest.max(self.difference / 2.0_f32.powi(self.level));
    }
}

/// Writes texels behind each other.
struct Packer {
    format: u32,
    words: Vec<u32>,
    /// How many texels there are.
    count: usize,
}

impl Packer {
    /// Appends texels, and makes them what is read of them: the codes nearest to them.
    fn append(&mut self, texels: &mut [f32]) {
        let (lanes, greatest) = match self.format {
            height_format::UNORM8 => (4, 255.0),
            height_format::UNORM16 => (2, 65535.0),
            _ => {
                self.words.extend(texels.iter().map(|texel| texel.to_bits()));
                return;
            }
        };
        for texel in texels {
            let code = (*texel * greatest).round();
            *texel = code / greatest;
            let lane = self.count % lanes;
            if lane == 0 {
                self.words.push(0);
            }
            if let Some(word) = self.words.last_mut() {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "a code, of 16 bits at most"
                )]
                let code = code as u32;
                *word |= code << (32 / lanes * lane);
            }
            self.count += 1;
        }
    }
}

impl Level {
    /// The next one.
    fn halved(&self, width: u32, height: u32) -> Level {
        let (columns, rows) = (covered(self.width, width), covered(self.height, height));
        let mean = |row: &[(usize, f32)], column: &[(usize, f32)]| {
            let (mut sum, mut weights) = (0.0, 0.0);
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for &(y, y_weight) in row {
                for &(x, x_weight) in column {
                    let texel = self.texels[y * self.width as usize + x];
                    let weight = f64::from(x_weight) * f64::from(y_weight);
                    sum += f64::from(texel) * weight;
                    weights += weight;
                    (low, high) = (low.min(texel), high.max(texel));
                }
            }
            rounded(sum / weights).clamp(low, high)
        };
        let texels = rows
            .par_iter()
            .flat_map_iter(|row| columns.iter().map(move |column| mean(row, column)))
            .collect();
        Level { width, height, texels }
    }
}

/// A number as precise as texels are.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn rounded(x: f64) -> f32 {
    x as f32
}

/// Between which two texels of a row of a level a place lies, and the share of the second.
#[derive(Clone, Copy)]
struct Place {
    texels: [usize; 2],
    share: f32,
}

impl Place {
    /// At `x`, from 0 to 1 along a row of `size` texels that goes on as `wrap` says.
    fn new(x: f64, size: u32, wrap: u32) -> Place {
        // From the centre of the texel before the first one on.
        let texel = x * f64::from(size) + 0.5;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "from 0 to the row's size"
        )]
        let first = texel as u32;
        let wrapped = |i: u32| match (i.checked_sub(1), wrap) {
            (None, wrap::REPEAT) => size - 1,
            (None, _) => 0,
            (Some(i), wrap::REPEAT) if i == size => 0,
            (Some(i), _) => i.min(size - 1),
        };
        Place { texels: [first, first + 1].map(|i| wrapped(i) as usize), share: rounded(texel.fract()) }
    }

    fn between(self, row: &[f32]) -> f32 {
        let [a, b] = self.texels.map(|i| row[i]);
        a + (b - a) * self.share
    }
}

/// The greatest difference of two levels as a filter reads them.
///
/// Both are bilinear between the lines through the texel centres of either, and so is their difference: it is greatest
/// where two of these lines cross. In a map that repeats, that holds across its border too, since each line there is in
/// it.
fn greatest_difference(finer: &Level, coarser: &Level, wrap: u32) -> f32 {
    let lines = |fine: u32, coarse: u32| -> Vec<[Place; 2]> {
        let centers = |size: u32| (0..size).map(move |i| (f64::from(i) + 0.5) / f64::from(size));
        // The border itself, where a clamped map is flat from the finer one's centre on but the other is not.
        centers(fine)
            .chain(centers(coarse))
            .chain([0.0, 1.0])
            .map(|x| [Place::new(x, fine, wrap), Place::new(x, coarse, wrap)])
            .collect()
    };
    let columns = lines(finer.width, coarser.width);
    let rows = lines(finer.height, coarser.height);
    let row_of = |level: &Level, place: Place| -> Vec<f32> {
        let width = level.width as usize;
        let [a, b] = place.texels.map(|y| &level.texels[y * width..(y + 1) * width]);
        a.iter().zip(b).map(|(a, b)| a + (b - a) * place.share).collect()
    };
    rows.par_iter()
        .map(|&[fine, coarse]| {
            let (fine, coarse) = (row_of(finer, fine), row_of(coarser, coarse));
            columns
                .iter()
                .map(|[column, coarse_column]| (column.between(&fine) - coarse_column.between(&coarse)).abs())
                .fold(0.0, f32::max)
        })
        .reduce(|| 0.0, f32::max)
}

/// How large the texels of `heights` are at the vertices of `mesh`.
pub fn texel_scales(mesh: &Mesh, heights: &Heights) -> Vec<TexelScale> {
    let unused = TexelScale { size: LARGEST, span: 1.0 };
    // Vertices that read the same texel at one place count as one, as the sides of seams there do.
    let key = |vertex: &Vertex| {
        (vertex.position.to_array().map(|x| (x + 0.0).to_bits()), vertex.u.to_bits(), vertex.v.to_bits())
    };
    let mut scales: HashMap<_, TexelScale> = HashMap::new();
    for triangle in &mesh.triangles {
        let map = &heights.displacements[triangle.displacement as usize];
        let [a, b, c] = triangle.vertices.map(|i| mesh.vertices[i as usize]);
        let texel =
            |vertex: Vertex| Vec2::new(vertex.u * map.map_width as f32, vertex.v * map.map_height as f32);
        let (to_b, to_c) = (texel(b) - texel(a), texel(c) - texel(a));
        // In f64, since models may be so large or small that squares of areas are not there in f32.
        let [p, q] = [b, c].map(|end| end.position.as_dvec3() - a.position.as_dvec3());
        let size = (p.cross(q).length() / to_b.as_dvec2().perp_dot(to_c.as_dvec2()).abs()).sqrt();
        let extent = to_b.abs().max(to_c.abs()).max((to_c - to_b).abs()).max_element();
        let scale = TexelScale {
            // Of a triangle without area nothing is seen.
            size: if size.is_nan() { 0.0 } else { rounded(size.min(LARGEST.into())) },
            span: power_of_two_below(extent * MOST_OF_TRIANGLE),
        };
        for vertex in [a, b, c] {
            let at = scales.entry(key(&vertex)).or_insert(scale);
            *at = TexelScale { size: at.size.max(scale.size), span: at.span.min(scale.span) };
        }
    }
    mesh.vertices.iter().map(|vertex| scales.get(&key(vertex)).copied().unwrap_or(unused)).collect()
}

/// The size of texels where a triangle has no extent in its map. Not infinite: the kernels interpolate it.
const LARGEST: f32 = 1e30;

/// What share of a triangle's extent in its map a pixel is taken to cover at the most: boxes, which hold the surface
/// from wherever it is seen, get larger with it.
const MOST_OF_TRIANGLE: f32 = 0.5;

/// The greatest power of two up to `x`, from 1 to 2^30; 1 for NaN.
fn power_of_two_below(x: f32) -> f32 {
    const MANTISSA: u32 = 0x7f_ffff;
    if x > 1.0 { f32::from_bits(x.min(1_073_741_824.0).to_bits() & !MANTISSA) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::texture::{HeightTexels, Level as LevelPlace, LevelOfDetail};

    fn map(width: u32, height: u32, format: u32, texels: Vec<u32>) -> HeightMap {
        HeightMap { width, height, format, texels, range: (0.0, 1.0), replaced: 0 }
    }

    /// Small whole numbers from a sequence without order.
    fn noise(i: u32) -> u32 {
        i.wrapping_mul(2_654_435_761) >> 24
    }

    #[test]
    fn levels_are_means_in_the_format_of_the_map() {
        let floats = map(4, 1, height_format::FLOAT32, [1.0_f32, 2.0, 5.0, 9.0].map(f32::to_bits).into());
        let (words, _) = with_levels(&floats, &[]);
        let values: Vec<f32> = words.into_iter().map(f32::from_bits).collect();
        assert_eq!(values, [1.0, 2.0, 5.0, 9.0, 1.5, 7.0, 4.25]);
        // The levels begin within a word: five texels, then two, then one.
        let bytes = map(5, 1, height_format::UNORM8, vec![u32::from_le_bytes([10, 20, 30, 40]), 50]);
        let (words, _) = with_levels(&bytes, &[]);
        assert_eq!(words.len() as u64, super::words(&bytes));
        assert_eq!(words[1].to_le_bytes(), [50, 18, 42, 30]);
        let halves = map(1, 2, height_format::UNORM16, vec![1000 | 2001 << 16]);
        assert_eq!(with_levels(&halves, &[]).0, [1000 | 2001 << 16, 1501]);
    }

    /// No place of the filtered map is farther from the map than its roughness says, and some place is nearly as far.
    /// Sides are odd, so that texels of levels lie anywhere.
    #[test]
    fn levels_differ_by_no_more_than_the_roughness() {
        for (width, height) in [(16, 16), (13, 9), (64, 1)] {
            let texels = (0..width * height).map(|i| (noise(i) as f32 / 255.0).to_bits()).collect();
            let map = map(width, height, height_format::FLOAT32, texels);
            let wraps = [wrap::REPEAT, wrap::CLAMP, wrap::MIRROR];
            let (texels, roughness) = with_levels(&map, &wraps);
            for (wrap, roughness) in wraps.into_iter().zip(roughness) {
                let (format, finest) = (height_format::FLOAT32, LevelPlace::finest(width, height));
                let levels = HeightTexels { texels: &texels, format, wrap, first_word: 0 };
                let mut greatest = 0.0_f32;
                for i in 0..20_000_u32 {
                    let uv =
                        Vec2::new(noise(2 * i) as f32 / 128.0 - 0.5, noise(2 * i + 1) as f32 / 128.0 - 0.5);
                    for side in [1.5, 2.0, 3.0, 4.0, 7.0, 16.0, 1e9] {
                        let sample = |detail| levels.sample(finest, uv, detail);
                        let difference =
                            (sample(LevelOfDetail::new(side)) - sample(LevelOfDetail::FINEST)).abs();
                        // Beyond the last level differences grow no more.
                        let most = roughness * side.min(width.max(height) as f32 * 2.0);
                        assert!(difference <= most * (1.0 + 1e-5), "{difference} {most} at {uv}, {side}");
                        if side == 2.0 {
                            greatest = greatest.max(difference / 2.0);
                        }
                    }
                }
                assert!(greatest > 0.8 * roughness, "{greatest} {roughness} {wrap}");
            }
        }
    }

    #[test]
    fn flat_maps_are_not_rough() {
        let flat = map(7, 5, height_format::FLOAT32, vec![0.3_f32.to_bits(); 35]);
        assert_eq!(with_levels(&flat, &[wrap::REPEAT]).1, [0.0]);
    }
}
