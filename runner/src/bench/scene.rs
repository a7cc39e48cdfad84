//! The scene that builds are measured over: as many displaced triangles as are asked for, the same on every machine up
//! to what its sine rounds.

use crate::scene::Mesh;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::Vertex;
use emboss_kernels::sampler::{pcg4d, unit_float};
use glam::{IVec3, UVec4, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_2, PI};

/// How many spheres there are.
const SPHERES: u32 = 60;
/// The room that their centres lie in.
const ROOM: Vec3 = Vec3::new(10.0, 3.0, 10.0);
/// Least radius; the greatest is 1.
const LEAST_RADIUS: f32 = 0.05;
/// How many times as many triangles one sphere may have as another of its size.
const DENSEST: f32 = 64.0;
/// How far bumps rise above the sphere, and sink below it, in radii.
const BUMPS: f32 = 0.08;
/// The displacement's heights reach so far to both sides, as a share of the side of a cell: prisms keep their shape
/// whatever the size of the scene, and overlap as those of a relief do.
const HEIGHT: f32 = 0.25;

/// The box of each of `count` prisms: triangle `i` of [`mesh`], displaced by a height to both sides of its base.
///
/// 60 spheres with bumps stand in a room, some within each other. Their radii differ by up to 20 times, and, however
/// large they are, the numbers of their triangles by up to 64 times. Of the last sphere triangles may be missing.
pub fn boxes(count: u32) -> Vec<Aabb> {
    let spheres = spheres(count);
    spheres.par_iter().flat_map_iter(|sphere| (0..sphere.triangles).map(|i| sphere.prism(i))).collect()
}

/// The base mesh of the `count` prisms, with the normals along which they are displaced.
pub fn mesh(count: u32) -> Mesh {
    let spheres = spheres(count);
    let triangles = spheres.iter().flat_map(|sphere| (0..sphere.triangles).map(|i| sphere.triangle(i)));
    let vertices: Vec<Vertex> = triangles.flatten().collect();
    let indices: Vec<[u32; 3]> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::from_triangles(&vertices, &indices)
}

/// A cube of `segments` by `segments` cells a face, blown up.
struct Sphere {
    center: Vec3,
    radius: f32,
    /// Where the waves of its bumps begin.
    phase: f32,
    segments: u32,
    /// How many there are: two for each cell, fewer on the last sphere.
    triangles: u32,
}

/// Spheres of `count` triangles. Each gets its share of what those before it left, as nearly as whole cells allow.
fn spheres(count: u32) -> Vec<Sphere> {
    let random = |i: u32, what: u32| pcg4d(UVec4::new(i, what, 0, 0)).to_array().map(unit_float);
    let weights: Vec<f64> = (0..SPHERES).map(|i| f64::from(DENSEST.powf(random(i, 0)[0]))).collect();
    let mut spheres = Vec::new();
    let (mut left, mut weight_left) = (count, weights.iter().sum::<f64>());
    for (i, weight) in (0..SPHERES).zip(weights) {
        let last = i + 1 == SPHERES;
        let share = if last { 1.0 } else { weight / weight_left };
        weight_left -= weight;
        let segments = (f64::from(left) * share / 12.0).sqrt();
        let segments = if last { segments.ceil() } else { segments.round() };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most sqrt(2^32 / 12)"
        )]
        let segments = (segments as u32).max(1);
        let triangles = (12 * segments * segments).min(left);
        left -= triangles;
        let [size, phase, ..] = random(i, 1);
        let [x, y, z, _] = random(i, 2);
        spheres.push(Sphere {
            center: Vec3::new(x, y, z) * ROOM,
            radius: LEAST_RADIUS.powf(size),
            phase: phase * PI,
            segments,
            triangles,
        });
    }
    spheres
}

