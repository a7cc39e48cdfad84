//! Who runs the kernels: the CPU or a Vulkan device, behind one trait.

pub mod cpu;
pub mod select;
pub mod vulkan;

use emboss_kernels::displacement::height_pyramid::pyramid_words;
use emboss_kernels::interface::{
    BvhNode, Displacement, Frame, Intersection, MAX_SUBDIVISIONS, NO_SEAMS, PointLight, Ray, SeamSide, Seams,
    Triangle, Vertex, color_format, counter, height_format, method,
};
use emboss_kernels::scene::{Features, SceneView};
use glam::Vec4;
use std::ops::ControlFlow;

/// Everything of a scene that kernels read, in the layout they read it. Empty buffers are allowed.
#[derive(Clone, Debug, Default)]
pub struct SceneBuffers {
    /// Corners of the base mesh.
    pub vertices: Vec<Vertex>,
    /// Base triangles.
    pub triangles: Vec<Triangle>,
    /// The BVH.
    pub nodes: Vec<BvhNode>,
    /// Triangle indices in the order of the BVH's leaves.
    pub primitives: Vec<u32>,
    /// How the height maps displace.
    pub displacements: Vec<Displacement>,
    /// Packed height maps.
    pub height_texels: Vec<u32>,
    /// Their pyramids.
    pub height_ranges: Vec<u32>,
    /// Where neighbours disagree.
    pub seams: Vec<Seams>,
    /// The sides of seams.
    pub seam_sides: Vec<SeamSide>,
    /// Packed colour map.
    pub color_texels: Vec<u32>,
    /// Lights.
    pub lights: Vec<PointLight>,
}

impl SceneBuffers {
    /// The buffers as kernels see them.
    pub fn view<'a>(&'a self, frame: &'a Frame) -> SceneView<'a> {
        SceneView {
            frame,
            vertices: &self.vertices,
            triangles: &self.triangles,
            nodes: &self.nodes,
            primitives: &self.primitives,
            displacements: &self.displacements,
            height_texels: &self.height_texels,
            height_ranges: &self.height_ranges,
            seams: &self.seams,
            seam_sides: &self.seam_sides,
            color_texels: &self.color_texels,
            lights: &self.lights,
        }
    }

    /// Checks every index that kernels follow without looking: a device build reads beyond a buffer without a word.
    /// What a kernel reads on the strength of `frame` and `features` is checked with them.
    pub fn check(&self, frame: &Frame, features: Features) -> Result<(), BackendError> {
        let below = |indices: &[u32], length: usize| indices.iter().all(|&i| (i as usize) < length);
        let map_words = |width: u32, height: u32, words_for: fn(u64) -> u64| {
            words_for(u64::from(width) * u64::from(height))
        };
        let texel_words = |map: &Displacement| match features.height_format {
            height_format::UNORM8 => map_words(map.map_width, map.map_height, |texels| texels.div_ceil(4)),
            height_format::UNORM16 => map_words(map.map_width, map.map_height, |texels| texels.div_ceil(2)),
            _ => map_words(map.map_width, map.map_height, |texels| texels),
        };
        let within = |first: u32, words: u64, length: usize| u64::from(first) + words <= length as u64;
        let map_is_sound = |map: &Displacement| {
            let words = texel_words(map);
            words > 0
                && u64::from(map.map_width) * u64::from(map.map_height) <= u32::MAX.into()
                && within(map.first_word, words, self.height_texels.len())
                && within(
                    map.first_range,
                    pyramid_words(features.height_format, map.map_width, map.map_height).into(),
                    self.height_ranges.len(),
                )
        };
        let seams_are_sound = |seams: &Seams| {
            let ends = seams.first_side.iter().zip(&seams.side_count);
            let sides_are_there =
                ends.into_iter().all(|(&first, &count)| within(first, count.into(), self.seam_sides.len()));
            sides_are_there && (0..3).all(|e| seams.flags >> (3 + e) & 1 == 0 || seams.side_count[e] > 0)
        };
        let maps = self.displacements.len();
        let names_a_map = |triangle: &Triangle| (triangle.displacement as usize) < maps;
        let names_seams = |t: &Triangle| t.seams == NO_SEAMS || (t.seams as usize) < self.seams.len();
        let color_words = match features.color_format {
            color_format::NONE => 0,
            color_format::SRGB8 => map_words(frame.color_width, frame.color_height, |texels| 256 + texels),
            _ => map_words(frame.color_width, frame.color_height, |texels| 3 * texels),
        };
        let color_is_sound = features.color_format == color_format::NONE
            || frame.color_width > 0
                && frame.color_height > 0
                && color_words <= self.color_texels.len().min(u32::MAX as usize) as u64;
        let traced = frame.triangle_count > 0;
        let displaced = traced && features.method != method::NONE;
        let node_is_sound = |node: &BvhNode| match node.count {
            0 => u64::from(node.first) + 1 < self.nodes.len() as u64,
            count => u64::from(node.first) + u64::from(count) <= self.primitives.len() as u64,
        };
        let what = if !self.triangles.iter().all(|t| below(&t.vertices, self.vertices.len())) {
            "a triangle names a vertex that is not there"
        } else if !below(&self.primitives, self.triangles.len()) {
            "the BVH names a triangle that is not there"
        } else if traced && self.nodes.is_empty() || !self.nodes.iter().all(node_is_sound) {
            "a BVH node's children or primitives are not there"
        } else if frame.light_count as usize > self.lights.len() {
            "there are fewer lights than the frame says"
        } else if traced && !self.triangles.iter().all(names_a_map) {
            "a triangle names a height map that is not there"
        } else if traced && !self.displacements.iter().all(map_is_sound) {
            "the height map has fewer texels than its size says"
        } else if displaced && features.seams != 0 && !self.triangles.iter().all(names_seams) {
            "a triangle names seams that are not there"
        } else if displaced && features.seams != 0 && !self.seams.iter().all(seams_are_sound) {
            "a seam names sides that are not there"
        } else if !self.seam_sides.iter().all(|side| (side.displacement as usize) < maps) {
            "a seam's side names a height map that is not there"
        } else if displaced && !(1..=MAX_SUBDIVISIONS).contains(&frame.subdivisions) {
            "N is not between 1 and the limit"
        } else if traced && !color_is_sound {
            "the colour map has fewer texels than its size says"
        } else {
            return Ok(());
        };
        Err(BackendError::Unsound { what })
    }
}

