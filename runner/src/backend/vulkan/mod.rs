//! The Vulkan backend: the kernels on a graphics card.
//!
//! Needs Vulkan 1.2's core with its memory model, and to show pictures in windows `VK_KHR_swapchain`; the loader is
//! opened at run time. From the bottom
//! up: `instance` and `validation`, `physical` (which device), `device` (the open device and handles that
//! destroy themselves), `buffer`, `commands` (submissions, timed), `transfers`, `pipeline`; then what runs on
//! them: `tiles` and `pacer` cut the work so that no submission runs long, `programs` are paced pipelines,
//! `resident` is a scene with its film; `scan` and `sort` are recorded into submissions of others. Apart from all that
//! `surface` is a window and `swapchain` shows pictures in it, from another thread; `window` opens a device for both,
//! or for the one that renders alone.
//!
//! Everything that a backend does runs on one queue, one submission at a time, and each is waited for. Hence between
//! two submissions buffers can be dropped and descriptors written, and a program that ends leaves nothing running. A
//! swapchain submits to the same queue, in turns with the backend, and shares no resource with the backend.
#![expect(
    unsafe_code,
    reason = "Vulkan's calls are unsafe; each stands in a block of its own with the rule it keeps"
)]
#![warn(clippy::multiple_unsafe_ops_per_block)]

mod buffer;
mod build;
mod commands;
mod device;
mod instance;
mod pacer;
mod physical;
mod pipeline;
mod programs;
mod resident;
mod scan;
mod sort;
pub mod specialize;
mod statistics;
mod surface;
mod swapchain;
mod tiles;
mod transfers;
mod turns;
mod validation;
mod window;

pub use swapchain::{Shown, Swapchain};
pub use validation::ValidationLog;
pub use window::{OpenDevice, Window};

use crate::backend::{Backend, BackendError, BuildReport, DeviceInfo, PipelineCode, SceneBuffers, Totals};
use crate::bvh::{BuildTimes, Bvh, MOST_GROWTH};
use crate::instances;
use buffer::{Buffer, Label};
use build::{Builder, OwnTree, Scratch, Tree};
use bytemuck::cast_slice;
use commands::Commands;
use device::Device;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::radix_sort::{count_words, limbs, result_half};
use emboss_kernels::bvh::refit::node_count;
use emboss_kernels::displacement::tessellate::vertices_of;
use emboss_kernels::interface::{
    BvhNode, Counter, Displacement, FilmPixel, Frame, Intersection, PointLight, Ray, Seams, Triangle,
    binding, bounds, counter,
};
use emboss_kernels::prism_tree::build::lowest_nodes;
use emboss_kernels::prism_tree::layout::levels;
use emboss_kernels::probe::{IN_STRIDE, OUT_STRIDE};
use emboss_kernels::relief::distance_map::{CELLS, COLUMNS, WORDS};
use emboss_kernels::scene::Features;
use glam::{Vec3, Vec4};
use instance::Instance;
use pipeline::Kernel;
use programs::Programs;
use resident::Resident;
use sort::SortBuffers;
use std::ops::{ControlFlow, Range};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};
use transfers::Transfers;

/// Rays that are on the device at a time; more are traced in turns, so that no number of rays is too large.
/// 28 MiB with their intersections.
const RAYS_AT_A_TIME: usize = 1 << 18;

/// Whether the environment lets drivers fuse products with sums, to measure what exactness costs: see
/// [`Backend::let_contract`].
fn contracts() -> bool {
    std::env::var_os("EMBOSS_CONTRACT").is_some_and(|value| value == "1")
}

/// Which Vulkan device is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Selection {
    /// The best hardware device: discrete, then integrated, then virtual. Never a software one, which is slower
    /// than the CPU backend; the error where there is no other names it.
    #[default]
    Auto,
    /// A number, as the list of [`devices`] has them from 0 on, or else a part of a name, in any case, of which the
    /// first match is taken. May be a software device.
    Named(String),
}

/// Every Vulkan device that fits, in the loader's order. Empty where drivers are installed and none of them offers
/// such a device.
///
/// # Errors
/// [`BackendError::NoDevice`] where there is no loader or no driver.
pub fn devices() -> Result<Vec<DeviceInfo>, BackendError> {
    let instance = Instance::new(false, &[])?;
    Ok(physical::enumerate(&instance, None)?.into_iter().map(|device| device.info).collect())
}

