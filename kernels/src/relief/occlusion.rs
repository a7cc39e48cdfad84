//! Parallax occlusion mapping.
//!
//! Tatarchuk, "Dynamic Parallax Occlusion Mapping with Approximate Soft Shadows", I3D 2006: a linear search over N
//! layers, then the intersection of the ray with the straight line between the heights at the last two of them.
//! Shadows are soft: of N heights on the way to the light the one counts that rises most above the ray, the more the
//! nearer it is. N is the number of layers.
//!
//! Cost: up to N + 1 readings of the map a ray, and N for each light.
//!
//! Artefacts: relief thinner than a layer is missed where a ray grazes it; within a layer, relief is flattened.
//! Shadows have penumbras of one softness, whatever the light's size, and leak where a narrow ridge falls between two
//! of N heights. The silhouette is the base mesh's. Deviations: N is the same for all rays, where the paper takes
//! more where they graze, and fades to a normal map with distance; the paper's eight weights of a light's heights, 1
//! to 12, are a linear function here, for any N.

use super::layers::Bracket;
use super::tangent_space::{Span, TangentRay, TangentSpace};
use crate::math::clamp;

/// What a height that rises by the whole range of heights above the ray, close to its start, takes of the light:
/// twice the number of the paper's heights, times the softening of its sample program (`ParallaxOcclusionMapping` of
/// the DirectX SDK), 0.58.
const SOFTENING: f32 = 16.0 * 0.58;

/// Where the ray meets the line between the heights at the ends of `bracket`.
#[inline]
pub fn refine(bracket: Bracket) -> f32 {
    let fall = bracket.near_clearance - bracket.far_clearance;
    let share = if fall > 0.0 { clamp(bracket.near_clearance / fall, 0.0, 1.0) } else { 1.0 };
    bracket.near + (bracket.far - bracket.near) * share
}

/// How much of the light is seen along `ray` towards it from the relief, from 0 to 1. `span` is from there on; the
/// heights are read along the way that the ray takes to climb by `range`, the whole range of heights.
#[inline]
pub fn light_seen(space: &TangentSpace<'_>, ray: &TangentRay, span: Span, range: f32, n: u32) -> f32 {
    let way = range / ray.climb().abs();
    let mut shadow = 0.0_f32;
    let mut i = 1;
    while i < n {
        let s = i as f32 / n as f32;
        let t = span.near + way * s;
        // Beyond the span there is nothing above the ray.
        let rise = if t < span.far { ray.clearance(space, t) / range } else { 0.0 };
        shadow = shadow.max(rise * (1.0 - s) * SOFTENING);
        i += 1;
    }
    1.0 - shadow.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interface::method;
    use crate::relief::test_ramp::{assert_on_ray, exact, found, ramp, rays};

    /// Over a plane the heights between two layers lie on a line: every N is exact.
    #[test]
    fn meets_a_plane_whatever_its_layers() {
        for n in [1, 4, 32] {
            let scene = ramp(n);
            for ray in rays() {
                let hit = found(&scene, method::OCCLUSION, &ray);
                // Heights of some ten roundings, divided by the sine of 25 degrees.
                assert!((f64::from(hit.t) - exact(&ray)).abs() < 2e-6, "{hit:?} {}", exact(&ray));
                assert_on_ray(&hit, &ray);
            }
        }
    }

    #[test]
    fn ends_of_a_bracket_are_met_where_clearance_is_nothing() {
        let bracket =
            |near_clearance, far_clearance| Bracket { near: 2.0, far: 4.0, near_clearance, far_clearance };
        assert_eq!(refine(bracket(1.0, -1.0)), 3.0);
        assert_eq!(refine(bracket(1.0, 0.0)), 4.0);
        assert_eq!(refine(bracket(0.0, -1.0)), 2.0);
        assert_eq!(refine(bracket(0.0, 0.0)), 4.0);
    }
}
