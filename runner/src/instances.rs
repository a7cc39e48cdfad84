//! Instances on the host: their transforms, the room of their meshes' trees, and the tree over them.
//!
//! Nodes lie in one buffer: first those of the tree over the instances, 2 i - 1 for i of them, then 2 m - 1 for each
//! mesh of m triangles, in the order of the instances. Both trees may have fewer; what is left is not read.

use crate::bvh::{Hlbvh, HostAabb};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::instance::MARGIN;
use emboss_kernels::interface::{BvhNode, Instance};
use emboss_kernels::math::{next_down, next_up};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// A mesh that is part of a scene's mesh, and where it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// How many of the triangles are its, behind those of the parts before.
    pub triangle_count: u32,
    /// From its own space to the world, at least one.
    pub places: Vec<DAffine3>,
}

/// Transforms that stretch a mesh more unevenly are refused: the square of that is computed with.
const MOST_STRETCH: f32 = 1e9;

/// Lengths to which transforms may take unit vectors: powers and products of them are within a float's range.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-30..=1e30;

/// The instance of a mesh in a place; `None` where floats cannot compute with the transform: it takes some direction to
/// nothing or beyond their range, or shears more than [`Instance::MOST_SHEAR`]. Its mesh is yet to be named.
pub fn placed(world_from_object: DAffine3) -> Option<Instance> {
    let rows = rows(world_from_object);
    let stored = affine(rows);
    let inverse = stored.inverse();
    let squares = stored.matrix3.transpose() * stored.matrix3;
    // The greatest singular value is at most the root of this, and equal to it where columns are at right angles.
    let [longest, shortest] = [squares, squares.inverse()].map(|m| most_row_sum(magnitudes(m)).sqrt());
    let in_range = LENGTHS.contains(&longest) && LENGTHS.contains(&(1.0 / shortest));
    if !in_range || !stored.translation.is_finite() {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, reason = "rounded, and then upwards")]
    let stretch = next_up((longest * shortest) as f32);
    let instance = Instance {
        world_from_object: rows,
        object_from_world: self::rows(inverse),
        stretch,
        ..Instance::default()
    };
    let finite = instance.object_from_world.as_flattened().iter().all(|x| x.is_finite());
    let back = magnitudes(affine(instance.object_from_world).matrix3);
    let shear = most_row_sum(magnitudes(stored.matrix3) * back);
    (finite && stretch <= MOST_STRETCH && shear <= Instance::MOST_SHEAR).then_some(instance)
}

/// The instances of all parts, in their order, each part's in its own; the index of the part whose transform does not
/// do where there is one.
///
/// # Errors
/// Which part has a place that [`placed`] does not take.
pub fn instances(parts: &[Part]) -> Result<Vec<Instance>, usize> {
    let count: usize = parts.iter().map(|part| part.places.len()).sum();
    let mut instances = Vec::with_capacity(count);
    let (mut first_node, mut first_triangle) = (room(count), 0);
    for (i, part) in parts.iter().enumerate() {
        let triangle_count = part.triangle_count;
        for &place in &part.places {
            let instance = placed(place).ok_or(i)?;
            instances.push(Instance { first_node, first_triangle, triangle_count, ..instance });
        }
        first_triangle += triangle_count;
        if !part.places.is_empty() {
            first_node = first_node.saturating_add(room(triangle_count as usize));
        }
    }
    Ok(instances)
}

/// The first instance of each mesh.
pub fn meshes(instances: &[Instance]) -> impl Iterator<Item = &Instance> {
    instances.chunk_by(|a, b| a.first_node == b.first_node).filter_map(<[_]>::first)
}

/// How many nodes all trees have room for.
pub fn node_room(instances: &[Instance]) -> u32 {
    let end = |last: &Instance| last.first_node.saturating_add(room(last.triangle_count as usize));
    instances.last().map_or(0, end)
}

