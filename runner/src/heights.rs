//! The height maps of a scene as the kernels read them: texels one map behind the other, with room for a min/max pyramid
//! of each, which backends build.

use crate::scene::{HeightMap, Relief};
use emboss_kernels::displacement::height_pyramid::{
    Pyramid, level_offset, level_words, pyramid_words, top_level,
};
use emboss_kernels::interface::{Displacement, displacement_kind, height_format};
use emboss_kernels::scene::Features;
use glam::Vec3;
use rayon::prelude::*;

/// Packed height maps.
#[derive(Clone, Debug, Default)]
pub struct Heights {
    /// One for each relief.
    pub displacements: Vec<Displacement>,
    /// Texels of all maps, in `format`.
    pub texels: Vec<u32>,
    /// One of [`height_format`]: the maps' own where they have the same, else floats.
    pub format: u32,
}

impl Heights {
    /// Packs the maps of `reliefs`, at least one. Without `displaced` heights are all zero.
    pub fn pack(reliefs: Vec<Relief>, displaced: bool) -> Heights {
        let format = common_format(&reliefs);
        let mut heights = Heights { format, ..Heights::default() };
        let (mut first_word, mut first_range) = (0, 0);
        for relief in reliefs {
            let map = if relief.map.format == format { relief.map } else { floats(&relief.map) };
            let scale = if displaced { relief.scale } else { 0.0 };
            let (height_min, height_max) =
                Displacement::height_range(map.range.0, map.range.1, relief.zero, scale);
            heights.displacements.push(Displacement {
                scale,
                zero: relief.zero,
                map_width: map.width,
                map_height: map.height,
                height_min,
                height_max,
                first_word,
                first_range,
            });
            first_word = sum(first_word, word(map.texels.len()));
            first_range = sum(first_range, pyramid_words(format, map.width, map.height));
            if heights.texels.is_empty() {
                heights.texels = map.texels;
            } else {
                heights.texels.extend(map.texels);
            }
        }
        heights
    }
}

/// Builds the pyramids of `displacements`, whose texels are in `format` and which go on as `wrap` says, where they name
/// their places in `ranges`: level by level, each of them in parallel.
pub fn build_pyramids(
    displacements: &[Displacement],
    texels: &[u32],
    ranges: &mut [u32],
    format: u32,
    wrap: u32,
) {
    for map in displacements {
        let (width, height) = (map.map_width, map.map_height);
        for level in 1..=top_level(width, height) {
            let offset = level_offset(format, width, height, level);
            let pyramid = Pyramid { texels, ranges, map: *map, format, wrap };
            let items = 0..level_words(format, width, height, level);
            let built: Vec<u32> = items.into_par_iter().map(|item| pyramid.level_word(level, item)).collect();
            let first = (map.first_range + offset) as usize;
            ranges[first..first + built.len()].copy_from_slice(&built);
            ranges[(map.first_range + level) as usize] = offset;
        }
    }
}

/// Least and greatest height of all maps; of none an infinite range, the wrong way round. Of vector displacement 0 and the
/// greatest length.
pub fn range(displacements: &[Displacement], features: Features) -> (f32, f32) {
    if features.displacement != displacement_kind::HEIGHT {
        let greatest = |map: &Displacement| map.height_min.abs().max(map.height_max.abs());
        let length =
            |maps: &[Displacement]| Vec3::from_slice(&maps.iter().map(greatest).collect::<Vec<_>>()).length();
        return (0.0, displacements.chunks_exact(3).map(length).fold(0.0, f32::max));
    }
    displacements.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), map| {
        (low.min(map.height_min), high.max(map.height_max))
    })
}

/// The format that all maps have, else floats.
fn common_format(reliefs: &[Relief]) -> u32 {
    let mut formats = reliefs.iter().map(|relief| relief.map.format);
    let first = formats.next().unwrap_or(height_format::FLOAT32);
    if formats.all(|format| format == first) { first } else { height_format::FLOAT32 }
}

/// The same map as floats.
fn floats(map: &HeightMap) -> HeightMap {
    let texels =
        (0..map.height).flat_map(|y| (0..map.width).map(move |x| map.texel(x, y).to_bits())).collect();
    HeightMap { format: height_format::FLOAT32, texels, ..map.clone() }
}

/// A number of words so far and more.
fn sum(words: u32, more: u32) -> u32 {
    words.checked_add(more).expect("height maps of fewer than 2^32 words")
}

/// A number of words; maps of one scene have fewer than 2^32.
fn word(count: usize) -> u32 {
    u32::try_from(count).expect("height maps of fewer than 2^32 words")
}
