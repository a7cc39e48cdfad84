//! Tangents of vertices by MikkTSpace, the frames that baked maps are made for: the same that the programs compute that
//! make these maps.

use super::Mesh;
use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use emboss_kernels::interface::{FLIPPED, Tangent, Vertex};
use glam::Vec3;
use std::ops::Range;

/// A mesh as MikkTSpace reads it, and the tangents that it gives.
struct Corners<'a> {
    mesh: &'a Mesh,
    /// Which of its triangles are read: one of the meshes that were appended, which have nothing in common.
    triangles: Range<usize>,
    /// Three for each triangle, in its stored order.
    tangents: Vec<Tangent>,
}

impl Corners<'_> {
    /// Where the corner stands in the stored order that is number `corner` counter-clockwise.
    fn stored(&self, triangle: usize, corner: usize) -> usize {
        if self.mesh.triangles[triangle].flags & FLIPPED == 0 { corner } else { [0, 2, 1][corner] }
    }

    /// Corner number `corner` of number `face` of the triangles that are read.
    fn vertex(&self, face: usize, corner: usize) -> &Vertex {
        let triangle = self.triangles.start + face;
        let vertices = self.mesh.triangles[triangle].vertices;
        &self.mesh.vertices[vertices[self.stored(triangle, corner)] as usize]
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.vertex(face, corner).position.to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.vertex(face, corner).normal.to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let vertex = self.vertex(face, corner);
        [vertex.u, vertex.v]
    }

    fn set_tangent(&mut self, tangent_space: Option<TangentSpace>, face: usize, corner: usize) {
        let normal = self.vertex(face, corner).normal;
        let given = tangent_space.map(|space| space.tangent_encoded());
        let triangle = self.triangles.start + face;
        let place = 3 * triangle + self.stored(triangle, corner);
        self.tangents[place] = tangent(given, normal);
    }
}

/// A tangent as given, or where there is none (texture coordinates on a line, a point) any that is at right angles to
/// the normal.
fn tangent(given: Option<[f32; 4]>, normal: Vec3) -> Tangent {
    if let Some([x, y, z, sign]) = given {
        // Adding 0 turns -0 into 0: what is equal has the same bits.
        let direction = Vec3::new(x, y, z) + 0.0;
        // Unit vectors of f32 are off by some 1e-7.
        if (direction.length_squared() - 1.0).abs() < 1e-5 {
            return Tangent { direction, sign };
        }
    }
    let direction = if normal == Vec3::ZERO { Vec3::X } else { normal.any_orthonormal_vector() + 0.0 };
    Tangent { direction, sign: 1.0 }
}

