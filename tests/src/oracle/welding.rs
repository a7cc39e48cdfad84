//! Which micro-vertices triangles share, and what becomes of those where they disagree: decided here anew, from
//! vertices and triangles alone.
//!
//! A *use* is a pair of vertex and height map that some triangle has at a corner. With welding, triangle corners at
//! equal positions share one micro-vertex, and so do the points of edges between the same two positions; without, they
//! do so where they have the same use.

use super::relief::Relief;
use super::rounding::{Rounding, UNIT_ROUNDOFF};
use super::vectors::Axes;
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{Triangle, Vertex};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// Vertex and height map of a triangle's corner.
type Use = (u32, u32);

/// What one triangle reads along an edge, from the end at the lower junction to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Side {
    pub(super) start: DVec2,
    pub(super) end: DVec2,
    pub(super) map: u32,
    /// What vectors are along at both ends; the same everywhere where they are along x, y and z, or there are none.
    pub(super) axes: [Axes; 2],
    /// How large texels are at both ends, and how many of them a pixel covers at the most.
    pub(super) texels: [DVec2; 2],
}

/// What triangles that disagree at a place have in common there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decided {
    /// Of a mean normal, which f32 rounds once.
    pub(super) direction: DVec3,
    pub(super) height: f64,
    pub(super) height_error: f64,
}

/// The common points of a mesh's triangles.
#[derive(Debug, Default)]
pub(super) struct Welding {
    /// The number of each use's common point.
    junctions: BTreeMap<Use, u32>,
    /// Those of several uses.
    decided: BTreeMap<u32, Decided>,
    /// The different readings at those of several uses, as sides of no length.
    readings: BTreeMap<u32, Vec<Side>>,
    /// Edges by their junctions, the lower one first, whose triangles do not all have the same uses there: their
    /// different sides.
    seams: BTreeMap<(u32, u32), Vec<Side>>,
}

impl Welding {
    /// Finds the junctions of the first `count` triangles; without `welded` none is decided and no edge is a seam.
    pub(super) fn new(
        buffers: &SceneBuffers,
        reliefs: &[Relief],
        count: u32,
        welded: bool,
        rounding: Rounding,
    ) -> Welding {
        let triangles = &buffers.triangles[..count as usize];
        let uses: BTreeSet<Use> = triangles.iter().flat_map(uses).collect();
        if !welded {
            return Welding { junctions: uses.into_iter().zip(0..).collect(), ..Welding::default() };
        }
        let vertex = |(v, _): Use| buffers.vertices[v as usize];
        let mut places: BTreeMap<[u32; 3], Vec<Use>> = BTreeMap::new();
        for one in uses {
            // Adding 0 turns -0 into 0.
            let place = vertex(one).position.to_array().map(|x| (x + 0.0).to_bits());
            places.entry(place).or_default().push(one);
        }
        let mut welding = Welding::default();
        for (uses, junction) in places.into_values().zip(0..) {
            welding.junctions.extend(uses.iter().map(|&one| (one, junction)));
            if uses.len() > 1 {
                let corners: Vec<(Vertex, u32)> = uses.iter().map(|&one| (vertex(one), one.1)).collect();
                welding.decided.insert(junction, decide(&corners, reliefs, rounding));
                welding.readings.insert(junction, different(buffers, uses.iter().map(|&one| [one, one])));
            }
        }
        welding.seams = welding.seams(buffers, triangles);
        welding
    }

    /// The common point that a triangle's corner at `vertex` belongs to.
    pub(super) fn junction(&self, vertex: u32, map: u32) -> u32 {
        self.junctions[&(vertex, map)]
    }

    /// What is decided at a junction.
    pub(super) fn decided(&self, junction: u32) -> Option<&Decided> {
        self.decided.get(&junction)
    }

    /// The different readings at a junction where triangles disagree.
    pub(super) fn readings(&self, junction: u32) -> Option<&[Side]> {
        self.readings.get(&junction).map(Vec::as_slice)
    }

