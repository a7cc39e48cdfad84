//! From a scene and settings to a picture: buffers, what the backend makes of them, the view of that, samples one after
//! the other, and what it took.

use crate::backend::{Backend, BackendError, SceneBuffers, Totals};
use crate::bvh::HostAabb;
use crate::colors::Colors;
use crate::distance_files;
use crate::framing::{self, Framing, FramingError, View};
use crate::height_levels::texel_scales;
use crate::heights::{self, Heights, Reading};
use crate::instances::{self, Part};
use crate::normal_maps;
use crate::picture::Picture;
use crate::scene::seams::SeamTable;
use crate::scene::{Material, Mesh, Relief};
use crate::settings::{DisplacementKind, Filter, Light, Method, Settings, Weld, Wrap};
use crate::space::{RenderSpace, exponent_of};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::displacement::subdivisions::Viewpoint;
use emboss_kernels::interface::{FilmPixel, Frame, Instance, PointLight, Triangle, bounds, filter};
use emboss_kernels::prism_tree::layout::Layout;
use emboss_kernels::scene::Features;
use glam::{DAffine3, DVec3, Vec3, Vec4};
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A mesh with its maps, and how height maps displace it. All its lengths are in the units of its mesh: see
/// [`Mesh::space`].
#[derive(Clone, Debug)]
pub struct Scene {
    /// The base mesh.
    pub mesh: Mesh,
    /// Its height maps, at least one (of vectors three for each: see [`Settings::displacement`]); triangles name theirs
    /// in [`Triangle::displacement`].
    ///
    /// [`Triangle::displacement`]: emboss_kernels::interface::Triangle::displacement
    pub reliefs: Vec<Relief>,
    /// What its surfaces look like, at least one; triangles name theirs by [`Triangle::material`].
    ///
    /// [`Triangle::material`]: emboss_kernels::interface::Triangle::material
    pub materials: Vec<Material>,
    /// The meshes that the mesh is made of, where they have places of their own; else none: it stands as it is.
    pub parts: Vec<Part>,
    /// N: parts of each triangle's side, 1 to [`MAX_SUBDIVISIONS`](emboss_kernels::interface::MAX_SUBDIVISIONS). Where
    /// N is [adaptive](Settings::adaptive) the greatest, a power of two.
    pub subdivisions: u32,
}

/// A scene made ready for a backend.
#[derive(Clone, Debug)]
pub struct Job {
    /// What the kernels read, in render space. Lights are there once the view is [framed](Job::frame_view).
    pub buffers: SceneBuffers,
    /// The render space. Rays that a backend traces, and what they hit, are in it.
    pub space: RenderSpace,
    /// In which steps its origin follows the eye: see [`RenderSpace::moved_to`].
    pub view_step: f64,
    /// What all pixels share. The camera is there once the view is [framed](Job::frame_view).
    pub frame: Frame,
    /// Which code is needed.
    pub features: Features,
    /// What was asked of the view.
    pub view: View,
    /// The lights that were asked for; without any the camera has a key light.
    pub lights: Vec<Light>,
    /// [`Relief::stem`] of each displacement.
    pub stems: Vec<Option<PathBuf>>,
    /// [`Relief::name`] of each displacement.
    pub names: Vec<Option<String>>,
}

impl Job {
    /// Places the camera and the lights for the displaced model, whose prisms lie in `boxes`, of instances in their own
    /// spaces. Returns where the camera is.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] where the model is too large or too small, [`RenderError::Framing`] where there is
    /// no camera as asked for.
    pub fn frame_view(&mut self, boxes: &[Aabb]) -> Result<Framing, RenderError> {
        let mut boxes = Cow::Borrowed(boxes);
        if !self.buffers.instances.is_empty() {
            let instances = &self.buffers.instances;
            // A mesh with places has its own space.
            let own = RenderSpace { origin: DVec3::ZERO, ..self.space };
            for mesh in instances::meshes(instances) {
                check_extent(instances::boxes_of(mesh, &boxes), &own)?;
            }
            boxes = Cow::Owned(instances::world_boxes(instances, &boxes));
        }
        check_extent(&boxes, &self.space)?;
        let aspect = f64::from(self.frame.width) / f64::from(self.frame.height);
        let framing = framing::frame(&self.view, &boxes, aspect, &self.space)?;
        self.buffers.lights = point_lights(&self.lights, &framing);
        (self.frame.camera, self.frame.light_count) = (framing.camera, count(self.buffers.lights.len()));
        Ok(framing)
    }
}

