//! The height maps of a scene as the kernels read them: texels one map behind the other, with room for a min/max
//! pyramid of each, which backends build.

use crate::height_levels;
use crate::render::RenderError;
use crate::scene::{HeightMap, Relief};
use crate::settings::{Filter, Wrap};
use emboss_kernels::displacement::height_pyramid::{
    Pyramid, level_offset, level_words, pyramid_words, top_level,
};
use emboss_kernels::interface::{Displacement, displacement_kind, height_format, wrap};
use emboss_kernels::scene::Features;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Packed height maps.
#[derive(Clone, Debug, Default)]
pub struct Heights {
    /// One for each relief.
    pub displacements: Vec<Displacement>,
    /// Texels of all maps.
    pub texels: Vec<u32>,
    /// What pipelines know of formats: that of all maps, or [`height_format::PER_MAP`].
    pub format: u32,
    /// What they know of wraps: that of all maps, or [`wrap::PER_MAP`].
    pub wrap: u32,
}

/// How a scene's maps are read.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Whether they displace: without that heights are all zero.
    pub displaced: bool,
    /// How maps go on whose reliefs do not say it.
    pub wrap: Wrap,
    /// Whether their levels are needed.
    pub filter: Filter,
}

impl Heights {
    /// Packs the maps of `reliefs`, each once however many share it; those that share its wrap too share its pyramid.
    /// # Errors
    /// [`RenderError::MapsTooLarge`] where maps or pyramids are more than 32 bits can number.
    pub fn pack(reliefs: Vec<Relief>, reading: Reading) -> Result<Heights, RenderError> {
        let wrap_of = |relief: &Relief| relief.wrap.unwrap_or(reading.wrap).id();
        let filtered = reading.displaced && reading.filter == Filter::Trilinear;
        let mut displacements: Vec<Displacement> = Vec::with_capacity(reliefs.len());
        let (mut words, mut range_words) = (0, 0);
        for (i, relief) in reliefs.iter().enumerate() {
            let (map, wrap) = (&relief.map, wrap_of(relief));
            let same_map = (0..i).filter(|&other| Arc::ptr_eq(&reliefs[other].map, map));
            let first_word = match same_map.clone().next() {
                Some(other) => displacements[other].first_word,
                None if filtered => grown(&mut words, height_levels::words(map))?,
                None => grown(&mut words, map.texels.len() as u64)?,
            };
            let first_range = match same_map.clone().find(|&other| displacements[other].wrap == wrap) {
                Some(other) => displacements[other].first_range,
                None => grown(&mut range_words, pyramid_words(map.format, map.width, map.height).into())?,
            };
            let mut displacement = Displacement {
                map_width: map.width,
                map_height: map.height,
                first_word,
                first_range,
                format: map.format,
                wrap,
                ..Displacement::default()
            };
            set_heights(&mut displacement, relief, reading.displaced);
            displacements.push(displacement);
        }
        let format = common(displacements.iter().map(|map| map.format), height_format::PER_MAP);
        let wrap = common(displacements.iter().map(|map| map.wrap), wrap::PER_MAP);
        let mut texels = Vec::new();
        for (i, relief) in reliefs.into_iter().enumerate() {
            let is_new = displacements[i].first_word as usize == texels.len();
            if is_new && filtered {
                texels.extend(append_levels(&relief.map, &mut displacements[i..]));
            } else if texels.is_empty() {
                texels = Arc::unwrap_or_clone(relief.map).texels;
            } else if is_new {
                texels.extend_from_slice(&relief.map.texels);
            }
        }
        Ok(Heights { displacements, texels, format, wrap })
    }
}

/// The words of a map with its levels. Gives its roughness to those of `displacements` that are of it: the first is.
fn append_levels(map: &HeightMap, displacements: &mut [Displacement]) -> Vec<u32> {
    let first_word = displacements[0].first_word;
    let wraps = [wrap::REPEAT, wrap::CLAMP, wrap::MIRROR];
    let of_map = |displacement: &&mut Displacement| displacement.first_word == first_word;
    let used: Vec<u32> = wraps
        .into_iter()
        .filter(|&wrap| displacements.iter().any(|d| d.first_word == first_word && d.wrap == wrap))
        .collect();
    let (words, roughness) = height_levels::with_levels(map, &used);
    for displacement in displacements.iter_mut().filter(of_map) {
        let wrap = used.iter().position(|&wrap| wrap == displacement.wrap);
        displacement.roughness = wrap.map_or(0.0, |i| roughness[i]);
    }
    words
}

