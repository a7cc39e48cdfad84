//! The min/max pyramids that lavapipe builds: bit for bit the CPU's, and ranges of the texels that they stand for.

use emboss::backend::Backend;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Relief};
use emboss::settings::{Method, Settings, Wrap};
use emboss_kernels::interface::{Displacement, height_format};
use emboss_tests::scenes::{ReadyJob, job, tiles};
use emboss_tests::{Numbers, finish, lavapipe};

const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
const FORMATS: [u32; 3] = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];

/// Sizes of the maps of one scene: single texels, rows, columns, odd sizes and powers of two.
const SIZES: [(u32, u32); 12] = [
    (1, 1),
    (1, 9),
    (9, 1),
    (1, 16),
    (2, 1),
    (13, 7),
    (8, 8),
    (33, 65),
    (100, 3),
    (128, 64),
    (5, 1),
    (31, 32),
];

/// Texels of a word.
fn texels_per_word(format: u32) -> usize {
    match format {
        height_format::UNORM8 => 4,
        height_format::UNORM16 => 2,
        _ => 1,
    }
}

/// A map of random texels: codes of a format of integers, floats in [-1, 1). None is a zero, whose sign a device need
/// not keep.
fn random_map(numbers: &mut Numbers, format: u32, (width, height): (u32, u32)) -> HeightMap {
    let texels = (width * height) as usize;
    let mut word = || match format {
        height_format::FLOAT32 => (numbers.between(-1.0, 1.0) + 1e-12).to_bits(),
        _ => numbers.word(),
    };
    HeightMap {
        width,
        height,
        format,
        texels: (0..texels.div_ceil(texels_per_word(format))).map(|_| word()).collect(),
        range: if format == height_format::FLOAT32 { (-1.0, 1.0) } else { (0.0, 1.0) },
        replaced: 0,
    }
}

/// A scene whose triangles share random maps of some sizes.
fn scene_with_maps(sizes: &[(u32, u32)], format: u32, wrap: Wrap) -> ReadyJob {
    let mut numbers = Numbers::new(u64::from(format));
    let mut scene = tiles();
    let relief = |&size| Relief::new(random_map(&mut numbers, format, size), 0.25, 0.1);
    let reliefs: Vec<Relief> = sizes.iter().map(relief).collect();
    for (map, triangle) in (0..u32::try_from(sizes.len()).unwrap()).cycle().zip(&mut scene.mesh.triangles) {
        triangle.displacement = map;
    }
    // Pyramids are built whatever the method; this one's pipelines compile fastest.
    let method = Method::None;
    job(Scene { reliefs, ..scene }, &Settings { method, wrap, width: 1, height: 1, ..Settings::default() })
}

/// Number `i` of a list of packed ones, in an order that is the numbers' own: codes as they are, floats by value.
fn unpacked(words: &[u32], format: u32, i: usize) -> f64 {
    match format {
        height_format::UNORM8 => f64::from(words[i / 4] >> (8 * (i % 4)) & 0xff),
        height_format::UNORM16 => f64::from(words[i / 2] >> (16 * (i % 2)) & 0xffff),
        _ => f64::from(f32::from_bits(words[i])),
    }
}

/// The texels along a side that an entry stands for: 2^(level + 1) from its own on, which go round where maps repeat,
/// and end with the map where they do not.
fn square_side(entry: u32, level: u32, size: u32, wrap: Wrap) -> Vec<u32> {
    let all = (entry << level)..(entry << level) + (2 << level);
    all.filter(|&x| wrap == Wrap::Repeat || x < size).map(|x| x % size).collect()
}

/// Fails unless every stored entry of a map's pyramid holds the texels of its square; and no more, unless the square
/// goes round the map.
fn assert_holds_texels(job: &ReadyJob, ranges: &[u32], map: &Displacement, wrap: Wrap) {
    let format = job.features.height_format;
    let (width, height) = (map.map_width, map.map_height);
    let texels = &job.buffers.height_texels[map.first_word as usize..];
    let pyramid = &ranges[map.first_range as usize..];
    let mut level = 1;
    while 1 << (level - 1) < width.max(height) {
        let (across, down) = (width.div_ceil(1 << level), height.div_ceil(1 << level));
        let entries = &pyramid[pyramid[level as usize] as usize..];
        for entry in 0..across * down {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for &y in &square_side(entry / across, level, height, wrap) {
                for &x in &square_side(entry % across, level, width, wrap) {
                    let texel = unpacked(texels, format, (y * width + x) as usize);
                    (low, high) = (low.min(texel), high.max(texel));
                }
            }
            let pair = 2 * entry as usize;
            let range = (unpacked(entries, format, pair), unpacked(entries, format, pair + 1));
            let what = format!("{map:?}, {wrap:?}, level {level}, entry {entry}: {range:?}, {low} to {high}");
            assert!(range.0 <= low && range.1 >= high, "{what}");
            let ends = |entry: u32| (entry << level) + (2 << level);
            let goes_round = ends(entry % across) > width || ends(entry / across) > height;
            assert!(wrap == Wrap::Repeat && goes_round || range == (low, high), "{what}");
        }
        level += 1;
    }
}

#[test]
fn pyramids_are_the_cpus_to_the_bit() {
    let mut backend = lavapipe();
    for format in FORMATS {
        for wrap in WRAPS {
            let job = scene_with_maps(&SIZES, format, wrap);
            assert_eq!(job.features.height_format, format);
            backend.load(&job.buffers, &job.frame, job.features).unwrap();
            let expected = job.view().height_ranges;
            let ranges = backend.height_ranges(expected.len()).unwrap();
            let differing: Vec<usize> =
                (0..expected.len()).filter(|&i| ranges[i] != expected[i]).take(8).collect();
            assert!(differing.is_empty(), "format {format}, {wrap:?}: words {differing:?} differ");
            for map in &job.buffers.displacements {
                assert_holds_texels(&job, &ranges, map, wrap);
            }
        }
    }
    finish(backend);
}

/// A map whose levels take many submissions, and one behind it.
#[test]
fn large_pyramids_are_the_cpus_to_the_bit() {
    let mut backend = lavapipe();
    let job = scene_with_maps(&[(1021, 700), (3, 3)], height_format::FLOAT32, Wrap::Repeat);
    backend.load(&job.buffers, &job.frame, job.features).unwrap();
    let expected = job.view().height_ranges;
    assert!(backend.height_ranges(expected.len()).unwrap() == expected);
    finish(backend);
}
