//! The maps that two methods read beside the height maps: of normals, and of Blinn's offsets.
//!
//! They stand in one buffer: first [`HEADER_WORDS`] words for each [`Displacement`](crate::interface::Displacement),
//! then texels of two words, top row first. The words of a header are the first word of its map, the map's width and
//! height, its [`wrap`](crate::interface::wrap), for normals that were made of heights the scale that they were made
//! for (a float; 0 for others), and of normals the [`normal_space`](crate::interface::normal_space).

use crate::math::at;
use crate::texture::footprint;
use glam::{Vec2, Vec3};

/// Words of a header.
pub const HEADER_WORDS: u32 = 6;

/// One of these maps.
#[derive(Clone, Copy)]
pub struct NormalTexels<'a> {
    words: &'a [u32],
    first: u32,
    width: u32,
    height: u32,
    wrap: u32,
    made_for: f32,
    /// See [`normal_space`](crate::interface::normal_space).
    pub space: u32,
}

impl<'a> NormalTexels<'a> {
    /// That of displacement number `i`.
    #[inline]
    pub fn load(words: &'a [u32], i: u32) -> Self {
        let header = i * HEADER_WORDS;
        NormalTexels {
            words,
            first: at(words, header),
            width: at(words, header + 1),
            height: at(words, header + 2),
            wrap: at(words, header + 3),
            made_for: f32::from_bits(at(words, header + 4)),
            space: at(words, header + 5),
        }
    }

    /// The bilinearly filtered normal at (u, v), which must be finite; of no particular length. Where it was made of
    /// heights it leans as these do at `scale`.
    #[inline]
    pub fn normal(&self, uv: Vec2, scale: f32) -> Vec3 {
        let normal = self.sample(uv, true);
        let lean = if self.made_for == 0.0 { 1.0 } else { scale / self.made_for };
        Vec3::new(normal.x * lean, normal.y * lean, normal.z)
    }

    /// The bilinearly filtered offsets at (u, v), which must be finite: growth of texels for a unit of u, and of v.
    #[inline]
    pub fn offsets(&self, uv: Vec2) -> Vec2 {
        let offsets = self.sample(uv, false);
        Vec2::new(offsets.x, offsets.y)
    }

    #[inline]
    fn sample(&self, uv: Vec2, of_normals: bool) -> Vec3 {
        let f = footprint(uv, self.width, self.height, self.wrap);
        let mut sum = Vec3::ZERO;
        // A loop, so that the code of a texel stands in a kernel once.
        let mut i = 0;
        loop {
            let (is_right, is_below) = (i & 1 != 0, i & 2 != 0);
            let x = if is_right { f.fx } else { 1.0 - f.fx };
            let y = if is_below { f.fy } else { 1.0 - f.fy };
            sum += self.texel(f.texels[i as usize], of_normals) * (x * y);
            i += 1;
            if i >= 4 {
                break;
            }
        }
        sum
    }

    /// Texel `i`: two floats, or three components of 16 bits, of which 32768 is 0 and 1 and 65535 are -1 and 1.
    #[inline]
    fn texel(&self, i: u32, of_normals: bool) -> Vec3 {
        let word = self.first + 2 * i;
        let (a, b) = (at(self.words, word), at(self.words, word + 1));
        if of_normals {
            let component = |code: u32| ((code & 0xffff) as f32 - 32768.0) / 32767.0;
            Vec3::new(component(a), component(a >> 16), component(b))
        } else {
            Vec3::new(f32::from_bits(a), f32::from_bits(b), 0.0)
        }
    }
}
