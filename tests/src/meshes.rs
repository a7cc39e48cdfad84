//! Closed meshes for tests, with points inside them; and what being closed and inside means, in f64.

use crate::Numbers;
use emboss::scene::{Mesh, builtin};
use emboss_kernels::interface::{FLIPPED, Vertex};
use glam::{DVec3, IVec3, Vec3};
use std::collections::{HashMap, HashSet};
use std::f64::consts::{PI, TAU};

/// A closed mesh around the origin before it is placed.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Corners; zero normals are to be computed.
    pub vertices: Vec<Vertex>,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Points well inside.
    pub inside: Vec<DVec3>,
}

/// A solid at its place, in f32.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The mesh as the program makes it.
    pub mesh: Mesh,
    /// Points inside.
    pub inside: Vec<Vec3>,
    /// How far the nearest point of the mesh is from any of them.
    pub room: f64,
}

impl Solid {
    /// The greatest side of its box.
    fn extent(&self) -> f64 {
        let positions = || self.vertices.iter().map(|v| v.position);
        let max = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
        let min = positions().fold(Vec3::INFINITY, Vec3::min);
        f64::from((max - min).max_element())
    }

    /// The solid scaled, then moved by so many of its extents along a line that is none of the axes.
    pub fn placed(&self, scale: f64, extents: f64) -> Placed {
        let offset = DVec3::new(1.0, -0.73, 0.41) * (extents * self.extent() * scale);
        let place = |p: DVec3| (p * scale + offset).as_vec3();
        let vertices: Vec<Vertex> =
            self.vertices.iter().map(|v| Vertex { position: place(v.position.as_dvec3()), ..*v }).collect();
        let mesh = Mesh::from_triangles(&vertices, &self.triangles);
        let inside: Vec<Vec3> = self.inside.iter().map(|&p| place(p)).collect();
        let room = inside.iter().map(|p| distance(&mesh, p.as_dvec3())).fold(f64::INFINITY, f64::min);
        Placed { mesh, inside, room }
    }
}

/// A sphere of radius 1: an icosahedron whose faces are split in four `levels` times. Its normals are shared, its
/// texture coordinates are longitude and latitude: split along the date line, where they go on beyond 1, and at the
/// poles, where each triangle has its own longitude.
pub fn icosphere(levels: u32) -> Solid {
    let (mut points, mut triangles) = icosahedron();
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push(((points[a as usize] + points[b as usize]) * 0.5).normalize());
                index(points.len() - 1)
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    let corners = triangles.iter().flat_map(|&t| spherical_chart(t.map(|v| points[v as usize])));
    loose(corners.collect(), in_ball(0.3))
}

/// The icosahedron with a vertex at either pole.
fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let ring = |y: f64, turn: f64| {
        (0..5).map(move |i| {
            let (sin, cos) = ((f64::from(i) + turn) * TAU / 5.0).sin_cos();
            DVec3::new(cos * (1.0 - y * y).sqrt(), y, -sin * (1.0 - y * y).sqrt())
        })
    };
    let y = 0.2_f64.sqrt();
    let points = [DVec3::Y].into_iter().chain(ring(y, 0.0)).chain(ring(-y, 0.5)).chain([-DVec3::Y]);
    let triangles = (0..5).flat_map(|i| {
        let (a, b) = (1 + i, 1 + (i + 1) % 5);
        let (c, d) = (a + 5, b + 5);
        [[0, a, b], [a, c, b], [b, c, d], [c, 11, d]]
    });
    (points.collect(), triangles.collect())
}

/// A triangle's corners on the unit sphere with longitude and latitude.
fn spherical_chart(points: [DVec3; 3]) -> [Vertex; 3] {
    let pole = |p: DVec3| p.y.abs() > 1.0 - 1e-9;
    let longitude = |p: DVec3| (-p.z).atan2(p.x) / TAU + 0.5;
    let around = points.iter().filter(|&&p| !pole(p)).map(|&p| longitude(p));
    let (least, most) = around.fold((1.0, 0.0), |(a, b): (f64, f64), u| (a.min(u), b.max(u)));
    // Farther round than half: it crosses the date line, and its west goes on beyond 1.
    let unfolded = |u: f64| if most - least > 0.5 && u < 0.5 { u + 1.0 } else { u };
    let others = |p: DVec3| points.into_iter().filter(move |&q| q != p).map(|q| unfolded(longitude(q)));
    points.map(|p| {
        let u = if pole(p) { others(p).sum::<f64>() / 2.0 } else { unfolded(longitude(p)) };
        let v = p.y.clamp(-1.0, 1.0).asin() / PI + 0.5;
        Vertex { position: p.as_vec3(), normal: p.as_vec3(), u: single(u), v: single(v) }
    })
}

