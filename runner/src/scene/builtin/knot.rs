//! `builtin:knot`: a trefoil knot grown over with pebbles, the scene that shows what the program is for.

use super::{BuiltinScene, light};
use crate::scene::noise::{Cell, Lattice, Table, fractal_of, lerp, mix, smoothstep, unit};
use crate::scene::{ColorMap, HeightMap, Mesh, image::per_texel};
use emboss_kernels::interface::Vertex;
use glam::{DQuat, DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

/// Cross-sections of the tube.
const SECTIONS: u32 = 104;
/// Vertices of a cross-section; with as many sections the quads are about square.
const SIDES: u32 = 12;
/// Radius of the tube.
const TUBE: f64 = 0.3;
/// Radius of the circle round which the knot's torus runs.
const TORUS: f64 = 1.12;
/// Radius of the knot's torus: strands pass each other at twice this, which leaves room for their relief.
const WINDING: f64 = 0.5;

/// Texels along the tube: nine times those around it, as the tube's length is to its circumference.
const MAP_WIDTH: u32 = 9 * MAP_HEIGHT;
/// Texels around the tube.
const MAP_HEIGHT: u32 = 384;
/// Map coordinates of the patterns: cells along and around the tube, of the same size in both directions.
const CELLS: Vec2 = Vec2::new(9.0, 1.0);

/// A trefoil knot of about 2,500 triangles whose maps run once along the tube and once around it.
pub(super) fn scene() -> BuiltinScene {
    let patterns = Patterns::new();
    let texels = per_texel(MAP_WIDTH, MAP_HEIGHT, |u, v| patterns.texel(Vec2::new(u, v)));
    BuiltinScene {
        mesh: mesh(),
        height: HeightMap::from_unit(MAP_WIDTH, MAP_HEIGHT, texels.iter().map(|t| t.0)),
        sideways: None,
        color: Some(ColorMap::from_linear(MAP_WIDTH, MAP_HEIGHT, texels.iter().map(|t| t.1))),
        zero: 0.5,
        scale: 0.2,
        subdivisions: 32,
        view: Vec3::new(0.1, -0.35, 1.0).normalize(),
        up: Vec3::Y,
        lights: vec![
            light(Vec3::new(-3.5, 4.5, 5.0), 1.0, Vec3::new(1.0, 0.95, 0.86)),
            light(Vec3::new(5.0, -1.0, 2.5), 0.3, Vec3::new(0.6, 0.75, 1.0)),
        ],
    }
}

/// The tube: sections at equal distances along the knot, in frames that turn as little as they can.
fn mesh() -> Mesh {
    let sections = sections();
    let mut vertices = Vec::new();
    for i in 0..=SECTIONS {
        let section = &sections[(i % SECTIONS) as usize];
        vertices.extend((0..=SIDES).map(|j| {
            // The last vertex of a section, and the last section, are the first again but for their coordinates.
            let normal = section.direction(f64::from(j % SIDES) / f64::from(SIDES));
            Vertex {
                position: (section.center + TUBE * normal).as_vec3(),
                u: i as f32 / SECTIONS as f32,
                normal: normal.as_vec3(),
                v: j as f32 / SIDES as f32,
            }
        }));
    }
    let triangles: Vec<[u32; 3]> = (0..SECTIONS)
        .flat_map(|i| (0..SIDES).map(move |j| i * (SIDES + 1) + j))
        .flat_map(|a| {
            let (b, c, d) = (a + SIDES + 1, a + SIDES + 2, a + 1);
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh::from_triangles(&vertices, &triangles)
}

/// A cross-section of the tube.
struct Section {
    center: DVec3,
    tangent: DVec3,
    /// Where v = 0 is, perpendicular to the tangent.
    side: DVec3,
}

impl Section {
    /// The outward direction at a share of the way around.
    fn direction(&self, v: f64) -> DVec3 {
        let (sin, cos) = (TAU * v).sin_cos();
        self.side * cos + self.side.cross(self.tangent) * sin
    }

    /// The section with its side turned about the tangent.
    fn turned(self, angle: f64) -> Self {
        Self { side: DQuat::from_axis_angle(self.tangent, angle) * self.side, ..self }
    }

    /// The section at another centre and tangent whose side turns least on the way: the double reflection of
    /// Wang, Jüttler, Zheng and Liu 2008.
    fn carried(&self, center: DVec3, tangent: DVec3) -> Self {
        let step = (center - self.center).normalize();
        let reflected = |v: DVec3, n: DVec3| v - 2.0 * v.dot(n) * n;
        let half = (tangent - reflected(self.tangent, step)).normalize();
        Self { center, tangent, side: reflected(reflected(self.side, step), half) }
    }
}

/// The sections, at equal distances. The turn by which the last frame misses the first is shared out evenly.
fn sections() -> Vec<Section> {
    let parameters = equidistant_parameters();
    let start = curve(0.0);
    let tangent = curve_tangent(0.0);
    let mut sections = vec![Section { center: start, tangent, side: tangent.any_orthonormal_vector() }];
    for &t in &parameters[1..] {
        let next = sections[sections.len() - 1].carried(curve(t), curve_tangent(t));
        sections.push(next);
    }
    let back = sections[sections.len() - 1].carried(start, tangent);
    let miss = back.side.cross(sections[0].side).dot(tangent).atan2(back.side.dot(sections[0].side));
    let share = miss / f64::from(SECTIONS);
    sections.into_iter().zip(0..).map(|(section, i)| section.turned(share * f64::from(i))).collect()
}

/// The knot's point at a parameter of period 1: twice about the axis, three times about the torus.
fn curve(t: f64) -> DVec3 {
    let (sin2, cos2) = (2.0 * TAU * t).sin_cos();
    let (sin3, cos3) = (3.0 * TAU * t).sin_cos();
    let radius = TORUS + WINDING * cos3;
    DVec3::new(radius * cos2, radius * sin2, WINDING * sin3)
}

/// The knot's unit tangent.
fn curve_tangent(t: f64) -> DVec3 {
    const STEP: f64 = 1e-5;
    (curve(t + STEP) - curve(t - STEP)).normalize()
}

/// Parameters of [`SECTIONS`] points at equal distances along the knot, from 0.
fn equidistant_parameters() -> Vec<f64> {
    const PIECES: u32 = 8192;
    let parameter = |i: u32| f64::from(i) / f64::from(PIECES);
    let mut lengths = vec![0.0];
    for i in 0..PIECES {
        lengths.push(lengths[i as usize] + curve(parameter(i)).distance(curve(parameter(i + 1))));
    }
    let total = lengths[PIECES as usize];
    let parameter_at = |length: f64| {
        let i = lengths.partition_point(|&l| l <= length) - 1;
        (i as f64 + (length - lengths[i]) / (lengths[i + 1] - lengths[i])) / f64::from(PIECES)
    };
    (0..SECTIONS).map(|i| parameter_at(total * f64::from(i) / f64::from(SECTIONS))).collect()
}

/// A pattern with a number of cells around the tube.
#[derive(Clone, Debug)]
struct Pattern<T> {
    scale: i32,
    table: T,
}

impl<T> Pattern<T> {
    fn new(scale: i32, seed: u32, table: impl Fn(Lattice) -> T) -> Self {
        Pattern { scale, table: table(Lattice::new(9 * scale, scale, seed)) }
    }

    /// Where a point of the map lies in it.
    fn at(&self, uv: Vec2) -> Vec2 {
        uv * CELLS * self.scale as f32
    }
}

/// What the maps are made of.
struct Patterns {
    /// Small unevenness.
    rough: Pattern<Vec<Table<Vec2>>>,
    large: Pattern<Table<Vec2>>,
    /// Those in the gaps between the large ones.
    small: Pattern<Table<Vec2>>,
    /// Of the colours along the tube.
    drift: Pattern<Vec<Table<Vec2>>>,
}

impl Patterns {
    fn new() -> Self {
        Patterns {
            rough: Pattern::new(20, 5, |lattice| lattice.fractal_table(4)),
            large: Pattern::new(7, 1, Lattice::cellular_table),
            small: Pattern::new(24, 2, Lattice::cellular_table),
            drift: Pattern::new(1, 31, |lattice| lattice.fractal_table(3)),
        }
    }

    /// Height and linear colour at a point of the map: large pebbles, small ones in the gaps between them.
    fn texel(&self, uv: Vec2) -> (f32, Vec3) {
        let rough = fractal(&self.rough, uv);
        let large = pebble(&self.large, uv, 0.05);
        let gap = 1.0 - smoothstep(0.0, 0.3, large.dome);
        // The small ones cost as much as the large ones and are seen in the gaps alone.
        let small = if gap > 0.0 { pebble(&self.small, uv, 0.02) } else { Pebble::default() };
        let bed = 0.04 + gap * 0.3 * small.dome * small.size;
        let height = (0.9 * large.dome * large.size).max(bed) + 0.05 * rough * (0.4 + 0.6 * large.dome);
        let drift = 0.46 + 1.0 * fractal(&self.drift, uv) + 0.4 * (large.tone - 0.5);
        ((height + 0.02).clamp(0.0, 1.0), color(drift, &large, &small, gap, rough))
    }
}

fn fractal(pattern: &Pattern<Vec<Table<Vec2>>>, uv: Vec2) -> f32 {
    fractal_of(&pattern.table, pattern.at(uv))
}

/// A pebble of a cellular pattern.
#[derive(Default)]
struct Pebble {
    /// Its profile, 0 in the gap around it to 1 on top.
    dome: f32,
    /// Its own height, to be multiplied with the profile.
    size: f32,
    /// A random number of its own, in [0,1).
    tone: f32,
}

/// The pebble at a point, half a `gap` away from the cell's border. Distances are in cells.
fn pebble(pattern: &Pattern<Table<Vec2>>, uv: Vec2, gap: f32) -> Pebble {
    let Cell { border, id } = pattern.table.cellular(pattern.at(uv));
    let rise = ((border - gap) / 0.26).clamp(0.0, 1.0);
    Pebble {
        dome: (1.0 - (1.0 - rise).powi(2)).sqrt(),
        size: lerp(0.6, 1.0, unit(mix(id ^ 0x9e37))),
        tone: unit(mix(id ^ 0x51ed)),
    }
}

/// The linear colour: teal, jade, sand and coral drift along the tube, each pebble in its own tone, the crests
/// worn lighter and the gaps dark with their own small rust-coloured pebbles.
fn color(drift: f32, large: &Pebble, small: &Pebble, gap: f32, rough: f32) -> Vec3 {
    let stone = palette(drift.clamp(0.0, 1.0)) * (0.8 + 0.4 * large.tone);
    let crest = smoothstep(0.3, 1.0, large.dome);
    let stone = stone * lerp(0.45, 1.2, crest) + Vec3::splat(0.035) * crest * crest;
    let small = palette(0.7 + 0.3 * small.tone) * lerp(0.06, 0.75, small.dome);
    stone.lerp(small, smoothstep(0.1, 0.8, gap)) * (1.0 + 0.3 * rough)
}

/// A walk through the knot's colours, in linear light.
fn palette(t: f32) -> Vec3 {
    let stops = [
        Vec3::new(0.008, 0.075, 0.115),
        Vec3::new(0.012, 0.2, 0.2),
        Vec3::new(0.1, 0.32, 0.2),
        Vec3::new(0.5, 0.42, 0.2),
        Vec3::new(0.62, 0.26, 0.12),
    ];
    let x = t * (stops.len() - 1) as f32;
    let mut color = stops[0];
    for (i, &stop) in stops.iter().enumerate().skip(1) {
        color = color.lerp(stop, smoothstep(0.0, 1.0, x - (i - 1) as f32));
    }
    color
}
