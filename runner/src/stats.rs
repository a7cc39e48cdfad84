//! What a rendering took, as `--stats` writes it.

use crate::backend::{
    Backend, BuildReport, PipelineCode, distance_maps, is_stored, stored_sizes, tree_primitives,
};
use crate::render::{Job, Rendering, Scene};
use crate::reports::Reports;
use crate::settings::{
    Bounds, DisplacementKind, Filter, Method, Normals, Settings, Shade, Subdivisions, Weld, Wrap,
};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::{BvhNode, FilmPixel, counter};
use emboss_kernels::relief::distance_map::WORDS;
use glam::UVec4;
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Statistics of a rendering. Times are in milliseconds, sizes in bytes.
#[derive(Clone, Debug, Serialize)]
pub struct Stats {
    /// Base triangles, those of a mesh that has instances once.
    pub triangles: u64,
    /// Places in which meshes stand; 0 where each triangle stands once, as it is.
    pub instances: u64,
    /// Micro-triangles of the surface: N² for each base triangle, in each of its places. None of them is stored, but by
    /// `--method tessellate`.
    pub micro_triangles: u64,
    /// The least N of a triangle.
    pub n_least: u32,
    /// The greatest N of a triangle.
    pub n_greatest: u32,
    /// Time from the height maps' pyramids over the boxes of the displaced triangles to the BVH over them.
    pub bvh_build_ms: f64,
    /// Time for all samples, without loading and without storing the picture.
    pub frame_ms: f64,
    /// The part of it that the device was at work on samples; null on the CPU backend.
    pub device_ms: Option<f64>,
    /// Primary and shadow rays.
    pub rays: u64,
    /// Rays divided by the frame's time.
    pub rays_per_second: f64,
    /// Pixels in which the model is hit: primary rays that hit, divided by samples of a pixel.
    pub pixels_hit: f64,
    /// Whether the rendering was stopped before its last sample.
    pub interrupted: bool,
    /// `vulkan` or `cpu`.
    pub backend: &'static str,
    /// The device's name.
    pub device: String,
    /// Memory of what the kernels read and write.
    pub bytes: Bytes,
    /// The code that the device got for this scene, counters included; null on the CPU backend, where all is in the
    /// program.
    pub pipelines: Option<Vec<PipelineCode>>,
    /// Work of all rays.
    pub work: Work,
    /// What was asked for.
    pub settings: SettingsUsed,
    /// What may surprise in the picture: nothing as long as it was not looked for.
    pub warnings: Reports,
}

/// Bytes of each kind of data.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Bytes {
    /// Corners of the base mesh, and their tangents.
    pub vertices: u64,
    /// Base triangles.
    pub triangles: u64,
    /// Nodes of the BVH, of instances those of all trees.
    pub nodes: u64,
    /// Order of the triangles, or of stored micro-triangles, in the BVH's leaves.
    pub primitives: u64,
    /// Micro-vertices, or what they follow from; 0 where none is stored.
    pub micro_vertices: u64,
    /// Stored bounds of the exact method; 0 where there are none.
    pub bounds: u64,
    /// Texels of the height maps.
    pub height_texels: u64,
    /// The height maps' min/max pyramids.
    pub height_ranges: u64,
    /// Distance maps; 0 where none is read.
    pub distances: u64,
    /// Boxes of triangles, or also of stored micro-triangles, from which the BVH is refitted.
    pub boxes: u64,
    /// Sizes of texels at vertices; 0 where no levels are read.
    pub texel_scales: u64,
    /// Maps of normals or of offsets; 0 where none is read.
    pub normal_texels: u64,
    /// Seams and their sides.
    pub seams: u64,
    /// Texels of the colour maps.
    pub color_texels: u64,
    /// What materials look like.
    pub materials: u64,
    /// Lights.
    pub lights: u64,
    /// Instances.
    pub instances: u64,
    /// Sums of samples.
    pub film: u64,
}

/// The work counters: see [`counter`].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Work {
    /// Primary rays.
    pub primary_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Primary rays that hit.
    pub hits: u64,
    /// Ray/box tests.
    pub boxes: u64,
    /// Prisms whose boxes rays entered.
    pub prisms: u64,
    /// Steps of grid walks: cells walked.
    pub steps: u64,
    /// Micro-triangles or base triangles tested.
    pub triangles: u64,
    /// Walks that met their cap on steps.
    pub cap_hits: u64,
    /// Walks that ended inside the grid because signs told no way on.
    pub lost_walks: u64,
    /// Sub-triangles of quadtrees tested.
    pub sub_triangles: u64,
}