/// The cube of side 2 with 24 vertices: normals are split at every edge, and each face has a chart of its own, of a
/// size and place in the map that no other has.
pub fn cube() -> Solid {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for (face, first) in (0..6_u16).zip((0..).step_by(4)) {
        let normal = axes[usize::from(face)];
        let right = axes[usize::from(face + 1) % 6];
        let up = normal.cross(right);
        let chart = f32::from(face);
        vertices.extend([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| Vertex {
            position: normal + right * (2.0 * u - 1.0) + up * (2.0 * v - 1.0),
            normal,
            u: 0.13 * chart + u * (0.4 + 0.3 * chart),
            v: -0.21 * chart + v * (1.7 - 0.2 * chart),
        }));
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    Solid { vertices, triangles, inside: in_ball(0.4) }
}

/// `builtin:knot`, whose maps meet along the tube and around it.
///
/// # Panics
/// Where there is no such scene.
pub fn knot() -> Solid {
    /// Radius of the knot's tube.
    const TUBE: f64 = 0.3;
    let mesh = builtin::load("builtin:knot").expect("a built-in scene").mesh;
    // Each vertex stands on a circle round the tube's middle.
    let middle = |v: &Vertex| v.position.as_dvec3() - TUBE * v.normal.as_dvec3();
    let inside = mesh.vertices.iter().step_by(173).map(middle).collect();
    let triangles = mesh.triangles.iter().map(|t| outward(t.vertices, t.flags)).collect();
    Solid { vertices: mesh.vertices, triangles, inside }
}

/// A slab of cubes with three holes, its corners moved at random: a surface of genus 3. Each square has a chart of its
/// own, and its diagonal at random; a third of the squares have normals of their own, the others those of the corners.
pub fn genus_three(seed: u64) -> Solid {
    let solid = |c: IVec3| {
        let within = (0..7).contains(&c.x) && (0..3).contains(&c.y) && c.z == 0;
        within && !(c.y == 1 && c.x % 2 == 1)
    };
    let mut numbers = Numbers::new(seed);
    let cells: Vec<IVec3> =
        (0..7).flat_map(|x| (0..3).map(move |y| IVec3::new(x, y, 0))).filter(|&cell| solid(cell)).collect();
    let mut moved: HashMap<IVec3, DVec3> = HashMap::new();
    let middle = DVec3::new(3.5, 1.5, 0.5);
    let mut corners = Vec::new();
    for &cell in &cells {
        for axis in [IVec3::X, IVec3::Y, IVec3::Z] {
            for outward in [axis, -axis] {
                if solid(cell + outward) {
                    continue;
                }
                let right = IVec3::new(axis.z, axis.x, axis.y);
                let up = outward.cross(right);
                // Twice the cube's middle, then its corners.
                let middle_of_face = 2 * cell + IVec3::ONE + outward;
                let square = [-right - up, right - up, right + up, up - right].map(|to| {
                    let corner = (middle_of_face + to) / 2;
                    let place = corner.as_dvec3() - middle;
                    *moved.entry(corner).or_insert_with(|| place + 0.2 * numbers.in_cube().as_dvec3())
                });
                corners.extend(charted_square(square, &mut numbers));
            }
        }
    }
    loose(corners, cells.iter().map(|cell| cell.as_dvec3() + DVec3::splat(0.5) - middle).collect())
}

/// The two triangles of a square, counter-clockwise.
fn charted_square(square: [DVec3; 4], numbers: &mut Numbers) -> [Vertex; 6] {
    let own = (square[2] - square[0]).cross(square[3] - square[1]).normalize().as_vec3();
    let normal = if numbers.below(3) == 0 { own } else { Vec3::ZERO };
    let (u, v, size) = (numbers.between(-1.0, 1.0), numbers.between(-1.0, 1.0), numbers.between(0.3, 1.2));
    let charted: [Vertex; 4] = std::array::from_fn(|i| {
        let (x, y) = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)][i];
        Vertex { position: square[i].as_vec3(), normal, u: u + size * x, v: v + size * y }
    });
    let first = numbers.below(2) as usize;
    [0, 1, 2, 0, 2, 3].map(|i| charted[(first + i) % 4])
}

