//! Who runs the kernels: the CPU or a Vulkan device, behind one trait.

pub mod cpu;
pub mod host_scene;
pub mod select;
pub mod vulkan;

use crate::bvh::Bvh;
use crate::heights;
use crate::instances;
use crate::scene::mip_levels;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::displacement::height_pyramid::{MAX_MAP_SIDE, pyramid_words};
use emboss_kernels::displacement::tessellate;
use emboss_kernels::interface::{
    Displacement, Frame, Instance, Intersection, MAX_PRIMITIVES, MAX_SUBDIVISIONS, Material, NO_SEAMS,
    PointLight, Ray, SeamSide, Seams, Tangent, TexelScale, Triangle, Vertex, bounds, color_format, counter,
    displacement_kind, filter, height_format, method, normal_space, shade, wrap,
};
use emboss_kernels::prism_tree::layout::Layout;
use emboss_kernels::relief::distance_map::{WORDS, is_turned};
use emboss_kernels::relief::normal_texels::HEADER_WORDS;
use emboss_kernels::scene::Features;
use glam::Vec4;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::Duration;

/// A scene in the layout in which kernels read it. Empty buffers are allowed. What follows from these (pyramids, the
/// heights of triangles and seams, boxes, the BVH) each backend computes itself.
#[derive(Clone, Debug, Default)]
pub struct SceneBuffers {
    /// Corners of the base mesh.
    pub vertices: Vec<Vertex>,
    /// Their tangents, where vector displacement is along these.
    pub tangents: Vec<Tangent>,
    /// How large texels are at them, where maps are filtered by their levels.
    pub texel_scales: Vec<TexelScale>,
    /// Base triangles; their heights are not read.
    pub triangles: Vec<Triangle>,
    /// How the height maps displace, their pyramids one behind the other. Those of one image with one wrap may share a
    /// pyramid.
    pub displacements: Vec<Displacement>,
    /// Packed height maps.
    pub height_texels: Vec<u32>,
    /// Where neighbours disagree; their heights are not read.
    pub seams: Vec<Seams>,
    /// The sides of seams, and the readings of decided corners.
    pub seam_sides: Vec<SeamSide>,
    /// Packed colour maps.
    pub color_texels: Vec<u32>,
    /// What surfaces look like.
    pub materials: Vec<Material>,
    /// Lights.
    pub lights: Vec<PointLight>,
    /// Maps of normals or of offsets, where the method reads them: see
    /// [`normal_texels`](emboss_kernels::relief::normal_texels).
    pub normal_texels: Vec<u32>,
    /// The distance map of each displacement that is known already, [`WORDS`] floats; what is not is computed where
    /// the method reads it.
    pub distances: Vec<Option<Vec<f32>>>,
    /// Where meshes stand; none where each triangle stands once, as it is. See [`instances`].
    pub instances: Vec<Instance>,
}

impl SceneBuffers {
    /// Words of the pyramids of all maps, one behind the other.
    pub fn pyramid_words(&self) -> u64 {
        let words = |map: &Displacement| pyramid_words(map.format, map.map_width, map.map_height);
        heights::pyramids(&self.displacements).map(|(_, map)| u64::from(words(map))).sum()
    }

    /// Whether there is a whole map of normals or of offsets for each displacement.
    fn own_map_is_sound(&self) -> bool {
        let words = self.normal_texels.len() as u64;
        let headers = self.normal_texels.chunks_exact(HEADER_WORDS as usize).take(self.displacements.len());
        let is_sound = |header: &[u32]| {
            let [first, width, height, wrap] = [header[0], header[1], header[2], header[3]].map(u64::from);
            width > 0
                && height > 0
                && wrap < u64::from(wrap::PER_MAP)
                && width
                    .checked_mul(height)
                    .and_then(|texels| texels.checked_mul(2)?.checked_add(first))
                    .is_some_and(|end| end <= words.min(u32::MAX.into()))
        };
        headers.len() == self.displacements.len() && headers.into_iter().all(is_sound)
    }

    /// Whether the tangents of vertices are read with them.
    fn normals_are_along_tangents(&self) -> bool {
        let mut headers =
            self.normal_texels.chunks_exact(HEADER_WORDS as usize).take(self.displacements.len());
        headers.any(|header| header[HEADER_WORDS as usize - 1] == normal_space::TANGENT)
    }