/// How finely the base triangles of a picture are cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cuts {
    /// The least N of a triangle.
    pub least: u32,
    /// The greatest.
    pub greatest: u32,
    /// N² of each triangle, summed.
    pub micro_triangles: u64,
}

impl Job {
    /// How finely the triangles are cut, of each instance for itself, seen by the job's camera. Of no triangles N is
    /// the greatest.
    pub fn cuts(&self) -> Cuts {
        let viewpoint = Viewpoint::new(&self.frame);
        let SceneBuffers { triangles, vertices, instances, .. } = &self.buffers;
        let n_of = |viewpoint: &Viewpoint, triangle: &Triangle| {
            if self.features.adaptive == 0 {
                return self.frame.subdivisions;
            }
            let [a, b, c] = triangle.vertices.map(|v| vertices[v as usize].position);
            viewpoint.subdivisions(a, b, c).triangle
        };
        let none = Cuts { least: u32::MAX, greatest: 0, micro_triangles: 0 };
        let add = |cuts: Cuts, n: u32| Cuts {
            least: cuts.least.min(n),
            greatest: cuts.greatest.max(n),
            micro_triangles: cuts.micro_triangles + u64::from(n).pow(2),
        };
        let cuts = if instances.is_empty() {
            triangles.iter().map(|triangle| n_of(&viewpoint, triangle)).fold(none, add)
        } else {
            let of_instance = |instance: &Instance| {
                let viewpoint = viewpoint.within(instance);
                let first = instance.first_triangle as usize;
                let mesh = &triangles[first..first + instance.triangle_count as usize];
                mesh.iter().map(move |triangle| n_of(&viewpoint, triangle))
            };
            instances.iter().flat_map(of_instance).fold(none, add)
        };
        let most = self.frame.subdivisions;
        Cuts {
            least: cuts.least.min(most),
            greatest: if cuts.greatest == 0 { most } else { cuts.greatest },
            ..cuts
        }
    }
}

