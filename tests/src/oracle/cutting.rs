//! Adaptive N, worked out in f64 from positions and the camera.

use super::rounding::UNIT_ROUNDOFF;
use emboss_kernels::interface::Frame;
use emboss_kernels::scene::Features;
use glam::DVec3;

/// How the base triangles of a scene are cut.
pub(super) struct Cutting {
    /// The greatest N; without adaptive N that of all.
    most: u32,
    /// Where N is adaptive what it follows.
    seen: Option<Seen>,
}

struct Seen {
    eye: DVec3,
    detail: f64,
    reach: f64,
}

/// How one is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cut {
    pub(super) n: u32,
    /// N of the edge across from each corner.
    edges: [u32; 3],
    /// How many of the smallest parts there can be make one of the triangle's.
    unit: u32,
}

impl Cutting {
    pub(super) fn new(frame: &Frame, features: Features) -> Cutting {
        let reach = f64::from(frame.height_min.abs().max(frame.height_max.abs()));
        let eye = frame.camera.eye.as_dvec3();
        let seen = Seen { eye, detail: frame.detail.into(), reach };
        Cutting { most: frame.subdivisions, seen: (features.adaptive != 0).then_some(seen) }
    }

    /// How the triangle of these corners is cut.
    ///
    /// # Panics
    /// Where the camera stands so that rounding decides on a number.
    pub(super) fn of(&self, corners: [DVec3; 3]) -> Cut {
        let Some(seen) = &self.seen else { return Cut { n: self.most, edges: [self.most; 3], unit: 1 } };
        let edge = |e: usize| [corners[(e + 1) % 3], corners[(e + 2) % 3]];
        let lengths = [0, 1, 2].map(|e| edge(e)[0].distance(edge(e)[1]));
        let n = seen.parts(lengths.into_iter().fold(0.0, f64::max), &corners, self.most);
        let edges = [0, 1, 2].map(|e| seen.parts(lengths[e], &edge(e), self.most));
        assert!(edges.iter().all(|parts| *parts <= n), "{n} {edges:?}");
        Cut { n, edges, unit: self.most / n }
    }
}

impl Seen {
    /// Into how many parts a side of that length is cut, from the distance of the box around some points.
    fn parts(&self, length: f64, points: &[DVec3], most: u32) -> u32 {
        let (low, high) = points
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let beside = (low - self.eye).max(self.eye - high) - DVec3::splat(self.reach);
        // f32 rounds two differences, of coordinates and heights.
        let magnitude = low.abs().max(high.abs()) + self.eye.abs() + DVec3::splat(self.reach);
        let by = |error: f64| {
            let away = (beside + magnitude * error).max(DVec3::ZERO).length();
            // Squares, their sums and products take less than the 16 u of a length and a distance here.
            let asked = length * self.detail.sqrt() * (1.0 - 8.0 * error) / away;
            let powers = (0..=most.ilog2()).map(|e| 1 << e);
            powers.into_iter().find(|p| asked <= f64::from(*p)).unwrap_or(most)
        };
        let (fewest, all) = (by(2.0 * UNIT_ROUNDOFF), by(-2.0 * UNIT_ROUNDOFF));
        assert_eq!(fewest, all, "rounding decides on N; move the camera");
        all
    }
}

impl Cut {
    /// The steps from the three edges of the place over which the micro-vertex of grid point (j, k) stands. On an edge
    /// that has its own parts it is the end of one, the nearest; of two the one farther from the corner that is stored
    /// first.
    pub(super) fn place(&self, (j, k): (u32, u32)) -> [u32; 3] {
        let n = self.n;
        let mut steps = [n - j - k, j, k];
        for (e, (from, to)) in [(1, 2), (0, 2), (0, 1)].into_iter().enumerate() {
            if steps[e] == 0 {
                let parts = self.edges[e];
                let nearest = (2 * steps[to] * parts + n) / (2 * n);
                steps[to] = nearest * (n / parts);
                steps[from] = n - steps[to];
            }
        }
        steps
    }

    /// The same in steps that all triangles count in.
    pub(super) fn common_place(&self, point: (u32, u32)) -> [u32; 3] {
        self.place(point).map(|steps| steps * self.unit)
    }
}
