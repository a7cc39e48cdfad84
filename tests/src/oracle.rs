//! Who is right: the micro-triangle surface in f64, met by rays in the plainest way.
//!
//! The oracle reads what the host hands to the kernels (vertices, triangles with the numbers of their maps, texels,
//! settings) and shares no code with them: its own height maps, its own decisions at seams, its own micro-vertices,
//! which it stores, its own tree of boxes around them, its own ray/triangle test in the plane across the ray. It does
//! not look at what the host worked out of these: bounds on heights, pyramids, tables of seams, the BVH.
//!
//! Tangents of vertices are the host's, as their normals are. With [`Features::seams`] set, triangles whose vertices
//! stand at the same places share the micro-vertices there, whatever else they disagree on; without, where they do not
//! share vertices and map, an edge is a border of both.
//!
//! # When f32 may differ
//! To first order in the unit roundoff u, every f32 result is exact for micro-vertices that are moved a little:
//! - by the error of the micro-vertex itself (`Piece::error`), in any direction;
//! - across the ray by the ray/triangle test (`Rounding::across`).
//!
//! All triangles at a vertex see it moved alike. Together the move is at most [`Answer::lateral_error`], e. So:
//! - A triangle that f32 reports comes within e of the ray, seen along the ray.
//! - Its distance is that of its plane within e / cos, since the true triangle has a point within e of the reported
//!   one, and within e of the depths of its vertices; both widened by what rounding the depths adds
//!   (`Rounding::along`), of a depth that is at most sqrt(3) D, D the greatest coordinate difference to the origin.
//! - A ray that goes through triangles, and past every outline of the surface (an edge at its border, or one whose
//!   two triangles lie on the same side of it) at more than e, is not let through by f32 either: moving vertices by
//!   e moves no outline across the ray. Which of the triangles around an edge or vertex is hit may differ.

mod cutting;
mod limit;
mod line;
mod relief;
mod rounding;
mod tessellation;
mod tree;
mod vectors;
mod verdict;
mod welding;

pub use limit::{LimitNormal, LimitSurface};
pub use verdict::{Clarity, Disagreement};

use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{Frame, MISS, Ray};
use emboss_kernels::scene::Features;
use glam::{DVec2, DVec3};
use line::{Errors, Line, edge_distance};
use rayon::prelude::*;
use rounding::{Rounding, UNIT_ROUNDOFF};
use std::cmp::Ordering::Equal;
use tessellation::{Base, Cell, Piece, VertexKey};
use tree::{Box3, Tree};

/// The surface of a scene, ready to be asked.
pub struct Oracle {
    pieces: Vec<Piece>,
    tree: Tree,
    /// Around all micro-vertices.
    bounds: Box3,
    /// Greatest error of a micro-vertex.
    vertex_error: f64,
    rounding: Rounding,
}

/// A ray in numbers that f32 does not have.
#[derive(Clone, Copy, Debug)]
pub struct WideRay {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes, of any length.
    pub direction: DVec3,
    /// Its end, in lengths of the direction.
    pub t_max: f64,
    /// By how much the ray that f32 traces may be beside it where it starts, and by how much along it.
    pub start_error: f64,
    /// How far that ray's direction may be turned, as a tangent; distances may be off by as much of themselves.
    pub slope_error: f64,
}

impl From<&Ray> for WideRay {
    fn from(ray: &Ray) -> WideRay {
        WideRay {
            origin: ray.origin.as_dvec3(),
            direction: ray.direction.as_dvec3(),
            t_max: ray.t_max.into(),
            start_error: 0.0,
            slope_error: 0.0,
        }
    }
}

/// Everything that a ray comes near to.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// All micro-triangles within [`lateral_error`](Self::lateral_error) of the ray's line, nearest first, but for
    /// those that lie behind its origin for certain.
    pub meetings: Vec<Meeting>,
    /// Bound on how far, seen along the ray, f32 arithmetic moves a vertex: in model units.
    pub lateral_error: f64,
    /// The ray's length in model units.
    t_max: f64,
    /// Length of the ray's direction, by which reported distances are multiplied.
    direction_length: f64,
}

