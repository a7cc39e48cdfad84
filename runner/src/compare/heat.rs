//! Colours for errors.

use crate::picture::linear_from_srgb;
use glam::Vec3;

/// The error that is shown brightest: what is above looks the same.
pub const MOST: f32 = 0.4;

/// Colours at equal steps from no error to [`MOST`], as sRGB codes: the map magma of Matplotlib, which ꟻLIP uses too.
pub const STOPS: [[u8; 3]; 5] = [[0, 0, 4], [81, 18, 124], [183, 55, 121], [252, 137, 97], [252, 253, 191]];

/// The colour of an error, in linear RGB.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of stops")]
pub fn color(error: f32) -> Vec3 {
    let place = (error / MOST).clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let first = (place as usize).min(STOPS.len() - 2);
    let [a, b] = [STOPS[first], STOPS[first + 1]].map(|stop| Vec3::from(stop.map(f32::from)) / 255.0);
    a.lerp(b, place - first as f32).map(linear_from_srgb)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::srgb_from_linear;

    #[test]
    fn colors_begin_at_black_and_end_at_the_last_stop() {
        let code = |error| (color(error).map(srgb_from_linear) * 255.0).round();
        assert_eq!(code(0.0), Vec3::new(0.0, 0.0, 4.0));
        assert_eq!(code(0.5 * MOST), Vec3::new(183.0, 55.0, 121.0));
        assert_eq!((code(MOST), code(1.0)), (Vec3::new(252.0, 253.0, 191.0), code(MOST)));
    }
}
