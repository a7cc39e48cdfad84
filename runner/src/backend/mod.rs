//! Who runs the kernels: the CPU or a Vulkan device, behind one trait.

pub mod cpu;
pub mod select;
pub mod vulkan;

use emboss_kernels::interface::{BvhNode, Frame, Intersection, PointLight, Ray, Triangle, Vertex, counter};
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
