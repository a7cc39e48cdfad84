//! Normal mapping.
//!
//! Cohen, Olano and Manocha, "Appearance-Preserving Simplification", SIGGRAPH 1998, and Heidrich and Seidel,
//! "Realistic, Hardware-Accelerated Shading and Lighting", SIGGRAPH 1999: a map of normals replaces that of the
//! surface. In tangent space they are along tangent, bitangent and normal, those of MikkTSpace, interpolated and not
//! normalised, as programs bake them; in object space along the axes of the mesh, in world space along those of the
//! scene. Where neither the command line nor the material names one the host makes one in tangent space from the height
//! map. No parameter.
//!
//! Cost: one reading of the normal map a ray.
//!
//! Artefacts: those of [`bump`](super::bump). A map made from heights knows one size of texels for the whole mesh:
//! where the mesh stretches the map, relief leans too much or too little. A map in object space turns with the mesh,
//! but not with what bends it; one in world space does not even turn. Deviation: without `--smooth` the normal that
//! maps in tangent space lean from is the triangle's own, so that a map that leans nowhere shows what no map does.

use super::normal_texels::NormalTexels;
use super::tangent_space::TangentSpace;
use crate::interface::normal_space;
use crate::math::{dot, unit};
use glam::{Vec2, Vec3};

/// The normal that the map gives at `uv` over barycentric coordinates `w`, where the surface has `ns`; of a map in
/// world space in that of the scene, else in that of the mesh. `ns` where it gives none, and to the bit where it
/// leans nowhere in tangent space.
#[inline]
pub fn normal(space: &TangentSpace<'_>, map: &NormalTexels<'_>, w: Vec3, uv: Vec2, ns: Vec3) -> Vec3 {
    let m = map.normal(uv, space.scale());
    let mut normal = m;
    let mut leans = true;
    if map.space == normal_space::TANGENT {
        let (tangent, bitangent) = space.tangents(w);
        normal = tangent * m.x + bitangent * m.y + ns * m.z;
        leans = m.x != 0.0 || m.y != 0.0;
    }
    let normal = unit(normal);
    if leans && dot(normal, normal) > 0.5 { normal } else { ns }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interface::{Tangent, method, wrap};
    use crate::relief::test_ramp::{SLOPE, found, ramp, rays};
    use crate::test_scene::TestScene;

    /// The square under one texel, in some space.
    fn under(space: u32, made_for: f32, [x, y, z]: [u32; 3]) -> TestScene {
        let mut scene = ramp(1);
        scene.tangents = vec![Tangent { direction: Vec3::X, sign: 1.0 }; scene.vertices.len()];
        scene.normal_texels = vec![6, 1, 1, wrap::REPEAT, made_for.to_bits(), space, x | y << 16, z];
        scene
    }

    fn shown(scene: &TestScene) -> Vec3 {
        let ray = rays()[0];
        let (flat, hit) = (found(scene, method::NONE, &ray), found(scene, method::NORMAL_MAP, &ray));
        assert_eq!((hit.t, hit.point, hit.u, hit.v), (flat.t, flat.point, flat.u, flat.v));
        hit.normal
    }

    /// Codes are steps of 1 / 32767 from 32768.
    #[test]
    fn shows_the_texel_in_its_space() {
        let lean = |x: u32, y: u32| [32768 + x, 32768 + y, 65535];
        for space in [normal_space::TANGENT, normal_space::OBJECT, normal_space::WORLD] {
            assert_eq!(shown(&under(space, 0.0, lean(0, 0))), Vec3::Z);
            let normal = shown(&under(space, 0.0, lean(16384, 8192)));
            assert!(normal.distance(Vec3::new(0.5, 0.25, 1.0).normalize()) < 1e-4, "{normal}");
        }
        // Tangent space turns with the tangents, and is mirrored with them.
        let mut turned = under(normal_space::TANGENT, 0.0, lean(16384, 8192));
        turned.tangents.iter_mut().for_each(|t| *t = Tangent { direction: Vec3::Y, sign: -1.0 });
        let normal = shown(&turned);
        assert!(normal.distance(Vec3::new(0.25, 0.5, 1.0).normalize()) < 1e-4, "{normal}");
    }

    /// A map that was made for another scale leans as the present one says.
    #[test]
    fn normals_of_heights_follow_the_scale() {
        let expected = Vec3::new(-SLOPE as f32, 0.0, 1.0).normalize();
        for (made_for, slope) in [(0.25, SLOPE), (0.5, 2.0 * SLOPE), (-0.25, -SLOPE)] {
            let code = (32768.0 - slope * 32767.0).round() as u32;
            let normal = shown(&under(normal_space::TANGENT, made_for, [code, 32768, 65535]));
            assert!(normal.distance(expected) < 1e-4, "{made_for}: {normal}");
        }
    }
}
