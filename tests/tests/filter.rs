//! Texture filtering: on the way from near to far, pictures of one sample stay near those of many, and outlines where
//! they are.

use emboss::backend::cpu::CpuBackend;
use emboss::picture::Picture;
use emboss::render::Scene;
use emboss::scene::{ColorMap, HeightMap, Material, Relief};
use emboss::settings::{Filter, Method, Settings};
use emboss_kernels::interface::{color_format, height_format};
use emboss_tests::Numbers;
use emboss_tests::compare::{rendered, rmse};
use emboss_tests::meshes;
use emboss_tests::scenes::{builtin_scene, job};
use glam::Vec3;

/// Side of the map in texels.
const SIDE: u32 = 256;
/// Samples of the picture that shows what is right.
const MANY: u32 = 64;

/// Texels at random, the hardest of maps: nothing near a texel tells anything of it.
fn noise() -> ColorMap {
    let mut numbers = Numbers::new(61);
    let texels = (0..SIDE * SIDE * 3).map(|_| numbers.unit().to_bits()).collect();
    ColorMap { width: SIDE, height: SIDE, format: color_format::FLOAT32, texels }
}

/// The quilt's square under noise, repeated `times` over its side, in ambient light: pixels show the map and nothing
/// else.
fn picture(times: f32, method: Method, filter: Filter, samples: u32) -> Picture {
    let (mut scene, settings) = builtin_scene("builtin:quilt", 8, 96, 72);
    scene.materials = vec![Some(noise()).into()];
    scene
        .mesh
        .vertices
        .iter_mut()
        .for_each(|vertex| (vertex.u, vertex.v) = (vertex.u * times, vertex.v * times));
    // The relief, of few micro-triangles, stays as it is however often the map repeats.
    scene.reliefs[0].scale = 0.05;
    let settings = Settings { method, filter, ambient: 1.0, shadows: false, lights: Vec::new(), ..settings };
    let mut dark = job(scene, &settings);
    dark.leave_no_light();
    rendered(&mut CpuBackend::new(), &dark, samples)
}

/// Against pictures of 64 samples, which are themselves off by an eighth of what one sample of the noise deviates by,
/// 0.19: by 0.024. One filtered sample is off by no more than 0.06, a third of that deviation, and from 8 repeats on,
/// where a pixel's mean says little, by no more than 0.03. One unfiltered sample is off by all of it.
#[test]
#[expect(clippy::print_stdout, reason = "docs/SHADING.md shows the table")]
fn pictures_of_one_sample_stay_near_those_of_many_on_the_way_to_afar() {
    println!("| Repeats | bilinear | trilinear |");
    let flat = [1.0, 2.0, 4.0, 8.0, 16.0, 64.0].map(|times| (times, Method::None));
    for (times, method) in flat.into_iter().chain([(4.0, Method::Quadtree)]) {
        let reference = picture(times, method, Filter::Bilinear, MANY);
        let [bilinear, trilinear] = [Filter::Bilinear, Filter::Trilinear]
            .map(|filter| rmse(&picture(times, method, filter, 1), &reference));
        println!("| {times} by {method:?} | {bilinear:.3} | {trilinear:.3} |");
        let most = if times < 8.0 { 0.06 } else { 0.03 };
        assert!(trilinear < most && bilinear > 0.15, "{times}, {method:?}: {trilinear}, {bilinear}");
    }
}

/// A sphere of radius 1 under random heights up to `height`, `side` texels a side, seen from `distance` of its middle.
fn bumpy_sphere(side: u32, height: f32, distance: f32, filter: Filter, samples: u32) -> Picture {
    const SIZE: u32 = 96;
    let solid = meshes::icosphere(1).placed(1.0, 0.0);
    let mut numbers = Numbers::new(5);
    let texels = (0..side * side).map(|_| numbers.unit().to_bits()).collect();
    let format = height_format::FLOAT32;
    let map = HeightMap { width: side, height: side, format, texels, range: (0.0, 1.0), replaced: 0 };
    let reliefs = vec![Relief::new(map, 0.0, height)];
    let scene = Scene {
        mesh: solid.mesh,
        reliefs,
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 64,
    };
    let settings =
        Settings { filter, width: SIZE, height: SIZE, ambient: 0.1, shadows: false, ..Settings::default() };
    let mut job = job(scene, &settings);
    job.look_from(Vec3::new(0.48, 0.36, 0.8) * distance);
    rendered(&mut CpuBackend::new(), &job, samples)
}

/// Whether the sphere covers all of the pixels around (x, y), or none of them.
fn surroundings(picture: &Picture, x: usize, y: usize) -> (bool, bool) {
    let width = picture.width as usize;
    let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| picture.pixels[y * width + x].w));
    let (least, most) = around.fold((1.0_f32, 0.0_f32), |(a, b), alpha| (a.min(alpha), b.max(alpha)));
    (least == 1.0, most == 0.0)
}

/// On the way from near to afar no outline is off by more than a pixel: what either picture covers with all pixels
/// around, the other covers too, and what it leaves free with all around stays free. High bumps are read as they are:
/// levels would take their tops, which the outline is made of.
#[test]
fn outlines_stay_within_a_pixel_on_the_way_to_afar() {
    let mut changed = 0;
    for (height, distance) in [(0.3, 3.0), (0.3, 6.0), (0.02, 3.0), (0.02, 6.0), (0.02, 12.0)] {
        let [plain, filtered] = [Filter::Bilinear, Filter::Trilinear]
            .map(|filter| bumpy_sphere(512, height, distance, filter, 8));
        for (a, b) in [(&plain, &filtered), (&filtered, &plain)] {
            for y in 1..a.height as usize - 1 {
                for x in 1..a.width as usize - 1 {
                    let (inside, outside) = surroundings(a, x, y);
                    let alpha = b.pixels[y * a.width as usize + x].w;
                    assert!(!(inside && alpha < 1.0), "pixel ({x}, {y}) from {distance} is lost");
                    assert!(!(outside && alpha > 0.0), "pixel ({x}, {y}) from {distance} is new");
                    changed +=
                        u32::from(a.pixels[y * a.width as usize + x] != b.pixels[y * a.width as usize + x]);
                }
            }
        }
    }
    // A fifth of all pixels that show the sphere from its nearest place.
    assert!(changed > 1000, "{changed} pixels are filtered");
}

/// Light on gentle bumps, of which a pixel covers more and more: by one sample it is off from the mean of many by what
/// bumps there are within a pixel. Levels leave less of it: 0.43 to 0.59 was measured. They end where a pixel covers
/// half a base triangle, so that farther out more is left again.
#[test]
#[expect(clippy::print_stdout, reason = "docs/SHADING.md shows the table")]
fn distant_relief_is_calm() {
    println!("| Distance | bilinear | trilinear |");
    for distance in [3.0, 6.0, 12.0] {
        let [bilinear, trilinear] = [Filter::Bilinear, Filter::Trilinear].map(|filter| {
            let [one, many] = [1, MANY].map(|samples| bumpy_sphere(512, 0.004, distance, filter, samples));
            rmse(&one, &many)
        });
        println!("| {distance} | {bilinear:.4} | {trilinear:.4} |");
        assert!(trilinear < 0.75 * bilinear, "from {distance}: {trilinear} of {bilinear}");
    }
}
