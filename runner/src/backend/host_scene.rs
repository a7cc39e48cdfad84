//! A scene in the host's memory with all that follows from its buffers, by the functions that kernels run on a device.

use super::{
    BackendError, BuildReport, SceneBuffers, check_displacements, check_features, check_lights,
    distance_maps, has_tree, is_stored, micro_vertices, reserved, stored_sizes, tree_primitives,
    turned_distances, unknown_distances, with_displacements, with_stored_bounds, with_view,
};
use crate::bvh::{Bvh, Hlbvh, MOST_GROWTH};
use crate::heights::build_pyramids;
use crate::instances;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::displacement::height_pyramid::height_bounds;
use emboss_kernels::displacement::seams::decide_seams;
use emboss_kernels::displacement::surface::{HeightField, prism_bounds};
use emboss_kernels::displacement::tessellate;
use emboss_kernels::interface::{BvhNode, Displacement, Frame, Instance, PointLight, bounds};
use emboss_kernels::prism_tree::build;
use emboss_kernels::prism_tree::layout::{Layout, heap_nodes, levels};
use emboss_kernels::relief::distance_map::{self, CELLS, COLUMNS, WORDS};
use emboss_kernels::scene::{Features, SceneView};
use glam::UVec4;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// What the CPU backend traces, and what tests look at. The default is an empty scene.
#[derive(Clone, Debug, Default)]
pub struct HostScene {
    /// With the heights of triangles and seams.
    buffers: SceneBuffers,
    frame: Frame,
    features: Features,
    height_ranges: Vec<u32>,
    boxes: Vec<Aabb>,
    /// Three floats each; none unless that is the method.
    micro_vertices: Vec<f32>,
    /// The tree that is stored for the exact method; none unless the features say so.
    prism_tree: Vec<UVec4>,
    /// Distance maps; none unless the method reads them.
    distances: Vec<f32>,
    /// Those of them that have to be computed when prisms are prepared next.
    stale_distances: Vec<u32>,
    /// The boxes of micro-triangles, as far.
    micro_boxes: Vec<Aabb>,
    /// The tree over the boxes, of these or of those, or with instances those of their meshes.
    trees: Vec<MeshTree>,
    /// The same as kernels read them, with instances behind the tree over these.
    bvh: Bvh,
    report: BuildReport,
}

/// The tree over the boxes of some triangles or micro-triangles, as it was built or refitted last.
#[derive(Clone, Debug)]
struct MeshTree {
    primitives: Range<usize>,
    tree: Hlbvh,
    /// What it cost when it was built.
    built_cost: f64,
}

impl MeshTree {
    fn left_out(&self) -> u32 {
        u32::try_from(self.primitives.len()).unwrap_or(u32::MAX) - self.tree.sound()
    }
}

impl HostScene {
    /// A copy of `scene`, checked, with its pyramids, heights, boxes and BVH.
    ///
    /// # Errors
    /// [`BackendError::Unsound`] where the buffers do not fit each other, [`BackendError::Allocation`] where memory
    /// ends.
    pub fn new(scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<HostScene, BackendError> {
        scene.check(frame, features)?;
        let mut host =
            HostScene { buffers: copied_scene(scene)?, frame: *frame, features, ..HostScene::default() };
        if frame.triangle_count == 0 {
            return Ok(host);
        }
        let start = Instant::now();
        let words = usize::try_from(scene.pyramid_words()).unwrap_or(usize::MAX);
        host.height_ranges = reserved("the height maps' pyramids", words)?;
        host.height_ranges.resize(words, 0);
        let SceneBuffers { displacements, height_texels, .. } = &host.buffers;
        build_pyramids(displacements, height_texels, &mut host.height_ranges);
        host.take_distances(&scene.distances)?;
        host.stale_distances = unknown_distances(scene, features);
        host.prepare_prisms()?;
        host.build_bvh(start);
        Ok(host)
    }

    /// The scene as kernels see it.
    pub fn view(&self) -> SceneView<'_> {
        SceneView {
            frame: &self.frame,
            vertices: &self.buffers.vertices,
            tangents: &self.buffers.tangents,
            texel_scales: &self.buffers.texel_scales,
            triangles: &self.buffers.triangles,
            nodes: &self.bvh.nodes,
            primitives: &self.bvh.primitives,
            displacements: &self.buffers.displacements,
            height_texels: &self.buffers.height_texels,
            height_ranges: &self.height_ranges,
            seams: &self.buffers.seams,
            seam_sides: &self.buffers.seam_sides,
            color_texels: &self.buffers.color_texels,
            materials: &self.buffers.materials,
            lights: &self.buffers.lights,
            normal_texels: &self.buffers.normal_texels,
            instances: &self.buffers.instances,
            micro_vertices: &self.micro_vertices,
            distances: &self.distances,
            prism_tree: &self.prism_tree,
        }
    }