/// What comes of a job.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The mean of the samples so far.
    pub picture: Picture,
    /// The work it took.
    pub totals: Totals,
    /// The time from the first sample to the last.
    pub elapsed: Duration,
    /// The part of it that the device was at work, in milliseconds; `None` on the CPU.
    pub device_ms: Option<f64>,
    /// Whether it was stopped before the last sample was complete.
    pub interrupted: bool,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// No camera.
    #[error(transparent)]
    Framing(#[from] FramingError),
    /// The film is larger than this machine's memory.
    #[error(
        "a picture of {width}x{height} needs {needed} MiB, but only {available} MiB of memory are free; choose a \
            smaller --size"
    )]
    Memory {
        /// Pixels of a row.
        width: u32,
        /// Rows.
        height: u32,
        /// What is needed, in MiB.
        needed: u64,
        /// What is there, in MiB.
        available: u64,
    },
    /// The model is out of the range that distances, areas and volumes are computed in.
    #[error(
        "the displaced model reaches from {min} to {max}, but floats compute with sizes between {SMALLEST:e} and \
            {LARGEST:e}, of which relief and instances reach up to {LARGEST:e} times that of the mesh; scale the \
            model, or change SCALE"
    )]
    OutOfRange {
        /// Lower corner of its box, in world units.
        min: DVec3,
        /// Upper corner.
        max: DVec3,
    },
    /// A height map's texels are too large to be filtered.
    #[error(
        "a height map has texels from {min:e} to {max:e}, but floats filter texels up to {LARGEST_TEXEL:e}; scale the \
            map down, and SCALE up"
    )]
    TexelsTooLarge {
        /// The least texel.
        min: f32,
        /// The greatest.
        max: f32,
    },
    /// All height maps, or all colour maps, are more than kernels can number.
    #[error(
        "the maps take {words} words together, but kernels number {} of them; scale them down, or use fewer",
        u32::MAX
    )]
    MapsTooLarge {
        /// Words of 32 bits.
        words: u64,
    },
    /// A part has a place that floats cannot compute with.
    #[error(
        "a transform of part {part} takes directions to nothing, to infinity or almost to each other; change it"
    )]
    Transform {
        /// Which part.
        part: usize,
    },
    /// A method takes heights alone.
    #[error(
        "--method {method} takes heights along normals, but vectors displace anywhere; use --method quadtree"
    )]
    MethodOfVectors {
        /// Which one.
        method: Method,
    },
    /// A method takes one N.
    #[error(
        "--method {method} takes one N for all triangles, but N is auto; use --method quadtree, or a number for N"
    )]
    MethodOfAuto {
        /// Which one.
        method: Method,
    },
    /// Micro-triangles are stored for one view and one place.
    #[error("--method tessellate stores micro-triangles once, but {what}; use --method quadtree")]
    StoredOnce {
        /// What asks for more.
        what: &'static str,
    },
    /// The backend failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

/// Refuses what asks for more than one stored surface.
fn check_stored(settings: &Settings, instances: &[Instance]) -> Result<(), RenderError> {
    let what = if !settings.method.is_stored() {
        return Ok(());
    } else if settings.filter == Filter::Trilinear {
        "with --filter trilinear heights follow the camera"
    } else if !instances.is_empty() {
        "instances have a place each"
    } else {
        return Ok(());
    };
    Err(RenderError::StoredOnce { what })
}

/// Finds out whether a picture fits in memory, before anything is computed for it. Where the system does not tell
/// how much is free, the backend's allocation decides.
pub fn check_memory(settings: &Settings) -> Result<(), RenderError> {
    const MIB: u64 = 1 << 20;
    // The film, the resolved picture, and its quantised copy of at most 16 bits a channel.
    let per_pixel = size_of::<FilmPixel>() + size_of::<Vec4>() + size_of::<[u16; 4]>();
    let needed = settings.pixels().saturating_mul(per_pixel as u64);
    match available_memory() {
        Some(available) if needed > available => Err(RenderError::Memory {
            width: settings.width,
            height: settings.height,
            needed: needed.div_ceil(MIB),
            available: available / MIB,
        }),
        _ => Ok(()),
    }
}

