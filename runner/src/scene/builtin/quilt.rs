//! `builtin:quilt`: two triangles that carry a buttoned upholstery.

use super::{BuiltinScene, light};
use crate::scene::noise::{Lattice, lerp, smoothstep};
use crate::scene::{ColorMap, HeightMap, Mesh, image::per_texel};
use emboss_kernels::interface::Vertex;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Texels of a side of the maps.
const MAP_SIDE: u32 = 1024;
/// Diamonds along a side of the map; whole, so that the map tiles.
const DIAMONDS: f32 = 4.0;
/// Radius of a button, in widths of a diamond.
const BUTTON: f32 = 0.1;

/// A square of side 4 in the xy plane that faces +z.
pub(super) fn scene() -> BuiltinScene {
    let texels = per_texel(MAP_SIDE, MAP_SIDE, |u, v| texel(Vec2::new(u, v)));
    let view = Vec3::new(0.0, -0.75, 0.9).normalize();
    BuiltinScene {
        mesh: mesh(),
        height: HeightMap::from_unit(MAP_SIDE, MAP_SIDE, texels.iter().map(|t| t.0)),
        sideways: None,
        color: Some(ColorMap::from_linear(MAP_SIDE, MAP_SIDE, texels.iter().map(|t| t.1))),
        zero: 0.0,
        scale: 0.3,
        subdivisions: 512,
        view,
        up: Vec3::Y,
        lights: vec![light(Vec3::new(-3.5, 2.5, 3.0), 1.0, Vec3::new(1.0, 0.96, 0.9))],
    }
}

/// Two triangles with the whole map.
fn mesh() -> Mesh {
    let vertices = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| Vertex {
        position: Vec3::new(4.0 * u - 2.0, 4.0 * v - 2.0, 0.0),
        u,
        normal: Vec3::Z,
        v,
    });
    Mesh::from_triangles(&vertices, &[[0, 1, 2], [0, 2, 3]])
}

/// Height and linear colour at a point of the map.
fn texel(uv: Vec2) -> (f32, Vec3) {
    // Along the diamonds' sides, whole numbers at the seams.
    let p = DIAMONDS * Vec2::new(uv.x + uv.y, uv.x - uv.y);
    let to_button = (p - p.round()).length();
    let pillow = pillow(p, to_button) + grain(uv);
    let button = button(to_button);
    let is_button = smoothstep(BUTTON * 1.06, BUTTON, to_button);
    let height = lerp(pillow, button, is_button);
    (height.clamp(0.0, 1.0), leather(uv, pillow, p).lerp(brass(to_button), is_button))
}

/// A cushion between seams, drawn in at the buttons of its corners, with stitches along the seams.
fn pillow(p: Vec2, to_button: f32) -> f32 {
    let bulge = ((PI * p.x).sin() * (PI * p.y).sin()).abs().powf(0.45);
    let dent = 1.0 - (-(to_button / 0.3).powi(2)).exp();
    0.06 + 0.88 * bulge * lerp(0.55, 1.0, dent) + stitches(p, to_button)
}

/// A row of stitches on both sides of each seam, none near the buttons.
fn stitches(p: Vec2, to_button: f32) -> f32 {
    let along_x = stitch((p.y - p.y.round()).abs(), p.x);
    let along_y = stitch((p.x - p.x.round()).abs(), p.y);
    0.05 * along_x.max(along_y) * smoothstep(0.16, 0.22, to_button)
}

/// The thread at a distance from a seam, at a place along it: 0 to 1.
fn stitch(from_seam: f32, along: f32) -> f32 {
    let thread = smoothstep(0.014, 0.0, (from_seam - 0.055).abs());
    thread * smoothstep(-0.2, 0.3, (TAU * 12.0 * along).sin())
}

/// A flat dome with a rim, sunk to the level of the dents.
fn button(to_button: f32) -> f32 {
    let r = (to_button / BUTTON).min(1.0);
    let dome = (1.0 - r * r).sqrt();
    0.1 + 0.26 * dome.powf(0.7) - 0.05 * smoothstep(0.14, 0.06, (r - 0.62).abs())
}

/// The fine grain of leather: the borders of small cells.
fn grain(uv: Vec2) -> f32 {
    let cells = Lattice::new(96, 96, 11);
    0.012 * smoothstep(0.0, 0.22, cells.cellular(uv * 96.0).border)
}

/// Dark red leather, worn lighter on the cushions' crests.
fn leather(uv: Vec2, height: f32, p: Vec2) -> Vec3 {
    let patina = Lattice::new(5, 5, 3).fractal(uv * 5.0, 4);
    let crest = smoothstep(0.15, 1.0, height) + 0.25 * patina;
    let leather = Vec3::new(0.055, 0.008, 0.007).lerp(Vec3::new(0.36, 0.05, 0.028), crest.clamp(0.0, 1.0));
    let thread = stitch((p.y - p.y.round()).abs(), p.x).max(stitch((p.x - p.x.round()).abs(), p.y));
    let off_button = smoothstep(0.16, 0.22, (p - p.round()).length());
    leather.lerp(Vec3::new(0.62, 0.42, 0.2), 0.8 * thread * off_button)
}

/// Brass, tarnished towards its rim.
fn brass(to_button: f32) -> Vec3 {
    Vec3::new(0.72, 0.47, 0.16).lerp(Vec3::new(0.3, 0.17, 0.05), smoothstep(0.3, 1.0, to_button / BUTTON))
}
