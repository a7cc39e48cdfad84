//! Random prisms and rays for the unit tests of methods.

use crate::displacement::height_pyramid::{build_word, height_bounds, level_words, pyramid_words, top_level};
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::interface::{Displacement, Tangent, displacement_kind, method};
use crate::math::tests::Numbers;
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::test_scene::{FLAT, TestScene};
use glam::Vec3;

/// What [`Prism::view`] is read with, unless vectors displace it.
pub(crate) const FEATURES: Features = Features { method: method::GRID_WALK, ..FLAT };

/// A prism of random shape under a random 16x16 map.
pub(crate) struct Prism {
    pub(crate) scene: TestScene,
    /// What displaces it: see [`displacement_kind`].
    kind: u32,
}

impl Prism {
    /// `spread`: how far vertex normals lean from the triangle's, as a tangent. `relief`: greatest height as a
    /// share of the edges' length.
    pub(crate) fn random(numbers: &mut Numbers, n: u32, spread: f32, relief: f32) -> Self {
        let p = [numbers.vec3(), numbers.vec3(), numbers.vec3()];
        let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
        let mut scene = TestScene::squares(&[0.0]);
        for (vertex, position) in scene.vertices.iter_mut().zip(p) {
            vertex.position = position;
            vertex.normal = (normal + numbers.vec3() * spread).normalize();
            (vertex.u, vertex.v) = (numbers.unit() * 2.0, numbers.unit() * 2.0);
        }
        scene.height_texels = (0..256).map(|_| numbers.unit().to_bits()).collect();
        let map = &mut scene.displacements[0];
        (map.map_width, map.map_height) = (16, 16);
        (map.scale, map.zero) = (relief * (p[1] - p[0]).length(), numbers.unit());
        (map.height_min, map.height_max) = Displacement::height_range(0.0, 1.0, map.zero, map.scale);
        scene.frame.subdivisions = n;
        scene.triangles.truncate(1);
        Prism { scene, kind: displacement_kind::HEIGHT }.prepared()
    }

    /// The same displaced by vectors: two more maps of its map's size, and tangents that lean as normals do, by `spread`.
    pub(crate) fn with_vectors(mut self, numbers: &mut Numbers, kind: u32, spread: f32) -> Self {
        let scene = &mut self.scene;
        for _ in 0..2 {
            let first_word = scene.height_texels.len() as u32;
            scene.height_texels.extend((0..256).map(|_| numbers.unit().to_bits()));
            let first = scene.displacements[0];
            scene.displacements.push(Displacement { first_word, zero: numbers.unit(), ..first });
        }
        let along = scene.vertices[1].position - scene.vertices[0].position;
        let sign = if numbers.unit() < 0.5 { 1.0 } else { -1.0 };
        for vertex in &scene.vertices {
            let tangent = along.normalize() + numbers.vec3() * spread;
            let direction = tangent.reject_from_normalized(vertex.normal).normalize();
            scene.tangents.push(Tangent { direction, sign });
        }
        Prism { kind, ..self }.prepared()
    }

    /// With its pyramids and the bounds on its heights.
    fn prepared(mut self) -> Self {
        let features = self.features();
        let scene = &mut self.scene;
        scene.build_pyramids(features);
        let view = scene.view();
        let field = HeightField::new(&view, features);
        let (low, high) = height_bounds(&field, &scene.vertices, scene.triangles[0]);
        (scene.triangles[0].height_min, scene.triangles[0].height_max) = (low, high);
        self
    }

    /// What its view is read with.
    pub(crate) fn features(&self) -> Features {
        Features { displacement: self.kind, ..FEATURES }
    }

    pub(crate) fn base(&self) -> BaseTriangle {
        BaseTriangle::load(&self.scene.view(), 0)
    }

    pub(crate) fn view(&self) -> SceneView<'_> {
        self.scene.view()
    }

    /// A point over the base triangle, somewhat beyond its rim and its range of heights too.
    fn target(&self, numbers: &mut Numbers) -> Vec3 {
        let base = self.base();
        let (b, c) = (numbers.unit() * 1.4 - 0.2, numbers.unit() * 1.4 - 0.2);
        let w = Vec3::new(1.0 - b - c, b, c);
        let map = &self.scene.displacements[0];
        let h = map.height_min + (map.height_max - map.height_min) * (numbers.unit() * 1.2 - 0.1);
        let n = base.n0 * w.x + base.n1 * w.y + base.n2 * w.z;
        base.p0 * w.x + base.p1 * w.y + base.p2 * w.z + n * h
    }
}

impl TestScene {
    /// Makes the pyramids of all maps, one behind the other.
    pub(crate) fn build_pyramids(&mut self, features: Features) {
        self.height_ranges.clear();
        for map in &mut self.displacements {
            map.first_range = self.height_ranges.len() as u32;
            let words = pyramid_words(features.height_format, map.map_width, map.map_height);
            self.height_ranges.resize((map.first_range + words) as usize, 0);
            for level in 1..=top_level(map.map_width, map.map_height) {
                for item in 0..level_words(features.height_format, map.map_width, map.map_height, level) {
                    build_word(
                        &self.height_texels,
                        &mut self.height_ranges,
                        map,
                        features.height_format,
                        features.height_wrap,
                        level,
                        item,
                    );
                }
            }
        }
    }
}

/// Random rays: from outside, from inside the prism, grazing; with `adversarial` a fifth of them aimed at micro-vertices and
/// micro-edges, and a fifth along the normal, half of these exactly.
pub(crate) fn random_ray(
    prism: &Prism,
    field: &HeightField<'_>,
    numbers: &mut Numbers,
    adversarial: bool,
) -> TraversalRay {
    let mut target = prism.target(numbers);
    let base = prism.base();
    if adversarial && numbers.unit() < 0.2 {
        // A micro-vertex, or the middle of a micro-edge: several micro-triangles are met at once.
        let n = field.subdivisions;
        let j = (numbers.unit() * n as f32) as u32;
        let k = (numbers.unit() * (n - j) as f32) as u32;
        let a = base.micro_vertex(field, j, k);
        let b = base.micro_vertex(field, j, k + 1);
        target = if numbers.unit() < 0.5 { a } else { (a + b) * 0.5 };
    }
    let kind = numbers.unit() * if adversarial { 1.0 } else { 0.8 };
    let origin = if kind < 0.3 {
        target + numbers.vec3() * 10.0
    } else if kind < 0.6 {
        prism.target(numbers)
    } else if kind < 0.8 {
        let along = (base.p1 - base.p0) * numbers.unit() + (base.p2 - base.p0) * numbers.unit();
        target + along * 3.0 + base.n0 * (0.1 * numbers.unit())
    } else {
        let n = (base.n0 + base.n1 * numbers.unit() + base.n2 * numbers.unit()).normalize();
        target + n * 5.0 + numbers.vec3() * if numbers.unit() < 0.5 { 0.0 } else { 0.01 }
    };
    TraversalRay::new(origin, (target - origin).normalize(), f32::INFINITY)
}