/// Bytes of memory that can be had without swapping, where the system tells it in a file.
fn available_memory() -> Option<u64> {
    let meminfo = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Makes a scene ready to be [loaded](load): finds its tangents, where vectors are along them, and its seams, and packs
/// its maps.
pub fn prepare(scene: Scene, settings: &Settings) -> Result<Job, RenderError> {
    let Scene { mut mesh, reliefs, materials, mut parts, subdivisions } = scene;
    let view_step = view_step(&mesh, &parts);
    let space = settings.view.eye.map_or(mesh.space, |eye| mesh.space.moved_to(eye, view_step));
    let shift = (space.origin - mesh.space.origin) * space.scale();
    parts.iter_mut().flat_map(|part| &mut part.places).for_each(|place| place.translation -= shift);
    mesh.with_whole_coordinates(|triangle| reads_clamped(triangle, settings, &reliefs, &materials));
    let instances = instances::instances(&parts).map_err(|part| RenderError::Transform { part })?;
    let method = settings.method;
    if settings.displacement != DisplacementKind::Height && !method.takes_vectors() {
        return Err(RenderError::MethodOfVectors { method });
    }
    if settings.adaptive.is_some() && !method.takes_any_scene() {
        return Err(RenderError::MethodOfAuto { method });
    }
    check_stored(settings, &instances)?;
    check_texels(&reliefs)?;
    let normal_texels = normal_maps::pack(settings, &mesh, &reliefs)?;
    let along_tangents =
        settings.displacement == DisplacementKind::Tangent || normal_maps::needs_tangents(settings, &reliefs);
    let tangents = if along_tangents { mesh.split_by_tangents() } else { Vec::new() };
    let seams = match settings.weld {
        // Nothing that methods in image space do needs them.
        Weld::On if settings.boxes() != 1 => SeamTable::find(&mut mesh, settings.displacement),
        Weld::On | Weld::Off => SeamTable::default(),
    };
    let reading = Reading { displaced: settings.displaces(), wrap: settings.wrap, filter: settings.filter };
    let stems = reliefs.iter().map(|relief| relief.stem.clone()).collect();
    let names = reliefs.iter().map(|relief| relief.name.clone()).collect();
    let heights = Heights::pack(reliefs, reading)?;
    let texel_scales = match settings.filter {
        Filter::Bilinear => Vec::new(),
        Filter::Trilinear => texel_scales(&mesh, &heights),
    };
    let colors = Colors::pack(materials, settings.wrap, settings.filter)?;
    let features = Features {
        method: settings.method.id(),
        shade: settings.shade.id(),
        shadows: u32::from(settings.shadows),
        height_format: heights.format,
        color_format: colors.format,
        height_wrap: heights.wrap,
        color_wrap: colors.wrap,
        counters: u32::from(settings.counting),
        normals: settings.normals.id(),
        seams: u32::from(!seams.seams.is_empty()),
        smooth: u32::from(settings.smooth),
        displacement: settings.displacement.id(),
        filter: settings.filter.id(),
        adaptive: u32::from(settings.adaptive.is_some()),
        instances: u32::from(!instances.is_empty()),
        bounds: bounds::NONE,
    };
    let features =
        Features { bounds: stored_bounds(settings, &mesh, &seams, subdivisions, features), ..features };
    let detail = |pixels| framing::detail(&settings.view, settings.width, settings.height, pixels);
    let (height_min, height_max) = heights::range(&heights.displacements, features);
    let frame = Frame {
        width: settings.width,
        height: settings.height,
        seed: settings.seed,
        ambient: settings.ambient,
        background: settings.background.unwrap_or(Vec3::ZERO),
        background_alpha: if settings.background.is_some() { 1.0 } else { 0.0 },
        triangle_count: count(mesh.triangles.len()),
        steps_scale: settings.method.many_steps(subdivisions),
        subdivisions,
        height_min,
        height_max,
        detail: settings.adaptive.map_or(0.0, detail),
        ..Frame::default()
    };
    let buffers = SceneBuffers {
        vertices: mesh.vertices,
        tangents,
        texel_scales,
        triangles: mesh.triangles,
        displacements: heights.displacements,
        height_texels: heights.texels,
        seams: seams.seams,
        seam_sides: seams.sides,
        color_texels: colors.texels,
        materials: colors.materials,
        normal_texels,
        instances,
        ..SceneBuffers::default()
    };
    let (view, lights) = (settings.view, settings.lights.clone());
    Ok(Job { buffers, space, view_step, frame, features, view, lights, stems, names })
}

/// What of the bounds fits into the memory that they may take: see [`bounds`]. Scenes whose surface follows the view,
/// and instances, have none.
fn stored_bounds(
    settings: &Settings,
    mesh: &Mesh,
    seams: &SeamTable,
    subdivisions: u32,
    features: Features,
) -> u32 {
    let is_fixed = features.filter == filter::BILINEAR && features.adaptive == 0 && features.instances == 0;
    if settings.method != Method::Quadtree || !is_fixed {
        return bounds::NONE;
    }
    let layout = Layout::new(count(mesh.triangles.len()), subdivisions);
    let fits = |stored| {
        let floats = layout.floats(count(seams.seams.len()), Features { bounds: stored, ..features });
        let quarters = layout.quarters();
        let bytes = floats.saturating_mul(4).saturating_add(quarters.saturating_mul(16));
        bytes <= settings.bounds.bytes() && floats.max(quarters) <= u32::MAX.into()
    };
    let largest = [bounds::ALL, bounds::BOXES].into_iter().find(|&stored| fits(stored));
    largest.unwrap_or(bounds::NONE)
}

/// Loads a job, and looks at what the backend makes of it as was asked for: then the job has its camera and lights.
pub fn load(backend: &mut dyn Backend, job: &mut Job) -> Result<(), RenderError> {
    distance_files::load(backend, job)?;
    job.frame_view(&backend.prism_boxes()?)?;
    backend.set_view(&job.frame, &job.buffers.lights)?;
    Ok(())
}

/// A length as kernels read it; meshes have 32-bit indices.
fn count(len: usize) -> u32 {
    u32::try_from(len).unwrap_or(u32::MAX)
}

/// Takes `samples` samples of every pixel of a loaded job. Calls `progress` with the share done (0 to 1) between parts;
/// `Break` ends the rendering, and the picture is what there is by then.
pub fn render(
    backend: &mut dyn Backend,
    job: &Job,
    samples: u32,
    progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
) -> Result<Rendering, BackendError> {
    let start = Instant::now();
    let mut flow = ControlFlow::Continue(());
    for sample in 0..samples {
        let share = |pass: f32| (sample as f32 + pass) / samples as f32;
        flow = backend.add_sample(sample, &mut |pass| progress(share(pass)))?;
        if flow.is_break() {
            break;
        }
    }
    let elapsed = start.elapsed();
    let picture = Picture { width: job.frame.width, height: job.frame.height, pixels: backend.resolve()? };
    let (totals, device_ms) = (backend.totals()?, backend.device_ms());
    Ok(Rendering { picture, totals, elapsed, device_ms, interrupted: flow.is_break() })
}

/// In which steps the origin of a scene's render space follows the eye ([`RenderSpace::moved_to`]): [`ROOM`] times the
/// size of its smallest part, in render space. A scene without parts has no steps: infinity.
///
/// So a part that is small in its scene has all its digits where it is seen from near, and a camera that flies round it
/// finds it where it was.
fn view_step(mesh: &Mesh, parts: &[Part]) -> f64 {
    let mut rest = &mesh.triangles[..];
    let mut least = f64::INFINITY;
    for part in parts {
        let triangles;
        (triangles, rest) = rest.split_at((part.triangle_count as usize).min(rest.len()));
        let positions = triangles.iter().flat_map(|t| t.vertices).map(|v| mesh.vertices[v as usize].position);
        let reach = positions.fold(0.0_f32, |reach, p| reach.max(p.abs().max_element()));
        for DAffine3 { matrix3, .. } in &part.places {
            let lengths = [matrix3.x_axis, matrix3.y_axis, matrix3.z_axis].map(DVec3::length);
            least = lengths.into_iter().map(|length| f64::from(reach) * length).fold(least, f64::min);
        }
    }
    if least.is_normal() { ROOM * 2_f64.powi(exponent_of(least)) } else { f64::INFINITY }
}

/// See [`view_step`]: where the eye is half a step away, coordinates are 2^-12 of the smallest part apart. Less would
/// have the viewer load a meadow of many small parts anew more often.
const ROOM: f64 = 4096.0;

/// Whether a map that a triangle reads does not go on beyond its borders as it is within them.
fn reads_clamped(
    triangle: &Triangle,
    settings: &Settings,
    reliefs: &[Relief],
    materials: &[Material],
) -> bool {
    let count = if settings.displacement == DisplacementKind::Height { 1 } else { 3 };
    let reliefs = reliefs.iter().skip(triangle.displacement as usize).take(count);
    let of_relief = |relief: &Relief| [Some(relief.wrap), relief.normal_map.as_ref().map(|map| map.wrap)];
    let own = reliefs.flat_map(of_relief).flatten();
    let of_material = materials.get(triangle.material() as usize).map(|material| material.wrap);
    own.chain(of_material).any(|wrap| wrap.unwrap_or(settings.wrap) == Wrap::Clamp)
}

/// Models are refused that are larger than this in world units, or whose relief or places reach farther than this in
/// render space: kernels multiply three lengths, and 1e12 cubed is within a float's range.
const LARGEST: f32 = 1e12;
/// Models smaller than this are refused, in world units: what is reported of them in these is a float.
const SMALLEST: f32 = 1e-12;

/// Refuses a model that is too large or too small to compute with; its boxes are in the render space. One without
/// triangles is fine: it shows nothing.
fn check_extent(boxes: &[Aabb], space: &RenderSpace) -> Result<(), RenderError> {
    let Some(whole) = boxes.iter().copied().reduce(Aabb::union) else { return Ok(()) };
    let reach = whole.min.abs().max(whole.max.abs()).max_element();
    let size = space.world_length(f64::from((whole.max - whole.min).max_element()));
    let fits = (f64::from(SMALLEST)..=2.0 * f64::from(LARGEST)).contains(&size);
    if reach <= LARGEST && fits {
        return Ok(());
    }
    let [min, max] = [whole.min, whole.max].map(|corner| space.world(corner.as_dvec3()));
    Err(RenderError::OutOfRange { min, max })
}

/// Texels beyond this are refused: a filter takes the differences of texels, whose products and sums are thus within
/// a float's range.
const LARGEST_TEXEL: f32 = 1e30;

/// Refuses maps whose heights could not be computed.
fn check_texels(reliefs: &[Relief]) -> Result<(), RenderError> {
    for relief in reliefs {
        let (min, max) = relief.map.range;
        if min < -LARGEST_TEXEL || max > LARGEST_TEXEL {
            return Err(RenderError::TexelsTooLarge { min, max });
        }
    }
    Ok(())
}

/// The lights as the kernels read them, in render space.
fn point_lights(lights: &[Light], framing: &Framing) -> Vec<PointLight> {
    if lights.is_empty() {
        return vec![framing::key_light(framing)];
    }
    let space = &framing.space;
    let point_light = |light: &Light| {
        let position = space.point(light.position).as_vec3();
        let usual = || framing::intensity_for(position, framing.target);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "rounded, at the ends of the range of floats alone"
        )]
        let given = |intensity: f32| space.intensity(intensity.into()) as f32;
        PointLight {
            position,
            color: light.color,
            intensity: light.intensity.map_or_else(usual, given),
            padding: 0,
        }
    };
    lights.iter().map(point_light).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::cpu::CpuBackend;
    use crate::scene::builtin;
    use emboss_kernels::interface::{counter, height_format};
    use std::sync::Arc;

    fn quilt() -> Scene {
        let builtin = builtin::load("builtin:quilt").expect("built in");
        Scene {
            mesh: builtin.mesh,
            reliefs: vec![Relief::new(builtin.height, builtin.zero, builtin.scale)],
            materials: vec![builtin.color.into()],
            parts: vec![],
            subdivisions: 4,
        }
    }

    fn small() -> Settings {
        Settings { width: 24, height: 16, counting: true, ..Settings::default() }
    }

    /// The quilt, loaded.
    fn loaded(settings: &Settings) -> (CpuBackend, Job) {
        let (mut backend, mut job) = (CpuBackend::new(), prepare(quilt(), settings).expect("sound maps"));
        load(&mut backend, &mut job).expect("framed");
        (backend, job)
    }

    fn rendered(settings: &Settings, samples: u32) -> Rendering {
        let (mut backend, job) = loaded(settings);
        render(&mut backend, &job, samples, &mut |_| ControlFlow::Continue(())).expect("fits")
    }

    #[test]
    fn without_displacement_boxes_are_flat() {
        let (flat, job) = loaded(&Settings { method: Method::None, ..small() });
        let (displaced, _) = loaded(&small());
        let volume = |backend: &CpuBackend| {
            let bounds = backend.scene().bvh().bounds();
            (bounds.max - bounds.min).element_product()
        };
        assert!(volume(&flat) < 0.01 * volume(&displaced));
        assert_eq!(job.buffers.displacements[0].scale, 0.0);
    }

    #[test]
    fn the_model_is_in_the_middle_of_its_picture() {
        let picture = rendered(&small(), 1).picture;
        let alpha = |x: usize, y: usize| picture.pixels[y * 24 + x].w;
        assert_eq!((alpha(12, 8), alpha(0, 0), alpha(23, 0)), (1.0, 0.0, 0.0));
        // It touches neither the left nor the lower edge.
        assert!((0..16).all(|y| alpha(0, y) == 0.0) && (0..24).all(|x| alpha(x, 15) == 0.0));
    }

    /// However little their scale makes of them.
    #[test]
    fn texels_that_no_filter_can_take_are_refused() {
        let with_texel = |texel: f32| {
            let mut scene = quilt();
            scene.reliefs[0].scale = 1e-38;
            let texels = vec![texel.to_bits(), (-texel).to_bits()];
            let map = Arc::make_mut(&mut scene.reliefs[0].map);
            (map.width, map.height, map.format) = (2, 1, height_format::FLOAT32);
            (map.texels, map.range) = (texels, (-texel, texel));
            prepare(scene, &small())
        };
        assert!(with_texel(1e30).is_ok());
        let error = with_texel(3e38).expect_err("its differences are infinite").to_string();
        assert!(error.contains("floats filter texels up to 1e30"), "{error}");
    }

    #[test]
    fn each_sample_is_a_ray_for_each_pixel() {
        let rendering = rendered(&small(), 3);
        assert_eq!(rendering.totals[counter::PRIMARY_RAYS as usize], 24 * 16 * 3);
        assert!(!rendering.interrupted);
    }

    #[test]
    fn progress_runs_from_sample_to_sample() {
        let (mut backend, job) = loaded(&small());
        let mut shares = Vec::new();
        let rendering = render(&mut backend, &job, 4, &mut |share| {
            shares.push(share);
            if share < 0.5 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })
        .expect("fits");
        // While a tile takes long the same share is told again, so that Ctrl-C is heard.
        shares.dedup();
        shares.retain(|share| *share > 0.0);
        assert_eq!(shares, [0.25, 0.5]);
        assert!(rendering.interrupted);
        assert_eq!(rendering.totals[counter::PRIMARY_RAYS as usize], 24 * 16 * 2);
    }

    #[test]
    fn lights_are_the_users_or_the_key_light() {
        let (_, job) = loaded(&small());
        assert_eq!(job.frame.light_count, 1);
        let light = Light { position: DVec3::splat(9.0), color: Vec3::X, intensity: None };
        let lights = vec![light, Light { intensity: Some(2.0), ..light }];
        let (_, job) = loaded(&Settings { lights, ..small() });
        assert_eq!(job.frame.light_count, 2);
        assert!(job.buffers.lights[0].intensity > 2.0);
        assert_eq!(job.buffers.lights[1].intensity, 2.0);
    }

    #[test]
    fn a_background_fills_what_is_not_hit() {
        let red = rendered(&Settings { background: Some(Vec3::X), ..small() }, 1);
        assert_eq!(red.picture.pixels[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
    }

    #[test]
    fn pictures_beyond_memory_are_refused_at_once() {
        let huge = Settings { width: u32::MAX, height: u32::MAX, ..small() };
        let error = check_memory(&huge);
        // Systems that do not tell their memory leave it to the allocation.
        assert!(available_memory().is_none() || matches!(error, Err(RenderError::Memory { .. })));
        assert!(check_memory(&small()).is_ok());
    }
}
