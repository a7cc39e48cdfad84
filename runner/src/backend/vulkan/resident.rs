//! A scene and its film in the device's memory.

use super::buffer::{Buffer, Label, require_room};
use super::build::{Tree, TreeState};
use super::commands::Commands;
use super::device::Device;
use super::transfers::Transfers;
use crate::backend::{
    BackendError, SceneBuffers, check_displacements, check_features, check_lights, distance_maps, has_tree,
    is_stored, micro_vertices, stored_sizes, tree_primitives, turned_distances, unknown_distances,
    with_displacements, with_stored_bounds, with_view,
};
use crate::instances;
use bytemuck::{bytes_of, cast_slice};
use emboss_kernels::interface::{
    BvhNode, Counter, Displacement, FilmPixel, Frame, Instance, PointLight, binding, bounds, counter,
};
use emboss_kernels::relief::distance_map::WORDS;
use emboss_kernels::scene::Features;
use glam::{UVec4, Vec4};
use std::sync::Arc;

/// What a user can do about a model that is too large.
const SMALLER_MODEL: &str = "use a model of fewer triangles, or --backend cpu";
/// What a user can do about too many micro-triangles.
const SMALLER_TESSELLATION: &str = "use a smaller N, or --method quadtree, which stores no micro-triangles";
/// What a user can do about a map that is too large.
const SMALLER_MAP: &str = "scale the map down, or use --backend cpu";
/// What a user can do about a film that is too large.
const SMALLER_SIZE: &str = "use a smaller --size, or --backend cpu";
/// What a user can do about all of them together.
const SMALLER_SCENE: &str =
    "use smaller maps, a model of fewer triangles or a smaller --size, or --backend cpu";

/// The buffers of bindings [`binding::FRAME`] to [`binding::COUNTERS`], [`binding::BOXES`], [`binding::MATERIALS`],
/// [`binding::TANGENTS`], [`binding::TEXEL_SCALES`], [`binding::INSTANCES`], [`binding::NORMAL_TEXELS`],
/// [`binding::MICRO_VERTICES`], [`binding::DISTANCES`] and [`binding::PRISM_TREE`], which live as long as the scene.
pub(super) struct Resident {
    /// By binding, but for the last ten: the boxes, the materials, the tangents, the texels' sizes, the instances, the
    /// normal maps, the micro-vertices, the distance maps, the stored tree and the boxes of micro-triangles.
    buffers: Vec<Buffer>,
    frame: Frame,
    displacements: Vec<Displacement>,
    /// The distance maps that have to be computed when prisms are prepared next.
    stale_distances: Vec<u32>,
    instances: Vec<Instance>,
    features: Features,
    /// How many entries of the seams' table are read.
    seams: u32,
    tree: TreeState,
}

/// Where a binding's buffer stands in [`Resident::buffers`].
fn place_of(binding: u32) -> usize {
    match binding {
        binding::BOXES => binding::COUNTERS as usize + 1,
        binding::MATERIALS => binding::COUNTERS as usize + 2,
        binding::TANGENTS => binding::COUNTERS as usize + 3,
        binding::TEXEL_SCALES => binding::COUNTERS as usize + 4,
        binding::INSTANCES => binding::COUNTERS as usize + 5,
        binding::NORMAL_TEXELS => binding::COUNTERS as usize + 6,
        binding::MICRO_VERTICES => binding::COUNTERS as usize + 7,
        binding::DISTANCES => binding::COUNTERS as usize + 8,
        binding::PRISM_TREE => binding::COUNTERS as usize + 9,
        _ => binding as usize,
    }
}

/// Where the boxes of micro-triangles stand there.
const MICRO_BOXES: usize = binding::COUNTERS as usize + 10;

/// What one of the buffers holds at first.
struct Content<'a> {
    label: Label,
    /// Its size in bytes; may be 0.
    bytes: u64,
    /// What is uploaded; `None` for zeros.
    data: Option<&'a [u8]>,
}

