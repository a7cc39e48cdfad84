//! Vector displacement on the CPU against the oracle: every one of many rays hits the micro-triangle that exact
//! arithmetic finds, or one that rounding cannot tell from it, wherever the surface hangs over or folds.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::{RenderError, Scene, prepare};
use emboss::scene::{HeightMap, Relief};
use emboss::settings::{DisplacementKind, Method, Normals, Settings, Weld, Wrap};
use emboss_kernels::interface::{MISS, Ray, height_format};
use emboss_tests::Numbers;
use emboss_tests::exact::{Court, patchwork};
use emboss_tests::long::rays;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{self, ReadyJob, VECTORS, mushroom, with_vectors};
use glam::Vec3;

/// A scene that vectors displace.
fn ready(scene: Scene, displacement: DisplacementKind, normals: Normals) -> ReadyJob {
    let settings = Settings { displacement, normals, width: 1, height: 1, ..Settings::default() };
    scenes::job(scene, &settings)
}

/// Rays of a case.
fn count() -> usize {
    rays(10_000, 10_000_000)
}

/// Has the CPU's quadtree judged.
fn judge(scene: impl Fn() -> Scene, name: &str, subdivisions: &[u32]) {
    let mut backend = CpuBackend::new();
    let mut court = Court::new(&mut backend, Oracle::new);
    for &n in subdivisions {
        for (kind, normals) in [
            (DisplacementKind::Tangent, Normals::Normalized),
            (DisplacementKind::Tangent, Normals::Linear),
            (DisplacementKind::Object, Normals::Normalized),
        ] {
            let job = ready(Scene { subdivisions: n, ..scene() }, kind, normals);
            let what = format!("{name}, {kind:?}, {normals:?}, N = {n}");
            court.judge_job(&what, &job, u64::from(n), count());
        }
    }
}

#[test]
fn mushrooms_are_exact() {
    judge(|| mushroom(1), "mushrooms", &[1, 3, 8, 17]);
}

#[test]
fn cube_under_random_vectors_is_exact() {
    let scene = || with_vectors(scenes::builtin("builtin:cube"), &mut Numbers::new(7));
    judge(scene, "cube", &[1, 3, 8, 17]);
}

/// Not at N = 17: there noise of its map's 1024 texels a side moves micro-vertices by more than their triangles' size
/// within what rounding may do to texture coordinates, so that the oracle accepts almost anything.
#[test]
fn knot_under_random_vectors_is_exact() {
    let scene = || with_vectors(scenes::builtin("builtin:knot"), &mut Numbers::new(7));
    judge(scene, "knot", &[1, 3, 8]);
}

/// Neighbours that disagree on everything, all wraps and formats, welded and not.
#[test]
fn patchwork_under_random_vectors_is_exact() {
    let mut backend = CpuBackend::new();
    let mut court = Court::new(&mut backend, Oracle::new);
    let cases = [
        (Wrap::Repeat, [height_format::UNORM8; 2]),
        (Wrap::Clamp, [height_format::UNORM16, height_format::FLOAT32]),
        (Wrap::Mirror, [height_format::UNORM16; 2]),
    ];
    for ((wrap, formats), seed) in cases.into_iter().zip(1..) {
        for displacement in VECTORS {
            for weld in [Weld::On, Weld::Off] {
                let scene = with_vectors(patchwork(seed, formats, 6), &mut Numbers::new(seed));
                let settings =
                    Settings { wrap, displacement, weld, width: 1, height: 1, ..Settings::default() };
                let what = format!("patchwork, {wrap:?}, {displacement:?}, weld {weld:?}");
                court.judge_job(&what, &scenes::job(scene, &settings), seed, count());
            }
        }
    }
}

/// The most micro-triangles that a line from above goes through.
fn most_layers(job: &ReadyJob) -> usize {
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let mut most = 0;
    for i in 0..40_u8 {
        for j in 0..40_u8 {
            let origin = Vec3::new(f32::from(i) * 0.1 - 1.97, f32::from(j) * 0.1 - 1.93, 5.0);
            let ray = Ray { origin, t_max: f32::INFINITY, direction: -Vec3::Z, padding: 0 };
            most = most.max(oracle.trace(&ray).meetings.iter().filter(|met| met.margin > 0.0).count());
        }
    }
    most
}

/// A mushroom has a cap over gills over ground; without what moves it sideways it is a height field over the xy plane.
#[test]
fn mushrooms_hang_over() {
    let vectors = mushroom(32);
    let mut heights = vectors.clone();
    heights.reliefs[..2].iter_mut().for_each(|relief| relief.scale = 0.0);
    let layers = |scene| most_layers(&ready(scene, DisplacementKind::Object, Normals::Normalized));
    assert_eq!(layers(heights), 1);
    assert!(layers(vectors) >= 3);
}

/// A map of one texel moves the whole model, in object space by its vector: the quilt's square, 4 wide, by (1, -2, 3).
#[test]
fn one_texel_moves_the_model() {
    let relief = |texel: f32| Relief::new(HeightMap::flat(texel), 0.5, 2.0);
    let scene = Scene {
        reliefs: vec![relief(1.0), relief(-0.5), relief(2.0)],
        subdivisions: 5,
        ..scenes::builtin("builtin:quilt")
    };
    let job = ready(scene, DisplacementKind::Object, Normals::Normalized);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    let down = |x: f32, y: f32| {
        let origin = Vec3::new(x, y, 10.0);
        Ray { origin, t_max: f32::INFINITY, direction: -Vec3::Z, padding: 0 }
    };
    let rays = [down(-0.9, -3.9), down(2.9, -0.1), down(-1.1, -3.0), down(0.0, 0.1)];
    let hits = backend.trace_rays(&rays).expect("the CPU does not fail");
    assert_eq!(hits.iter().map(|hit| hit.primitive != MISS).collect::<Vec<_>>(), [true, true, false, false]);
    // A distance of 7 has some roundings of 5e-7.
    assert!(hits[..2].iter().all(|hit| (hit.t - 7.0).abs() < 5e-6), "{hits:?}");
}

#[test]
fn grid_walk_refuses_vectors() {
    let method = Method::GridWalk;
    let settings = |displacement| Settings { method, displacement, ..Settings::default() };
    assert!(prepare(scenes::builtin("builtin:quilt"), &settings(DisplacementKind::Height)).is_ok());
    for kind in VECTORS {
        let refused = prepare(mushroom(4), &settings(kind)).expect_err("it cannot");
        assert!(matches!(refused, RenderError::MethodOfVectors { .. }), "{refused}");
    }
}
