//! Small scenes for unit tests.

use crate::interface::{
    BvhNode, Camera, Displacement, FLIPPED, Frame, Instance, Material, NO_SEAMS, PointLight, SeamSide, Seams,
    Tangent, TexelScale, Triangle, Vertex, height_format, method,
};
use crate::scene::{Features, SceneView};
use glam::Vec3;

/// The buffers of a scene whose BVH is a single leaf.
#[derive(Clone, Default)]
pub(crate) struct TestScene {
    pub(crate) frame: Frame,
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) tangents: Vec<Tangent>,
    pub(crate) texel_scales: Vec<TexelScale>,
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) nodes: Vec<BvhNode>,
    pub(crate) primitives: Vec<u32>,
    pub(crate) displacements: Vec<Displacement>,
    pub(crate) height_texels: Vec<u32>,
    pub(crate) height_ranges: Vec<u32>,
    pub(crate) seams: Vec<Seams>,
    pub(crate) seam_sides: Vec<SeamSide>,
    pub(crate) color_texels: Vec<u32>,
    pub(crate) materials: Vec<Material>,
    pub(crate) lights: Vec<PointLight>,
    pub(crate) normal_texels: Vec<u32>,
    pub(crate) instances: Vec<Instance>,
    pub(crate) micro_vertices: Vec<f32>,
    pub(crate) distances: Vec<f32>,
    pub(crate) prism_tree: Vec<glam::UVec4>,
}

/// The undisplaced method, lit, without shadows.
pub(crate) const FLAT: Features = Features {
    method: method::NONE,
    shade: crate::interface::shade::LIT,
    shadows: 0,
    height_format: height_format::FLOAT32,
    color_format: crate::interface::color_format::NONE,
    height_wrap: 0,
    color_wrap: 0,
    counters: 0,
    normals: 0,
    seams: 0,
    smooth: 0,
    displacement: 0,
    filter: 0,
    adaptive: 0,
    instances: 0,
    bounds: 0,
};

impl TestScene {
    /// Level squares [-1, 1]² facing +z, one at each of the given heights, under a map of one texel 0.
    pub(crate) fn squares(heights: &[f32]) -> Self {
        let mut scene = TestScene { height_texels: vec![0], ..TestScene::default() };
        for &z in heights {
            let first = scene.vertices.len() as u32;
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let position = Vec3::new(x, y, z);
                scene.vertices.push(Vertex { position, normal: Vec3::Z, u: x, v: y });
            }
            scene.triangles.push(Triangle {
                vertices: [first, first + 1, first + 2],
                seams: NO_SEAMS,
                ..Triangle::default()
            });
            scene.triangles.push(Triangle {
                vertices: [first, first + 2, first + 3],
                seams: NO_SEAMS,
                ..Triangle::default()
            });
        }
        let count = scene.triangles.len() as u32;
        scene.primitives = (0..count).collect();
        scene.nodes.push(BvhNode { min: Vec3::splat(-9.0), first: 0, max: Vec3::splat(9.0), count });
        scene.displacements.push(Displacement { map_width: 1, map_height: 1, ..Displacement::default() });
        scene.materials.push(Material { albedo: Vec3::new(0.5, 0.25, 1.0), ..Material::default() });
        scene.frame = Frame {
            camera: Camera {
                eye: Vec3::new(0.0, 0.0, 5.0),
                right: Vec3::X * 0.1,
                up: Vec3::Y * 0.1,
                forward: -Vec3::Z,
                ..Camera::default()
            },
            subdivisions: 1,
            width: 1,
            height: 1,
            triangle_count: count,
            ..Frame::default()
        };
        scene
    }

    /// Turns every triangle's stored order round, as the host does where indices do not ascend.
    pub(crate) fn flipped(mut self) -> Self {
        for t in &mut self.triangles {
            t.vertices.swap(1, 2);
            t.flags ^= FLIPPED;
        }
        self
    }

    pub(crate) fn with_light(mut self, position: Vec3, intensity: f32) -> Self {
        self.lights.push(PointLight { position, intensity, color: Vec3::ONE, padding: 0 });
        self.frame.light_count = self.lights.len() as u32;
        self
    }

    pub(crate) fn view(&self) -> SceneView<'_> {
        SceneView {
            frame: &self.frame,
            vertices: &self.vertices,
            tangents: &self.tangents,
            texel_scales: &self.texel_scales,
            triangles: &self.triangles,
            nodes: &self.nodes,
            primitives: &self.primitives,
            displacements: &self.displacements,
            height_texels: &self.height_texels,
            height_ranges: &self.height_ranges,
            seams: &self.seams,
            seam_sides: &self.seam_sides,
            color_texels: &self.color_texels,
            materials: &self.materials,
            lights: &self.lights,
            normal_texels: &self.normal_texels,
            instances: &self.instances,
            micro_vertices: &self.micro_vertices,
            distances: &self.distances,
            prism_tree: &self.prism_tree,
        }
    }
}