    /// The different sides of the edge between two junctions, the lower one first; `None` where triangles agree.
    pub(super) fn sides(&self, a: u32, b: u32) -> Option<&[Side]> {
        self.seams.get(&(a, b)).map(Vec::as_slice)
    }

    fn seams(&self, buffers: &SceneBuffers, triangles: &[Triangle]) -> BTreeMap<(u32, u32), Vec<Side>> {
        let mut edges: BTreeMap<(u32, u32), BTreeSet<[Use; 2]>> = BTreeMap::new();
        for triangle in triangles {
            let [a, b, c] = uses(triangle);
            for mut ends in [[a, b], [b, c], [a, c]] {
                ends.sort_by_key(|end| self.junctions[end]);
                let [start, end] = ends.map(|end| self.junctions[&end]);
                edges.entry((start, end)).or_default().insert(ends);
            }
        }
        edges.retain(|_, uses| uses.len() > 1);
        edges.into_iter().map(|(ends, uses)| (ends, different(buffers, uses.into_iter()))).collect()
    }
}

/// The different sides between the ends of each pair, each once.
fn different(buffers: &SceneBuffers, uses: impl Iterator<Item = [Use; 2]>) -> Vec<Side> {
    let mut sides: Vec<Side> = Vec::new();
    for ends in uses {
        let [start, end] = ends.map(|(v, _)| uv(&buffers.vertices[v as usize]));
        let axes = ends.map(|(v, _)| Axes::of_vertex(buffers, v));
        let texels = ends.map(|(v, _)| texel_scale(buffers, v));
        let side = Side { start, end, map: ends[0].1, axes, texels };
        if !sides.contains(&side) {
            sides.push(side);
        }
    }
    sides
}

/// Texture coordinates of a vertex.
pub(super) fn uv(vertex: &Vertex) -> DVec2 {
    DVec2::new(f64::from(vertex.u), f64::from(vertex.v))
}

/// The size of texels at a vertex, and how many of them a pixel covers at the most, where the host says it.
pub(super) fn texel_scale(buffers: &SceneBuffers, vertex: u32) -> DVec2 {
    buffers
        .texel_scales
        .get(vertex as usize)
        .map_or(DVec2::ONE, |scale| DVec2::new(f64::from(scale.size), f64::from(scale.span)))
}

fn uses(triangle: &Triangle) -> [Use; 3] {
    triangle.vertices.map(|v| (v, triangle.displacement))
}

