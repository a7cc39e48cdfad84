//! Texture filtering: on the way from near to far, pictures of one sample stay near those of many.

use emboss::backend::cpu::CpuBackend;
use emboss::picture::Picture;
use emboss::scene::ColorMap;
use emboss::settings::{Filter, Method, Settings};
use emboss_kernels::interface::color_format;
use emboss_tests::Numbers;
use emboss_tests::compare::{rendered, rmse};
use emboss_tests::scenes::{builtin_scene, job};

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

/// The quilt's square under noise, repeated `times` over its side, in ambient light: pixels show the map and nothing else.
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

/// Against pictures of 64 samples, which are themselves off by an eighth of what one sample of the noise deviates by, 0.19:
/// by 0.024. One filtered sample is off by no more than 0.06, a third of that deviation, and from 8 repeats on, where
/// a pixel's mean says little, by no more than 0.03. One unfiltered sample is off by all of it.
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
