//! Who is right: the micro-triangle surface in f64, met by rays in the plainest way.
//!
//! The oracle reads what the host hands to the kernels (vertices, triangles, texels, settings) and shares no code
//! with them: its own height map, its own micro-vertices, which it stores, its own ray/triangle test in the plane
//! across the ray, a loop over all boxes and all micro-triangles in them. Surfaces are as each base triangle's own
//! vertices define them: where two triangles at an edge do not share its vertices (split normals or texture
//! coordinates), the edge is a border of both.
//!
//! # When f32 may differ
//! To first order in the unit roundoff u, every f32 result is exact for micro-vertices that are moved a little:
//! - by the error of the micro-vertex itself (`Piece::error`), in any direction;
//! - across the ray by the ray/triangle test: the difference to the origin is off by 1 u, the shear by 5 u (two
//!   components of the direction by 2 u each, their quotient), its product and sum by 2 u. With D the greatest
//!   coordinate difference to the origin that is 9 u D in each of two coordinates, less than 13 u D together. The
//!   signs of its edge functions are those of exact arithmetic.
//!
//! All triangles at a vertex see it moved alike. Together the move is at most [`Answer::lateral_error`], e. So:
//! - A triangle that f32 reports comes within e of the ray, seen along the ray.
//! - Its distance is that of its plane within e / cos, since the true triangle has a point within e of the reported
//!   one, and within e of the depths of its vertices; both widened by what rounding the depths adds, 15 u of a depth
//!   that is at most sqrt(3) D: 5 u for the vertices' depths, 8 u for the weighted sum and its quotient, 2 u for the
//!   scale by the direction's length.
//! - A ray that goes through triangles, and past every outline of the surface (an edge at its border, or one whose
//!   two triangles lie on the same side of it) at more than e, is not let through by f32 either: moving vertices by
//!   e moves no outline across the ray. Which of the triangles around an edge or vertex is hit may differ.

mod relief;
mod tessellation;
mod verdict;

pub use verdict::{Clarity, Disagreement};

use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{Frame, MISS, Ray};
use emboss_kernels::scene::Features;
use glam::{DVec2, DVec3};
use relief::Relief;
use tessellation::{Cell, Piece, VertexKey};

/// Unit roundoff of f32.
const UNIT_ROUNDOFF: f64 = 1.0 / 16_777_216.0;

/// The surface of a scene, ready to be asked.
pub struct Oracle {
    pieces: Vec<Piece>,
    /// Greatest error of a micro-vertex.
    vertex_error: f64,
}

/// Everything that a ray comes near to.
#[derive(Clone, Debug)]
pub struct Answer {
    /// All micro-triangles within [`lateral_error`](Self::lateral_error) of the ray's line, nearest first.
    pub meetings: Vec<Meeting>,
    /// Bound on how far, seen along the ray, f32 arithmetic moves a vertex: in model units.
    pub lateral_error: f64,
    /// The ray's length in model units.
    t_max: f64,
    /// Length of the ray's direction, by which reported distances are multiplied.
    direction_length: f64,
}

/// A micro-triangle near a ray.
#[derive(Clone, Debug)]
pub struct Meeting {
    /// Distance at which the line meets the triangle's plane, in model units; infinite where it runs along it.
    pub t: f64,
    /// Least distance that f32 arithmetic may give; above `t_high` where no hit can be explained.
    pub t_low: f64,
    /// Greatest such distance.
    pub t_high: f64,
    /// Index of the base triangle.
    pub base: u32,
    /// The packed cell, as in [`Intersection::cell`](emboss_kernels::interface::Intersection).
    pub cell: u32,
    /// Distance from the line to the triangle's outline, seen along the ray: negative outside of it.
    pub margin: f64,
    /// The vertices across the ray, its line at the origin.
    outline: [DVec2; 3],
    keys: [VertexKey; 3],
}

impl Oracle {
    /// Tessellates the scene: (N+1)(N+2)/2 vertices of 24 bytes for each base triangle.
    ///
    /// # Panics
    /// Where indices point beyond their buffers, as no scene that the host prepared does.
    pub fn new(buffers: &SceneBuffers, frame: &Frame, features: Features) -> Self {
        let relief = Relief::new(buffers, &buffers.displacements[0], features);
        let pieces: Vec<Piece> = (0..frame.triangle_count)
            .map(|base| Piece::new(buffers, &relief, base, frame.subdivisions))
            .collect();
        let vertex_error = pieces.iter().fold(0.0, |most, piece| piece.error.max(most));
        Oracle { pieces, vertex_error }
    }