    /// Which code it needs.
    pub fn features(&self) -> Features {
        self.features
    }

    /// The box of each triangle's prism.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The tree over the boxes; with instances as [`Backend::bvh`](super::Backend::bvh).
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// What building it took.
    pub fn report(&self) -> BuildReport {
        self.report
    }

    /// As [`Backend::set_view`](super::Backend::set_view), apart from the film.
    ///
    /// # Errors
    /// [`BackendError::Unsound`] where there are fewer lights than `frame` says.
    pub fn set_view(&mut self, frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError> {
        check_lights(frame, lights)?;
        self.buffers.lights = copied("lights", lights)?;
        self.frame = with_view(&self.frame, frame);
        Ok(())
    }

    /// As [`Backend::set_displacements`](super::Backend::set_displacements), apart from the film.
    ///
    /// # Errors
    /// [`BackendError::Unsound`] where something else than heights would change.
    pub fn set_displacements(&mut self, displacements: &[Displacement]) -> Result<(), BackendError> {
        check_displacements(&self.buffers.displacements, displacements)?;
        self.stale_distances = turned_distances(&self.buffers.displacements, displacements, self.features);
        self.buffers.displacements.copy_from_slice(displacements);
        self.frame = with_displacements(&self.frame, displacements, self.features);
        if self.frame.triangle_count == 0 {
            return Ok(());
        }
        let start = Instant::now();
        self.prepare_prisms()?;
        self.update_bvh(start);
        Ok(())
    }

    /// As [`Backend::set_features`](super::Backend::set_features), apart from the film.
    ///
    /// # Errors
    /// [`BackendError::Unsound`] where the scene was packed or built for others.
    pub fn set_features(&mut self, features: Features) -> Result<(), BackendError> {
        check_features(self.features, features)?;
        self.features = with_stored_bounds(self.features, features);
        Ok(())
    }

    /// Everything from the pyramids to the BVH: the heights of triangles, those of seams, the boxes, and of a
    /// tessellation its own.
    fn prepare_prisms(&mut self) -> Result<(), BackendError> {
        let features = self.features;
        // Taken out, since the view of the rest is read meanwhile, which has neither.
        let mut triangles = std::mem::take(&mut self.buffers.triangles);
        let mut seams = std::mem::take(&mut self.buffers.seams);
        let view = self.view();
        let field = HeightField::new(&view, features);
        triangles.par_iter_mut().for_each(|triangle| {
            (triangle.height_min, triangle.height_max) = height_bounds(&field, view.vertices, *triangle);
        });
        if features.seams != 0 {
            seams.par_iter_mut().for_each(|seams| *seams = decide_seams(&field, *seams));
        }
        (self.buffers.triangles, self.buffers.seams) = (triangles, seams);
        let mut boxes = reserved("the prisms' boxes", self.frame.triangle_count as usize)?;
        let view = self.view();
        (0..self.frame.triangle_count)
            .into_par_iter()
            .map(|primitive| prism_bounds(&view, features, primitive))
            .collect_into_vec(&mut boxes);
        self.boxes = boxes;
        if is_stored(features) {
            self.tessellate()?;
        }
        if has_tree(&self.frame, features) {
            self.store_bounds()?;
        }
        self.map_distances();
        Ok(())
    }

    /// Makes room for the distance maps, where the method reads them, and takes those that are known.
    fn take_distances(&mut self, known: &[Option<Vec<f32>>]) -> Result<(), BackendError> {
        let maps = distance_maps(self.buffers.displacements.len(), self.features);
        let floats = maps as usize * WORDS as usize;
        self.distances = reserved("the distance maps", floats)?;
        self.distances.resize(floats, 0.0);
        for (map, known) in self.distances.chunks_exact_mut(WORDS as usize).zip(known) {
            if let Some(known) = known {
                map.copy_from_slice(known);
            }
        }
        Ok(())
    }

    /// Computes the distance maps that have to be.
    fn map_distances(&mut self) {
        let features = self.features;
        let mut distances = std::mem::take(&mut self.distances);
        let view = self.view();
        let field = HeightField::new(&view, features);
        for &map in &self.stale_distances {
            let pyramid = field.pyramid(field.displacement(map));
            let map = &mut distances[map as usize * WORDS as usize..][..WORDS as usize];
            let (columns, cells) = map.split_at_mut(COLUMNS as usize);
            let column = |(i, column): (u32, &mut f32)| *column = distance_map::column(&pyramid, i);
            (0..COLUMNS).into_par_iter().zip(columns.par_iter_mut()).for_each(column);
            let distance = |i| distance_map::distance(columns, 0, pyramid.wrap, i);
            (0..CELLS).into_par_iter().zip(cells).for_each(|(i, cell)| *cell = distance(i));
        }
        self.distances = distances;
    }

    /// The micro-vertices of all triangles, and the boxes of their micro-triangles.
    fn tessellate(&mut self) -> Result<(), BackendError> {
        let features = self.features;
        let floats = 3 * micro_vertices(&self.frame, features) as usize;
        let mut points = reserved("the micro-vertices", floats)?;
        points.resize(floats, 0.0);
        let view = self.view();
        let count = micro_vertices(&self.frame, features);
        points.par_chunks_exact_mut(3).zip(0..count).for_each(|(point, i)| {
            tessellate::store(point, 0, tessellate::micro_vertex(&view, features, i));
        });
        self.micro_vertices = points;
        let count = tree_primitives(&self.frame, features);
        let mut boxes = reserved("the micro-triangles' boxes", count as usize)?;
        let (points, n) = (&self.micro_vertices, self.frame.subdivisions);
        (0..count).into_par_iter().map(|i| tessellate::bounds(points, n, i)).collect_into_vec(&mut boxes);
        self.micro_boxes = boxes;
        Ok(())
    }

    /// The stored tree below the triangles.
    fn store_bounds(&mut self) -> Result<(), BackendError> {
        let features = self.features;
        let (floats, quarters) = stored_sizes(&self.frame, features, self.buffers.seams.len());
        let length = |count| usize::try_from(count).unwrap_or(usize::MAX);
        // The old ones go first, so that two need not fit side by side.
        (self.micro_vertices, self.prism_tree) = (Vec::new(), Vec::new());
        let mut micro_vertices = reserved("the micro-vertices", length(floats))?;
        micro_vertices.resize(length(floats), 0.0);
        let mut tree = reserved("the stored bounds", length(quarters))?;
        tree.resize(length(quarters), UVec4::ZERO);
        let layout = Layout::new(self.frame.triangle_count, self.frame.subdivisions);
        let triangles = 0..self.frame.triangle_count;
        if features.bounds == bounds::ALL {
            let view = self.view();
            let store = |i| build::store_micro_vertex(&view, features, i);
            for_each_stored(0..build::micro_vertices(&view), store, |stored| {
                stored.store(&mut micro_vertices)
            });
        }
        self.micro_vertices = micro_vertices;
        let view = self.view();
        for triangle in triangles.clone() {
            build::store_record(build::frame(&view, features, triangle), &mut tree, layout.record(triangle));
        }
        self.prism_tree = tree;
        let (n, levels) = (self.frame.subdivisions, levels(self.frame.subdivisions));
        if levels > 0 {
            let of_heap = build::lowest_nodes(n);
            let mut tree = std::mem::take(&mut self.prism_tree);
            let frames = tree[..layout.heap_node(0, 0) as usize].to_vec();
            let view = SceneView { prism_tree: &frames, ..self.view() };
            let place = |i| layout.heap_node(i / of_heap, heap_nodes(levels - 1) + i % of_heap);
            let lowest = |i| (place(i), build::lowest_node(&view, features, i));
            let count = self.frame.triangle_count * of_heap;
            for_each_stored(0..count, lowest, |(place, node)| node.store(&mut tree, place));
            for level in (0..levels - 1).rev() {
                for triangle in triangles.clone() {
                    for node in heap_nodes(level)..heap_nodes(level + 1) {
                        let inner = build::inner_node(&tree, &layout, triangle, node);
                        inner.store(&mut tree, layout.heap_node(triangle, node));
                    }
                }
            }
            self.prism_tree = tree;
        }
        Ok(())
    }

    /// The stored tree above the triangles.
    fn collapse_bvh(&mut self) {
        if has_tree(&self.frame, self.features) {
            let layout = Layout::new(self.frame.triangle_count, self.frame.subdivisions);
            // A pair has two nodes; those behind the root are pairs.
            let pairs = u32::try_from(self.bvh.nodes.len() / 2).unwrap_or(u32::MAX);
            for pair in 0..pairs {
                let (node, links) = build::collapse(&self.bvh.nodes, &self.bvh.primitives, pair);
                node.store(&mut self.prism_tree, layout.upper_node(pair));
                self.prism_tree[layout.upper_node(pair) as usize + 3] = links;
            }
        }
    }

    /// What the trees are over.
    fn tree_boxes(&self) -> &[Aabb] {
        if is_stored(self.features) { &self.micro_boxes } else { &self.boxes }
    }

    /// Gives the tree the boxes that its triangles have now, or builds it again where that does not do. `start` is when
    /// the work began.
    fn update_bvh(&mut self, start: Instant) {
        // A triangle that was left out may be sound by now, which a refit would not notice.
        let mut trees = std::mem::take(&mut self.trees);
        let boxes = self.tree_boxes();
        let refitted = self.report.left_out == 0
            && trees.iter_mut().all(|MeshTree { primitives, tree, built_cost }| {
                tree.refit(&boxes[primitives.clone()]) && tree.cost() <= MOST_GROWTH * *built_cost
            });
        self.trees = trees;
        if refitted {
            self.join_trees();
            self.report = BuildReport { duration: start.elapsed(), refitted, ..self.report };
        } else {
            self.build_bvh(start);
        }
    }

    /// Builds the tree over the boxes. `start` is when the work began.
    fn build_bvh(&mut self, start: Instant) {
        let of_mesh = |mesh: &Instance| {
            let first = mesh.first_triangle as usize;
            first..first + mesh.triangle_count as usize
        };
        let mut meshes: Vec<_> = instances::meshes(&self.buffers.instances).map(of_mesh).collect();
        if meshes.is_empty() {
            meshes.push(0..self.tree_boxes().len());
        }
        let built = |primitives: Range<usize>| {
            let tree = Hlbvh::build(&self.tree_boxes()[primitives.clone()]);
            MeshTree { built_cost: tree.cost(), primitives, tree }
        };
        self.trees = meshes.into_iter().map(built).collect();
        let nodes = self.join_trees();
        let left_out = self.trees.iter().map(MeshTree::left_out).sum();
        self.report = BuildReport { duration: start.elapsed(), nodes, left_out, refitted: false };
    }

    /// Puts the trees where kernels read them. Returns how many nodes they have together.
    fn join_trees(&mut self) -> u32 {
        let trees: Vec<Bvh> = self.trees.iter().map(|mesh| mesh.tree.tree()).collect();
        for (mesh, tree) in self.trees.iter().zip(&trees) {
            debug_assert_eq!(tree.validate(&self.tree_boxes()[mesh.primitives.clone()]).err(), None);
        }
        let instances = &self.buffers.instances;
        let mut count: usize = trees.iter().map(|tree| tree.nodes.len()).sum();
        if instances.is_empty() {
            self.bvh = trees.into_iter().next().unwrap_or_default();
            self.collapse_bvh();
        } else {
            let bounds: Vec<Aabb> = trees.iter().map(Bvh::bounds).collect();
            let over = instances::tree_over(instances, &bounds);
            let mut nodes = vec![BvhNode::default(); instances::node_room(instances) as usize];
            let mut primitives = vec![0; self.boxes.len()];
            nodes[..over.len()].copy_from_slice(&over);
            for ((instance, mesh), tree) in instances::meshes(instances).zip(&self.trees).zip(&trees) {
                nodes[instance.first_node as usize..][..tree.nodes.len()].copy_from_slice(&tree.nodes);
                primitives[mesh.primitives.clone()].copy_from_slice(&tree.primitives);
            }
            self.bvh = Bvh { nodes, primitives };
            count += over.len();
        }
        u32::try_from(count).unwrap_or(u32::MAX)
    }
}

/// Computes items in parallel, and stores them one after the other, some at a time.
fn for_each_stored<T: Send>(items: Range<u32>, compute: impl Fn(u32) -> T + Sync, mut store: impl FnMut(T)) {
    const AT_A_TIME: u32 = 1 << 18;
    let mut computed = Vec::new();
    let mut first = items.start;
    while first < items.end {
        let end = first.saturating_add(AT_A_TIME).min(items.end);
        (first..end).into_par_iter().map(&compute).collect_into_vec(&mut computed);
        computed.drain(..).for_each(&mut store);
        first = end;
    }
}

/// A copy of the scene, so that the caller's may go.
fn copied_scene(scene: &SceneBuffers) -> Result<SceneBuffers, BackendError> {
    Ok(SceneBuffers {
        vertices: copied("vertices", &scene.vertices)?,
        tangents: copied("tangents", &scene.tangents)?,
        texel_scales: copied("the sizes of texels", &scene.texel_scales)?,
        triangles: copied("triangles", &scene.triangles)?,
        displacements: copied("the height maps", &scene.displacements)?,
        height_texels: copied("the height maps", &scene.height_texels)?,
        seams: copied("the seams", &scene.seams)?,
        seam_sides: copied("the seams", &scene.seam_sides)?,
        color_texels: copied("the colour maps", &scene.color_texels)?,
        materials: copied("the materials", &scene.materials)?,
        lights: copied("lights", &scene.lights)?,
        normal_texels: copied("the normal maps", &scene.normal_texels)?,
        // What is known stands behind the other maps, see `take_distances`.
        distances: Vec::new(),
        instances: copied("the instances", &scene.instances)?,
    })
}

fn copied<T: Copy>(name: &'static str, items: &[T]) -> Result<Vec<T>, BackendError> {
    let mut copy = reserved(name, items.len())?;
    copy.extend_from_slice(items);
    Ok(copy)
}
