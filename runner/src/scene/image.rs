//! Height and colour maps out of image files.

mod single_channel;

use super::{ColorMap, HeightMap, SceneError};
use crate::picture::{linear_from_srgb, srgb_from_linear};
use ::image::{DynamicImage, ImageDecoder, ImageError, ImageReader, Limits};
use emboss_kernels::interface::{color_format, height_format};
use glam::Vec3;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tracing::warn;

/// Greatest width and height of a map: the power of two for which kernels can number the words of a colour map in
/// floats (three a texel) with 32 bits.
const MAX_SIDE: u32 = 32_768;

/// Weights of R, G and B in the luminance, after Rec. ITU-R BT.709.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Words of the table at the head of a [`color_format::SRGB8`] map.
pub(super) const SRGB_CODES: usize = 256;

/// Loads a height map.
///
/// Values are read linearly, whatever the file says of its colour space. Images of equal channels keep their 8 or
/// 16 bits; coloured ones become their luminance, by the Rec. 709 weights on the stored values, in floats. Alpha is
/// not read. `invert` replaces each texel by 1 - texel, exactly for integers. NaN and infinite texels become `zero`,
/// the texel value of no displacement, and are counted in [`HeightMap::replaced`].
pub fn load_height_map(path: &Path, zero: f32, invert: bool) -> Result<HeightMap, SceneError> {
    let Picture { width, height, channels, samples } = decode(path)?;
    let packed = match samples {
        Samples::Unorm8(codes) => pack_codes(&codes, channels, invert),
        Samples::Unorm16(codes) => pack_codes(&codes, channels, invert),
        Samples::Float32(values) => pack_floats(values.chunks_exact(channels).map(grey_float), zero, invert),
    };
    let Packed { format, texels, range, replaced } = packed;
    Ok(HeightMap { width, height, format, texels, range, replaced })
}

/// The channels of a vector map: red, green and blue.
#[derive(Clone, Debug)]
pub struct VectorMap {
    /// A map each, all of one size and format.
    pub channels: [HeightMap; 3],
    /// The texel value of no displacement.
    pub zero: f32,
}

/// Loads a vector map: the red, green and blue of a picture, read linearly, whatever the file says of its colour space.
/// Alpha is not read. Without a `zero` it is that of the format: 0 for floats, which may be negative, 0.5 for integers,
/// which may not. Texels of which a value is NaN or infinite become `zero` whole, and are counted in each channel's
/// [`HeightMap::replaced`].
pub fn load_vector_map(path: &Path, zero: Option<f32>) -> Result<VectorMap, SceneError> {
    let Picture { width, height, channels, samples } = decode(path)?;
    if channels < 3 {
        return Err(SceneError::NoVectors { path: path.into() });
    }
    let zero = zero.unwrap_or(if matches!(samples, Samples::Float32(_)) { 0.0 } else { 0.5 });
    let channel = |i: usize| {
        let Packed { format, texels, range, replaced } = match &samples {
            Samples::Unorm8(codes) => pack_grey(codes.chunks_exact(channels).map(|texel| texel[i])),
            Samples::Unorm16(codes) => pack_grey(codes.chunks_exact(channels).map(|texel| texel[i])),
            Samples::Float32(values) => {
                let finite = |texel: &[f32]| {
                    if rgb(texel).iter().all(|x| x.is_finite()) { texel[i] } else { f32::NAN }
                };
                pack_floats(values.chunks_exact(channels).map(finite), zero, false)
            }
        };
        HeightMap { width, height, format, texels, range, replaced }
    };
    Ok(VectorMap { channels: [channel(0), channel(1), channel(2)], zero })
}

/// Loads a colour map: 8 bits a channel stay in sRGB, 16 bits are taken for sRGB and decoded to linear floats, and
/// floats (EXR, HDR, TIFF) are linear as they are. Alpha is not read. NaN and infinite values become 0, and a warning
/// counts them.
pub fn load_color_map(path: &Path) -> Result<ColorMap, SceneError> {
    let Picture { width, height, channels, samples } = decode(path)?;
    let (format, texels) = match samples {
        Samples::Unorm8(codes) => (color_format::SRGB8, pack_srgb8(codes.chunks_exact(channels).map(rgb))),
        Samples::Unorm16(codes) => {
            (color_format::FLOAT32, decode_srgb16(codes.chunks_exact(channels).map(rgb)))
        }
        Samples::Float32(values) => {
            let (texels, replaced) = finite_words(values.chunks_exact(channels).map(rgb));
            if replaced > 0 {
                warn!("{}: {replaced} values are NaN or infinite; 0 is used instead", path.display());
            }
            (color_format::FLOAT32, texels)
        }
    };
    Ok(ColorMap { width, height, format, texels })
}

