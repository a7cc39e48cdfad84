//! What a ray's tracing cost: boxes tested, cells walked, triangles tested, caps hit.

use crate::interface::{Counter, counter};

/// Work done for one pixel or ray. Plain integers: an invocation sums its own and adds them once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Primary rays.
    pub primary_rays: u32,
    /// Shadow rays.
    pub shadow_rays: u32,
    /// Primary rays that hit.
    pub hits: u32,
    /// Ray/box tests.
    pub boxes: u32,
    /// Prisms whose boxes rays entered.
    pub prisms: u32,
    /// Cells walked by the grid walk.
    pub cells: u32,
    /// Micro-triangles (or base triangles) tested.
    pub triangles: u32,
    /// Walks that met their cap on steps.
    pub cap_hits: u32,
    /// Walks that ended inside the grid because signs told no way on.
    pub lost_walks: u32,
    /// Sub-triangles of quadtrees tested.
    pub sub_triangles: u32,
}

impl Counts {
    /// The counts in the order of [`counter`].
    #[inline]
    pub fn to_array(self) -> [u32; counter::COUNT] {
        [
            self.primary_rays,
            self.shadow_rays,
            self.hits,
            self.boxes,
            self.prisms,
            self.cells,
            self.triangles,
            self.cap_hits,
            self.lost_walks,
            self.sub_triangles,
        ]
    }
}

impl Counter {
    /// Its value as one integer.
    #[cfg(not(target_arch = "spirv"))]
    pub fn value(self) -> u64 {
        u64::from(self.high) << 32 | u64::from(self.low)
    }
}
