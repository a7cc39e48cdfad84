//! Making a [`Mesh`] out of loose triangles: welding, normals, orientation.

use super::Mesh;
use crate::space::RenderSpace;
use emboss_kernels::interface::{FLIPPED, NO_SEAMS, Triangle, Vertex};
use glam::{DAffine3, DVec2, DVec3, Vec3};
use std::collections::HashMap;

/// A triangle of the source with three different positions.
struct Face {
    /// Indices of its vertices, counter-clockwise seen from outside.
    vertices: [u32; 3],
    material: u32,
    /// Its outward normal, twice its area long: zero for a sliver, whose positions lie in a line.
    area_normal: DVec3,
}

/// A sum of area normals this small against the sum of their lengths is rounding noise of faces that cancel: f64
/// rounds each to 2^-52 of its length, which leaves room for some four million faces at a vertex.
const CANCELLED: f64 = 1e-9;

impl Mesh {
    /// Builds a mesh from triangles given counter-clockwise seen from outside.
    ///
    /// - Vertices that agree in position, normal and texture coordinates become one. All vertices at a position
    ///   stand together, positions in order of first use: so the two triangles at an edge list its ends in the
    ///   same order even where texture coordinates or normals are split.
    /// - Normals are normalised; zero ones are replaced by the area-weighted mean of the normals of all faces at
    ///   the position, whatever else splits its vertices. Where that mean vanishes (a sheet and its back), the
    ///   first of these faces gives its normal.
    /// - Triangles with two corners at one position (-0 is 0) are left out and counted in [`Mesh::dropped`]: their
    ///   other two edges are one, so that nothing opens. Slivers, whose three positions differ but lie in a line,
    ///   stay: one that fills a T-junction gets an area where the surface is displaced, and closes it.
    /// - Slivers add nothing to computed normals. Where only slivers meet, the normal is the mean of those computed
    ///   at the other ends of their edges, once for each sliver at an edge; all of them share it, as anywhere.
    ///   Where these have none either, it is zero, which does not displace.
    ///
    /// Areas are computed in f64, where the differences and products of f32 coordinates of similar size are exact.
    ///
    /// Positions, normals and texture coordinates must be finite, indices within `vertices`.
    pub fn from_triangles(vertices: &[Vertex], triangles: &[[u32; 3]]) -> Self {
        Self::with_materials(vertices, triangles.iter().map(|&triangle| (triangle, 0)))
    }

    /// [`from_triangles`](Self::from_triangles), each triangle with the index of its material.
    pub fn with_materials(
        vertices: &[Vertex],
        triangles: impl ExactSizeIterator<Item = ([u32; 3], u32)>,
    ) -> Self {
        Self::with_tiles(vertices, &[], triangles)
    }

    /// [`with_materials`](Self::with_materials), of each vertex with [`Mesh::tiles`], where there are any. Vertices
    /// that differ in these do not become one.
    pub(super) fn with_tiles(
        vertices: &[Vertex],
        tiles: &[DVec2],
        triangles: impl ExactSizeIterator<Item = ([u32; 3], u32)>,
    ) -> Self {
        let tile = |v: u32| tiles.get(v as usize).copied().unwrap_or_default();
        let given = triangles.len();
        let faces: Vec<Face> = triangles.filter_map(|(t, material)| face(vertices, t, material)).collect();
        let positions = weld_positions(vertices, &faces);
        let normals = computed_normals(&positions, &faces);
        let mut unified = Unified::default();
        let indices: Vec<[u32; 3]> = faces
            .iter()
            .map(|face| {
                face.vertices
                    .map(|v| unified.insert(vertices[v as usize], tile(v), positions[v as usize], &normals))
            })
            .collect();
        let (vertices, tiles, new_index) = unified.into_sorted();
        let triangle = |(t, face): (&[u32; 3], &Face)| {
            oriented(t.map(|v| new_index[v as usize])).with_material(face.material)
        };
        Self {
            vertices,
            triangles: indices.iter().zip(&faces).map(triangle).collect(),
            dropped: given - faces.len(),
            collapsed: 0,
            starts: Vec::new(),
            tiles: if tiles.iter().all(|&tile| tile == DVec2::ZERO) { Vec::new() } else { tiles },
            space: RenderSpace::default(),
        }
    }

