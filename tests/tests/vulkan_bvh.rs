//! The BVH that a device builds against the one that the processor builds from the same kernels.

use emboss::backend::vulkan::{Selection, VulkanBackend};
use emboss::bvh::{Bvh, Hlbvh, HostAabb};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::sampler::{pcg4d, unit_float};
use emboss_tests::lavapipe;
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
    let mut backend = lavapipe::backend();
    for count in [0, 1, 2, 3, 255, 256, 257, 10_000, 100_000] {
        let boxes = scattered(count, 1.0);
        let mut bvh = backend.bvh_over(&boxes).expect("room");
        let times = bvh.build().expect("built");
        let tree = bvh.read().expect("read");
        println!("{count}: {times:?}");
        assert_eq!(tree.validate(&boxes).err(), None);
        assert!(tree == Hlbvh::build(&boxes).tree(), "{count}");
    }
    let _ = (Bvh::default(), Selection::Auto, boxes_half());
    fn boxes_half() -> f64 {
        Aabb { min: Vec3::ZERO, max: Vec3::ONE }.half_area()
    }
    assert_eq!(backend.validation_messages(), Vec::<String>::new());
    let _: Option<VulkanBackend> = None;
}
