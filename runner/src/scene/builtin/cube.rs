//! `builtin:cube`: the simplest closed mesh whose normals and texture coordinates are split at every edge.

use super::{BuiltinScene, light};
use crate::scene::{HeightMap, Mesh, image::per_texel};
use emboss_kernels::interface::Vertex;
use glam::Vec3;
use std::f32::consts::PI;

/// Texels of a side of the height map.
const MAP_SIDE: u32 = 512;
/// Bumps along a side of a face.
const BUMPS: f32 = 5.0;

/// A cube of side 2 around the origin with the relief |sin 5πu · sin 5πv| on each face.
pub(super) fn scene() -> BuiltinScene {
    let bump = |u: f32, v: f32| ((BUMPS * PI * u).sin() * (BUMPS * PI * v).sin()).abs();
    let view = Vec3::new(0.55, 0.45, 0.85).normalize();
    BuiltinScene {
        mesh: mesh(),
        height: HeightMap::from_unit(MAP_SIDE, MAP_SIDE, per_texel(MAP_SIDE, MAP_SIDE, bump).into_iter()),
        sideways: None,
        color: None,
        zero: 0.0,
        scale: 0.2,
        subdivisions: 128,
        view,
        up: Vec3::Y,
        lights: vec![light(Vec3::new(2.0, 5.0, 5.5), 1.0, Vec3::ONE)],
    }
}

/// Six faces of two triangles, each with the whole map, upright on the four sides.
fn mesh() -> Mesh {
    let sides = [Vec3::X, Vec3::Z, -Vec3::X, -Vec3::Z].map(|n| (n, Vec3::Y));
    let ends = [(Vec3::Y, -Vec3::Z), (-Vec3::Y, Vec3::Z)];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for ((normal, up), first) in sides.into_iter().chain(ends).zip((0..).step_by(4)) {
        let right = up.cross(normal);
        vertices.extend([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| {
            let position = normal + right * (2.0 * u - 1.0) + up * (2.0 * v - 1.0);
            Vertex { position, u, normal, v }
        }));
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    Mesh::from_triangles(&vertices, &triangles)
}
