//! Noise that repeats, for maps that tile: functions of a point whose period is a whole number along each axis.

use glam::{IVec2, Vec2};

/// A lattice that repeats every `period` units along x and y, with its own random numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    /// Repeat along each axis, at least 1.
    pub(super) period: IVec2,
    /// Which of the many lattices.
    pub(super) seed: u32,
}

/// Where a point lies among the cells of a cellular pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    /// Smooth distance to the borders of the cell, at most the true one: it rounds the cell's corners and crest.
    pub(super) border: f32,
    /// A random number that is the cell's own.
    pub(super) id: u32,
}

/// What belongs to each point of a lattice, computed once: maps read it a hundred times. Bits are the same.
#[derive(Clone, Debug)]
pub(super) struct Table<T> {
    lattice: Lattice,
    of_point: fn(Lattice, IVec2) -> T,
    /// Row by row, of a period and a margin round it.
    values: Vec<T>,
}

/// How far beyond a period a pattern within it looks.
const MARGIN: i32 = 3;

/// Radius, in cells, by which the corners of a cellular pattern are rounded. Half of it gives facets, twice as much
/// makes all cells look alike.
const ROUNDING: f32 = 0.07;

impl Lattice {
    /// A lattice of `x` by `y` cells.
    pub(super) fn new(x: i32, y: i32, seed: u32) -> Self {
        Self { period: IVec2::new(x, y), seed }
    }

    /// A random number that belongs to a lattice point.
    fn hash(self, point: IVec2) -> u32 {
        let p = point.rem_euclid(self.period);
        mix(mix(mix(self.seed).wrapping_add(p.x.cast_unsigned())).wrapping_add(p.y.cast_unsigned()))
    }

    /// The gradient at a lattice point, of length 1.
    fn slope(self, point: IVec2) -> Vec2 {
        Vec2::from_angle(unit(self.hash(point)) * std::f32::consts::TAU)
    }

    /// An octave of a fractal sum.
    fn octave(self, octave: u32) -> Self {
        Self { period: self.period * (1 << octave), seed: self.seed.wrapping_add(octave) }
    }

    /// Fractal sum of gradient noise: each octave twice as fine and half as strong, about -1 to 1.
    pub(super) fn fractal(self, p: Vec2, octaves: u32) -> f32 {
        fractal(p, (0..octaves).map(|octave| move |point| self.octave(octave).slope(point)))
    }

    /// The tables of a fractal sum that is read often: see [`fractal_of`].
    pub(super) fn fractal_table(self, octaves: u32) -> Vec<Table<Vec2>> {
        (0..octaves).map(|octave| Table::new(self.octave(octave), Lattice::slope)).collect()
    }

    /// The Voronoi cell of a point, one centre to each unit square (Worley 1996). Its borders are the bisectors to
    /// the centres within two squares; [`ROUNDING`] says how smoothly the least of their distances is taken.
    pub(super) fn cellular(self, p: Vec2) -> Cell {
        let (border, nearest) = cellular(p, |square| self.center(square));
        Cell { border, id: self.hash(nearest) }
    }

    /// The table of a cellular pattern that is read often.
    pub(super) fn cellular_table(self) -> Table<Vec2> {
        Table::new(self, Lattice::center)
    }

    /// The centre of the cell of a unit square, away from the square's border so that cells keep a fair size.
    fn center(self, square: IVec2) -> Vec2 {
        let hash = self.hash(square);
        square.as_vec2() + 0.1 + 0.8 * Vec2::new(unit(mix(hash)), unit(mix(hash ^ 0x5bd1_e995)))
    }
}

impl<T: Copy> Table<T> {
    fn new(lattice: Lattice, of_point: fn(Lattice, IVec2) -> T) -> Self {
        let along = |period: i32| -MARGIN..period + MARGIN;
        let points =
            along(lattice.period.y).flat_map(|y| along(lattice.period.x).map(move |x| IVec2::new(x, y)));
        Table { lattice, of_point, values: points.map(|point| of_point(lattice, point)).collect() }
    }

    fn at(&self, point: IVec2) -> T {
        let (place, size) = (point + MARGIN, self.lattice.period + 2 * MARGIN);
        let is_there = place.cmpge(IVec2::ZERO).all() && place.cmplt(size).all();
        // Of points beyond the margin nothing is kept.
        let value = is_there.then(|| self.values.get((place.y * size.x + place.x).cast_unsigned() as usize));
        value.flatten().copied().unwrap_or_else(|| (self.of_point)(self.lattice, point))
    }
}

impl Table<Vec2> {
    /// As [`Lattice::cellular`].
    pub(super) fn cellular(&self, p: Vec2) -> Cell {
        let (border, nearest) = cellular(p, |square| self.at(square));
        Cell { border, id: self.lattice.hash(nearest) }
    }
}

/// As [`Lattice::fractal`].
pub(super) fn fractal_of(octaves: &[Table<Vec2>], p: Vec2) -> f32 {
    fractal(p, octaves.iter().map(|octave| |point| octave.at(point)))
}

