//! Faces that are there twice: exporters write them when objects were joined twice, or give cards a back of their own.

use crate::instances::Part;
use crate::render::Scene;
use crate::scene::Mesh;
use emboss_kernels::interface::{Triangle, Vertex};
use glam::{DAffine3, DMat3, DVec3};
use serde::Serialize;
use std::collections::{HashMap, HashSet};

/// Triangles at one edge beyond so many are not looked at for quadrangles: pairs of them are as many as its square.
const MOST_AT_AN_EDGE: usize = 64;
/// Four corners are in a plane where none is farther from that of the others than this share of the longest side: most
/// exporters write six digits.
const FLAT: f64 = 1e-5;

/// Triangles of a scene that lie on others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Repeated {
    /// How many, in all places: of those that lie on each other all but one.
    pub triangles: u64,
    /// How many of them lie on triangles of another model, or of another instance of their own.
    pub across_models: u64,
}

/// How many triangles of a mesh lie on others of it, in O(n log n): those with the same three corners in any order, all
/// but the first, and the two that cut a flat quadrangle along its other diagonal. Corners are the same where their
/// positions are, -0 being 0; normals, texture coordinates and materials may differ.
///
/// Other ways to cover the same area are not found.
pub fn repeated_triangles(mesh: &Mesh) -> u64 {
    repeated(&standing(&mesh.vertices, &mesh.triangles, DVec3::ZERO))
}

/// The triangles of a scene that lie on others, within models and across: of instances those of each mesh, and those of
/// an instance that stands where another one of its mesh does.
///
/// Models of which each has an origin of its own are compared in doubles. Corners that were rounded about different
/// origins may differ there, and are not found then.
pub fn repeated_in(scene: &Scene) -> Repeated {
    let Mesh { vertices, triangles, starts, .. } = &scene.mesh;
    // Triangles stand in the order of their meshes.
    let model = |triangle: &Triangle| starts.partition_point(|&start| start <= triangle.vertices[0]);
    let once = Part { triangle_count: 0, places: vec![DAffine3::IDENTITY] };
    let mut rest = &triangles[..];
    let mut parts: Vec<(&Part, &[Triangle])> = Vec::new();
    for part in &scene.parts {
        let triangles;
        (triangles, rest) = rest.split_at(part.triangle_count as usize);
        parts.push((part, triangles));
    }
    if parts.is_empty() {
        parts.push((&once, triangles));
    }
    // What stands once, only moved, may stand on another model; all of these together, and each for itself.
    let (mut together, mut within) = (Vec::new(), 0);
    let mut sum = Repeated::default();
    for (part, triangles) in parts {
        if let [DAffine3 { matrix3, translation }] = part.places[..]
            && matrix3 == DMat3::IDENTITY
        {
            for model in triangles.chunk_by(|a, b| model(a) == model(b)) {
                let corners = standing(vertices, model, translation);
                within += repeated(&corners);
                together.extend(corners);
            }
            continue;
        }
        let of_mesh = repeated(&standing(vertices, triangles, DVec3::ZERO));
        let places = part.places.len() as u64;
        let again = places - distinct_places(part);
        let across = again * u64::from(part.triangle_count);
        sum.triangles += (places - again) * of_mesh + across;
        sum.across_models += across;
    }
    let all = repeated(&together);
    sum.triangles += all;
    sum.across_models += all.saturating_sub(within);
    sum
}

/// In how many places a part stands.
fn distinct_places(part: &Part) -> u64 {
    let bits = |place: &DAffine3| place.to_cols_array().map(|x| (x + 0.0).to_bits());
    part.places.iter().map(bits).collect::<HashSet<_>>().len() as u64
}

/// A corner of a triangle.
#[derive(Clone, Copy)]
struct Corner {
    /// Where it is, all models about one origin.
    position: DVec3,
    /// Its greatest coordinate about the origin of its own model, which `f32` rounds to 2^-24 of itself.
    reach: f64,
}

/// The corners of triangles, moved.
fn standing(vertices: &[Vertex], triangles: &[Triangle], translation: DVec3) -> Vec<[Corner; 3]> {
    let corner = |v: u32| {
        let stored = vertices[v as usize].position.as_dvec3();
        Corner { position: stored + translation, reach: stored.abs().max_element() }
    };
    triangles.iter().map(|triangle| triangle.vertices.map(corner)).collect()
}

/// A triangle's corners by the numbers of their positions, in ascending order.
type Corners = [u32; 3];