/// Runs kernels on a Vulkan device. A new one holds an empty scene and a film without pixels.
pub struct VulkanBackend {
    resident: Resident,
    programs: Programs,
    /// Made when it is first needed.
    builder: Option<Rc<Builder>>,
    transfers: Transfers,
    commands: Commands,
    device: Arc<Device>,
    /// What the samples took since the film was cleared.
    samples_ms: f64,
    report: BuildReport,
    /// The SAH cost of the BVH as it was built, once it was asked for.
    built_cost: Option<f64>,
}

impl VulkanBackend {
    /// Opens the selected device, under the validation layers where `validate` is true.
    ///
    /// # Errors
    /// [`BackendError::NoDevice`] where nothing matches `selection`, [`BackendError::NoValidation`] where the layers
    /// are asked for and are not installed.
    pub fn new(selection: &Selection, validate: bool) -> Result<Self, BackendError> {
        let instance = Arc::new(Instance::new(validate, &[])?);
        let found = physical::enumerate(&instance, None)?;
        let device = Device::new(instance, physical::select(found, selection)?)?;
        Self::empty_on(OpenDevice(device))
    }

    /// A backend on a device that is open already, for a window: see [`OpenDevice::for_window`]. What builds BVHs is
    /// compiled at once, since the scene is still being read.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn on(device: OpenDevice) -> Result<Self, BackendError> {
        let mut backend = Self::empty_on(device)?;
        backend.programs = Programs::for_window();
        backend.programs.let_contract(contracts());
        backend.builder()?;
        Ok(backend)
    }

    fn empty_on(OpenDevice(device): OpenDevice) -> Result<Self, BackendError> {
        let commands = Commands::new(&device)?;
        let mut transfers = Transfers::new(&device)?;
        let resident = empty(&device, &commands, &mut transfers)?;
        let mut programs = Programs::default();
        programs.let_contract(contracts());
        if contracts() {
            tracing::warn!(
                "EMBOSS_CONTRACT=1: the driver may fuse products with sums, so that nothing is exact"
            );
        }
        Ok(VulkanBackend {
            resident,
            programs,
            builder: None,
            transfers,
            commands,
            device,
            samples_ms: 0.0,
            report: BuildReport::default(),
            built_cost: None,
        })
    }

    /// What the validation layers have said so far; empty where validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.validation_log().messages()
    }

    /// The list that the validation layers write to. It can be kept when the backend is dropped, and has then what
    /// they say of that.
    pub fn validation_log(&self) -> ValidationLog {
        self.device.instance().log().clone()
    }

    /// The sum of samples of each pixel, row-major, top row first.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], or another error of the driver.
    pub fn film(&mut self) -> Result<Vec<FilmPixel>, BackendError> {
        let count = self.resident.pixels() as usize;
        self.transfers.read(&self.commands, self.resident.buffer(binding::FILM), count)
    }

    /// The first `words` words of the height maps' pyramids as the device built them.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], or another error of the driver.
    ///
    /// # Panics
    /// Where the scene has fewer.
    pub fn height_ranges(&mut self, words: usize) -> Result<Vec<u32>, BackendError> {
        self.transfers.read(&self.commands, self.resident.buffer(binding::HEIGHT_RANGES), words)
    }

    /// Sorts pairs of a key and a value by keys of `bits` bits, stably. A key has one word, or two where `bits` is
    /// above 32: then the lower words of all keys come first, then the upper ones; so also in what is returned. A part
    /// of the BVH's build, by itself for tests.
    ///
    /// # Errors
    /// [`BackendError::TooLarge`], [`BackendError::DeviceLost`], or another error of the driver.
    ///
    /// # Panics
    /// Where `bits` is not 1 to 64, keys and values are not equally many, or there are more than 65,535 blocks of 1024.
    pub fn sort_pairs(
        &mut self,
        keys: &[u32],
        values: &[u32],
        bits: u32,
    ) -> Result<(Vec<u32>, Vec<u32>), BackendError> {
        assert!((1..=64).contains(&bits) && keys.len() == values.len() * limbs(bits) as usize);
        let count = length(values);
        let key_words = self.buffer("the sort's keys", 2 * size_of_val(keys), cast_slice(keys))?;
        let value_words = self.buffer("the sort's values", 2 * size_of_val(values), cast_slice(values))?;
        let counts = self.buffer("the sort's counts", words(count_words(count)), &[])?;
        let sums = self.buffer("the sort's sums", words(sort::sum_words(count)), &[])?;
        let builder = self.builder()?;
        let sorter = builder.sorter();
        sorter.bind(SortBuffers { keys: &key_words, values: &value_words, counts: &counts, sums: &sums });
        self.commands.run("sorting", |recorder| sorter.record(recorder, count, bits))?;
        let half = result_half(bits) as usize;
        let mut both_keys = self.transfers.read(&self.commands, &key_words, 2 * keys.len())?;
        let mut both_values = self.transfers.read(&self.commands, &value_words, 2 * values.len())?;
        let keys = both_keys.drain(half * keys.len()..).take(keys.len()).collect();
        let values = both_values.drain(half * values.len()..).take(values.len()).collect();
        Ok((keys, values))
    }

    /// The exclusive prefix sums of `values`, modulo 2^32. A part of the BVH's build, by itself for tests.
    ///
    /// # Errors
    /// [`BackendError::TooLarge`], [`BackendError::DeviceLost`], or another error of the driver.
    ///
    /// # Panics
    /// Where there are more than 65,535 blocks of 1024.
    pub fn scan(&mut self, values: &[u32]) -> Result<Vec<u32>, BackendError> {
        let count = length(values);
        let scanned = self.buffer("the scan's values", size_of_val(values), cast_slice(values))?;
        let sums = self.buffer("the scan's sums", words(scan::sum_words(count)), &[])?;
        let builder = self.builder()?;
        let scanner = builder.sorter().scanner();
        scanner.bind(&scanned, &sums);
        self.commands.run("scanning", |recorder| scanner.record(recorder, count))?;
        self.transfers.read(&self.commands, &scanned, values.len())
    }

    /// Takes boxes to build a BVH over: by itself, for tests and measurements.
    ///
    /// # Errors
    /// [`BackendError::TooLarge`], [`BackendError::Allocation`], or another error of the driver.
    pub fn bvh_over(&mut self, boxes: &[Aabb]) -> Result<DeviceBvh<'_>, BackendError> {
        let builder = self.builder()?;
        let (tree, scratch) =
            (OwnTree::new(&self.device, length(boxes))?, Scratch::new(&self.device, length(boxes))?);
        let mut bvh = DeviceBvh { backend: self, builder, tree, scratch };
        bvh.put_boxes(boxes)?;
        Ok(bvh)
    }

    /// What builds BVHs, compiled now if this is the first time that it is needed.
    fn builder(&mut self) -> Result<Rc<Builder>, BackendError> {
        if let Some(builder) = &self.builder {
            return Ok(Rc::clone(builder));
        }
        let builder = Rc::new(Builder::new(&self.device)?);
        self.builder = Some(Rc::clone(&builder));
        Ok(builder)
    }

    /// The first `triangles` triangles and `seams` entries of the seams' table, with the heights that the device
    /// computed.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], or another error of the driver.
    ///
    /// # Panics
    /// Where the scene has fewer.
    pub fn heights(
        &mut self,
        triangles: usize,
        seams: usize,
    ) -> Result<(Vec<Triangle>, Vec<Seams>), BackendError> {
        let triangles =
            self.transfers.read(&self.commands, self.resident.buffer(binding::TRIANGLES), triangles)?;
        let seams = self.transfers.read(&self.commands, self.resident.buffer(binding::SEAMS), seams)?;
        Ok((triangles, seams))
    }

    /// Compiles what the scene needs before it is traced, so that its time is not part of the build's.
    fn compile_preparation(&mut self, resident: &Resident) -> Result<(), BackendError> {
        self.builder()?;
        self.programs.get(&self.device, Kernel::HeightPyramid)?;
        for (kernel, items) in preparation(resident) {
            if !items.is_empty() {
                self.programs.get(&self.device, kernel)?;
            }
        }
        if resident.bounds().1 != bounds::NONE {
            for kernel in TREE_KERNELS {
                self.programs.get(&self.device, kernel)?;
            }
        }
        Ok(())
    }

    /// Compiles what makes pictures, so that its time is not part of the first sample's.
    fn compile_tracing(&mut self) -> Result<(), BackendError> {
        for kernel in [Kernel::Render, Kernel::Resolve] {
            self.programs.get(&self.device, kernel)?;
        }
        Ok(())
    }

    /// Everything from the pyramids to the BVH: the heights of triangles, those of seams, the boxes, and of a
    /// tessellation micro-vertices and their boxes; distance maps.
    fn prepare_prisms(&mut self, resident: &Resident) -> Result<(), BackendError> {
        for (kernel, items) in preparation(resident) {
            if !items.is_empty() {
                let program = self.programs.get(&self.device, kernel)?;
                let micro = kernel == Kernel::TessellateBounds;
                program.pipeline().bind(|at| match at {
                    binding::BOXES if micro => resident.micro_boxes(),
                    _ => resident.buffer(at),
                });
                program.run_batches(&self.commands, items, 0)?;
            }
        }
        self.store_bounds(resident)
    }

    /// The stored tree below the triangles.
    fn store_bounds(&mut self, resident: &Resident) -> Result<(), BackendError> {
        let (n, stored) = resident.bounds();
        if stored == bounds::NONE {
            return Ok(());
        }
        let triangles = resident.triangles();
        let mut run = |kernel, count, level| {
            let program = self.programs.get(&self.device, kernel)?;
            program.pipeline().bind(|at| resident.buffer(at));
            program.run_batches(&self.commands, 0..count, level)
        };
        if stored == bounds::ALL {
            run(Kernel::TreeMicroVertices, triangles * vertices_of(n), 0)?;
        }
        run(Kernel::TreeFrames, triangles, 0)?;
        run(Kernel::TreeBlocks, triangles * lowest_nodes(n), 0)?;
        for level in (0..levels(n).saturating_sub(1)).rev() {
            run(Kernel::TreeNodes, triangles << (2 * level), level)?;
        }
        Ok(())
    }

    /// The stored tree above the triangles.
    fn collapse_bvh(&mut self, resident: &Resident) -> Result<(), BackendError> {
        let (_, stored) = resident.bounds();
        let pairs = self.report.nodes / 2;
        if stored != bounds::NONE && pairs > 0 {
            let program = self.programs.get(&self.device, Kernel::TreeUpperNodes)?;
            program.pipeline().bind(|at| resident.buffer(at));
            program.run_batches(&self.commands, 0..pairs, 0)?;
        }
        Ok(())
    }

    /// Gives the tree the boxes that its triangles have now, or builds it again where that does not do. `before` is
    /// what was said of it, `start` when the work began.
    fn update_bvh(
        &mut self,
        resident: &Resident,
        before: BuildReport,
        built_cost: f64,
        start: Instant,
    ) -> Result<(), BackendError> {
        // A triangle that was left out may be sound by now, which a refit would not notice.
        if before.left_out == 0 {
            let builder = self.builder()?;
            let (commands, transfers, tree) = (&self.commands, &self.transfers, resident.tree());
            builder.refit(commands, tree)?;
            let is_sound = tree.state.unsound(commands, transfers)? == 0;
            if is_sound && builder.cost(commands, transfers, tree)? <= MOST_GROWTH * built_cost {
                self.report = BuildReport { duration: start.elapsed(), refitted: true, ..before };
                return self.collapse_bvh(resident);
            }
        }
        self.build_bvh(resident, start)
    }

    /// Builds the tree over the boxes. `start` is when the work began.
    fn build_bvh(&mut self, resident: &Resident, start: Instant) -> Result<(), BackendError> {
        if !resident.instances().is_empty() {
            return self.build_trees(resident, start);
        }
        let builder = self.builder()?;
        let tree = resident.tree();
        builder.build(&self.commands, tree, &Scratch::new(&self.device, tree.state.count())?)?;
        let sound = tree.state.sound(&self.commands, &self.transfers)?;
        let (nodes, left_out) = (node_count(sound), tree.state.count() - sound);
        self.report = BuildReport { duration: start.elapsed(), nodes, left_out, refitted: false };
        self.built_cost = None;
        self.collapse_bvh(resident)
    }

    /// Builds the trees of the instances' meshes, one after the other, each by itself, and the tree over the instances.
    /// They are not refitted: a mesh that has instances is small next to what is seen of it.
    fn build_trees(&mut self, resident: &Resident, start: Instant) -> Result<(), BackendError> {
        let builder = self.builder()?;
        let (instances, mut bounds) = (resident.instances(), Vec::new());
        let (mut nodes, mut left_out) = (0, 0);
        for mesh in instances::meshes(instances) {
            let count = mesh.triangle_count;
            let own = OwnTree::new(&self.device, count)?;
            let tree = own.tree();
            if count == 0 {
                bounds.push(Aabb::EMPTY);
                continue;
            }
            let first = u64::from(mesh.first_triangle);
            own.take_boxes(&self.commands, resident.buffer(binding::BOXES), first)?;
            builder.build(&self.commands, tree, &Scratch::new(&self.device, count)?)?;
            own.give(&self.commands, resident.tree(), mesh)?;
            let sound = tree.state.sound(&self.commands, &self.transfers)?;
            (nodes, left_out) = (nodes + node_count(sound), left_out + count - sound);
            let root: Vec<BvhNode> = self.transfers.read(&self.commands, tree.nodes, 1)?;
            bounds.extend(root.iter().map(|root| Aabb { min: root.min, max: root.max }));
        }
        let over = instances::tree_over(instances, &bounds);
        self.transfers.write(&self.commands, resident.buffer(binding::NODES), cast_slice(&over))?;
        nodes += length(&over);
        self.report = BuildReport { duration: start.elapsed(), nodes, left_out, refitted: false };
        Ok(())
    }

    /// Leaves an empty scene in the place of the present one.
    fn take_scene(&mut self) -> Result<Resident, BackendError> {
        let empty = empty(&self.device, &self.commands, &mut self.transfers)?;
        (self.samples_ms, self.report) = (0.0, BuildReport::default());
        Ok(std::mem::replace(&mut self.resident, empty))
    }

    /// A buffer for the kernels that holds `data` at first, and is `bytes` long.
    fn buffer(&mut self, name: &'static str, bytes: usize, data: &[u8]) -> Result<Buffer, BackendError> {
        let label = Label { name, remedy: "use fewer at a time" };
        let buffer = Buffer::for_kernels(&self.device, label, bytes as u64)?;
        self.transfers.write(&self.commands, &buffer, data)?;
        Ok(buffer)
    }

    /// Traces rays that fit on the device at a time.
    fn trace_some(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError> {
        let origin = self.buffer("the rays", size_of_val(rays), cast_slice(rays))?;
        let hits = self.buffer("the intersections", rays.len() * size_of::<Intersection>(), &[])?;
        let program = self.programs.get(&self.device, Kernel::TraceRays)?;
        program.pipeline().bind(|at| match at {
            binding::RAYS => &origin,
            binding::INTERSECTIONS => &hits,
            _ => self.resident.buffer(at),
        });
        program.run_batches(&self.commands, 0..length(rays), 0)?;
        self.transfers.read(&self.commands, &hits, rays.len())
    }
}

