//! The BVH that a device builds against the one that the processor builds from the same kernels.

use emboss::bvh::Hlbvh;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::sampler::{pcg4d, unit_float};
use emboss_tests::{finish, lavapipe};
use glam::{UVec4, Vec3};

/// Boxes of a fiftieth of `size`, scattered over it.
fn scattered(count: u32, size: f32) -> Vec<Aabb> {
    (0..count)
        .map(|i| {
            let bits = pcg4d(UVec4::new(i, 1, 2, 3));
            let min = Vec3::new(unit_float(bits.x), unit_float(bits.y), unit_float(bits.z));
            Aabb { min: min * size, max: (min + 0.02 * unit_float(bits.w)) * size }
        })
        .collect()
}

#[test]
fn quick() {
    let mut backend = lavapipe();
    for count in [0, 1, 2, 3, 255, 256, 257, 10_000, 100_000] {
        let boxes = scattered(count, 1.0);
        let mut bvh = backend.bvh_over(&boxes).expect("room");
        let times = bvh.build().expect("built");
        let tree = bvh.read().expect("read");
        println!("{count}: {times:?}");
        assert_eq!(tree.validate(&boxes).err(), None);
        assert!(tree == Hlbvh::build(&boxes).tree(), "{count}");
    }
    finish(backend);
}

#[test]
#[ignore]
fn speed() {
    use emboss::backend::vulkan::{Selection, VulkanBackend};
    let mut backend = VulkanBackend::new(&Selection::Auto, false).expect("device");
    let start = std::time::Instant::now();
    drop(backend.bvh_over(&scattered(1, 1.0)).unwrap());
    println!("pipelines {:?}", start.elapsed());
    for count in [1000, 10_000, 100_000, 1_000_000, 1_048_577, 4_000_000, 10_000_000] {
        let boxes = scattered(count, 1.0);
        let mut bvh = backend.bvh_over(&boxes).expect("room");
        let mut best = bvh.build().expect("built");
        for _ in 0..10 {
            let times = bvh.build().expect("built");
            if times.total() < best.total() {
                best = times;
            }
        }
        let rate = f64::from(count) / best.total() / 1e3;
        println!(
            "{count}: {:.3} ms {rate:.0} M/s {best:?} cost {:.2} refit {:?}",
            best.total(),
            bvh.cost().unwrap(),
            bvh.refit(&boxes)
        );
        if count <= 100_000 {
            let tree = bvh.read().expect("read");
            assert_eq!(tree.validate(&boxes).err(), None);
            assert!(tree == Hlbvh::build(&boxes).tree(), "{count}");
        }
    }
}
