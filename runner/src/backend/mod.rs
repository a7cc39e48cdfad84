//! Who runs the kernels: the CPU or a Vulkan device, behind one trait.

pub mod cpu;
pub mod select;
pub mod vulkan;

use emboss_kernels::interface::{
    BvhNode, Frame, Intersection, MAX_SUBDIVISIONS, PointLight, Ray, Triangle, Vertex, color_format, counter,
    height_format, method,
};
use emboss_kernels::scene::Features;
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
    /// Packed height map.
    pub height_texels: Vec<u32>,
    /// Packed colour map.
    pub color_texels: Vec<u32>,
    /// Lights.
    pub lights: Vec<PointLight>,
}

impl SceneBuffers {
    /// Checks every index that kernels follow without looking: a device build reads beyond a buffer without a word.
    /// What a kernel reads on the strength of `frame` and `features` is checked with them.
    pub fn check(&self, frame: &Frame, features: Features) -> Result<(), BackendError> {
        let below = |indices: &[u32], length: usize| indices.iter().all(|&i| (i as usize) < length);
        let map_words = |width: u32, height: u32, words_for: fn(u64) -> u64| {
            words_for(u64::from(width) * u64::from(height))
        };
        let d = &frame.displacement;
        let height_words = match features.height_format {
            height_format::UNORM8 => map_words(d.map_width, d.map_height, |texels| texels.div_ceil(4)),
            height_format::UNORM16 => map_words(d.map_width, d.map_height, |texels| texels.div_ceil(2)),
            _ => map_words(d.map_width, d.map_height, |texels| texels),
        };
        let color_words = match features.color_format {
            color_format::NONE => 0,
            color_format::SRGB8 => map_words(frame.color_width, frame.color_height, |texels| 256 + texels),
            _ => map_words(frame.color_width, frame.color_height, |texels| 3 * texels),
        };
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
        } else if displaced && (height_words == 0 || height_words > self.height_texels.len() as u64) {
            "the height map has fewer texels than its size says"
        } else if displaced && !(1..=MAX_SUBDIVISIONS).contains(&d.subdivisions) {
            "N is not between 1 and the limit"
        } else if traced && color_words > self.color_texels.len() as u64 {
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
            nodes: vec![BvhNode { count: 1, ..BvhNode::default() }],
            primitives: vec![0],
            height_texels: vec![0; 3],
            color_texels: vec![0; 256 + 9],
            lights: vec![PointLight::default()],
        };
        let displacement =
            Displacement { map_width: 3, map_height: 3, subdivisions: 1, ..Displacement::default() };
        let frame = Frame {
            displacement,
            triangle_count: 1,
            light_count: 1,
            color_width: 3,
            color_height: 3,
            ..Frame::default()
        };
        let features =
            Features { method: method::GRID_WALK, color_format: color_format::SRGB8, ..Features::default() };
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
        let breaks: [(&str, Break); 9] = [
            ("a vertex", |scene, _| scene.triangles[0].vertices[1] = 3),
            ("a triangle", |scene, _| scene.primitives[0] = 1),
            ("BVH node", |scene, _| scene.nodes[0].count = 2),
            ("BVH node", |scene, _| scene.nodes[0].count = 0),
            ("BVH node", |scene, _| scene.nodes.clear()),
            ("lights", |_, frame| frame.light_count = 2),
            ("height map", |_, frame| frame.displacement.map_width = 5),
            ("N is not", |_, frame| frame.displacement.subdivisions = 0),
            ("colour map", |_, frame| frame.color_width = 4),
        ];
        for (expected, fault) in breaks {
            let (mut scene, mut frame, features) = sound();
            fault(&mut scene, &mut frame);
            let error = scene.check(&frame, features).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
