//! The HLBVH on the processor beside the binned reference and the PLOC builder of the obvhs crate: `cargo bench
//! --package emboss-tests`. Builders take turns, so that what else the machine does slows all of them; times are
//! medians as multiples of the HLBVH's, by the clock on the wall, from boxes to a tree in memory.
#![expect(clippy::print_stdout, reason = "prints a table")]

use emboss::bench::scene;
use emboss::bvh::{Bvh, Hlbvh};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::BvhNode;
use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Builds of each size by each builder: a median of seven outlives three interruptions.
const ROUNDS: usize = 7;

/// PLOC alone, whose neighbours are those beside it, and as obvhs sets it by default for a fast and for a middling
/// build, with reinsertion; leaves hold one primitive, as ours do.
const PLOC: [(&str, BvhBuildParams); 3] = [
    ("PLOC, fastest", BvhBuildParams::fastest_build()),
    ("PLOC, fast", BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::fast_build() }),
    ("PLOC, medium", BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() }),
];

fn main() {
    for count in [10_000, 100_000, 1_000_000] {
        compare(&scene::boxes(count));
    }
}

/// A builder under its name: builds a tree, and returns how long that took.
type Builder<'a> = (&'a str, Box<dyn Fn() -> (Duration, Bvh) + 'a>);

fn compare(boxes: &[Aabb]) {
    let theirs: Vec<obvhs::aabb::Aabb> = boxes.iter().map(their_box).collect();
    let mut builders: Vec<Builder<'_>> = vec![
        ("HLBVH", Box::new(|| timed(|| Hlbvh::build(boxes), |bvh| bvh.tree()))),
        ("binned SAH", Box::new(|| timed(|| Bvh::binned(boxes), |bvh| bvh))),
    ];
    for (name, settings) in &PLOC {
        let build = || build_bvh2(&theirs, *settings, &mut Duration::default());
        builders.push((name, Box::new(move || timed(build, |bvh| our_tree(&bvh)))));
    }
    let mut times = vec![Vec::new(); builders.len()];
    let mut costs = vec![0.0; builders.len()];
    // The first round warms up, and looks at the trees.
    for ((name, build), cost) in builders.iter().zip(&mut costs) {
        let stats = build().1.validate(boxes);
        *cost = stats.unwrap_or_else(|error| panic!("{name} builds no valid tree: {error}")).sah_cost;
    }
    for _ in 0..ROUNDS {
        for ((_, build), times) in builders.iter().zip(&mut times) {
            times.push(build().0);
        }
    }
    let medians: Vec<f64> = times
        .iter_mut()
        .map(|times| {
            times.sort();
            times[ROUNDS / 2].as_secs_f64()
        })
        .collect();
    println!("{} prisms: {:.1} million a second", boxes.len(), boxes.len() as f64 / medians[0] * 1e-6);
    for (((name, _), median), cost) in builders.iter().zip(&medians).zip(&costs) {
        println!("  {name:<14} {:>6.2} times as long, SAH cost {cost:>6.2}", median / medians[0]);
    }
}

/// How long `build` takes, and what `tree` makes of its result, untimed.
fn timed<T>(build: impl FnOnce() -> T, tree: impl FnOnce(T) -> Bvh) -> (Duration, Bvh) {
    let start = Instant::now();
    let built = black_box(build());
    (start.elapsed(), tree(built))
}

fn their_box(bounds: &Aabb) -> obvhs::aabb::Aabb {
    obvhs::aabb::Aabb::new(bounds.min.to_array().into(), bounds.max.to_array().into())
}

/// Their tree in our layout. Both have siblings side by side, and a leaf's primitives in a row.
fn our_tree(bvh: &Bvh2) -> Bvh {
    let node = |node: &obvhs::bvh2::node::Bvh2Node| BvhNode {
        min: Vec3::from_array(node.aabb().min.to_array()),
        max: Vec3::from_array(node.aabb().max.to_array()),
        first: node.first_index,
        count: node.prim_count,
    };
    Bvh { nodes: bvh.nodes.iter().map(node).collect(), primitives: bvh.primitive_indices.clone() }
}
