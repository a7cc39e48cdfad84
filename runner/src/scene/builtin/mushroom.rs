//! `builtin:mushroom`: a knoll on which mushrooms grow. Their caps hang over, as no height map's relief can: each is
//! the ground around its foot, drawn in to a stem and out again to a cap by a vector map.

use super::{BuiltinScene, light};
use crate::scene::noise::{Lattice, lerp, mix, smoothstep, unit};
use crate::scene::{ColorMap, HeightMap, Mesh, image::per_texel};
use emboss_kernels::interface::Vertex;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_PI_2;

/// Texels of a side of the maps.
const MAP_SIDE: u32 = 1024;
/// Squares along a side of the mesh.
const SQUARES: u16 = 6;
/// Side of the mesh in model units.
const SIDE: f32 = 4.0;
/// Cells along a side of the map; in each stands a mushroom, or none.
const CELLS: u32 = 4;
/// Height of a mushroom, in radii of the patch that it grows from.
const HEIGHT: f32 = 1.5;
/// Greatest radius of such a patch, as a share of the map.
const LARGEST: f32 = 0.115;
/// Model units of the greatest height, which is 1 in the map.
const SCALE: f32 = LARGEST * SIDE * HEIGHT;

/// A point of the profile of a mushroom, in radii of its patch.
struct Profile {
    /// Distance from its axis.
    radius: f32,
    height: f32,
    part: Part,
}

#[derive(Clone, Copy, PartialEq)]
enum Part {
    Ground,
    Stem,
    Gills,
    Cap,
}

/// Where the profile turns, in shares of the way from the patch's rim to its middle: radius and height there, and what
/// comes next. The cap, last, is a dome.
const TURNS: [(f32, f32, f32, Part); 5] = [
    (0.0, 1.0, 0.0, Part::Ground),
    (0.16, 0.3, 0.0, Part::Stem),
    (0.42, 0.18, 0.95, Part::Gills),
    (0.6, 0.84, 0.72, Part::Cap),
    (0.66, 0.88, 0.86, Part::Cap),
];

/// A square sheet over the xy plane that rises towards its middle.
pub(super) fn scene() -> BuiltinScene {
    let texels = per_texel(MAP_SIDE, MAP_SIDE, |u, v| texel(Vec2::new(u, v)));
    let map = |axis: usize| HeightMap::from_floats(MAP_SIDE, MAP_SIDE, texels.iter().map(|t| t.0[axis]));
    BuiltinScene {
        mesh: mesh(),
        height: map(2),
        sideways: Some([map(0), map(1)]),
        color: Some(ColorMap::from_linear(MAP_SIDE, MAP_SIDE, texels.iter().map(|t| t.1))),
        zero: 0.0,
        scale: SCALE,
        subdivisions: 96,
        view: Vec3::new(0.15, -1.0, 0.3).normalize(),
        up: Vec3::Z,
        lights: vec![light(Vec3::new(-3.0, -3.5, 4.5), 1.0, Vec3::new(1.0, 0.95, 0.86))],
    }
}

/// Shared vertices, so that normals and tangents turn smoothly; the whole map once.
fn mesh() -> Mesh {
    let line = 0..=SQUARES;
    let share = |i: u16| f32::from(i) / f32::from(SQUARES);
    let vertices: Vec<Vertex> =
        line.clone().flat_map(|j| line.clone().map(move |i| ground(Vec2::new(share(i), share(j))))).collect();
    let (squares, across) = (u32::from(SQUARES), u32::from(SQUARES) + 1);
    let corners = (0..squares).flat_map(|j| (0..squares).map(move |i| j * across + i));
    let triangles: Vec<[u32; 3]> =
        corners.flat_map(|a| [[a, a + 1, a + 1 + across], [a, a + 1 + across, a + across]]).collect();
    Mesh::from_triangles(&vertices, &triangles)
}