    /// The mesh in another place of its own [space](Mesh::space); `None` where its coordinates are not finite there or
    /// no triangle is left. A mirrored one keeps its outside. Where rounding moves vertices to one position they are
    /// welded, as in [`from_triangles`](Self::from_triangles); triangles that are left out for that are
    /// [collapsed](Mesh::collapsed).
    pub fn transformed(&self, world_from_model: DAffine3) -> Option<Self> {
        self.carried(world_from_model, self.space)
    }

    /// The mesh in another place and another space; as [`transformed`](Self::transformed). Each position is computed in
    /// f64 and rounded once.
    pub(super) fn carried(&self, world_from_model: DAffine3, space: RenderSpace) -> Option<Self> {
        let matrix = world_from_model.matrix3;
        let normal_matrix = matrix.inverse().transpose();
        let mirrored = matrix.determinant() < 0.0;
        // Origins, which may be far away, are subtracted from each other first.
        let stretch = space.scale() / self.space.scale();
        let shift = space.point(world_from_model.transform_point3(self.space.origin));
        let transformed = |vertex: &Vertex| Vertex {
            position: (matrix * vertex.position.as_dvec3() * stretch + shift).as_vec3(),
            normal: (normal_matrix * vertex.normal.as_dvec3()).normalize_or_zero().as_vec3(),
            ..*vertex
        };
        let vertices: Vec<Vertex> = self.vertices.iter().map(transformed).collect();
        let triangles = self.triangles.iter().enumerate().map(|(i, triangle)| {
            let [a, b, c] = triangle.vertices;
            let flipped = (triangle.flags & FLIPPED != 0) != mirrored;
            (if flipped { [a, c, b] } else { [a, b, c] }, index(i))
        });
        if !vertices.iter().all(|vertex| vertex.position.is_finite()) {
            return None;
        }
        let mesh = Self::with_tiles(&vertices, &self.tiles, triangles).with_ids(|i| {
            let triangle = self.triangles[i as usize];
            (triangle.displacement, triangle.material())
        });
        let (dropped, collapsed) = (self.dropped, mesh.dropped + self.collapsed);
        (!mesh.triangles.is_empty()).then_some(Self { dropped, collapsed, space, ..mesh })
    }

    /// The mesh with each triangle's relief and material, in this order, as `ids` gives them for the index that stands
    /// in the place of its material.
    #[must_use]
    pub(super) fn with_ids(mut self, ids: impl Fn(u32) -> (u32, u32)) -> Self {
        for triangle in &mut self.triangles {
            let (relief, material) = ids(triangle.material());
            *triangle = triangle.with_material(material);
            triangle.displacement = relief;
        }
        self
    }

    /// Adds the triangles of another mesh, which do not weld with those that are there.
    ///
    /// # Panics
    /// Where it is of another [space](Mesh::space).
    pub fn append(&mut self, other: Self) {
        if self.vertices.is_empty() {
            *self = other;
            return;
        }
        assert!(self.space == other.space, "meshes of two spaces have no coordinates in common");
        if !(self.tiles.is_empty() && other.tiles.is_empty()) {
            self.tiles.resize(self.vertices.len(), DVec2::ZERO);
            self.tiles.extend(&other.tiles);
            self.tiles.resize(self.vertices.len() + other.vertices.len(), DVec2::ZERO);
        }
        let start = index(self.vertices.len());
        self.starts.push(start);
        self.starts.extend(other.starts.iter().map(|vertex| start + vertex));
        self.vertices.extend(other.vertices);
        let moved = |t: Triangle| Triangle { vertices: t.vertices.map(|v| start + v), ..t };
        self.triangles.extend(other.triangles.into_iter().map(moved));
        self.dropped += other.dropped;
        self.collapsed += other.collapsed;
    }

    /// The corners of the mesh's box in its own [space](Mesh::space), least first; `None` where it has no vertex.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = self.vertices.first()?.position;
        Some(
            self.vertices
                .iter()
                .fold((first, first), |(min, max), v| (min.min(v.position), max.max(v.position))),
        )
    }
}

/// The face of a triangle, `None` where two of its corners are at one position.
fn face(vertices: &[Vertex], triangle: [u32; 3], material: u32) -> Option<Face> {
    let [p0, p1, p2] = triangle.map(|v| vertices[v as usize].position);
    // As with `bits`, -0 equals 0; positions are finite.
    if p0 == p1 || p1 == p2 || p2 == p0 {
        return None;
    }
    let [p0, p1, p2] = [p0, p1, p2].map(|p| p.as_dvec3());
    Some(Face { vertices: triangle, material, area_normal: (p1 - p0).cross(p2 - p0) })
}

