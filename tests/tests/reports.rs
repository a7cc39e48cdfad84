//! What is said of pictures that show nothing of what was meant, on the CPU.

use emboss::backend::cpu::CpuBackend;
use emboss::reports::Reports;
use emboss::scene::builtin;
use emboss_tests::{reports, scenes};

#[test]
fn empty_pictures_are_found() {
    reports::assert_empty_pictures_are_found(&mut CpuBackend::new());
}

#[test]
fn cameras_inside_are_found() {
    reports::assert_cameras_in_relief_are_found(&mut CpuBackend::new());
    reports::assert_cameras_inside_are_found(&mut CpuBackend::new());
}

#[test]
fn darkness_is_found() {
    reports::assert_darkness_is_found(&mut CpuBackend::new());
}

#[test]
fn a_lit_speck_is_seen() {
    reports::assert_a_lit_speck_is_seen(&mut CpuBackend::new());
}

/// Built-in scenes have nothing twice, and show what they are for.
#[test]
fn nothing_is_said_of_built_in_scenes_but_of_their_n() {
    for name in builtin::NAMES {
        let (scene, settings) = scenes::builtin_scene(name, 4, 40, 30);
        let reports = Reports::of(&mut CpuBackend::new(), scene, &settings).expect("a built-in scene fits");
        assert_eq!((reports.repeated.triangles, reports.useless), (0, None), "{name}");
        assert_eq!(reports.undersampled.len(), 1, "{name}: 4 parts are too few for any of them");
    }
}
