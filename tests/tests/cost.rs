//! What rays cost as N grows: counted work, which no machine's load changes.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::settings::{Method, Settings};
use emboss_kernels::interface::counter;
use emboss_tests::scenes;
use std::ops::ControlFlow;

/// What a counter says a primary ray of a small picture of the quilt took.
fn work(method: Method, subdivisions: u32, counter: u32) -> f64 {
    let (scene, settings) = scenes::builtin_scene("builtin:quilt", subdivisions, 160, 120);
    let job = scenes::job(scene, &Settings { method, counting: true, shadows: false, ..settings });
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a built-in scene fits");
    let flow = backend.add_sample(0, &mut |_| ControlFlow::Continue(())).expect("the CPU does not fail");
    assert!(flow.is_continue());
    let totals = backend.totals().expect("the CPU counts");
    totals[counter as usize] as f64 / totals[counter::PRIMARY_RAYS as usize] as f64
}

/// The quadtree by the table of costs in EXACTNESS.md, which this prints, and the walk, which is the control.
///
/// Each doubling of N adds a level to the quadtree, and a ray that crosses the surface at one place reaches as many of
/// a level's nodes whatever the level is: those around the ray in the column that the heights leave. Of each that it
/// reaches it tests the four children, so that 20 a doubling are five reached, in the mean over rays that hit the quilt
/// and rays that do not; 16.4 is the most that was measured, at the greatest N. The walk's cells double with N.
#[test]
#[expect(clippy::print_stdout, reason = "the table is what the test is run by hand for")]
fn cost_of_the_quadtree_grows_with_the_logarithm_of_n() {
    const MOST_A_DOUBLING: f64 = 20.0;
    let mut before = f64::INFINITY;
    for n in [4, 16, 64, 256, 1024, 4096] {
        let counters = [counter::SUB_TRIANGLES, counter::TRIANGLES];
        let [nodes, triangles] = counters.map(|counter| work(Method::Quadtree, n, counter));
        println!("N = {n:<4} {nodes:>6.1} sub-triangles {triangles:>6.1} micro-triangles");
        let doublings = 2.0;
        assert!((nodes + triangles - before) / doublings < MOST_A_DOUBLING, "N = {n}");
        before = nodes + triangles;
    }
    let cells = |n| work(Method::GridWalk, n, counter::CELLS);
    assert!((cells(4096) - cells(1024)) / 2.0 > 2.0 * MOST_A_DOUBLING);
}