impl Resident {
    /// Uploads a scene, which is checked, and makes an empty film for it. Sizes are checked before anything is
    /// allocated.
    pub(super) fn new(
        device: &Arc<Device>,
        commands: &Commands,
        transfers: &mut Transfers,
        scene: &SceneBuffers,
        frame: &Frame,
        features: Features,
    ) -> Result<Self, BackendError> {
        let contents = contents(scene, frame, features);
        require_room_for_all(device, &contents)?;
        let buffers: Vec<_> = contents
            .iter()
            .map(|content| Buffer::for_kernels(device, content.label, content.bytes))
            .collect::<Result<_, _>>()?;
        for (buffer, content) in buffers.iter().zip(&contents) {
            content.fill(commands, transfers, buffer)?;
        }
        let maps = distance_maps(scene.displacements.len(), features) as usize;
        for (known, map) in scene.distances.iter().take(maps).zip(0..) {
            if let Some(known) = known {
                let offset = map * u64::from(WORDS) * size_of::<f32>() as u64;
                let distances = &buffers[place_of(binding::DISTANCES)];
                transfers.write_at(commands, distances, offset, cast_slice(known))?;
            }
        }
        let seams = if features.seams == 0 { 0 } else { scene.seams.len() };
        Ok(Resident {
            buffers,
            frame: *frame,
            displacements: scene.displacements.clone(),
            stale_distances: unknown_distances(scene, features),
            instances: scene.instances.clone(),
            features,
            // A buffer holds them.
            seams: u32::try_from(seams).unwrap_or(u32::MAX),
            // Trees of instances' meshes have their own while they are built.
            tree: TreeState::new(
                device,
                if scene.instances.is_empty() { tree_primitives(frame, features) } else { 0 },
            )?,
        })
    }

    /// Looks at the scene in another way; see [`Backend::set_view`](crate::backend::Backend::set_view).
    pub(super) fn set_view(
        &mut self,
        device: &Arc<Device>,
        commands: &Commands,
        transfers: &mut Transfers,
        frame: &Frame,
        lights: &[PointLight],
    ) -> Result<(), BackendError> {
        check_lights(frame, lights)?;
        let lights = lights_content(lights);
        let place = place_of(binding::LIGHTS);
        if lights.bytes > self.buffers[place].bytes() {
            self.buffers[place] = Buffer::for_kernels(device, lights.label, lights.bytes)?;
        }
        lights.fill(commands, transfers, &self.buffers[place])?;
        let frame = with_view(&self.frame, frame);
        if (frame.width, frame.height) != (self.frame.width, self.frame.height) {
            // The old film goes first, so that two need not fit side by side.
            self.resize_film(device, &Frame::default())?;
            self.resize_film(device, &frame)?;
        }
        self.frame = frame;
        transfers.write(commands, self.buffer(binding::FRAME), bytes_of(&frame))?;
        self.clear_film(commands)
    }

    /// Replaces film and picture by those of a frame. What they hold is undefined.
    fn resize_film(&mut self, device: &Arc<Device>, frame: &Frame) -> Result<(), BackendError> {
        for (binding, content) in film_contents(frame) {
            self.buffers[place_of(binding)] = Buffer::for_kernels(device, content.label, content.bytes)?;
        }
        (self.frame.width, self.frame.height) = (frame.width, frame.height);
        Ok(())
    }

    /// Takes other heights of the same maps.
    pub(super) fn set_displacements(
        &mut self,
        commands: &Commands,
        transfers: &mut Transfers,
        displacements: &[Displacement],
    ) -> Result<(), BackendError> {
        check_displacements(&self.displacements, displacements)?;
        self.stale_distances = turned_distances(&self.displacements, displacements, self.features);
        self.displacements.copy_from_slice(displacements);
        self.frame = with_displacements(&self.frame, displacements, self.features);
        transfers.write(commands, self.buffer(binding::DISPLACEMENTS), cast_slice(displacements))?;
        transfers.write(commands, self.buffer(binding::FRAME), bytes_of(&self.frame))?;
        self.clear_film(commands)
    }

    /// Takes the features of other code for the same scene.
    pub(super) fn set_features(
        &mut self,
        commands: &Commands,
        features: Features,
    ) -> Result<(), BackendError> {
        check_features(self.features, features)?;
        self.features = with_stored_bounds(self.features, features);
        self.clear_film(commands)
    }

    /// Clears the film and the counters.
    fn clear_film(&self, commands: &Commands) -> Result<(), BackendError> {
        for binding in [binding::FILM, binding::COUNTERS] {
            commands.run("clearing", |recorder| recorder.fill(self.buffer(binding), 0))?;
        }
        Ok(())
    }

    /// The buffer of a binding up to [`binding::COUNTERS`], of the boxes, or one of those behind.
    pub(super) fn buffer(&self, binding: u32) -> &Buffer {
        &self.buffers[place_of(binding)]
    }