impl Sphere {
    /// Triangle `i`, counter-clockwise seen from outside.
    fn triangle(&self, i: u32) -> [Vertex; 3] {
        let (cell, upper) = (i / 2, i % 2 == 1);
        let (face, cell) = (cell / (self.segments * self.segments), cell % (self.segments * self.segments));
        let (x, y) = (cell % self.segments, cell / self.segments);
        let corner = |i: u32, j: u32| self.vertex(face, x + i, y + j);
        let [a, b, c] = if upper {
            [corner(0, 0), corner(1, 1), corner(0, 1)]
        } else {
            [corner(0, 0), corner(1, 0), corner(1, 1)]
        };
        if face < 3 { [a, b, c] } else { [a, c, b] }
    }

    /// Vertex (x, y) of a face's grid. Faces 0 to 2 look along x, y and z, the others the opposite way.
    fn vertex(&self, face: u32, x: u32, y: u32) -> Vertex {
        let segments = self.segments.cast_signed();
        let axis = (face % 3) as usize;
        // In whole numbers, so that faces agree on their edges.
        let mut direction = IVec3::ZERO;
        direction[axis] = if face < 3 { segments } else { -segments };
        direction[(axis + 1) % 3] = 2 * x.cast_signed() - segments;
        direction[(axis + 2) % 3] = 2 * y.cast_signed() - segments;
        let normal = direction.as_vec3().normalize();
        let wave = normal * Vec3::new(9.0, 11.0, 13.0) + self.phase;
        let bump = 1.0 + BUMPS * wave.x.sin() * wave.y.sin() * wave.z.sin();
        Vertex { position: self.center + normal * (self.radius * bump), normal, u: 0.0, v: 0.0 }
    }

    /// The box of prism `i`: of its corners moved along their normals, both ways.
    fn prism(&self, i: u32) -> Aabb {
        let height = HEIGHT * self.radius * FRAC_PI_2 / self.segments as f32;
        self.triangle(i).iter().fold(Aabb::EMPTY, |bounds, Vertex { position, normal, .. }| {
            bounds.including(*position - *normal * height).including(*position + *normal * height)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::HostAabb;
    use emboss_kernels::bvh::node::is_sound;

    #[test]
    fn there_are_as_many_prisms_as_asked_for() {
        for count in [0, 1, 7, 719, 721, 1000, 12_345, 100_000] {
            let boxes = boxes(count);
            assert_eq!(boxes.len(), count as usize);
            assert!(boxes.iter().all(|&bounds| is_sound(bounds)), "{count}");
        }
    }

    /// What is traced lies in what is built over, and nothing of it was left out.
    #[test]
    fn prisms_hold_their_triangles() {
        const COUNT: u32 = 10_000;
        let (mesh, boxes) = (mesh(COUNT), boxes(COUNT));
        assert_eq!((mesh.triangles.len(), mesh.dropped), (COUNT as usize, 0));
        for (triangle, bounds) in mesh.triangles.iter().zip(boxes) {
            let corners = triangle.vertices.map(|v| mesh.vertices[v as usize].position);
            assert!(corners.iter().all(|&p| bounds.contains(Aabb { min: p, max: p })));
        }
    }

    /// Faces share their edges: a sphere of n segments has 6 n^2 + 2 vertices.
    #[test]
    fn spheres_are_closed() {
        let sphere = Sphere { center: Vec3::ONE, radius: 2.0, phase: 0.5, segments: 5, triangles: 300 };
        let vertices: Vec<Vertex> = (0..300).flat_map(|i| sphere.triangle(i)).collect();
        let triangles: Vec<[u32; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert_eq!(Mesh::from_triangles(&vertices, &triangles).vertices.len(), 6 * 25 + 2);
        for [a, b, c] in (0..300).map(|i| sphere.triangle(i)) {
            let ng = (b.position - a.position).cross(c.position - a.position);
            assert!(ng.dot(a.normal) > 0.0, "a triangle is inside out");
        }
    }

    #[test]
    fn sizes_differ() {
        let areas: Vec<f64> = boxes(100_000).iter().map(|bounds| bounds.half_area()).collect();
        let (least, most) = areas.iter().fold((f64::MAX, 0.0_f64), |(a, b), &x| (a.min(x), b.max(x)));
        // The largest sphere is about 20 times as large as the smallest, its surface 400 times.
        assert!(most > 400.0 * least, "{least} to {most}");
    }
}