/// A fractal sum of noises with these gradients at lattice points.
fn fractal<F: Fn(IVec2) -> Vec2>(p: Vec2, octaves: impl Iterator<Item = F>) -> f32 {
    let mut sum = 0.0;
    let mut weights = 0.0;
    for (octave, slope) in octaves.enumerate() {
        let factor = (1 << octave) as f32;
        let weight = 1.0 / factor;
        sum += weight * gradient(p * factor, slope);
        weights += weight;
    }
    sum / weights
}

/// Gradient noise after Perlin 2002, about -1 to 1, 0 at lattice points, where it has these slopes.
fn gradient(p: Vec2, slope: impl Fn(IVec2) -> Vec2) -> f32 {
    let base = p.floor();
    let f = p - base;
    let corner = |x, y| {
        let offset = IVec2::new(x, y);
        slope(base.as_ivec2() + offset).dot(f - offset.as_vec2())
    };
    let t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let bottom = lerp(corner(0, 0), corner(1, 0), t.x);
    let top = lerp(corner(0, 1), corner(1, 1), t.x);
    // Slopes of length 1 reach sqrt(1/2) in the middle of a cell.
    lerp(bottom, top, t.y) * std::f32::consts::SQRT_2
}

/// The distance of a point to the border of its cell, and the square of the cell's centre.
fn cellular(p: Vec2, center: impl Fn(IVec2) -> Vec2) -> (f32, IVec2) {
    let home = p.floor().as_ivec2();
    let (nearest, offset) = square(1)
        .map(|step| (home + step, p - center(home + step)))
        .min_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()))
        .unwrap_or((home, Vec2::ZERO));
    let sum: f32 = square(2)
        // The centres of the outermost corners are too far off to be neighbours.
        .filter(|&step| step != IVec2::ZERO && step.length_squared() < 8)
        .map(|step| {
            let other = p - center(nearest + step);
            // From one centre to the other, and the point's distance to the middle between them.
            let way = offset - other;
            // Vec2's own root is a software one, for kernels; this one gives the same.
            let along = way * (1.0 / way.length_squared().sqrt());
            let distance = along.dot(-(offset + other) * 0.5);
            (-distance / ROUNDING).exp()
        })
        .sum();
    ((-ROUNDING * sum.ln()).max(0.0), nearest)
}

/// The points at most `reach` steps from the origin along each axis.
fn square(reach: i32) -> impl Iterator<Item = IVec2> {
    (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| IVec2::new(x, y)))
}

/// `a` at t = 0, `b` at t = 1.
pub(super) fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// 0 up to `low`, 1 from `high` on, smooth between.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A random number as one in [0,1).
pub(super) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// Scrambles a number: the finaliser of PCG RXS-M-XS, O'Neill 2014.
pub(super) fn mix(x: u32) -> u32 {
    let state = x.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a cell-free grid: multiples of 1/16, at which adding a period is exact.
    fn points() -> impl Iterator<Item = Vec2> {
        (0..64).flat_map(|y| (0..96).map(move |x| Vec2::new(x as f32, y as f32) / 16.0))
    }

    #[test]
    fn patterns_repeat_exactly() {
        let lattice = Lattice::new(6, 4, 7);
        for p in points() {
            for shift in [Vec2::new(6.0, 0.0), Vec2::new(0.0, 4.0), Vec2::new(-6.0, 8.0)] {
                // Multiples of 1/16 and periods add exactly, but centres at another offset round differently.
                let tolerance = 16.0 * f32::EPSILON * 16.0;
                let (a, b) = (lattice.fractal(p, 3), lattice.fractal(p + shift, 3));
                assert!((a - b).abs() < tolerance, "{p}: {a} {b}");
                let (a, b) = (lattice.cellular(p), lattice.cellular(p + shift));
                assert!((a.border - b.border).abs() < tolerance, "{p}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn gradient_noise_stays_in_its_range_and_fills_it() {
        let lattice = Lattice::new(6, 4, 7);
        let (min, max) = points()
            .map(|p| lattice.fractal(p, 1))
            .fold((0f32, 0f32), |(min, max), x| (min.min(x), max.max(x)));
        assert!(min >= -1.0 && max <= 1.0, "{min} {max}");
        assert!(min < -0.4 && max > 0.4, "{min} {max}");
        assert_eq!(lattice.fractal(Vec2::new(3.0, 2.0), 1), 0.0);
    }

    /// Within a period, and beyond it, where nothing is kept.
    #[test]
    fn tables_hold_what_is_computed() {
        let lattice = Lattice::new(6, 4, 7);
        let (octaves, cells) = (lattice.fractal_table(3), lattice.cellular_table());
        for p in points().flat_map(|p| [p, p - 20.0]) {
            assert_eq!(fractal_of(&octaves, p), lattice.fractal(p, 3), "{p}");
            assert_eq!(cells.cellular(p), lattice.cellular(p), "{p}");
        }
    }

    #[test]
    fn borders_are_where_the_nearest_centre_changes() {
        let lattice = Lattice::new(6, 4, 7);
        for p in points() {
            let cell = lattice.cellular(p);
            // Within its distance to the border nothing else is nearer; 0.1 % keeps off the border's own rounding.
            for i in 0..16 {
                let direction = Vec2::from_angle(i as f32 * std::f32::consts::TAU / 16.0);
                let inside = lattice.cellular(p + direction * (cell.border * 0.999));
                assert_eq!(inside.id, cell.id, "{p}");
            }
        }
    }
}
