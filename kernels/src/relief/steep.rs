//! Steep parallax mapping.
//!
//! McGuire and McGuire, "Steep Parallax Mapping", I3D 2005 poster: the relief is cut into N layers, and the ray is
//! stopped at the first one below the height field. N is the number of layers, the same for all rays.
//!
//! Cost: up to N + 1 readings of the map a ray, and up to N for each light.
//!
//! Artefacts: what is shown lies up to a layer too deep, so that smooth slopes turn into steps; relief thinner than a
//! layer is missed where a ray grazes it; the silhouette is the base mesh's. Deviation: the paper's layers are those
//! of a height map from 0 to 1, here those between the map's least and greatest height, on whichever side of the base
//! triangle.

use super::layers::Bracket;

/// The layer at which the ray was stopped: too far by less than a layer.
#[inline]
pub fn refine(bracket: Bracket) -> f32 {
    bracket.far
}

#[cfg(test)]
mod tests {
    use crate::interface::method;
    use crate::relief::test_ramp::{TOP, assert_on_ray, exact, found, ramp, rays, time_of};

    /// Never before the ramp, and less than a layer behind it.
    #[test]
    fn stops_at_the_next_layer() {
        for n in [1, 4, 32] {
            let scene = ramp(n);
            for ray in rays() {
                let hit = found(&scene, method::STEEP, &ray);
                let behind = f64::from(hit.t) - exact(&ray);
                let layer = time_of(TOP, &ray) / f64::from(n);
                assert!(behind > -1e-6 && behind < layer + 1e-6, "{behind} {layer} {ray:?}");
                assert_on_ray(&hit, &ray);
            }
        }
    }

    /// A layer that lies where the ray meets the ramp is the hit: the last of one layer is the bottom.
    #[test]
    fn one_layer_is_the_bottom() {
        for ray in rays() {
            let hit = found(&ramp(1), method::STEEP, &ray);
            let bottom = if ray.direction.z < 0.0 { 0.0 } else { TOP };
            assert!((hit.point.z - bottom).abs() < 1e-6, "{hit:?}");
        }
    }
}
