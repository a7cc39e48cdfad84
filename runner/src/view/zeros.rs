//! The texel values that the zero goes through.

use crate::scene::Relief;
use crate::stats::agreed;
use emboss_kernels::interface::height_format;

/// How many units of the last digit a step is.
const STEP: f64 = 2.0;

/// The zeros of a scene's maps, and how far one can go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Zeros {
    /// That of all maps as they were loaded, where it is one.
    pub(super) loaded: Option<f32>,
    lowest: f32,
    highest: f32,
}

impl Zeros {
    /// Of these maps; those that displace nothing, as the one that stands for the lack of a map, do not count. A zero
    /// stays among the texels that a map has, and of a map of integers among those that it could have.
    pub(super) fn of(reliefs: &[Relief]) -> Zeros {
        let displacing = || reliefs.iter().filter(|relief| relief.scale != 0.0);
        let ends = displacing().flat_map(|relief| {
            let (lowest, highest) = relief.map.range;
            let is_float = relief.map.format == height_format::FLOAT32;
            [relief.zero, lowest, highest]
                .into_iter()
                .chain((!is_float).then_some([0.0, 1.0]).into_iter().flatten())
        });
        let ends = || ends.clone().filter(|end| end.is_finite());
        let (lowest, highest) = (ends().reduce(f32::min), ends().reduce(f32::max));
        Zeros {
            loaded: agreed(displacing().map(|relief| relief.zero)),
            lowest: lowest.unwrap_or(0.0),
            highest: highest.unwrap_or(1.0),
        }
    }

    /// `zero`, or else the loaded one, moved by some steps: each a fiftieth of the way from the lowest to the highest
    /// texel, or less so that it is twice a power of ten, and the result is a multiple of that power.
    #[expect(clippy::cast_possible_truncation, reason = "rounded")]
    pub(super) fn stepped(&self, zero: Option<f32>, steps: i32) -> f32 {
        let way = f64::from(self.highest) - f64::from(self.lowest);
        let digits = if way > 0.0 { (2.0 - way.log10()).ceil() as i32 } else { 2 };
        let units = 10_f64.powi(digits);
        let middle = 0.5_f32.clamp(self.lowest, self.highest);
        let from = f64::from(zero.or(self.loaded).unwrap_or(middle));
        let stepped = (from * units + STEP * f64::from(steps)).round() / units;
        (stepped as f32).clamp(self.lowest, self.highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::HeightMap;

    fn relief(format: u32, range: (f32, f32), zero: f32, scale: f32) -> Relief {
        Relief::new(HeightMap { format, range, ..HeightMap::flat(0.5) }, zero, scale)
    }

    #[test]
    fn integers_go_through_all_that_they_could_be() {
        let zeros = Zeros::of(&[relief(height_format::UNORM8, (0.4, 0.6), 0.01, 1.0)]);
        assert_eq!(zeros.stepped(None, -1), 0.0);
        assert_eq!(zeros.stepped(Some(0.0), 3), 0.06);
        assert_eq!(zeros.stepped(Some(0.99), 1), 1.0);
    }

    /// Metres of a scan, say, or the small vectors of a bake: steps are as fine as the map.
    #[test]
    fn floats_go_through_what_they_are() {
        let zeros = Zeros::of(&[relief(height_format::FLOAT32, (-0.01, 0.03), 0.0, 1.0)]);
        assert_eq!((zeros.loaded, zeros.stepped(None, 1)), (Some(0.0), 0.0002));
        assert_eq!((zeros.stepped(None, -999), zeros.stepped(None, 999)), (-0.01, 0.03));
        let zeros = Zeros::of(&[relief(height_format::FLOAT32, (100.0, 4000.0), 50.0, 1.0)]);
        assert_eq!((zeros.stepped(None, 1), zeros.stepped(None, -1)), (70.0, 50.0));
    }

    #[test]
    fn what_displaces_nothing_does_not_count() {
        let (map, flat) = (
            relief(height_format::FLOAT32, (2.0, 3.0), 2.5, -1.0),
            relief(height_format::FLOAT32, (0.0, 0.0), 0.0, 0.0),
        );
        let zeros = Zeros::of(&[map.clone(), flat]);
        assert_eq!((zeros.loaded, zeros.stepped(None, -9999)), (Some(2.5), 2.0));
        let several = Zeros::of(&[map, relief(height_format::FLOAT32, (2.0, 3.0), 2.0, 1.0)]);
        assert_eq!((several.loaded, several.stepped(None, 0)), (None, 2.0));
        assert_eq!(Zeros::of(&[]).stepped(None, 1), 0.52);
    }
}
