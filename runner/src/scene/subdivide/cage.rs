//! Control meshes: polygons over welded positions, with texture coordinates and creases.

use super::Boundary;
use crate::scene::Mesh;
use crate::scene::precise::PreciseVertex;
use emboss_kernels::interface::FLIPPED;
use glam::{DVec2, DVec3};
use std::collections::{HashMap, HashSet};

/// A mesh of polygons that is to be subdivided.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cage {
    /// The positions, each there once.
    pub(super) positions: Vec<DVec3>,
    /// Texture coordinates, each pair of one vertex alone; z is 0, so that what moves positions moves them too.
    pub(super) uvs: Vec<DVec3>,
    /// The polygons, one after the other.
    pub(super) faces: Vec<Face>,
    /// Their corners, counter-clockwise seen from outside.
    pub(super) corners: Vec<Corner>,
    /// Which positions never move.
    pub(super) held: Vec<bool>,
    /// How many triangles were left out, since positions of theirs were one.
    pub(super) dropped: usize,
}

/// A polygon: three corners or more, at as many positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Face {
    /// The first of its corners.
    pub(super) first: u32,
    /// How many they are.
    pub(super) count: u32,
    /// Index of its material.
    pub(super) material: u32,
    /// Its smoothing group: edges between two of them are creases.
    pub(super) group: u32,
}

/// A corner of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    /// Its position.
    pub(super) vertex: u32,
    /// Its texture coordinates.
    pub(super) uv: u32,
    /// Whether the edge from here to the polygon's next corner is a crease.
    pub(super) crease: bool,
}

/// Makes a [`Cage`] polygon by polygon.
#[derive(Debug, Default)]
pub(crate) struct CageBuilder {
    cage: Cage,
    vertices: HashMap<[u64; 3], u32>,
    uvs: HashMap<(u32, [u64; 2]), u32>,
}

impl CageBuilder {
    /// Adds a polygon. Positions that agree are one, also where texture coordinates do not. Corners that repeat the
    /// position before them are left out; a polygon that has fewer than three then, or comes back to a position, is
    /// left out itself and counted.
    pub(crate) fn polygon(
        &mut self,
        corners: impl Iterator<Item = (DVec3, DVec2)>,
        material: u32,
        group: u32,
    ) {
        let mut ring: Vec<Corner> = Vec::new();
        let mut given = 0;
        for (position, uv) in corners {
            given += 1;
            let corner = self.corner(position, uv);
            if ring.last().is_none_or(|last| last.vertex != corner.vertex) {
                ring.push(corner);
            }
        }
        while ring.len() > 1 && ring[0].vertex == ring[ring.len() - 1].vertex {
            ring.pop();
        }
        let different: HashSet<u32> = ring.iter().map(|corner| corner.vertex).collect();
        if ring.len() < 3 || different.len() < ring.len() {
            self.cage.dropped += usize::max(given, 3) - 2;
            return;
        }
        self.cage.push(&ring, material, group);
    }

    /// The control mesh.
    pub(crate) fn finish(self) -> Cage {
        self.cage
    }

    fn corner(&mut self, position: DVec3, uv: DVec2) -> Corner {
        // -0 is 0.
        let bits = |x: f64| (x + 0.0).to_bits();
        let cage = &mut self.cage;
        let vertex = *self.vertices.entry(position.to_array().map(bits)).or_insert_with(|| {
            cage.positions.push(position);
            cage.held.push(false);
            index(cage.positions.len() - 1)
        });
        let uv = *self.uvs.entry((vertex, uv.to_array().map(bits))).or_insert_with(|| {
            cage.uvs.push(uv.extend(0.0));
            index(cage.uvs.len() - 1)
        });
        Corner { vertex, uv, crease: false }
    }
}