/// Displaces by the heights of a relief, of whose map the displacement is. Without `displaced` they are all zero.
pub fn set_heights(displacement: &mut Displacement, relief: &Relief, displaced: bool) {
    let (zero, (lowest, highest)) = (relief.zero, relief.map.range);
    let scale = if displaced { relief.scale } else { 0.0 };
    let (height_min, height_max) = Displacement::height_range(lowest, highest, zero, scale);
    *displacement = Displacement { scale, zero, height_min, height_max, ..*displacement };
}

/// The maps that pyramids are built of, with their indices: of those that share a pyramid the first.
pub fn pyramids(displacements: &[Displacement]) -> impl Iterator<Item = (u32, &Displacement)> {
    let mut end = 0;
    (0..).zip(displacements).filter(move |(_, map)| {
        let is_new = u64::from(map.first_range) >= end;
        if is_new {
            let words = pyramid_words(map.format, map.map_width, map.map_height);
            end = u64::from(map.first_range) + u64::from(words);
        }
        is_new
    })
}

/// Builds the pyramids of `displacements` where they name their places in `ranges`: level by level, each of them in
/// parallel.
pub fn build_pyramids(displacements: &[Displacement], texels: &[u32], ranges: &mut [u32]) {
    for (_, map) in pyramids(displacements) {
        let (width, height, format, wrap) = (map.map_width, map.map_height, map.format, map.wrap);
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

/// Least and greatest height of all maps; of none an infinite range, the wrong way round. Of vector displacement 0 and
/// the greatest length.
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

/// What all of some values are, `mixed` where they differ; 0 of none.
pub(crate) fn common(mut values: impl Iterator<Item = u32>, mixed: u32) -> u32 {
    let first = values.next().unwrap_or(0);
    if values.all(|value| value == first) { first } else { mixed }
}

/// Adds `more` words to a buffer that has `words`; returns where they begin.
pub(crate) fn grown(words: &mut u32, more: u64) -> Result<u32, RenderError> {
    let first = *words;
    let sum = u64::from(first) + more;
    *words = u32::try_from(sum).map_err(|_| RenderError::MapsTooLarge { words: sum })?;
    Ok(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(wrap: Wrap) -> Reading {
        Reading { displaced: true, wrap, filter: Filter::Bilinear }
    }

    fn map(format: u32, words: usize) -> Arc<HeightMap> {
        let texels = vec![0; words];
        Arc::new(HeightMap { width: 4, height: 2, format, texels, range: (0.0, 1.0), replaced: 0 })
    }

    #[test]
    fn maps_are_packed_once_and_so_are_pyramids_of_one_wrap() {
        let (a, b) = (map(height_format::UNORM8, 2), map(height_format::FLOAT32, 8));
        let relief =
            |map: &Arc<HeightMap>, wrap, scale| Relief { wrap, ..Relief::new(Arc::clone(map), 0.0, scale) };
        let reliefs = vec![
            relief(&a, None, 1.0),
            relief(&b, Some(Wrap::Clamp), 1.0),
            relief(&a, Some(Wrap::Mirror), 1.0),
            relief(&a, Some(Wrap::Repeat), 2.0),
        ];
        let heights = Heights::pack(reliefs, reading(Wrap::Repeat)).expect("small");
        let places: Vec<_> =
            heights.displacements.iter().map(|map| (map.first_word, map.first_range)).collect();
        let words = |map: &HeightMap| pyramid_words(map.format, 4, 2);
        let (first, second) = (words(&a), words(&a) + words(&b));
        assert_eq!(places, [(0, 0), (2, first), (0, second), (0, 0)]);
        assert_eq!(heights.texels.len(), 10);
        assert_eq!((heights.format, heights.wrap), (height_format::PER_MAP, wrap::PER_MAP));
        let built: Vec<_> = pyramids(&heights.displacements).map(|(i, _)| i).collect();
        assert_eq!(built, [0, 1, 2]);
    }

    #[test]
    fn what_is_alike_is_known() {
        let reliefs = [0.1, 0.2].map(|scale| Relief::new(map(height_format::UNORM16, 4), 0.0, scale)).into();
        let heights = Heights::pack(reliefs, reading(Wrap::Mirror)).expect("small");
        assert_eq!((heights.format, heights.wrap), (height_format::UNORM16, wrap::MIRROR));
    }

    #[test]
    fn more_words_than_32_bits_number_are_an_error() {
        let mut words = 5;
        assert_eq!(grown(&mut words, u64::from(u32::MAX) - 5).expect("fits"), 5);
        assert!(grown(&mut words, 1).expect_err("one too many").to_string().contains("4294967296 words"));
    }
}
