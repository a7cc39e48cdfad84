//! How a stored tree is built: each function is one invocation's work, in the order in which they are dispatched. All
//! of it follows the heights of triangles and seams; [`collapse`] follows the BVH.

use crate::aabb::Aabb;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::displacement::tessellate::{self, grid_point_at, vertices_of};
use crate::interface::{BvhNode, displacement_kind};
use crate::math::{at, put};
use crate::prism_tree::block::{Block, MicroVertices, POINTS};
use crate::prism_tree::corners::Corners;
use crate::prism_tree::frame::AffineFrame;
use crate::prism_tree::layout::{BLOCK_SIDE, Layout, first_child, heap_nodes, levels};
use crate::prism_tree::node::{Node, TRIANGLE};
use crate::scene::{Features, SceneView};
use glam::{UVec4, Vec3};

/// Stores micro-vertex number `i` of all: of heights its lift, and where the triangle has seams and the micro-vertex
/// lies on its border its position too; of vectors its position. What it stores is what `floats` has from then on.
#[inline]
pub fn store_micro_vertex(scene: &SceneView<'_>, features: Features, i: u32) -> StoredMicroVertex {
    let n = scene.frame.subdivisions;
    let layout = Layout::new(scene.frame.triangle_count, n);
    let field = HeightField::new(scene, features);
    let base = BaseTriangle::load(scene, i / vertices_of(n));
    let (j, k) = grid_point_at(n, i % vertices_of(n));
    let on_border = j == 0 || k == 0 || j + k == n;
    let is_vector = features.displacement != displacement_kind::HEIGHT;
    let on_seam = base.has_seams(&field) && on_border;
    let position = if is_vector || on_seam { base.micro_vertex(&field, j, k) } else { Vec3::ZERO };
    StoredMicroVertex {
        lift: if is_vector || on_seam { 0.0 } else { base.own_lift(&field, j, k) },
        position,
        lift_place: i,
        position_place: if is_vector {
            3 * i
        } else if on_seam {
            layout.border(base.seams, j, k)
        } else {
            0
        },
        has_lift: !is_vector,
        has_position: is_vector || on_seam,
    }
}

/// What [`store_micro_vertex`] found, and where it goes.
#[derive(Clone, Copy, Debug)]
pub struct StoredMicroVertex {
    lift: f32,
    position: Vec3,
    lift_place: u32,
    position_place: u32,
    has_lift: bool,
    has_position: bool,
}

impl StoredMicroVertex {
    /// Writes it.
    #[inline]
    pub fn store(&self, floats: &mut [f32]) {
        if self.has_lift {
            put(floats, self.lift_place, self.lift);
        }
        if self.has_position {
            put(floats, self.position_place, self.position.x);
            put(floats, self.position_place + 1, self.position.y);
            put(floats, self.position_place + 2, self.position.z);
        }
    }
}

/// The frame of a triangle, and the triangle, whose [corners](Corners) belong into its record too.
#[inline]
pub fn frame(scene: &SceneView<'_>, features: Features, triangle: u32) -> (AffineFrame, BaseTriangle) {
    let base = BaseTriangle::load(scene, triangle);
    (AffineFrame::new(&base, base.reach(&HeightField::new(scene, features))), base)
}

/// Writes a triangle's record.
#[inline]
pub fn store_record((frame, base): (AffineFrame, BaseTriangle), quarters: &mut [UVec4], first: u32) {
    frame.store(quarters, first);
    Corners::store(&base, quarters, first);
}

/// How many nodes the lowest level of a heap has: those over four blocks.
#[inline]
pub fn lowest_nodes(n: u32) -> u32 {
    let levels = levels(n);
    if levels == 0 { 0 } else { 1 << (2 * (levels - 1)) }
}

/// Node number `i` of the lowest ones of all heaps. Frames and micro-vertices must be stored.
#[inline]
pub fn lowest_node(scene: &SceneView<'_>, features: Features, i: u32) -> Node {
    let n = scene.frame.subdivisions;
    let layout = Layout::new(scene.frame.triangle_count, n);
    let (triangle, place) = (i / lowest_nodes(n), i % lowest_nodes(n));
    let frame = AffineFrame::load(scene.prism_tree, layout.record(triangle));
    let micro_vertices = MicroVertices::new(scene, features);
    let node = heap_nodes(levels(n) - 1) + place;
    let mut boxes = [Aabb::EMPTY; 4];
    let mut child = 0;
    while child < 4 {
        let block = Block::of_heap(n, first_child(node) + child);
        let points = micro_vertices.of_block(triangle, block);
        let mut bounds = Aabb::EMPTY;
        let (mut i, mut a, mut b) = (0, 0, 0);
        while i < POINTS {
            let (j, k) = block.point(a, b);
            if j + k <= n {
                bounds = bounds.including(frame.point(points[i as usize]));
            }
            b += 1;
            if a + b > BLOCK_SIDE {
                a += 1;
                b = 0;
            }
            i += 1;
        }
        // A block of which a single point lies in the grid has no cell there; its box does no harm.
        boxes[child as usize] = bounds;
        child += 1;
    }
    Node::new(boxes)
}

/// The node over four nodes of a heap.
#[inline]
pub fn inner_node(quarters: &[UVec4], layout: &Layout, triangle: u32, node: u32) -> Node {
    let mut boxes = [Aabb::EMPTY; 4];
    let mut child = 0;
    while child < 4 {
        let first = layout.heap_node(triangle, first_child(node) + child);
        boxes[child as usize] = Node::load(quarters, first).bounds();
        child += 1;
    }
    Node::new(boxes)
}

/// The node over pair `pair` of siblings of the binary BVH, and the links of its children: in the place of a sibling
/// that is no leaf stand its children.
#[inline]
pub fn collapse(nodes: &[BvhNode], primitives: &[u32], pair: u32) -> (Node, UVec4) {
    let mut boxes = [Aabb::EMPTY; 4];
    let mut links = [0; 4];
    let mut sibling = 0;
    while sibling < 2 {
        let first = 2 * sibling as usize;
        let node = at(nodes, 1 + 2 * pair + sibling);
        if node.count > 0 {
            boxes[first] = Aabb { min: node.min, max: node.max };
            links[first] = link(primitives, node);
        } else {
            let mut child = 0;
            while child < 2 {
                let node = at(nodes, node.first + child);
                boxes[first + child as usize] = Aabb { min: node.min, max: node.max };
                links[first + child as usize] = link(primitives, node);
                child += 1;
            }
        }
        sibling += 1;
    }
    (Node::new(boxes), UVec4::new(links[0], links[1], links[2], links[3]))
}

/// The link to a node of the binary BVH: a leaf has one triangle.
#[inline]
pub fn link(primitives: &[u32], node: BvhNode) -> u32 {
    if node.count > 0 { TRIANGLE | at(primitives, node.first) } else { (node.first - 1) / 2 }
}

/// How many pairs of siblings a BVH over `triangles` triangles has at the most.
#[inline]
pub fn pairs(triangles: u32) -> u32 {
    if triangles == 0 { 0 } else { triangles - 1 }
}

/// How many micro-vertices [`store_micro_vertex`] stores.
#[inline]
pub fn micro_vertices(scene: &SceneView<'_>) -> u32 {
    scene.frame.triangle_count * tessellate::vertices_of(scene.frame.subdivisions)
}