impl HeightMap {
    /// A map of one texel: the same height everywhere.
    pub fn flat(value: f32) -> Self {
        Self {
            width: 1,
            height: 1,
            format: height_format::FLOAT32,
            texels: vec![value.to_bits()],
            range: (value, value),
            replaced: 0,
        }
    }

    /// A map of 16-bit texels out of numbers in [0,1] (others are clamped), row by row from the top. `width` and
    /// `height` are at least 1, and there are as many numbers as texels.
    pub(super) fn from_unit(width: u32, height: u32, texels: impl ExactSizeIterator<Item = f32>) -> Self {
        let Packed { format, texels, range, replaced } = pack_grey(texels.map(u16::from_unit));
        Self { width, height, format, texels, range, replaced }
    }

    /// The map with each texel t replaced by 1 - t: for integer codes, packed in words, the complement of all bits.
    pub fn inverted(&self) -> Self {
        let invert = |&word: &u32| match self.format {
            height_format::FLOAT32 => (1.0 - f32::from_bits(word)).to_bits(),
            _ => !word,
        };
        let (min, max) = self.range;
        Self { texels: self.texels.iter().map(invert).collect(), range: (1.0 - max, 1.0 - min), ..*self }
    }

    /// A map of floats, row by row from the top. `width` and `height` are at least 1, and there are as many numbers as
    /// texels, all of them finite.
    pub(super) fn from_floats(width: u32, height: u32, texels: impl ExactSizeIterator<Item = f32>) -> Self {
        let Packed { format, texels, range, replaced } = pack_floats(texels, 0.0, false);
        Self { width, height, format, texels, range, replaced }
    }

    /// Whether its texels have only 256 values, so that a smooth slope becomes a staircase.
    pub fn has_steps(&self) -> bool {
        self.format == height_format::UNORM8
    }

    /// The texel in column `x` and row `y` from the top, both within the map.
    pub fn texel(&self, x: u32, y: u32) -> f32 {
        let i = y as usize * self.width as usize + x as usize;
        match self.format {
            height_format::UNORM8 => u8::unpack(&self.texels, i).to_unit(),
            height_format::UNORM16 => u16::unpack(&self.texels, i).to_unit(),
            _ => f32::from_bits(self.texels[i]),
        }
    }
}

impl ColorMap {
    /// A map of 8-bit texels out of linear RGB in [0,1] (others are clamped), row by row from the top. `width` and
    /// `height` are at least 1, and there are as many colours as texels.
    pub(super) fn from_linear(width: u32, height: u32, colors: impl ExactSizeIterator<Item = Vec3>) -> Self {
        let codes = colors.map(|color| color.to_array().map(|c| u8::from_unit(srgb_from_linear(c))));
        Self { width, height, format: color_format::SRGB8, texels: pack_srgb8(codes) }
    }
}

