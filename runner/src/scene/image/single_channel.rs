//! EXR and TIFF files of a single channel of floats, which the image crate does not read.

use super::{MAX_SIDE, Picture, Samples, check_size};
use crate::scene::SceneError;
use ::image::ImageFormat;
use exr::prelude::{ReadChannels, ReadLayers};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// Decodes a file of a single channel; `None` where it is none, or damaged.
pub(super) fn decode(path: &Path, format: ImageFormat) -> Option<Result<Picture, SceneError>> {
    let picture = match format {
        ImageFormat::OpenExr => decode_exr(path)?,
        ImageFormat::Tiff => decode_tiff(path)?,
        _ => return None,
    };
    Some(check_size(path, picture.width, picture.height).map(|()| picture))
}

/// The only channel of an EXR file's first layer, or its luminance `Y`.
fn decode_exr(path: &Path) -> Option<Picture> {
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level();
    let layer = reader.all_channels().first_valid_layer().all_attributes().from_file(path).ok()?.layer_data;
    let channels = layer.channel_data.list;
    let channel = channels.iter().find(|channel| channels.len() == 1 || channel.name == *"Y")?;
    let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
    // Channels may have fewer samples than the layer has pixels; such a one is no height map.
    (values.len() == layer.size.area()).then_some(())?;
    grey(u32::try_from(layer.size.width()).ok()?, u32::try_from(layer.size.height()).ok()?, values)
}

/// A TIFF file of grey floats of 32 bits.
fn decode_tiff(path: &Path) -> Option<Picture> {
    let file = BufReader::new(File::open(path).ok()?);
    let mut decoder = Decoder::new(file).ok()?.with_limits(limits());
    let (width, height) = decoder.dimensions().ok()?;
    if decoder.colortype().ok()? != ColorType::Gray(32) {
        return None;
    }
    let DecodingResult::F32(values) = decoder.read_image().ok()? else {
        return None;
    };
    grey(width, height, values)
}

/// Room for the largest map.
fn limits() -> Limits {
    let mut limits = Limits::unlimited();
    limits.decoding_buffer_size = MAX_SIDE as usize * MAX_SIDE as usize * size_of::<f32>();
    limits
}

/// A picture of one channel; `None` where there are fewer values than texels.
fn grey(width: u32, height: u32, values: Vec<f32>) -> Option<Picture> {
    let texels = usize::try_from(u64::from(width) * u64::from(height)).ok()?;
    (values.len() == texels).then_some(Picture {
        width,
        height,
        channels: 1,
        samples: Samples::Float32(values),
    })
}