    /// All that the ray's line comes near to.
    pub fn trace(&self, ray: &Ray) -> Answer {
        let line = Line::new(ray);
        let reach = self.pieces.iter().map(|piece| line.reach(piece)).fold(0.0, f64::max);
        let errors = Errors {
            lateral: self.vertex_error + 13.0 * UNIT_ROUNDOFF * reach,
            depth: 15.0 * UNIT_ROUNDOFF * 3.0_f64.sqrt() * reach,
        };
        let mut meetings: Vec<Meeting> = self
            .pieces
            .iter()
            .filter(|piece| line.nears(piece, errors.lateral))
            .flat_map(|piece| line.meetings(piece, errors))
            .collect();
        meetings.sort_by(|a, b| a.t.total_cmp(&b.t));
        Answer {
            meetings,
            lateral_error: errors.lateral,
            t_max: f64::from(ray.t_max) * line.length,
            direction_length: line.length,
        }
    }
}

impl Answer {
    /// The nearest hit in exact arithmetic; `None` on a miss.
    pub fn nearest(&self) -> Option<&Meeting> {
        self.meetings.iter().find(|m| m.margin >= 0.0 && (0.0..=self.t_max).contains(&m.t))
    }
}

/// Bounds on what f32 arithmetic does to a ray's hits.
#[derive(Clone, Copy)]
struct Errors {
    /// Of a vertex, as seen along the ray.
    lateral: f64,
    /// Of a distance, apart from what follows of that.
    depth: f64,
}

/// A ray's line with a frame of coordinates around it.
struct Line {
    origin: DVec3,
    /// Unit direction.
    direction: DVec3,
    /// Two unit vectors across it.
    across: [DVec3; 2],
    /// Length of the ray's own direction.
    length: f64,
}

impl Line {
    fn new(ray: &Ray) -> Self {
        let direction = ray.direction.as_dvec3();
        let (x, y) = direction.normalize().any_orthonormal_pair();
        Line {
            origin: ray.origin.as_dvec3(),
            direction: direction.normalize(),
            across: [x, y],
            length: direction.length(),
        }
    }

    /// Greatest coordinate difference between the origin and a point of the piece.
    fn reach(&self, piece: &Piece) -> f64 {
        (piece.min - self.origin).abs().max((piece.max - self.origin).abs()).max_element()
    }

    /// Whether the line comes within `distance` of the sphere around the piece.
    fn nears(&self, piece: &Piece, distance: f64) -> bool {
        let centre = self.local((piece.min + piece.max) * 0.5);
        let radius = 0.5 * (piece.max - piece.min).length();
        centre.truncate().length() <= radius + distance
    }

    /// A point across the ray (first two coordinates) and along it (third).
    fn local(&self, p: DVec3) -> DVec3 {
        let p = p - self.origin;
        DVec3::new(p.dot(self.across[0]), p.dot(self.across[1]), p.dot(self.direction))
    }

    /// The micro-triangles of the piece that come within the errors of the line.
    fn meetings(&self, piece: &Piece, errors: Errors) -> Vec<Meeting> {
        let local: Vec<DVec3> = piece.vertices.iter().map(|&p| self.local(p)).collect();
        let meeting = |cell: Cell| {
            let corners = cell.grid_points().map(|point| local[piece.index(point)]);
            let margin = margin(corners.map(DVec3::truncate), errors.lateral)?;
            let (t, t_low, t_high) = distances(corners, errors);
            let keys = cell.grid_points().map(|point| piece.key(point));
            let outline = corners.map(DVec3::truncate);
            Some(Meeting { t, t_low, t_high, base: piece.base, cell: cell.pack(), margin, outline, keys })
        };
        piece.cells().filter_map(meeting).collect()
    }
}

/// Distance from the origin to the outline of a triangle, negative outside; `None` beyond `reach` outside.
fn margin(p: [DVec2; 3], reach: f64) -> Option<f64> {
    let min = p[0].min(p[1]).min(p[2]);
    let max = p[0].max(p[1]).max(p[2]);
    if min.max_element() > reach || max.min_element() < -reach {
        return None;
    }
    let sides = [0, 1, 2].map(|e| p[(e + 1) % 3].perp_dot(p[(e + 2) % 3]));
    let inside = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
    let distance = (0..3).map(|e| edge_distance(p, e)).fold(f64::INFINITY, f64::min);
    let margin = if inside { distance } else { -distance };
    (margin >= -reach).then_some(margin)
}

