//! Elementary kernels one by one, on words in and words out, so that tests can compare each between the CPU and a
//! device. Nothing that renders calls this module.
//!
//! Item i reads words `i * IN_STRIDE ..` and writes words `i * OUT_STRIDE ..`. Floats travel as their bits, vectors as
//! three words. What a kernel does not use is not read, and not written.

use crate::aabb::Aabb;
use crate::barycentric::grid_point;
use crate::bilinear_patch::{BilinearPatch, PatchHit};
use crate::displacement::cell::Cell;
use crate::interface::{Camera, Ray};
use crate::math::{
    MinMax, at, clamp, difference_of_products, floor, fma, next_down, next_up, put, resolve_sign,
    rounding_of_product, sqrt, unit,
};
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
/// [`fma`], [`difference_of_products`] and [`resolve_sign`]: a, b, c, d to fma(a, b, c), a b - c d, and that with its
/// sign resolved.
pub const ARITHMETIC: u32 = 7;
/// Sums of plain products: a, b, c, d to a b + c, d - a c. Neither product has another use, for which a driver might
/// leave it alone.
pub const CONTRACTION: u32 = 8;
/// Operations one by one: a, b to a + b, a b, a / b, the root of |a|, [`rounding_of_product`], the floor of a.
pub const OPERATIONS: u32 = 9;
/// Minima, maxima and comparisons of what may be NaN: x, low, high to min(x, high), min(high, x), max(x, low), max(low,
/// x), [`clamp`] between them, [`clamp`] between 0 and 1, and a word with bit 0 for x < high, 1 for x >= high, 2 for
/// !(x > low), 3 for x is NaN.
pub const NAN: u32 = 10;
/// A loop: n, seed to the word that n turns of [`turned`] make of the seed.
pub const LOOP: u32 = 11;
/// A read that may be beyond the buffer: an index to the word of the input there. For devices, which do not check it.
pub const BEYOND: u32 = 12;
/// Denormal numbers: x, 1, a, b to x 1, x + x, a b, 1 where x > 0 or else 0, x as it is.
pub const DENORMALS: u32 = 13;
/// [`TraversalRay::from_ray`] and [`next_up`]: direction, `t_max` to the unit direction, the distance at `t_max`, the
/// parameter there, and the neighbours of the direction's x above and below.
pub const DIRECTION: u32 = 14;
/// [`unit()`]: a vector to a unit vector.
pub const UNIT: u32 = 15;
/// How many kernels there are.
pub const COUNT: u32 = 16;
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
        let difference = difference_of_products(p.x, p.y, q.x, q.y);
        put(output, b + 1, difference.to_bits());
        put(output, b + 2, resolve_sign(difference, p.x, p.y, q.x, q.y).to_bits());
    } else if kernel == CONTRACTION {
        let (p, q) = (vec3(input, a), float(input, a + 3));
        put(output, b, (p.x * p.y + p.z).to_bits());
        put(output, b + 1, (q - p.x * p.z).to_bits());
    } else if kernel == OPERATIONS {
        let (x, y) = (float(input, a), float(input, a + 1));
        put(output, b, (x + y).to_bits());
        put(output, b + 1, (x * y).to_bits());
        put(output, b + 2, (x / y).to_bits());
        put(output, b + 3, sqrt(x.abs()).to_bits());
        put(output, b + 4, rounding_of_product(x, y).to_bits());
        put(output, b + 5, floor(x).to_bits());
    } else if kernel == NAN {
        let (x, low, high) = (float(input, a), float(input, a + 1), float(input, a + 2));
        put(output, b, x.min_num(high).to_bits());
        put(output, b + 1, high.min_num(x).to_bits());
        put(output, b + 2, x.max_num(low).to_bits());
        put(output, b + 3, low.max_num(x).to_bits());
        put(output, b + 4, clamp(x, low, high).to_bits());
        put(output, b + 5, clamp(x, 0.0, 1.0).to_bits());
        let comparisons = [x < high, x >= high, !(x > low), x.is_nan()];
        let bit = |i: usize| (comparisons[i] as u32) << i;
        put(output, b + 6, bit(0) | bit(1) | bit(2) | bit(3));
    } else if kernel == LOOP {
        let (n, mut word) = (at(input, a), at(input, a + 1));
        let mut i = 0;
        while i < n {
            word = turned(word);
            i += 1;
        }
        put(output, b, word);
    } else if kernel == BEYOND {
        put(output, b, at(input, at(input, a)));
    } else if kernel == DENORMALS {
        let (x, one) = (float(input, a), float(input, a + 1));
        put(output, b, (x * one).to_bits());
        put(output, b + 1, (x + x).to_bits());
        put(output, b + 2, (float(input, a + 2) * float(input, a + 3)).to_bits());
        put(output, b + 3, (x > 0.0) as u32);
        put(output, b + 4, at(input, a));
    } else if kernel == DIRECTION {
        let (direction, t_max) = (vec3(input, a), float(input, a + 3));
        let (ray, stretch) = TraversalRay::from_ray(Ray { origin: Vec3::ZERO, t_max, direction, padding: 0 });
        put_vec3(output, b, ray.direction);
        put(output, b + 3, ray.t_max.to_bits());
        put(output, b + 4, stretch.parameter(ray.t_max).to_bits());
        put(output, b + 5, next_up(direction.x).to_bits());
        put(output, b + 6, next_down(direction.x).to_bits());
    } else if kernel == UNIT {
        put_vec3(output, b, unit(vec3(input, a)));
    }
}

/// The next word of a sequence in which none can be told without those before it: the linear congruential generator of
/// Press, Teukolsky, Vetterling and Flannery, *Numerical Recipes*, 2nd ed., section 7.1, and a shift of its bits.
#[inline]
pub fn turned(word: u32) -> u32 {
    let next = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    next ^ next >> 15
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
