//! Boxes around blocks of micro-triangles, and boxes around those: the oracle's own bounding volume hierarchy.

use super::line::Line;
use super::tessellation::{Block, Piece};
use glam::DVec3;
use rayon::prelude::*;

/// From how many blocks on it is worth handing half of them to another thread.
const WORTH_A_THREAD: usize = 4096;

/// A binary tree over blocks, in depth-first order: a first child follows its parent, a second one its sibling's
/// subtree.
pub(super) struct Tree {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
struct Node {
    bounds: Box3,
    /// How many nodes its subtree has, itself included; 1 of a leaf.
    size: usize,
    /// A leaf's block.
    block: Block,
}

/// A box.
#[derive(Clone, Copy)]
pub(super) struct Box3 {
    pub(super) centre: DVec3,
    /// Half its extent.
    pub(super) half: DVec3,
}

impl Box3 {
    /// From its least and its greatest corner.
    pub(super) fn new((min, max): (DVec3, DVec3)) -> Box3 {
        Box3 { centre: (min + max) * 0.5, half: (max - min) * 0.5 }
    }

    /// The least box around both.
    fn union(self, other: Box3) -> Box3 {
        let min = (self.centre - self.half).min(other.centre - other.half);
        let max = (self.centre + self.half).max(other.centre + other.half);
        Box3::new((min, max))
    }
}

impl Tree {
    /// Splits all blocks of all pieces at the median of their centres along the axis in which they spread most, down to
    /// single blocks.
    pub(super) fn new(pieces: &[Piece]) -> Tree {
        let mut leaves: Vec<Node> = pieces
            .par_iter()
            .flat_map_iter(|piece| {
                let bounds = |block| Box3::new(piece.block_bounds(block));
                piece.blocks().map(move |block| Node { bounds: bounds(block), size: 1, block })
            })
            .collect();
        let Some(&any) = leaves.first() else { return Tree { nodes: Vec::new() } };
        let mut nodes = vec![any; 2 * leaves.len() - 1];
        fill(&mut nodes, &mut leaves);
        Tree { nodes }
    }

    /// Calls `visit` with every block whose box the line comes within `distance` of, in each coordinate, and not wholly
    /// that far behind its origin.
    pub(super) fn visit(&self, line: &Line, distance: f64, mut visit: impl FnMut(Block)) {
        let mut i = 0;
        while let Some(node) = self.nodes.get(i) {
            if !line.nears(&node.bounds, distance) {
                i += node.size;
                continue;
            }
            if node.size == 1 {
                visit(node.block);
            }
            i += 1;
        }
    }
}

/// Makes `nodes` the tree over `leaves`, of which it has one less than twice as many.
fn fill(nodes: &mut [Node], leaves: &mut [Node]) {
    if let [leaf] = leaves {
        nodes[0] = *leaf;
        return;
    }
    let centres = || leaves.iter().map(|leaf| leaf.bounds.centre);
    let (least, greatest) = (centres().reduce(DVec3::min), centres().reduce(DVec3::max));
    let spread = greatest.unwrap_or_default() - least.unwrap_or_default();
    let axis = spread.max_position();
    let middle = leaves.len() / 2;
    leaves.select_nth_unstable_by(middle, |a, b| a.bounds.centre[axis].total_cmp(&b.bounds.centre[axis]));
    let size = nodes.len();
    let worth_a_thread = leaves.len() >= WORTH_A_THREAD;
    let (node, children) = nodes.split_at_mut(1);
    let (first, second) = children.split_at_mut(2 * middle - 1);
    let (before, after) = leaves.split_at_mut(middle);
    if worth_a_thread {
        rayon::join(|| fill(first, before), || fill(second, after));
    } else {
        fill(first, before);
        fill(second, after);
    }
    node[0] = Node { bounds: first[0].bounds.union(second[0].bounds), size, ..node[0] };
}
