//! Adaptive N: how finely a base triangle is cut, from what the edges of the base mesh know.
//!
//! An edge has a number of parts of its own, worked out from its two ends alone and symmetrically in them, so that all
//! triangles at it have the same to the bit, however they store it. A triangle has the greatest number that any of its
//! edges could ask for. On an edge of fewer parts its micro-vertices move to the nearest of the edge's own
//! ([`Subdivisions::snapped`]): what it has there is the edge's polyline, and so is what its neighbour has. Numbers are
//! powers of two, so that a place on the edge has the same weights whatever it is counted in.

use crate::displacement::cell::Cell;
use crate::interface::{Frame, Instance};
use crate::math::{MinMax, dot};
use glam::Vec3;

/// Where the surface is seen from, and how closely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera's eye.
    pub eye: Vec3,
    /// See [`Frame::detail`](crate::interface::Frame::detail).
    pub detail: f32,
    /// The greatest length by which anything is displaced.
    pub reach: f32,
    /// How often a side is halved at most.
    pub most_halvings: u32,
    /// Side of a pixel at distance 1.
    pub pixel: f32,
}

/// How finely a base triangle is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Subdivisions {
    /// N of the triangle, a power of two where N is adaptive.
    pub triangle: u32,
    /// For the edge across from each corner how many of the triangle's parts make one of the edge's: a power of two, at
    /// most N.
    pub steps: [u32; 3],
}

impl Viewpoint {
    /// That of the camera.
    #[inline]
    pub fn new(frame: &Frame) -> Viewpoint {
        Viewpoint {
            eye: frame.camera.eye,
            detail: frame.detail,
            reach: frame.height_min.abs().max_num(frame.height_max.abs()),
            // The exponent of a power of two.
            most_halvings: ((frame.subdivisions.max(1) as f32).to_bits() >> 23) - 127,
            pixel: frame.pixel_side(),
        }
    }

    /// The same in an instance's object space. Where its transform stretches unevenly a length in the world is as much
    /// longer as it may be.
    #[inline]
    pub fn within(self, instance: &Instance) -> Viewpoint {
        let stretch = instance.stretch;
        Viewpoint {
            eye: instance.object_point(self.eye),
            detail: self.detail * (stretch * stretch),
            pixel: self.pixel / stretch,
            ..self
        }
    }

    /// How the base triangle of these corners is cut.
    ///
    /// Its own number is that of its longest edge at the distance of its own box, which is no farther than any edge's.
    /// Minima, maxima, differences and fused sums of squares are monotonic as they are rounded: so the number is none
    /// below an edge's, and every step at least 1.
    #[inline]
    pub fn subdivisions(&self, p0: Vec3, p1: Vec3, p2: Vec3) -> Subdivisions {
        let (a, b, c) = (squared_length(p1, p2), squared_length(p0, p2), squared_length(p0, p1));
        let most =
            self.halvings(a.max_num(b).max_num(c), p0.min_num(p1).min_num(p2), p0.max_num(p1).max_num(p2));
        Subdivisions {
            triangle: 1 << most,
            steps: [
                1 << (most - self.halvings(a, p1.min_num(p2), p1.max_num(p2))),
                1 << (most - self.halvings(b, p0.min_num(p2), p0.max_num(p2))),
                1 << (most - self.halvings(c, p0.min_num(p1), p0.max_num(p1))),
            ],
        }
    }

    /// How often an edge of a squared length is halved: until no part is longer than `detail` allows at the least
    /// distance that anything displaced from the box `low` to `high` can have.
    #[inline]
    fn halvings(&self, squared_length: f32, low: Vec3, high: Vec3) -> u32 {
        let beside = (low - self.eye).max_num(self.eye - high) - Vec3::splat(self.reach);
        let away = beside.max_num(Vec3::ZERO);
        half_exponent(squared_length * self.detail, dot(away, away)).min(self.most_halvings)
    }
}

/// The squared distance of two points, the same in both orders: squares forget signs.
#[inline]
fn squared_length(a: Vec3, b: Vec3) -> f32 {
    let along = b - a;
    dot(along, along)
}

