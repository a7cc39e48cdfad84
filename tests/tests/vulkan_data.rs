//! Real meshes and maps. They belong to others and are not part of the project: where the folder is absent, these
//! tests say so and prove nothing.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::picture::{Destination, Picture};
use emboss::render::{Job, Scene};
use emboss::scene::Relief;
use emboss::scene::image::{load_color_map, load_height_map};
use emboss::scene::obj::load_obj;
use emboss::settings::{Method, Settings};
use emboss_kernels::interface::{Intersection, MISS, Ray, counter};
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::scenes::{builtin_scene, job};
use emboss_tests::{finish, lavapipe};
use glam::Vec2;
use std::path::{Path, PathBuf};

/// Pixels of a side of the pictures.
const SIDE: u32 = 200;

/// The folder with the real data, if it is there.
#[expect(clippy::print_stderr, reason = "a test that proves nothing must say so")]
fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("{} is absent: nothing is tested", folder.display());
    None
}

fn square() -> Settings {
    Settings { width: SIDE, height: SIDE, ..Settings::default() }
}

/// The frog as the original program shows it.
fn monsterfrog(data: &Path, subdivisions: u32) -> (Scene, Settings) {
    let folder = data.join("monsterfrog");
    let mesh = load_obj(&folder.join("monsterfrog_mapped.obj")).unwrap().mesh;
    assert_eq!(mesh.triangles.len(), 2584);
    let height_map = load_height_map(&folder.join("monsterfrog-d.bmp"), 0.5, false).unwrap();
    let color_map = Some(load_color_map(&folder.join("monsterfrog-n.bmp")).unwrap());
    (
        Scene {
            mesh,
            reliefs: vec![Relief::new(height_map, 0.5, 0.5)],
            materials: vec![color_map.into()],
            parts: vec![],
            subdivisions,
        },
        square(),
    )
}

/// The built-in quilt with the chesterfield's relief.
fn chesterfield(data: &Path, subdivisions: u32) -> (Scene, Settings) {
    let (scene, settings) = builtin_scene("builtin:quilt", subdivisions, SIDE, SIDE);
    let height_map = load_height_map(&data.join("chesterfield-height.jpg"), 0.0, false).unwrap();
    (Scene { reliefs: vec![Relief::new(height_map, 0.0, 0.4)], ..scene }, settings)
}

/// Keeps a picture for people to look at.
fn keep(picture: &Picture, name: &str) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../test-pictures");
    std::fs::create_dir_all(&folder).unwrap();
    Destination::new(folder.join(name)).unwrap().write(picture, "").unwrap();
}

/// The rays through the pixels' centres.
fn central_rays(job: &Job) -> Vec<Ray> {
    let frame = &job.frame;
    let ray = |i: u32| {
        let (x, y) = ((i % frame.width) as f32 + 0.5, (i / frame.width) as f32 + 0.5);
        let film = Vec2::new(x / frame.width as f32, y / frame.height as f32);
        let direction = frame.camera.ray_direction(film);
        Ray { origin: frame.camera.eye, t_max: f32::INFINITY, direction, padding: 0 }
    };
    (0..frame.width * frame.height).map(ray).collect()
}

/// The picture by both backends and both methods for any N: alike, and kept.
fn assert_alike(scene: &Scene, settings: &Settings, name: &str) {
    for method in [Method::Quadtree, Method::GridWalk] {
        let settings = Settings { method, ..settings.clone() };
        assert_alike_by(&job(scene.clone(), &settings), &format!("{name}-{method:?}"));
    }
}

/// The picture of a job by both backends: alike, and kept.
fn assert_alike_by(job: &Job, name: &str) {
    let mut backend = lavapipe();
    let picture = rendered(&mut backend, job, 1);
    let mut cpu = CpuBackend::new();
    keep(&picture, &format!("{name}-vulkan.png"));
    keep(&rendered(&mut cpu, job, 1), &format!("{name}-cpu.png"));
    against_cpu(job, 1, &picture).assert_same(name);
    let caps = counter::CAP_HITS as usize;
    assert_eq!(
        (backend.totals().unwrap()[caps], cpu.totals().unwrap()[caps]),
        (0, 0),
        "{name}: walks cut short"
    );
    finish(backend);
}

/// On each backend the quadtree's picture is brute force's, bit for bit: the hit comes from the same test of the same
/// micro-triangle. The walk's differs where it misses: in fewer pixels than one in a thousand.
fn assert_methods_are_exact(scene: &Scene, settings: &Settings) {
    let by = |method| job(scene.clone(), &Settings { method, ..settings.clone() });
    let mut vulkan = lavapipe();
    let backends: [&mut dyn Backend; 2] = [&mut vulkan, &mut CpuBackend::new()];
    for backend in backends {
        let reference = rendered(backend, &by(Method::BruteForce), 1);
        for (method, most) in [(Method::Quadtree, 0), (Method::GridWalk, reference.pixels.len() / 1000)] {
            let picture = rendered(backend, &by(method), 1);
            let different: Vec<usize> =
                (0..picture.pixels.len()).filter(|&i| picture.pixels[i] != reference.pixels[i]).collect();
            let name = &backend.device().name;
            assert!(different.len() <= most, "{name}, {method:?}: pixels {different:?} differ");
        }
    }
    finish(vulkan);
}