    /// Checks every index that kernels follow without looking: a device build reads beyond a buffer without a word.
    /// What a kernel reads on the strength of `frame` and `features` is checked with them.
    pub fn check(&self, frame: &Frame, features: Features) -> Result<(), BackendError> {
        if self.triangles.len() > MAX_PRIMITIVES as usize {
            return Err(BackendError::TooManyTriangles { count: self.triangles.len() });
        }
        if self.instances.len() > MAX_PRIMITIVES as usize {
            return Err(BackendError::TooManyInstances { count: self.instances.len() });
        }
        check_micro_triangles(frame, features)?;
        if u64::from(distance_maps(self.displacements.len(), features)) * u64::from(WORDS) > u32::MAX.into() {
            return Err(BackendError::TooManyDistanceMaps { count: self.displacements.len() });
        }
        let is_whole = |map: &Option<Vec<f32>>| map.as_ref().is_none_or(|map| map.len() == WORDS as usize);
        let below = |indices: &[u32], length: usize| indices.iter().all(|&i| (i as usize) < length);
        let filtered = features.filter != filter::BILINEAR;
        let texels = |width: u32, height: u32, levels: bool| {
            if levels { mip_levels::texels(width, height) } else { u64::from(width) * u64::from(height) }
        };
        let texel_words = |map: &Displacement| {
            // Where no method displaces levels are not read.
            let levels = filtered && displaces(features);
            let texels = texels(map.map_width, map.map_height, levels);
            match map.format {
                height_format::UNORM8 => texels.div_ceil(4),
                height_format::UNORM16 => texels.div_ceil(2),
                _ => texels,
            }
        };
        let height_is_known = |map: &Displacement| {
            map.format < height_format::PER_MAP
                && map.wrap < wrap::PER_MAP
                && map.known_format(features.height_format) == map.format
                && map.known_wrap(features.height_wrap) == map.wrap
        };
        let within = |first: u32, words: u64, length: usize| u64::from(first) + words <= length as u64;
        let map_is_sound = |map: &Displacement| {
            let words = texel_words(map);
            map.map_width > 0
                && map.map_height > 0
                && map.map_width.max(map.map_height) <= MAX_MAP_SIDE
                && texels(map.map_width, map.map_height, filtered) <= u32::MAX.into()
                && map.roughness.is_finite()
                && map.roughness >= 0.0
                && within(map.first_word, words, self.height_texels.len())
        };
        // Those of sound maps.
        let pyramids_are_in_line = || {
            let mut next = 0;
            let place = |map: &Displacement| (map_of(map), map.first_range);
            self.displacements.iter().enumerate().all(|(i, map)| {
                if u64::from(map.first_range) == next {
                    next += u64::from(pyramid_words(map.format, map.map_width, map.map_height));
                    next <= u32::MAX.into()
                } else {
                    self.displacements[..i].iter().any(|other| place(other) == place(map))
                }
            })
        };
        let seams_are_sound = |seams: &Seams| {
            let are_there = |flag: u32, first: u32, count: u32| {
                within(first, count.into(), self.seam_sides.len())
                    && (seams.flags >> flag & 1 == 0 || count > 0)
            };
            (0..)
                .zip(seams.first_reading)
                .zip(seams.reading_count)
                .all(|((e, first), n)| are_there(e, first, n))
                && (3..)
                    .zip(seams.first_side)
                    .zip(seams.side_count)
                    .all(|((e, first), n)| are_there(e, first, n))
        };
        let vectors = features.displacement != displacement_kind::HEIGHT;
        let is_a_map = |displacement: u32| {
            let first = displacement as usize;
            match self.displacements.get(first..first + if vectors { 3 } else { 1 }) {
                Some([]) | None => false,
                Some([first, others @ ..]) => others
                    .iter()
                    .all(|map| (map.map_width, map.map_height) == (first.map_width, first.map_height)),
            }
        };
        let names_a_map = |triangle: &Triangle| is_a_map(triangle.displacement);
        let own_map_is_sound = || self.own_map_is_sound();
        let along_tangents = features.displacement == displacement_kind::TANGENT
            || features.method == method::NORMAL_MAP && self.normals_are_along_tangents();
        let has_tangents = !along_tangents || self.tangents.len() >= self.vertices.len();
        let has_texel_scales = !filtered
            || self.texel_scales.len() >= self.vertices.len()
                && self.texel_scales.iter().all(|scale| scale.size.is_finite() && scale.span >= 1.0);
        let names_seams = |t: &Triangle| t.seams == NO_SEAMS || (t.seams as usize) < self.seams.len();
        let names_a_material = |triangle: &Triangle| (triangle.material() as usize) < self.materials.len();
        let color_words = |map: &Material| {
            let texels = texels(map.color_width, map.color_height, filtered);
            match map.color_format {
                color_format::SRGB8 => texels.saturating_add(256),
                _ => texels.saturating_mul(3),
            }
        };
        let color_is_sound = |map: &Material| {
            map.color_format == color_format::NONE
                || map.color_width > 0
                    && map.color_height > 0
                    && within(
                        map.first_word,
                        color_words(map),
                        self.color_texels.len().min(u32::MAX as usize),
                    )
        };
        let color_is_known = |map: &Material| {
            let (format, wrap) = (features.color_format, features.color_wrap);
            map.color_format < color_format::PER_MATERIAL
                && map.color_wrap < wrap::PER_MAP
                && (format == color_format::PER_MATERIAL || format == map.color_format)
                && (wrap == wrap::PER_MAP || wrap == map.color_wrap || map.color_format == color_format::NONE)
        };
        let traced = frame.triangle_count > 0;
        let displaced = traced && displaces(features);
        let welded = traced && features.seams != 0;
        let adaptive = displaced && features.adaptive != 0;
        let what = if !self.triangles.iter().all(|t| below(&t.vertices, self.vertices.len())) {
            "a triangle names a vertex that is not there"
        } else if frame.triangle_count as usize > self.triangles.len() {
            "there are fewer triangles than the frame says"
        } else if frame.light_count as usize > self.lights.len() {
            FEWER_LIGHTS
        } else if (features.instances == 0) != self.instances.is_empty() {
            "there are instances, or none, other than the features say"
        } else if !instances::are_sound(&self.instances, frame.triangle_count) {
            "the instances' meshes do not lie one behind the other"
        } else if traced && !self.triangles.iter().all(names_a_map) {
            "a triangle names a height map that is not there"
        } else if traced && !self.displacements.iter().all(height_is_known) {
            "a height map is not stored, or not wrapped, as the features say"
        } else if traced && !self.displacements.iter().all(map_is_sound) {
            "the height map has fewer texels than its size says, or more along a side than 2^22"
        } else if traced && !pyramids_are_in_line() {
            "the height maps' pyramids do not lie one behind the other"
        } else if welded && !self.triangles.iter().all(names_seams) {
            "a triangle names seams that are not there"
        } else if welded && !self.seams.iter().all(seams_are_sound) {
            "a seam names sides that are not there"
        } else if !self.seam_sides.iter().all(|side| is_a_map(side.displacement)) {
            "a seam's side names a height map that is not there"
        } else if !self.seam_sides.iter().all(|side| below(&side.vertices, self.vertices.len())) {
            "a seam's side names a vertex that is not there"
        } else if vectors && !method::takes_vectors(features.method) {
            METHOD_OF_VECTORS
        } else if traced && method::has_own_map(features.method) && !own_map_is_sound() {
            "a map of normals or of offsets has fewer texels than its size says"
        } else if self.distances.len() > self.displacements.len() || !self.distances.iter().all(is_whole) {
            "a distance map has not its size, or is of no height map"
        } else if traced && !has_tangents {
            "there are fewer tangents than vertices"
        } else if traced && !has_texel_scales {
            "a vertex has no size of texels"
        } else if displaced && !(1..=MAX_SUBDIVISIONS).contains(&frame.subdivisions) {
            "N is not between 1 and the limit"
        } else if adaptive && !(frame.subdivisions.is_power_of_two() && frame.detail > 0.0) {
            "the greatest N is no power of two, or there is no detail that N follows"
        } else if adaptive && !method::takes_any_scene(features.method) {
            METHOD_OF_AUTO
        } else if is_stored(features) && (filtered || features.instances != 0) {
            "a tessellation is of one view and one place"
        } else if displaced && !bounds_fit(frame, features, self.seams.len()) {
            "bounds are stored of what depends on the view, of instances, or of more than kernels number"
        } else if traced && !self.triangles.iter().all(names_a_material) {
            "a triangle names a material that is not there"
        } else if traced && !self.materials.iter().all(color_is_known) {
            "a colour map is not stored, or not wrapped, as the features say"
        } else if traced && !self.materials.iter().all(color_is_sound) {
            "a colour map has fewer texels than its size says"
        } else {
            return Ok(());
        };
        Err(BackendError::Unsound { what })
    }
}

