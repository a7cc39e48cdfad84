//! What `emboss compare` measures against is right: the reference's hits are judged by the oracle, which stores the
//! same micro-triangles in f64 and shares no code with it.

use emboss::backend::cpu::CpuBackend;
use emboss::compare::cameras::centre_rays;
use emboss::compare::metrics::{Capture, errors};
use emboss::compare::reference::{Reason, Request, Residual, configuration, find, grazing_camera, stage};
use emboss::compare::subject::{Configuration, EDIT_FACTOR, Stage, Subject};
use emboss::compare::usual_methods;
use emboss::render::Scene;
use emboss::settings::{Method, Settings, Subdivisions};
use emboss_tests::exact::judge;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes;
use std::ops::ControlFlow;
use std::time::Duration;

const SIZE: (u32, u32) = (96, 72);

/// Every pixel of the user's camera and of the grazing one.
#[test]
fn references_are_exact_and_converged() {
    let (mut scene, settings) = scenes::builtin_scene("builtin:cube", 8, SIZE.0, SIZE.1);
    let mut backend = CpuBackend::new();
    let request = Request { given: None, least: 8, time: Duration::from_secs(600) };
    let stage = stage(&mut backend, &scene, &settings, request).expect("framed");
    let going_on = &mut || ControlFlow::Continue(());
    let found = find(&mut backend, &scene, &settings, &stage, request, going_on).expect("found");
    assert_eq!(found.reason, Reason::Converged);
    assert!(found.n > 8 && found.residual.is_some_and(Residual::is_converged), "{found:?}");

    let exact = configuration(found.n);
    let mut fine = Subject::load(&mut backend, &scene, &settings, exact, Some(&stage)).expect("loads");
    let own = fine.hits(stage.camera).expect("traced");
    // Twice as many parts again change no more.
    let twice = configuration(2 * found.n);
    let mut finer = Subject::load(&mut backend, &scene, &settings, twice, Some(&stage)).expect("loads");
    let pixel_side = 2.0 * stage.camera.up.length() / SIZE.1 as f32;
    let rest = Residual::between(&own, &finer.hits(stage.camera).expect("traced"), pixel_side);
    assert!(rest.is_converged(), "{rest:?} is left at N = {}", found.n);
    scene.subdivisions = found.n;
    assert_exact(&mut backend, &scene, &settings, &stage);
}

/// The reference with the N that the user names, on the other built-in scenes: of a curved mesh with seams, of a patch
/// with fine relief, of vectors.
#[test]
fn references_of_all_scenes_are_exact() {
    let mut backend = CpuBackend::new();
    for (name, n) in [("builtin:knot", 16), ("builtin:quilt", 64), ("builtin:mushroom", 32)] {
        let (scene, settings) = scenes::builtin_scene(name, n, SIZE.0, SIZE.1);
        let request = Request { given: Some(n), least: n, time: Duration::ZERO };
        let stage = stage(&mut backend, &scene, &settings, request).expect("framed");
        assert_exact(&mut backend, &scene, &settings, &stage);
    }
}

/// Asserts that every pixel of the stage's camera and of the grazing one hits what the oracle accepts, with the scene's
/// N.
fn assert_exact(backend: &mut CpuBackend, scene: &Scene, settings: &Settings, stage: &Stage) {
    let exact = configuration(scene.subdivisions);
    let fine = Subject::load(backend, scene, settings, exact, Some(stage)).expect("loads");
    let lift = fine.lift();
    let grazing = grazing_camera(backend, scene, settings, stage, lift);
    let grazing = grazing.expect("traced").expect("the scene is seen");
    let job = scenes::job(scene.clone(), settings);
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let mut fine = Subject::load(backend, scene, settings, exact, Some(stage)).expect("loads");
    for camera in [stage.camera, grazing] {
        let hits = fine.hits(camera).expect("traced").hits;
        let tally = judge(&job, &oracle, &centre_rays(&camera, SIZE.0, SIZE.1), &hits);
        // A low camera sees much sky over a patch: 18 % of its rays hit the quilt.
        assert!(10 * tally.hits > tally.rays, "too few hits to tell: {tally:?}");
    }
}

/// The first frame after an edit, whose time is measured, is the one of a scene that has had these heights from the
/// beginning: nothing that a method keeps is stale.
#[test]
fn edits_end_with_the_correct_frame() {
    let (scene, settings) = scenes::builtin_scene("builtin:cube", 4, 32, 24);
    let mut higher = scene.clone();
    higher.reliefs.iter_mut().for_each(|relief| relief.scale *= EDIT_FACTOR);
    let mut backend = CpuBackend::new();
    let request = Request { given: Some(4), least: 4, time: Duration::ZERO };
    let stage = stage(&mut backend, &scene, &settings, request).expect("framed");
    let going_on = &mut || ControlFlow::Continue(());
    for method in usual_methods() {
        let n = method.parameter().map(|_| Subdivisions::Fixed(4));
        let configuration = Configuration { method, n };
        let mut load = |scene| {
            let subject = Subject::load(&mut backend, scene, &settings, configuration, Some(&stage));
            let mut subject = subject.expect("loads");
            let before = subject.capture(stage.camera, 1, going_on).expect("rendered");
            if std::ptr::eq(scene, &higher) {
                return (before.clone(), before);
            }
            subject.edit_ms(going_on).expect("edited");
            (before, subject.capture(stage.camera, 1, going_on).expect("rendered"))
        };
        let (before, edited) = load(&scene);
        let (_, expected) = load(&higher);
        let flip = |a: &Capture, b: &Capture| errors(a, b, 1.0).0.flip;
        // What is made of heights for one scale is rounded, so that normals turn by some 1e-4: a code of 255 at most,
        // in few pixels.
        assert!(flip(&expected, &edited) < 1e-3, "{method}: {}", flip(&expected, &edited));
        assert!(method == Method::None || flip(&before, &edited) > 5e-3, "{method} shows no edit");
    }
}
