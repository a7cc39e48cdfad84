//! The bounding volume hierarchy over the prisms.
//!
//! Built as an HLBVH (Garanzha, Pantaleoni and McAllister, "Simpler and Faster HLBVH with Work Queues", HPG 2011) by
//! kernels, in this order:
//!
//! 1. [`morton`]: the box of all centres, codes; [`radix_sort`] sorts them; where the sorted order splits.
//! 2. [`hlbvh`]: subtrees of neighbours on the curve, *treelets*, from the bottom up.
//! 3. [`top`]: the tree over the treelets by the surface area heuristic (SAH), level by level from work queues, and
//!    [`small`] where they are few.
//! 4. [`refit`]: boxes again, when primitives have moved.
//!
//! # Layout
//! A tree over m primitives has m - 1 inner nodes and as many pairs of siblings. Each pair is that of one of the m - 1
//! *splits* between neighbours in the sorted order: the children of the node that split q parts stand at 1 + 2q and
//! 2 + 2q, the root at 0. So every node has its place without any counting, and the same primitives give the same tree
//! on every device, whichever invocation comes first. (In the top of the tree a split need not lie where its pair's
//! number says: there the numbers are only handed out, each once.)

pub mod hlbvh;
pub mod morton;
pub mod node;
pub mod query;
pub mod radix_sort;
pub mod refit;
pub mod scan;
pub mod small;
pub mod top;
pub mod traverse;

/// The state of a build: words of [`BUILD_STATE`](crate::interface::binding::BUILD_STATE), all zero before it.
pub mod header {
    /// The [`Extent`](super::node::Extent) of the primitives' centres.
    pub const CENTERS: u32 = 0;
    /// How many primitives are sound: the tree holds these.
    pub const SOUND: u32 = 6;
    /// Splits of this level or above are between treelets.
    pub const THRESHOLD: u32 = 7;
    /// How many treelets.
    pub const TREELETS: u32 = 8;
    /// Three words: workgroups that build too deep treelets again.
    pub const DEEP_GROUPS: u32 = 9;
    /// How many leaves a refit found unbounded.
    pub const UNSOUND: u32 = 12;
    /// How many treelets the tree is over: those that are sound.
    pub const ITEMS: u32 = 13;
    /// [`LEVELS`](super::morton::LEVELS) words: how many splits there are of each level.
    pub const LEVEL_COUNTS: u32 = 16;
    /// Three words: workgroups of `bvh_small`, one for each small task.
    pub const SMALL_GROUPS: u32 = LEVEL_COUNTS + super::morton::LEVELS;
    /// How many tasks each level of the top has. One level more than there are is named, never run.
    pub const TASK_COUNTS: u32 = SMALL_GROUPS + 3;
    /// How many words.
    pub const WORDS: u32 = TASK_COUNTS + super::top::MOST_LEVELS + 1;
}