/// Evaluates a function of the texture coordinates at the centre of each texel, top row first.
pub(super) fn per_texel<T: Send>(width: u32, height: u32, f: impl Fn(f32, f32) -> T + Sync) -> Vec<T> {
    use rayon::prelude::*;
    let center = |i: u32, count: u32| (i as f32 + 0.5) / count as f32;
    let row = |y| (0..width).map(|x| f(center(x, width), 1.0 - center(y, height))).collect::<Vec<T>>();
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

/// Decodes an image file, whose format its first bytes tell.
fn decode(path: &Path) -> Result<Picture, SceneError> {
    let unreadable = |source| SceneError::Unreadable { path: path.into(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut reader = ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(unreadable)?;
    let Some(format) = reader.format() else {
        return Err(SceneError::NotAnImage { path: path.into() });
    };
    reader.limits(limits());
    let decoder = match reader.into_decoder() {
        Ok(decoder) => decoder,
        Err(source) => {
            return single_channel::decode(path, format).ok_or_else(|| decode_error(path, source))?;
        }
    };
    let (width, height) = decoder.dimensions();
    check_size(path, width, height)?;
    let image = DynamicImage::from_decoder(decoder).map_err(|source| decode_error(path, source))?;
    Ok(Picture::of(image))
}

/// What a decoder may use: room for the largest map in 16-byte texels, 16 GiB. A small file can hold a large map:
/// where memory is short, decoding it fails as any allocation does.
fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * u64::from(MAX_SIDE) * u64::from(MAX_SIDE));
    limits
}

/// A decoder's error, told apart from a format that is not read at all.
fn decode_error(path: &Path, source: ImageError) -> SceneError {
    match source {
        ImageError::Unsupported(ref error)
            if matches!(error.kind(), ::image::error::UnsupportedErrorKind::Format(_)) =>
        {
            SceneError::NotAnImage { path: path.into() }
        }
        source => SceneError::Decode { path: path.into(), source },
    }
}

/// Refuses maps without texels and those that kernels cannot address.
fn check_size(path: &Path, width: u32, height: u32) -> Result<(), SceneError> {
    if width == 0 || height == 0 {
        return Err(SceneError::NoTexels { path: path.into(), width, height });
    }
    if width.max(height) > MAX_SIDE {
        return Err(SceneError::TooManyTexels { path: path.into(), width, height, limit: MAX_SIDE });
    }
    Ok(())
}

/// A decoded image, top row first.
struct Picture {
    width: u32,
    height: u32,
    /// Values of a texel, 1 to 4.
    channels: usize,
    samples: Samples,
}

/// The values of an image, channel after channel, texel after texel.
enum Samples {
    Unorm8(Vec<u8>),
    Unorm16(Vec<u16>),
    Float32(Vec<f32>),
}

impl Picture {
    /// The values of an image, without a copy.
    fn of(image: DynamicImage) -> Self {
        use DynamicImage as D;
        let (width, height) = (image.width(), image.height());
        let (channels, samples) = match image {
            D::ImageLuma8(buffer) => (1, Samples::Unorm8(buffer.into_raw())),
            D::ImageLumaA8(buffer) => (2, Samples::Unorm8(buffer.into_raw())),
            D::ImageRgb8(buffer) => (3, Samples::Unorm8(buffer.into_raw())),
            D::ImageRgba8(buffer) => (4, Samples::Unorm8(buffer.into_raw())),
            D::ImageLuma16(buffer) => (1, Samples::Unorm16(buffer.into_raw())),
            D::ImageLumaA16(buffer) => (2, Samples::Unorm16(buffer.into_raw())),
            D::ImageRgb16(buffer) => (3, Samples::Unorm16(buffer.into_raw())),
            D::ImageRgba16(buffer) => (4, Samples::Unorm16(buffer.into_raw())),
            D::ImageRgb32F(buffer) => (3, Samples::Float32(buffer.into_raw())),
            // The widest of today's kinds, to which those to come convert.
            image => (4, Samples::Float32(image.into_rgba32f().into_raw())),
        };
        Self { width, height, channels, samples }
    }
}

/// The red, green and blue of a texel of one to four channels: grey, grey and alpha, RGB, RGBA.
fn rgb<T: Copy>(texel: &[T]) -> [T; 3] {
    match *texel {
        [r, g, b, ..] => [r, g, b],
        _ => [texel[0]; 3],
    }
}

/// A height map's texels and what goes with them.
struct Packed {
    format: u32,
    texels: Vec<u32>,
    range: (f32, f32),
    replaced: usize,
}

/// An unsigned integer that stands for a number in [0,1].
trait Code: Copy + Ord + Into<u32> {
    const FORMAT: u32;
    const BITS: u32;
    const MAX: Self;
    const PER_WORD: usize = (u32::BITS / Self::BITS) as usize;

    /// The nearest code; NaN gives 0.
    fn from_unit(x: f32) -> Self;

    /// 1 - this.
    fn complement(self) -> Self;

    /// Code `i` of packed ones.
    fn unpack(words: &[u32], i: usize) -> Self;

    /// The number that the code stands for, rounded once.
    #[inline]
    fn to_unit(self) -> f32 {
        let (code, max): (u32, u32) = (self.into(), Self::MAX.into());
        code as f32 / max as f32
    }
}

macro_rules! impl_code {
    ($code:ty, $format:expr) => {
        impl Code for $code {
            const FORMAT: u32 = $format;
            const BITS: u32 = <$code>::BITS;
            const MAX: Self = <$code>::MAX;

            #[inline]
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a float's cast saturates, so it rounds and clamps"
            )]
            fn from_unit(x: f32) -> Self {
                (x * f32::from(<$code>::MAX) + 0.5) as Self
            }

            #[inline]
            fn complement(self) -> Self {
                <$code>::MAX - self
            }

            #[inline]
            #[expect(
                clippy::cast_possible_truncation,
                reason = "the code is the word's lower part after the shift"
            )]
            fn unpack(words: &[u32], i: usize) -> Self {
                (words[i / Self::PER_WORD] >> (i % Self::PER_WORD * <$code>::BITS as usize)) as Self
            }
        }
    };
}
impl_code!(u8, height_format::UNORM8);
impl_code!(u16, height_format::UNORM16);