/// What kind of device a backend runs on, in the order in which `auto` prefers them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card of its own.
    Discrete,
    /// A graphics unit that shares the host's memory.
    Integrated,
    /// A virtual machine's share of a card.
    Virtual,
    /// A Vulkan driver that runs on the CPU, such as lavapipe: used only when asked for.
    Software,
    /// The CPU backend.
    Cpu,
}

/// A device that can render.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// `vulkan` or `cpu`.
    pub backend: &'static str,
    /// The driver's or the processor's name.
    pub name: String,
    /// What kind it is.
    pub kind: DeviceKind,
    /// Driver and API version, or the number of threads.
    pub details: String,
}

/// Totals of the work counters, in the order of [`counter`].
pub type Totals = [u64; counter::COUNT];

/// What went wrong in a backend.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BackendError {
    /// No Vulkan loader, no driver, or no device that fits.
    #[error("no Vulkan device: {reason}; install a Vulkan driver, or use --backend cpu")]
    NoDevice {
        /// Why.
        reason: String,
    },
    /// Vulkan answered with an error.
    #[error("Vulkan: {what} failed: {source}")]
    Vulkan {
        /// What was attempted.
        what: &'static str,
        /// What Vulkan answered.
        source: ash::vk::Result,
    },
    /// A buffer is larger than the device allows or has room for.
    #[error("{name} needs {bytes} bytes, more than the {limit} bytes that {device} allows; {remedy}")]
    TooLarge {
        /// The buffer.
        name: &'static str,
        /// Its size.
        bytes: u64,
        /// What the device allows.
        limit: u64,
        /// The device.
        device: String,
        /// What a user can do.
        remedy: &'static str,
    },
    /// The device stopped answering.
    #[error(
        "{device} was lost while {what}; the picture so far is lost, a smaller N or --backend cpu may help"
    )]
    DeviceLost {
        /// The device.
        device: String,
        /// What it was doing.
        what: &'static str,
    },
    /// The validation layers were asked for and are not installed.
    #[error(
        "the Vulkan validation layers are not installed; install them (on Debian the package \
         vulkan-validationlayers), or leave out --validate"
    )]
    NoValidation,
    /// The scene's buffers do not fit each other: a defect of the program that made them.
    #[error("the scene cannot be traced: {what}")]
    Unsound {
        /// What does not fit.
        what: &'static str,
    },
    /// Memory could not be had.
    #[error("no memory for {name} ({bytes} bytes): {reason}")]
    Allocation {
        /// The buffer.
        name: &'static str,
        /// Its size.
        bytes: u64,
        /// Why.
        reason: String,
    },
}

