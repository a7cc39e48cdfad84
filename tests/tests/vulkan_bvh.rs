//! The BVH that a device builds: node for node the one that the processor builds from the same kernels.

use emboss::bvh::Hlbvh;
use emboss_tests::boxes::{cases, scattered};
use emboss_tests::long::{Cases, is_long, on_device};
use emboss_tests::{finish, lavapipe};

#[test]
fn trees_are_those_of_the_processor_node_for_node() {
    let mut backend = lavapipe();
    for (what, boxes) in cases() {
        let mut bvh = backend.bvh_over(&boxes).expect("room");
        // Twice: a build leaves nothing behind that another stumbles over.
        for _ in 0..2 {
            bvh.build().expect("built");
        }
        let tree = bvh.read().expect("read");
        assert_eq!(tree.validate(&boxes).err(), None, "{what}");
        let host = Hlbvh::build(&boxes);
        assert!(tree == host.tree(), "{what}: the device built another tree");
        let (cost, host_cost) = (bvh.cost().expect("summed"), host.cost());
        // Each in single precision, of which a device may divide with 2.5 ulp.
        assert!((cost - host_cost).abs() <= 1e-5 * host_cost, "{what}: {cost}, {host_cost}");
    }
    finish(backend);
}

/// Of 10^6 boxes, which take several rows of workgroups; in the long mode also of as many as have keys of two words,
/// and of millions, on the device that it names.
#[test]
fn large_trees_are_those_of_the_processor_before_and_after_a_refit() {
    let counts: &[u32] =
        if is_long() { &[1_000_000, (1 << 20) + 1, 4_000_000, 10_000_000] } else { &[1_000_000] };
    on_device(|backend| {
        let mut cases = Cases::new();
        for &count in counts {
            cases.run(format_args!("{count} boxes"), || {
                let (before, after) = (scattered(count, 1.0), scattered(count, 3.0));
                let mut bvh = backend.bvh_over(&before).expect("room");
                bvh.build().expect("built");
                let mut host = Hlbvh::build(&before);
                assert!(bvh.read().expect("read") == host.tree(), "{count}");
                bvh.refit(&after).expect("refitted");
                assert!(host.refit(&after));
                assert!(bvh.read().expect("read") == host.tree(), "{count}, refitted");
                "the same tree"
            });
        }
        cases.finish();
    });
}

#[test]
fn refits_are_those_of_the_processor() {
    let mut backend = lavapipe();
    for count in [1, 2, 65, 1000, 40_000] {
        let (before, after) = (scattered(count, 1.0), scattered(count, 3.0));
        let mut bvh = backend.bvh_over(&before).expect("room");
        bvh.build().expect("built");
        let mut host = Hlbvh::build(&before);
        for boxes in [&after, &before] {
            bvh.refit(boxes).expect("refitted");
            assert!(host.refit(boxes));
            assert!(bvh.read().expect("read") == host.tree(), "{count}");
        }
    }
    finish(backend);
}
