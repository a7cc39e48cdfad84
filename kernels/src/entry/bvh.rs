//! Entry points of the BVH's build, in the order in which they are dispatched.

use crate::bvh::top::TopBuffers;
use crate::bvh::{hlbvh, morton, refit, small, top};
use crate::interface::{BATCH_GROUP_SIZE, BuildStep};
use crate::parallel::{Word, Workgroup};
use glam::UVec3;
use spirv_std::{glam, spirv};

/// The number of an invocation in a dispatch of workgroups of [`BATCH_GROUP_SIZE`] along x, in rows along y where
/// there are more than a device takes in one.
#[inline]
fn item(id: UVec3, groups: UVec3) -> u32 {
    id.y * groups.x * BATCH_GROUP_SIZE + id.x
}

/// Reduces the boxes to that of their centres.
#[spirv(compute(threads(128), entry_point_name = "bvh_centers"))]
pub fn bvh_centers(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut morton::BoundsShared,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
) {
    morton::center_bounds(Workgroup::of_invocation(group.x, local), shared, step, boxes, state);
}

/// Writes keys and indices to be sorted.
#[spirv(compute(threads(64), entry_point_name = "bvh_codes"))]
pub fn bvh_codes(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 19)] keys: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 20)] values: &[Word],
) {
    let i = item(id, groups);
    if i < step.count {
        morton::encode(step, boxes, state, keys, values, i);
    }
}

/// Finds where the sorted order splits.
#[spirv(compute(threads(128), entry_point_name = "bvh_levels"))]
pub fn bvh_levels(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut morton::LevelsShared,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 19)] keys: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 26)] levels: &[Word],
) {
    morton::split_levels(Workgroup::of_invocation(group.x, local), shared, step, keys, levels, state);
}

/// Chooses where treelets end, and sets up the top's first task. One invocation.
#[spirv(compute(threads(1), entry_point_name = "bvh_threshold"))]
pub fn bvh_threshold(
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 32)] treelet_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 30)] tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 33)] queues: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 31)] bins: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 35)] small_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 36)] lists: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
) {
    let buffers = TopBuffers {
        state,
        treelets,
        treelet_tasks,
        tasks,
        queues,
        bins,
        small_tasks,
        lists,
        nodes,
        parents,
    };
    hlbvh::choose_threshold(step, &buffers);
}

/// Makes each primitive a treelet.
#[spirv(compute(threads(64), entry_point_name = "bvh_singles"))]
pub fn bvh_singles(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[Word],
) {
    if id.x < step.count {
        hlbvh::emit_single(boxes, treelets, primitives, id.x);
    }
}

/// Flags the last primitive of each treelet, for the scan that numbers them.
#[spirv(compute(threads(64), entry_point_name = "bvh_flags"))]
pub fn bvh_flags(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 26)] levels: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 22)] flags: &[Word],
) {
    let i = item(id, groups);
    if i < step.count {
        hlbvh::flag_treelets(state, levels, flags, i);
    }
}

/// Builds the treelets.
#[spirv(compute(threads(64), entry_point_name = "bvh_treelets"))]
pub fn bvh_treelets(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 20)] order: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 26)] levels: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 22)] treelet_of: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 27)] arrivals: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[Word],
) {
    hlbvh::emit_treelet(
        step,
        boxes,
        state,
        order,
        levels,
        treelet_of,
        arrivals,
        parents,
        treelets,
        nodes,
        primitives,
        item(id, groups),
    );
}

/// Adds the treelets to the top's first task.
#[spirv(compute(threads(64), entry_point_name = "bvh_start"))]
pub fn bvh_start(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 32)] treelet_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 30)] tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 33)] queues: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 31)] bins: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 35)] small_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 36)] lists: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
) {
    let buffers = TopBuffers {
        state,
        treelets,
        treelet_tasks,
        tasks,
        queues,
        bins,
        small_tasks,
        lists,
        nodes,
        parents,
    };
    top::start_treelet(&buffers, id.x);
}

/// Splits the tasks of a level of the top.
#[spirv(compute(threads(128), entry_point_name = "bvh_choose"))]
pub fn bvh_choose(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut top::Shared,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 32)] treelet_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 30)] tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 33)] queues: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 31)] bins: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 35)] small_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 36)] lists: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
) {
    let buffers = TopBuffers {
        state,
        treelets,
        treelet_tasks,
        tasks,
        queues,
        bins,
        small_tasks,
        lists,
        nodes,
        parents,
    };
    // The same for all of a workgroup.
    if group.x < top::task_count(step, state) {
        top::choose(Workgroup::of_invocation(group.x, local), shared, step, &buffers);
    }
}

/// Takes treelets to the tasks of the next level, or to their places.
#[spirv(compute(threads(64), entry_point_name = "bvh_move"))]
pub fn bvh_move(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 32)] treelet_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 30)] tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 33)] queues: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 31)] bins: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 35)] small_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 36)] lists: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
) {
    let buffers = TopBuffers {
        state,
        treelets,
        treelet_tasks,
        tasks,
        queues,
        bins,
        small_tasks,
        lists,
        nodes,
        parents,
    };
    top::move_treelet(step, &buffers, id.x);
}

/// Makes the nodes of small tasks.
#[spirv(compute(threads(96), entry_point_name = "bvh_small"))]
pub fn bvh_small(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut small::Shared,
    #[spirv(push_constant)] step: &BuildStep,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 29)] treelets: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 32)] treelet_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 30)] tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 33)] queues: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 31)] bins: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 35)] small_tasks: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 36)] lists: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
) {
    let buffers = TopBuffers {
        state,
        treelets,
        treelet_tasks,
        tasks,
        queues,
        bins,
        small_tasks,
        lists,
        nodes,
        parents,
    };
    small::split_small_task(Workgroup::of_invocation(group.x, local), shared, step, &buffers);
}

/// Gives a tree whose primitives moved new boxes.
#[spirv(compute(threads(64), entry_point_name = "bvh_refit"))]
pub fn bvh_refit(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 24)] boxes: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 27)] arrivals: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 28)] parents: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] primitives: &[Word],
) {
    refit::refit(boxes, state, arrivals, parents, nodes, primitives, item(id, groups));
}

/// Sums what a tree costs to traverse.
#[spirv(compute(threads(128), entry_point_name = "bvh_costs"))]
pub fn bvh_costs(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] local: u32,
    #[spirv(workgroup)] shared: &mut refit::Shared,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 25)] state: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] nodes: &[Word],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 34)] costs: &[Word],
) {
    refit::sum_costs(Workgroup::of_invocation(group.x, local), shared, state, nodes, costs);
}