/// For each vertex the number of its position, in order of first use by a face; vertices without a face get 0.
fn weld_positions(vertices: &[Vertex], faces: &[Face]) -> Vec<u32> {
    let mut numbers = HashMap::new();
    let mut position_of = vec![0; vertices.len()];
    for v in faces.iter().flat_map(|face| face.vertices) {
        let next = index(numbers.len());
        position_of[v as usize] = *numbers.entry(bits(vertices[v as usize].position)).or_insert(next);
    }
    position_of
}

/// The unit normal of each welded position, or zero: see [`Mesh::from_triangles`].
fn computed_normals(position_of: &[u32], faces: &[Face]) -> Vec<Vec3> {
    let count = faces.iter().flat_map(|f| f.vertices).map(|v| position_of[v as usize] as usize + 1).max();
    let mut sums = vec![NormalSum::default(); count.unwrap_or(0)];
    for face in faces {
        for v in face.vertices {
            sums[position_of[v as usize] as usize].add(face.area_normal);
        }
    }
    let mut normals: Vec<Vec3> = sums.iter().map(NormalSum::unit).collect();
    for (position, sum) in neighbour_sums(position_of, faces, &normals) {
        normals[position] = sum.unit();
    }
    normals
}

/// For each position without a normal the sum of its neighbours', in order of faces.
fn neighbour_sums(position_of: &[u32], faces: &[Face], normals: &[Vec3]) -> HashMap<usize, NormalSum> {
    let mut sums: HashMap<usize, NormalSum> = HashMap::new();
    for face in faces {
        let [a, b, c] = face.vertices.map(|v| position_of[v as usize] as usize);
        for (position, neighbours) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            if normals[position] == Vec3::ZERO {
                let sum = sums.entry(position).or_default();
                neighbours.into_iter().for_each(|n| sum.add(normals[n].as_dvec3()));
            }
        }
    }
    sums
}

/// The area normals of the faces at a position, or the normals of its neighbours.
#[derive(Clone, Copy, Default)]
struct NormalSum {
    /// The first that is not zero.
    first: DVec3,
    /// Of all.
    sum: DVec3,
    /// Sum of their lengths.
    length: f64,
}

impl NormalSum {
    /// Adds one.
    fn add(&mut self, normal: DVec3) {
        if self.length == 0.0 {
            self.first = normal;
        }
        self.sum += normal;
        self.length += normal.length();
    }

    /// The mean's direction, or the first one's where they cancel; zero where all are.
    fn unit(&self) -> Vec3 {
        let cancelled = self.sum.length() <= CANCELLED * self.length;
        (if cancelled { self.first } else { self.sum }).normalize_or_zero().as_vec3()
    }
}

/// Vertices, each stored once, with the number of its position.
#[derive(Default)]
struct Unified {
    index_of: HashMap<([u32; 8], [u64; 2]), u32>,
    vertices: Vec<(u32, Vertex, DVec2)>,
}

impl Unified {
    /// The index of `vertex` with its final normal, added where it is new.
    fn insert(&mut self, vertex: Vertex, tile: DVec2, position: u32, normals: &[Vec3]) -> u32 {
        let given = vertex.normal.as_dvec3().normalize_or_zero().as_vec3();
        let normal = if given == Vec3::ZERO { normals[position as usize] } else { given };
        let vertex = Vertex { normal, ..vertex };
        let [[x, y, z], [nx, ny, nz]] = [vertex.position, normal].map(bits);
        let key = [x, y, z, nx, ny, nz, float_bits(vertex.u), float_bits(vertex.v)];
        let key = (key, tile.to_array().map(|tile| (tile + 0.0).to_bits()));
        let next = index(self.vertices.len());
        *self.index_of.entry(key).or_insert_with(|| {
            self.vertices.push((position, vertex, tile));
            next
        })
    }

    /// The vertices in order of position with their tiles, and for each former index the new one.
    fn into_sorted(self) -> (Vec<Vertex>, Vec<DVec2>, Vec<u32>) {
        let mut order: Vec<u32> = (0..index(self.vertices.len())).collect();
        order.sort_by_key(|&v| self.vertices[v as usize].0);
        let mut new_index = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            new_index[old as usize] = index(new);
        }
        let sorted = || order.iter().map(|&v| self.vertices[v as usize]);
        (
            sorted().map(|(_, vertex, _)| vertex).collect(),
            sorted().map(|(_, _, tile)| tile).collect(),
            new_index,
        )
    }
}

