//! The linear search that several methods begin with: layers of the relief, one after the other.

use super::tangent_space::{Span, TangentRay, TangentSpace};

/// Two distances along a ray, of which the first is outside the relief and the second is not; with how far.
#[derive(Clone, Copy, Debug)]
pub struct Bracket {
    /// The last one outside.
    pub near: f32,
    /// [`TangentRay::clearance`] there.
    pub near_clearance: f32,
    /// The first one that is not.
    pub far: f32,
    /// Its clearance, not above 0 but for rounding.
    pub far_clearance: f32,
}

/// The first of `n` layers of equal height, from where a ray comes into `span`, at which the ray is no longer outside
/// the relief. The last one is the relief's own bound, so that there is one; relief thinner than a layer may be
/// missed.
#[inline]
pub fn search(space: &TangentSpace<'_>, ray: &TangentRay, span: Span, n: u32) -> Bracket {
    let mut bracket = Bracket { near: span.near, near_clearance: 0.0, far: span.near, far_clearance: 0.0 };
    let mut i = 0;
    let mut outside = true;
    while outside && i <= n {
        let t = span.at(i as f32 / n as f32);
        let clearance = ray.clearance(space, t);
        bracket.near = bracket.far;
        bracket.near_clearance = bracket.far_clearance;
        bracket.far = t;
        bracket.far_clearance = clearance;
        outside = clearance > 0.0;
        i += 1;
    }
    bracket
}

/// Whether the light is seen, 1, or not, 0, along a ray towards it from the relief: it is where none of the first `n`
/// layers between the relief and where the ray leaves `span` is inside the relief.
#[inline]
pub fn light_seen(space: &TangentSpace<'_>, ray: &TangentRay, span: Span, n: u32) -> f32 {
    let mut i = 1;
    let mut outside = true;
    while outside && i < n {
        // It comes from inside, where it is at no layer.
        outside = ray.clearance(space, span.at(i as f32 / n as f32)) <= 0.0;
        i += 1;
    }
    if outside { 1.0 } else { 0.0 }
}
