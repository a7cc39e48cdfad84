//! Hits on the surface.

use crate::interface::MISS;

/// A ray's nearest hit so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance; infinite where nothing was hit.
    pub t: f32,
    /// Base triangle, or [`MISS`].
    pub primitive: u32,
    /// Packed [`Cell`](crate::displacement::cell::Cell); 0 for an undisplaced triangle.
    pub cell: u32,
    /// Barycentric coordinate of the micro-triangle's second vertex.
    pub b1: f32,
    /// Barycentric coordinate of its third vertex.
    pub b2: f32,
    /// The [`Instance`](crate::interface::Instance) whose triangle it is; 0 where there are none, and while it is
    /// looked for in an instance's mesh.
    pub instance: u32,
}

impl Hit {
    /// No hit.
    pub const NONE: Hit = Hit { t: f32::INFINITY, primitive: MISS, cell: 0, b1: 0.0, b2: 0.0, instance: 0 };

    /// Whether anything was hit.
    #[inline]
    pub fn is_some(&self) -> bool {
        self.primitive != MISS
    }

    /// The nearer of two hits. Where both are equally far, the one of the lower instance, then of the
    /// lower base triangle, then of the lower cell: so that the result does not depend on the order in which triangles
    /// were tested.
    #[inline]
    pub fn nearer(self, other: Hit) -> Hit {
        let other_wins = other.t < self.t
            || other.t == self.t
                && (other.instance < self.instance
                    || other.instance == self.instance
                        && (other.primitive < self.primitive
                            || other.primitive == self.primitive && other.cell < self.cell));
        if other_wins { other } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearer_hit_wins_and_ties_go_to_the_lower_instance_then_triangle_then_cell() {
        let hit = |t, instance, primitive, cell| Hit { t, primitive, cell, b1: 0.0, b2: 0.0, instance };
        let ascending = [
            hit(1.0, 9, 9, 9),
            hit(2.0, 2, 9, 9),
            hit(2.0, 3, 3, 7),
            hit(2.0, 3, 4, 1),
            hit(2.0, 3, 4, 2),
            Hit::NONE,
        ];
        for (i, &first) in ascending.iter().enumerate() {
            for &second in &ascending[i..] {
                assert_eq!(first.nearer(second), first);
                assert_eq!(second.nearer(first), first);
            }
        }
    }
}
