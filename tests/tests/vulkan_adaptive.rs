//! Adaptive N on lavapipe: the CPU's pictures, no cracks, and every hit what the oracle finds. In the
//! [long mode](emboss_tests::long) the latter two on a hardware device, by 10^6 rays a case.

use emboss::backend::Backend;
use emboss::settings::{DisplacementKind, Settings};
use emboss_kernels::interface::{MISS, height_format};
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::exact::{Court, patchwork};
use emboss_tests::long::{is_long, on_device, rays};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{self, builtin_scene};
use emboss_tests::views::{greatest_step, near_a_vertex, rough, seen};
use emboss_tests::{LeakRays, Numbers, finish, lavapipe, meshes};
use glam::Vec3;

#[test]
fn pictures_are_alike() {
    let mut backend = lavapipe();
    for (name, eye, smooth) in
        [("builtin:knot", Vec3::new(0.9, 0.8, 2.2), false), ("builtin:cube", Vec3::new(1.2, 0.9, 1.6), true)]
    {
        let (scene, mut settings) = builtin_scene(name, 64, 96, 72);
        settings.view.eye = Some(eye.as_dvec3());
        let settings = Settings { adaptive: Some(4.0), smooth, ..settings.clone() };
        let job = scenes::job(scene.clone(), &settings);
        assert!(greatest_step(&job) > 1, "{name} is cut alike");
        let picture = rendered(&mut backend, &job, 1);
        against_cpu(&job, 1, &picture).assert_same(&format!("{name}, smooth: {smooth}"));
    }
    finish(backend);
}

#[test]
fn solids_seen_from_nearby_are_closed() {
    on_device(|backend| assert_solids_are_closed(backend, rays(3_000, 1_000_000)));
}

/// By so many rays each.
fn assert_solids_are_closed(backend: &mut dyn Backend, count: usize) {
    let (mut numbers, mut greatest, mut again) = (Numbers::new(2), 0, 0);
    let solids = [(meshes::cube(), false), (meshes::icosphere(1), true)];
    for (turn, (solid, second_map)) in solids.into_iter().cycle().take(3).enumerate() {
        let placed = solid.placed(1.0, [0.0, 1e2][turn % 2]);
        let displacement =
            [DisplacementKind::Height, DisplacementKind::Tangent, DisplacementKind::Object][turn];
        let settings = Settings { displacement, ..Settings::default() };
        let scene = rough(&placed, displacement, second_map, &mut numbers);
        let eye = near_a_vertex(&placed, 0.1, &mut numbers);
        let most = if displacement == DisplacementKind::Height { 256 } else { 32 };
        let job = seen(scene, eye, 0.2, most, &settings);
        greatest = greatest.max(greatest_step(&job));
        backend.load(&job.buffers, &job.frame, job.features).unwrap();
        let traced = LeakRays::new(&job, &placed.inside, numbers.bits()).rays(0, count);
        let hits = backend.trace_rays(&traced).unwrap();
        for (ray, _) in traced.iter().zip(&hits).filter(|(_, hit)| hit.primitive == MISS) {
            // Lavapipe leaves all loops of eight rays after 65535 turns together, which rays through vectors come to.
            // Alone a ray has them for itself.
            let alone = backend.trace_rays(&[*ray]).unwrap()[0];
            assert!(alone.primitive != MISS, "turn {turn}: {ray:?} leaks, {:?}", job.frame);
            again += 1;
        }
    }
    let most = if is_long() { 0 } else { 100 };
    assert!(again <= most, "{again} rays were too dear to be a test");
    assert!(greatest >= 16, "neighbours are alike: {greatest}");
}

#[test]
fn patchwork_seen_from_nearby_is_exact() {
    on_device(|backend| judge_patchworks(backend, rays(4_000, 1_000_000)));
}

/// By so many rays each.
fn judge_patchworks(backend: &mut dyn Backend, count: usize) {
    let mut court = Court::new(backend, Oracle::of_vulkan);
    for turn in 0..2 {
        let scene = patchwork(turn, [height_format::UNORM16; 2], 1);
        let eye = Numbers::new(turn).direction() * 2.2;
        court.judge_job(
            &format!("patchwork {turn}"),
            &seen(scene, eye, 0.4, 32, &Settings::default()),
            turn,
            count,
        );
    }
}
