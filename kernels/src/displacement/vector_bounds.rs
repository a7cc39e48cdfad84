//! The bound on the micro-vertices over a node of the [quadtree](super::quadtree) that vectors displace.
//!
//! Such a micro-vertex is p(w) + sum over axes of lift_a a(w), p and the axes a linear, so for fixed lifts it is a
//! convex combination of these sums at the node's three corners. A lift is a height divided by |a| (or as it is), and
//! lies in a range as it does for heights: each map's pyramid gives one. So every micro-vertex lies in the box around
//! three boxes, one at each corner: the corner's point and, component by component, all that lifts within their ranges
//! can add to it. Where an axis may vanish its unit vector may point anywhere. The frame is that of the ray.
//!
//! On seams it is the mean of such sums over the sides, each with its own axes and ranges, over the seam's stretch in
//! the node: the boxes at its two ends are the means of the sides' boxes. Where an edge that is none has fewer parts
//! than the triangle, the stretch that micro-vertices of the node are moved to is bounded as the node itself.

use crate::barycentric::{interpolate, interpolate2};
use crate::displacement::height_pyramid::{texel_coordinates, texel_error};
use crate::displacement::quadtree::{Bounds, Lifts, Node, RayFrame, farthest, filtered_range};
use crate::displacement::surface::{BaseTriangle, HeightField, along_edge};
use crate::displacement::vector::{Sides, Source};
use crate::interface::{Displacement, displacement_kind, normals};
use crate::math::MinMax;
use glam::Vec3;

/// How much of [`BaseTriangle::reach`], in unit roundoffs, is in the margin of bounds. The reach is the sum of three
/// magnitudes; lifts that are bounded are up to four times as great. An axis at a corner is off by 3 u where it is the
/// cross product of two, by 27 u from interpolation with weights whose magnitudes add up to 3 at the most (beyond the
/// grid's border), by 6 u and 5 u from the ray's frame, and its lift by 16 u: 228 u of the magnitude. A micro-vertex
/// interpolates the axis with an error of 9 u, which its lift makes 36 u of the magnitude where it is bounded, and the
/// height's division, the root and the sums come to 20 u; sides are averaged by 3 u, here and there.
pub(super) const ROUNDINGS_OF_REACH: f32 = 384.0;
/// The same of the largest coordinate, in addition to what heights have: a point of the bound is interpolated in the
/// world, with weights off by 6 u and 3 u of operations, whose magnitudes add up to 3 at the most; its micro-vertex
/// takes two more fused operations, twice counted.
pub(super) const ROUNDINGS_OF_COORDINATE: f32 = 32.0;

/// The box in the frame of every micro-vertex over a node, without the margin. `has_seams`: whether it is at a border
/// of which some is decided with neighbours. `coarse`: the edges of fewer parts than the triangle that it touches.
/// `margin`: what distances to the eye are off by, where maps are filtered by their levels.
pub(super) fn of_node(
    field: &HeightField<'_>,
    base: &BaseTriangle,
    frame: &RayFrame,
    node: &Node,
    has_seams: bool,
    coarse: u32,
    margin: f32,
) -> Bounds {
    let n = field.subdivisions;
    let touched = node.edges_touched(n);
    let corners = if has_seams { node.corners_reached(touched, field) } else { 0 };
    // The node itself, then what of the triangle's edges and corners is in it.
    let part_count = if has_seams {
        7
    } else if coarse != 0 {
        4
    } else {
        1
    };
    let mut bounds = Bounds::EMPTY;
    // A loop, so that the code of a part stands in a kernel once.
    let mut part = 0;
    while part < part_count {
        let piece = if part == 0 {
            let corners = node.corners(n);
            Piece { corners, edge: NO_EDGE, sides: Sides::NONE, is_there: true }
        } else if part <= 3 {
            Piece::at_edge(field, base, node, touched, coarse, part - 1)
        } else {
            Piece::at_corner(field, base, corners, part - 4)
        };
        if piece.is_there {
            let own = piece.bounds(field, base, frame, margin);
            bounds = bounds.including(own.min).including(own.max);
        }
        part += 1;
    }
    bounds
}

/// [`Piece::edge`] of a piece that is none of an edge.
const NO_EDGE: u32 = 3;

/// A part of a base triangle's grid that is displaced in one way.
struct Piece {
    /// Grid points whose triangle holds it.
    corners: [(u32, u32); 3],
    /// The edge on which it is, or [`NO_EDGE`].
    edge: u32,
    /// What decides it; the triangle itself where there is none.
    sides: Sides,
    /// Whether there is such a part.
    is_there: bool,
}

impl Piece {
    /// The triangle's corner `e`, where it is decided with neighbours and one of the `corners` that a node
    /// [reaches](Node::corners_reached).
    #[inline]
    fn at_corner(field: &HeightField<'_>, base: &BaseTriangle, corners: u32, e: u32) -> Piece {
        let n = field.subdivisions;
        let sides = Sides::of_corner(&base.seams(field), e);
        let point = (if e == 1 { n } else { 0 }, if e == 2 { n } else { 0 });
        let is_there = corners >> e & 1 != 0 && sides.count > 0;
        Piece { corners: [point, point, point], edge: NO_EDGE, sides, is_there }
    }