/// The settings that decide how much work there is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SettingsUsed {
    /// Parts of each triangle's side, or how they were chosen.
    #[serde(rename = "N")]
    pub subdivisions: Subdivisions,
    /// The texel value of no displacement; null where materials differ.
    pub zero: Option<f32>,
    /// Height of a texel step from 0 to 1, in model units; null where materials differ.
    pub scale: Option<f32>,
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples of a pixel.
    pub samples: u32,
    /// Seed of the random numbers.
    pub seed: u32,
    /// How displaced triangles were intersected.
    pub method: Method,
    /// What texels displaced along.
    pub displacement: DisplacementKind,
    /// Along which direction heights are measured.
    pub normals: Normals,
    /// Whether neighbours that disagree meet without a crack.
    pub weld: Weld,
    /// How much memory stored bounds may take: `none`, `auto` or MiB.
    pub bounds: Bounds,
    /// What pixels show.
    pub shade: Shade,
    /// Whether light was reflected by the displaced surface's own normals.
    pub smooth: bool,
    /// Whether lights cast shadows.
    pub shadows: bool,
    /// How maps are read outside [0,1); null where they differ.
    pub wrap: Option<Wrap>,
    /// How colour maps were read.
    pub filter: Filter,
}

impl SettingsUsed {
    /// What was asked for: `zero`, `scale` and N as chosen, also where the method does not displace.
    pub fn new(settings: &Settings, samples: u32, scene: &Scene) -> SettingsUsed {
        #[expect(clippy::cast_possible_truncation, reason = "what it was before it was multiplied")]
        let in_world = |scale: f32| scene.mesh.space.world_length(scale.into()) as f32;
        let wraps = scene.reliefs.iter().map(|relief| relief.wrap);
        let wraps = wraps.chain(scene.materials.iter().map(|material| material.wrap));
        SettingsUsed {
            subdivisions: match settings.adaptive {
                Some(pixels) => Subdivisions::Auto { pixels },
                None => Subdivisions::Fixed(scene.subdivisions),
            },
            zero: agreed(scene.reliefs.iter().map(|relief| relief.zero)),
            scale: agreed(scene.reliefs.iter().map(|relief| in_world(relief.scale))),
            width: settings.width,
            height: settings.height,
            samples,
            seed: settings.seed,
            method: settings.method,
            displacement: settings.displacement,
            normals: settings.normals,
            weld: settings.weld,
            bounds: settings.bounds,
            shade: settings.shade,
            smooth: settings.smooth,
            shadows: settings.shadows,
            wrap: agreed(wraps.map(|wrap| wrap.unwrap_or(settings.wrap))),
            filter: settings.filter,
        }
    }
}

impl Stats {
    /// The statistics of a rendering whose work was counted ([`Settings::counting`]).
    pub fn new(job: &Job, rendering: &Rendering, backend: &dyn Backend, settings: SettingsUsed) -> Stats {
        let (build, device) = (backend.build_report(), backend.device());
        let pipelines = backend.pipelines();
        let work = Work::new(rendering);
        let rays = work.primary_rays + work.shadow_rays;
        let triangles = job.buffers.triangles.len() as u64;
        let cuts = job.cuts();
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        Stats {
            triangles,
            instances: job.buffers.instances.len() as u64,
            micro_triangles: cuts.micro_triangles,
            n_least: cuts.least,
            n_greatest: cuts.greatest,
            bvh_build_ms: milliseconds(build.duration),
            frame_ms: milliseconds(rendering.elapsed),
            device_ms: rendering.device_ms,
            rays,
            rays_per_second: ratio(rays as f64, rendering.elapsed.as_secs_f64()),
            pixels_hit: ratio(work.hits as f64 * pixels as f64, work.primary_rays as f64),
            interrupted: rendering.interrupted,
            backend: device.backend,
            device: device.name.clone(),
            bytes: Bytes::new(job, build),
            pipelines: (!pipelines.is_empty()).then_some(pipelines),
            work,
            settings,
            warnings: Reports::default(),
        }
    }

    /// Finds out whether they could be written, before the work that they are about.
    pub fn check(path: &Path) -> Result<(), StatsError> {
        check_file(path).map_err(|reason| StatsError { path: path.to_owned(), reason })
    }

    /// Writes them as JSON.
    pub fn write(&self, path: &Path) -> Result<(), StatsError> {
        write_json(path, self).map_err(|reason| StatsError { path: path.to_owned(), reason })
    }
}

/// Finds out whether a file could be written.
pub(crate) fn check_file(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    if folder.is_dir() && !path.is_dir() {
        return Ok(());
    }
    let reason = if path.is_dir() { "it is a folder" } else { "its folder does not exist" };
    Err(io::Error::other(reason))
}

