//! The invariants of a BVH, checked, and its statistics.

use super::{Bvh, HostAabb};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::node::is_sound;
use emboss_kernels::interface::{BvhNode, MAX_BVH_DEPTH};

/// What a tree is like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BvhStats {
    /// How many nodes.
    pub nodes: usize,
    /// How many of them are leaves.
    pub leaves: usize,
    /// Primitives of the fullest leaf.
    pub largest_leaf: u32,
    /// Edges on the longest path from the root to a leaf.
    pub depth: u32,
    /// Expected tests of a ray that meets the root's box: 1 for an inner node, 1 for each primitive of a leaf, times
    /// the node's share of the root's area. NaN where the root's area is 0 or infinite.
    pub sah_cost: f64,
}

/// An invariant that a tree breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BvhError {
    /// A node points to the root, into nothing, or to primitives that do not exist.
    #[error("BVH node {node} points nowhere")]
    Dangling {
        /// The node.
        node: u32,
    },
    /// A box does not hold what is below it.
    #[error("BVH node {node} is smaller than what it holds")]
    TooSmall {
        /// The node.
        node: u32,
    },
    /// A leaf is below the limit on depth.
    #[error("BVH node {node} is deeper than {MAX_BVH_DEPTH} levels")]
    TooDeep {
        /// The node.
        node: u32,
    },
    /// A primitive with a sound box is in no leaf or in more than one, or one without is in some.
    #[error("primitive {primitive} is in {count} leaves of the BVH")]
    NotOnce {
        /// The primitive.
        primitive: u32,
        /// How many leaves hold it.
        count: u32,
    },
    /// A node is a child of two nodes, or its own descendant.
    #[error("BVH node {node} is reached twice")]
    Shared {
        /// The node.
        node: u32,
    },
    /// A node is no one's child.
    #[error("{count} BVH nodes cannot be reached from the root")]
    Unreachable {
        /// How many.
        count: usize,
    },
}

impl Bvh {
    /// Checks that each of `boxes` is in one leaf, those that are not [sound](is_sound) in none, that nodes hold their
    /// children and primitives, and that the depth keeps its limit.
    pub fn validate(&self, boxes: &[Aabb]) -> Result<BvhStats, BvhError> {
        let mut walk = Walk {
            bvh: self,
            boxes,
            uses: vec![0; boxes.len()],
            seen: vec![false; self.nodes.len()],
            stats: BvhStats { nodes: self.nodes.len(), ..BvhStats::default() },
        };
        match &self.nodes[..] {
            // Where nothing is sound, a root that no ray enters, or none.
            [] => {}
            [root] if root.count == 0 && root.min.cmpgt(root.max).all() => walk.seen[0] = true,
            _ => walk.subtree(0, 0)?,
        }
        walk.finish()
    }
}

struct Walk<'a> {
    bvh: &'a Bvh,
    boxes: &'a [Aabb],
    /// In how many leaves each primitive is.
    uses: Vec<u32>,
    /// Which nodes were reached.
    seen: Vec<bool>,
    stats: BvhStats,
}