fn repeated(triangles: &[[Corner; 3]]) -> u64 {
    let (corners, positions) = numbered(triangles);
    let mut is_repeated = vec![false; corners.len()];
    let mut first_of = HashMap::with_capacity(corners.len());
    for (i, corners) in corners.iter().enumerate() {
        is_repeated[i] = *first_of.entry(*corners).or_insert(i) != i;
    }
    let once: Vec<usize> = (0..corners.len()).filter(|&i| !is_repeated[i]).collect();
    for pair in other_diagonals(&corners, &once, &positions) {
        pair.into_iter().for_each(|i| is_repeated[i] = true);
    }
    is_repeated.into_iter().filter(|&is_repeated| is_repeated).count() as u64
}

/// The corners of each triangle, and one at the position of each number.
fn numbered(triangles: &[[Corner; 3]]) -> (Vec<Corners>, Vec<Corner>) {
    let (mut numbers, mut positions) = (HashMap::new(), Vec::new());
    let mut number = |corner: Corner| {
        *numbers.entry(corner.position.to_array().map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
            positions.push(corner);
            // Meshes have 32-bit indices.
            u32::try_from(positions.len() - 1).unwrap_or(u32::MAX)
        })
    };
    let corners = triangles.iter().map(|triangle| {
        let mut corners = triangle.map(&mut number);
        corners.sort_unstable();
        corners
    });
    let corners = corners.collect();
    (corners, positions)
}

/// Two triangles at a common edge that make a convex quadrangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Quadrangle {
    /// In ascending order.
    corners: [u32; 4],
    /// The lower triangle first.
    triangles: [usize; 2],
    diagonal: [u32; 2],
}

/// The pairs of triangles that cover a quadrangle which a pair before them covers, cut along its other diagonal. `once`
/// are the triangles that count.
fn other_diagonals(corners: &[Corners], once: &[usize], positions: &[Corner]) -> Vec<[usize; 2]> {
    let edges_of = |&i: &usize| {
        let [a, b, c] = corners[i];
        [([a, b], c, i), ([a, c], b, i), ([b, c], a, i)]
    };
    let mut edges: Vec<([u32; 2], u32, usize)> = once.iter().flat_map(edges_of).collect();
    edges.sort_unstable();
    let mut quadrangles = Vec::new();
    for at_edge in edges.chunk_by(|a, b| a.0 == b.0).filter(|at_edge| at_edge.len() <= MOST_AT_AN_EDGE) {
        for (i, &(diagonal, c, first)) in at_edge.iter().enumerate() {
            for &(_, d, second) in &at_edge[i + 1..] {
                let [p, q, r, s] = [diagonal[0], diagonal[1], c, d].map(|n| positions[n as usize]);
                if is_flat_and_convex([p, q, r, s]) {
                    let mut corners = [diagonal[0], diagonal[1], c, d];
                    corners.sort_unstable();
                    let triangles = [first.min(second), first.max(second)];
                    quadrangles.push(Quadrangle { corners, triangles, diagonal });
                }
            }
        }
    }
    quadrangles.sort_unstable();
    let same = quadrangles.chunk_by(|a, b| a.corners == b.corners);
    same.flat_map(|same| same.iter().filter(|other| other.diagonal != same[0].diagonal))
        .map(|other| other.triangles)
        .collect()
}

