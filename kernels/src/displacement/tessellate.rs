//! Vertex displacement: the N² micro-triangles of each base triangle stored, in a BVH of their own. Cook, "Shade
//! Trees", SIGGRAPH 1984, moved the vertices of what was to be drawn; Cook, Carpenter and Catmull, "The Reyes Image
//! Rendering Architecture", SIGGRAPH 1987, diced surfaces for it.
//!
//! It is what the methods that store nothing are measured against. The surface and the triangle test are theirs, bit
//! for bit, so that it finds what [`quadtree`](super::quadtree) finds. A ray costs what a tree over as many triangles
//! costs; memory is some 100 bytes for each micro-triangle: 64 of nodes, 4 of order, 6 of micro-vertices and 24 of
//! boxes. The tree has at most [`MAX_PRIMITIVES`](crate::interface::MAX_PRIMITIVES) micro-triangles.
//!
//! The grid of a base triangle is stored in rows of constant j from j = N, a single micro-vertex, to j = 0, whose N +
//! 1 lie along an edge: row s = N - j begins at s (s + 1) / 2. Micro-triangles are in rows too, of 2r + 1 between
//! rows r and r + 1 of micro-vertices, beginning at r²; lower and upper ones by turns. Neither place depends on N.

use crate::aabb::Aabb;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField, intersect_micro_triangle};
use crate::hit::Hit;
use crate::math::{UNIT_ROUNDOFF, at, max_abs, put, sqrt};
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use glam::Vec3;

/// By how much of the greatest coordinate of a micro-triangle, and of a ray's origin, boxes are grown: so that the
/// box of each micro-triangle that the ray is found to hit is entered, no farther away than that.
///
/// The triangle test moves vertices as seen along the ray by at most 6 u of the distance from its origin, 6 sqrt(3) u
/// of both coordinates. That counts twice, as in [`quadtree`](super::quadtree), and its distance is off by 12 u of as
/// much: 42 u together.
const MARGIN: f32 = 48.0 * UNIT_ROUNDOFF;

/// Micro-vertices of a base triangle whose sides have `n` parts.
#[inline]
pub fn vertices_of(n: u32) -> u32 {
    (n + 1) * (n + 2) / 2
}

/// Place of grid point (j, k) among them.
#[inline]
pub fn vertex_place(n: u32, j: u32, k: u32) -> u32 {
    let row = n - j;
    row * (row + 1) / 2 + k
}

/// The grid point (j, k) in place `i`.
#[inline]
pub fn grid_point_at(n: u32, i: u32) -> (u32, u32) {
    // The row is the greatest s with s (s + 1) / 2 <= i. 8 i + 1 is rounded and its root off by 9 u: of rows up to 4096
    // that is less than 1/100 of a row.
    let s = ((sqrt((8 * i + 1) as f32) - 1.0) * 0.5) as u32;
    let s = if s * (s + 1) / 2 > i { s - 1 } else { s };
    let s = if (s + 1) * (s + 2) / 2 <= i { s + 1 } else { s };
    (n - s, i - s * (s + 1) / 2)
}

/// The cell in place `i` of the N² of a base triangle.
#[inline]
fn cell_at(n: u32, i: u32) -> Cell {
    let r = sqrt(i as f32) as u32;
    let r = if r * r > i { r - 1 } else { r };
    let r = if (r + 1) * (r + 1) <= i { r + 1 } else { r };
    let place = i - r * r;
    Cell { j: n - 1 - r, k: place >> 1, upper: place & 1 != 0 }
}

/// Computes micro-vertex number `i` of all. Heights must be bounded and seams decided.
#[inline]
pub fn micro_vertex(scene: &SceneView<'_>, features: Features, i: u32) -> Vec3 {
    let n = scene.frame.subdivisions;
    let primitive = i / vertices_of(n);
    let (j, k) = grid_point_at(n, i % vertices_of(n));
    BaseTriangle::load(scene, primitive).micro_vertex(&HeightField::new(scene, features), j, k)
}

/// Writes micro-vertex number `i`.
#[inline]
pub fn store(micro_vertices: &mut [f32], i: u32, p: Vec3) {
    put(micro_vertices, 3 * i, p.x);
    put(micro_vertices, 3 * i + 1, p.y);
    put(micro_vertices, 3 * i + 2, p.z);
}

/// The vertices of the micro-triangle of `cell` of a base triangle, in the cell's order.
#[inline]
fn corners(micro_vertices: &[f32], n: u32, primitive: u32, cell: Cell) -> [Vec3; 3] {
    let first = primitive * vertices_of(n);
    let mut corners = [Vec3::ZERO; 3];
    let mut e = 0;
    while e < 3 {
        let (j, k) = cell.vertex(e);
        let i = 3 * (first + vertex_place(n, j, k));
        corners[e as usize] =
            Vec3::new(at(micro_vertices, i), at(micro_vertices, i + 1), at(micro_vertices, i + 2));
        e += 1;
    }
    corners
}

