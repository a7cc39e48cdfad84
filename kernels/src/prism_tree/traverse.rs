//! The loop that takes a ray through a stored tree.

use crate::bvh::query::{Query, farthest};
use crate::counters::Counts;
use crate::hit::Hit;
use crate::interface::MAX_BVH_DEPTH;
use crate::math::{MinMax, at, max_abs, scratch};
use crate::prism_tree::block::{Block, MicroVertices};
use crate::prism_tree::build::link;
use crate::prism_tree::frame::{AffineFrame, Slabs};
use crate::prism_tree::layout::{Layout, first_child};
use crate::prism_tree::node::{Node, TRIANGLE};
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use glam::{UVec2, UVec4, Vec4};

/// Room of a ray's stack. A node leaves three children for later; a level of nodes above the triangles stands for two
/// of the binary BVH, but for leaves, which are the last; a heap has ten levels at N = 4096.
const STACK: usize = 3 * (MAX_BVH_DEPTH as usize / 2 + 1) + 3 * 10;

/// No link.
const NONE: u32 = u32::MAX;

/// A hit of the ray, or [`Hit::NONE`]: see [`bvh::traverse`](crate::bvh::traverse::traverse), which it stands for
/// where a tree is stored.
///
/// Depth first, nearest child first. A ray that comes to a triangle is taken into its frame until the triangle's part
/// of the stack is empty. Nodes are visited in a loop of their own, up to the next block, so that rays of a subgroup
/// intersect blocks together (Aila and Laine, "Understanding the Efficiency of Ray Traversal on GPUs", HPG 2009).
/// `docs/BOUNDS.md` has what else was tried.
#[inline]
pub fn traverse(
    scene: &SceneView<'_>,
    features: Features,
    ray: &TraversalRay,
    query: Query,
    counts: &mut Counts,
) -> Hit {
    let mut nearest = Hit::NONE;
    if scene.frame.triangle_count == 0 {
        return nearest;
    }
    let n = scene.frame.subdivisions;
    let layout = Layout::new(scene.frame.triangle_count, n);
    let micro_vertices = MicroVertices::new(scene, features);
    let root = at(scene.nodes, 0);
    let world = Slabs::in_world(ray, max_abs(root.min).max_num(max_abs(root.max)));
    let mut slabs = world;
    // Links, and the bits of the distances at which their boxes are entered.
    let mut stack: [UVec2; STACK] = scratch();
    let mut depth = 0;
    // Of a tree without sound boxes the root is none.
    let mut current = if root.min.x <= root.max.x { link(scene.primitives, root) } else { NONE };
    // The triangle that the ray is in, and where its part of the stack begins.
    let mut inside = false;
    let mut triangle = 0;
    let mut floor = 0;
    let mut going = true;
    while going {
        let mut at_block = false;
        let mut searching = true;
        while searching {
            let limit = farthest(ray, nearest);
            if current == NONE {
                if inside && depth == floor {
                    inside = false;
                    slabs = world;
                }
                going = depth > 0;
                if going {
                    depth -= 1;
                    let entry = stack[depth as usize];
                    if f32::from_bits(entry.y) <= limit {
                        current = entry.x;
                    }
                }
            }
            if !inside && current != NONE && current & TRIANGLE != 0 {
                triangle = current & !TRIANGLE;
                slabs = Slabs::in_frame(&AffineFrame::load(scene.prism_tree, layout.record(triangle)), ray);
                inside = true;
                floor = depth;
                current = 0;
                counts.prisms += 1;
            }
            if current != NONE && !(inside && current >= layout.nodes_of_heap) {
                let first =
                    if inside { layout.heap_node(triangle, current) } else { layout.upper_node(current) };
                let node = Node::load(scene.prism_tree, first);
                let keys = sorted(node.entry_distances(&slabs, limit));
                if inside {
                    counts.sub_triangles += 4;
                } else {
                    counts.boxes += 4;
                }
                let links = if inside {
                    let child = first_child(current);
                    UVec4::new(child, child + 1, child + 2, child + 3)
                } else {
                    at(scene.prism_tree, first + 3)
                };
                // The farthest first, so that the nearest is taken up next.
                if keys.w < MISSED {
                    stack[depth as usize] = UVec2::new(component(links, keys.w & 3), keys.w & !3);
                    depth += 1;
                }
                if keys.z < MISSED {
                    stack[depth as usize] = UVec2::new(component(links, keys.z & 3), keys.z & !3);
                    depth += 1;
                }
                if keys.y < MISSED {
                    stack[depth as usize] = UVec2::new(component(links, keys.y & 3), keys.y & !3);
                    depth += 1;
                }
                current = if keys.x < MISSED { component(links, keys.x & 3) } else { NONE };
            }
            at_block = inside && current != NONE && current >= layout.nodes_of_heap;
            searching = going && !at_block;
        }
        if at_block {
            let block = Block::of_heap(n, current);
            nearest = micro_vertices.intersect(triangle, ray, block, nearest, counts);
            current = NONE;
            going = !(query == Query::Any && nearest.is_some());
        }
    }
    nearest
}

/// The least key of a child that is missed: the bits of infinity, which is beyond those of all distances.
const MISSED: u32 = 0x7f80_0000;

