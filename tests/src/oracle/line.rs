//! A ray's line against boxes and micro-triangles.

use super::Meeting;
use super::tessellation::{BLOCK, Block, Piece};
use super::tree::Box3;
use glam::{DVec2, DVec3};

/// Bounds on what f32 arithmetic does to a ray's hits.
#[derive(Clone, Copy)]
pub(super) struct Errors {
    /// Of a vertex, as seen along the ray.
    pub(super) lateral: f64,
    /// Of a distance, apart from what follows of that.
    pub(super) depth: f64,
}

/// A ray's line with a frame of coordinates around it.
pub(super) struct Line {
    pub(super) origin: DVec3,
    /// Unit direction.
    direction: DVec3,
    /// Magnitudes of its components.
    steepness: DVec3,
    /// Two unit vectors across it.
    across: [DVec3; 2],
    /// Length of the ray's own direction.
    pub(super) length: f64,
}

impl Line {
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        let length = direction.length();
        let direction = direction / length;
        let (x, y) = direction.any_orthonormal_pair();
        Line { origin, direction, steepness: direction.abs(), across: [x, y], length }
    }

    /// Whether the line comes within `distance` of a box in each coordinate, and the box is not wholly that far behind
    /// the origin.
    ///
    /// A line misses a box where, seen along one of the axes, it passes its rectangle: the cross products of direction
    /// and axes are all the directions that can separate them.
    pub(super) fn nears(&self, bounds: &Box3, distance: f64) -> bool {
        let half = bounds.half + DVec3::splat(distance);
        let (c, d, steep) = (bounds.centre - self.origin, self.direction, self.steepness);
        (c.y * d.z - c.z * d.y).abs() <= half.y * steep.z + half.z * steep.y
            && (c.z * d.x - c.x * d.z).abs() <= half.z * steep.x + half.x * steep.z
            && (c.x * d.y - c.y * d.x).abs() <= half.x * steep.y + half.y * steep.x
            && c.dot(d) + half.dot(steep) >= 0.0
    }

    /// A point across the ray (first two coordinates) and along it (third).
    fn local(&self, p: DVec3) -> DVec3 {
        let p = p - self.origin;
        DVec3::new(p.dot(self.across[0]), p.dot(self.across[1]), p.dot(self.direction))
    }

    /// Adds the micro-triangles of a block that come within the errors of the line, unless they lie farther than the
    /// errors behind its origin.
    pub(super) fn add_meetings(
        &self,
        piece: &Piece,
        block: Block,
        errors: Errors,
        meetings: &mut Vec<Meeting>,
    ) {
        let mut local = [[DVec3::ZERO; BLOCK as usize + 1]; BLOCK as usize + 1];
        for (row, points) in piece.block_rows(block).enumerate() {
            for (column, &point) in points.iter().enumerate() {
                local[row][column] = self.local(point);
            }
        }
        for cell in piece.block_cells(block) {
            let (row, column) = ((cell.j - block.j) as usize, (cell.k - block.k) as usize);
            let (right, above) = (local[row + 1][column], local[row][column + 1]);
            let corners = if cell.upper {
                [local[row + 1][column + 1], above, right]
            } else {
                [local[row][column], right, above]
            };
            if !encloses_axis(&corners, errors.lateral) {
                continue;
            }
            let outline = corners.map(DVec3::truncate);
            let Some(margin) = margin(outline, errors.lateral) else { continue };
            let farthest = corners[0].z.max(corners[1].z).max(corners[2].z);
            if farthest + errors.lateral + errors.depth < 0.0 {
                continue;
            }
            let (t, t_low, t_high) = distances(corners, errors);
            let keys = cell.grid_points().map(|point| piece.key(point));
            // At an edge of fewer parts than the triangle's, two micro-vertices may be one.
            if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
                continue;
            }
            let (base, cell) = (piece.base, cell.pack());
            meetings.push(Meeting { t, t_low, t_high, base, cell, margin, outline, keys });
        }
    }
}

/// Whether the rectangle around a triangle, as seen along the third axis and grown by `reach`, holds the origin.
fn encloses_axis([a, b, c]: &[DVec3; 3], reach: f64) -> bool {
    let within = |a: f64, b: f64, c: f64| a.min(b).min(c) <= reach && a.max(b).max(c) >= -reach;
    within(a.x, b.x, c.x) && within(a.y, b.y, c.y)
}

/// Distance from the origin to the outline of a triangle, negative outside; `None` beyond `reach` outside.
fn margin(p: [DVec2; 3], reach: f64) -> Option<f64> {
    let sides = [0, 1, 2].map(|e| p[(e + 1) % 3].perp_dot(p[(e + 2) % 3]));
    let inside = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
    let distance = (0..3).map(|e| edge_distance(p, e)).fold(f64::INFINITY, f64::min);
    let margin = if inside { distance } else { -distance };
    (margin >= -reach).then_some(margin)
}

/// Distance from the origin to the edge across from vertex `e`.
pub(super) fn edge_distance(p: [DVec2; 3], e: usize) -> f64 {
    let (a, b) = (p[(e + 1) % 3], p[(e + 2) % 3]);
    let along = b - a;
    let squared = along.length_squared();
    let s = if squared > 0.0 { (-a.dot(along) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + along * s).length_squared().sqrt()
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
