//! A relief whose hits are known in closed form: a slope over a level square.

use crate::counters::Counts;
use crate::displacement::height_pyramid::{build_word, level_words, pyramid_words, top_level};
use crate::interface::{Intersection, MISS, Ray, height_format, wrap};
use crate::math::tests::Numbers;
use crate::render::trace_ray;
use crate::scene::Features;
use crate::test_scene::{FLAT, TestScene};
use glam::{DVec3, Vec3};

/// How far heights reach.
pub(crate) const TOP: f32 = 0.25;
/// How fast they rise along x: z = SLOPE (1 + x).
pub(crate) const SLOPE: f64 = 0.125;

/// The square [-1, 1]² facing +z under a map of two texels, 0 and 1, between whose centres it lies; N is `n`.
pub(crate) fn ramp(n: u32) -> TestScene {
    let mut scene = TestScene::squares(&[0.0]);
    let map = &mut scene.displacements[0];
    (map.map_width, map.scale, map.height_max) = (2, TOP, TOP);
    scene.height_texels = vec![0.0_f32.to_bits(), 1.0_f32.to_bits()];
    scene.vertices.iter_mut().for_each(|vertex| vertex.u = 0.5 + vertex.position.x * 0.25);
    scene.frame.subdivisions = n;
    scene
}

/// Rays from above and from below that meet square and ramp well within their borders, none at less than 30 degrees.
pub(crate) fn rays() -> Vec<Ray> {
    let mut numbers = Numbers::new(31);
    let ray = |i: usize| {
        let side = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let target = numbers.vec3() * Vec3::new(0.4, 0.4, 0.0);
        let direction = numbers.vec3() * Vec3::new(1.2, 1.2, 0.0) - Vec3::Z * side;
        Ray { origin: target - direction * (1.0 + numbers.unit()), t_max: 1e9, direction, padding: 0 }
    };
    (0..200).map(ray).collect()
}

/// Where a ray meets the ramp, in `f64`.
pub(crate) fn exact(ray: &Ray) -> f64 {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    (SLOPE * (1.0 + o.x) - o.z) / (d.z - SLOPE * d.x)
}

/// What a method finds of a ray, which must hit.
pub(crate) fn found(scene: &TestScene, method: u32, ray: &Ray) -> Intersection {
    let features = Features { method, ..FLAT };
    let hit = trace_ray(&scene.view(), features, *ray, &mut Counts::default());
    assert!(hit.primitive != MISS, "{ray:?}");
    hit
}

/// How much of a unit of t a ray takes to climb by a height.
pub(crate) fn time_of(height: f32, ray: &Ray) -> f64 {
    f64::from(height) / f64::from(ray.direction.z.abs())
}

/// Asserts that a hit's point, normal and texture coordinates are those of the ramp where the hit says that it is.
pub(crate) fn assert_on_ray(hit: &Intersection, ray: &Ray) {
    let point = ray.origin.as_dvec3() + ray.direction.as_dvec3() * f64::from(hit.t);
    // Coordinates are below 4, and of some ten roundings.
    assert!(point.distance(hit.point.as_dvec3()) < 4e-6, "{point} {hit:?}");
    assert!((f64::from(hit.u) - (0.5 + point.x * 0.25)).abs() < 2e-6, "{point} {hit:?}");
    assert!((f64::from(hit.v) - point.y).abs() < 4e-6, "{point} {hit:?}");
    let normal = DVec3::new(-SLOPE, 0.0, 1.0).normalize();
    assert!(normal.distance(hit.normal.as_dvec3()) < 1e-6, "{hit:?}");
}

/// The scene with the pyramid of its map.
pub(crate) fn with_pyramid(mut scene: TestScene) -> TestScene {
    let (map, format) = (scene.displacements[0], height_format::FLOAT32);
    let (width, height) = (map.map_width, map.map_height);
    scene.height_ranges = vec![0; pyramid_words(format, width, height) as usize];
    for level in 1..=top_level(width, height) {
        for item in 0..level_words(format, width, height, level) {
            let (texels, ranges) = (&scene.height_texels, &mut scene.height_ranges);
            build_word(texels, ranges, &map, format, wrap::REPEAT, level, item);
        }
    }
    scene
}
