//! Scenes made by code, for a first look and for tests: `builtin:cube`, `builtin:quilt`, `builtin:knot`,
//! `builtin:mushroom`.

mod cube;
mod knot;
mod mushroom;
mod quilt;

use super::{ColorMap, HeightMap, Mesh};
use emboss_kernels::interface::PointLight;
use glam::Vec3;

/// A model with its maps and the settings that show it well.
#[derive(Clone, Debug)]
pub struct BuiltinScene {
    /// The base mesh.
    pub mesh: Mesh,
    /// Its relief; of a vector map the component along the normal.
    pub height: HeightMap,
    /// The components along tangent and bitangent, where its relief is a vector map.
    pub sideways: Option<[HeightMap; 2]>,
    /// Its colours, where it has some.
    pub color: Option<ColorMap>,
    /// The texel value of no displacement.
    pub zero: f32,
    /// Height of a texel step from 0 to 1, in model units.
    pub scale: f32,
    /// N, parts of each side of a triangle.
    pub subdivisions: u32,
    /// Unit vector from the model to the camera.
    pub view: Vec3,
    /// What the camera shows upwards.
    pub up: Vec3,
    /// Its lights.
    pub lights: Vec<PointLight>,
}

/// The names that [`load`] knows, as they are written on the command line.
pub const NAMES: [&str; 4] = ["builtin:cube", "builtin:quilt", "builtin:knot", "builtin:mushroom"];

/// The scene of that name, `None` where there is none. The same on every call.
pub fn load(name: &str) -> Option<BuiltinScene> {
    match name {
        "builtin:cube" => Some(cube::scene()),
        "builtin:quilt" => Some(quilt::scene()),
        "builtin:knot" => Some(knot::scene()),
        "builtin:mushroom" => Some(mushroom::scene()),
        _ => None,
    }
}

