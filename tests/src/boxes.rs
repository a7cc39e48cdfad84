//! Boxes that try the builders of bounding volume hierarchies.

use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::hlbvh::MAX_TREELETS;
use emboss_kernels::bvh::node::LARGEST;
use emboss_kernels::sampler::{pcg4d, unit_float};
use glam::{UVec4, Vec3};

/// Boxes up to a fiftieth of `size` wide, scattered over a cube.
pub fn scattered(count: u32, size: f32) -> Vec<Aabb> {
    (0..count)
        .map(|i| {
            let bits = pcg4d(UVec4::new(i, 1, 2, 3));
            let min = Vec3::new(unit_float(bits.x), unit_float(bits.y), unit_float(bits.z));
            Aabb { min: min * size, max: (min + 0.02 * unit_float(bits.w)) * size }
        })
        .collect()
}

/// The box of one point.
pub fn point(position: Vec3) -> Aabb {
    Aabb { min: position, max: position }
}

/// Points of which each halves the distance to the origin along one axis, at the corner of a cube full of others: their
/// codes part one after the other, bit by bit, so that their treelet would be a chain of as many levels. As many others
/// that codes are two words long.
pub fn chain_among_many() -> Vec<Aabb> {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    let chain = (8..=21).flat_map(|bit| axes.map(|axis| point(axis * 2.0_f32.powi(-bit))));
    // The corners of the cube, so that cells of codes are powers of two of its side.
    let corners = [point(Vec3::ZERO), point(Vec3::splat(1.0 - f32::EPSILON))];
    let away = |bounds: &Aabb| bounds.min.max_element() > 0.1;
    let others = scattered(1_200_000, 0.95).into_iter().filter(away);
    chain.chain(corners).chain(others).collect()
}

/// What builders are tried on: a name, and boxes.
pub fn cases() -> Vec<(String, Vec<Aabb>)> {
    // Around the sizes of workgroups and of small tasks, and across the limit from which on primitives are sorted.
    let counts = [0, 1, 2, 3, 63, 64, 65, 128, 129, 255, 256, 257, 10_000, MAX_TREELETS, MAX_TREELETS + 1];
    let mut cases: Vec<_> =
        counts.into_iter().map(|count| (format!("{count} boxes"), scattered(count, 1.0))).collect();
    for count in [3, 300, 50_000] {
        let mut add = |what: &str, boxes: Vec<Aabb>| cases.push((format!("{count} {what}"), boxes));
        let line = |i: u32| Vec3::new(i as f32, 0.0, 0.0);
        add("equal boxes", vec![scattered(1, 1.0)[0]; count as usize]);
        add("points at one place", vec![point(Vec3::splat(3.0)); count as usize]);
        add("points in a line", (0..count).map(|i| point(line(i))).collect());
        add(
            "nested boxes",
            (1..=count).map(|i| Aabb { min: -line(i), max: Vec3::splat(i as f32) }).collect(),
        );
        add("boxes of extent 1e-30", scattered(count, 1e-30));
        add("boxes of extent 1e30", scattered(count, 1e30));
        add("boxes as large as may be", scattered(count, 1.0).into_iter().map(huge).collect());
        add("points each a bit further", (0..count).map(|i| point(progression(i))).collect());
        let mut broken = scattered(count, 1.0);
        broken[1].min.y = f32::NAN;
        broken[count as usize - 1].max.z = f32::INFINITY;
        add("boxes, two of them broken", broken);
        add("boxes, all broken", vec![Aabb { min: Vec3::NAN, max: Vec3::NAN }; count as usize]);
    }
    cases.push(("a long chain among many".to_owned(), chain_among_many()));
    cases
}

/// A box of the unit cube, scaled so that some are just within what is sound.
fn huge(bounds: Aabb) -> Aabb {
    let scaled = |p: Vec3| (p * 2.0 - Vec3::ONE).clamp(-Vec3::ONE, Vec3::ONE) * LARGEST;
    Aabb { min: scaled(bounds.min), max: scaled(bounds.max) }
}

/// A geometric progression, round and round: SAH takes one point off after the other.
fn progression(i: u32) -> Vec3 {
    Vec3::splat(2.0_f32.powi(i32::try_from(i % 240).unwrap_or(0) - 120))
}
