//! The micro-triangle surface in f64, stored: what the kernels never do.

use super::UNIT_ROUNDOFF;
use super::relief::Relief;
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::FLIPPED;
use glam::{DVec2, DVec3};

/// A micro-triangle within its piece, by the grid points (j, k) of its three vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cell {
    pub(super) j: u32,
    pub(super) k: u32,
    pub(super) upper: bool,
}

impl Cell {
    /// The cell of a packed word as `Intersection::cell` documents it: j in 13 bits, k in 13 bits, a bit for upper.
    pub(super) fn unpack(word: u32) -> Cell {
        Cell { j: word % 8192, k: word / 8192 % 8192, upper: word / 8192 / 8192 % 2 == 1 }
    }

    /// The other way round.
    pub(super) fn pack(self) -> u32 {
        self.j + 8192 * (self.k + 8192 * u32::from(self.upper))
    }

    /// The grid points of its vertices, in the order of the base triangle's.
    pub(super) fn grid_points(self) -> [(u32, u32); 3] {
        let Cell { j, k, upper } = self;
        if upper { [(j + 1, k + 1), (j, k + 1), (j + 1, k)] } else { [(j, k), (j + 1, k), (j, k + 1)] }
    }
}

/// Which micro-vertices are one and the same: those of an edge belong to all triangles with that edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VertexKey {
    /// A vertex of the base mesh.
    Corner(u32),
    /// On the base edge between two vertices, ascending, so many steps from the first.
    Edge(u32, u32, u32),
    /// Inside a base triangle, at grid point (j, k).
    Inside(u32, u32, u32),
}

/// The displaced grid over one base triangle.
pub(super) struct Piece {
    /// Index of the base triangle.
    pub(super) base: u32,
    /// Least corner of the box around its micro-vertices.
    pub(super) min: DVec3,
    /// Greatest corner.
    pub(super) max: DVec3,
    /// Its micro-vertices, row by row: (0,0), (0,1), .. (0,N), (1,0), ..
    pub(super) vertices: Vec<DVec3>,
    /// Texture coordinates of the base triangle's vertices.
    pub(super) uv: [DVec2; 3],
    /// Whether the stored order is clockwise seen from outside.
    pub(super) flipped: bool,
    /// Greatest distance by which f32 arithmetic may move one of its micro-vertices.
    pub(super) error: f64,
    corners: [u32; 3],
    n: u32,
}

impl Piece {
    /// Displaces the grid of base triangle `base`: P + h n / |n|, all interpolated linearly; where the interpolated
    /// normal vanishes there is no direction to displace in, and the vertex stays.
    pub(super) fn new(buffers: &SceneBuffers, relief: &Relief, base: u32, n: u32) -> Self {
        let triangle = buffers.triangles[base as usize];
        let corners = triangle.vertices.map(|v| buffers.vertices[v as usize]);
        let p = corners.map(|v| v.position.as_dvec3());
        let normals = corners.map(|v| v.normal.as_dvec3());
        let uv = corners.map(|v| DVec2::new(f64::from(v.u), f64::from(v.v)));
        let mut piece = Piece {
            base,
            min: DVec3::INFINITY,
            max: DVec3::NEG_INFINITY,
            vertices: Vec::new(),
            uv,
            flipped: triangle.flags & FLIPPED != 0,
            error: 0.0,
            corners: triangle.vertices,
            n,
        };
        for (j, k) in (0..=n).flat_map(|j| (0..=n - j).map(move |k| (j, k))) {
            let w = piece.weights(j, k);
            let (point, normal) = (mixed(w, p), mixed(w, normals));
            let length = normal.length();
            let height = relief.height(mixed(w, uv));
            let direction = normal.normalize_or_zero();
            let vertex = point + height * direction;
            let height_error = relief.height_error(mixed(w, uv.map(DVec2::abs)));
            let error = vertex_error(mixed(w, p.map(DVec3::abs)), length, height, height_error);
            piece.error = piece.error.max(error);
            piece.min = piece.min.min(vertex);
            piece.max = piece.max.max(vertex);
            piece.vertices.push(vertex);
        }
        piece
    }

    /// All its cells.
    pub(super) fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let n = self.n;
        (0..n).flat_map(move |j| {
            (0..n - j).flat_map(move |k| {
                let lower = Cell { j, k, upper: false };
                let upper = Cell { j, k, upper: true };
                std::iter::once(lower).chain((j + k + 1 < n).then_some(upper))
            })
        })
    }

    /// Place of grid point (j, k) among the vertices: rows 0 to j - 1 have N + 1, N, .. of them.
    pub(super) fn index(&self, (j, k): (u32, u32)) -> usize {
        let (n, j, k) = (self.n as usize, j as usize, k as usize);
        j * (n + 1) - j * (j.max(1) - 1) / 2 + k
    }

    /// The micro-vertices of a cell.
    pub(super) fn corners(&self, cell: Cell) -> [DVec3; 3] {
        cell.grid_points().map(|point| self.vertices[self.index(point)])
    }

    /// Barycentric coordinates of grid point (j, k) on the base triangle.
    pub(super) fn weights(&self, j: u32, k: u32) -> [f64; 3] {
        [self.n - j - k, j, k].map(|m| f64::from(m) / f64::from(self.n))
    }

    /// What the micro-vertex at a grid point shares with those of other base triangles.
    pub(super) fn key(&self, (j, k): (u32, u32)) -> VertexKey {
        let steps = [self.n - j - k, j, k];
        let present: Vec<(u32, u32)> =
            self.corners.into_iter().zip(steps).filter(|&(_, steps)| steps > 0).collect();
        match present[..] {
            [(vertex, _)] => VertexKey::Corner(vertex),
            [(a, _), (b, from_a)] if a < b => VertexKey::Edge(a, b, from_a),
            [(a, from_b), (b, _)] => VertexKey::Edge(b, a, from_b),
            _ => VertexKey::Inside(self.base, j, k),
        }
    }
}

/// How far f32 arithmetic may move a micro-vertex at `height` over a point whose coordinates are sums of terms that
/// add up to `magnitude`, with an interpolated normal of `length` and a height off by `height_error`.
///
/// Point and normal are off by 4 u of their terms (weight, product, two fused sums). The normal's add up to a vector no
/// longer than 1, so that its direction is off by at most 8 u / length; the squares, the root and the quotient add
/// 4 u to the direction's length. The last fused operation rounds the coordinate. A direction, however wrong, is no
/// longer than 1, so that two are at most 2 apart.
fn vertex_error(magnitude: DVec3, length: f64, height: f64, height_error: f64) -> f64 {
    let direction = UNIT_ROUNDOFF * (8.0 / length + 4.0);
    let lift = height.abs() * direction.min(2.0) + height_error;
    let rounding = UNIT_ROUNDOFF * (5.0 * magnitude + DVec3::splat(height.abs()));
    lift + rounding.length()
}

/// The weighted sum of three values.
pub(super) fn mixed<T>(w: [f64; 3], v: [T; 3]) -> T
where
    T: std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    let [a, b, c] = v;
    a * w[0] + b * w[1] + c * w[2]
}
