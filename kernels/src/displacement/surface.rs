//! The micro-triangle surface.

use crate::interface::{Displacement, Triangle, Vertex};
use crate::math::at;
use glam::Vec3;

/// An axis-aligned box that holds every micro-triangle of a base triangle, whatever its heights in
/// [`height_min`, `height_max`](Displacement) are.
pub fn prism_bounds(vertices: &[Vertex], triangle: Triangle, displacement: &Displacement) -> (Vec3, Vec3) {
    let reach = displacement.height_min.abs().max(displacement.height_max.abs());
    let p0 = at(vertices, triangle.vertices[0]).position;
    let p1 = at(vertices, triangle.vertices[1]).position;
    let p2 = at(vertices, triangle.vertices[2]).position;
    (p0.min(p1).min(p2) - reach, p0.max(p1).max(p2) + reach)
}
