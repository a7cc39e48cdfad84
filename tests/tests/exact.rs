//! The exact method on the CPU against the oracle: every one of many rays hits the micro-triangle that exact arithmetic
//! finds, or one that rounding cannot tell from it, within the stated errors.
//!
//! With `EMBOSS_LONG=1` in the environment each case has 10^8 rays.

use emboss::backend::cpu::CpuBackend;
use emboss_tests::exact::{Court, rays_a_case};
use emboss_tests::oracle::Oracle;

fn court(backend: &mut CpuBackend) -> Court<'_> {
    Court { backend, oracle: Oracle::new }
}

#[test]
fn cube_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:cube", rays_a_case(1_000_000));
}

#[test]
fn quilt_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:quilt", rays_a_case(1_000_000));
}

#[test]
fn knot_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:knot", rays_a_case(1_000_000));
}

#[test]
fn linear_normals_are_exact() {
    court(&mut CpuBackend::new()).judge_linear_normals(rays_a_case(100_000));
}

#[test]
fn patchwork_is_exact() {
    court(&mut CpuBackend::new()).judge_patchwork(rays_a_case(100_000));
}
