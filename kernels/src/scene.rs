//! What a kernel sees of a scene: slices over the host's buffers.

use crate::interface::{BvhNode, Frame, PointLight, Triangle, Vertex};

/// The buffers of a scene, as bound by the backend.
#[derive(Clone, Copy)]
pub struct SceneView<'a> {
    /// What all pixels share.
    pub frame: &'a Frame,
    /// Corners of the base mesh.
    pub vertices: &'a [Vertex],
    /// Base triangles.
    pub triangles: &'a [Triangle],
    /// The BVH, its root first.
    pub nodes: &'a [BvhNode],
    /// Triangle indices in the order of the BVH's leaves.
    pub primitives: &'a [u32],
    /// The height map.
    pub height_texels: &'a [u32],
    /// The colour map.
    pub color_texels: &'a [u32],
    /// The lights.
    pub lights: &'a [PointLight],
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
        ]
    }
}
