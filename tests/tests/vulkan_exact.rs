//! The exact method on lavapipe, as `exact.rs` judges it on the CPU, by fewer rays: a tenth in the grid cases and a
//! fifth elsewhere, some 180 s of processor time. `EMBOSS_LONG=1` makes them 10^8.

use emboss_tests::exact::{Court, rays_a_case};
use emboss_tests::oracle::Oracle;
use emboss_tests::{finish, lavapipe};

/// Has the quadtree of lavapipe judged, and listens to the validation layers.
fn judge(cases: impl Fn(&mut Court<'_>)) {
    let mut backend = lavapipe();
    cases(&mut Court { backend: &mut backend, oracle: Oracle::of_vulkan });
    finish(backend);
}

#[test]
fn cube_is_exact() {
    judge(|court| court.judge_builtin("builtin:cube", rays_a_case(100_000)));
}

#[test]
fn quilt_is_exact() {
    judge(|court| court.judge_builtin("builtin:quilt", rays_a_case(100_000)));
}

#[test]
fn knot_is_exact() {
    judge(|court| court.judge_builtin("builtin:knot", rays_a_case(100_000)));
}

#[test]
fn linear_normals_are_exact() {
    judge(|court| court.judge_linear_normals(rays_a_case(20_000)));
}

#[test]
fn patchwork_is_exact() {
    judge(|court| court.judge_patchwork(rays_a_case(20_000)));
}