/// The least e, 0 or more, with a <= 4^e b; above 100 where b is below the normal floats. `a` and `b` are not negative.
///
/// Exact, by the bits of both: a logarithm or a root that a device rounds in its own way could tell one triangle at an
/// edge another number than the other. It grows with a and shrinks with b.
#[inline]
pub fn half_exponent(a: f32, b: f32) -> u32 {
    const MANTISSA: u32 = (1 << 23) - 1;
    let (a, b) = (a.to_bits(), b.to_bits());
    // 2 e is at least the difference of exponents, and one more if a has the greater mantissa.
    let (of_a, of_b) = ((a >> 23) + (a & MANTISSA > b & MANTISSA) as u32, b >> 23);
    let e = if of_a > of_b { (of_a - of_b + 1) >> 1 } else { 0 };
    if of_b == 0 { u32::MAX } else { e }
}

impl Subdivisions {
    /// N everywhere.
    #[inline]
    pub fn uniform(n: u32) -> Subdivisions {
        Subdivisions { triangle: n, steps: [1, 1, 1] }
    }

    /// The grid point whose micro-vertex grid point (j, k) has: on an edge of fewer parts the nearest one of the
    /// edge's, of two the one farther from its start, elsewhere itself. Corners stay.
    #[inline]
    pub fn snapped(&self, j: u32, k: u32) -> (u32, u32) {
        let n = self.triangle;
        let step = if k == 0 {
            self.steps[2]
        } else if j == 0 {
            self.steps[1]
        } else if j + k == n {
            self.steps[0]
        } else {
            1
        };
        let snapped_k = snap(k, step);
        (if j + k == n { n - snapped_k } else { snap(j, step) }, snapped_k)
    }

    /// The area of a cell whose corners are [`snapped`](Self::snapped), in cells.
    #[inline]
    pub fn cells(&self, cell: Cell) -> u32 {
        let (j0, k0) = self.snapped_corner(cell, 0);
        let (j1, k1) = self.snapped_corner(cell, 1);
        let (j2, k2) = self.snapped_corner(cell, 2);
        ((j1 - j0) * (k2 - k0) - (k1 - k0) * (j2 - j0)).unsigned_abs()
    }

    #[inline]
    fn snapped_corner(&self, cell: Cell, e: u32) -> (i32, i32) {
        let (j, k) = cell.vertex(e);
        let (j, k) = self.snapped(j, k);
        (j as i32, k as i32)
    }

    /// Which edges have fewer parts than the triangle: bit e is for edge e.
    #[inline]
    pub fn coarse_edges(&self) -> u32 {
        (self.steps[0] > 1) as u32 | ((self.steps[1] > 1) as u32) << 1 | ((self.steps[2] > 1) as u32) << 2
    }
}

