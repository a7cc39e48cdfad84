//! Changes to a scene that is loaded on the CPU.

use emboss::backend::cpu::CpuBackend;
use emboss_tests::changes;

#[test]
fn views_change_without_a_build() {
    changes::assert_views_change(&mut CpuBackend::new());
}

#[test]
fn heights_change_with_their_boxes() {
    changes::assert_heights_change(&mut CpuBackend::new());
}

#[test]
fn code_changes_without_a_build() {
    changes::assert_code_changes(&mut CpuBackend::new());
}

#[test]
fn costly_trees_are_built_anew() {
    changes::assert_costly_trees_are_built_anew(&mut CpuBackend::new());
}

#[test]
fn what_is_not_finite_is_left_out() {
    changes::assert_what_is_not_finite_is_left_out(&mut CpuBackend::new());
}
