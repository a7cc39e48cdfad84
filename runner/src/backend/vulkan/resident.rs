//! A scene and its film in the device's memory.

use super::buffer::{Buffer, Label, require_room};
use super::commands::Commands;
use super::device::Device;
use super::transfers::Transfers;
use crate::backend::{BackendError, SceneBuffers};
use bytemuck::{bytes_of, cast_slice};
use emboss_kernels::interface::{Counter, FilmPixel, Frame, binding, counter};
use glam::Vec4;
use std::sync::Arc;

/// What a user can do about a model that is too large.
const SMALLER_MODEL: &str = "use a model of fewer triangles, or --backend cpu";
/// What a user can do about a map that is too large.
const SMALLER_MAP: &str = "scale the map down, or use --backend cpu";
/// What a user can do about a film that is too large.
const SMALLER_SIZE: &str = "use a smaller --size, or --backend cpu";
/// What a user can do about all of them together.
const SMALLER_SCENE: &str =
    "use smaller maps, a model of fewer triangles or a smaller --size, or --backend cpu";

/// The buffers of bindings [`binding::FRAME`] to [`binding::COUNTERS`], which live as long as the scene.
pub(super) struct Resident {
    /// Indexed by binding.
    buffers: Vec<Buffer>,
    width: u32,
    height: u32,
}

/// What one of the buffers holds at first.
struct Content<'a> {
    label: Label,
    /// Its size in bytes; may be 0.
    bytes: u64,
    /// What is uploaded; `None` for zeros.
    data: Option<&'a [u8]>,
}

impl Resident {
    /// Uploads a scene and makes an empty film for it. Sizes are checked before anything is allocated.
    pub(super) fn new(
        device: &Arc<Device>,
        commands: &Commands,
        transfers: &mut Transfers,
        scene: &SceneBuffers,
        frame: &Frame,
    ) -> Result<Self, BackendError> {
        let contents = contents(scene, frame);
        require_room_for_all(device, &contents)?;
        let buffers: Vec<_> = contents
            .iter()
            .map(|content| Buffer::for_kernels(device, content.label, content.bytes))
            .collect::<Result<_, _>>()?;
        for (buffer, content) in buffers.iter().zip(&contents) {
            match content.data {
                Some(data) if !data.is_empty() => transfers.write(commands, buffer, data)?,
                _ => commands.run("clearing", |recorder| recorder.fill(buffer, 0)).map(drop)?,
            }
        }
        Ok(Resident { buffers, width: frame.width, height: frame.height })
    }

    /// The buffer of a binding up to [`binding::COUNTERS`].
    pub(super) fn buffer(&self, binding: u32) -> &Buffer {
        &self.buffers[binding as usize]
    }

    /// Width of the film in pixels.
    pub(super) fn width(&self) -> u32 {
        self.width
    }

    /// Height of the film in pixels.
    pub(super) fn height(&self) -> u32 {
        self.height
    }

    /// How many pixels the film has: below 2³², since a buffer holds them.
    pub(super) fn pixels(&self) -> u32 {
        self.width * self.height
    }
}

/// What each buffer holds, in the order of bindings.
fn contents<'a>(scene: &'a SceneBuffers, frame: &'a Frame) -> [Content<'a>; binding::COUNTERS as usize + 1] {
    let pixels = u64::from(frame.width) * u64::from(frame.height);
    let zeros = |name, remedy, count: u64, element: usize| Content {
        label: Label { name, remedy },
        // Saturates far above what any device allows.
        bytes: count.saturating_mul(element as u64),
        data: None,
    };
    [
        uploaded("the frame", SMALLER_SCENE, bytes_of(frame)),
        uploaded("the vertices", SMALLER_MODEL, cast_slice(&scene.vertices)),
        uploaded("the triangles", SMALLER_MODEL, cast_slice(&scene.triangles)),
        uploaded("the BVH", SMALLER_MODEL, cast_slice(&scene.nodes)),
        uploaded("the BVH's primitives", SMALLER_MODEL, cast_slice(&scene.primitives)),
        uploaded("the height maps' settings", SMALLER_SCENE, cast_slice(&scene.displacements)),
        uploaded("the height maps", SMALLER_MAP, cast_slice(&scene.height_texels)),
        // Built on the device: see `Program::build_pyramids`.
        zeros("the height maps' pyramids", SMALLER_MAP, scene.height_ranges.len() as u64, size_of::<u32>()),
        uploaded("the seams", SMALLER_MODEL, cast_slice(&scene.seams)),
        uploaded("the seams' sides", SMALLER_MODEL, cast_slice(&scene.seam_sides)),
        uploaded("the colour map", SMALLER_MAP, cast_slice(&scene.color_texels)),
        uploaded("the lights", "use fewer lights", cast_slice(&scene.lights)),
        zeros("the film", SMALLER_SIZE, pixels, size_of::<FilmPixel>()),
        zeros("the picture", SMALLER_SIZE, pixels, size_of::<Vec4>()),
        zeros("the counters", SMALLER_SCENE, counter::COUNT as u64, size_of::<Counter>()),
    ]
}

fn uploaded<'a>(name: &'static str, remedy: &'static str, data: &'a [u8]) -> Content<'a> {
    Content { label: Label { name, remedy }, bytes: data.len() as u64, data: Some(data) }
}

/// `TooLarge` for the first buffer that the device does not allow, else for all of them together.
fn require_room_for_all(device: &Device, contents: &[Content<'_>]) -> Result<(), BackendError> {
    let limits = device.limits();
    for content in contents {
        require_room(device, content.label, content.bytes, limits.buffer_bytes())?;
    }
    // Each is at most a few GiB by now, so that the sum cannot overflow.
    let total = contents.iter().map(|content| content.bytes).sum();
    let label = Label { name: "the scene with its film", remedy: SMALLER_SCENE };
    require_room(device, label, total, limits.heap_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_stand_at_their_bindings() {
        let scene = SceneBuffers {
            height_texels: vec![1; 3],
            height_ranges: vec![3; 37],
            color_texels: vec![2; 5],
            ..Default::default()
        };
        let frame = Frame { width: 7, height: 3, ..Frame::default() };
        let contents = contents(&scene, &frame);
        let bytes = |binding: u32| contents[binding as usize].bytes;
        assert_eq!(bytes(binding::FRAME), size_of::<Frame>() as u64);
        assert_eq!(bytes(binding::HEIGHT_TEXELS), 12);
        assert_eq!(bytes(binding::HEIGHT_RANGES), 4 * 37);
        assert_eq!(bytes(binding::COLOR_TEXELS), 20);
        assert_eq!(bytes(binding::FILM), 7 * 3 * 20);
        assert_eq!(bytes(binding::PICTURE), 7 * 3 * 16);
        assert_eq!(bytes(binding::COUNTERS), 8 * counter::COUNT as u64);
    }

    #[test]
    fn sizes_beyond_any_memory_saturate() {
        let frame = Frame { width: u32::MAX, height: u32::MAX, ..Frame::default() };
        let contents = contents(&SceneBuffers::default(), &frame).map(|content| content.bytes);
        assert_eq!(contents[binding::FILM as usize], u64::MAX);
    }
}
