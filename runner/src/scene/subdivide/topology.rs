//! What meets at the edges and the vertices of a control mesh.

use super::cage::{Cage, index};
use std::collections::HashMap;

/// The edges of a [`Cage`], and how each vertex moves.
pub(super) struct Topology {
    /// In order of their first use.
    pub(super) edges: Vec<Edge>,
    /// The edge from each corner to the next one of its face.
    pub(super) edge_of: Vec<u32>,
    /// The face of each corner.
    pub(super) face_of: Vec<u32>,
    /// Where the corners of each vertex begin in `corners_at`, and where the last ones end.
    starts: Vec<u32>,
    corners_at: Vec<u32>,
    /// How each vertex moves.
    pub(super) rules: Vec<Rule>,
    /// Whether texture coordinates at each vertex move as it does: they are one pair there and at all its edges, none
    /// of which is a border.
    pub(super) moves_uv: Vec<bool>,
}

/// An edge.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    /// The corners that it begins at in its faces; of more than two the first two.
    pub(super) sides: [u32; 2],
    /// How many faces it has.
    faces: u32,
    /// Whether it is a crease or counts as one.
    pub(super) is_sharp: bool,
    /// Whether it has two faces, which run along it in opposite directions.
    pub(super) is_inner: bool,
    /// Whether texture coordinates jump across it, or it has none beyond.
    pub(super) is_seam: bool,
}

/// How a vertex moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// As the surface does, with all that is around it.
    Smooth,
    /// Along its two creases.
    Crease,
    /// Not at all.
    Corner,
}

impl Topology {
    /// That of a control mesh.
    pub(super) fn new(cage: &Cage) -> Topology {
        let (edges, edge_of) = edges(cage);
        let mut face_of = vec![0; cage.corners.len()];
        for (f, face) in cage.faces.iter().enumerate() {
            face_of[face.corners()].fill(index(f));
        }
        let mut starts = vec![0; cage.positions.len() + 1];
        cage.corners.iter().for_each(|corner| starts[corner.vertex as usize + 1] += 1);
        for v in 0..cage.positions.len() {
            starts[v + 1] += starts[v];
        }
        let mut ends = starts.clone();
        let mut corners_at = vec![0; cage.corners.len()];
        for (c, corner) in cage.corners.iter().enumerate() {
            let end = &mut ends[corner.vertex as usize];
            corners_at[*end as usize] = index(c);
            *end += 1;
        }
        let mut topology =
            Topology { edges, edge_of, face_of, starts, corners_at, rules: vec![], moves_uv: vec![] };
        topology.rules = (0..cage.positions.len()).map(|v| topology.rule(cage, v)).collect();
        let moves_uv = |v| topology.edges_at(cage, v).iter().all(|&e| !topology.edges[e as usize].is_seam);
        topology.moves_uv = (0..cage.positions.len()).map(moves_uv).collect();
        topology
    }

    /// The corners at a vertex.
    pub(super) fn corners_at(&self, v: usize) -> &[u32] {
        &self.corners_at[self.starts[v] as usize..self.starts[v + 1] as usize]
    }

    /// The corner after `c` in its face.
    pub(super) fn next(&self, cage: &Cage, c: u32) -> u32 {
        index(cage.faces[self.face_of[c as usize] as usize].next(c as usize))
    }

    /// The corner before `c` in its face.
    pub(super) fn previous(&self, cage: &Cage, c: u32) -> u32 {
        index(cage.faces[self.face_of[c as usize] as usize].previous(c as usize))
    }

    /// The edge that begins at `c`.
    pub(super) fn edge_from(&self, c: u32) -> &Edge {
        &self.edges[self.edge_of[c as usize] as usize]
    }

