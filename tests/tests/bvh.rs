//! The HLBVH as the processor builds it, by the kernels: valid whatever the boxes, as good as the reference, and
//! refitted.

use emboss::bvh::{Bvh, Hlbvh};
use emboss_kernels::aabb::Aabb;
use emboss_tests::boxes::{cases, chain_among_many, scattered};
use glam::Vec3;

/// Relative error of a sum of costs in single precision: each of some 2^21 nodes' shares is off by a few roundings, and
/// so is each of the ten sums it goes through; errors of nodes do not add up beyond that of their sum.
const COST_ERROR: f64 = 32.0 * f32::EPSILON as f64;

#[test]
fn trees_are_valid_whatever_the_boxes() {
    for (what, boxes) in cases() {
        let built = Hlbvh::build(&boxes);
        let stats = built.tree().validate(&boxes).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(stats.leaves, built.sound() as usize, "{what}");
        assert!(stats.largest_leaf <= 1, "{what}");
        if stats.sah_cost.is_finite() && stats.leaves > 0 {
            let cost = built.cost();
            let off = (cost - stats.sah_cost).abs();
            // Where only some sides vanish next to the root's, single precision may lose what they add.
            assert!(off <= COST_ERROR * stats.sah_cost || cost == 0.0, "{what}: {cost}, {}", stats.sah_cost);
        }
    }
}

/// What is left out is counted, and the rest is built as without it.
#[test]
fn broken_boxes_are_left_out() {
    let mut boxes = scattered(50_000, 1.0);
    for (i, value) in [(0, f32::NAN), (17, f32::INFINITY), (49_999, f32::NEG_INFINITY)] {
        boxes[i].max.y = value;
    }
    let built = Hlbvh::build(&boxes);
    assert_eq!(built.sound(), 49_997);
    let whole: Vec<Aabb> = boxes.iter().copied().filter(|bounds| bounds.max.is_finite()).collect();
    let (cost, without) = (built.cost(), Hlbvh::build(&whole).cost());
    assert_eq!(cost.to_bits(), without.to_bits());
}

/// The chain is one treelet of more than forty levels, which is built again by halves: the depth keeps its limit
/// (`trees_are_valid_whatever_the_boxes`), and the second run leaves its mark.
#[test]
fn a_treelet_that_comes_out_too_deep_is_built_again() {
    let boxes = chain_among_many();
    assert!(Hlbvh::build(&boxes).has_deep_treelets());
    assert!(!Hlbvh::build(&scattered(100_000, 1.0)).has_deep_treelets());
}

#[test]
fn a_refit_follows_the_boxes_and_keeps_the_nodes() {
    for count in [1, 2, 65, 1000, 50_000] {
        let before = scattered(count, 1.0);
        let after: Vec<Aabb> = before
            .iter()
            .zip(scattered(count, 0.3).iter().rev())
            .map(|(bounds, other)| Aabb { min: bounds.min - other.min, max: bounds.max + other.max })
            .collect();
        let mut built = Hlbvh::build(&before);
        let first = built.tree();
        // Twice: a refit leaves the tree ready for another.
        for boxes in [&after, &before, &after] {
            assert!(built.refit(boxes));
            assert_eq!(built.tree().validate(boxes).err(), None, "{count}");
        }
        let links = |tree: &Bvh| tree.nodes.iter().map(|node| (node.first, node.count)).collect::<Vec<_>>();
        assert_eq!(links(&built.tree()), links(&first));
        assert!(built.refit(&before) && built.tree() == first, "{count}");
    }
}

#[test]
fn a_refit_notices_boxes_that_break() {
    let mut boxes = scattered(300, 1.0);
    let mut built = Hlbvh::build(&boxes);
    boxes[7].min = Vec3::NAN;
    assert!(!built.refit(&boxes));
    boxes[7].min = boxes[7].max;
    assert!(built.refit(&boxes), "what broke is whole again");
}

#[test]
fn the_same_boxes_give_the_same_tree_on_any_number_of_threads() {
    let boxes = scattered(60_000, 1.0);
    let many = Hlbvh::build(&boxes).tree();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    assert!(pool.install(|| Hlbvh::build(&boxes)).tree() == many);
}
