//! The surface that micro-triangles approach as N grows, and the same relief over a smooth base, in f64: their normals
//! by finite differences.

use super::relief::Relief;
use super::rounding::{Rounding, UNIT_ROUNDOFF};
use super::tessellation::Cell;
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{FLIPPED, normals};
use emboss_kernels::scene::Features;
use glam::{DVec2, DVec3};

/// Step of the differences, in barycentric coordinates. Their error is its square times the surface's third derivative:
/// 1e-11 of what that is to the first, which roundings of f32 exceed ten thousandfold. Those of f64 add 1e-16 / step.
const STEP: f64 = 1.0 / 262_144.0;

/// Each base triangle displaced by its own height map, without end subdivided. Seams are not welded.
pub struct LimitSurface<'a> {
    buffers: &'a SceneBuffers,
    reliefs: Vec<Relief>,
    linear: bool,
}

/// A normal of the surface.
#[derive(Clone, Copy, Debug)]
pub struct LimitNormal {
    /// Unit vector, to the outside of the base mesh.
    pub direction: DVec3,
    /// Bound on the distance of a unit vector that f32 arithmetic computes from the derivatives.
    pub error: f64,
}

/// A base triangle's attributes at a point: values along an edge, from vertex 0 to vertex 1 or 2, are differences.
struct Corners {
    edges: [DVec3; 2],
    normals: [DVec3; 3],
    uv: [DVec2; 3],
    relief: usize,
    flipped: bool,
}

impl<'a> LimitSurface<'a> {
    /// The surface of a scene.
    pub fn new(buffers: &'a SceneBuffers, features: Features) -> Self {
        let relief = |map| Relief::new(buffers, map, false);
        let reliefs = buffers.displacements.iter().map(relief).collect();
        LimitSurface { buffers, reliefs, linear: features.normals == normals::LINEAR }
    }

    /// The barycentric coordinates, on a base triangle of N parts a side, of the point (b1, b2) of a packed cell.
    pub fn weights(cell: u32, b1: f32, b2: f32, n: u32) -> DVec3 {
        let [first, second, third] = Cell::unpack(cell).grid_points().map(|(j, k)| {
            let (j, k) = (f64::from(j) / f64::from(n), f64::from(k) / f64::from(n));
            DVec3::new(1.0 - j - k, j, k)
        });
        let (b1, b2) = (f64::from(b1), f64::from(b2));
        first * (1.0 - b1 - b2) + second * b1 + third * b2
    }

    /// The normal of base triangle `triangle` at barycentric coordinates `w`, as of the micro-triangles there. `None`
    /// where there is none to compare: so near to a line through texel centres, where the filter has a kink, that the
    /// difference's step or f32's rounding may cross it; and where interpolated normals all but cancel (below 1/16).
    ///
    /// # Panics
    /// Where there is no such triangle.
    pub fn normal(&self, triangle: u32, w: DVec3) -> Option<LimitNormal> {
        let corners = self.comparable(triangle, w)?;
        let slope = |along: DVec3| difference(w, along, |w| self.point(&corners, w));
        Some(self.of_slopes(&corners, w, EDGES.map(slope)))
    }

    /// The normal of the same relief over the smooth surface that the base mesh stands for: what its slope is at right
    /// angles to the interpolated vertex normal, is that of the traced surface with the heights as they are at `w`;
    /// along the normal it is that of the heights alone.
    ///
    /// # Panics
    /// Where there is no such triangle.
    pub fn smooth_normal(&self, triangle: u32, w: DVec3) -> Option<LimitNormal> {
        let corners = self.comparable(triangle, w)?;
        let relief = &self.reliefs[corners.relief];
        let (n, height) = (blend(w, corners.normals), relief.height(uv(&corners, w)));
        let unit = n.normalize();
        let level =
            |w: DVec3| corners.edges[0] * w.y + corners.edges[1] * w.z + self.direction(&corners, w) * height;
        let lift = self.direction(&corners, w).length();
        let slope = |along: DVec3| {
            let across = difference(w, along, level).reject_from_normalized(unit);
            let rise = difference(w, along, |w| DVec3::X * relief.height(uv(&corners, w))).x;
            across + unit * (rise * lift)
        };
        Some(self.of_slopes(&corners, w, EDGES.map(slope)))
    }

    /// A triangle's attributes, where its normal at `w` can be compared.
    fn comparable(&self, triangle: u32, w: DVec3) -> Option<Corners> {
        let corners = self.corners(triangle);
        let cancels = blend(w, corners.normals).length() < 1.0 / 16.0;
        (!cancels && self.is_off_kinks(&corners, w)).then_some(corners)
    }

    /// The normal of a surface that grows by `slopes` along two sides of a triangle.
    fn of_slopes(&self, corners: &Corners, w: DVec3, slopes: [DVec3; 2]) -> LimitNormal {
        let normal = slopes[0].cross(slopes[1]);
        let direction = if corners.flipped { -normal } else { normal }.normalize();
        let error = self.error(corners, w) / normal.length() + 8.0 * UNIT_ROUNDOFF;
        LimitNormal { direction, error }
    }

    fn corners(&self, triangle: u32) -> Corners {
        let triangle = &self.buffers.triangles[triangle as usize];
        let vertices = triangle.vertices.map(|v| self.buffers.vertices[v as usize]);
        let [a, b, c] = vertices.map(|v| v.position.as_dvec3());
        Corners {
            edges: [b - a, c - a],
            normals: vertices.map(|v| v.normal.as_dvec3()),
            uv: vertices.map(|v| DVec2::new(f64::from(v.u), f64::from(v.v))),
            relief: triangle.displacement as usize,
            flipped: triangle.flags & FLIPPED != 0,
        }
    }

