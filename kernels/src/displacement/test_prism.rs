//! Random prisms and rays for the unit tests of methods.

use crate::displacement::height_pyramid::{build_word, height_bounds, level_words, pyramid_words, top_level};
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::interface::{
    Displacement, Tangent, TexelScale, displacement_kind, filter, height_format, method, wrap,
};
use crate::math::tests::Numbers;
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::test_scene::{FLAT, TestScene};
use crate::texture::{HeightTexels, Level, LevelOfDetail};
use glam::{Vec2, Vec3};

/// What [`Prism::view`] is read with, unless vectors displace it.
pub(crate) const FEATURES: Features = Features { method: method::GRID_WALK, ..FLAT };

/// A prism of random shape under a random 16x16 map.
pub(crate) struct Prism {
    pub(crate) scene: TestScene,
    /// What displaces it: see [`displacement_kind`].
    kind: u32,
    /// How its maps are read: see [`filter`].
    filter: u32,
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
        Prism { scene, kind: displacement_kind::HEIGHT, filter: filter::BILINEAR }.prepared()
    }

    /// The same displaced by vectors: two more maps of its map's size, and tangents that lean as normals do, by
    /// `spread`.
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

    /// The same with the levels of its maps, seen from so far away that some of them are read.
    pub(crate) fn filtered(mut self, numbers: &mut Numbers) -> Self {
        let features = self.features();
        let scene = &mut self.scene;
        let texels = std::mem::take(&mut scene.height_texels);
        for map in &mut scene.displacements {
            let first = map.first_word as usize;
            map.first_word = scene.height_texels.len() as u32;
            scene.height_texels.extend(&texels[first..first + 256]);
            map.roughness = append_levels(&mut scene.height_texels, map.first_word);
        }
        let edge = (scene.vertices[1].position - scene.vertices[0].position).length();
        let wide = |numbers: &mut Numbers| (numbers.unit() * 8.0 - 6.0).exp2();
        let scale = |numbers: &mut Numbers| TexelScale {
            size: edge * wide(numbers) * 0.1,
            span: [1.0, 2.0, 4.0, 8.0][(numbers.unit() * 4.0) as usize],
        };
        scene.texel_scales = (0..scene.vertices.len()).map(|_| scale(numbers)).collect();
        scene.frame.camera.eye = scene.vertices[0].position + numbers.vec3() * (edge * 4.0 * wide(numbers));
        scene.frame.camera.up = Vec3::Y * wide(numbers);
        // Also triangles that are no larger than some texels.
        let shrunk = wide(numbers).min(1.0);
        for vertex in &mut scene.vertices {
            (vertex.u, vertex.v) = (vertex.u * shrunk, vertex.v * shrunk);
        }
        let maps = &scene.displacements;
        let greatest = |map: &Displacement| map.height_min.abs().max(map.height_max.abs());
        (scene.frame.height_min, scene.frame.height_max) =
            if features.displacement == displacement_kind::HEIGHT {
                (maps[0].height_min, maps[0].height_max)
            } else {
                (0.0, Vec3::new(greatest(&maps[0]), greatest(&maps[1]), greatest(&maps[2])).length())
            };
        Prism { filter: filter::TRILINEAR, ..self }.prepared()
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
        Features { displacement: self.kind, filter: self.filter, ..FEATURES }
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

/// Appends the levels of the 16x16 map at the end of `texels`; returns its roughness where it repeats.
fn append_levels(texels: &mut Vec<u32>, first_word: u32) -> f32 {
    let mut side = 16;
    let mut finer = first_word as usize;
    while side > 1 {
        let next = texels.len();
        side /= 2;
        for i in 0..side * side {
            let (x, y) = (2 * (i % side), 2 * (i / side));
            let texel = |x: usize, y: usize| f32::from_bits(texels[finer + y * 2 * side + x]);
            let mean = (texel(x, y) + texel(x + 1, y) + texel(x, y + 1) + texel(x + 1, y + 1)) * 0.25;
            texels.push(mean.to_bits());
        }
        finer = next;
    }
    // Texel centres lie on quarters of texels at the most, between which all levels are bilinear.
    let map = HeightTexels { texels, format: height_format::FLOAT32, wrap: wrap::REPEAT, first_word };
    let finest = Level::finest(16, 16);
    let mut roughness = 0.0_f32;
    for i in 0..32 * 32 {
        let uv = Vec2::new((i % 32) as f32, (i / 32) as f32) / 32.0;
        for width in [2.0, 4.0, 8.0, 16.0] {
            let difference = map.sample(finest, uv, LevelOfDetail::new(width))
                - map.sample(finest, uv, LevelOfDetail::FINEST);
            roughness = roughness.max(difference.abs() / width);
        }
    }
    roughness
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

/// Random rays: from outside, from inside the prism, grazing; with `adversarial` a fifth of them aimed at
/// micro-vertices and micro-edges, and a fifth along the normal, half of these exactly.
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
