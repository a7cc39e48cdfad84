//! Bilinear patches: the walls of a prism.

use crate::math::{cross, dot, sqrt};
use glam::Vec3;

/// The patch q(u,v) = (1-u)(1-v) q00 + u (1-v) q10 + (1-u) v q01 + u v q11.
#[derive(Clone, Copy, Debug)]
pub struct BilinearPatch {
    /// Corner u = 0, v = 0.
    pub q00: Vec3,
    /// Corner u = 1, v = 0.
    pub q10: Vec3,
    /// Corner u = 0, v = 1.
    pub q01: Vec3,
    /// Corner u = 1, v = 1.
    pub q11: Vec3,
}

/// Where a line meets a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchHit {
    /// Parameter along the line; NaN where it does not meet the patch this often.
    pub t: f32,
    /// First patch coordinate.
    pub u: f32,
    /// Second patch coordinate.
    pub v: f32,
}

impl PatchHit {
    /// No hit.
    pub const NONE: PatchHit = PatchHit { t: f32::NAN, u: 0.0, v: 0.0 };

    /// Whether the line meets the patch here.
    #[inline]
    pub fn is_some(&self) -> bool {
        !self.t.is_nan()
    }
}

impl BilinearPatch {
    /// Both meetings of the line `origin + t direction` with the patch, for u in [0, 1] and every v and t: callers
    /// ask for the part of the ruled surface that they need.
    ///
    /// Reshetov, "Cool Patches: A Geometric Approach to Ray/Bilinear Patch Intersections", *Ray Tracing Gems*
    /// chapter 8, 2019: u solves a quadratic whose coefficients are volumes; then the line meets the straight line
    /// u = const. Deviation: signs of t and bounds of v are left to the caller. A line that lies in the surface
    /// (all coefficients zero) has no meeting.
    #[inline]
    pub fn intersect_line(&self, origin: Vec3, direction: Vec3) -> (PatchHit, PatchHit) {
        // The volume of direction, ruling and start is m(u) . q(u), both linear: a + b u + c u². Written with the
        // rulings' cross products first, which lose nothing where the line runs along a ruling.
        let (q00, q10) = (self.q00 - origin, self.q10 - origin);
        let (e00, e11) = (self.q01 - self.q00, self.q11 - self.q10);
        let along = self.q10 - self.q00;
        let m0 = cross(direction, e00);
        let dm = cross(direction, e11) - m0;
        let a = dot(m0, q00);
        let b = dot(m0, along) + dot(dm, q00);
        let c = dot(dm, along);
        // Its roots, the larger in magnitude first, since the other then cancels nothing.
        let discriminant = crate::math::difference_of_products(b, b, 4.0 * a, c);
        if discriminant < 0.0 {
            return (PatchHit::NONE, PatchHit::NONE);
        }
        let root = sqrt(discriminant);
        let q = -0.5 * (b + if b < 0.0 { -root } else { root });
        (
            self.on_ruling(q / c, direction, q00, q10, e00, e11),
            self.on_ruling(a / q, direction, q00, q10, e00, e11),
        )
    }

