//! Methods in image space on lavapipe: each makes the CPU's picture. Small ones, since lavapipe compiles each method
//! for seconds.

use emboss::settings::{Method, Settings, Shade};
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::scenes::{IMAGE_SPACE, builtin_scene, job};
use emboss_tests::{finish, lavapipe};

#[test]
fn methods_in_image_space_are_alike() {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene("builtin:cube", 12, 64, 48);
    let lit = IMAGE_SPACE.map(|method| (method, Shade::Lit));
    for (method, shade) in lit.into_iter().chain([(Method::Relief, Shade::Error)]) {
        let job = job(scene.clone(), &Settings { method, shade, ..settings.clone() });
        let picture = rendered(&mut backend, &job, 1);
        against_cpu(&job, 1, &picture).assert_same(&method.to_string());
        let hit = picture.pixels.iter().filter(|pixel| pixel.w > 0.0).count();
        assert!(hit * 4 > picture.pixels.len(), "{method}: only {hit} pixels show anything");
    }
    finish(backend);
}
