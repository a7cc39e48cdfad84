//! Where things are in the buffers of a stored tree. All places follow from the number of triangles and N.
//!
//! The buffer of nodes, in quarters of 16 bytes: for each pair of siblings of the binary BVH a node of four quarters
//! ([`upper_node`](Layout::upper_node)), for each triangle a record of eight, then for each triangle a heap of nodes of
//! three.
//!
//! The buffer of micro-vertices, in floats: for each triangle its lifts in the order of
//! [`tessellate::vertex_place`], or of vectors three coordinates each; then for each entry of the table of seams the
//! micro-vertices on that triangle's [border](border_place), three coordinates each.

use crate::displacement::tessellate;
use crate::interface::{bounds, displacement_kind};
use crate::scene::Features;

/// Cells a side of a leaf's block.
pub const BLOCK_SIDE: u32 = 4;
/// Quarters of a node above the triangles: three as in a heap, and its children's [links](super::node).
pub const UPPER_QUARTERS: u32 = 4;
/// Quarters of a triangle's record: its [frame](super::frame), then its [corners](super::corners).
pub const RECORD_QUARTERS: u32 = 8;
/// Quarters of the frame in it.
pub const FRAME_QUARTERS: u32 = 4;
/// Quarters of a node of a heap.
pub const HEAP_QUARTERS: u32 = 3;

/// How many levels of nodes lie above the blocks of a triangle whose sides have `n` parts: 0 where it is a block.
#[inline]
pub fn levels(n: u32) -> u32 {
    let side = n.next_power_of_two();
    if side <= BLOCK_SIDE { 0 } else { side.trailing_zeros() - BLOCK_SIDE.trailing_zeros() }
}

/// How many nodes a heap of so many levels has: (4^levels - 1) / 3. At the same time the number of its first block,
/// counted from its root on.
#[inline]
pub fn heap_nodes(levels: u32) -> u32 {
    ((1 << (2 * levels)) - 1) / 3
}

/// The children of node `i` of a heap are nodes, or below the last level blocks, from this number on.
#[inline]
pub fn first_child(i: u32) -> u32 {
    4 * i + 1
}

/// The layout of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Base triangles.
    triangles: u32,
    /// N.
    n: u32,
    /// [`heap_nodes`].
    pub nodes_of_heap: u32,
}

impl Layout {
    /// The layout of a scene of `triangles` triangles, whose sides have `n` parts.
    #[inline]
    pub fn new(triangles: u32, n: u32) -> Layout {
        Layout { triangles, n, nodes_of_heap: heap_nodes(levels(n)) }
    }

    /// First quarter of the node over pair `pair` of siblings of the binary BVH.
    #[inline]
    pub fn upper_node(&self, pair: u32) -> u32 {
        pair * UPPER_QUARTERS
    }

    /// First quarter of a triangle's record, which its frame begins.
    #[inline]
    pub fn record(&self, triangle: u32) -> u32 {
        self.triangles * UPPER_QUARTERS + triangle * RECORD_QUARTERS
    }

    /// First quarter of node `i` of a triangle's heap.
    #[inline]
    pub fn heap_node(&self, triangle: u32, i: u32) -> u32 {
        self.triangles * (UPPER_QUARTERS + RECORD_QUARTERS)
            + (triangle * self.nodes_of_heap + i) * HEAP_QUARTERS
    }

    /// How many quarters there are.
    pub fn quarters(&self) -> u64 {
        let of_triangle = UPPER_QUARTERS + RECORD_QUARTERS;
        u64::from(self.triangles)
            * (u64::from(of_triangle) + u64::from(self.nodes_of_heap) * u64::from(HEAP_QUARTERS))
    }

    /// Place of the lift of grid point (j, k), in lifts or in micro-vertices.
    #[inline]
    pub fn micro_vertex(&self, triangle: u32, j: u32, k: u32) -> u32 {
        triangle * tessellate::vertices_of(self.n) + tessellate::vertex_place(self.n, j, k)
    }

    /// First float of the micro-vertex over (j, k), a point of the border of the triangle with entry `seams` of the
    /// table of seams.
    #[inline]
    pub fn border(&self, seams: u32, j: u32, k: u32) -> u32 {
        self.triangles * tessellate::vertices_of(self.n)
            + 3 * (3 * self.n * seams + border_place(self.n, j, k))
    }

    /// How many floats there are, `seams` being the entries of the table of seams.
    pub fn floats(&self, seams: u32, features: Features) -> u64 {
        let vertices = u64::from(self.triangles) * u64::from(tessellate::vertices_of(self.n));
        if features.bounds != bounds::ALL {
            0
        } else if features.displacement == displacement_kind::HEIGHT {
            let seams = if features.seams != 0 { u64::from(seams) } else { 0 };
            vertices + 9 * u64::from(self.n) * seams
        } else {
            3 * vertices
        }
    }
}

/// Place of grid point (j, k) of the border among the 3 N of them: along the edge k = 0, then j = 0, then the third.
#[inline]
pub fn border_place(n: u32, j: u32, k: u32) -> u32 {
    if k == 0 {
        j
    } else if j == 0 {
        n + k
    } else {
        2 * n + k
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heaps_hold_every_block() {
        for (n, expected) in [(1, 0), (4, 0), (5, 1), (8, 1), (9, 2), (64, 4), (65, 5), (4096, 10)] {
            assert_eq!(levels(n), expected, "N = {n}");
            // A block has 16 micro-triangles.
            assert!(u64::from(n).pow(2) <= 16 << (2 * levels(n)));
        }
        assert_eq!(heap_nodes(0), 0);
        assert_eq!(heap_nodes(4), 1 + 4 + 16 + 64);
        // The last child of the last node is the last block.
        assert_eq!(first_child(heap_nodes(4) - 1) + 3, heap_nodes(4) + 255);
    }

    #[test]
    fn border_places_are_each_taken_once() {
        for n in [1, 2, 3, 8, 17] {
            let mut taken = vec![0; 3 * n as usize];
            for j in 0..=n {
                for k in (0..=n - j).filter(|&k| j == 0 || k == 0 || j + k == n) {
                    taken[border_place(n, j, k) as usize] += 1;
                }
            }
            assert!(taken.iter().all(|&count| count == 1), "{taken:?}");
        }
    }

    #[test]
    fn parts_lie_one_behind_the_other() {
        let layout = Layout::new(7, 64);
        assert_eq!(layout.record(0), layout.upper_node(7));
        assert_eq!(layout.heap_node(0, 0), layout.record(7));
        assert_eq!(layout.heap_node(1, 0), layout.heap_node(0, 85));
        assert_eq!(u64::from(layout.heap_node(7, 0)), layout.quarters());
        let features = Features { bounds: bounds::ALL, seams: 1, ..Features::default() };
        assert_eq!(u64::from(layout.micro_vertex(6, 0, 64)) + 1, u64::from(layout.border(0, 0, 0)));
        assert_eq!(u64::from(layout.border(2, 0, 0)), layout.floats(2, features));
    }

    #[test]
    fn floats_are_those_of_what_is_stored() {
        let layout = Layout::new(7, 64);
        let features = Features { bounds: bounds::ALL, seams: 1, ..Features::default() };
        let vertices = 7 * u64::from(tessellate::vertices_of(64));
        let vectors = Features { displacement: displacement_kind::TANGENT, ..features };
        assert_eq!(layout.floats(2, vectors), 3 * vertices);
        assert_eq!(layout.floats(2, Features { seams: 0, ..features }), vertices);
        assert_eq!(layout.floats(2, Features { bounds: bounds::BOXES, ..features }), 0);
    }
}