    /// Width and height of the film in pixels.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.frame.width, self.frame.height]
    }

    /// How many pixels the film has: below 2³², since a buffer holds them.
    pub(super) fn pixels(&self) -> u32 {
        self.frame.width * self.frame.height
    }

    /// Where meshes stand; none where there is one tree.
    pub(super) fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// The boxes of micro-triangles.
    pub(super) fn micro_boxes(&self) -> &Buffer {
        &self.buffers[MICRO_BOXES]
    }

    /// How many distance maps there are.
    pub(super) fn distance_maps(&self) -> u32 {
        distance_maps(self.displacements.len(), self.features)
    }

    /// Those of them that have to be computed when prisms are prepared next.
    pub(super) fn stale_distances(&self) -> &[u32] {
        &self.stale_distances
    }

    /// How many micro-vertices, and how many micro-triangles are stored.
    pub(super) fn stored(&self) -> [u32; 2] {
        let micro_triangles =
            if is_stored(self.features) { tree_primitives(&self.frame, self.features) } else { 0 };
        [micro_vertices(&self.frame, self.features), micro_triangles]
    }

    /// Which code it is traced with.
    pub(super) fn features(&self) -> Features {
        self.features
    }

    /// N, and which bounds are stored.
    pub(super) fn bounds(&self) -> (u32, u32) {
        let stored = has_tree(&self.frame, self.features);
        (self.frame.subdivisions, if stored { self.features.bounds } else { bounds::NONE })
    }

    /// The tree over the triangles or micro-triangles, where there are no instances.
    pub(super) fn tree(&self) -> Tree<'_> {
        Tree {
            boxes: if is_stored(self.features) { self.micro_boxes() } else { self.buffer(binding::BOXES) },
            nodes: self.buffer(binding::NODES),
            primitives: self.buffer(binding::PRIMITIVES),
            state: &self.tree,
        }
    }

    /// How many triangles are traced.
    pub(super) fn triangles(&self) -> u32 {
        self.frame.triangle_count
    }

    /// How many entries of the seams' table are read.
    pub(super) fn seams(&self) -> u32 {
        self.seams
    }
}

impl Content<'_> {
    /// Uploads it, or clears the buffer.
    fn fill(
        &self,
        commands: &Commands,
        transfers: &mut Transfers,
        buffer: &Buffer,
    ) -> Result<(), BackendError> {
        match self.data {
            Some(data) if !data.is_empty() => transfers.write(commands, buffer, data),
            _ => commands.run("clearing", |recorder| recorder.fill(buffer, 0)).map(drop),
        }
    }
}

/// What each buffer holds, in the order of [`place_of`].
fn contents<'a>(
    scene: &'a SceneBuffers,
    frame: &'a Frame,
    features: Features,
) -> [Content<'a>; MICRO_BOXES + 1] {
    let triangles = u64::from(frame.triangle_count);
    // What nothing traces was not checked, and has no pyramids.
    let pyramid_words = if triangles == 0 { 0 } else { scene.pyramid_words() };
    // A leaf for each triangle or micro-triangle, and the inner nodes between them.
    let primitives = u64::from(tree_primitives(frame, features));
    let one_tree = (2 * primitives).saturating_sub(1);
    let smaller_tree = if is_stored(features) { SMALLER_TESSELLATION } else { SMALLER_MODEL };
    let (micro_floats, quarters) = stored_sizes(frame, features, scene.seams.len());
    let distances = u64::from(distance_maps(scene.displacements.len(), features)) * u64::from(WORDS);
    let micro_boxes = if is_stored(features) { 6 * primitives } else { 0 };
    let nodes = one_tree.max(instances::node_room(&scene.instances).into());
    let [(_, film), (_, picture)] = film_contents(frame);
    [
        uploaded("the frame", SMALLER_SCENE, bytes_of(frame)),
        uploaded("the vertices", SMALLER_MODEL, cast_slice(&scene.vertices)),
        uploaded("the triangles", SMALLER_MODEL, cast_slice(&scene.triangles)),
        zeros("the BVH", smaller_tree, nodes, size_of::<BvhNode>()),
        zeros("the BVH's primitives", smaller_tree, primitives, size_of::<u32>()),
        uploaded("the height maps' settings", SMALLER_SCENE, cast_slice(&scene.displacements)),
        uploaded("the height maps", SMALLER_MAP, cast_slice(&scene.height_texels)),
        zeros("the height maps' pyramids", SMALLER_MAP, pyramid_words, size_of::<u32>()),
        uploaded("the seams", SMALLER_MODEL, cast_slice(&scene.seams)),
        uploaded("the seams' sides", SMALLER_MODEL, cast_slice(&scene.seam_sides)),
        uploaded("the colour maps", SMALLER_MAP, cast_slice(&scene.color_texels)),
        lights_content(&scene.lights),
        film,
        picture,
        zeros("the counters", SMALLER_SCENE, counter::COUNT as u64, size_of::<Counter>()),
        zeros("the prisms' boxes", SMALLER_MODEL, 6 * triangles, size_of::<f32>()),
        uploaded("the materials", SMALLER_SCENE, cast_slice(&scene.materials)),
        uploaded("the tangents", SMALLER_MODEL, cast_slice(&scene.tangents)),
        uploaded("the sizes of texels", SMALLER_MODEL, cast_slice(&scene.texel_scales)),
        uploaded("the instances", "use fewer instances, or --backend cpu", cast_slice(&scene.instances)),
        uploaded("the normal maps", SMALLER_MAP, cast_slice(&scene.normal_texels)),
        zeros("the micro-vertices", SMALLER_TESSELLATION, micro_floats, size_of::<f32>()),
        zeros("the distance maps", "use fewer maps, or --method pyramid", distances, size_of::<f32>()),
        zeros("the stored bounds", "use --bounds none, or a smaller N", quarters, size_of::<UVec4>()),
        zeros("the micro-triangles' boxes", SMALLER_TESSELLATION, micro_boxes, size_of::<f32>()),
    ]
}