/// The box of micro-triangle number `i` of all; the empty one where a vertex is not finite, as of a prism.
#[inline]
pub fn bounds(micro_vertices: &[f32], n: u32, i: u32) -> Aabb {
    let [a, b, c] = corners(micro_vertices, n, i / (n * n), cell_at(n, i % (n * n)));
    let magnitude = max_abs(a).max(max_abs(b)).max(max_abs(c));
    let bounds = Aabb::EMPTY.including(a).including(b).including(c).padded(MARGIN * magnitude);
    if a.is_finite() && b.is_finite() && c.is_finite() { bounds } else { Aabb::EMPTY }
}

/// By how much a ray from `origin` grows all boxes.
#[inline]
pub fn ray_margin(origin: Vec3) -> f32 {
    MARGIN * max_abs(origin)
}

/// The nearer of `nearest` and the ray's hit on micro-triangle number `i` of all.
#[inline]
pub fn intersect(scene: &SceneView<'_>, ray: &TraversalRay, i: u32, nearest: Hit) -> Hit {
    let n = scene.frame.subdivisions;
    let primitive = i / (n * n);
    let cell = cell_at(n, i % (n * n));
    let [a, b, c] = corners(scene.micro_vertices, n, primitive, cell);
    let sheared = [ray.shear_point(a), ray.shear_point(b), ray.shear_point(c)];
    intersect_micro_triangle(primitive, ray, cell, sheared, nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::gamma;
    use crate::test_scene::{FLAT, TestScene};

    /// All grid points and cells of small N, and the last rows of the greatest, where roots are rounded most.
    #[test]
    fn places_are_those_of_rows_laid_end_to_end() {
        for n in [1, 2, 3, 17, 4096] {
            let (mut vertex, mut cell) = (0, 0);
            for row in 0..=n {
                let checked = n < 100 || row < 40 || row + 40 > n;
                for k in 0..=row {
                    if checked {
                        assert_eq!(grid_point_at(n, vertex), (n - row, k));
                        assert_eq!(vertex_place(n, n - row, k), vertex);
                    }
                    vertex += 1;
                }
                for place in 0..if row < n { 2 * row + 1 } else { 0 } {
                    if checked {
                        let expected = Cell { j: n - 1 - row, k: place / 2, upper: place % 2 == 1 };
                        assert_eq!(cell_at(n, cell), expected);
                    }
                    cell += 1;
                }
            }
            assert_eq!((vertex, cell), (vertices_of(n), n * n));
        }
    }

    /// The closed form: a flat square cut into triangles that cover it once.
    #[test]
    fn micro_triangles_of_a_flat_square_tile_it() {
        let mut scene = TestScene::squares(&[0.0]);
        let n = 5;
        scene.frame.subdivisions = n;
        let count = 2 * vertices_of(n);
        let mut micro_vertices = vec![0.0; 3 * count as usize];
        for i in 0..count {
            store(&mut micro_vertices, i, micro_vertex(&scene.view(), FLAT, i));
        }
        scene.micro_vertices = micro_vertices;
        let view = scene.view();
        let mut area = 0.0;
        for i in 0..2 * n * n {
            let [a, b, c] = corners(view.micro_vertices, n, i / (n * n), cell_at(n, i % (n * n)));
            area += 0.5 * (b - a).cross(c - a).length();
            let bounds = bounds(view.micro_vertices, n, i);
            assert!([a, b, c].into_iter().all(|p| p.cmpgt(bounds.min).all() && p.cmplt(bounds.max).all()));
            let centre = (a + b + c) / 3.0;
            let down = TraversalRay::new(centre + Vec3::Z, -Vec3::Z, f32::INFINITY);
            let hits: Vec<u32> =
                (0..2 * n * n).filter(|&other| intersect(&view, &down, other, Hit::NONE).is_some()).collect();
            assert_eq!(hits, [i]);
            let hit = intersect(&view, &down, i, Hit::NONE);
            assert_eq!((hit.primitive, hit.cell), (i / (n * n), cell_at(n, i % (n * n)).pack()));
            // Of depths of about 1: see `triangle::intersect`.
            assert!((hit.t - 1.0).abs() <= 2.0 * gamma(12), "{}", hit.t);
            // One that leaves it does not meet it again.
            assert!(!intersect(&view, &down.leaving(hit, -Vec3::Z), i, Hit::NONE).is_some());
        }
        assert!((area - 4.0).abs() < 1e-5, "{area}");
    }

    #[test]
    fn what_is_not_finite_has_no_box() {
        let mut micro_vertices = [0.0; 9];
        assert!(bounds(&micro_vertices, 1, 0).min.is_finite());
        micro_vertices[4] = f32::NAN;
        assert_eq!(bounds(&micro_vertices, 1, 0), Aabb::EMPTY);
    }
}