impl Mesh {
    /// The tangent of each vertex, by MikkTSpace from positions, normals and texture coordinates. Vertices at which
    /// triangles have different ones (where the map is mirrored, or turns around) are split, the copies side by side:
    /// indices stay in the order of positions.
    pub fn split_by_tangents(&mut self) -> Vec<Tangent> {
        let tangents = vec![Tangent::default(); 3 * self.triangles.len()];
        let mut corners = Corners { mesh: self, triangles: 0..0, tangents };
        let ends = self.starts.iter().copied().chain([u32::MAX]);
        for end in ends {
            let begin = corners.triangles.end;
            let count = self.triangles[begin..].partition_point(|triangle| triangle.vertices[0] < end);
            corners.triangles = begin..begin + count;
            match generate_tangents(&mut corners) {
                Ok(()) => {}
                // The type of its errors has no values.
                Err(_) => unreachable!("MikkTSpace does not fail"),
            }
        }
        let at_corners = corners.tangents;

        // The different tangents of each vertex, in order of the triangles.
        let mut of_vertex: Vec<Vec<Tangent>> = vec![Vec::new(); self.vertices.len()];
        for (triangle, tangents) in self.triangles.iter().zip(at_corners.chunks_exact(3)) {
            for (&v, tangent) in triangle.vertices.iter().zip(tangents) {
                let known = &mut of_vertex[v as usize];
                if !known.contains(tangent) {
                    known.push(*tangent);
                }
            }
        }
        let mut first_copy = Vec::with_capacity(of_vertex.len());
        let (mut vertices, mut tangents) = (Vec::new(), Vec::new());
        for (vertex, mut different) in self.vertices.iter().zip(of_vertex.clone()) {
            first_copy.push(vertices.len());
            if different.is_empty() {
                different.push(tangent(None, vertex.normal));
            }
            vertices.extend(different.iter().map(|_| *vertex));
            tangents.extend(different);
        }
        for (triangle, at_corners) in self.triangles.iter_mut().zip(at_corners.chunks_exact(3)) {
            for (v, tangent) in triangle.vertices.iter_mut().zip(at_corners) {
                let old = *v as usize;
                let copy = of_vertex[old].iter().position(|known| known == tangent);
                let new = first_copy[old] + copy.expect("every corner's tangent is noted above");
                *v = u32::try_from(new).expect("a mesh has at most 2^32 - 1 corners");
            }
        }
        for start in &mut self.starts {
            let new = first_copy.get(*start as usize).copied().unwrap_or(vertices.len());
            *start = u32::try_from(new).expect("a mesh has at most 2^32 - 1 corners");
        }
        self.vertices = vertices;
        tangents
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vertex(x: f32, y: f32, u: f32, v: f32) -> Vertex {
        Vertex { position: Vec3::new(x, y, 0.0), normal: Vec3::Z, u, v }
    }

    /// A square of two triangles, its map turned by 90 degrees: u grows along y, v along -x.
    fn turned(scale: f32) -> Mesh {
        let corner = |x: f32, y: f32| vertex(x * scale, y * scale, y, 1.0 - x);
        let vertices = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        Mesh::from_triangles(&vertices, &[[0, 1, 2], [2, 3, 0]])
    }

    #[test]
    fn tangents_run_along_u_at_any_scale() {
        for scale in [1.0, 1e-12, 1e12] {
            let mut mesh = turned(scale);
            let tangents = mesh.split_by_tangents();
            assert_eq!((tangents.len(), mesh.vertices.len()), (4, 4), "scale {scale}");
            for tangent in tangents {
                assert!(tangent.direction.abs_diff_eq(Vec3::Y, 1e-6), "{tangent:?}");
                // n x t = -x, which is where v grows.
                assert_eq!(tangent.sign, 1.0);
            }
        }
    }

    /// Two triangles at an edge, the map of the second a mirror image.
    #[test]
    fn mirrored_neighbours_split_their_vertices() {
        let vertices = [
            vertex(0.0, 0.0, 0.0, 0.0),
            vertex(0.0, 1.0, 0.0, 1.0),
            vertex(-1.0, 0.0, 1.0, 0.0),
            vertex(1.0, 0.0, 1.0, 0.0),
        ];
        let mut mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [0, 3, 1]]);
        assert_eq!(mesh.vertices.len(), 4);
        let winding = mesh.triangles.iter().map(|t| t.flags).collect::<Vec<_>>();
        let before: Vec<_> = corners(&mesh);
        let tangents = mesh.split_by_tangents();
        assert_eq!((mesh.vertices.len(), tangents.len()), (6, 6));
        assert_eq!(corners(&mesh), before, "triangles keep their corners");
        assert_eq!(mesh.triangles.iter().map(|t| t.flags).collect::<Vec<_>>(), winding);
        for triangle in &mesh.triangles {
            assert!(triangle.vertices.is_sorted(), "{triangle:?}");
            let left = triangle.vertices.iter().any(|&v| mesh.vertices[v as usize].position.x < 0.0);
            for v in triangle.vertices {
                let Tangent { direction, sign } = tangents[v as usize];
                let along_u = if left { -Vec3::X } else { Vec3::X };
                assert!(direction.abs_diff_eq(along_u, 1e-6), "{direction}");
                assert_eq!(sign, if left { -1.0 } else { 1.0 });
            }
        }
    }

    fn corners(mesh: &Mesh) -> Vec<[Vec3; 3]> {
        mesh.triangles.iter().map(|t| t.vertices.map(|v| mesh.vertices[v as usize].position)).collect()
    }

    #[test]
    fn texture_coordinates_in_a_point_leave_any_tangent() {
        let mut mesh = Mesh::from_triangles(
            &[vertex(0.0, 0.0, 0.5, 0.5), vertex(1.0, 0.0, 0.5, 0.5), vertex(0.0, 1.0, 0.5, 0.5)],
            &[[0, 1, 2]],
        );
        for Tangent { direction, sign } in mesh.split_by_tangents() {
            assert!((direction.length() - 1.0).abs() < 1e-6 && direction.dot(Vec3::Z).abs() < 1e-6);
            assert_eq!(sign.abs(), 1.0);
        }
    }

    /// Two meshes that share an edge, one behind the other, have the tangents that each has alone.
    #[test]
    fn appended_meshes_have_their_own_tangents() {
        let square = |at: f32, slant: f32| {
            let corner = |x: f32, y: f32| Vertex {
                position: Vec3::new(at + x, y, 0.0),
                normal: Vec3::Z,
                u: at + x,
                v: y + slant * x,
            };
            let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
            Mesh::from_triangles(&corners, &[[0, 1, 2], [0, 2, 3]])
        };
        let (mut left, mut right) = (square(0.0, 0.0), square(1.0, 0.5));
        let mut both = left.clone();
        both.append(right.clone());
        let alone = [left.split_by_tangents(), right.split_by_tangents()].concat();
        assert_eq!(both.split_by_tangents(), alone);
        assert_eq!(both.starts, [4]);
        assert_ne!(alone[0], alone[4]);
    }
}
