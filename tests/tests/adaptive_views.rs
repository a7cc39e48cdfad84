//! What adaptive N shows, and what it saves: micro-triangles in pixels, pictures against the finest, pictures on a
//! path.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::bvh::HostAabb;
use emboss::picture::Picture;
use emboss::render::{Job, load, prepare, render};
use emboss::settings::Settings;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
use emboss_kernels::interface::Camera;
use emboss_tests::compare::rmse;
use emboss_tests::scenes::{self, ReadyJob, builtin_scene};
use glam::{DVec2, Vec3};
use std::ops::ControlFlow;
use std::time::Duration;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

/// A built-in scene, N as given or where it is `None` adaptive, that is looked at from one place after the other.
struct Views {
    backend: CpuBackend,
    job: Job,
    boxes: Vec<Aabb>,
    /// The eye that sees all of it.
    usual_eye: Vec3,
}

impl Views {
    fn new(name: &str, n: Option<u32>) -> Views {
        let (scene, settings) = builtin_scene(name, n.unwrap_or(4096), WIDTH, HEIGHT);
        let settings = Settings { adaptive: n.is_none().then_some(1.0), ..settings };
        let mut backend = CpuBackend::new();
        let mut job = prepare(scene, &settings).expect("sound maps");
        load(&mut backend, &mut job).expect("a built-in scene fits");
        let boxes = backend.prism_boxes().expect("the CPU does not fail");
        let usual_eye = job.frame.camera.eye;
        Views { backend, job, boxes, usual_eye }
    }

    /// An eye in the direction of the default one, so many times as far away from the middle of the model.
    fn eye(&self, share: f32) -> Vec3 {
        let whole = self.boxes.iter().copied().reduce(Aabb::union).expect("not empty");
        let centre = (whole.min + whole.max) * 0.5;
        centre + (self.usual_eye - centre) * share
    }

    /// The picture from an eye, one sample a pixel, and how long it took.
    fn picture(&mut self, eye: Vec3) -> (Picture, Duration) {
        self.job.view.eye = Some(eye.as_dvec3());
        self.job.frame_view(&self.boxes).expect("framed");
        self.backend.set_view(&self.job.frame, &self.job.buffers.lights).expect("its own lights");
        let rendering = render(&mut self.backend, &self.job, 1, &mut |_| ControlFlow::Continue(()));
        let rendering = rendering.expect("the CPU does not fail");
        (rendering.picture, rendering.elapsed)
    }
}

/// The table of EXACTNESS.md, which this prints: time, micro-triangles and the error against N = 1024.
///
/// Pictures have one sample, the same rays in all of them, so that what differs is the surface.
#[test]
#[expect(clippy::print_stdout, reason = "the table is what the test is run by hand for")]
fn adaptive_n_is_as_fine_as_it_needs() {
    for name in ["builtin:knot"] {
        let mut finest = Views::new(name, Some(1024));
        let eyes = [0.4, 4.0].map(|share| (share, finest.eye(share)));
        let finest = eyes.map(|(_, eye)| finest.picture(eye).0);
        let mut of_auto = [(0.0, 0.0, 0); 2];
        for n in [None, Some(8), Some(64), Some(512)] {
            let mut views = Views::new(name, n);
            for (i, (share, eye)) in eyes.into_iter().enumerate() {
                let (picture, time) = views.picture(eye);
                let (cuts, error) = (views.job.cuts(), rmse(&picture, &finest[i]));
                if n.is_none() {
                    of_auto[i] = (time.as_secs_f64(), error, cuts.micro_triangles);
                }
                let (auto_time, auto_error, auto_count) = of_auto[i];
                println!(
                    "{name} {share}: N {} to {}, {} micro-triangles, time {:.2}, rmse {error:.5}",
                    cuts.least,
                    cuts.greatest,
                    cuts.micro_triangles,
                    time.as_secs_f64() / auto_time
                );
                // No worse than fewer micro-triangles everywhere.
                assert!(
                    n.is_none() || cuts.micro_triangles >= auto_count || auto_error < error,
                    "{name} {share}"
                );
            }
        }
    }
}