/// Packs the texels of an image in integers: the codes themselves where all channels agree, else the luminance.
fn pack_codes<T: Code>(samples: &[T], channels: usize, invert: bool) -> Packed {
    let texels = samples.chunks_exact(channels);
    if texels.clone().map(rgb).all(|[r, g, b]| r == g && g == b) {
        let grey = texels.map(|texel| if invert { texel[0].complement() } else { texel[0] });
        pack_grey(grey)
    } else {
        let luminance = texels.map(|texel| grey_float(&rgb(texel).map(T::to_unit)));
        pack_floats(luminance, 0.0, invert)
    }
}

/// Packs codes into words, the first in the lowest bits.
fn pack_grey<T: Code>(codes: impl ExactSizeIterator<Item = T>) -> Packed {
    let mut texels = vec![0; codes.len().div_ceil(T::PER_WORD)];
    let mut range: Option<(T, T)> = None;
    for (i, code) in codes.enumerate() {
        texels[i / T::PER_WORD] |= code.into() << (i % T::PER_WORD * T::BITS as usize);
        range = Some(range.map_or((code, code), |(min, max)| (min.min(code), max.max(code))));
    }
    let range = range.map_or((0.0, 0.0), |(min, max)| (min.to_unit(), max.to_unit()));
    Packed { format: T::FORMAT, texels, range, replaced: 0 }
}

/// Packs floats; those that are NaN or infinite become `zero`.
fn pack_floats(values: impl ExactSizeIterator<Item = f32>, zero: f32, invert: bool) -> Packed {
    let mut texels = Vec::with_capacity(values.len());
    let mut range = (f32::INFINITY, f32::NEG_INFINITY);
    let mut replaced = 0;
    for value in values {
        let mut texel = if invert { 1.0 - value } else { value };
        if !texel.is_finite() {
            texel = zero;
            replaced += 1;
        }
        range = (range.0.min(texel), range.1.max(texel));
        texels.push(texel.to_bits());
    }
    Packed { format: height_format::FLOAT32, texels, range, replaced }
}

/// A texel's value: where its channels agree that, else its luminance.
fn grey_float(texel: &[f32]) -> f32 {
    let [r, g, b] = rgb(texel);
    if r == g && g == b {
        return r;
    }
    let luminance = LUMINANCE[0] * f64::from(r) + LUMINANCE[1] * f64::from(g) + LUMINANCE[2] * f64::from(b);
    #[expect(clippy::cast_possible_truncation, reason = "the sum is rounded to the texels' precision")]
    {
        luminance as f32
    }
}

/// The words of a [`color_format::SRGB8`] map.
fn pack_srgb8(texels: impl ExactSizeIterator<Item = [u8; 3]>) -> Vec<u32> {
    let mut words = Vec::with_capacity(SRGB_CODES + texels.len());
    words.extend((0..=u8::MAX).map(|code| linear_from_srgb(code.to_unit()).to_bits()));
    words.extend(texels.map(|[r, g, b]| u32::from_le_bytes([r, g, b, u8::MAX])));
    words
}

/// The words of a [`color_format::FLOAT32`] map, from sRGB in 16 bits.
fn decode_srgb16(texels: impl ExactSizeIterator<Item = [u16; 3]>) -> Vec<u32> {
    let linear: Vec<u32> = (0..=u16::MAX).map(|code| linear_from_srgb(code.to_unit()).to_bits()).collect();
    let mut words = Vec::with_capacity(3 * texels.len());
    words.extend(texels.flatten().map(|code| linear[usize::from(code)]));
    words
}

/// The words of a [`color_format::FLOAT32`] map with 0 for values that are NaN or infinite, and how many these were.
fn finite_words(texels: impl ExactSizeIterator<Item = [f32; 3]>) -> (Vec<u32>, usize) {
    let mut words = Vec::with_capacity(3 * texels.len());
    let mut replaced = 0;
    for value in texels.flatten() {
        replaced += usize::from(!value.is_finite());
        words.push(if value.is_finite() { value.to_bits() } else { 0 });
    }
    (words, replaced)
}

#[cfg(test)]
mod tests;