    /// The part of the triangle's edge `e` within a node, where it is a seam, or has fewer parts than the triangle.
    /// `touched`: the node's [`edges_touched`](Node::edges_touched), `coarse`: those of fewer parts.
    #[inline]
    fn at_edge(
        field: &HeightField<'_>,
        base: &BaseTriangle,
        node: &Node,
        touched: u32,
        coarse: u32,
        e: u32,
    ) -> Piece {
        let mut sides = Sides::NONE;
        if base.has_seams(field) {
            sides = Sides::of_edge(&base.seams(field), e);
        }
        let [a, b] = node.stretch_ends(e, field);
        let is_there = touched >> e & 1 != 0 && sides.count > 0 || coarse >> e & 1 != 0;
        Piece { corners: [a, b, b], edge: e, sides, is_there }
    }

    /// The box of its micro-vertices.
    #[inline]
    fn bounds(&self, field: &HeightField<'_>, base: &BaseTriangle, frame: &RayFrame, margin: f32) -> Bounds {
        let n = field.subdivisions;
        let (w0, w1, w2) =
            (weights(self.corners[0], n), weights(self.corners[1], n), weights(self.corners[2], n));
        let position = |w: Vec3| {
            let p = frame.point(interpolate(w, base.p0, base.p1, base.p2));
            Bounds { min: p, max: p }
        };
        let (mut box0, mut box1, mut box2) = (position(w0), position(w1), position(w2));
        let distance = if field.is_filtered() {
            farthest(frame.point(field.viewpoint.eye), box0.min, box1.min, box2.min) + margin
        } else {
            0.0
        };
        let alone = self.sides.count == 0;
        let count = if alone { 1 } else { self.sides.count };
        let share = 1.0 / count as f32;
        let mut i = 0;
        while i < count {
            let (source, w0, w1, w2) = if alone {
                (Source::of_triangle(base), w0, w1, w2)
            } else {
                let source = Source::of_side(&field.seam_side(self.sides.first + i));
                // A reading at a corner is a side of no length.
                let along = |w: Vec3| if self.edge == NO_EDGE { Vec3::X } else { along_edge(w, self.edge) };
                (source, along(w0), along(w1), along(w2))
            };
            let [a, b, c] = source.corners(field);
            let map = field.displacement(source.displacement);
            let texel = |w: Vec3| texel_coordinates(&map, interpolate2(w, a.uv, b.uv, c.uv));
            let (t0, t1, t2) = (texel(w0), texel(w1), texel(w2));
            let error = texel_error(&map, a.uv.abs().max_num(b.uv.abs()).max_num(c.uv.abs()));
            let (low, high) = (t0.min_num(t1).min_num(t2) - error, t0.max_num(t1).max_num(t2) + error);
            let mut axis = 0;
            while axis < 3 {
                let map = field.displacement(source.displacement + axis);
                let texels = field.pyramid(map).range_between(low, high);
                let (least, greatest) =
                    Displacement::height_range(texels.min, texels.max, map.zero, map.scale);
                let (least, greatest) = if field.is_filtered() {
                    let texel = field.least_texel(source.vertices);
                    filtered_range(field, &map, distance, texel, least, greatest)
                } else {
                    (least, greatest)
                };
                let (a, b, c) = (a.axis(axis), b.axis(axis), c.axis(axis));
                let (a0, a1, a2) = (
                    frame.vector(interpolate(w0, a, b, c)),
                    frame.vector(interpolate(w1, a, b, c)),
                    frame.vector(interpolate(w2, a, b, c)),
                );
                let lifts = if field.kind == displacement_kind::OBJECT || field.normals == normals::LINEAR {
                    Lifts { min: least, max: greatest, bounded: true }
                } else {
                    Lifts::new(least, greatest, a0, a1, a2)
                };
                if lifts.bounded {
                    let (lowest, highest) = (lifts.min * share, lifts.max * share);
                    box0 = box0.lifted(a0 * lowest, a0 * highest);
                    box1 = box1.lifted(a1 * lowest, a1 * highest);
                    box2 = box2.lifted(a2 * lowest, a2 * highest);
                } else {
                    let reach = Vec3::splat(least.abs().max_num(greatest.abs()) * share);
                    box0 = box0.lifted(-reach, reach);
                    box1 = box1.lifted(-reach, reach);
                    box2 = box2.lifted(-reach, reach);
                }
                axis += 1;
            }
            i += 1;
        }
        Bounds {
            min: box0.min.min_num(box1.min).min_num(box2.min),
            max: box0.max.max_num(box1.max).max_num(box2.max),
        }
    }
}

impl Bounds {
    /// Moved by anything between two vectors, component by component.
    #[inline]
    fn lifted(self, a: Vec3, b: Vec3) -> Bounds {
        Bounds { min: self.min + a.min_num(b), max: self.max + a.max_num(b) }
    }
}

/// Barycentric coordinates of grid point (j, k). An inverted node at the border has a corner beyond it.
#[inline]
fn weights((j, k): (u32, u32), n: u32) -> Vec3 {
    let per_cell = 1.0 / n as f32;
    Vec3::new(n as f32 - (j + k) as f32, j as f32, k as f32) * per_cell
}