/// A light that gives the irradiance `strength` where it faces a surface at the origin.
fn light(position: Vec3, strength: f32, color: Vec3) -> PointLight {
    PointLight { position, intensity: strength * position.length_squared(), color, padding: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::wrap;
    use emboss_kernels::texture::{HeightTexels, Level, LevelOfDetail};
    use glam::Vec2;
    use std::collections::HashMap;
    use std::sync::LazyLock;

    /// Made once for all tests, since its maps take a while.
    static KNOT: LazyLock<BuiltinScene> = LazyLock::new(knot::scene);

    /// How often each edge, by the bits of its ends' positions, is run through in each direction.
    fn directed_edges(mesh: &Mesh) -> HashMap<[[u32; 3]; 2], u32> {
        let mut edges = HashMap::new();
        for triangle in &mesh.triangles {
            let [a, mut b, mut c] = triangle.vertices.map(|v| mesh.vertices[v as usize].position);
            if triangle.flags != 0 {
                (b, c) = (c, b);
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry([from, to].map(|p| p.to_array().map(f32::to_bits))).or_default() += 1;
            }
        }
        edges
    }

    /// The volume inside a closed mesh, negative where it is inside out.
    fn volume(mesh: &Mesh) -> f32 {
        let six_fold: f32 = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.vertices.map(|v| mesh.vertices[v as usize].position);
                let volume = a.dot(b.cross(c));
                if triangle.flags == 0 { volume } else { -volume }
            })
            .sum();
        six_fold / 6.0
    }

    fn assert_closed(mesh: &Mesh) {
        let edges = directed_edges(mesh);
        for ([from, to], count) in &edges {
            assert_eq!((*count, edges.get(&[*to, *from])), (1, Some(&1)), "{from:?} {to:?}");
        }
    }

    #[test]
    fn every_name_loads_and_no_other() {
        for name in NAMES {
            let scene = load(name).unwrap_or_else(|| panic!("{name} is listed but unknown"));
            assert_eq!(scene.mesh.dropped, 0, "{name}");
            assert!(scene.view.is_normalized() && !scene.lights.is_empty(), "{name}");
            let (min, max) = scene.height.range;
            assert!((0.0..0.1).contains(&min) && (0.9..=1.0).contains(&max), "{name} uses {min} to {max}");
            for vertex in &scene.mesh.vertices {
                assert!(vertex.normal.is_normalized(), "{name} {vertex:?}");
            }
        }
        assert!(load("builtin:teapot").is_none());
    }

    #[test]
    fn the_cube_is_closed_with_split_normals() {
        let mesh = cube::scene().mesh;
        assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (12, 24));
        assert_closed(&mesh);
        assert!((volume(&mesh) - 8.0).abs() < 1e-5);
        for vertex in &mesh.vertices {
            assert_eq!(vertex.position.dot(vertex.normal), 1.0, "{vertex:?}");
            assert!([0.0, 1.0].contains(&vertex.u) && [0.0, 1.0].contains(&vertex.v));
        }
    }

    #[test]
    fn the_cubes_relief_is_the_product_of_sines() {
        let map = cube::scene().height;
        for (x, y) in [(0, 0), (51, 51), (100, 300), (511, 17)] {
            let [u, v] = [x, map.height - 1 - y].map(|i: u32| (f64::from(i) + 0.5) / 512.0);
            let expected =
                ((5.0 * std::f64::consts::PI * u).sin() * (5.0 * std::f64::consts::PI * v).sin()).abs();
            // Half a code of 16 bits, and the rounding of f32 sines.
            assert!((f64::from(map.texel(x, y)) - expected).abs() < 0.5 / 65535.0 + 4e-6, "{x} {y}");
        }
    }

    #[test]
    fn the_quilt_is_a_square_that_faces_z() {
        let mesh = quilt::scene().mesh;
        assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (2, 4));
        for vertex in &mesh.vertices {
            assert_eq!(vertex.normal, Vec3::Z);
            assert_eq!(vertex.position, Vec3::new(4.0 * vertex.u - 2.0, 4.0 * vertex.v - 2.0, 0.0));
        }
    }

    #[test]
    fn the_knot_is_closed_and_right_side_out() {
        let mesh = &KNOT.mesh;
        assert!((2400..2600).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());
        assert_closed(mesh);
        assert!(volume(mesh) > 0.0);
    }

    #[test]
    fn the_knots_seams_agree_in_position_and_normal() {
        let mesh = &KNOT.mesh;
        let mut normals = HashMap::new();
        let mut split = 0;
        for vertex in &mesh.vertices {
            let before = normals
                .insert(vertex.position.to_array().map(f32::to_bits), (vertex.normal, vertex.u, vertex.v));
            if let Some((normal, u, v)) = before {
                split += 1;
                assert_eq!(normal, vertex.normal);
                // Texture coordinates differ by whole maps, so that wrapping gives the same texels.
                assert_eq!([(u - vertex.u).fract(), (v - vertex.v).fract()], [0.0, 0.0], "{vertex:?}");
            }
        }
        assert!(split > 100, "the seams have {split} vertices in all");
    }

    /// Greatest step between neighbours in a row, `x` to `x + 1`, and between those across the seam.
    fn steps(map: &HeightMap, size: u32, texel: impl Fn(u32, u32) -> f32) -> (f32, f32) {
        let across = map.width * map.height / size;
        let step =
            |i: u32, j: u32| (0..across).map(|k| (texel(i, k) - texel(j, k)).abs()).fold(0.0, f32::max);
        let inside = (0..size - 1).map(|i| step(i, i + 1)).fold(0.0, f32::max);
        (inside, step(size - 1, 0))
    }

    #[test]
    fn the_knots_relief_tiles_in_both_directions() {
        let map = &KNOT.height;
        let (inside, seam) = steps(map, map.width, |x, y| map.texel(x, y));
        assert!(seam <= inside, "along: {seam} at the seam, {inside} elsewhere");
        let (inside, seam) = steps(map, map.height, |y, x| map.texel(x, y));
        assert!(seam <= inside, "around: {seam} at the seam, {inside} elsewhere");
    }

    #[test]
    fn the_knots_heights_agree_across_its_seams() {
        let map = &KNOT.height;
        let texels =
            HeightTexels { texels: &map.texels, format: map.format, wrap: wrap::REPEAT, first_word: 0 };
        let height = |u, v| {
            texels.sample(Level::finest(map.width, map.height), Vec2::new(u, v), LevelOfDetail::FINEST)
        };
        for k in 0..=1000u16 {
            let along = f32::from(k) / 1000.0;
            // The same four texels with the same weights of one half: each side leaves their range by 3 ulp at most.
            let tolerance = 6.0 * f32::EPSILON;
            let (a, b) = (height(0.0, along), height(1.0, along));
            assert!((a - b).abs() <= tolerance, "v = {along}: {a} {b}");
            let (a, b) = (height(along, 0.0), height(along, 1.0));
            assert!((a - b).abs() <= tolerance, "u = {along}: {a} {b}");
        }
    }
}