/// Pixels that differ from all of their eight neighbours: misses among hits, hits among misses, and hits that are
/// farther from each neighbour than the neighbours' depths are apart.
fn isolated(hits: &[Intersection]) -> (Vec<usize>, Vec<usize>) {
    let side = SIDE as usize;
    let (mut holes, mut spots) = (Vec::new(), Vec::new());
    for i in (side + 1..hits.len() - side - 1).filter(|i| !matches!(i % side, 0) && i % side != side - 1) {
        let around =
            [i - side - 1, i - side, i - side + 1, i - 1, i + 1, i + side - 1, i + side, i + side + 1];
        let depths = around.map(|j| hits[j].t);
        let (low, high) =
            depths.iter().fold((f32::INFINITY, 0f32), |(low, high), &t| (low.min(t), high.max(t)));
        if hits[i].primitive == MISS {
            // Surface all round, as smooth as that of a single body.
            if high - low < 0.02 * low {
                holes.push(i);
            }
        } else if !low.is_finite() || hits[i].t - high > high - low || low - hits[i].t > high - low {
            spots.push(i);
        }
    }
    (holes, spots)
}

/// No hole in the body at all; and wherever a pixel stands out, as well as at every eleventh pixel, the hit is brute
/// force's. On the device the pixels that stand out must be the same ones: brute force at large N is not asked of it,
/// since lavapipe ends a shader's loops, without a word, after 65535 rounds of all of them together (Mesa's
/// `LP_MAX_TGSI_LOOP_ITERATIONS`).
fn assert_no_stray_pixels(scene: &Scene, settings: &Settings, name: &str) {
    let descent = job(scene.clone(), settings);
    let brute_force = job(scene.clone(), &Settings { method: Method::BruteForce, ..settings.clone() });
    let rays = central_rays(&descent);
    let mut cpu = CpuBackend::new();
    let hits = traced(&mut cpu, &descent, &rays);
    let (holes, spots) = isolated(&hits);
    assert!(holes.is_empty(), "{name} has holes: {holes:?}");
    let suspects: Vec<usize> = spots.iter().copied().chain((0..hits.len()).step_by(11)).collect();
    let suspect_rays: Vec<Ray> = suspects.iter().map(|&i| rays[i]).collect();
    for (&i, truth) in suspects.iter().zip(traced(&mut cpu, &brute_force, &suspect_rays)) {
        assert_eq!(hits[i], truth, "{name}: pixel ({}, {})", i % SIDE as usize, i / SIDE as usize);
    }
    let mut vulkan = lavapipe();
    let on_device = isolated(&traced(&mut vulkan, &descent, &rays));
    finish(vulkan);
    assert_eq!(on_device, (holes, spots), "{name}: other pixels stand out on the device");
}

/// A backend's hits of rays through the scene of a job.
fn traced(backend: &mut dyn Backend, job: &Job, rays: &[Ray]) -> Vec<Intersection> {
    backend.load(&job.buffers, &job.frame, job.features).unwrap();
    backend.trace_rays(rays).unwrap()
}

#[test]
fn monsterfrog_is_alike_on_both_backends() {
    let Some(data) = data() else { return };
    for subdivisions in [8, 64] {
        let (scene, settings) = monsterfrog(&data, subdivisions);
        assert_alike(&scene, &settings, &format!("monsterfrog-{subdivisions}"));
    }
}

#[test]
fn monsterfrog_has_no_stray_pixel() {
    let Some(data) = data() else { return };
    let (scene, settings) = monsterfrog(&data, 8);
    assert_methods_are_exact(&scene, &settings);
    let (scene, settings) = monsterfrog(&data, 64);
    assert_no_stray_pixels(&scene, &settings, "monsterfrog");
}

#[test]
fn chesterfield_is_alike_on_both_backends() {
    let Some(data) = data() else { return };
    for subdivisions in [8, 64] {
        let (scene, settings) = chesterfield(&data, subdivisions);
        assert_alike(&scene, &settings, &format!("chesterfield-{subdivisions}"));
    }
}

#[test]
fn chesterfield_has_no_stray_pixel() {
    let Some(data) = data() else { return };
    let (scene, settings) = chesterfield(&data, 8);
    assert_methods_are_exact(&scene, &settings);
    let (scene, settings) = chesterfield(&data, 64);
    assert_no_stray_pixels(&scene, &settings, "chesterfield");
}