/// The triangle with its vertices ascending, [`FLIPPED`] where that takes an odd permutation.
fn oriented(vertices: [u32; 3]) -> Triangle {
    let [a, b, c] = vertices;
    let inversions = u32::from(a > b) + u32::from(a > c) + u32::from(b > c);
    let mut ascending = vertices;
    ascending.sort_unstable();
    Triangle {
        vertices: ascending,
        flags: if inversions % 2 == 1 { FLIPPED } else { 0 },
        seams: NO_SEAMS,
        ..Triangle::default()
    }
}

/// A vector's bits, equal where its coordinates are: -0 counts as 0.
fn bits(v: Vec3) -> [u32; 3] {
    v.to_array().map(float_bits)
}

/// A number's bits, equal where the numbers are: -0 counts as 0.
fn float_bits(x: f32) -> u32 {
    (x + 0.0).to_bits()
}

/// A count of vertices as an index. Meshes come with 32-bit indices, and welding makes no new ones.
fn index(count: usize) -> u32 {
    u32::try_from(count).expect("a mesh has at most 2^32 - 1 vertices")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    fn vertex(position: [f32; 3], normal: [f32; 3], u: f32, v: f32) -> Vertex {
        Vertex { position: position.into(), normal: normal.into(), u, v }
    }

    /// Two triangles that share the edge (1,0,0)-(0,1,0), folded along it; the second's copies of its ends have
    /// their own texture coordinates.
    fn fold() -> (Vec<Vertex>, Vec<[u32; 3]>) {
        let none = [0.0; 3];
        let vertices = vec![
            vertex([0.0, 0.0, 0.0], none, 0.0, 0.0),
            vertex([1.0, 0.0, 0.0], none, 1.0, 0.0),
            vertex([0.0, 1.0, 0.0], none, 0.0, 1.0),
            vertex([0.0, 1.0, 0.0], none, 0.5, 0.5),
            vertex([1.0, 0.0, 0.0], none, 0.5, 0.0),
            vertex([1.0, 1.0, -2.0], none, 1.0, 1.0),
        ];
        (vertices, vec![[0, 1, 2], [3, 4, 5]])
    }

    fn normal_in(mesh: &Mesh, triangle: Triangle) -> Vec3 {
        let [p0, p1, p2] = triangle.vertices.map(|v| mesh.vertices[v as usize].position);
        let n = (p1 - p0).cross(p2 - p0).normalize();
        if triangle.flags & FLIPPED == 0 { n } else { -n }
    }

    #[test]
    fn computed_normals_are_shared_across_split_texture_coordinates() {
        let (vertices, triangles) = fold();
        let mesh = Mesh::from_triangles(&vertices, &triangles);
        assert_eq!(mesh.vertices.len(), 6);
        // Cross products: (0,0,1) and (-1,0,0)x... summed by hand: (0,1,0)->(1,0,0): (1,-1,0), (0,1,0)->(1,1,-2):
        // (1,0,-2), so the second is (2,2,1); both together (2,2,2).
        let expected = Vec3::splat(1.0 / 3f32.sqrt());
        for v in mesh.vertices.iter().filter(|v| v.position.x + v.position.y == 1.0) {
            // One rounding in f32 of a unit vector's coordinate: 2^-25; the expectation itself is off by as much.
            assert!(v.normal.abs_diff_eq(expected, 2f32.powi(-23)), "{v:?}");
        }
    }

    #[test]
    fn weights_are_areas() {
        let none = [0.0; 3];
        // At the origin a face of area 2 looks to +z and one of area 1/2 to +x.
        let vertices = [
            vertex([0.0, 0.0, 0.0], none, 0.0, 0.0),
            vertex([2.0, 0.0, 0.0], none, 0.0, 0.0),
            vertex([0.0, 2.0, 0.0], none, 0.0, 0.0),
            vertex([0.0, 1.0, 0.0], none, 0.0, 0.0),
            vertex([0.0, 0.0, 1.0], none, 0.0, 0.0),
        ];
        let mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [0, 3, 4]]);
        let expected = Vec3::new(1.0, 0.0, 4.0).normalize();
        assert!(mesh.vertices[0].normal.abs_diff_eq(expected, 2f32.powi(-23)), "{:?}", mesh.vertices[0]);
    }

    #[test]
    fn faces_that_cancel_leave_the_first_ones_normal() {
        let none = [0.0; 3];
        let vertices = [
            vertex([0.1, 0.0, 0.3], none, 0.0, 0.0),
            vertex([1.0, 0.2, 0.0], none, 1.0, 0.0),
            vertex([0.0, 1.0, 0.7], none, 0.0, 1.0),
        ];
        let mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [2, 1, 0]]);
        let expected = normal_in(&mesh, mesh.triangles[0]);
        for v in &mesh.vertices {
            assert!(v.normal.abs_diff_eq(expected, 2f32.powi(-22)), "{v:?}");
        }
    }

    #[test]
    fn winding_survives_the_ascending_order() {
        let none = [0.0; 3];
        let vertices = [
            vertex([0.0, 0.0, 0.0], none, 0.0, 0.0),
            vertex([1.0, 0.0, 0.0], none, 1.0, 0.0),
            vertex([0.0, 1.0, 0.0], none, 0.0, 1.0),
        ];
        let up = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];
        let down = [[0, 2, 1], [2, 1, 0], [1, 0, 2]];
        // The first triangle fixes the numbering, so that the others meet it in every permutation.
        let mesh = Mesh::from_triangles(&vertices, &[&up[..], &down[..]].concat());
        for (i, &triangle) in mesh.triangles.iter().enumerate() {
            assert_eq!(triangle.vertices, [0, 1, 2]);
            assert_eq!(normal_in(&mesh, triangle), if i < 3 { Vec3::Z } else { -Vec3::Z }, "{i}");
        }
    }

    #[test]
    fn vertices_are_one_only_where_everything_agrees() {
        let up = [0.0, 0.0, 2.0];
        let vertices = [
            vertex([0.0, 0.0, 0.0], up, 0.0, 0.0),
            vertex([1.0, 0.0, 0.0], up, 1.0, 0.0),
            vertex([0.0, 1.0, 0.0], up, 0.0, 1.0),
            vertex([-0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.0, -0.0), // the first again
            vertex([1.0, 0.0, 0.0], up, 0.5, 0.0),                // other texture coordinates
            vertex([0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 0.0, 1.0),   // another normal
        ];
        let mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [3, 4, 5]]);
        assert_eq!(mesh.vertices.len(), 5);
        assert_eq!(mesh.vertices[0].normal, Vec3::Z);
        // Copies of a position stand together, positions in order of first use.
        let positions: Vec<Vec3> = mesh.vertices.iter().map(|v| v.position).collect();
        assert_eq!(positions, [Vec3::ZERO, Vec3::X, Vec3::X, Vec3::Y, Vec3::Y]);
        assert_eq!(mesh.triangles[1].vertices, [0, 2, 4]);
    }

    #[test]
    fn corners_that_coincide_are_dropped_and_counted_but_slivers_stay() {
        let none = [0.0; 3];
        let vertices = [
            vertex([0.1, 0.1, 0.1], none, 0.0, 0.0),
            vertex([0.2, 0.2, 0.2], none, 1.0, 0.0),
            vertex([0.3, 0.3, 0.3], none, 0.0, 1.0),
            vertex([0.1, 0.1, 0.1], none, 0.7, 0.0),
            vertex([0.0, 1.0, 0.0], none, 0.0, 1.0),
            vertex([-0.0, 1.0, -0.0], none, 0.0, 1.0),
        ];
        // A repeated index, two vertices at one position, two that differ in signs of 0, and three on a line.
        let mesh = Mesh::from_triangles(&vertices, &[[0, 0, 4], [0, 3, 4], [4, 1, 5], [0, 1, 2], [0, 1, 4]]);
        assert_eq!((mesh.triangles.len(), mesh.dropped, mesh.vertices.len()), (2, 3, 4));
    }

    #[test]
    fn normals_at_slivers_are_their_neighbours() {
        let none = [0.0; 3];
        let vertices = [
            vertex([0.0, 0.0, 0.0], none, 0.0, 0.0),
            vertex([4.0, 0.0, 0.0], none, 1.0, 0.0),
            vertex([0.0, 4.0, 0.0], none, 0.0, 1.0),
            vertex([4.0, 0.0, 4.0], none, 0.0, 1.0),
            vertex([2.0, 0.0, 0.0], none, 0.5, 0.0),
            vertex([1.0, 0.0, 0.0], none, 0.5, 0.0),
            vertex([1.5, 0.0, 0.0], none, 0.5, 0.0),
        ];
        // Two faces, two slivers with a corner of their own between them, and one that touches no face.
        let faces = [[0, 1, 2], [1, 2, 3], [0, 4, 1], [1, 4, 0], [4, 5, 6]];
        let mesh = Mesh::from_triangles(&vertices, &faces[..4]);
        let normal = |mesh: &Mesh, x: f32| {
            let at = Vec3::new(x, 0.0, 0.0);
            mesh.vertices.iter().find(|v| v.position == at).expect("used").normal
        };
        let without = Mesh::from_triangles(&vertices, &faces[..2]);
        let ends = [0.0, 4.0].map(|x| normal(&without, x));
        assert_eq!([0.0, 4.0].map(|x| normal(&mesh, x)), ends, "slivers weigh nothing");
        let expected = (ends[0] + ends[1]).normalize();
        assert!(normal(&mesh, 2.0).abs_diff_eq(expected, 2f32.powi(-22)), "{:?}", mesh.vertices);
        // A position whose neighbours have none from faces has none.
        let chain = Mesh::from_triangles(&vertices, &faces);
        assert_eq!((normal(&chain, 2.0), normal(&chain, 1.0)), (normal(&mesh, 2.0), Vec3::ZERO));
    }

    /// A triangle with its own plane's normal, in a material, behind one that is left out.
    fn plane() -> Mesh {
        let normal = [2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0];
        let vertices = [
            vertex([1.0, 0.0, 0.0], normal, 0.0, 0.0),
            vertex([0.0, 1.0, 0.0], normal, 1.0, 0.0),
            vertex([0.0, 0.0, 2.0], normal, 0.0, 1.0),
        ];
        Mesh::with_materials(&vertices, [([0, 0, 1], 1), ([0, 1, 2], 3)].into_iter())
    }

    /// Normals stay those of the plane under any scale, and outside stays outside in a mirror.
    #[test]
    fn transformed_meshes_keep_their_outside() {
        let rotation = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-2.0);
        for scale in [DVec3::ONE, DVec3::new(1e-3, 7.0, 2.0), DVec3::new(-1.0, 1.0, 1.0), DVec3::splat(-2.0)]
        {
            let matrix = rotation * DMat3::from_diagonal(scale);
            let transform = DAffine3::from_mat3_translation(matrix, DVec3::new(1.0, 2.0, 3.0));
            let mesh = plane().transformed(transform).expect("finite");
            let [triangle] = mesh.triangles[..] else { panic!("{mesh:?}") };
            assert_eq!((triangle.material(), mesh.dropped, mesh.collapsed), (3, 1, 0));
            for v in &mesh.vertices {
                // The triangle is up to 7 long and 1e-3 wide, and its corners are off by 2^-24 of 4.
                assert!(v.normal.abs_diff_eq(normal_in(&mesh, triangle), 1e-3), "{scale} {v:?}");
            }
            let moved = transform.transform_point3(DVec3::new(0.0, 0.0, 2.0)).as_vec3();
            assert!(mesh.vertices.iter().any(|v| v.position == moved && v.v == 1.0));
        }
    }

    #[test]
    fn transforms_that_leave_nothing_are_told() {
        let scaled = |scale: f64| plane().transformed(DAffine3::from_scale(DVec3::splat(scale)));
        assert!(scaled(1e39).is_none());
        // All corners become 0.
        assert!(scaled(1e-60).is_none());
        assert!(scaled(1e-20).is_some());
    }

    #[test]
    fn appended_meshes_have_their_own_vertices() {
        let mut mesh = Mesh::default();
        for _ in 0..3 {
            mesh.append(plane());
        }
        assert_eq!((mesh.vertices.len(), mesh.dropped), (9, 3));
        assert_eq!(mesh.starts, [3, 6]);
        let indices: Vec<_> = mesh.triangles.iter().map(|t| t.vertices).collect();
        assert_eq!(indices, [[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
        let mut two = plane();
        two.append(mesh);
        assert_eq!(two.starts, [3, 6, 9]);
    }

    #[test]
    fn bounds_hold_every_vertex() {
        let (vertices, triangles) = fold();
        let mesh = Mesh::from_triangles(&vertices, &triangles);
        assert_eq!(mesh.bounds(), Some((Vec3::new(0.0, 0.0, -2.0), Vec3::ONE - Vec3::Z)));
        assert_eq!(Mesh::default().bounds(), None);
    }
}
