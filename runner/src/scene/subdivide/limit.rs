//! Where the vertices of a level end up, and the normals of the limit surface there.
//!
//! The masks are left eigenvectors of the subdivision's matrix: positions and tangents of Catmull-Clark from Halstead,
//! Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces", SIGGRAPH 1993; of Loop, of creases
//! and of borders from Hoppe and others 1994, and Biermann, Levin and Zorin, "Piecewise smooth subdivision surfaces
//! with normal control", SIGGRAPH 2000. A vertex that a single crease ends at counts as smooth.

use super::Scheme;
use super::cage::Cage;
use super::refine::{Values, loop_beta};
use super::topology::{Rule, Topology};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// All positions and texture coordinates in the limit. Faces must be quads, or of Loop triangles.
pub(super) fn points(cage: &Cage, topology: &Topology, scheme: Scheme) -> (Vec<DVec3>, Vec<DVec3>) {
    let position = |c: u32| cage.positions[cage.corners[c as usize].vertex as usize];
    let uv = |c: u32| cage.uvs[cage.corners[c as usize].uv as usize];
    let (mut positions, mut uvs) = (cage.positions.clone(), cage.uvs.clone());
    for v in 0..cage.positions.len() {
        let Some(&c) = topology.corners_at(v).first() else { continue };
        positions[v] = point(cage, topology, scheme, v, &position);
        if topology.moves_uv[v] {
            uvs[cage.corners[c as usize].uv as usize] = point(cage, topology, scheme, v, &uv);
        }
    }
    (positions, uvs)
}

fn point(cage: &Cage, topology: &Topology, scheme: Scheme, v: usize, values: Values<'_>) -> DVec3 {
    let corners = topology.corners_at(v);
    let here = values(corners[0]);
    match topology.rules[v] {
        Rule::Corner => here,
        Rule::Crease => {
            let ends = topology.crease_ends(cage, v);
            (here * 4.0 + values(ends[0]) + values(ends[1])) / 6.0
        }
        Rule::Smooth => {
            #[expect(clippy::cast_precision_loss, reason = "a vertex has fewer than 2^52 faces")]
            let n = corners.len() as f64;
            let neighbours: DVec3 = corners.iter().map(|&c| values(topology.next(cage, c))).sum();
            match scheme {
                Scheme::CatmullClark => {
                    let opposite = |&c: &u32| values(topology.next(cage, topology.next(cage, c)));
                    let faces: DVec3 = corners.iter().map(opposite).sum();
                    (here * (n * n) + neighbours * 4.0 + faces) / (n * (n + 5.0))
                }
                Scheme::Loop => {
                    let omega = 1.0 / (n + 0.375 / loop_beta(n));
                    here * (1.0 - n * omega) + neighbours * omega
                }
            }
        }
    }
}

/// The unit normal of the limit surface at each corner: one at a smooth vertex, on each side of creases another. Where
/// tangents are parallel it is that of the faces there, zero where these have none either.
pub(super) fn normals(cage: &Cage, topology: &Topology, scheme: Scheme) -> Vec<DVec3> {
    let mut normals: Vec<Option<DVec3>> = vec![None; cage.corners.len()];
    for v in 0..cage.positions.len() {
        let corners = topology.corners_at(v);
        let is_smooth = topology.rules[v] == Rule::Smooth;
        // Sectors begin at creases; what has none, goes round.
        let begins = |c: &u32| topology.edge_from(*c).is_sharp;
        let starts = corners.iter().copied().filter(begins).chain(corners.iter().copied());
        for start in starts {
            if normals[start as usize].is_some() {
                continue;
            }
            let fan = topology.fan(cage, start, |edge| is_smooth || !edge.is_sharp);
            let sector = Sector::new(cage, topology, &fan);
            let tangents = match topology.rules[v] {
                Rule::Smooth => sector.smooth_tangents(scheme),
                Rule::Crease => sector.crease_tangents(scheme),
                Rule::Corner => sector.corner_tangents(),
            };
            let of_faces = sector.area_normal();
            let normal = tangents.0.cross(tangents.1).normalize_or_zero();
            let is_sound = normal != DVec3::ZERO && (is_smooth || normal.dot(of_faces) > 0.0);
            let normal = if is_sound { normal } else { of_faces.normalize_or_zero() };
            fan.iter().for_each(|&c| normals[c as usize] = Some(normal));
        }
    }
    normals.into_iter().map(Option::unwrap_or_default).collect()
}