/// The multiple of `step`, a power of two, that is nearest to `i`; of two the greater. Never falls where `i` rises.
#[inline]
pub(super) fn snap(i: u32, step: u32) -> u32 {
    (i + (step >> 1)) & !(step - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::barycentric::exact_weight;
    use crate::math::tests::Numbers;

    /// The same in f64, where products with powers of four are exact.
    fn by_trial(a: f32, b: f32) -> u32 {
        let fits = |e: &i32| f64::from(a) <= 4.0_f64.powi(*e) * f64::from(b);
        (0..).find(fits).expect("there is one").unsigned_abs()
    }

    #[test]
    fn exponents_are_those_of_exact_arithmetic() {
        let mut numbers = Numbers::new(91);
        for _ in 0..200_000 {
            let b = (numbers.unit() * 60.0 - 30.0).exp2();
            let a = match (numbers.unit() * 4.0) as u32 {
                0 => b * (numbers.unit() * 40.0 - 10.0).exp2(),
                // At a threshold, and next to it.
                1 => b * (2.0 * (numbers.unit() * 14.0).floor()).exp2(),
                2 => (b * (2.0 * (numbers.unit() * 14.0).floor()).exp2()).next_up(),
                _ => (b * (2.0 * (numbers.unit() * 14.0).floor()).exp2()).next_down(),
            };
            assert_eq!(half_exponent(a, b), by_trial(a, b), "{a} {b}");
        }
        assert!(half_exponent(1.0, 0.0) > 100 && half_exponent(1.0, 1e-40) > 100);
        assert_eq!((half_exponent(0.0, 1.0), half_exponent(1.0, f32::INFINITY)), (0, 0));
        assert_eq!(half_exponent(f32::INFINITY, 1.0), 64);
    }

    fn viewpoint(numbers: &mut Numbers) -> Viewpoint {
        Viewpoint {
            eye: numbers.vec3() * (numbers.unit() * 16.0 - 4.0).exp2(),
            detail: (numbers.unit() * 24.0 - 4.0).exp2(),
            reach: numbers.unit(),
            most_halvings: (numbers.unit() * 13.0) as u32,
            pixel: 0.0,
        }
    }

    /// Whatever the place, the size and the order of corners: both triangles at an edge have its number, and none has
    /// fewer parts than its edges.
    #[test]
    fn triangles_agree_on_their_edge() {
        let mut numbers = Numbers::new(92);
        let (mut uneven, mut greatest) = (0, 0);
        for _ in 0..100_000 {
            let view = viewpoint(&mut numbers);
            let offset = numbers.vec3() * if numbers.unit() < 0.5 { 0.0 } else { 1000.0 };
            let size = (numbers.unit() * 12.0 - 6.0).exp2();
            let mut point = || offset + numbers.vec3() * size;
            let (a, b, c, d) = (point(), point(), point(), point());
            let (left, right) = (view.subdivisions(a, b, c), view.subdivisions(d, b, a));
            let parts = |of: Subdivisions, e: usize| of.triangle / of.steps[e];
            assert_eq!(parts(left, 2), parts(right, 0), "{view:?} {a} {b} {c} {d}");
            for of in [left, right] {
                assert!(of.triangle.is_power_of_two() && of.triangle <= 1 << view.most_halvings);
                assert!(of.steps.iter().all(|step| step.is_power_of_two() && *step <= of.triangle), "{of:?}");
            }
            let ratio = left.triangle.max(right.triangle) / left.triangle.min(right.triangle);
            uneven += u32::from(ratio > 1);
            greatest = greatest.max(ratio);
        }
        assert!(uneven > 5_000 && greatest >= 64, "no test of neighbours that differ: {uneven} {greatest}");
    }

    /// What is promised of lengths: no part of an edge is longer than `detail` allows at any displaced point over it.
    #[test]
    fn parts_are_as_short_as_asked() {
        let mut numbers = Numbers::new(93);
        for _ in 0..100_000 {
            let view = viewpoint(&mut numbers);
            let (a, b) = (numbers.vec3(), numbers.vec3());
            let halvings = view.halvings(squared_length(a, b), a.min(b), a.max(b));
            let place = (a + (b - a) * numbers.unit()).as_dvec3();
            let up = numbers.vec3().as_dvec3().normalize_or_zero() * f64::from(view.reach);
            let distance = (place + up).distance(view.eye.as_dvec3());
            let length = (b - a).as_dvec3().length() / f64::from(1 << halvings);
            let allowed = distance / f64::from(view.detail).sqrt();
            // A dozen roundings of f32, of coordinates and of the distance that is left of them.
            let rounding = 1e-6 * (1.0 + 2.0 / allowed.max(1e-6));
            let most = halvings == view.most_halvings;
            assert!(most || length <= allowed * (1.0 + rounding), "{length} {allowed} {halvings}");
        }
    }

    #[test]
    fn snapped_points_are_the_edges_own_and_nearest() {
        let cut = Subdivisions { triangle: 16, steps: [4, 16, 2] };
        for (j, k) in (0..=16).flat_map(|j| (0..=16 - j).map(move |k| (j, k))) {
            let (to_j, to_k) = cut.snapped(j, k);
            let moved = to_j.abs_diff(j).max(to_k.abs_diff(k));
            if j > 0 && k > 0 && j + k < 16 {
                assert_eq!(moved, 0);
                continue;
            }
            // On the same edge, at a part's end, not more than half a part away.
            assert!((k > 0 || to_k == 0) && (j > 0 || to_j == 0) && (j + k < 16 || to_j + to_k == 16));
            let edge = if k == 0 {
                2
            } else if j == 0 {
                1
            } else {
                0
            };
            let step = cut.steps[edge];
            assert!(
                to_j % step == 0 && to_k % step == 0 && 2 * moved <= step,
                "({j}, {k}) to ({to_j}, {to_k})"
            );
        }
        // Cells that are moved fill the triangle as before.
        let cells = (0..16).flat_map(|j| (0..16 - j).map(move |k| (j, k))).flat_map(|(j, k)| {
            [false, true].map(|upper| if upper && j + k == 15 { 0 } else { cut.cells(Cell { j, k, upper }) })
        });
        assert_eq!(cells.sum::<u32>(), 16 * 16);
        assert_eq!((cut.snapped(0, 0), cut.snapped(16, 0), cut.snapped(0, 16)), ((0, 0), (16, 0), (0, 16)));
    }

    #[test]
    fn weights_are_exact() {
        for n in (0..=12).map(|e| 1_u32 << e) {
            assert!((0..=n).all(|m| f64::from(exact_weight(m, n)) == f64::from(m) / f64::from(n)));
        }
    }
}