impl Cage {
    /// The control mesh of a mesh's triangles.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Cage {
        let mut builder = CageBuilder::default();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.vertices;
            let order = if triangle.flags & FLIPPED != 0 { [a, c, b] } else { [a, b, c] };
            let corners = order.into_iter().map(|v| {
                let vertex = mesh.vertices[v as usize];
                let tile = mesh.tiles.get(v as usize).copied().unwrap_or_default();
                let uv = DVec2::new(vertex.u.into(), vertex.v.into()) + tile;
                (mesh.space.world(vertex.position.as_dvec3()), uv)
            });
            builder.polygon(corners, triangle.material(), 0);
        }
        let mut cage = builder.finish();
        cage.dropped += mesh.dropped + mesh.collapsed;
        cage
    }

    /// Adds a polygon.
    pub(super) fn push(&mut self, ring: &[Corner], material: u32, group: u32) {
        let face = Face { first: index(self.corners.len()), count: index(ring.len()), material, group };
        self.faces.push(face);
        self.corners.extend_from_slice(ring);
    }

    /// How many corners they have.
    pub(super) fn corner_count(&self) -> u64 {
        self.corners.len() as u64
    }

    /// How many triangles they are, cut into fans.
    pub(super) fn fan_triangles(&self) -> u64 {
        self.faces.iter().map(|face| u64::from(face.count) - 2).sum()
    }

    /// The triangles of all fans: their corners, and the material.
    pub(super) fn fans(&self) -> impl Iterator<Item = ([u32; 3], u32)> {
        self.faces.iter().flat_map(|face| {
            let first = face.first;
            (1..face.count - 1).map(move |i| ([first, first + i, first + i + 1], face.material))
        })
    }

    /// The same surface, as it is cut into fans. Creases stay where they are.
    pub(super) fn cut_into_fans(&self) -> Cage {
        let mut cut = Cage { faces: Vec::new(), corners: Vec::new(), ..self.clone() };
        for face in &self.faces {
            let ring = &self.corners[face.corners()];
            for i in 1..ring.len() - 1 {
                // The fan's inner edges are none of the polygon's.
                let from =
                    |c: usize, is_outer: bool| Corner { crease: ring[c].crease && is_outer, ..ring[c] };
                let triangle = [from(0, i == 1), from(i, true), from(i + 1, i + 2 == ring.len())];
                cut.push(&triangle, face.material, face.group);
            }
        }
        cut
    }

    /// Marks the edges between two faces as creases whose smoothing groups differ, or whose normals are more than
    /// `angle` degrees apart. A face without an area has no normal, and no crease for that.
    pub(super) fn mark_creases(&mut self, angle: Option<f64>) {
        let limit = angle.map(|degrees| degrees.to_radians().cos());
        let normals: Vec<DVec3> = self.faces.iter().map(|face| self.area_normal(face)).collect();
        // The faces at each edge, and the corner that it begins at in each.
        let mut edges: HashMap<[u32; 2], Vec<(usize, usize)>> = HashMap::new();
        for (f, face) in self.faces.iter().enumerate() {
            for c in face.corners() {
                let mut ends = [self.corners[c].vertex, self.corners[face.next(c)].vertex];
                ends.sort_unstable();
                edges.entry(ends).or_default().push((f, c));
            }
        }
        for sides in edges.values() {
            let [(f, c), (g, d)] = sides[..] else { continue };
            let (m, n) = (normals[f], normals[g]);
            let is_bent = limit.is_some_and(|limit| m.dot(n) < limit * m.length() * n.length());
            if is_bent || self.faces[f].group != self.faces[g].group {
                (self.corners[c].crease, self.corners[d].crease) = (true, true);
            }
        }
    }

    /// Has the borders' corners stay where that is asked for.
    pub(super) fn hold_corners(&mut self, boundary: Boundary) {
        let mut faces = vec![0; self.positions.len()];
        self.corners.iter().for_each(|corner| faces[corner.vertex as usize] += 1);
        if boundary == Boundary::Corners {
            self.held = faces.into_iter().map(|count| count == 1).collect();
        }
    }

    /// Twice the area of a polygon, along its normal (Newell).
    fn area_normal(&self, face: &Face) -> DVec3 {
        let at = |c: usize| self.positions[self.corners[c].vertex as usize];
        let first = at(face.first as usize);
        face.corners().map(|c| (at(c) - first).cross(at(face.next(c)) - first)).sum()
    }

    /// A corner as a vertex of a mesh.
    pub(super) fn vertex(&self, corner: Corner, normal: DVec3) -> PreciseVertex {
        let position = self.positions[corner.vertex as usize];
        let uv = self.uvs[corner.uv as usize].truncate();
        PreciseVertex { position, normal: normal.as_vec3(), uv }
    }
}

impl Face {
    /// The indices of its corners.
    pub(super) fn corners(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// The corner after corner `c` of it.
    pub(super) fn next(&self, c: usize) -> usize {
        let next = c + 1;
        if next == self.corners().end { self.first as usize } else { next }
    }

    /// The corner before corner `c` of it.
    pub(super) fn previous(&self, c: usize) -> usize {
        if c == self.first as usize { self.corners().end - 1 } else { c - 1 }
    }
}

/// A count as an index.
pub(super) fn index(count: usize) -> u32 {
    u32::try_from(count).expect("what is subdivided is below the limit of a BVH")
}
