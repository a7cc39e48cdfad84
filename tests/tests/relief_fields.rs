//! The methods that follow rays through stored surfaces, prisms and fields of distances, against the exact one and closed
//! forms.

use bytemuck::bytes_of;
use emboss::backend::cpu::CpuBackend;
use emboss::backend::{Backend, BackendError};
use emboss::render::Scene;
use emboss::settings::{Method, Normals, Settings, Weld};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{Intersection, MISS, Ray, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::scene::Features;
use emboss_tests::compare::rendered;
use emboss_tests::scenes::{self, ReadyJob, VECTORS, builtin_scene};
use emboss_tests::{Numbers, RaySource};

/// So many rays of each kind, as `builtin.rs` has them.
fn rays(job: &ReadyJob, seed: u64, of_each: usize) -> Vec<Ray> {
    let mut source = RaySource::new(job, seed);
    let five = |_| {
        [
            source.from_outside(),
            source.from_inside(),
            source.grazing(),
            source.along_normal(),
            source.towards_edge(3.0),
        ]
    };
    (0..of_each).flat_map(five).collect()
}

/// The job by another method, with what the host makes of it.
fn by(job: &ReadyJob, method: Method) -> ReadyJob {
    let features = Features { method: method.id(), ..job.features };
    job.with_features(features)
}

/// Panics unless both jobs give one answer to each ray, bit for bit; and to shadow rays that leave the hits.
fn assert_same_hits(exact: &ReadyJob, other: &ReadyJob, seed: u64, of_each: usize) {
    let mut answers = CpuBackend::new();
    let mut trace = |job: &ReadyJob, rays: &[Ray]| -> Vec<Intersection> {
        answers.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
        answers.trace_rays(rays).expect("the CPU does not fail")
    };
    let first = rays(exact, seed, of_each);
    let (expected, found) = (trace(exact, &first), trace(other, &first));
    let n = exact.frame.subdivisions;
    for ((ray, expected), found) in first.iter().zip(&expected).zip(&found) {
        assert_eq!(bytes_of(expected), bytes_of(found), "N = {n}: {ray:?}\n{expected:?}\n{found:?}");
    }
    let hits = expected.iter().filter(|hit| hit.primitive != MISS);
    assert!(4 * hits.clone().count() > first.len(), "N = {n}: too few hits for a test");
    let mut numbers = Numbers::new(seed);
    let (exact_view, other_view) = (exact.view(), other.view());
    for hit in hits {
        // As shadow rays: from the point itself, which only the micro-triangle that is left keeps from being hit.
        let left = Hit { primitive: hit.primitive, cell: hit.cell, ..Hit::NONE };
        let ray = TraversalRay::new(hit.point, numbers.direction(), f32::INFINITY).leaving(left);
        let [nearest, found] = [(exact_view, exact.features), (other_view, other.features)]
            .map(|(view, features)| traverse(&view, features, &ray, Query::Nearest, &mut Counts::default()));
        assert_eq!(nearest, found, "N = {n}, leaving: {ray:?}");
        let any = traverse(&other_view, other.features, &ray, Query::Any, &mut Counts::default());
        assert_eq!(any.is_some(), nearest.is_some(), "N = {n}, any: {ray:?}");
    }
}

#[test]
fn tessellate_is_quadtree_on_the_built_in_scenes() {
    for name in ["builtin:cube", "builtin:quilt", "builtin:knot"] {
        for (n, of_each) in [(1, 400), (3, 400), (8, 400), (17, 400), (64, 200)] {
            // 64 on the knot is ten million.
            let n = if name == "builtin:knot" && n == 64 { 24 } else { n };
            let exact = scenes::ready(
                Scene { subdivisions: n, ..scenes::builtin(name) },
                emboss::settings::Wrap::Repeat,
            );
            assert_same_hits(&exact, &by(&exact, Method::Tessellate), u64::from(n), of_each);
        }
    }
}

/// Vectors in both spaces, linear directions, cracked seams.
#[test]
fn tessellate_is_quadtree_under_vectors_and_without_seams() {
    let settings = Settings { width: 1, height: 1, ..Settings::default() };
    for displacement in VECTORS {
        let exact = scenes::job(scenes::mushroom(9), &Settings { displacement, ..settings.clone() });
        assert_same_hits(&exact, &by(&exact, Method::Tessellate), 5, 300);
    }
    let settings = Settings { normals: Normals::Linear, weld: Weld::Off, ..settings };
    let exact = scenes::job(Scene { subdivisions: 6, ..scenes::builtin("builtin:cube") }, &settings);
    assert_same_hits(&exact, &by(&exact, Method::Tessellate), 6, 300);
}

/// Pictures with shadows, and after heights have changed.
#[test]
fn tessellate_paints_the_picture_of_the_quadtree() {
    let (scene, settings) = builtin_scene("builtin:cube", 8, 64, 48);
    let settings = Settings { shadows: true, ..settings };
    let exact = scenes::job(scene.clone(), &settings);
    let stored = by(&exact, Method::Tessellate);
    let mut backend = CpuBackend::new();
    let picture = rendered(&mut backend, &exact, 2);
    assert!(rendered(&mut backend, &stored, 2) == picture);
    for scale in [0.3, 0.301, 0.0, -0.2] {
        let mut moved = scene.clone();
        moved.reliefs[0].scale = scale;
        let mut other = (*scenes::job(moved, &settings)).clone();
        (other.frame.camera, other.frame.light_count) = (exact.frame.camera, exact.frame.light_count);
        other.buffers.lights.clone_from(&exact.buffers.lights);
        backend.load(&stored.buffers, &stored.frame, stored.features).expect("fits");
        backend.set_displacements(&other.buffers.displacements).expect("heights alone");
        let seen =
            emboss::render::render(&mut backend, &stored, 2, &mut |_| std::ops::ControlFlow::Continue(()));
        let seen = seen.expect("the CPU does not fail").picture;
        assert!(seen == rendered(&mut backend, &other, 2), "scale {scale}");
        assert!(seen != picture);
    }
}

#[test]
fn what_cannot_be_stored_is_refused() {
    let scene = Scene { subdivisions: 4096, ..scenes::builtin("builtin:cube") };
    let settings = Settings { method: Method::Tessellate, width: 1, height: 1, ..Settings::default() };
    let job = emboss::render::prepare(scene, &settings).expect("sound maps");
    let error = CpuBackend::new().load(&job.buffers, &job.frame, job.features).expect_err("too many");
    let triangles = job.frame.triangle_count;
    assert!(matches!(error, BackendError::TooManyMicroTriangles { .. }), "{error}");
    let most = (f64::from(emboss_kernels::interface::MAX_PRIMITIVES) / f64::from(triangles)).sqrt().floor();
    assert!(error.to_string().contains(&format!("use N = {most} or less, or --method quadtree")), "{error}");

    let auto = Settings { adaptive: Some(1.0), ..settings.clone() };
    let error = emboss::render::prepare(scenes::builtin("builtin:cube"), &auto).expect_err("auto");
    assert!(error.to_string().contains("N is auto"), "{error}");

    // What is stored is for one method.
    let exact = scenes::ready(scenes::builtin("builtin:cube"), emboss::settings::Wrap::Repeat);
    let mut backend = CpuBackend::new();
    backend.load(&exact.buffers, &exact.frame, exact.features).expect("fits");
    let features = Features { method: method::TESSELLATE, ..exact.features };
    assert!(backend.set_features(features).expect_err("not built").to_string().contains("another scene"));
}