    /// The edges at a vertex, each once.
    fn edges_at(&self, cage: &Cage, v: usize) -> Vec<u32> {
        let both = |&c: &u32| [self.edge_of[c as usize], self.edge_of[self.previous(cage, c) as usize]];
        let mut edges: Vec<u32> = self.corners_at(v).iter().flat_map(both).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// For each crease at a vertex the corner at its other end, the corners of one face.
    pub(super) fn crease_ends(&self, cage: &Cage, v: usize) -> Vec<u32> {
        let mut ends: Vec<(u32, u32)> = Vec::new();
        for &c in self.corners_at(v) {
            let (next, previous) = (self.next(cage, c), self.previous(cage, c));
            for (edge, end) in [(self.edge_of[c as usize], next), (self.edge_of[previous as usize], previous)]
            {
                if self.edges[edge as usize].is_sharp && ends.iter().all(|(known, _)| *known != edge) {
                    ends.push((edge, end));
                }
            }
        }
        ends.into_iter().map(|(_, end)| end).collect()
    }

    fn rule(&self, cage: &Cage, v: usize) -> Rule {
        let corners = self.corners_at(v);
        let [first, ..] = corners[..] else { return Rule::Corner };
        let creases = self.edges_at(cage, v).iter().filter(|&&e| self.edges[e as usize].is_sharp).count();
        // All faces there are one fan, which a walk over inner edges goes round or through.
        let start = self.first_of_fan(cage, first);
        let is_fan = self.fan(cage, start, |edge| edge.is_inner).len() == corners.len();
        match creases {
            _ if cage.held[v] || !is_fan && creases < 2 => Rule::Corner,
            0 | 1 => Rule::Smooth,
            2 if is_fan || self.is_between_sheets(cage, v) => Rule::Crease,
            _ => Rule::Corner,
        }
    }

    /// Whether all that ends at a vertex is edges of three faces and more: sheets that meet along a curve.
    fn is_between_sheets(&self, cage: &Cage, v: usize) -> bool {
        let mut edges = self.edges_at(cage, v).into_iter().map(|e| &self.edges[e as usize]);
        edges.all(|edge| edge.is_inner || edge.faces > 2)
    }

    /// The corner that a fan around a vertex begins at, clockwise from `c`: `c` where it is closed.
    fn first_of_fan(&self, cage: &Cage, c: u32) -> u32 {
        let mut first = c;
        loop {
            let edge = self.edge_from(first);
            if !edge.is_inner {
                return first;
            }
            let other = edge.sides[usize::from(edge.sides[0] == first)];
            first = self.next(cage, other);
            if first == c {
                return c;
            }
        }
    }

    /// The corners at a vertex counter-clockwise from `c` on, over edges that `is_open` lets pass; each once.
    pub(super) fn fan(&self, cage: &Cage, c: u32, is_open: impl Fn(&Edge) -> bool) -> Vec<u32> {
        let mut fan = vec![c];
        let mut last = c;
        loop {
            let before = self.previous(cage, last);
            let edge = &self.edges[self.edge_of[before as usize] as usize];
            if !edge.is_inner || !is_open(edge) {
                return fan;
            }
            // There it begins at the vertex.
            last = edge.sides[usize::from(edge.sides[0] == before)];
            if last == c {
                return fan;
            }
            fan.push(last);
        }
    }
}

/// The edges, and the one from each corner.
fn edges(cage: &Cage) -> (Vec<Edge>, Vec<u32>) {
    let mut known: HashMap<[u32; 2], u32> = HashMap::with_capacity(cage.corners.len() / 2);
    let mut edges: Vec<Edge> = Vec::with_capacity(cage.corners.len() / 2);
    let mut edge_of = Vec::with_capacity(cage.corners.len());
    for face in &cage.faces {
        for c in face.corners() {
            let (corner, next) = (cage.corners[c], cage.corners[face.next(c)]);
            let mut ends = [corner.vertex, next.vertex];
            ends.sort_unstable();
            let e = *known.entry(ends).or_insert(index(edges.len()));
            edge_of.push(e);
            let Some(edge) = edges.get_mut(e as usize) else {
                let sides = [index(c); 2];
                let alone = Edge { sides, faces: 1, is_sharp: true, is_inner: false, is_seam: true };
                edges.push(alone);
                continue;
            };
            edge.faces += 1;
            if edge.faces == 2 {
                edge.sides[1] = index(c);
            }
        }
    }
    for edge in &mut edges {
        let [a, b] = edge.sides.map(|c| &cage.corners[c as usize]);
        edge.is_inner = edge.faces == 2 && a.vertex != b.vertex;
        edge.is_sharp = !edge.is_inner || a.crease || b.crease;
    }
    // Texture coordinates are one on both sides where those at both ends are.
    let next: Vec<u32> =
        cage.faces.iter().flat_map(|face| face.corners().map(|c| index(face.next(c)))).collect();
    for edge in edges.iter_mut().filter(|edge| edge.is_inner) {
        let [a, b] = edge.sides.map(|c| c as usize);
        let uv = |c: usize| cage.corners[c].uv;
        edge.is_seam = uv(a) != uv(next[b] as usize) || uv(b) != uv(next[a] as usize);
    }
    (edges, edge_of)
}