/// The faces at a vertex between two creases, or all around it, relative to the vertex.
struct Sector {
    /// The other ends of its edges, counter-clockwise; one more than faces where it does not go round.
    edges: Vec<DVec3>,
    /// The corners across its faces.
    faces: Vec<DVec3>,
}

impl Sector {
    fn new(cage: &Cage, topology: &Topology, fan: &[u32]) -> Sector {
        let position = |c: u32| cage.positions[cage.corners[c as usize].vertex as usize];
        let here = position(fan[0]);
        let last = topology.previous(cage, fan[fan.len() - 1]);
        let mut edges: Vec<DVec3> = fan.iter().map(|&c| position(topology.next(cage, c)) - here).collect();
        edges.push(position(last) - here);
        let faces =
            fan.iter().map(|&c| position(topology.next(cage, topology.next(cage, c))) - here).collect();
        Sector { edges, faces }
    }

    /// Twice the area of the triangles between its edges, along their normals.
    fn area_normal(&self) -> DVec3 {
        self.edges.windows(2).map(|pair| pair[0].cross(pair[1])).sum()
    }

    #[expect(clippy::cast_precision_loss, reason = "a vertex has fewer than 2^52 faces")]
    fn smooth_tangents(&self, scheme: Scheme) -> (DVec3, DVec3) {
        let n = self.faces.len();
        let step = TAU / n as f64;
        let tangent = |shift: f64| -> DVec3 {
            let cos = |i: usize| (step * i as f64 - shift).cos();
            match scheme {
                Scheme::CatmullClark => {
                    let edge = 1.0 + step.cos() + (0.5 * step).cos() * (2.0 * (9.0 + step.cos())).sqrt();
                    let of =
                        |i: usize| self.edges[i] * (edge * cos(i)) + self.faces[i] * (cos(i) + cos(i + 1));
                    (0..n).map(of).sum()
                }
                Scheme::Loop => (0..n).map(|i| self.edges[i] * cos(i)).sum(),
            }
        };
        (tangent(0.0), tangent(0.5 * PI))
    }

    /// Along the crease, and into the sector.
    ///
    /// The mask of the latter is the left eigenvector of the eigenvalue l, with the shares p sin(i t) of inner edge i,
    /// q (sin(i t) + sin((i + 1) t)) of face i, t = pi / k for k faces, and that of the creases' other ends that
    /// follows from the creases' rule. (Published masks, as Zorin's of 2000, are of rules that are changed beside
    /// creases; for regular vertices they are the same. Without those changes there is no tangent plane where more than
    /// three quads, or of Loop five triangles, meet on one side; this is what of it is across the crease then.)
    #[expect(clippy::cast_precision_loss, reason = "a vertex has fewer than 2^52 faces")]
    fn crease_tangents(&self, scheme: Scheme) -> (DVec3, DVec3) {
        let k = self.faces.len();
        let (first, last) = (self.edges[0], self.edges[k]);
        if k == 1 {
            return (first - last, first + last);
        }
        let t = PI / k as f64;
        let sin = |i: usize| (t * i as f64).sin();
        let (l, p, q) = match scheme {
            Scheme::CatmullClark => {
                let b = 10.0 + 2.0 * t.cos();
                let l = (b + (b * b - 64.0).sqrt()) / 32.0;
                (l, 16.0 * l - 4.0, 1.0)
            }
            Scheme::Loop => (0.375 + 0.25 * t.cos(), 1.0, 0.0),
        };
        // Of an end of the creases, how much its first neighbours give it; of the vertex, how much all inside do.
        let (beside, inside) = match scheme {
            Scheme::CatmullClark => (l * q * sin(1), 0.375 * p + 0.5 * q),
            Scheme::Loop => (0.125 * p * sin(1), 0.375 * p),
        };
        let ends =
            (-8.0 * (l - 0.75) * beside - inside / (0.5 * t).tan()) / (1.0 - 8.0 * (l - 0.75) * (l - 0.5));
        let edges: DVec3 = (1..k).map(|i| self.edges[i] * (p * sin(i))).sum();
        let faces: DVec3 = (0..k).map(|i| self.faces[i] * (q * (sin(i) + sin(i + 1)))).sum();
        (first - last, edges + faces + (first + last) * ends)
    }

    /// Along the two creases that bound it.
    fn corner_tangents(&self) -> (DVec3, DVec3) {
        (self.edges[0], self.edges[self.faces.len()])
    }
}