/// The ground at texture coordinates `uv`: z = (1 - x²/4)(1 - y²/4) / 2.
fn ground(uv: Vec2) -> Vertex {
    let p = SIDE * (uv - 0.5);
    let (a, b) = (1.0 - p.x * p.x / 4.0, 1.0 - p.y * p.y / 4.0);
    let slope = Vec2::new(p.x * b, p.y * a) / 4.0;
    Vertex { position: p.extend(0.5 * a * b), u: uv.x, normal: slope.extend(1.0).normalize(), v: uv.y }
}

/// The vector (along u, along v, along the normal) and the linear colour at a point of the map.
fn texel(uv: Vec2) -> (Vec3, Vec3) {
    let moss = Lattice::new(24, 24, 5).fractal(uv * 24.0, 4);
    let bumps = 0.025 * (1.0 + moss).clamp(0.0, 2.0);
    let cell = (uv * CELLS as f32).floor();
    let (hash, chosen) = mushroom_in(cell);
    let [turn, size, hue] = [1, 2, 3].map(|i| unit(mix(hash + i)));
    let radius = LARGEST * lerp(0.6, 1.0, size);
    // Anywhere in its cell that keeps its patch within.
    let room = 0.5 / CELLS as f32 - radius;
    let middle = (cell + 0.5) / CELLS as f32 + room * Vec2::new(2.0 * turn - 1.0, 2.0 * hue - 1.0);
    let from_middle = uv - middle;
    let share = from_middle.length() / radius;
    let ground_color = Vec3::new(0.05, 0.11, 0.02).lerp(Vec3::new(0.13, 0.2, 0.035), 0.5 + 0.5 * moss);
    if !chosen || share >= 1.0 {
        return (Vec3::new(0.0, 0.0, bumps), ground_color);
    }
    let profile = profile(1.0 - share);
    let outward = from_middle.normalize_or(Vec2::X);
    let to_model = radius * SIDE / SCALE;
    let sideways = outward * ((profile.radius - share) * to_model);
    let on_ground = smoothstep(0.45, 0.0, profile.height);
    let height = profile.height * to_model + bumps * on_ground * smoothstep(0.3, 1.0, profile.radius);
    (sideways.extend(height), color(&profile, outward, hue, ground_color))
}

/// A cell's random number, and whether a mushroom stands in it.
fn mushroom_in(cell: Vec2) -> (u32, bool) {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells of the map")]
    let number = cell.y as u32 * CELLS + cell.x as u32;
    let hash = mix(number + 40);
    (hash, unit(hash) < 0.75)
}

/// The profile at a share of the way from the rim of its patch to the middle.
fn profile(way: f32) -> Profile {
    let (last, dome_radius, dome_height, _) = TURNS[TURNS.len() - 1];
    if way >= last {
        let (sin, cos) = (FRAC_PI_2 * (way - last) / (1.0 - last)).sin_cos();
        let height = lerp(dome_height, HEIGHT, sin);
        return Profile { radius: dome_radius * cos, height, part: Part::Cap };
    }
    let next = TURNS.iter().position(|turn| way < turn.0).unwrap_or(1);
    let ((start, r0, h0, part), (end, r1, h1, _)) = (TURNS[next - 1], TURNS[next]);
    let s = (way - start) / (end - start);
    Profile { radius: lerp(r0, r1, s), height: lerp(h0, h1, s), part }
}

/// Red caps with white warts, pale stems and gills.
fn color(profile: &Profile, outward: Vec2, hue: f32, ground: Vec3) -> Vec3 {
    let pale = Vec3::new(0.72, 0.62, 0.45);
    match profile.part {
        Part::Ground => ground.lerp(pale, smoothstep(0.5, 0.3, profile.radius)),
        Part::Stem => pale,
        Part::Gills => {
            let gills = (60.0 * outward.y.atan2(outward.x)).sin();
            Vec3::new(0.5, 0.38, 0.26) * (1.0 + 0.25 * gills)
        }
        Part::Cap => {
            let red = Vec3::new(0.45, 0.03, 0.015).lerp(Vec3::new(0.5, 0.14, 0.02), hue);
            let warts = Lattice::new(64, 64, 9).cellular((outward * profile.radius + 2.0) * 5.0);
            red.lerp(Vec3::new(0.8, 0.74, 0.62), smoothstep(0.32, 0.42, warts.border))
        }
    }
}