    /// The displaced point, from vertex 0 on, so that differences are the same wherever the model is.
    fn point(&self, corners: &Corners, w: DVec3) -> DVec3 {
        let height = self.reliefs[corners.relief].height(uv(corners, w));
        corners.edges[0] * w.y + corners.edges[1] * w.z + self.direction(corners, w) * height
    }

    /// What heights are along.
    fn direction(&self, corners: &Corners, w: DVec3) -> DVec3 {
        let n = blend(w, corners.normals);
        if self.linear { n } else { n.normalize() }
    }

    /// Whether all that a difference reads lies between the same texels, whichever way f32 rounds.
    fn is_off_kinks(&self, corners: &Corners, w: DVec3) -> bool {
        let relief = &self.reliefs[corners.relief];
        let to_line = relief.distance_to_lines(uv(corners, w));
        let [du, dv] = along_edges(corners).map(|d| d.abs() * STEP);
        let reach = (du + dv) * relief.size() + self.shift(corners);
        (0..2).all(|axis| to_line[axis] > reach[axis])
    }

    /// How far rounding moves the point that is read, in texels: weights 8 u (the grid's quotient, three products and
    /// sums), interpolation 3 u, both of the coordinates' magnitudes; reduction and scale as in `Relief::height_error`.
    fn shift(&self, corners: &Corners) -> DVec2 {
        let magnitude: DVec2 = corners.uv.iter().map(|t| t.abs()).sum();
        self.reliefs[corners.relief].size() * (11.0 * magnitude + DVec2::splat(3.0)) * UNIT_ROUNDOFF
    }

    /// Bound on the error of the cross product of the derivatives, computed in f32 as `BaseTriangle::shading_normal`
    /// says: errors of its parts to first order in u, times what they are multiplied by. What of the product is along
    /// the unit normal n is off by what the normal is, twice.
    fn error(&self, corners: &Corners, w: DVec3) -> f64 {
        const U: f64 = UNIT_ROUNDOFF;
        let relief = &self.reliefs[corners.relief];
        let n = blend(w, corners.normals);
        // n: three weights of 8 u, three operations each. Dividing by the length: 2 + 1 + 1 u, see
        // `Rounding::by_length`.
        let (shortest, n_error) = (n.length(), 3.0 * 11.0 * U);
        let unit_error = 2.0 * n_error / shortest + 4.0 * U;
        let (d_length, d_error) = if self.linear { (shortest, n_error) } else { (1.0, unit_error) };
        // d' = (n' - d (d · n')) / |n|.
        let d_slope = |m: f64| {
            if self.linear {
                return (m, U * m);
            }
            let (slope, part) = (m / shortest, 2.0 * d_error + 6.0 * U);
            (slope, slope * (part + n_error / shortest + 4.0 * U))
        };
        let height = relief.height(uv(corners, w)).abs();
        let magnitude: DVec2 = corners.uv.iter().map(|t| t.abs()).sum();
        let h_error = relief.height_error(magnitude * 3.0, Rounding::IEEE);
        // h': the filter's slope per texel changes with the point that is read by the texels' twist, at most twice the
        // steepest step; it is three operations on differences, and five more follow.
        let shift = self.shift(corners);
        let steepest = relief.steepest();
        let h_slope = |along: DVec2| {
            let texels = along.abs() * relief.size();
            let twist = 2.0 * steepest.min_element();
            let slope_error = twist * DVec2::new(shift.y, shift.x) + 9.0 * U * steepest;
            (relief.scale().abs() * texels.dot(steepest), relief.scale().abs() * texels.dot(slope_error))
        };
        let [along_1, along_2] = along_edges(corners);
        let ((h1, h1_error), (h2, h2_error)) = (h_slope(along_1), h_slope(along_2));
        let tangent = |e: usize| {
            let edge = corners.edges[e].length();
            let (slope, slope_error) = d_slope((corners.normals[e + 1] - corners.normals[0]).length());
            let length = edge + height * slope;
            (length, height * slope_error + h_error * slope + 3.0 * U * length)
        };
        let ((a, a_error), (b, b_error)) = (tangent(0), tangent(1));
        let product = |x: f64, dx: f64, y: f64, dy: f64| x * dy + dx * y + 4.0 * U * x * y;
        let scaled =
            |h: f64, dh: f64, x: f64, dx: f64| h * product(d_length, d_error, x, dx) + dh * d_length * x;
        product(a, a_error, b, b_error)
            + a * b * (2.0 * unit_error + 4.0 * U)
            + scaled(h1, h1_error, b, b_error)
            + scaled(h2, h2_error, a, a_error)
    }
}

/// From vertex 0 to vertices 1 and 2, in barycentric coordinates.
const EDGES: [DVec3; 2] = [DVec3::new(-1.0, 1.0, 0.0), DVec3::new(-1.0, 0.0, 1.0)];

/// How `value` grows at `w`.
fn difference(w: DVec3, along: DVec3, value: impl Fn(DVec3) -> DVec3) -> DVec3 {
    (value(w + along * STEP) - value(w - along * STEP)) / (2.0 * STEP)
}

fn blend(w: DVec3, corners: [DVec3; 3]) -> DVec3 {
    corners[0] * w.x + corners[1] * w.y + corners[2] * w.z
}

fn uv(corners: &Corners, w: DVec3) -> DVec2 {
    corners.uv[0] * w.x + corners.uv[1] * w.y + corners.uv[2] * w.z
}

/// How texture coordinates change from vertex 0 to vertices 1 and 2.
fn along_edges(corners: &Corners) -> [DVec2; 2] {
    [corners.uv[1] - corners.uv[0], corners.uv[2] - corners.uv[0]]
}