    /// Where the line meets the straight line u = const; no hit where u is outside [0, 1] (or NaN: a quadratic that
    /// has no such root).
    #[inline]
    fn on_ruling(&self, u: f32, direction: Vec3, q00: Vec3, q10: Vec3, e00: Vec3, e11: Vec3) -> PatchHit {
        if !(u >= 0.0 && u <= 1.0) {
            return PatchHit::NONE;
        }
        let start = q00 * (1.0 - u) + q10 * u;
        let ruling = e00 * (1.0 - u) + e11 * u;
        let n = cross(direction, ruling);
        let n2 = dot(n, n);
        if n2 == 0.0 {
            return PatchHit::NONE;
        }
        PatchHit { t: -dot(cross(n, ruling), start) / n2, u, v: -dot(cross(n, direction), start) / n2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::tests::Numbers;

    fn point(p: &BilinearPatch, u: f32, v: f32) -> Vec3 {
        p.q00 * ((1.0 - u) * (1.0 - v)) + p.q10 * (u * (1.0 - v)) + p.q01 * ((1.0 - u) * v) + p.q11 * (u * v)
    }

    fn hits(p: &BilinearPatch, o: Vec3, d: Vec3) -> Vec<PatchHit> {
        let (first, second) = p.intersect_line(o, d);
        [first, second].into_iter().filter(PatchHit::is_some).collect()
    }

    #[test]
    fn plane_patch_is_met_once() {
        let patch = BilinearPatch { q00: Vec3::ZERO, q10: Vec3::X, q01: Vec3::Y, q11: Vec3::X + Vec3::Y };
        let found = hits(&patch, Vec3::new(0.25, 0.5, 2.0), -Vec3::Z);
        assert_eq!(found, [PatchHit { t: 2.0, u: 0.25, v: 0.5 }]);
        assert_eq!(hits(&patch, Vec3::new(1.25, 0.5, 2.0), -Vec3::Z), []);
    }

    #[test]
    fn saddle_can_be_met_twice() {
        // q(u,v) has height (2u-1)(2v-1); the line at height 1/2 along the diagonal crosses it twice.
        let corner = |x: f32, y: f32| Vec3::new(x, y, x * y);
        let patch = BilinearPatch {
            q00: corner(-1.0, -1.0),
            q10: corner(1.0, -1.0),
            q01: corner(-1.0, 1.0),
            q11: corner(1.0, 1.0),
        };
        let mut ts: Vec<f32> =
            hits(&patch, Vec3::new(0.0, 0.0, 0.5), Vec3::new(1.0, 1.0, 0.0)).iter().map(|h| h.t).collect();
        ts.sort_by(f32::total_cmp);
        assert_eq!(ts.len(), 2);
        // (t, t, 1/2) lies on z = x y where t² = 1/2. Bound: a few roundings of numbers near 1.
        assert!((ts[0] + 0.5_f32.sqrt()).abs() < 1e-6 && (ts[1] - 0.5_f32.sqrt()).abs() < 1e-6, "{ts:?}");
    }

    #[test]
    fn line_in_the_surface_has_no_meeting() {
        let patch = BilinearPatch { q00: Vec3::ZERO, q10: Vec3::X, q01: Vec3::Y, q11: Vec3::X + Vec3::Y };
        assert_eq!(hits(&patch, Vec3::new(0.5, 0.5, 0.0), Vec3::X), []);
    }

    /// A line through a known point of a random patch finds that point.
    #[test]
    fn line_through_a_point_of_the_patch_finds_it() {
        let mut numbers = Numbers::new(5);
        let mut checked = 0;
        for _ in 0..50_000 {
            let patch = BilinearPatch {
                q00: numbers.vec3(),
                q10: numbers.vec3(),
                q01: numbers.vec3(),
                q11: numbers.vec3(),
            };
            let (u, v) = (0.05 + 0.9 * numbers.unit(), 0.05 + 0.9 * numbers.unit());
            let target = point(&patch, u, v);
            let d = numbers.vec3().normalize();
            let ruling = (patch.q01 - patch.q00) * (1.0 - u) + (patch.q11 - patch.q10) * u;
            let across = (patch.q10 - patch.q00) * (1.0 - v) + (patch.q11 - patch.q01) * v;
            // The volume by which the solution divides: near zero the line grazes the patch and u is ill-posed.
            if d.dot(ruling.cross(across)).abs() < 0.05 {
                continue;
            }
            checked += 1;
            let error = hits(&patch, target - d * 3.0, d)
                .iter()
                .map(|h| ((h.t - 3.0).abs()).max((h.u - u).abs()).max((h.v - v).abs()))
                .fold(f32::INFINITY, f32::min);
            // About 30 roundings of numbers below 8, divided by at most 0.05.
            assert!(error < 30.0 * 8.0 * crate::math::UNIT_ROUNDOFF / 0.05, "{patch:?} {u} {v} {error}");
        }
        assert!(checked > 30_000);
    }
}