/// A solid of loose triangles, three corners each; the program finds out which are the same.
fn loose(vertices: Vec<Vertex>, inside: Vec<DVec3>) -> Solid {
    let triangles = (0..index(vertices.len()) / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Solid { vertices, triangles, inside }
}

/// The origin, and points up to `radius` away from it.
fn in_ball(radius: f64) -> Vec<DVec3> {
    let mut numbers = Numbers::new(17);
    [DVec3::ZERO].into_iter().chain((0..7).map(|_| numbers.direction().as_dvec3() * radius)).collect()
}

/// A triangle's vertices, counter-clockwise seen from outside.
fn outward([a, b, c]: [u32; 3], flags: u32) -> [u32; 3] {
    if flags & FLIPPED == 0 { [a, b, c] } else { [a, c, b] }
}

/// The corners of each triangle, counter-clockwise seen from outside.
fn faces(mesh: &Mesh) -> impl Iterator<Item = [DVec3; 3]> {
    let position = |v: u32| mesh.vertices[v as usize].position.as_dvec3();
    mesh.triangles.iter().map(move |t| outward(t.vertices, t.flags).map(position))
}

/// V - E + F of a closed mesh, vertices at a position counted once.
///
/// # Panics
/// Where an edge has not exactly one triangle on either side.
pub fn euler_characteristic(mesh: &Mesh) -> i64 {
    // -0 is 0.
    let bits = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
    let mut edges: HashSet<[[u64; 3]; 2]> = HashSet::new();
    let mut places = HashSet::new();
    for face in faces(mesh) {
        let [a, b, c] = face.map(bits);
        places.extend([a, b, c]);
        for edge in [[a, b], [b, c], [c, a]] {
            assert!(edges.insert(edge), "two triangles run along an edge in the same direction");
        }
    }
    assert!(edges.iter().all(|&[a, b]| edges.contains(&[b, a])), "an edge has one triangle");
    let count = |n: usize| i64::from(index(n));
    count(places.len()) - count(edges.len()) / 2 + count(mesh.triangles.len())
}

/// How often a closed mesh goes round a point: the sum of the solid angles of its triangles (Van Oosterom and Strackee,
/// "The Solid Angle of a Plane Triangle", 1983), of the whole sphere.
pub fn winding_number(mesh: &Mesh, p: DVec3) -> f64 {
    let angle = |corners: [DVec3; 3]| {
        let [a, b, c] = corners.map(|q| (q - p).normalize());
        2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
    };
    faces(mesh).map(angle).sum::<f64>() / (4.0 * PI)
}

/// Distance from a point to the nearest one of a mesh.
pub fn distance(mesh: &Mesh, p: DVec3) -> f64 {
    faces(mesh).map(|corners| distance_to_triangle(corners.map(|q| q - p))).fold(f64::INFINITY, f64::min)
}

/// Distance from the origin to a triangle: to its plane where the foot lies inside, else to the nearest edge.
fn distance_to_triangle(q: [DVec3; 3]) -> f64 {
    let normal = (q[1] - q[0]).cross(q[2] - q[0]);
    let side = |e: usize| q[e].cross(q[(e + 1) % 3]).dot(normal);
    if normal != DVec3::ZERO && (0..3).all(|e| side(e) >= 0.0) {
        return q[0].dot(normal.normalize()).abs();
    }
    let to_edge = |e: usize| {
        let (a, along) = (q[e], q[(e + 1) % 3] - q[e]);
        let squared = along.length_squared();
        let s = if squared > 0.0 { (-a.dot(along) / squared).clamp(0.0, 1.0) } else { 0.0 };
        (a + along * s).length()
    };
    (0..3).map(to_edge).fold(f64::INFINITY, f64::min)
}

/// A number rounded to f32.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
fn single(x: f64) -> f32 {
    x as f32
}

/// A count as an index.
fn index(count: usize) -> u32 {
    u32::try_from(count).expect("meshes of tests are small")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_are_closed_and_have_the_genus_that_they_say() {
        for (solid, characteristic) in
            [(icosphere(2), 2), (cube(), 2), (knot(), 0), (genus_three(1), -4), (genus_three(2), -4)]
        {
            let placed = solid.placed(1.0, 0.0);
            assert_eq!(euler_characteristic(&placed.mesh), characteristic);
            assert!(placed.room > 0.2, "{}", placed.room);
            for p in placed.inside {
                assert!((winding_number(&placed.mesh, p.as_dvec3()) - 1.0).abs() < 1e-9);
            }
            assert!(winding_number(&placed.mesh, DVec3::splat(9.0)).abs() < 1e-9);
        }
    }

    #[test]
    #[should_panic(expected = "an edge has one triangle")]
    fn a_hole_is_found() {
        let mut mesh = cube().placed(1.0, 0.0).mesh;
        mesh.triangles.pop();
        euler_characteristic(&mesh);
    }

    #[test]
    fn distance_is_to_faces_edges_and_corners() {
        let mesh = cube().placed(1.0, 0.0).mesh;
        for (p, expected) in [
            (DVec3::new(0.1, 0.2, 0.5), 0.5),
            (DVec3::new(3.0, 0.3, 0.3), 2.0),
            (DVec3::new(4.0, 5.0, 0.0), 5.0),
            (DVec3::splat(2.0), 3.0_f64.sqrt()),
        ] {
            assert!((distance(&mesh, p) - expected).abs() < 1e-12, "{p}");
        }
    }
}