/// Whether nodes lie as they should, each mesh in an own range of the first `triangles` triangles.
pub fn are_sound(instances: &[Instance], triangles: u32) -> bool {
    let (mut next_node, mut next_triangle) = (room(instances.len()), 0);
    meshes(instances).all(|mesh| {
        let end = mesh.first_triangle.checked_add(mesh.triangle_count);
        let fits = mesh.first_node == next_node
            && mesh.first_triangle >= next_triangle
            && end.is_some_and(|end| end <= triangles);
        next_node = next_node.saturating_add(room(mesh.triangle_count as usize));
        next_triangle = end.unwrap_or(u32::MAX);
        fits && next_node < u32::MAX
    }) && instances.windows(2).all(|pair| {
        pair[0].first_node != pair[1].first_node
            || (pair[0].first_triangle, pair[0].triangle_count)
                == (pair[1].first_triangle, pair[1].triangle_count)
    })
}

/// Nodes of a tree over `count` boxes.
fn room(count: usize) -> u32 {
    u32::try_from(2 * count.max(1) - 1).unwrap_or(u32::MAX)
}

/// The box in the world of what lies in `bounds` in an instance's object space; empty where that is.
pub fn world_box(instance: &Instance, bounds: Aabb) -> Aabb {
    if !bounds.min.cmple(bounds.max).all() {
        return Aabb::EMPTY;
    }
    // Where the ray in object space is what the surface is met by, the inverse of its transform is the one that counts.
    let world_from_object = affine(instance.object_from_world).inverse();
    let corners = bounds.corners().map(|corner| world_from_object.transform_point3(corner.as_dvec3()));
    let [min, max] =
        [DVec3::min, DVec3::max].map(|choose| corners.into_iter().reduce(choose).unwrap_or_default());
    let reach = min.abs().max(max.abs()).max_element() + world_from_object.translation.abs().max_element();
    let margin = DVec3::splat(f64::from(MARGIN) * reach);
    let outwards = |p: DVec3, next: fn(f32) -> f32| Vec3::from(p.as_vec3().to_array().map(next));
    Aabb { min: outwards(min - margin, next_down), max: outwards(max + margin, next_up) }
}

/// Up to so many boxes are taken to the world one by one, which takes some milliseconds.
const MOST_BOXES: usize = 1 << 16;

/// The boxes of an instance's mesh, of those of all triangles.
pub fn boxes_of<'a>(instance: &Instance, boxes: &'a [Aabb]) -> &'a [Aabb] {
    &boxes[instance.first_triangle as usize..][..instance.triangle_count as usize]
}

/// Boxes around all that is shown: those of the triangles of each instance, or where that is too many those of the
/// instances. `boxes` are those of the triangles in their own spaces.
pub fn world_boxes(instances: &[Instance], boxes: &[Aabb]) -> Vec<Aabb> {
    let shown: usize = instances.iter().map(|instance| instance.triangle_count as usize).sum();
    let in_world = |instance: &Instance| -> Vec<Aabb> {
        let boxes = boxes_of(instance, boxes);
        if shown <= MOST_BOXES {
            boxes.iter().map(|&bounds| world_box(instance, bounds)).collect()
        } else {
            let whole = boxes.iter().copied().reduce(Aabb::union);
            whole.map(|whole| world_box(instance, whole)).into_iter().collect()
        }
    };
    instances.iter().flat_map(in_world).collect()
}

/// The tree over the instances, whose meshes lie in `mesh_bounds`, in the order of [`meshes`]. Instances of nothing are
/// left out. It is built by the kernels of the meshes' trees.
pub fn tree_over(instances: &[Instance], mesh_bounds: &[Aabb]) -> Vec<BvhNode> {
    let meshes = instances.chunk_by(|a, b| a.first_node == b.first_node).zip(mesh_bounds);
    let boxes: Vec<Aabb> = meshes
        .flat_map(|(instances, &bounds)| instances.iter().map(move |instance| world_box(instance, bounds)))
        .collect();
    let tree = Hlbvh::build(&boxes).tree();
    let mut nodes = tree.nodes;
    for leaf in nodes.iter_mut().filter(|node| node.count > 0) {
        // A leaf of that builder has one primitive.
        leaf.first = tree.primitives[leaf.first as usize];
    }
    nodes
}

