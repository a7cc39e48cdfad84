//! What a ray asks of a tree.

use crate::hit::Hit;
use crate::math::{MinMax, gamma};
use crate::ray::TraversalRay;

/// What a traversal looks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Query {
    /// The nearest hit.
    Nearest,
    /// Any hit: the first one found ends the search.
    Any,
}

/// Beyond this distance a box can hold no hit that counts: hits at equal distances must all be found, and a hit's
/// computed distance can fall short of its box's by the rounding of both.
#[inline]
pub(crate) fn farthest(ray: &TraversalRay, nearest: Hit) -> f32 {
    ray.t_max.min_num(nearest.t * (1.0 + 4.0 * gamma(12)))
}