/// Writes a file of JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> io::Result<()> {
    let mut json = serde_json::to_string_pretty(value)?;
    json.push('\n');
    std::fs::write(path, json)
}

/// The statistics could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: the statistics could not be written ({reason}); choose another --stats", path.display())]
pub struct StatsError {
    /// The file.
    pub path: PathBuf,
    /// What the system said.
    pub reason: io::Error,
}

impl Bytes {
    /// What a loaded job has in memory.
    pub(crate) fn new(job: &Job, build: BuildReport) -> Bytes {
        let buffers = &job.buffers;
        let micro_triangles =
            if is_stored(job.features) { tree_primitives(&job.frame, job.features) } else { 0 };
        let (floats, quarters) = stored_sizes(&job.frame, job.features, buffers.seams.len());
        let boxes = u64::from(job.frame.triangle_count) + u64::from(micro_triangles);
        Bytes {
            vertices: bytes(&buffers.vertices) + bytes(&buffers.tangents),
            triangles: bytes(&buffers.triangles),
            nodes: u64::from(build.nodes) * size_of::<BvhNode>() as u64,
            primitives: u64::from(tree_primitives(&job.frame, job.features)) * size_of::<u32>() as u64,
            micro_vertices: floats * size_of::<f32>() as u64,
            bounds: quarters * size_of::<UVec4>() as u64,
            height_texels: bytes(&buffers.height_texels),
            height_ranges: buffers.pyramid_words() * size_of::<u32>() as u64,
            distances: u64::from(distance_maps(buffers.displacements.len(), job.features))
                * u64::from(WORDS)
                * size_of::<f32>() as u64,
            boxes: boxes * size_of::<Aabb>() as u64,
            texel_scales: bytes(&buffers.texel_scales),
            normal_texels: bytes(&buffers.normal_texels),
            seams: bytes(&buffers.seams) + bytes(&buffers.seam_sides),
            color_texels: bytes(&buffers.color_texels),
            materials: bytes(&buffers.materials),
            lights: bytes(&buffers.lights),
            instances: bytes(&buffers.instances),
            film: u64::from(job.frame.width) * u64::from(job.frame.height) * size_of::<FilmPixel>() as u64,
        }
    }

    /// The BVH.
    pub(crate) fn bvh(&self) -> u64 {
        self.nodes + self.primitives
    }

    /// What is made of the height maps for rays to skip what they cannot meet: min/max pyramids, distance maps and
    /// stored bounds.
    pub(crate) fn trees(&self) -> u64 {
        self.height_ranges + self.distances + self.bounds
    }

    /// Height maps, and maps of normals or of offsets.
    pub(crate) fn maps(&self) -> u64 {
        self.height_texels + self.normal_texels
    }

    /// Everything but the film and the colour maps, which are the same whatever the method.
    pub(crate) fn without_pictures(&self) -> u64 {
        // Every field is named, so that none that comes later is forgotten.
        let Bytes {
            vertices,
            triangles,
            nodes,
            primitives,
            height_texels,
            height_ranges,
            seams,
            color_texels: _,
            materials,
            lights,
            instances,
            micro_vertices,
            bounds,
            distances,
            boxes,
            texel_scales,
            normal_texels,
            film: _,
        } = self;
        vertices
            + triangles
            + nodes
            + primitives
            + micro_vertices
            + bounds
            + distances
            + boxes
            + texel_scales
            + normal_texels
            + height_texels
            + height_ranges
            + seams
            + materials
            + lights
            + instances
    }
}

impl Work {
    fn new(rendering: &Rendering) -> Work {
        let total = |counter: u32| rendering.totals[counter as usize];
        Work {
            primary_rays: total(counter::PRIMARY_RAYS),
            shadow_rays: total(counter::SHADOW_RAYS),
            hits: total(counter::HITS),
            boxes: total(counter::BOXES),
            prisms: total(counter::PRISMS),
            steps: total(counter::CELLS),
            triangles: total(counter::TRIANGLES),
            cap_hits: total(counter::CAP_HITS),
            lost_walks: total(counter::LOST_WALKS),
            sub_triangles: total(counter::SUB_TRIANGLES),
        }
    }
}

fn bytes<T>(items: &[T]) -> u64 {
    size_of_val(items) as u64
}

/// The value that all are, where they are all the same.
pub(crate) fn agreed<T: PartialEq>(mut values: impl Iterator<Item = T>) -> Option<T> {
    let first = values.next()?;
    values.all(|value| value == first).then_some(first)
}

fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

/// `a / b`; 0 where nothing was done.
fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}
