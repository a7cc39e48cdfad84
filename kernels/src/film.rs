//! The film: sums of samples, and the picture resolved from them.

use crate::interface::{FilmPixel, Frame};
use glam::{Vec3, Vec4};

/// What one sample of a pixel brings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Linear RGB, 0 where nothing was hit.
    pub radiance: Vec3,
    /// 1 where something was hit, else 0.
    pub alpha: f32,
}

impl FilmPixel {
    /// This sum with `sample` added.
    #[inline]
    pub fn plus(self, sample: Sample) -> Self {
        FilmPixel {
            radiance: [
                self.radiance[0] + sample.radiance.x,
                self.radiance[1] + sample.radiance.y,
                self.radiance[2] + sample.radiance.z,
            ],
            alpha: self.alpha + sample.alpha,
            samples: self.samples + 1,
        }
    }

    /// The mean of the samples over the frame's background: linear RGB premultiplied by alpha, and alpha. A pixel
    /// without samples shows the background.
    #[inline]
    pub fn resolve(self, frame: &Frame) -> Vec4 {
        let scale = if self.samples == 0 { 0.0 } else { 1.0 / self.samples as f32 };
        let radiance = Vec3::new(self.radiance[0], self.radiance[1], self.radiance[2]) * scale;
        let behind = (1.0 - self.alpha * scale) * frame.background_alpha;
        (radiance + frame.background * behind).extend(self.alpha * scale + behind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Sample = Sample { radiance: Vec3::new(2.0, 0.0, 0.0), alpha: 1.0 };

    #[test]
    fn resolved_pixel_is_the_mean_over_the_background() {
        let half = FilmPixel::default().plus(RED).plus(Sample::default());
        let mut frame = Frame { background: Vec3::new(0.0, 0.0, 0.5), ..Frame::default() };
        assert_eq!(half.resolve(&frame), Vec4::new(1.0, 0.0, 0.0, 0.5));
        frame.background_alpha = 1.0;
        assert_eq!(half.resolve(&frame), Vec4::new(1.0, 0.0, 0.25, 1.0));
    }

    #[test]
    fn pixel_without_samples_is_the_background() {
        let mut frame = Frame { background: Vec3::ONE, ..Frame::default() };
        assert_eq!(FilmPixel::default().resolve(&frame), Vec4::ZERO);
        frame.background_alpha = 1.0;
        assert_eq!(FilmPixel::default().resolve(&frame), Vec4::ONE);
    }
}