impl Backend for VulkanBackend {
    fn device(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn load(&mut self, scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<(), BackendError> {
        // The old scene goes first, to make room. After an error the backend holds an empty one.
        self.take_scene()?;
        scene.check(frame, features)?;
        self.programs.set_features(features);
        let transfers = &mut self.transfers;
        let resident = Resident::new(&self.device, &self.commands, transfers, scene, frame, features)?;
        // What nothing traces was not checked, and is not read.
        if frame.triangle_count > 0 {
            self.compile_preparation(&resident)?;
            let start = Instant::now();
            let program = self.programs.get(&self.device, Kernel::HeightPyramid)?;
            program.pipeline().bind(|at| resident.buffer(at));
            program.build_pyramids(&self.commands, &scene.displacements)?;
            self.prepare_prisms(&resident)?;
            self.build_bvh(&resident, start)?;
        }
        self.compile_tracing()?;
        self.resident = resident;
        Ok(())
    }

    fn build_report(&self) -> BuildReport {
        self.report
    }

    fn pipelines(&self) -> Vec<PipelineCode> {
        self.programs.codes()
    }

    fn compile_time(&self) -> Duration {
        self.programs.compile_time()
    }

    fn prism_boxes(&mut self) -> Result<Vec<Aabb>, BackendError> {
        let (boxes, count) = (self.resident.buffer(binding::BOXES), self.resident.triangles() as usize);
        read_boxes(&self.commands, &self.transfers, boxes, count)
    }

    fn bvh(&mut self) -> Result<Bvh, BackendError> {
        if self.resident.instances().is_empty() {
            return self.resident.tree().read(&self.commands, &self.transfers);
        }
        let (nodes, triangles) = (instances::node_room(self.resident.instances()), self.resident.triangles());
        let Tree { nodes: node_buffer, primitives, .. } = self.resident.tree();
        Ok(Bvh {
            nodes: self.transfers.read(&self.commands, node_buffer, nodes as usize)?,
            primitives: self.transfers.read(&self.commands, primitives, triangles as usize)?,
        })
    }

    fn distance_maps(&mut self) -> Result<Vec<f32>, BackendError> {
        let floats = self.resident.distance_maps() as usize * WORDS as usize;
        self.transfers.read(&self.commands, self.resident.buffer(binding::DISTANCES), floats)
    }

    fn set_view(&mut self, frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError> {
        self.samples_ms = 0.0;
        self.programs.beware();
        self.resident.set_view(&self.device, &self.commands, &mut self.transfers, frame, lights)
    }

    fn set_displacements(&mut self, displacements: &[Displacement]) -> Result<(), BackendError> {
        self.samples_ms = 0.0;
        self.programs.beware();
        self.resident.set_displacements(&self.commands, &mut self.transfers, displacements)?;
        if self.resident.triangles() > 0 && !self.resident.instances().is_empty() {
            let (start, resident) = (Instant::now(), self.take_scene()?);
            self.prepare_prisms(&resident)?;
            self.build_bvh(&resident, start)?;
            self.resident = resident;
        } else if self.resident.triangles() > 0 {
            let (start, before) = (Instant::now(), self.report);
            let built_cost = match self.built_cost {
                Some(cost) => cost,
                None => self.builder()?.cost(&self.commands, &self.transfers, self.resident.tree())?,
            };
            self.built_cost = Some(built_cost);
            // Half-built trees are not traced: after an error the backend holds an empty scene.
            let resident = self.take_scene()?;
            self.prepare_prisms(&resident)?;
            self.update_bvh(&resident, before, built_cost, start)?;
            self.resident = resident;
        }
        Ok(())
    }

    fn set_features(&mut self, features: Features) -> Result<(), BackendError> {
        self.samples_ms = 0.0;
        self.resident.set_features(&self.commands, features)?;
        self.programs.set_features(self.resident.features());
        self.compile_tracing()
    }

    fn add_sample(
        &mut self,
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, BackendError> {
        let size = self.resident.size();
        let program = self.programs.get(&self.device, Kernel::Render)?;
        program.pipeline().bind(|at| self.resident.buffer(at));
        let pass = program.run_film(&self.commands, size, sample, progress)?;
        self.samples_ms += pass.device_ms;
        Ok(pass.flow)
    }

    fn resolve(&mut self) -> Result<Vec<Vec4>, BackendError> {
        let size = self.resident.size();
        let program = self.programs.get(&self.device, Kernel::Resolve)?;
        program.pipeline().bind(|at| self.resident.buffer(at));
        // Nothing asks to end it early.
        program.run_film(&self.commands, size, 0, &mut |_| ControlFlow::Continue(()))?;
        let count = self.resident.pixels() as usize;
        self.transfers.read(&self.commands, self.resident.buffer(binding::PICTURE), count)
    }

    fn totals(&mut self) -> Result<Totals, BackendError> {
        let counters: Vec<Counter> =
            self.transfers.read(&self.commands, self.resident.buffer(binding::COUNTERS), counter::COUNT)?;
        Ok(std::array::from_fn(|i| counters[i].value()))
    }

    fn device_ms(&mut self) -> Option<f64> {
        Some(self.samples_ms)
    }

    fn trace_rays(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError> {
        let mut hits = Vec::with_capacity(rays.len());
        for some in rays.chunks(RAYS_AT_A_TIME) {
            hits.extend(self.trace_some(some)?);
        }
        Ok(hits)
    }

    fn let_contract(&mut self, contracts: bool) {
        self.programs.let_contract(contracts);
    }

    /// # Panics
    /// Where `input` has fewer words than `count` items read: kernels do not check indices on a device.
    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError> {
        assert!(input.len() >= count as usize * IN_STRIDE as usize, "probe needs {IN_STRIDE} words an item");
        let words = count as usize * OUT_STRIDE as usize;
        let arguments = self.buffer("the probe's input", size_of_val(input), cast_slice(input))?;
        let results = self.buffer("the probe's output", words * size_of::<u32>(), &[])?;
        self.commands.run("clearing", |recorder| recorder.fill(&results, 0))?;
        let program = self.programs.get(&self.device, Kernel::Probe)?;
        program.pipeline().bind(|at| if at == binding::PROBE_IN { &arguments } else { &results });
        program.run_batches(&self.commands, 0..count, kernel)?;
        self.transfers.read(&self.commands, &results, words)
    }
}

/// A BVH on the device, by itself: see [`VulkanBackend::bvh_over`].
pub struct DeviceBvh<'a> {
    backend: &'a mut VulkanBackend,
    builder: Rc<Builder>,
    tree: OwnTree,
    /// Kept for the next build: a card that waits for memory to be allocated slows its clocks.
    scratch: Scratch,
}

impl DeviceBvh<'_> {
    /// Builds it over its boxes. Returns what the phases took on the device.
    ///
    /// # Errors
    /// [`BackendError::TooLarge`], [`BackendError::Allocation`], or another error of the driver.
    pub fn build(&mut self) -> Result<BuildTimes, BackendError> {
        self.builder.build(&self.backend.commands, self.tree.tree(), &self.scratch)
    }

    /// Gives the nodes the boxes that the primitives have now. Returns what it took on the device, in milliseconds.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If there are not as many boxes as before.
    pub fn refit(&mut self, boxes: &[Aabb]) -> Result<f64, BackendError> {
        assert_eq!(boxes.len(), self.tree.tree().state.count() as usize, "a refit keeps the primitives");
        self.put_boxes(boxes)?;
        self.builder.refit(&self.backend.commands, self.tree.tree())
    }

    /// Its SAH cost, as [`BvhStats::sah_cost`](crate::bvh::BvhStats::sah_cost) but in single precision.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn cost(&mut self) -> Result<f64, BackendError> {
        self.builder.cost(&self.backend.commands, &self.backend.transfers, self.tree.tree())
    }

    /// The tree, copied to the host.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn read(&mut self) -> Result<Bvh, BackendError> {
        self.tree.tree().read(&self.backend.commands, &self.backend.transfers)
    }

    fn put_boxes(&mut self, boxes: &[Aabb]) -> Result<(), BackendError> {
        let floats: Vec<_> = boxes.iter().flat_map(|bounds| [bounds.min, bounds.max]).collect();
        let VulkanBackend { transfers, commands, .. } = &mut *self.backend;
        transfers.write(commands, self.tree.tree().boxes, cast_slice(&floats))
    }
}

/// An empty scene, and a film without pixels.
fn empty(
    device: &Arc<Device>,
    commands: &Commands,
    transfers: &mut Transfers,
) -> Result<Resident, BackendError> {
    let (scene, frame) = (SceneBuffers::default(), Frame::default());
    Resident::new(device, commands, transfers, &scene, &frame, Features::default())
}

/// The kernels that prepare prisms in their order, each with the items that it runs over.
fn preparation(resident: &Resident) -> Vec<(Kernel, Range<u32>)> {
    let [micro_vertices, micro_triangles] = resident.stored();
    let mut kernels = vec![
        (Kernel::BoundHeights, 0..resident.triangles()),
        (Kernel::DecideSeams, 0..resident.seams()),
        (Kernel::PrismBounds, 0..resident.triangles()),
        (Kernel::Tessellate, 0..micro_vertices),
        (Kernel::TessellateBounds, 0..micro_triangles),
    ];
    for &map in resident.stale_distances() {
        kernels.push((Kernel::DistanceColumns, map * COLUMNS..(map + 1) * COLUMNS));
        kernels.push((Kernel::DistanceMap, map * CELLS..(map + 1) * CELLS));
    }
    kernels
}

/// The kernels that store a tree.
const TREE_KERNELS: [Kernel; 5] = [
    Kernel::TreeMicroVertices,
    Kernel::TreeFrames,
    Kernel::TreeBlocks,
    Kernel::TreeNodes,
    Kernel::TreeUpperNodes,
];

/// The first `count` boxes in a buffer.
fn read_boxes(
    commands: &Commands,
    transfers: &Transfers,
    boxes: &Buffer,
    count: usize,
) -> Result<Vec<Aabb>, BackendError> {
    let floats: Vec<[f32; 6]> = transfers.read(commands, boxes, count)?;
    let bounds = |[x, y, z, u, v, w]: [f32; 6]| Aabb { min: Vec3::new(x, y, z), max: Vec3::new(u, v, w) };
    Ok(floats.into_iter().map(bounds).collect())
}

/// Length of a slice that is known to be short, or is refused where it is not.
fn length<T>(slice: &[T]) -> u32 {
    u32::try_from(slice.len()).unwrap_or(u32::MAX)
}

/// Size of `count` words in bytes.
fn words(count: u32) -> usize {
    count as usize * size_of::<u32>()
}
