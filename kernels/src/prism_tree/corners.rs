//! What micro-vertices of a base triangle are interpolated from, stored side by side: a block needs nothing else of the
//! triangle.

use crate::displacement::surface::BaseTriangle;
use crate::math::{at, put};
use crate::prism_tree::frame::{quarter, vector_of};
use crate::prism_tree::layout::FRAME_QUARTERS;
use glam::{UVec4, Vec3};

/// The corners of a base triangle, in the stored order.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    /// Positions.
    pub p: [Vec3; 3],
    /// Unit normals.
    pub n: [Vec3; 3],
    /// Index of its [`Seams`](crate::interface::Seams), or [`NO_SEAMS`](crate::interface::NO_SEAMS).
    pub seams: u32,
}

impl Corners {
    /// Reads the corners of the record that begins at quarter `first`.
    #[inline]
    pub fn load(quarters: &[UVec4], first: u32) -> Corners {
        let component = |i: u32| f32::from_bits(at(quarters, first + i).w);
        let behind = first + FRAME_QUARTERS;
        let (a, b) = (at(quarters, behind), at(quarters, behind + 1));
        let (c, d) = (at(quarters, behind + 2), at(quarters, behind + 3));
        Corners {
            // The first one is the frame's origin.
            p: [Vec3::new(component(0), component(1), component(2)), vector_of(a), vector_of(b)],
            n: [
                Vec3::new(f32::from_bits(a.w), f32::from_bits(b.w), f32::from_bits(c.w)),
                vector_of(c),
                vector_of(d),
            ],
            seams: d.w,
        }
    }

    /// Writes them into a record whose frame is stored.
    #[inline]
    pub fn store(base: &BaseTriangle, quarters: &mut [UVec4], first: u32) {
        let behind = first + FRAME_QUARTERS;
        put(quarters, behind, quarter(base.p1, base.n0.x));
        put(quarters, behind + 1, quarter(base.p2, base.n0.y));
        put(quarters, behind + 2, quarter(base.n1, base.n0.z));
        let n2 = quarter(base.n2, 0.0);
        put(quarters, behind + 3, UVec4::new(n2.x, n2.y, n2.z, base.seams));
    }
}