/// Where a point is on the film, in pixels; `None` behind the camera or beside the film.
fn on_film(camera: &Camera, p: Vec3) -> Option<DVec2> {
    let [p, right, up, forward] =
        [p - camera.eye, camera.right, camera.up, camera.forward].map(|v: Vec3| v.as_dvec3());
    let depth = p.dot(forward);
    let film = DVec2::new(p.dot(right) / right.length_squared(), p.dot(up) / up.length_squared()) / depth;
    let inside = depth > 0.0 && film.abs().max_element() <= 1.0;
    inside.then_some(film * DVec2::new(f64::from(WIDTH), f64::from(HEIGHT)) * 0.5)
}

/// The areas on the film, in pixels, of micro-triangles that are wholly in it; of finely cut triangles of every so
/// many.
fn areas(job: &ReadyJob, every: u32) -> Vec<f64> {
    let view = job.view();
    let whole = HeightField::new(&view, job.features);
    let mut areas = Vec::new();
    for primitive in 0..view.frame.triangle_count {
        let field = whole.of_triangle(&view, primitive, 0);
        let (base, n) = (BaseTriangle::load(&view, primitive), field.subdivisions);
        for j in 0..n {
            for k in (0..n - j).filter(|k| n <= every || (j + 7 * k) % every == 0) {
                for upper in [false, true].into_iter().filter(|upper| !upper || j + k + 1 < n) {
                    let corners = base.micro_triangle(&field, Cell { j, k, upper });
                    let film = corners.map(|p| on_film(&job.frame.camera, p));
                    if let [Some(a), Some(b), Some(c)] = film {
                        areas.push(0.5 * (b - a).perp_dot(c - a).abs());
                    }
                }
            }
        }
    }
    areas
}

/// Of flat models no micro-triangle is larger than a pixel, of displaced ones few are: relief makes them steeper and
/// longer.
#[test]
#[expect(clippy::print_stdout, reason = "the shares are what EXACTNESS.md states")]
fn micro_triangles_are_smaller_than_pixels() {
    for name in ["builtin:knot", "builtin:cube"] {
        for share in [0.4, 4.0] {
            let eye = Views::new(name, Some(1)).eye(share);
            for scale in [None, Some(0.0)] {
                let (scene, mut settings) = builtin_scene(name, 4096, WIDTH, HEIGHT);
                settings.view.eye = Some(eye.as_dvec3());
                let scene = scale.map_or(scene.clone(), |scale| scenes::scaled(scene, scale));
                let job = scenes::job(scene, &Settings { adaptive: Some(1.0), ..settings });
                let areas = areas(&job, 16);
                let large = areas.iter().filter(|area| **area > 1.0).count() as f64 / areas.len() as f64;
                let greatest = areas.iter().copied().fold(0.0, f64::max);
                let count = areas.len();
                println!(
                    "{name} {share} {scale:?}: {large:.5} of {count} above a pixel, greatest {greatest:.2}"
                );
                let most = if scale.is_none() { 0.05 } else { 0.0 };
                assert!(large <= most, "{name} {share}: {large}");
            }
        }
    }
}

/// On an approach by 1 % a frame pictures differ from the ones before by as much as they do for a fixed N: what changes
/// is the view, and hardly the surface.
#[test]
#[expect(clippy::print_stdout, reason = "the ratio is what EXACTNESS.md states")]
fn n_does_not_flicker_on_a_path() {
    let steps = |n: Option<u32>| {
        let mut views = Views::new("builtin:knot", n);
        let start = views.eye(1.0);
        let pictures: Vec<Picture> = (0..6).map(|i| views.picture(start * 0.99_f32.powi(i)).0).collect();
        pictures.windows(2).map(|two| rmse(&two[1], &two[0])).collect::<Vec<f64>>()
    };
    let (auto, fixed) = (steps(None), steps(Some(256)));
    let ratios: Vec<f64> = auto.iter().zip(&fixed).map(|(auto, fixed)| auto / fixed).collect();
    println!("{ratios:.3?}");
    assert!(ratios.iter().all(|ratio| *ratio < 1.1), "{ratios:?}");
}
