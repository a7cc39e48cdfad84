//! The exact method on lavapipe, as `exact.rs` judges it on the CPU: by a quarter of the rays for N of 1 and 3, a tenth
//! for the greater N, whose rays take lavapipe up to 150 us of processor time each, and a fifth in what is no grid
//! case. With `EMBOSS_RAYS=1000000` all grid cases have 10^6. In the [long mode](emboss_tests::long) they are as many
//! as on the CPU, on a hardware device.

use emboss_tests::exact::Court;
use emboss_tests::long::{is_long, on_device, rays};
use emboss_tests::oracle::Oracle;

/// Has the quadtree of the device judged.
fn judge(cases: impl Fn(&mut Court<'_>)) {
    on_device(|backend| cases(&mut Court::new(backend, Oracle::of_vulkan)));
}

/// Rays of a grid case.
fn grid_rays(n: u32) -> usize {
    rays(if n < 8 { 250_000 } else { 100_000 }, 100_000_000)
}

#[test]
fn cube_is_exact() {
    judge(|court| court.judge_builtin("builtin:cube", grid_rays));
}

#[test]
fn quilt_is_exact() {
    judge(|court| court.judge_builtin("builtin:quilt", grid_rays));
}

#[test]
fn knot_is_exact() {
    judge(|court| court.judge_builtin("builtin:knot", grid_rays));
}

#[test]
fn linear_normals_are_exact() {
    judge(|court| court.judge_linear_normals(rays(20_000, 10_000_000)));
}

#[test]
fn filtered_maps_are_exact() {
    // Where a pixel is wider than many micro-triangles rays take more turns of loops than lavapipe has.
    judge(|court| court.judge_filtered(!is_long(), rays(2_000, 1_000_000)));
}

#[test]
fn patchwork_is_exact() {
    judge(|court| court.judge_patchwork(rays(20_000, 10_000_000)));
}
