//! Relief mapping.
//!
//! Policarpo, Oliveira and Comba, "Real-Time Relief Mapping on Arbitrary Polygonal Surfaces", I3D 2005: a linear
//! search over N layers finds one on each side of the relief, a binary search the place between them. N is the number
//! of layers; the binary search has [`HALVINGS`] steps, the paper's 8.
//!
//! Cost: up to N + 1 + 8 readings of the map a ray, and up to N for each light.
//!
//! Artefacts: relief thinner than a layer is missed where a ray grazes it, so that thin features break off; else what
//! is shown is right to 2^-8 of a layer. The silhouette is the base mesh's. Deviations: layers lie between the map's
//! least and greatest height, on whichever side of the base triangle; the normal is computed from heights, not read
//! from a normal map.

use super::layers::Bracket;
use super::tangent_space::{TangentRay, TangentSpace};

/// Steps of the binary search.
pub const HALVINGS: u32 = 8;

/// Where the ray goes into the relief, too far by at most 2^-8 of a layer.
#[inline]
pub fn refine(space: &TangentSpace<'_>, ray: &TangentRay, bracket: Bracket) -> f32 {
    let (mut near, mut far) = (bracket.near, bracket.far);
    let mut i = 0;
    while i < HALVINGS {
        let middle = 0.5 * (near + far);
        let outside = ray.clearance(space, middle) > 0.0;
        near = if outside { middle } else { near };
        far = if outside { far } else { middle };
        i += 1;
    }
    far
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interface::method;
    use crate::relief::test_ramp::{TOP, assert_on_ray, exact, found, ramp, rays, time_of};

    /// Never before the ramp, and less than 2^-8 of a layer behind it.
    #[test]
    fn stops_within_a_part_of_a_layer() {
        for n in [1, 4, 32] {
            let scene = ramp(n);
            for ray in rays() {
                let hit = found(&scene, method::RELIEF, &ray);
                let behind = f64::from(hit.t) - exact(&ray);
                let part = time_of(TOP, &ray) / f64::from(n << HALVINGS);
                assert!(behind > -1e-6 && behind < part + 1e-6, "{behind} {part} {ray:?}");
                assert_on_ray(&hit, &ray);
            }
        }
    }
}