/// The rows of a transform, rounded.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn rows(transform: DAffine3) -> [[f32; 4]; 3] {
    let (m, t) = (transform.matrix3.transpose(), transform.translation);
    let row = |r: DVec3, t: f64| [r.x, r.y, r.z, t].map(|x| x as f32);
    [row(m.x_axis, t.x), row(m.y_axis, t.y), row(m.z_axis, t.z)]
}

/// The transform of rows.
fn affine(rows: [[f32; 4]; 3]) -> DAffine3 {
    let [x, y, z] = rows.map(|row| row.map(f64::from));
    let matrix =
        DMat3::from_cols([x[0], x[1], x[2]].into(), [y[0], y[1], y[2]].into(), [z[0], z[1], z[2]].into());
    DAffine3::from_mat3_translation(matrix.transpose(), DVec3::new(x[3], y[3], z[3]))
}

fn magnitudes(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs())
}

/// Of a matrix without negative elements.
fn most_row_sum(m: DMat3) -> f64 {
    let sums = m.x_axis + m.y_axis + m.z_axis;
    // NaN, of a matrix without inverse, must not be lost.
    if sums.is_nan() { f64::NAN } else { sums.max_element() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn turned() -> DQuat {
        DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -3.0).normalize(), 0.8)
    }

    #[test]
    fn stretch_is_the_ratio_of_greatest_and_least_length() {
        let stretch = |matrix: DMat3| placed(DAffine3::from_mat3(matrix)).expect("invertible").stretch;
        let scaled = DMat3::from_quat(turned()) * DMat3::from_diagonal(DVec3::new(-2.0, 16.0, 4.0));
        // Entries of the matrix are rounded to f32 first.
        assert!((8.0..8.00001).contains(&stretch(scaled)), "{}", stretch(scaled));
        assert!((1.0..1.000001).contains(&stretch(DMat3::IDENTITY)));
        // Singular values of a shear by 1/2 are those of [[1, 1/2], [0, 1]]: (sqrt(17) +- 1) / 4.
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z);
        let exact = (17_f32.sqrt() + 1.0) / (17_f32.sqrt() - 1.0);
        assert!((exact..1.2 * exact).contains(&stretch(shear)), "{}", stretch(shear));
    }

    #[test]
    fn world_boxes_hold_the_transformed_corners_and_little_more() {
        let scale = DVec3::new(3.0, -1e-2, 0.5);
        let place = DAffine3::from_scale_rotation_translation(scale, turned(), DVec3::splat(7.0));
        let instance = placed(place).expect("invertible");
        let bounds = Aabb { min: Vec3::new(-1.0, -2.0, 0.0), max: Vec3::new(1.0, 5.0, 0.0) };
        let world = world_box(&instance, bounds);
        let corners = bounds.corners().map(|corner| place.transform_point3(corner.as_dvec3()).as_vec3());
        let tight = corners.into_iter().fold(Aabb::EMPTY, Aabb::including);
        assert!(world.contains(tight) && tight.padded(4e-4).contains(world), "{tight:?} {world:?}");
        assert_eq!(world_box(&instance, Aabb::EMPTY), Aabb::EMPTY);
    }

    #[test]
    fn broken_layouts_are_noticed() {
        let part = |triangle_count, places| Part { triangle_count, places: vec![DAffine3::IDENTITY; places] };
        let sound = instances(&[part(4, 2), part(3, 1)]).expect("invertible");
        assert_eq!(
            sound.iter().map(|i| (i.first_node, i.first_triangle)).collect::<Vec<_>>(),
            [(5, 0), (5, 0), (12, 4)]
        );
        assert_eq!(node_room(&sound), 17);
        assert!(are_sound(&sound, 7) && !are_sound(&sound, 6));
        let breaks: [fn(&mut Vec<Instance>); 5] = [
            |instances| instances[2].first_node = 11,
            |instances| instances[2].first_triangle = 3,
            |instances| instances[1].first_triangle = 1,
            |instances| instances[2].triangle_count = u32::MAX,
            |instances| instances.truncate(1),
        ];
        for (i, fault) in breaks.into_iter().enumerate() {
            let mut broken = sound.clone();
            fault(&mut broken);
            assert!(!are_sound(&broken, 7), "fault {i}");
        }
    }
}