/// Keys of four children by ascending distance. A key has the bits of a distance, which are in the order of the
/// distances where these are not negative, with the child's number in the lowest two: a distance that is less by some
/// units of the last place is a bound as well.
#[inline]
fn sorted(distances: Vec4) -> UVec4 {
    let key = |distance: f32, child: u32| distance.to_bits() & !3 | child;
    let (a, b, c, d) = (key(distances.x, 0), key(distances.y, 1), key(distances.z, 2), key(distances.w, 3));
    let (a, b) = (a.min(b), a.max(b));
    let (c, d) = (c.min(d), c.max(d));
    let (a, c) = (a.min(c), a.max(c));
    let (b, d) = (b.min(d), b.max(d));
    let (b, c) = (b.min(c), b.max(c));
    UVec4::new(a, b, c, d)
}

#[inline]
fn component(v: UVec4, i: u32) -> u32 {
    let low = if i & 1 == 0 { v.x } else { v.y };
    let high = if i & 1 == 0 { v.z } else { v.w };
    if i & 2 == 0 { low } else { high }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::brute_force;
    use crate::displacement::surface::HeightField;
    use crate::displacement::test_prism::{FEATURES, Prism, random_ray};
    use crate::interface::{bounds, displacement_kind, method, normals};
    use crate::math::tests::Numbers;
    use crate::prism_tree::build::{self, inner_node, lowest_node, lowest_nodes, store_micro_vertex};
    use crate::prism_tree::layout::{heap_nodes, levels};
    use glam::Vec3;

    /// The prism with its tree, below a binary BVH of one leaf.
    fn with_tree(mut prism: Prism, features: Features) -> Prism {
        let n = prism.scene.frame.subdivisions;
        prism.scene.frame.triangle_count = 1;
        let root = &mut prism.scene.nodes[0];
        (root.min, root.max, root.count) = (Vec3::splat(-9.0), Vec3::splat(9.0), 1);
        let layout = Layout::new(1, n);
        let mut quarters = vec![UVec4::ZERO; layout.quarters() as usize];
        let mut floats = vec![0.0; layout.floats(0, features) as usize];
        if features.bounds == bounds::ALL {
            for i in 0..build::micro_vertices(&prism.view()) {
                store_micro_vertex(&prism.view(), features, i).store(&mut floats);
            }
        }
        prism.scene.micro_vertices = floats;
        let record = build::frame(&prism.view(), features, 0);
        build::store_record(record, &mut quarters, layout.record(0));
        prism.scene.prism_tree = quarters.clone();
        for i in 0..lowest_nodes(n) {
            let node = heap_nodes(levels(n) - 1) + i;
            lowest_node(&prism.view(), features, i).store(&mut quarters, layout.heap_node(0, node));
        }
        for node in (0..heap_nodes(levels(n).saturating_sub(1))).rev() {
            let whole = inner_node(&quarters, &layout, 0, node);
            whole.store(&mut quarters, layout.heap_node(0, node));
        }
        prism.scene.prism_tree = quarters;
        prism
    }

    const KINDS: [u32; 3] =
        [displacement_kind::HEIGHT, displacement_kind::TANGENT, displacement_kind::OBJECT];

    /// The tree and brute force agree bit for bit, for the nearest hit and for any, on prisms of all kinds, with and
    /// without stored micro-vertices; 20 rays each, a fifth aimed at micro-vertices and micro-edges.
    #[test]
    fn equals_brute_force() {
        let mut numbers = Numbers::new(31);
        let (mut hits, mut total) = (0, Counts::default());
        for round in 0..6_000_usize {
            let kind = KINDS[if round % 4 == 0 { 1 + round / 4 % 2 } else { 0 }];
            let n = 1 + (numbers.unit() * numbers.unit() * 40.0) as u32;
            let spread = [0.0, 0.05, 0.3, 1.5][round / 4 % 4];
            let prism = Prism::random(&mut numbers, n, spread, 0.3);
            let prism = if kind == displacement_kind::HEIGHT {
                prism
            } else {
                prism.with_vectors(&mut numbers, kind, spread)
            };
            let features = Features {
                method: method::QUADTREE,
                normals: [normals::NORMALIZED, normals::LINEAR][round % 2],
                bounds: [bounds::BOXES, bounds::ALL][round / 2 % 2],
                displacement: kind,
                ..FEATURES
            };
            let prism = with_tree(prism, features);
            let view = prism.view();
            let field = HeightField::new(&view, features);
            for _ in 0..20 {
                let ray = random_ray(&prism, &field, &mut numbers, true);
                let found = traverse(&view, features, &ray, Query::Nearest, &mut total);
                let exact =
                    brute_force::intersect(&field, &prism.base(), &ray, Hit::NONE, &mut Counts::default());
                assert_eq!(found, exact, "N = {n}, {features:?}, {ray:?}, {:?}", prism.base());
                let any = traverse(&view, features, &ray, Query::Any, &mut Counts::default());
                assert_eq!(any.is_some(), exact.is_some(), "N = {n}, {ray:?}, {:?}", prism.base());
                hits += u32::from(exact.is_some());
            }
        }
        assert!(hits > 30_000, "the rays are no test: {hits} hits");
        // Four blocks of sixteen a ray in the mean would be no bound to speak of.
        assert!(total.triangles < 64 * total.prisms, "{total:?}");
    }
}
