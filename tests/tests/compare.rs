//! What `emboss compare` measures against is right: the reference's hits are judged by the oracle, which stores the same
//! micro-triangles in f64 and shares no code with it.

use emboss::backend::cpu::CpuBackend;
use emboss::compare::cameras::centre_rays;
use emboss::compare::reference::{Reason, Request, Residual, configuration, find, grazing_camera, stage};
use emboss::compare::subject::Subject;
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
    let lift = fine.lift();
    // Twice as many parts again change no more.
    let twice = configuration(2 * found.n);
    let mut finer = Subject::load(&mut backend, &scene, &settings, twice, Some(&stage)).expect("loads");
    let pixel_side = 2.0 * stage.camera.up.length() / SIZE.1 as f32;
    let rest = Residual::between(&own, &finer.hits(stage.camera).expect("traced"), pixel_side);
    assert!(rest.is_converged(), "{rest:?} is left at N = {}", found.n);

    let grazing = grazing_camera(&mut backend, &scene, &settings, &stage, lift);
    let grazing = grazing.expect("traced").expect("the scene is seen");
    scene.subdivisions = found.n;
    let job = scenes::job(scene.clone(), &settings);
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let mut fine = Subject::load(&mut backend, &scene, &settings, exact, Some(&stage)).expect("loads");
    for camera in [stage.camera, grazing] {
        let hits = fine.hits(camera).expect("traced").hits;
        let tally = judge(&job, &oracle, &centre_rays(&camera, SIZE.0, SIZE.1), &hits);
        assert!(5 * tally.hits > tally.rays, "too few hits to tell: {tally:?}");
    }
}