/// What is wrong with a frame that counts more lights than there are.
const FEWER_LIGHTS: &str = "there are fewer lights than the frame says";

/// Finds out whether there are as many lights as `frame` says.
fn check_lights(frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError> {
    if frame.light_count as usize > lights.len() {
        return Err(BackendError::Unsound { what: FEWER_LIGHTS });
    }
    Ok(())
}

/// What of a displacement is its map.
fn map_of(map: &Displacement) -> [u32; 5] {
    [map.map_width, map.map_height, map.first_word, map.format, map.wrap]
}

/// Finds out whether `new` differs from `loaded` in heights alone.
fn check_displacements(loaded: &[Displacement], new: &[Displacement]) -> Result<(), BackendError> {
    let map = |d: &Displacement| (map_of(d), d.first_range, d.roughness.to_bits());
    let is_sound = |d: &Displacement| {
        d.scale.is_finite() && d.zero.is_finite() && d.height_min.is_finite() && d.height_max.is_finite()
    };
    let what = if !loaded.iter().map(map).eq(new.iter().map(map)) {
        "the displacements are of other height maps than those loaded"
    } else if !new.iter().all(is_sound) {
        "a displacement is not finite"
    } else {
        return Ok(());
    };
    Err(BackendError::Unsound { what })
}

/// Finds out whether `new` differs from `loaded` in nothing that the scene was packed or built for.
fn check_features(loaded: Features, new: Features) -> Result<(), BackendError> {
    // Bounds are as they were stored: see `with_stored_bounds`.
    let Features { method, shade, shadows, smooth, counters, bounds, .. } = new;
    // Height maps are packed with their levels only where a method displaces. Boxes are those of the surface that rays
    // meet, and methods in image space have no seams.
    let lacks_levels = !displaces(loaded) && displaces(new) && loaded.filter != filter::BILINEAR;
    let lacks_map = method::has_own_map(method) && method != loaded.method;
    let other_boxes = method::boxes(loaded.method, loaded.shade) != method::boxes(method, shade);
    // Micro-triangles with their tree, or distance maps, are there or not.
    let lacks_store = is_stored(loaded) != is_stored(new) || has_distances(loaded) != has_distances(new);
    let what = if lacks_levels
        || lacks_map
        || other_boxes
        || lacks_store
        || (Features { method, shade, shadows, smooth, counters, bounds, ..loaded }) != new
    {
        "the features need another scene than the one loaded"
    } else if new.adaptive != 0 && !method::takes_any_scene(method) {
        METHOD_OF_AUTO
    } else if new.displacement != displacement_kind::HEIGHT && !method::takes_vectors(method) {
        METHOD_OF_VECTORS
    } else {
        return Ok(());
    };
    Err(BackendError::Unsound { what })
}

/// The features of other code for a scene with what is stored of its bounds.
fn with_stored_bounds(loaded: Features, new: Features) -> Features {
    Features { bounds: loaded.bounds, ..new }
}

/// Whether the method intersects a tessellation, which is stored.
pub(crate) fn is_stored(features: Features) -> bool {
    features.method == method::TESSELLATE
}

/// Whether the method reads distance maps.
fn has_distances(features: Features) -> bool {
    features.method == method::SPHERE
}

/// How many distance maps there are: one for each displacement.
pub(crate) fn distance_maps(displacements: usize, features: Features) -> u32 {
    if has_distances(features) { u32::try_from(displacements).unwrap_or(u32::MAX) } else { 0 }
}

/// The distance maps that have to be computed of a scene that is loaded.
fn unknown_distances(scene: &SceneBuffers, features: Features) -> Vec<u32> {
    let is_known = |&map: &u32| scene.distances.get(map as usize).is_some_and(Option::is_some);
    (0..distance_maps(scene.displacements.len(), features)).filter(|map| !is_known(map)).collect()
}

/// Those that have to be computed where heights change: they depend on the sign of the scale alone.
fn turned_distances(loaded: &[Displacement], new: &[Displacement], features: Features) -> Vec<u32> {
    let maps = distance_maps(loaded.len(), features);
    let turned = (0..maps).zip(loaded).zip(new).filter(|((_, old), new)| is_turned(old) != is_turned(new));
    turned.map(|((map, _), _)| map).collect()
}

/// How many primitives the tree of a scene without instances is over: triangles, or the micro-triangles of a
/// tessellation.
pub(crate) fn tree_primitives(frame: &Frame, features: Features) -> u32 {
    let n = if is_stored(features) { frame.subdivisions } else { 1 };
    // Checked to be few enough.
    frame.triangle_count.saturating_mul(n.saturating_mul(n))
}

/// How many micro-vertices a tessellation stores.
pub(crate) fn micro_vertices(frame: &Frame, features: Features) -> u32 {
    // N is checked only where something is traced.
    if is_stored(features) && frame.triangle_count > 0 {
        frame.triangle_count * tessellate::vertices_of(frame.subdivisions)
    } else {
        0
    }
}

/// Whether a [tree](emboss_kernels::prism_tree) is stored for the exact method.
pub(crate) fn has_tree(frame: &Frame, features: Features) -> bool {
    features.bounds != bounds::NONE && !is_stored(features) && frame.triangle_count > 0
}

/// How many floats of micro-vertices are stored, and how many quarters a stored tree has. `seams`: the entries of the
/// table of seams.
pub(crate) fn stored_sizes(frame: &Frame, features: Features, seams: usize) -> (u64, u64) {
    let layout = Layout::new(frame.triangle_count, frame.subdivisions);
    if is_stored(features) {
        (3 * u64::from(micro_vertices(frame, features)), 0)
    } else if has_tree(frame, features) {
        (layout.floats(u32::try_from(seams).unwrap_or(u32::MAX), features), layout.quarters())
    } else {
        (0, 0)
    }
}

/// Refuses a tessellation of more micro-triangles than a tree holds.
fn check_micro_triangles(frame: &Frame, features: Features) -> Result<(), BackendError> {
    let (triangles, subdivisions) = (frame.triangle_count, frame.subdivisions);
    let fits = |n: u32| u64::from(triangles) * u64::from(n).pow(2) <= MAX_PRIMITIVES.into();
    if !is_stored(features) || fits(subdivisions) {
        return Ok(());
    }
    let most = (1..=MAX_SUBDIVISIONS).take_while(|&n| fits(n)).last().unwrap_or(0);
    let count = u64::from(triangles) * u64::from(subdivisions).pow(2);
    Err(BackendError::TooManyMicroTriangles { triangles, subdivisions, count, most })
}

/// Whether a tree can be stored as the features say.
fn bounds_fit(frame: &Frame, features: Features, seams: usize) -> bool {
    let (floats, quarters) = stored_sizes(frame, features, seams);
    let is_of_one_view =
        features.filter == filter::BILINEAR && features.adaptive == 0 && features.instances == 0;
    features.bounds == bounds::NONE
        || features.bounds <= bounds::ALL && is_of_one_view && floats.max(quarters) <= u32::MAX.into()
}

/// Whether heights are read at all.
fn displaces(features: Features) -> bool {
    features.method != method::NONE || features.shade == shade::ERROR
}

/// What is wrong with most methods of vectors.
const METHOD_OF_VECTORS: &str = "the method takes no vectors";
/// What is wrong with them where triangles are cut differently.
const METHOD_OF_AUTO: &str = "the method takes one N";

/// The frame of the loaded scene in another view: what the scene itself decides stays.
fn with_view(loaded: &Frame, view: &Frame) -> Frame {
    Frame {
        triangle_count: loaded.triangle_count,
        subdivisions: loaded.subdivisions,
        height_min: loaded.height_min,
        height_max: loaded.height_max,
        ..*view
    }
}

/// The frame of the loaded scene with other heights.
fn with_displacements(loaded: &Frame, displacements: &[Displacement], features: Features) -> Frame {
    let (height_min, height_max) = heights::range(displacements, features);
    Frame { height_min, height_max, ..*loaded }
}

/// An empty vector with room for `len` items, or an error that names what it was for.
fn reserved<T>(name: &'static str, len: usize) -> Result<Vec<T>, BackendError> {
    let mut items = Vec::new();
    items.try_reserve_exact(len).map_err(|error| BackendError::Allocation {
        name,
        bytes: (len as u64).saturating_mul(size_of::<T>() as u64),
        reason: error.to_string(),
    })?;
    Ok(items)
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

/// What a backend made of a scene before it traces it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildReport {
    /// From the height maps' pyramids to the BVH, by the host's clock; after
    /// [`set_displacements`](Backend::set_displacements) without the pyramids. Compilation is not part of it.
    pub duration: Duration,
    /// Nodes of the BVH.
    pub nodes: u32,
    /// Triangles that the BVH leaves out, since their boxes are not finite, or all but.
    pub left_out: u32,
    /// Whether the BVH kept its nodes and only got other boxes.
    pub refitted: bool,
}

/// The code of a kernel's pipeline as a driver gets it: SPIR-V that is specialised for the features of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PipelineCode {
    /// The kernel.
    pub kernel: &'static str,
    /// Instructions of its functions, without declarations of types and constants.
    pub instructions: u32,
    /// The whole module.
    pub bytes: u64,
    /// The module before it was specialised, with the code for all features.
    pub bytes_of_all: u64,
    /// What the driver says of the code that it made of it, registers for example; empty where it says nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub statistics: Vec<PipelineStatistic>,
}

