//! Bump mapping by a map of offsets.
//!
//! Blinn, "Simulation of Wrinkled Surfaces", SIGGRAPH 1978, has two forms of the bump function: a table of heights,
//! whose derivatives are differences ([`bump`](super::bump)), and one of the two derivatives b_u and b_v themselves,
//! interpolated where it is read. The latter comes out of a file, or the host makes it from the height map by central
//! differences. No parameter.
//!
//! Cost: one reading of the offset map a ray, which takes twice the bits of a height map of 32.
//!
//! Artefacts: those of [`bump`](super::bump), but normals do not change abruptly at the lines between texels'
//! centres; in return slopes of a map that the host makes are those between two texels, so that the finest relief is
//! flatter.

use super::normal_texels::NormalTexels;
use super::tangent_space::TangentSpace;
use glam::Vec2;

/// The growth of heights along the triangle's first and its second side.
#[inline]
pub fn slopes(space: &TangentSpace<'_>, map: &NormalTexels<'_>, uv: Vec2) -> Vec2 {
    space.along_sides(map.offsets(uv) * space.scale())
}

#[cfg(test)]
mod tests {
    use crate::interface::{method, wrap};
    use crate::relief::test_ramp::{SLOPE, found, ramp, rays};
    use glam::DVec3;

    /// A texel step of 1 for half a unit of u.
    #[test]
    fn leans_by_the_offsets_of_its_map() {
        let mut scene = ramp(1);
        let normal = DVec3::new(-SLOPE, 0.0, 1.0).normalize();
        scene.normal_texels = vec![6, 1, 1, wrap::REPEAT, 0, 0, 2.0_f32.to_bits(), 0.0_f32.to_bits()];
        for ray in rays() {
            let (flat, hit) = (found(&scene, method::NONE, &ray), found(&scene, method::BUMP_OFFSET, &ray));
            assert_eq!((hit.t, hit.point, hit.u, hit.v), (flat.t, flat.point, flat.u, flat.v));
            assert!(normal.distance(hit.normal.as_dvec3()) < 1e-6, "{hit:?}");
        }
    }
}