/// A micro-triangle near a ray.
#[derive(Clone, Debug, PartialEq)]
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
    /// The judge of the CPU, whose operations are correctly rounded. Stores (N+1)(N+2)/2 vertices of 24 bytes for each
    /// base triangle.
    ///
    /// # Panics
    /// Where indices point beyond their buffers, as no scene that the host prepared does.
    pub fn new(buffers: &SceneBuffers, frame: &Frame, features: Features) -> Self {
        Oracle::with_rounding(buffers, frame, features, Rounding::IEEE)
    }

    /// The judge of a Vulkan device, which may round as its specification allows.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of_vulkan(buffers: &SceneBuffers, frame: &Frame, features: Features) -> Self {
        Oracle::with_rounding(buffers, frame, features, Rounding::VULKAN)
    }

    fn with_rounding(buffers: &SceneBuffers, frame: &Frame, features: Features, rounding: Rounding) -> Self {
        let base = Base::new(buffers, frame, features, rounding);
        let pieces: Vec<Piece> =
            (0..frame.triangle_count).into_par_iter().map(|triangle| Piece::new(&base, triangle)).collect();
        let vertex_error = pieces.iter().fold(0.0, |most, piece| piece.error.max(most));
        let bounds = pieces.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), piece| {
            (min.min(piece.min), max.max(piece.max))
        });
        Oracle { tree: Tree::new(&pieces), pieces, bounds: Box3::new(bounds), vertex_error, rounding }
    }

    /// All that the ray's line comes near to.
    pub fn trace(&self, ray: &Ray) -> Answer {
        self.trace_wide(&ray.into())
    }

    /// The same of a ray that f32 does not trace as it is.
    pub fn trace_wide(&self, ray: &WideRay) -> Answer {
        let line = Line::new(ray.origin, ray.direction);
        let mut errors = self.errors(&line);
        let Box3 { centre, half } = self.bounds;
        let moved = ray.start_error + ray.slope_error * ((centre - line.origin).abs() + half).length();
        errors.lateral += moved;
        errors.depth += moved;
        let mut meetings = Vec::new();
        // The boxes' own rounding, in f64, is far below a thousandth of errors that are f32's.
        self.tree.visit(&line, 1.001 * (errors.lateral + errors.depth), |block| {
            line.add_meetings(&self.pieces[block.piece as usize], block, errors, &mut meetings);
        });
        self.answer(ray, &line, errors, meetings)
    }

    /// What rounding may do to hits of that line's ray.
    fn errors(&self, line: &Line) -> Errors {
        let Box3 { centre, half } = self.bounds;
        let reach = ((centre - line.origin).abs() + half).max_element();
        Errors {
            lateral: self.vertex_error + self.rounding.across() * UNIT_ROUNDOFF * reach,
            depth: self.rounding.along() * UNIT_ROUNDOFF * 3.0_f64.sqrt() * reach,
        }
    }

    fn answer(&self, ray: &WideRay, line: &Line, errors: Errors, mut meetings: Vec<Meeting>) -> Answer {
        meetings.sort_by(|a, b| (a.t, a.base, a.cell).partial_cmp(&(b.t, b.base, b.cell)).unwrap_or(Equal));
        Answer {
            meetings,
            lateral_error: errors.lateral,
            t_max: ray.t_max * line.length,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RaySource, scenes};
    use emboss::render::Scene;
    use emboss::settings::Wrap;
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

    /// All that [`Oracle::trace`] finds, without its tree.
    fn by_plain_loop(oracle: &Oracle, ray: &Ray) -> Answer {
        let line = Line::new(ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let errors = oracle.errors(&line);
        let mut meetings = Vec::new();
        for piece in &oracle.pieces {
            for block in piece.blocks() {
                line.add_meetings(piece, block, errors, &mut meetings);
            }
        }
        oracle.answer(&ray.into(), &line, errors, meetings)
    }

    #[test]
    fn tree_gives_the_meetings_of_the_plain_loop() {
        for (name, n, count) in
            [("builtin:cube", 17, 1500), ("builtin:quilt", 6, 1500), ("builtin:knot", 3, 300)]
        {
            let scene = Scene { subdivisions: n, ..scenes::builtin(name) };
            let job = scenes::ready(scene, Wrap::Repeat);
            let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
            let mut source = RaySource::new(&job, 11);
            let mut rays: Vec<Ray> = (0..count)
                .flat_map(|_| [source.from_outside(), source.from_inside(), source.towards_edge(3.0)])
                .collect();
            // Along the axes the products of a box test are zero, or one is all there is.
            let axes = [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::new(0.0, 1.0, -1.0)];
            let along = |(i, ray): (usize, Ray)| Ray { direction: axes[i % 4], ..ray };
            rays.extend(rays.clone().into_iter().step_by(7).enumerate().map(along));
            let mut found = 0;
            for ray in &rays {
                let answer = oracle.trace(ray);
                assert_eq!(answer, by_plain_loop(&oracle, ray), "{name}: {ray:?}");
                found += answer.meetings.len();
            }
            assert!(2 * found > rays.len(), "{name}: {found} meetings of {} rays", rays.len());
        }
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