/// Distance from the origin to the edge across from vertex `e`.
fn edge_distance(p: [DVec2; 3], e: usize) -> f64 {
    let (a, b) = (p[(e + 1) % 3], p[(e + 2) % 3]);
    let along = b - a;
    let squared = along.length_squared();
    let s = if squared > 0.0 { (-a.dot(along) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + along * s).length()
}

/// Distance to the triangle's plane, and the least and greatest that f32 may report: see the head of this file.
fn distances(p: [DVec3; 3], errors: Errors) -> (f64, f64, f64) {
    let normal = (p[1] - p[0]).cross(p[2] - p[0]);
    let depths = p.map(|p| p.z);
    let (least, greatest) = (
        depths.into_iter().fold(f64::INFINITY, f64::min),
        depths.into_iter().fold(f64::NEG_INFINITY, f64::max),
    );
    let beyond = errors.lateral + errors.depth;
    let (least, greatest) = (least - beyond, greatest + beyond);
    // A triangle without area, or seen edge-on, has no plane to speak of.
    if normal.z == 0.0 {
        return (f64::INFINITY, least, greatest);
    }
    let t = normal.dot(p[0]) / normal.z;
    let cosine = normal.z.abs() / normal.length();
    let error = errors.lateral / cosine + errors.depth;
    (t, least.max(t - error), greatest.min(t + error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::{Displacement, Triangle, Vertex};
    use glam::Vec3;

    /// The triangle (0,0,0), (4,0,0), (0,4,0) facing +z, raised by 1, N = 2.
    fn raised() -> Oracle {
        let vertex = |x, y| Vertex { position: Vec3::new(x, y, 0.0), normal: Vec3::Z, ..Vertex::default() };
        let buffers = SceneBuffers {
            vertices: vec![vertex(0.0, 0.0), vertex(4.0, 0.0), vertex(0.0, 4.0)],
            triangles: vec![Triangle { vertices: [0, 1, 2], ..Triangle::default() }],
            displacements: vec![Displacement {
                scale: 1.0,
                map_width: 1,
                map_height: 1,
                ..Displacement::default()
            }],
            height_texels: vec![255],
            ..SceneBuffers::default()
        };
        let frame = Frame { subdivisions: 2, triangle_count: 1, ..Frame::default() };
        Oracle::new(&buffers, &frame, Features::default())
    }

    fn down(x: f32, y: f32) -> Ray {
        Ray { origin: Vec3::new(x, y, 5.0), t_max: f32::INFINITY, direction: -Vec3::Z * 2.0, padding: 0 }
    }

    #[test]
    fn ray_meets_the_cell_under_it() {
        for (x, y, cell, margin) in [
            (0.5, 0.5, Cell { j: 0, k: 0, upper: false }, 0.5),
            (2.5, 0.5, Cell { j: 1, k: 0, upper: false }, 0.5),
            (1.5, 1.5, Cell { j: 0, k: 0, upper: true }, 0.5),
        ] {
            let answer = raised().trace(&down(x, y));
            let nearest = answer.nearest().expect("hit");
            assert_eq!((nearest.cell, answer.meetings.len()), (cell.pack(), 1));
            assert!(
                (nearest.t - 4.0).abs() < 1e-12 && (nearest.margin - margin).abs() < 1e-12,
                "{nearest:?}"
            );
        }
        assert!(raised().trace(&down(3.0, 3.0)).nearest().is_none());
        assert!(raised().trace(&Ray { t_max: 1.9, ..down(0.5, 0.5) }).nearest().is_none());
    }

    #[test]
    fn both_triangles_at_an_edge_are_near_a_ray_through_it() {
        let answer = raised().trace(&down(1.0, 1.0));
        assert_eq!(answer.meetings.len(), 2);
        assert!(answer.meetings.iter().all(|m| m.margin.abs() < answer.lateral_error));
    }

    #[test]
    fn all_around_a_vertex_are_near_a_ray_through_it() {
        assert_eq!(raised().trace(&down(2.0, 0.0)).meetings.len(), 3);
    }
}
