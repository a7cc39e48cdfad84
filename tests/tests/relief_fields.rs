//! The methods that follow rays through stored surfaces, prisms and fields of distances, against the exact one and
//! closed forms.

use bytemuck::bytes_of;
use emboss::backend::cpu::CpuBackend;
use emboss::backend::{Backend, BackendError};
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{Filter, Method, Normals, Settings, Weld, Wrap};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{Intersection, MISS, Ray, Vertex, height_format, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::scene::Features;
use emboss_tests::changes;
use emboss_tests::compare::rendered;
use emboss_tests::flat::assert_all_methods_show_the_base_mesh;
use emboss_tests::instances::placed;
use emboss_tests::scenes::{self, ReadyJob, VECTORS, builtin_scene};
use emboss_tests::{Numbers, RaySource};
use glam::{DAffine3, DVec2, Vec3};

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
    let first = RaySource::new(exact, seed).of_each_kind(of_each);
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
        // As shadow rays, but from the point itself: only what is left keeps them from hitting it.
        let left = Hit { primitive: hit.primitive, cell: hit.cell, ..Hit::NONE };
        let direction = numbers.direction();
        let side = hit.normal * hit.normal.dot(direction).signum();
        let ray = TraversalRay::new(hit.point, direction, f32::INFINITY).leaving(left, side);
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
            // Trees of hundreds of thousands take seconds to build.
            let n = if name != "builtin:cube" && n > 8 { 9 } else { n };
            let exact = scenes::ready(Scene { subdivisions: n, ..scenes::builtin(name) }, Wrap::Repeat);
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

// --- Methods that follow the bilinear height field ---------------------------------------------------------------

/// Texels of the smooth map a side.
const SIDE: u16 = 256;
/// Its greatest height.
const TOP: f64 = 0.15;

/// Waves that repeat: three of them a side, lower ones across.
fn texel(x: u16, y: u16) -> f32 {
    let turn = |i: u16, waves: f64| (std::f64::consts::TAU * waves * f64::from(i) / f64::from(SIDE)).sin();
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let texel = (0.5 + 0.25 * turn(x, 3.0) + 0.25 * turn(y, 2.0) * turn(x, 1.0)) as f32;
    texel
}

/// The square [0, 1]² in the plane z = 0 under the waves, whose texture coordinates are x and y.
fn waves(n: u32) -> Scene {
    let corner = |x: f32, y: f32| Vertex { position: Vec3::new(x, y, 0.0), normal: Vec3::Z, u: x, v: y };
    let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
    // The first row is the top one.
    let texels = (0..SIDE).rev().flat_map(|y| (0..SIDE).map(move |x| texel(x, y).to_bits())).collect();
    let (side, format) = (u32::from(SIDE), height_format::FLOAT32);
    let map = HeightMap { width: side, height: side, format, texels, range: (0.0, 1.0), replaced: 0 };
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let relief = Relief::new(map, 0.0, TOP as f32);
    Scene {
        mesh: Mesh::from_triangles(&corners, &[[0, 1, 2], [0, 2, 3]]),
        reliefs: vec![relief],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: n,
    }
}

/// The waves in `f64`.
struct Waves(Vec<f64>);

impl Waves {
    fn new() -> Waves {
        Waves((0..SIDE).flat_map(|y| (0..SIDE).map(move |x| f64::from(texel(x, y)))).collect())
    }

    /// The bilinear height.
    fn height(&self, x: f64, y: f64) -> f64 {
        let side = f64::from(SIDE);
        let (x, y) = (x * side - 0.5, y * side - 0.5);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a texel of the map")]
        let at = |i: f64, j: f64| self.0[(j.rem_euclid(side) * side + i.rem_euclid(side)) as usize];
        let (i, j) = (x.floor(), y.floor());
        let (s, t) = (x - i, y - j);
        let row = |j: f64| at(i, j) * (1.0 - s) + at(i + 1.0, j) * s;
        TOP * (row(j) * (1.0 - t) + row(j + 1.0) * t)
    }

    /// Where the ray first meets the waves over the whole plane: 3,000 steps between the greatest and the least height,
    /// a tenth of a texel each at most, and bisection.
    fn first_crossing(&self, ray: &Ray) -> f64 {
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let above = |t: f64| {
            let p = o + d * t;
            p.z - self.height(p.x, p.y)
        };
        let (near, far) = ((TOP - o.z) / d.z, -o.z / d.z);
        let step = (far - near) / 3_000.0;
        let mut low = near;
        while above(low + step) > 0.0 && low < far {
            low += step;
        }
        let mut high = low + step;
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if above(middle) > 0.0 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// Rays from above, at 6 to 40 degrees, that meet the plane and the waves well within the square, each with where that
/// is.
fn rays_to_waves(count: usize) -> Vec<(Ray, f64)> {
    let (waves, mut numbers) = (Waves::new(), Numbers::new(12));
    let mut rays = Vec::new();
    while rays.len() < count {
        let target = Vec3::new(numbers.between(0.2, 0.8), numbers.between(0.2, 0.8), 0.0);
        let angle = numbers.between(0.0, std::f32::consts::TAU);
        let slope = numbers.between(0.1, 0.8);
        let direction = Vec3::new(angle.cos(), angle.sin(), -slope).normalize();
        let ray = Ray { origin: target - direction * 2.0, t_max: 10.0, direction, padding: 0 };
        let t = waves.first_crossing(&ray);
        let p = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
        if p.x.min(p.y) > 0.05 && p.x.max(p.y) < 0.95 {
            rays.push((ray, t));
        }
    }
    rays
}

/// The share of rays for which a method finds another place than the first crossing: more than 10^-5 away, which is ten
/// times what rounding makes of a distance of 2 where the ray and the waves are at least a few degrees apart.
fn share_wrong(method: Method, n: u32, rays: &[(Ray, f64)]) -> f64 {
    share_far(method, n, rays, 1e-5)
}

/// The share of rays for which a method finds a place more than `far` from the first crossing.
fn share_far(method: Method, n: u32, rays: &[(Ray, f64)], far: f64) -> f64 {
    let settings = Settings { method, width: 1, height: 1, ..Settings::default() };
    let job = scenes::job(waves(n), &settings);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    let only_rays: Vec<Ray> = rays.iter().map(|(ray, _)| *ray).collect();
    let hits = backend.trace_rays(&only_rays).expect("the CPU does not fail");
    let is_right = |(hit, (_, t)): &(&Intersection, &(Ray, f64))| (f64::from(hit.t) - t).abs() < far;
    (rays.len() - hits.iter().zip(rays).filter(is_right).count()) as f64 / rays.len() as f64
}

/// The share of rays that pass through a crest between two steps falls with the square of N: a ray that grazes a crest
/// of radius r by d is below it for sqrt(8 r d), and d is as likely to be anything. That holds while a step is longer
/// than a texel: below that crests are wedges. All other rays are where they should be, whatever N.
#[test]
fn inverse_misses_less_with_the_square_of_n() {
    let rays = rays_to_waves(20_000);
    let shares = [8, 16, 32].map(|n| share_wrong(Method::Inverse, n, &rays));
    for pair in shares.windows(2) {
        // 4, less what chance makes of some dozens.
        assert!(pair[0] > 2.5 * pair[1], "{shares:?}");
    }
    assert!(shares[0] > 0.001 && shares[0] > 8.0 * shares[2], "{shares:?}");
    // A step of some 0.06 is a chord 0.006 below crests of radius 0.075, of heights of 0.15: twice what that gives.
    assert!(shares[0] < 0.08, "{shares:?}");
}

/// Its hits are those of bilinear patches; N only says when it gives up: the share of rays that are not done falls, and
/// there is none once N is enough.
#[test]
fn pyramid_finds_each_first_crossing_once_n_is_enough() {
    let rays = rays_to_waves(5_000);
    let shares = [2, 4, 8, 16].map(|n| share_wrong(Method::Pyramid, n, &rays));
    assert!(shares.is_sorted_by(|a, b| a >= b) && shares[0] > 0.1, "{shares:?}");
    // A ray that grazes a crest by less than rounding may pass it.
    assert!(shares[3] <= 2.0 / rays.len() as f64, "{shares:?}");
}

/// Nearly all of its hits are right once no ray gives up; what is left are crests thinner along the ray than its least
/// step, 1/512 of the map. While rays give up, four times N leaves less than a quarter of them: steps grow with the
/// distance from the relief.
#[test]
fn sphere_finds_nearly_each_first_crossing_once_n_is_enough() {
    let rays = rays_to_waves(5_000);
    let shares = [32, 128, 512].map(|n| share_far(Method::Sphere, n, &rays, 1e-3));
    assert!(shares[0] > 0.2 && shares[0] > 4.0 * shares[1], "{shares:?}");
    assert!(shares[2] < 0.002, "{shares:?}");
}

/// All of them converge to what the quadtree does, whose micro-triangles are the patches' chords: with N = 512, sixteen
/// to a texel, these are off by less than a patch bends in a cell.
#[test]
fn the_quadtree_comes_to_the_same_places() {
    let rays = rays_to_waves(2_000);
    // What is off in height by up to 10^-5 is off by some ten times that along a ray that grazes.
    let share = share_far(Method::Quadtree, 512, &rays, 1e-3);
    assert!(share < 0.005, "{share}");
}

#[test]
fn flat_maps_show_the_base_mesh() {
    assert_all_methods_show_the_base_mesh(&mut CpuBackend::new(), 1000);
}

/// The waves over one triangle: what they would be beyond its edges is not there, however a ray comes by. Rays cross
/// them there first, or below the triangle's side, and go on.
#[test]
fn inverse_finds_nothing_beyond_the_edges() {
    let (waves_f64, mut numbers) = (Waves::new(), Numbers::new(21));
    // Few steps, so that many a one goes past an edge: 0.1 at the most.
    let mut scene = waves(24);
    let corners: Vec<Vertex> = scene.mesh.vertices.iter().copied().take(4).collect();
    scene.mesh = Mesh::from_triangles(&corners, &[[0, 1, 2]]);
    let points: Vec<_> = scene.mesh.vertices.iter().map(|v| v.position.as_dvec3().truncate()).collect();
    // How far inside a point is, by the nearest edge; from the base triangle that was made.
    let [a, b, c] = scene.mesh.triangles[0].vertices.map(|v| points[v as usize]);
    let turn = (b - a).perp_dot(c - a).signum();
    let inside = |p: DVec2| {
        let from = |a: DVec2, b: DVec2| turn * (b - a).perp_dot(p - a) / (b - a).length();
        from(a, b).min(from(b, c)).min(from(c, a))
    };
    let middle = (a + b + c) / 3.0;
    let settings = Settings { method: Method::Inverse, width: 1, height: 1, ..Settings::default() };
    let job = scenes::job(scene, &settings);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    let (mut first_beyond, mut missed) = (0, 0);
    for _ in 0..1500 {
        let target = middle.as_vec2().extend(0.0)
            + Vec3::new(numbers.between(-0.6, 0.6), numbers.between(-0.6, 0.6), numbers.between(0.0, 0.15));
        let angle = numbers.between(0.0, std::f32::consts::TAU);
        let direction = Vec3::new(angle.cos(), angle.sin(), numbers.between(-0.4, 0.4)).normalize();
        let ray = Ray { origin: target - direction * 2.0, t_max: 4.0, direction, padding: 0 };
        let at = |t: f64| ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
        let above = |t: f64| at(t).z - waves_f64.height(at(t).x, at(t).y);
        // Crossings of the endless waves, either way: a step is 1/8 of a texel.
        let steps = 8_192;
        let mut crossings = Vec::new();
        for i in 0..steps {
            let (mut low, mut high) =
                (4.0 * f64::from(i) / f64::from(steps), 4.0 * f64::from(i + 1) / f64::from(steps));
            if (above(low) > 0.0) != (above(high) > 0.0) {
                let from_above = above(low) > 0.0;
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if (above(middle) > 0.0) == from_above { low = middle } else { high = middle }
                }
                crossings.push(low);
            }
        }
        let depth = |t: f64| inside(at(t).truncate());
        // What is within a thousandth of an edge may be found or not, and so may two crossings within a step.
        let is_clear = crossings.iter().all(|&t| depth(t).abs() > 1e-3)
            && crossings.windows(2).all(|pair| pair[1] - pair[0] > 0.1);
        let expected = crossings.iter().find(|&&t| depth(t) > 0.0);
        let found = backend.trace_rays(&[ray]).expect("the CPU does not fail")[0];
        if !is_clear {
            continue;
        }
        match expected {
            Some(&t) => {
                first_beyond += usize::from(depth(crossings[0]) < 0.0);
                // Cut to 1/256 of a step, a tenth of a texel, where the waves are nearly straight.
                assert!((f64::from(found.t) - t).abs() < 1e-4, "{ray:?}: {t} {found:?}");
            }
            None => {
                missed += usize::from(!crossings.is_empty());
                assert_eq!(found.primitive, MISS, "{ray:?}: {found:?}");
            }
        }
    }
    assert!(first_beyond > 20 && missed > 20, "{first_beyond} {missed}");
}

#[test]
fn distance_maps_are_computed_when_they_have_to_be() {
    changes::assert_distances_are_kept(&mut CpuBackend::new());
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

    let filtered = Settings { filter: Filter::Trilinear, ..settings.clone() };
    let instances = placed(scenes::builtin("builtin:cube"), vec![DAffine3::IDENTITY]);
    for (scene, settings, what) in [
        (scenes::builtin("builtin:cube"), &filtered, "with --filter trilinear heights follow the camera"),
        (instances, &settings, "instances have a place each"),
    ] {
        let error = emboss::render::prepare(scene, settings).expect_err(what).to_string();
        assert!(error.contains(what) && error.ends_with("use --method quadtree"), "{error}");
    }

    // What is stored is for one method.
    let exact = scenes::ready(scenes::builtin("builtin:cube"), Wrap::Repeat);
    let mut backend = CpuBackend::new();
    backend.load(&exact.buffers, &exact.frame, exact.features).expect("fits");
    let features = Features { method: method::TESSELLATE, ..exact.features };
    assert!(backend.set_features(features).expect_err("not built").to_string().contains("another scene"));
}