/// Runs kernels. A backend holds one scene and one film at a time.
pub trait Backend {
    /// The device it runs on.
    fn device(&self) -> &DeviceInfo;

    /// Takes a scene, clears the film (`frame.width` x `frame.height`) and the counters, and makes the pipelines
    /// with just the code that `features` ask for.
    fn load(&mut self, scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<(), BackendError>;

    /// Adds sample number `sample` to every pixel, tile by tile. Calls `progress` with the share done (0 to 1)
    /// between tiles; `Break` ends the pass, and the film keeps what it has.
    fn add_sample(
        &mut self,
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, BackendError>;

    /// The picture so far: linear RGB premultiplied by alpha, row-major, top row first.
    fn resolve(&mut self) -> Result<Vec<Vec4>, BackendError>;

    /// The work counters since `load`.
    fn totals(&mut self) -> Result<Totals, BackendError>;

    /// What the device took for the samples since `load`, in milliseconds, without the host's time between
    /// submissions: by its own clock, or by the host's where it has none. `None` on the CPU.
    fn device_ms(&mut self) -> Option<f64>;

    /// The nearest hit of each ray.
    fn trace_rays(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError>;

    /// Runs an elementary kernel on `count` items: see [`probe`](emboss_kernels::probe). Needs no scene.
    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::Displacement;

    fn sound() -> (SceneBuffers, Frame, Features) {
        let scene = SceneBuffers {
            vertices: vec![Vertex::default(); 3],
            triangles: vec![Triangle { vertices: [0, 1, 2], ..Triangle::default() }],
            seams: vec![Seams { side_count: [1, 0, 0], ..Seams::default() }],
            seam_sides: vec![SeamSide::default()],
            displacements: vec![Displacement { map_width: 3, map_height: 3, ..Displacement::default() }],
            height_ranges: vec![0; pyramid_words(height_format::UNORM8, 3, 3) as usize],
            nodes: vec![BvhNode { count: 1, ..BvhNode::default() }],
            primitives: vec![0],
            height_texels: vec![0; 3],
            color_texels: vec![0; 256 + 9],
            lights: vec![PointLight::default()],
        };
        let frame = Frame {
            subdivisions: 1,
            triangle_count: 1,
            light_count: 1,
            color_width: 3,
            color_height: 3,
            ..Frame::default()
        };
        let features = Features {
            method: method::QUADTREE,
            color_format: color_format::SRGB8,
            seams: 1,
            ..Features::default()
        };
        (scene, frame, features)
    }

    #[test]
    fn sound_and_empty_scenes_pass() {
        let (scene, frame, features) = sound();
        assert!(scene.check(&frame, features).is_ok());
        assert!(SceneBuffers::default().check(&Frame::default(), Features::default()).is_ok());
    }

    #[test]
    fn every_index_that_a_kernel_follows_is_checked() {
        type Break = fn(&mut SceneBuffers, &mut Frame);
        let breaks: [(&str, Break); 17] = [
            ("a vertex", |scene, _| scene.triangles[0].vertices[1] = 3),
            ("a triangle", |scene, _| scene.primitives[0] = 1),
            ("BVH node", |scene, _| scene.nodes[0].count = 2),
            ("BVH node", |scene, _| scene.nodes[0].count = 0),
            ("BVH node", |scene, _| scene.nodes.clear()),
            ("lights", |_, frame| frame.light_count = 2),
            ("fewer texels", |scene, _| scene.displacements[0].map_width = 5),
            ("fewer texels", |scene, _| scene.displacements[0].first_word = 1),
            ("fewer texels", |scene, _| scene.displacements[0].first_range = 1),
            ("triangle names a height map", |scene, _| scene.triangles[0].displacement = 1),
            ("names seams", |scene, _| scene.triangles[0].seams = 1),
            ("names sides", |scene, _| scene.seams[0].first_side[0] = 1),
            ("names sides", |scene, _| scene.seams[0].flags = 1 << 4),
            ("side names a height map", |scene, _| scene.seam_sides[0].displacement = 1),
            ("N is not", |_, frame| frame.subdivisions = 0),
            ("colour map", |_, frame| frame.color_width = 4),
            ("colour map", |_, frame| frame.color_width = 0),
        ];
        for (expected, fault) in breaks {
            let (mut scene, mut frame, features) = sound();
            fault(&mut scene, &mut frame);
            let error = scene.check(&frame, features).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
