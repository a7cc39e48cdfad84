//! Every micro-triangle of a base triangle: slow, obvious, and what the other methods are tested against.

use crate::counters::Counts;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::hit::Hit;
use crate::ray::TraversalRay;

/// The nearer of `nearest` and the ray's hits on all N² micro-triangles of `base`.
///
/// Exact by construction: it *is* the definition of the surface. Cost: N² triangle tests and (N+1)(N+2) heights a
/// prism.
#[inline]
pub fn intersect(
    field: &HeightField<'_>,
    base: &BaseTriangle,
    ray: &TraversalRay,
    nearest: Hit,
    counts: &mut Counts,
) -> Hit {
    let n = field.subdivisions;
    let mut nearest = nearest;
    let mut j = 0;
    while j < n {
        // A strip between rows j and j+1: each step adds one vertex to either row.
        let mut a = base.micro_vertex(field, j, 0);
        let mut b = base.micro_vertex(field, j + 1, 0);
        let mut k = 0;
        while j + k < n {
            let c = base.micro_vertex(field, j, k + 1);
            nearest = base.intersect_cell(ray, Cell { j, k, upper: false }, a, b, c, nearest);
            counts.triangles += 1;
            if j + k + 1 < n {
                let d = base.micro_vertex(field, j + 1, k + 1);
                nearest = base.intersect_cell(ray, Cell { j, k, upper: true }, d, c, b, nearest);
                counts.triangles += 1;
                b = d;
            }
            a = c;
            k += 1;
        }
        j += 1;
    }
    nearest
}