fn lights_content(lights: &[PointLight]) -> Content<'_> {
    uploaded("the lights", "use fewer lights", cast_slice(lights))
}

/// What film and picture of a frame hold, with their bindings.
fn film_contents(frame: &Frame) -> [(u32, Content<'static>); 2] {
    let pixels = u64::from(frame.width) * u64::from(frame.height);
    [
        (binding::FILM, zeros("the film", SMALLER_SIZE, pixels, size_of::<FilmPixel>())),
        (binding::PICTURE, zeros("the picture", SMALLER_SIZE, pixels, size_of::<Vec4>())),
    ]
}

fn zeros(name: &'static str, remedy: &'static str, count: u64, element: usize) -> Content<'static> {
    // Saturates far above what any device allows.
    Content { label: Label { name, remedy }, bytes: count.saturating_mul(element as u64), data: None }
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
    use emboss_kernels::interface::{Material, Tangent, TexelScale, method};

    #[test]
    fn contents_stand_at_their_bindings() {
        let scene = SceneBuffers {
            height_texels: vec![1; 3],
            displacements: vec![Displacement { map_width: 2, map_height: 1, ..Displacement::default() }],
            color_texels: vec![2; 5],
            materials: vec![Material::default(); 3],
            tangents: vec![Tangent::default(); 3],
            texel_scales: vec![TexelScale::default(); 3],
            ..Default::default()
        };
        let frame = Frame { width: 7, height: 3, triangle_count: 4, ..Frame::default() };
        let contents = contents(&scene, &frame, Features::default());
        let bytes = |binding: u32| contents[place_of(binding)].bytes;
        assert_eq!(bytes(binding::FRAME), size_of::<Frame>() as u64);
        assert_eq!(bytes(binding::HEIGHT_TEXELS), 12);
        // A header of 32 words, and one entry of two bytes.
        assert_eq!(bytes(binding::HEIGHT_RANGES), 4 * 33);
        assert_eq!(bytes(binding::NODES), 7 * 32);
        assert_eq!(bytes(binding::PRIMITIVES), 4 * 4);
        assert_eq!(bytes(binding::BOXES), 4 * 24);
        assert_eq!(bytes(binding::TANGENTS), 3 * 16);
        assert_eq!(bytes(binding::TEXEL_SCALES), 3 * 8);
        assert_eq!(bytes(binding::COLOR_TEXELS), 20);
        assert_eq!(bytes(binding::MATERIALS), 3 * 32);
        assert_eq!(bytes(binding::FILM), 7 * 3 * 20);
        assert_eq!(bytes(binding::PICTURE), 7 * 3 * 16);
        assert_eq!(bytes(binding::COUNTERS), 8 * counter::COUNT as u64);
        assert_eq!((bytes(binding::MICRO_VERTICES), contents[MICRO_BOXES].bytes), (0, 0));
        assert_eq!(bytes(binding::DISTANCES), 0);
        let features = Features { method: method::SPHERE, ..Features::default() };
        let contents = super::contents(&scene, &frame, features);
        assert_eq!(contents[place_of(binding::DISTANCES)].bytes, u64::from(WORDS) * 4);
    }

    /// Four triangles of nine micro-triangles and ten micro-vertices.
    #[test]
    fn a_tessellation_has_its_buffers() {
        let frame = Frame { triangle_count: 4, subdivisions: 3, ..Frame::default() };
        let features = Features { method: method::TESSELLATE, ..Features::default() };
        let scene = SceneBuffers::default();
        let contents = contents(&scene, &frame, features);
        let bytes = |binding: u32| contents[place_of(binding)].bytes;
        assert_eq!(bytes(binding::NODES), 71 * 32);
        assert_eq!(bytes(binding::PRIMITIVES), 36 * 4);
        assert_eq!(bytes(binding::BOXES), 4 * 24);
        assert_eq!(bytes(binding::MICRO_VERTICES), 40 * 12);
        assert_eq!(contents[MICRO_BOXES].bytes, 36 * 24);
    }

    #[test]
    fn sizes_beyond_any_memory_saturate() {
        let frame = Frame { width: u32::MAX, height: u32::MAX, ..Frame::default() };
        let contents =
            contents(&SceneBuffers::default(), &frame, Features::default()).map(|content| content.bytes);
        assert_eq!(contents[binding::FILM as usize], u64::MAX);
    }
}