/// A driver's statistic of a pipeline.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PipelineStatistic {
    /// The driver's name for it.
    pub name: String,
    /// Its value; 0 or 1 where it is true or not.
    pub value: f64,
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
    /// Vulkan shows no pictures in the window. What it renders can be shown otherwise.
    #[error("Vulkan shows no pictures in the window: {reason}")]
    CannotPresent {
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
    /// More triangles than a BVH holds.
    #[error("the model has {count} triangles, more than the {MAX_PRIMITIVES} of a BVH; use a model of fewer")]
    TooManyTriangles {
        /// How many.
        count: usize,
    },
    /// More distance maps than kernels number words of.
    #[error(
        "the scene has {count} height maps, more than there can be distance maps of; use fewer, or --method pyramid"
    )]
    TooManyDistanceMaps {
        /// How many.
        count: usize,
    },
    /// More micro-triangles than a BVH holds.
    #[error(
        "{triangles} triangles at N = {subdivisions} have {count} micro-triangles, but a BVH stores at most \
            {MAX_PRIMITIVES}; \
         use N = {most} or less, or --method quadtree, which stores none"
    )]
    TooManyMicroTriangles {
        /// Base triangles.
        triangles: u32,
        /// N.
        subdivisions: u32,
        /// How many micro-triangles that makes.
        count: u64,
        /// The greatest N that fits.
        most: u32,
    },
    /// More instances than a BVH holds.
    #[error("the scene has {count} instances, more than the {MAX_PRIMITIVES} of a BVH; use fewer")]
    TooManyInstances {
        /// How many.
        count: usize,
    },
    /// The device stopped answering.
    #[error("{device} was lost while {what}; a smaller N or --backend cpu may help")]
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
    #[error(
        "no memory for {name} ({bytes} bytes): {reason}; end other programs, or use fewer pixels, smaller maps or a \
         smaller model"
    )]
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
    /// with just the code that `features` ask for. Then computes what follows from the scene: the height maps'
    /// pyramids, the heights of triangles and seams, the prisms' boxes, and the BVH over them. The camera may be
    /// missing as yet: see [`set_view`](Self::set_view). After an error the backend holds an empty scene.
    fn load(&mut self, scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<(), BackendError>;

    /// What computing that took, and what came of it.
    fn build_report(&self) -> BuildReport;

    /// The pipelines that hold code for the features of the loaded scene, in no order, without those that build BVHs,
    /// which are the same for all scenes. None where there are no pipelines: on the CPU backend the code for each
    /// choice of features is in the program.
    fn pipelines(&self) -> Vec<PipelineCode> {
        Vec::new()
    }

    /// How long pipelines were made since the backend was opened: the share of [`load`](Self::load) that a scene does
    /// not cost again.
    fn compile_time(&self) -> Duration {
        Duration::ZERO
    }

    /// The box of each triangle's prism: of the displaced triangle with all its micro-triangles.
    fn prism_boxes(&mut self) -> Result<Vec<Aabb>, BackendError>;

    /// The tree over the boxes. With instances the tree over them and those of their meshes, as kernels read them: see
    /// [`instances`].
    fn bvh(&mut self) -> Result<Bvh, BackendError>;

    /// The distance maps of the loaded scene, known or computed, one behind the other; none where its method reads
    /// none.
    fn distance_maps(&mut self) -> Result<Vec<f32>, BackendError>;

    /// Looks at the loaded scene in another way: with the camera, the film's size, the seed, the background, the light
    /// and the shading's settings of `frame`, and with other lights. What of `frame` the scene decides (triangles, N,
    /// heights) is not read. Film and counters are cleared; nothing is built.
    fn set_view(&mut self, frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError>;

    /// Displaces the loaded scene by other heights. Of its displacements only `zero` and `scale` may have changed,
    /// and the range of heights, which has to follow them. Film and counters are cleared; heights and boxes are
    /// computed anew, also distance maps of scales that change their sign, and the BVH gets these boxes or, where it
    /// does not suit them, is built anew.
    fn set_displacements(&mut self, displacements: &[Displacement]) -> Result<(), BackendError>;

    /// Traces the loaded scene with other code: `method`, `shade`, `shadows`, `smooth` and `counters` may differ from
    /// the features that it was loaded with, but for methods that need what the scene was not loaded with: a
    /// tessellation, distance maps, a map of their own, other boxes. Film and counters are cleared; pipelines are made
    /// where they hold other code, and nothing is built. (A scene is displaced by its scales alone, so that for
    /// [`method::NONE`] these have to be 0: see [`set_displacements`](Self::set_displacements).)
    fn set_features(&mut self, features: Features) -> Result<(), BackendError>;

    /// Adds sample number `sample` to every pixel, part by part. Calls `progress` with the share done (0 to 1)
    /// between parts; `Break` ends the pass, and the film keeps what it has.
    fn add_sample(
        &mut self,
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, BackendError>;

    /// The picture so far: linear RGB premultiplied by alpha, row-major, top row first.
    fn resolve(&mut self) -> Result<Vec<Vec4>, BackendError>;

    /// The work counters since the film was cleared.
    fn totals(&mut self) -> Result<Totals, BackendError>;

    /// What the device took for the samples since the film was cleared, in milliseconds, without the host's time
    /// between submissions: by its own clock, or by the host's where it has none. `None` on the CPU.
    fn device_ms(&mut self) -> Option<f64>;

    /// The nearest hit of each ray.
    fn trace_rays(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError>;

    /// From now on lets the driver fuse products with sums, or (as at first) not: then nothing is exact. To measure
    /// what drivers do, and what it costs to forbid it. On the CPU nothing is ever fused, and this does nothing.
    fn let_contract(&mut self, _contracts: bool) {}

    /// Runs an elementary kernel on `count` items: see [`probe`](emboss_kernels::probe). Needs no scene.
    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError>;
}

/// The hash of the kernels' sources, which is what the CPU runs too, as the manifest of the modules has it.
pub fn kernels_hash() -> String {
    let manifest: Option<serde_json::Value> =
        serde_json::from_str(include_str!("../../../assets/kernels.json")).ok();
    manifest.and_then(|manifest| Some(manifest["source_hash"].as_str()?.to_owned())).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> (SceneBuffers, Frame, Features) {
        let scene = SceneBuffers {
            vertices: vec![Vertex::default(); 3],
            tangents: vec![],
            texel_scales: vec![],
            triangles: vec![Triangle { vertices: [0, 1, 2], ..Triangle::default() }],
            seams: vec![Seams { side_count: [1, 0, 0], reading_count: [0, 1, 0], ..Seams::default() }],
            seam_sides: vec![SeamSide::default()],
            displacements: vec![Displacement { map_width: 3, map_height: 3, ..Displacement::default() }],
            materials: vec![Material {
                color_format: color_format::SRGB8,
                color_width: 3,
                color_height: 3,
                ..Material::default()
            }],
            height_texels: vec![0; 3],
            color_texels: vec![0; 256 + 9],
            lights: vec![PointLight::default()],
            normal_texels: vec![],
            distances: vec![],
            instances: vec![],
        };
        let frame = Frame { subdivisions: 1, triangle_count: 1, light_count: 1, ..Frame::default() };
        let features = Features {
            method: method::QUADTREE,
            color_format: color_format::SRGB8,
            seams: 1,
            ..Features::default()
        };
        (scene, frame, features)
    }

    /// A map of their own is whole, and one in tangent space has the tangents that it is along. Going over to such a
    /// method, or between boxes of the base mesh and of what it is displaced to, takes another scene.
    #[test]
    fn methods_have_the_maps_that_they_read() {
        let (mut scene, frame, features) = sound();
        scene.height_texels = vec![0; 9];
        let by = |method| Features { method, ..features };
        let refused = |scene: &SceneBuffers, method| {
            scene.check(&frame, by(method)).err().map_or(String::new(), |error| error.to_string())
        };
        assert!(refused(&scene, method::NORMAL_MAP).contains("a map of normals"));
        scene.normal_texels = vec![6, 2, 1, 0, 0, normal_space::WORLD, 0, 0, 0];
        assert!(refused(&scene, method::BUMP_OFFSET).contains("fewer texels"));
        scene.normal_texels.push(0);
        assert!(!refused(&scene, method::NORMAL_MAP).contains("normals"));
        scene.normal_texels[5] = normal_space::TANGENT;
        assert!(refused(&scene, method::NORMAL_MAP).contains("tangents"));
        assert!(!refused(&scene, method::BUMP_OFFSET).contains("tangents"));

        let goes = |from, to| check_features(by(from), by(to)).is_ok();
        assert!(goes(method::STEEP, method::BUMP) && goes(method::NORMAL_MAP, method::BUMP));
        assert!(!goes(method::BUMP, method::NORMAL_MAP) && !goes(method::BUMP_OFFSET, method::NORMAL_MAP));
        assert!(!goes(method::QUADTREE, method::STEEP) && !goes(method::STEEP, method::NONE));
    }

    /// Three maps of a size for each that is named, and a tangent for each vertex.
    #[test]
    fn vectors_need_three_maps_and_tangents() {
        let (mut scene, frame, features) = sound();
        let features = Features { displacement: displacement_kind::TANGENT, ..features };
        let check = |scene: &SceneBuffers| scene.check(&frame, features).map_err(|error| error.to_string());
        let words = pyramid_words(features.height_format, 3, 3);
        let first = scene.displacements[0];
        scene.displacements.push(Displacement { first_range: words, ..first });
        scene.tangents = vec![Tangent::default(); 3];
        assert!(check(&scene).expect_err("two maps").contains("names a height map"));
        scene.displacements.push(Displacement { first_range: 2 * words, ..first });
        assert_eq!(check(&scene), Ok(()));
        scene.displacements[2].map_width = 2;
        assert!(check(&scene).expect_err("of two sizes").contains("names a height map"));
        scene.displacements[2].map_width = 3;
        scene.tangents.pop();
        assert!(check(&scene).expect_err("two tangents").contains("fewer tangents"));
    }

    #[test]
    fn memory_that_cannot_be_had_is_an_error() {
        let error = reserved::<u64>("the film", usize::MAX / 32).expect_err("no machine has it");
        assert!(error.to_string().starts_with("no memory for the film ("), "{error}");
    }

    #[test]
    fn sound_and_empty_scenes_pass() {
        let (scene, frame, features) = sound();
        assert!(scene.check(&frame, features).is_ok());
        assert!(SceneBuffers::default().check(&Frame::default(), Features::default()).is_ok());
    }

    /// Also where nothing is displaced: seams are decided before anything is traced.
    #[test]
    fn seams_are_checked_whatever_the_method() {
        let (mut scene, frame, features) = sound();
        scene.seams[0].first_side[0] = 1;
        assert!(scene.check(&frame, Features { method: method::NONE, ..features }).is_err());
    }

    #[test]
    fn only_heights_of_displacements_may_change() {
        let (scene, ..) = sound();
        let loaded = &scene.displacements;
        let changed = |change: fn(&mut Displacement)| {
            let mut new = loaded.clone();
            change(&mut new[0]);
            check_displacements(loaded, &new)
        };
        assert!(changed(|d| (d.scale, d.zero, d.height_max) = (-2.0, 0.5, 1.0)).is_ok());
        let breaks: [fn(&mut Displacement); 6] = [
            |d| d.map_width = 2,
            |d| d.map_height = 2,
            |d| d.first_word = 1,
            |d| d.first_range = 1,
            |d| d.scale = f32::NAN,
            |d| d.height_max = f32::INFINITY,
        ];
        assert!(breaks.into_iter().all(|change| changed(change).is_err()));
        assert!(check_displacements(loaded, &[]).is_err());
    }

    #[test]
    fn only_features_that_nothing_was_packed_for_may_change() {
        let loaded = Features { method: method::QUADTREE, ..Features::default() };
        let check = |features| check_features(loaded, features).map_err(|error| error.to_string());
        let walk = Features { method: method::GRID_WALK, ..loaded };
        assert_eq!(check(Features { shade: 3, shadows: 1, smooth: 1, counters: 1, ..walk }), Ok(()));
        for other in [
            Features { height_wrap: wrap::CLAMP, ..loaded },
            Features { seams: 1, ..loaded },
            Features { filter: filter::TRILINEAR, ..loaded },
        ] {
            assert!(check(other).expect_err("packed otherwise").contains("another scene"));
        }
        let vectors = Features { displacement: displacement_kind::TANGENT, ..loaded };
        assert!(check_features(vectors, Features { method: method::GRID_WALK, ..vectors }).is_err());
    }

    #[test]
    fn every_index_that_a_kernel_follows_is_checked() {
        type Break = fn(&mut SceneBuffers, &mut Frame);
        let breaks: [(&str, Break); 25] = [
            ("a vertex", |scene, _| scene.triangles[0].vertices[1] = 3),
            ("fewer triangles", |_, frame| frame.triangle_count = 2),
            ("lights", |_, frame| frame.light_count = 2),
            ("fewer texels", |scene, _| scene.displacements[0].map_width = 5),
            ("fewer texels", |scene, _| scene.displacements[0].first_word = 1),
            ("along a side than 2^22", |scene, _| {
                scene.displacements[0].map_width = MAX_MAP_SIDE + 1;
                scene.height_texels = vec![0; MAX_MAP_SIDE as usize];
            }),
            ("pyramids", |scene, _| scene.displacements[0].first_range = 1),
            ("triangle names a height map", |scene, _| scene.triangles[0].displacement = 1),
            ("names seams", |scene, _| scene.triangles[0].seams = 1),
            ("names sides", |scene, _| scene.seams[0].first_side[0] = 1),
            ("names sides", |scene, _| scene.seams[0].flags = 1 << 4),
            ("names sides", |scene, _| scene.seams[0].first_reading[1] = 1),
            ("names sides", |scene, _| scene.seams[0].flags = 1 << 2),
            ("side names a height map", |scene, _| scene.seam_sides[0].displacement = 1),
            ("side names a vertex", |scene, _| scene.seam_sides[0].vertices[1] = 3),
            ("N is not", |_, frame| frame.subdivisions = 0),
            ("height map is not stored", |scene, _| scene.displacements[0].format = height_format::UNORM16),
            ("height map is not stored", |scene, _| scene.displacements[0].wrap = wrap::MIRROR),
            ("names a material", |scene, _| scene.triangles[0] = scene.triangles[0].with_material(1)),
            ("colour map has fewer", |scene, _| scene.materials[0].color_width = 4),
            ("colour map has fewer", |scene, _| scene.materials[0].color_width = 0),
            ("colour map has fewer", |scene, _| scene.materials[0].first_word = 1),
            ("colour map is not stored", |scene, _| scene.materials[0].color_format = color_format::FLOAT32),
            ("colour map is not stored", |scene, _| scene.materials[0].color_format = 9),
            ("colour map is not stored", |scene, _| scene.materials[0].color_wrap = wrap::CLAMP),
        ];
        for (expected, fault) in breaks {
            let (mut scene, mut frame, features) = sound();
            fault(&mut scene, &mut frame);
            let error = scene.check(&frame, features).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn adaptive_n_needs_a_power_of_two_and_a_detail() {
        let (scene, frame, features) = sound();
        let features = Features { adaptive: 1, ..features };
        let check = |subdivisions, detail, features| {
            let frame = Frame { subdivisions, detail, ..frame };
            scene.check(&frame, features).map_err(|error| error.to_string())
        };
        assert_eq!(check(64, 1.0, features), Ok(()));
        for (n, detail) in [(3, 1.0), (64, 0.0), (64, f32::NAN)] {
            assert!(check(n, detail, features).expect_err("unsound").contains("no power of two"));
        }
        let walk = Features { method: method::GRID_WALK, ..features };
        assert!(check(64, 1.0, walk).expect_err("unsound").contains("takes one N"));
    }

    /// 3 x 3 texels, and the one of the level behind them.
    #[test]
    fn levels_of_the_colour_map_are_checked_where_they_are_read() {
        let (mut scene, frame, features) = sound();
        let filtered = Features { filter: filter::TRILINEAR, ..features };
        let check = |scene: &SceneBuffers| scene.check(&frame, filtered).map_err(|error| error.to_string());
        assert!(check(&scene).expect_err("no sizes").contains("size of texels"));
        scene.texel_scales = vec![TexelScale { size: 1.0, span: 1.0 }; 3];
        let error = check(&scene).expect_err("a texel too few");
        assert!(error.contains("colour map"), "{error}");
        scene.texel_scales[1].size = f32::INFINITY;
        assert!(check(&scene).expect_err("no number").contains("size of texels"));
        scene.texel_scales[1].size = 2.0;
        scene.color_texels.push(0);
        assert!(scene.check(&frame, filtered).is_ok());
        (scene.materials[0].color_width, scene.materials[0].color_height) = (u32::MAX, u32::MAX);
        assert!(scene.check(&frame, filtered).is_err());
    }
}
