//! Elementary kernels one by one, on words in and words out, so that tests can compare each between the CPU and a
//! device. Nothing that renders calls this module.
//!
//! Item i reads words `i * IN_STRIDE ..` and writes words `i * OUT_STRIDE ..`. Floats travel as their bits, vectors as
//! three words. What a kernel does not use is not read, and not written.

use crate::aabb::Aabb;
use crate::barycentric::grid_point;
use crate::bilinear_patch::{BilinearPatch, PatchHit};
use crate::displacement::cell::Cell;
use crate::interface::Camera;
use crate::math::{at, difference_of_products, fma, put};
use crate::ray::TraversalRay;
use crate::sampler::{pcg4d, sample_2d};
use crate::triangle;
use glam::{UVec4, Vec2, Vec3};

/// [`pcg4d`]: 4 integers to 4 integers.
pub const PCG4D: u32 = 0;
/// [`sample_2d`]: x, y, sample, seed to 2 floats.
pub const SAMPLE_2D: u32 = 1;
/// [`Camera::ray_direction`]: right, up, forward, film x, y to a direction.
pub const CAMERA: u32 = 2;
/// [`Aabb::entry_distance`]: origin, unit direction, min, max to a distance.
pub const AABB: u32 = 3;
/// [`triangle::intersect`]: origin, unit direction, p0, p1, p2 to t, b1, b2.
pub const TRIANGLE: u32 = 4;
/// [`BilinearPatch::intersect_line`]: origin, direction, q00, q10, q01, q11 to t, u, v, 1 twice; 0, 0, 0, 0 for none.
pub const BILINEAR_PATCH: u32 = 5;
/// [`Cell::containing`] and its way back: beta, gamma, N to the packed cell and the grid point of its first vertex.
pub const CELL: u32 = 6;
/// [`fma`] and [`difference_of_products`]: a, b, c, d to fma(a, b, c), a b - c d.
pub const ARITHMETIC: u32 = 7;
/// How many kernels there are.
pub const COUNT: u32 = 8;
/// Words of an item's input.
pub const IN_STRIDE: u32 = 32;
/// Words of an item's output.
pub const OUT_STRIDE: u32 = 8;

/// Runs kernel `kernel` on item `i`; an unknown kernel does nothing.
#[inline]
pub fn run(kernel: u32, input: &[u32], output: &mut [u32], i: u32) {
    let (a, b) = (i * IN_STRIDE, i * OUT_STRIDE);
    if kernel == PCG4D {
        let v = pcg4d(UVec4::new(at(input, a), at(input, a + 1), at(input, a + 2), at(input, a + 3)));
        put(output, b, v.x);
        put(output, b + 1, v.y);
        put(output, b + 2, v.z);
        put(output, b + 3, v.w);
    } else if kernel == SAMPLE_2D {
        let s = sample_2d(at(input, a), at(input, a + 1), at(input, a + 2), at(input, a + 3));
        put(output, b, s.x.to_bits());
        put(output, b + 1, s.y.to_bits());
    } else if kernel == CAMERA {
        let camera = Camera {
            right: vec3(input, a),
            up: vec3(input, a + 3),
            forward: vec3(input, a + 6),
            ..Camera::default()
        };
        put_vec3(output, b, camera.ray_direction(Vec2::new(float(input, a + 9), float(input, a + 10))));
    } else if kernel == AABB {
        let bounds = Aabb { min: vec3(input, a + 6), max: vec3(input, a + 9) };
        let t = bounds.entry_distance(&ray(input, a), f32::INFINITY);
        put(output, b, t.to_bits());
    } else if kernel == TRIANGLE {
        let (p0, p1, p2) = (vec3(input, a + 6), vec3(input, a + 9), vec3(input, a + 12));
        let hit = triangle::intersect(&ray(input, a), p0, p1, p2, f32::INFINITY);
        put_vec3(output, b, Vec3::new(hit.t, hit.b1, hit.b2));
    } else if kernel == BILINEAR_PATCH {
        let patch = BilinearPatch {
            q00: vec3(input, a + 6),
            q10: vec3(input, a + 9),
            q01: vec3(input, a + 12),
            q11: vec3(input, a + 15),
        };
        let (first, second) = patch.intersect_line(vec3(input, a), vec3(input, a + 3));
        put_patch_hit(output, b, first);
        put_patch_hit(output, b + 4, second);
    } else if kernel == CELL {
        let n = at(input, a + 2);
        let cell = Cell::containing(float(input, a), float(input, a + 1), n);
        let (j, k) = cell.vertex(0);
        put(output, b, cell.pack());
        put_vec3(output, b + 1, grid_point(j, k, n));
    } else if kernel == ARITHMETIC {
        let (p, q) = (
            Vec2::new(float(input, a), float(input, a + 1)),
            Vec2::new(float(input, a + 2), float(input, a + 3)),
        );
        put(output, b, fma(p.x, p.y, q.x).to_bits());
        put(output, b + 1, difference_of_products(p.x, p.y, q.x, q.y).to_bits());
    }
}

#[inline]
fn float(input: &[u32], i: u32) -> f32 {
    f32::from_bits(at(input, i))
}

#[inline]
fn vec3(input: &[u32], i: u32) -> Vec3 {
    Vec3::new(float(input, i), float(input, i + 1), float(input, i + 2))
}

#[inline]
fn ray(input: &[u32], i: u32) -> TraversalRay {
    TraversalRay::new(vec3(input, i), vec3(input, i + 3), f32::INFINITY)
}

#[inline]
fn put_vec3(output: &mut [u32], i: u32, v: Vec3) {
    put(output, i, v.x.to_bits());
    put(output, i + 1, v.y.to_bits());
    put(output, i + 2, v.z.to_bits());
}

#[inline]
fn put_patch_hit(output: &mut [u32], i: u32, hit: PatchHit) {
    let found = hit.is_some();
    put_vec3(output, i, if found { Vec3::new(hit.t, hit.u, hit.v) } else { Vec3::ZERO });
    put(output, i + 3, found as u32);
}
