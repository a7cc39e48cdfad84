//! Vector displacement in f64, and how far an f32 evaluation of it may be off.

use super::rounding::{Rounding, UNIT_ROUNDOFF};
use super::tessellation::{Base, Place};
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::displacement_kind;
use glam::{DVec2, DVec3};

/// What the three components of vectors are along at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axes([DVec3; 3]);

impl Axes {
    /// Those of object space, and of vertices that have no tangents, along whose axes nothing is.
    pub(super) const XYZ: Axes = Axes([DVec3::X, DVec3::Y, DVec3::Z]);

    /// Tangent, bitangent and normal of a vertex.
    pub(super) fn of_vertex(buffers: &SceneBuffers, vertex: u32) -> Axes {
        let normal = buffers.vertices[vertex as usize].normal.as_dvec3();
        let Some(tangent) = buffers.tangents.get(vertex as usize) else { return Axes::XYZ };
        let direction = tangent.direction.as_dvec3();
        Axes([direction, normal.cross(direction) * f64::from(tangent.sign), normal])
    }
}

/// An end of an edge or a corner of a triangle that vectors are read over.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    pub(super) weight: f64,
    pub(super) uv: DVec2,
    pub(super) axes: Axes,
    /// How large texels are there, and how many of them a pixel covers at the most.
    pub(super) texels: DVec2,
}

/// A vector by which something is displaced.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    pub(super) vector: DVec3,
    /// How far f32 arithmetic may be off.
    pub(super) error: f64,
    /// Sum of its components' magnitudes.
    magnitude: f64,
}

impl Moved {
    /// What the maps from `map` on give between some ends whose weights add up to 1.
    ///
    /// A component of height h is along an axis a, of unit vectors interpolated and then normalised or not. Heights are
    /// off as in [`Relief::height_error`](super::relief::Relief::height_error), axes by their interpolation, the
    /// bitangent by its cross product too; what that makes of the component is as for heights along normals. Then come
    /// three fused operations.
    pub(super) fn new(base: &Base<'_>, map: u32, place: Place, ends: &[End]) -> Moved {
        let uv: DVec2 = ends.iter().map(|end| end.uv * end.weight).sum();
        let terms: DVec2 = ends.iter().map(|end| end.uv.abs() * end.weight).sum();
        let texels: DVec2 = ends.iter().map(|end| end.texels * end.weight).sum();
        let rounding = base.rounding;
        let mut moved = Moved { vector: DVec3::ZERO, error: 0.0, magnitude: 0.0 };
        for (i, relief) in base.components(map).iter().enumerate() {
            let (height, height_error) = base.height(relief, uv, terms, place, texels);
            let (axis, axis_error) = if base.kind == displacement_kind::OBJECT {
                (Axes::XYZ.0[i], 0.0)
            } else {
                let mean: DVec3 = ends.iter().map(|end| end.axes.0[i] * end.weight).sum();
                // A cross product is rounded once, or its products and difference are where nothing is fused.
                let cross = if i == 1 { 1.0 + 8.0 * rounding.product } else { 0.0 };
                let error = rounding.interpolation() + cross;
                if base.linear {
                    (mean, UNIT_ROUNDOFF * error)
                } else {
                    let turned = 2.0 * error / mean.length();
                    let off = (UNIT_ROUNDOFF * (turned + rounding.by_length())).min(2.0);
                    (mean.normalize_or_zero(), off)
                }
            };
            moved.vector += height * axis;
            moved.error += height.abs() * axis_error + height_error;
            moved.magnitude += height.abs();
        }
        moved.error += UNIT_ROUNDOFF * (3.0 + rounding.product) * 3.0_f64.sqrt() * moved.magnitude;
        moved
    }

    /// The mean of some, at least one. Each is added to those before it by three fused operations, whose results are no
    /// more than all magnitudes together; then comes the quotient, fused with the point.
    pub(super) fn mean(all: &[Moved], rounding: Rounding) -> Moved {
        let count = all.len() as f64;
        let sum = |of: fn(&Moved) -> f64| all.iter().map(of).sum::<f64>();
        let magnitude = sum(|moved| moved.magnitude);
        let roundings = 3.0 * (count - 1.0) + rounding.quotient + rounding.product + 1.0;
        Moved {
            vector: all.iter().map(|moved| moved.vector).sum::<DVec3>() / count,
            error: sum(|moved| moved.error) / count + UNIT_ROUNDOFF * roundings * 3.0_f64.sqrt() * magnitude,
            magnitude: magnitude / count,
        }
    }
}