/// Whether `r` and `s` lie in a plane with the edge from `p` to `q`, on different sides of it, and p and q on different
/// sides of the line from r to s.
fn is_flat_and_convex(corners: [Corner; 4]) -> bool {
    let [p, q, r, s] = corners.map(|corner| corner.position);
    let is_crossed = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| {
        let (of_c, of_d) = ((b - a).cross(c - a), (b - a).cross(d - a));
        of_c.dot(of_d) < 0.0
    };
    let longest =
        [q - p, r - p, s - p, r - q, s - q, s - r].map(DVec3::length).into_iter().fold(0.0, f64::max);
    // f32 rounds coordinates to 2^-24 of themselves.
    let reach = corners.iter().fold(0.0, |reach, corner| corner.reach.max(reach));
    let normal = (q - p).cross(r - p);
    let height = (s - p).dot(normal).abs();
    let room = (FLAT * longest + 4.0 * f64::from(f32::EPSILON) * reach) * normal.length();
    height <= room && is_crossed(p, q, r, s) && is_crossed(r, s, p, q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Mesh {
        let vertices: Vec<Vertex> = positions
            .iter()
            .enumerate()
            .map(|(i, &position)| Vertex { position: position.into(), u: i as f32, ..Vertex::default() })
            .collect();
        Mesh::from_triangles(&vertices, triangles)
    }

    /// A tilted square whose corners are as six digits have them, and the same corners again.
    const SQUARE: [[f32; 3]; 8] = [
        [-1.0, -0.04, 1.0],
        [1.0, 0.58, 1.0],
        [1.0, 0.240001, -1.0],
        [-1.0, -0.38, -1.0],
        [-1.0, -0.04, 1.0],
        [1.0, 0.58, 1.0],
        [1.0, 0.240001, -1.0],
        [-1.0, -0.38, -1.0],
    ];

    fn count(triangles: &[[u32; 3]]) -> u64 {
        repeated_triangles(&mesh(&SQUARE, triangles))
    }

    #[test]
    fn faces_are_found_in_any_winding_and_cut() {
        let (once, other) = ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]);
        assert_eq!(count(&once), 0);
        for winding in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1]] {
            assert_eq!(count(&[once[0], once[1], winding.map(|v| v + 4)]), 1, "{winding:?}");
        }
        assert_eq!(count(&[&once[..], &other].concat()), 2);
        let turned = other.map(|[a, b, c]| [c + 4, b + 4, a + 4]);
        assert_eq!(count(&[&turned[..], &once].concat()), 2);
        // Three and four times.
        assert_eq!(count(&[&once[..], &once, &once].concat()), 4);
        assert_eq!(count(&[&once[..], &other, &once, &turned].concat()), 6);
        // One half of the other cut covers no whole face.
        assert_eq!(count(&[once[0], once[1], other[0]]), 0);
    }

    #[test]
    fn what_only_shares_corners_is_no_repetition() {
        // The tetrahedron has each of its edges for a diagonal.
        let tetrahedron = mesh(
            &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        );
        assert_eq!(repeated_triangles(&tetrahedron), 0);
        // A square that is bent along either diagonal: two sheets, with room between them.
        let bent = mesh(
            &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.01], [1.0, 1.0, 0.0], [0.0, 1.0, 0.01]],
            &[[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]],
        );
        assert_eq!(repeated_triangles(&bent), 0);
        // A triangle with its middle, cut in two ways, is not convex.
        let middle = mesh(
            &[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1.0, 1.0, 0.0]],
            &[[0, 1, 3], [1, 2, 3], [2, 0, 3]],
        );
        assert_eq!(repeated_triangles(&middle), 0);
    }

    /// A grid and all of it again with the other diagonals: every triangle of the second lies on the first.
    #[test]
    fn grids_are_counted_whole() {
        const SIDE: u32 = 40;
        let at = |x: u32, y: u32| y * (SIDE + 1) + x;
        let points = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| [x as f32, y as f32, 0.5 * x as f32]));
        let cells = || (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let one = cells().flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        let other = cells().flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, d], [b, c, d]]
        });
        let points: Vec<_> = points.collect();
        let once: Vec<_> = one.clone().collect();
        assert_eq!(repeated_triangles(&mesh(&points, &once)), 0);
        let twice: Vec<_> = one.chain(other).collect();
        assert_eq!(repeated_triangles(&mesh(&points, &twice)), u64::from(2 * SIDE * SIDE));
    }

    fn scene(mesh: Mesh, parts: Vec<Part>) -> Scene {
        Scene { mesh, reliefs: vec![], materials: vec![], parts, subdivisions: 1 }
    }

    #[test]
    fn models_and_instances_that_stand_on_each_other_are_told_apart() {
        let twice = mesh(&SQUARE, &[[0, 1, 2], [0, 2, 3], [4, 6, 5]]);
        let mut both = twice.clone();
        both.append(mesh(&SQUARE, &[[0, 1, 3], [1, 2, 3]]));
        assert_eq!(repeated_in(&scene(both, vec![])), Repeated { triangles: 3, across_models: 2 });
        let moved = DAffine3::from_translation(DVec3::from(Vec3::X));
        let places = vec![DAffine3::IDENTITY, moved, DAffine3::IDENTITY];
        let parts = vec![Part { triangle_count: 3, places }];
        // One in each of two places, and all three of the third.
        assert_eq!(repeated_in(&scene(twice, parts)), Repeated { triangles: 5, across_models: 3 });
    }

    /// Models that have an origin each stand in parts of one place.
    #[test]
    fn models_about_their_own_origins_are_compared_where_they_stand() {
        let mut all = mesh(&SQUARE, &[[0, 1, 2], [0, 2, 3]]);
        all.append(mesh(&SQUARE, &[[0, 1, 3], [1, 2, 3]]));
        all.append(mesh(&SQUARE, &[[0, 1, 2]]));
        let count = |last: DVec3| {
            let far = DVec3::new(4e9, 0.0, -3e8);
            let part =
                |triangle_count, at| Part { triangle_count, places: vec![DAffine3::from_translation(at)] };
            repeated_in(&scene(all.clone(), vec![part(2, far), part(2, far), part(1, last)]))
        };
        assert_eq!(count(DVec3::ZERO), Repeated { triangles: 2, across_models: 2 });
        assert_eq!(count(DVec3::new(4e9, 0.0, -3e8)), Repeated { triangles: 3, across_models: 3 });
    }
}
