//! Vector displacement on lavapipe: what `vectors.rs` and `leak.rs` ask of the CPU, by fewer rays, and the CPU's
//! pictures.

use emboss::backend::Backend;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{DisplacementKind, Normals, Settings, Shade, Weld};
use emboss_kernels::interface::{MISS, height_format};
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::exact::{Court, patchwork};
use emboss_tests::long::{on_device, rays};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{VECTORS, WildMap, builtin_scene, job, mushroom, with_vectors};
use emboss_tests::{LeakRays, Numbers, meshes};

#[test]
fn mushrooms_and_patchwork_are_exact() {
    on_device(|backend| {
        let mut court = Court::new(backend, Oracle::of_vulkan);
        for displacement in VECTORS {
            let settings = Settings { displacement, width: 1, height: 1, ..Settings::default() };
            for n in [3, 8] {
                let what = format!("mushrooms, {displacement:?}, N = {n}");
                court.judge_job(&what, &job(mushroom(n), &settings), u64::from(n), rays(10_000, 10_000_000));
            }
            let formats = [height_format::UNORM16, height_format::FLOAT32];
            for (weld, normals) in [(Weld::On, Normals::Normalized), (Weld::Off, Normals::Linear)] {
                let scene = with_vectors(patchwork(2, formats, 5), &mut Numbers::new(2));
                let settings = Settings { weld, normals, ..settings.clone() };
                let what = format!("patchwork, {displacement:?}, weld {weld:?}");
                court.judge_job(&what, &job(scene, &settings), 4, rays(10_000, 10_000_000));
            }
        }
    });
}

#[test]
fn pictures_are_alike() {
    on_device(|backend| {
        let (scene, settings) = builtin_scene("builtin:mushroom", 12, 96, 72);
        let scene = Scene { reliefs: mushroom(12).reliefs, ..scene };
        for (displacement, shade, smooth) in [
            (DisplacementKind::Tangent, Shade::Lit, false),
            (DisplacementKind::Tangent, Shade::Normal, true),
            (DisplacementKind::Tangent, Shade::Height, false),
            (DisplacementKind::Object, Shade::Lit, false),
            (DisplacementKind::Object, Shade::Normal, true),
        ] {
            let job = job(scene.clone(), &Settings { displacement, shade, smooth, ..settings.clone() });
            let picture = rendered(backend, &job, 2);
            against_cpu(&job, 2, &picture).assert_same(&format!("{displacement:?}, {shade:?}"));
            let hit = picture.pixels.iter().filter(|pixel| pixel.w > 0.0).count();
            assert!(hit * 10 > picture.pixels.len(), "only {hit} pixels show anything");
        }
    });
}

/// Rays from within a cube and a sphere, whose edges vectors move by up to half the way to them.
#[test]
fn closed_meshes_stay_closed() {
    on_device(|backend| {
        for (solid, n) in [(meshes::cube(), 7), (meshes::icosphere(1), 3)] {
            let placed = solid.placed(1.0, 1.0);
            for (displacement, weld) in
                [(VECTORS[0], Weld::On), (VECTORS[1], Weld::On), (VECTORS[0], Weld::Off)]
            {
                let mut numbers = Numbers::new(5);
                #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
                let scale = (0.5 * placed.room / 3.0_f64.sqrt()) as f32;
                let map = WildMap::Noise.map(&mut numbers);
                let relief = Relief::new(map, 0.0, scale);
                let (mesh, reliefs) = (placed.mesh.clone(), vec![relief]);
                let scene = Scene {
                    mesh,
                    reliefs,
                    materials: vec![Material::default()],
                    parts: vec![],
                    subdivisions: n,
                };
                let scene = with_vectors(scene, &mut numbers);
                let settings = Settings { displacement, weld, width: 1, height: 1, ..Settings::default() };
                let job = job(scene, &settings);
                backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
                let rays = LeakRays::new(&job, &placed.inside, 6).rays(0, rays(30_000, 10_000_000));
                let hits = backend.trace_rays(&rays).expect("no device fails");
                let leaks = hits.iter().filter(|hit| hit.primitive == MISS).count();
                if weld == Weld::On {
                    assert_eq!(leaks, 0, "{displacement:?}, N = {n}");
                } else {
                    assert!(leaks > 20, "there is nothing to test: {leaks} leaks");
                }
            }
        }
    });
}
