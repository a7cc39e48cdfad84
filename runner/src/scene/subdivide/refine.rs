//! One level of subdivision.

use super::Scheme;
use super::cage::{Cage, Corner, index};
use super::topology::{Rule, Topology};
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Positions, or texture coordinates, by corner.
pub(super) type Values<'a> = &'a dyn Fn(u32) -> DVec3;

/// The control mesh of the next level: its vertices are those of this one, then of Catmull-Clark one for each face,
/// then one for each edge.
pub(super) fn refined(cage: &Cage, topology: &Topology, scheme: Scheme) -> Cage {
    let position = |c: u32| cage.positions[cage.corners[c as usize].vertex as usize];
    let uv = |c: u32| cage.uvs[cage.corners[c as usize].uv as usize];
    let mut finer = Cage { dropped: cage.dropped, ..Cage::default() };
    // Vertices.
    finer.positions = (0..cage.positions.len())
        .map(|v| match topology.corners_at(v) {
            [] => cage.positions[v],
            _ => vertex_point(cage, topology, scheme, v, &position),
        })
        .collect();
    finer.uvs.clone_from(&cage.uvs);
    for v in (0..cage.positions.len()).filter(|&v| topology.moves_uv[v]) {
        if let Some(&c) = topology.corners_at(v).first() {
            finer.uvs[cage.corners[c as usize].uv as usize] = vertex_point(cage, topology, scheme, v, &uv);
        }
    }
    // Faces.
    let (first_face, first_face_uv) = (index(finer.positions.len()), index(finer.uvs.len()));
    if scheme == Scheme::CatmullClark {
        finer.positions.extend((0..cage.faces.len()).map(|f| face_point(cage, f, &position)));
        finer.uvs.extend((0..cage.faces.len()).map(|f| face_point(cage, f, &uv)));
    }
    // Edges; at seams each side has texture coordinates of its own.
    let first_edge = index(finer.positions.len());
    let mut edge_uv: Vec<u32> = vec![0; cage.corners.len()];
    for edge in &topology.edges {
        finer.positions.push(edge_point(cage, topology, scheme, edge.sides, edge.is_sharp, &position));
        if !edge.is_seam {
            let both = index(finer.uvs.len());
            finer.uvs.push(edge_point(cage, topology, scheme, edge.sides, edge.is_sharp, &uv));
            edge.sides.iter().for_each(|&c| edge_uv[c as usize] = both);
        }
    }
    let edge_ends = |c: u32| (cage.corners[c as usize], cage.corners[topology.next(cage, c) as usize]);
    let mut at_seams: HashMap<[u32; 3], u32> = HashMap::new();
    for c in 0..index(cage.corners.len()) {
        if topology.edge_from(c).is_seam {
            let (from, to) = edge_ends(c);
            let mut ends = [from.uv, to.uv];
            ends.sort_unstable();
            // Faces that agree there, as of an edge that has three, share it.
            let key = [topology.edge_of[c as usize], ends[0], ends[1]];
            edge_uv[c as usize] = *at_seams.entry(key).or_insert_with(|| {
                finer.uvs.push((uv(c) + uv(topology.next(cage, c))) * 0.5);
                index(finer.uvs.len() - 1)
            });
        }
    }
    finer.held.clone_from(&cage.held);
    finer.held.resize(finer.positions.len(), false);
    // What each corner of a face becomes.
    let on_edge = |c: u32, crease: bool| Corner {
        vertex: first_edge + topology.edge_of[c as usize],
        uv: edge_uv[c as usize],
        crease,
    };
    for (f, face) in cage.faces.iter().enumerate() {
        let middle = Corner { vertex: first_face + index(f), uv: first_face_uv + index(f), crease: false };
        let corners: Vec<u32> = face.corners().map(index).collect();
        for &c in &corners {
            let before = topology.previous(cage, c);
            let (from, back) = (cage.corners[c as usize], cage.corners[before as usize].crease);
            let ring = [from, on_edge(c, false), middle, on_edge(before, back)];
            match scheme {
                Scheme::CatmullClark => finer.push(&ring, face.material, face.group),
                Scheme::Loop => finer.push(&[ring[0], ring[1], ring[3]], face.material, face.group),
            }
        }
        if scheme == Scheme::Loop {
            let inner: Vec<Corner> = corners.iter().map(|&c| on_edge(c, false)).collect();
            finer.push(&inner, face.material, face.group);
        }
    }
    finer
}

/// The mean of a face's corners.
fn face_point(cage: &Cage, f: usize, values: Values<'_>) -> DVec3 {
    let face = cage.faces[f];
    face.corners().map(|c| values(index(c))).sum::<DVec3>() / f64::from(face.count)
}

/// Where the new vertex of an edge is whose faces begin it at the corners `sides`.
fn edge_point(
    cage: &Cage,
    topology: &Topology,
    scheme: Scheme,
    sides: [u32; 2],
    is_sharp: bool,
    values: Values<'_>,
) -> DVec3 {
    let ends = values(sides[0]) + values(topology.next(cage, sides[0]));
    if is_sharp {
        return ends * 0.5;
    }
    match scheme {
        Scheme::CatmullClark => {
            let faces = sides.map(|c| face_point(cage, topology.face_of[c as usize] as usize, values));
            (ends + faces[0] + faces[1]) * 0.25
        }
        Scheme::Loop => {
            let opposite = sides.map(|c| values(topology.previous(cage, c)));
            ends * 0.375 + (opposite[0] + opposite[1]) * 0.125
        }
    }
}

/// Where vertex `v` of a level, which has a corner, is on the next one.
fn vertex_point(cage: &Cage, topology: &Topology, scheme: Scheme, v: usize, values: Values<'_>) -> DVec3 {
    let corners = topology.corners_at(v);
    let here = values(corners[0]);
    match topology.rules[v] {
        Rule::Corner => here,
        Rule::Crease => {
            let ends = topology.crease_ends(cage, v);
            here * 0.75 + (values(ends[0]) + values(ends[1])) * 0.125
        }
        Rule::Smooth => {
            #[expect(clippy::cast_precision_loss, reason = "a vertex has fewer than 2^52 faces")]
            let n = corners.len() as f64;
            let neighbours: DVec3 = corners.iter().map(|&c| values(topology.next(cage, c))).sum();
            match scheme {
                Scheme::CatmullClark => {
                    let face = |&c: &u32| face_point(cage, topology.face_of[c as usize] as usize, values);
                    let faces: DVec3 = corners.iter().map(face).sum();
                    // Q / n + 2 R / n + (n - 3) P / n, Q the mean of faces, R that of the edges' middles.
                    (faces / n + (here + neighbours / n) + here * (n - 3.0)) / n
                }
                Scheme::Loop => {
                    let beta = loop_beta(n);
                    here * (1.0 - n * beta) + neighbours * beta
                }
            }
        }
    }
}

/// The share of each of n neighbours in a vertex of Loop's.
pub(super) fn loop_beta(n: f64) -> f64 {
    let c = 0.375 + 0.25 * (TAU / n).cos();
    (0.625 - c * c) / n
}
