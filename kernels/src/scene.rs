//! What a kernel sees of a scene: slices over the host's buffers.

use crate::interface::{
    BvhNode, Displacement, Frame, Instance, Material, PointLight, SeamSide, Seams, Tangent, TexelScale,
    Triangle, Vertex,
};
use glam::UVec4;

/// The buffers of a scene, as bound by the backend.
#[derive(Clone, Copy)]
pub struct SceneView<'a> {
    /// What all pixels share.
    pub frame: &'a Frame,
    /// Corners of the base mesh.
    pub vertices: &'a [Vertex],
    /// Their tangents; none unless vector displacement is along them.
    pub tangents: &'a [Tangent],
    /// How large texels are at them; none unless maps are filtered by their levels.
    pub texel_scales: &'a [TexelScale],
    /// Base triangles.
    pub triangles: &'a [Triangle],
    /// The BVH, its root first. Of instances the tree over them, then that of each mesh.
    pub nodes: &'a [BvhNode],
    /// Triangle indices in the order of the BVH's leaves, of instances counted from their mesh's first.
    pub primitives: &'a [u32],
    /// How the height maps displace.
    pub displacements: &'a [Displacement],
    /// The height maps.
    pub height_texels: &'a [u32],
    /// Their min/max pyramids.
    pub height_ranges: &'a [u32],
    /// Where neighbours disagree.
    pub seams: &'a [Seams],
    /// The sides of seams.
    pub seam_sides: &'a [SeamSide],
    /// The colour maps.
    pub color_texels: &'a [u32],
    /// What surfaces look like.
    pub materials: &'a [Material],
    /// The lights.
    pub lights: &'a [PointLight],
    /// Maps of normals or of offsets; none unless the method reads them.
    pub normal_texels: &'a [u32],
    /// The instances; none unless [`Features::instances`].
    pub instances: &'a [Instance],
    /// Micro-vertices: three floats each where the method is [`TESSELLATE`](crate::interface::method::TESSELLATE), of a
    /// [stored tree](crate::prism_tree) as its [layout](crate::prism_tree::layout) says; else none.
    pub micro_vertices: &'a [f32],
    /// Distance maps; none unless the method is [`SPHERE`](crate::interface::method::SPHERE).
    pub distances: &'a [f32],
    /// The [stored tree](crate::prism_tree); none unless [`Features::bounds`].
    pub prism_tree: &'a [UVec4],
}

/// The switches that decide which code a pipeline holds: values of the modules in
/// [`interface`](crate::interface). Specialisation constants on Vulkan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// See [`method`](crate::interface::method).
    pub method: u32,
    /// See [`shade`](crate::interface::shade).
    pub shade: u32,
    /// 1 where lights cast shadows.
    pub shadows: u32,
    /// See [`height_format`](crate::interface::height_format).
    pub height_format: u32,
    /// See [`color_format`](crate::interface::color_format).
    pub color_format: u32,
    /// See [`wrap`](crate::interface::wrap).
    pub height_wrap: u32,
    /// See [`wrap`](crate::interface::wrap).
    pub color_wrap: u32,
    /// 1 where work is counted.
    pub counters: u32,
    /// See [`normals`](crate::interface::normals).
    pub normals: u32,
    /// 1 where some triangle has seams.
    pub seams: u32,
    /// 1 where light is reflected by the displaced surface's own normals.
    pub smooth: u32,
    /// See [`displacement_kind`](crate::interface::displacement_kind).
    pub displacement: u32,
    /// See [`filter`](crate::interface::filter).
    pub filter: u32,
    /// 1 where N of each triangle follows its distance to the camera.
    pub adaptive: u32,
    /// 1 where meshes stand in the places of [`Instance`]s, 0 where each triangle stands once, as it is stored.
    pub instances: u32,
    /// What is stored for the exact method: see [`bounds`](crate::interface::bounds).
    pub bounds: u32,
}

impl Features {
    /// The values in the order of the ids in [`spec`](crate::interface::spec).
    pub fn to_array(self) -> [u32; crate::interface::spec::COUNT as usize] {
        [
            self.method,
            self.shade,
            self.shadows,
            self.height_format,
            self.color_format,
            self.height_wrap,
            self.color_wrap,
            self.counters,
            self.normals,
            self.seams,
            self.smooth,
            self.displacement,
            self.filter,
            self.adaptive,
            self.instances,
            self.bounds,
        ]
    }
}