/// What corners at one place, in order of their vertices, agree on: the mean of their different normals, or the first
/// where these cancel; the mean of the heights of their different texture coordinates and maps. The program takes
/// it of f32 heights in f64 and rounds it once.
fn decide(corners: &[(Vertex, u32)], reliefs: &[Relief], rounding: Rounding) -> Decided {
    let (mut normals, mut readings) = (Vec::new(), Vec::new());
    for (vertex, map) in corners {
        let (normal, reading) = (vertex.normal.as_dvec3(), (uv(vertex), *map));
        if !normals.contains(&normal) {
            normals.push(normal);
        }
        if !readings.contains(&reading) {
            readings.push(reading);
        }
    }
    let sum: DVec3 = normals.iter().sum();
    // Opposite unit vectors of f32 cancel to a few u.
    let cancelled = sum.length() < 1e-6 * normals.len() as f64;
    let direction = if normals.len() == 1 || cancelled { normals[0] } else { sum.normalize() };
    let mean = |of: &dyn Fn(&Relief, DVec2) -> f64| {
        readings.iter().map(|&(uv, map)| of(&reliefs[map as usize], uv)).sum::<f64>() / readings.len() as f64
    };
    let height = mean(&|relief, uv| relief.height(uv));
    let error = mean(&|relief, uv| relief.height_error(uv.abs(), rounding));
    Decided { direction, height, height_error: error + UNIT_ROUNDOFF * height.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::{Displacement, height_format, wrap};
    use glam::Vec3;

    /// Two triangles at the edge (0,0,0)-(0,1,0), which agree on nothing there, and one that shares (0,0,0) and (1,0,0)
    /// with the first. The first map is twice u, the second 10 throughout.
    fn folded(welded: bool) -> (Welding, SceneBuffers) {
        let vertex = |x: f32, y: f32, normal: Vec3, u: f32| Vertex {
            position: Vec3::new(x, y, if u > 0.5 { 0.0 } else { -0.0 }),
            normal,
            u,
            v: 0.5,
        };
        let vertices = vec![
            vertex(0.0, 0.0, Vec3::X, 0.5),
            vertex(0.0, 0.0, Vec3::Y, 0.75),
            vertex(0.0, 1.0, Vec3::Z, 0.25),
            vertex(0.0, 1.0, -Vec3::Z, 0.5),
            vertex(1.0, 0.0, Vec3::Z, 0.5),
            vertex(-1.0, 0.0, Vec3::Z, 0.5),
            vertex(0.0, -1.0, Vec3::Z, 0.5),
        ];
        let triangle = |vertices, displacement| Triangle { vertices, displacement, ..Triangle::default() };
        let map = |first_word, width| Displacement {
            scale: 1.0,
            map_width: width,
            map_height: 1,
            first_word,
            format: height_format::FLOAT32,
            wrap: wrap::CLAMP,
            ..Displacement::default()
        };
        let buffers = SceneBuffers {
            vertices,
            triangles: vec![triangle([0, 2, 4], 0), triangle([1, 3, 5], 1), triangle([0, 4, 6], 0)],
            displacements: vec![map(0, 2), map(2, 1)],
            height_texels: [0.5_f32, 1.5, 10.0].map(f32::to_bits).to_vec(),
            ..SceneBuffers::default()
        };
        let reliefs: Vec<Relief> =
            buffers.displacements.iter().map(|map| Relief::new(&buffers, map, false)).collect();
        (Welding::new(&buffers, &reliefs, 3, welded, Rounding::IEEE), buffers)
    }

    #[test]
    fn corners_that_disagree_take_means() {
        let (welding, _) = folded(true);
        let [a, b] = [(0, 0), (1, 1)].map(|(vertex, map)| welding.junction(vertex, map));
        assert_eq!(a, b);
        let corner = welding.decided(a).expect("two vertices stand there");
        assert!((corner.direction - DVec3::new(0.5, 0.5, 0.0).normalize()).length() < 1e-15);
        assert_eq!(corner.height, (1.0 + 10.0) / 2.0);
        let cancelling = welding.decided(welding.junction(3, 1)).expect("two vertices stand there");
        assert_eq!((cancelling.direction, cancelling.height), (DVec3::Z, (0.5 + 10.0) / 2.0));
        assert!(welding.decided(welding.junction(4, 0)).is_none());
    }

    #[test]
    fn edge_whose_triangles_disagree_is_a_seam_of_both() {
        let (welding, _) = folded(true);
        let [mut ends, shared] =
            [[(0, 0), (2, 0)], [(0, 0), (4, 0)]].map(|ends| ends.map(|(v, map)| welding.junction(v, map)));
        let start_first = ends[0] < ends[1];
        ends.sort_unstable();
        let side = |start: f64, end: f64, map| {
            let [start, end] = [start, end].map(|u| DVec2::new(u, 0.5));
            let [start, end] = if start_first { [start, end] } else { [end, start] };
            Side { start, end, map, axes: [Axes::XYZ; 2], texels: [DVec2::ONE; 2] }
        };
        assert_eq!(welding.sides(ends[0], ends[1]), Some(&[side(0.5, 0.25, 0), side(0.75, 0.5, 1)][..]));
        assert_eq!(welding.sides(shared[0].min(shared[1]), shared[0].max(shared[1])), None);
    }

    #[test]
    fn unwelded_corners_are_shared_by_the_same_vertex_and_map_alone() {
        let (welding, buffers) = folded(false);
        let uses: BTreeSet<Use> = buffers.triangles.iter().flat_map(uses).collect();
        let junctions: BTreeSet<u32> = uses.iter().map(|&(v, map)| welding.junction(v, map)).collect();
        assert_eq!(junctions.len(), uses.len());
        assert!(junctions.iter().all(|&junction| welding.decided(junction).is_none()));
        assert!(welding.seams.is_empty());
    }
}
