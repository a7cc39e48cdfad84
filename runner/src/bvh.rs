//! Bounding volume hierarchies on the host: the kernels of the [HLBVH](emboss_kernels::bvh) run on the processor, the
//! reference that its quality is measured against, and the invariants of any.
//!
//! A tree has the layout of [`BvhNode`]: root at 0, the two children of a node side by side. An empty scene has no
//! nodes.

mod binned;
mod boxes;
mod hlbvh;
pub mod scan;
pub mod sort;
mod validate;

pub use boxes::HostAabb;
pub use hlbvh::Hlbvh;
pub use validate::{BvhError, BvhStats};

use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::BvhNode;

/// A binary BVH.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// The nodes, root first.
    pub nodes: Vec<BvhNode>,
    /// Indices of the boxes in the order of the leaves.
    pub primitives: Vec<u32>,
}

impl Bvh {
    /// The box around everything; empty for an empty tree.
    pub fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |root| Aabb { min: root.min, max: root.max })
    }
}

/// A refit tree whose SAH cost is more than this many times that of the tree as it was built is built again: tracing
/// takes about as much longer as the cost is higher, and a build takes less than most frames.
pub(crate) const MOST_GROWTH: f64 = 1.2;

/// What the phases of a build took, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BuildTimes {
    /// The box of centres and the codes.
    pub codes: f64,
    /// The radix sort.
    pub sort: f64,
    /// Splits, treelets and their numbers.
    pub treelets: f64,
    /// The tree over the treelets.
    pub top: f64,
}

impl BuildTimes {
    /// All of it.
    pub fn total(self) -> f64 {
        self.codes + self.sort + self.treelets + self.top
    }
}

/// Up to so many primitives, ten bits along each axis tell neighbours apart well enough: a tree of 10^6 costs as much
/// as with 21 bits.
const MOST_NARROW: u32 = 1 << 20;

/// How many bits the sort keys of `count` primitives have: those of Morton codes, and one more for primitives that the
/// tree leaves out.
pub(crate) fn key_bits(count: u32) -> u32 {
    if count <= MOST_NARROW { 32 } else { 64 }
}