impl Walk<'_> {
    /// Checks the tree below `node`. Recursion is bounded by the depth limit, which is checked first.
    fn subtree(&mut self, node: u32, depth: u32) -> Result<(), BvhError> {
        if depth > MAX_BVH_DEPTH {
            return Err(BvhError::TooDeep { node });
        }
        if std::mem::replace(&mut self.seen[node as usize], true) {
            return Err(BvhError::Shared { node });
        }
        self.stats.depth = self.stats.depth.max(depth);
        let this = self.bvh.nodes[node as usize];
        self.stats.sah_cost += bounds_of(this).half_area() * f64::from(this.count.max(1));
        if this.count > 0 { self.leaf(node, this) } else { self.inner(node, this, depth) }
    }

    fn leaf(&mut self, node: u32, leaf: BvhNode) -> Result<(), BvhError> {
        self.stats.leaves += 1;
        self.stats.largest_leaf = self.stats.largest_leaf.max(leaf.count);
        let range = leaf.first as usize..leaf.first as usize + leaf.count as usize;
        for &primitive in self.bvh.primitives.get(range).ok_or(BvhError::Dangling { node })? {
            let held = self.boxes.get(primitive as usize).ok_or(BvhError::Dangling { node })?;
            if !bounds_of(leaf).contains(*held) {
                return Err(BvhError::TooSmall { node });
            }
            self.uses[primitive as usize] += 1;
        }
        Ok(())
    }

    fn inner(&mut self, node: u32, inner: BvhNode, depth: u32) -> Result<(), BvhError> {
        if inner.first == 0 || inner.first as usize + 1 >= self.bvh.nodes.len() {
            return Err(BvhError::Dangling { node });
        }
        for child in [inner.first, inner.first + 1] {
            if !bounds_of(inner).contains(bounds_of(self.bvh.nodes[child as usize])) {
                return Err(BvhError::TooSmall { node });
            }
            self.subtree(child, depth + 1)?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<BvhStats, BvhError> {
        let expected = |primitive: u32| u32::from(is_sound(self.boxes[primitive as usize]));
        if let Some((primitive, &count)) = (0..).zip(&self.uses).find(|&(p, &count)| count != expected(p)) {
            return Err(BvhError::NotOnce { primitive, count });
        }
        let unreachable = self.seen.iter().filter(|&&seen| !seen).count();
        if unreachable > 0 {
            return Err(BvhError::Unreachable { count: unreachable });
        }
        if self.stats.leaves > 0 {
            self.stats.sah_cost /= self.bvh.bounds().half_area();
        }
        Ok(self.stats)
    }
}

fn bounds_of(node: BvhNode) -> Aabb {
    Aabb { min: node.min, max: node.max }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn unit_box_at(x: f32) -> Aabb {
        Aabb { min: Vec3::new(x, 0.0, 0.0), max: Vec3::new(x + 1.0, 1.0, 1.0) }
    }

    fn three() -> (Vec<Aabb>, Bvh) {
        let boxes = vec![unit_box_at(0.0), unit_box_at(4.0), unit_box_at(9.0)];
        let bvh = Bvh::binned(&boxes);
        (boxes, bvh)
    }

    /// Two unit cubes, one apart: half areas 1 * 3 + 3 * 1 + 1 * 1 = 7 and 3 each. One inner test, and each leaf's
    /// primitive with the probability 3/7.
    #[test]
    fn the_cost_is_the_expected_number_of_tests() {
        let boxes = [unit_box_at(0.0), unit_box_at(2.0)];
        let stats = Bvh::binned(&boxes).validate(&boxes).expect("valid");
        assert!((stats.sah_cost - (1.0 + 2.0 * 3.0 / 7.0)).abs() < 1e-12, "{}", stats.sah_cost);
        assert_eq!((stats.nodes, stats.leaves, stats.largest_leaf, stats.depth), (3, 2, 1, 1));
    }

    #[test]
    fn a_box_that_misses_its_child_is_found() {
        let (boxes, mut bvh) = three();
        bvh.nodes[0].max.x -= 0.5;
        assert_eq!(bvh.validate(&boxes), Err(BvhError::TooSmall { node: 0 }));
    }

    #[test]
    fn a_leaf_that_misses_its_primitive_is_found() {
        let (mut boxes, bvh) = three();
        boxes[0].min.y = -1.0;
        assert!(matches!(bvh.validate(&boxes), Err(BvhError::TooSmall { .. })));
    }

    #[test]
    fn a_primitive_listed_twice_is_found() {
        let (boxes, mut bvh) = three();
        let leaf = |i: u32| bvh.nodes.iter().position(|n| n.count > 0 && n.first == i).expect("a leaf");
        let (from, to) = (leaf(0), leaf(1));
        bvh.primitives[1] = bvh.primitives[0];
        (bvh.nodes[to].min, bvh.nodes[to].max) = (bvh.nodes[from].min, bvh.nodes[from].max);
        assert!(matches!(bvh.validate(&boxes), Err(BvhError::NotOnce { .. } | BvhError::TooSmall { .. })));
    }

    #[test]
    fn a_circle_of_nodes_is_found() {
        let (boxes, mut bvh) = three();
        bvh.nodes[0].first = 0;
        assert_eq!(bvh.validate(&boxes), Err(BvhError::Dangling { node: 0 }));
    }

    #[test]
    fn a_missing_leaf_is_found() {
        let (mut boxes, bvh) = three();
        boxes.push(unit_box_at(5.0));
        assert_eq!(bvh.validate(&boxes), Err(BvhError::NotOnce { primitive: 3, count: 0 }));
    }

    #[test]
    fn a_stray_node_is_found() {
        let (boxes, mut bvh) = three();
        bvh.nodes.push(BvhNode::default());
        assert_eq!(bvh.validate(&boxes), Err(BvhError::Unreachable { count: 1 }));
    }

    /// A chain as a degenerate builder would make it: each inner node holds one leaf and the rest.
    #[test]
    fn a_chain_beyond_the_limit_is_found() {
        let count = MAX_BVH_DEPTH + 2;
        let boxes = vec![unit_box_at(0.0); count as usize];
        let (min, max) = (boxes[0].min, boxes[0].max);
        let mut nodes = vec![BvhNode { min, max, first: 1, count: 0 }];
        for i in 0..count - 1 {
            nodes.push(BvhNode { min, max, first: i, count: 1 });
            nodes.push(BvhNode { min, max, first: 2 * i + 3, count: 0 });
        }
        let last = nodes.len() - 1;
        nodes[last] = BvhNode { min, max, first: count - 1, count: 1 };
        let bvh = Bvh { nodes, primitives: (0..count).collect() };
        assert!(matches!(bvh.validate(&boxes), Err(BvhError::TooDeep { .. })));
    }
}
