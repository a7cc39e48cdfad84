//! Methods in image space: what they find where the answer is known, and what is left of the base mesh.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::framing::View;
use emboss::normal_maps::OffsetMap;
use emboss::render::{RenderError, Scene, prepare};
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{DisplacementKind, Light, Method, Settings, Shade};
use emboss_kernels::interface::{Intersection, Ray, Vertex, height_format};
use emboss_tests::Numbers;
use emboss_tests::compare::rendered;
use emboss_tests::instances::{placed, rotation, world_ray};
use emboss_tests::scenes::{IMAGE_SPACE, builtin_scene, job};
use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};
use std::f64::consts::TAU;
use std::path::Path;

/// Texels of a side of the waves' map.
const SIDE: u32 = 1024;
/// Height of the waves from trough to crest, on a square of side 1.
const HEIGHT: f32 = 0.08;

/// The square [0, 1]² facing +z, its texture coordinates x and y, under waves in both directions around it.
#[expect(clippy::cast_possible_truncation, reason = "texels are stored in single precision")]
fn waves() -> Scene {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let vertex = |(u, v)| Vertex { position: Vec3::new(u, v, 0.0), u, normal: Vec3::Z, v };
    let wave = |i: u32| (4.0 * TAU * (f64::from(i) + 0.5) / f64::from(SIDE)).sin();
    let texel = |x: u32, y: u32| (0.5 + 0.25 * (wave(x) + wave(SIDE - 1 - y))) as f32;
    let texels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| texel(x, y).to_bits())).collect();
    let map = HeightMap {
        width: SIDE,
        height: SIDE,
        format: height_format::FLOAT32,
        texels,
        range: (0.0, 1.0),
        replaced: 0,
    };
    Scene {
        mesh: Mesh::from_triangles(&corners.map(vertex), &[[0, 1, 2], [0, 2, 3]]),
        reliefs: vec![Relief::new(map, 0.5, HEIGHT)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 1,
    }
}

/// The bilinear filter over the waves' map, in `f64`.
#[expect(clippy::cast_possible_truncation, reason = "indices of texels of a small map")]
fn height(texels: &[u32], p: DVec2) -> f64 {
    let side = i64::from(SIDE);
    let (x, y) = (p.x * side as f64 - 0.5, (1.0 - p.y) * side as f64 - 0.5);
    let texel = |i: i64, j: i64| {
        let index = j.rem_euclid(side) * side + i.rem_euclid(side);
        f64::from(f32::from_bits(texels[index as usize]))
    };
    let (i, j) = (x.floor() as i64, y.floor() as i64);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let row = |j| texel(i, j) * (1.0 - fx) + texel(i + 1, j) * fx;
    f64::from(HEIGHT) * (row(j) * (1.0 - fy) + row(j + 1) * fy - 0.5)
}

/// Where a ray meets the waves: it is steeper than these, so that it does once.
fn root(texels: &[u32], ray: &Ray) -> f64 {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let outside = |t: f64| {
        let p: DVec3 = o + d * t;
        (p.z - height(texels, p.truncate())) * -d.z > 0.0
    };
    let reach = f64::from(HEIGHT);
    let (mut near, mut far) = ((-o.z - reach) / d.z, (reach - o.z) / d.z);
    if near > far {
        (near, far) = (far, near);
    }
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if outside(middle) { near = middle } else { far = middle }
    }
    far
}

/// Rays from either side at 45 degrees and more, through the middle of the square.
fn steep_rays(count: usize) -> Vec<Ray> {
    let mut numbers = Numbers::new(70);
    let ray = |i: usize| {
        let side = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let target = Vec3::new(numbers.between(0.3, 0.7), numbers.between(0.3, 0.7), 0.0);
        let direction = Vec3::new(numbers.between(-0.7, 0.7), numbers.between(-0.7, 0.7), side);
        Ray { origin: target - direction * 0.2, t_max: f32::INFINITY, direction, padding: 0 }
    };
    (0..count).map(ray).collect()
}

fn hits(scene: Scene, method: Method, rays: &[Ray]) -> Vec<Intersection> {
    hits_with(scene, Settings { method, ..Settings::default() }, rays)
}

fn hits_with(scene: Scene, settings: Settings, rays: &[Ray]) -> Vec<Intersection> {
    let job = job(scene, &Settings { width: 1, height: 1, ..settings });
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// How far in height hits of a method are behind where their rays meet the waves, by N.
fn signed_errors(method: Method, n: u32) -> Vec<f64> {
    let scene = Scene { subdivisions: n, ..waves() };
    let texels = scene.reliefs[0].map.texels.clone();
    let rays = steep_rays(400);
    let found = hits(scene, method, &rays);
    let error = |(ray, hit): (&Ray, &Intersection)| {
        // Directions have a height of 1.
        let error = f64::from(hit.t) - root(&texels, ray);
        // It is the point of the ray, and where the map is read.
        let point = ray.origin + ray.direction * hit.t;
        assert!(point.distance(hit.point) < 1e-6, "{ray:?} {hit:?}");
        assert!((point.x - hit.u).abs().max((point.y - hit.v).abs()) < 1e-6, "{ray:?} {hit:?}");
        error
    };
    rays.iter().zip(&found).map(error).collect()
}

/// The mean and the greatest distance between them.
fn errors(method: Method, n: u32) -> (f64, f64) {
    let errors: Vec<f64> = signed_errors(method, n).into_iter().map(f64::abs).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64, errors.iter().copied().fold(0.0, f64::max))
}

/// Numbers of layers, each twice the one before.
const LAYERS: [u32; 4] = [4, 8, 16, 32];
/// What rounding can move a hit by, in heights: coordinates of rays and maps are below 1, and some 20 roundings off.
const ROUNDING: f64 = 20.0 * 6e-8;

/// The heights of a layer.
fn layer(n: u32) -> f64 {
    f64::from(HEIGHT) / f64::from(n)
}

/// Of first order: half a layer on average, as a place anywhere within one is, and never more than one.
#[test]
fn steep_converges_by_the_layer() {
    for n in LAYERS {
        let errors = signed_errors(Method::Steep, n);
        // Never in front of the waves.
        let is_behind = |&error: &f64| error > -ROUNDING && error < layer(n) + ROUNDING;
        assert!(errors.iter().all(is_behind), "N = {n}: {errors:?}");
        // The mean of 400 such places is off by 3 % (its standard deviation times two).
        let share = errors.iter().sum::<f64>() / errors.len() as f64 / layer(n);
        assert!((0.46..0.54).contains(&share), "N = {n}: {share} of a layer");
    }
}

/// 2^-8 of that.
#[test]
fn relief_converges_by_a_part_of_the_layer() {
    for n in LAYERS {
        let (mean, greatest) = errors(Method::Relief, n);
        let part = layer(n) / 256.0;
        assert!(greatest < part + ROUNDING, "N = {n}: {greatest}");
        assert!(mean > 0.3 * part - ROUNDING, "N = {n}: {mean} is too good for {part}");
    }
}

/// Of second order: a line between two heights is off by the square of their distance, times curvature.
#[test]
fn occlusion_converges_by_the_layers_square() {
    let means = LAYERS.map(|n| errors(Method::Occlusion, n).0);
    for pair in means.windows(2) {
        let ratio = pair[0] / pair[1];
        // 4 where layers are thin; with 4 of them the ray moves by a twelfth of a wave between two, where the next
        // order is a tenth.
        assert!((3.4..4.6).contains(&ratio), "{means:?}");
    }
    // Curvature times an eighth of the distance's square: waves of amplitude HEIGHT / 4 in two directions, at right
    // angles twice that, along a ray of at most 45 degrees.
    let curvature = 0.25 * f64::from(HEIGHT) * (4.0 * TAU).powi(2);
    for (n, mean) in LAYERS.into_iter().zip(means) {
        assert!(mean < curvature * layer(n).powi(2) / 8.0, "N = {n}: {means:?}");
    }
}

/// The exact method's micro-triangles are on the way to the same surface: what the others converge to.
#[test]
fn the_exact_method_converges_to_the_same_waves() {
    let (mean, greatest) = errors_of_exact(512);
    // An edge of 1/512 (sqrt(2) along the diagonal) under the curvature of both waves, twice over: by triangles and by
    // texels.
    let curvature = 0.25 * f64::from(HEIGHT) * (4.0 * TAU).powi(2) * 2.0;
    let bound = 2.0 * curvature * 2.0 / 512.0_f64.powi(2) / 8.0 / (1.0 - 0.71);
    assert!(greatest < bound + ROUNDING, "{greatest} {mean} {bound}");
}

fn errors_of_exact(n: u32) -> (f64, f64) {
    errors(Method::Quadtree, n)
}

/// Whatever a method finds, it is seen where the base mesh is, and nowhere else.
#[test]
fn outlines_are_the_base_meshs() {
    let (scene, settings) = builtin_scene("builtin:cube", 8, 64, 48);
    let coverage = |method| {
        let picture = rendered(
            &mut CpuBackend::new(),
            &job(scene.clone(), &Settings { method, ..settings.clone() }),
            1,
        );
        picture.pixels.iter().map(|pixel| pixel.w).collect::<Vec<_>>()
    };
    let flat = coverage(Method::None);
    for method in IMAGE_SPACE {
        assert!(!method.changes_silhouette());
        assert_eq!(coverage(method), flat, "{method}");
    }
    assert!(Method::Quadtree.changes_silhouette());
}

/// A mesh in its place shows what it shows by itself, to a ray that is taken there.
#[test]
fn instances_show_what_their_mesh_does() {
    let mut numbers = Numbers::new(9);
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, 0.5, 3.0),
        rotation(&mut numbers),
        DVec3::new(0.3, -0.2, 0.4),
    );
    let rays = steep_rays(200);
    let moved: Vec<Ray> = rays.iter().map(|ray| world_ray(place, ray)).collect();
    for method in [Method::ParallaxLimited, Method::Relief, Method::Occlusion] {
        let alone = hits(Scene { subdivisions: 16, ..waves() }, method, &rays);
        let instances = hits(Scene { subdivisions: 16, ..placed(waves(), vec![place]) }, method, &moved);
        for ((ray, alone), hit) in moved.iter().zip(&alone).zip(&instances) {
            // Rays in the world have lengths of their own; points need none.
            let expected = place.transform_point3(alone.point.as_dvec3());
            assert!(expected.distance(hit.point.as_dvec3()) < 1e-5, "{method} {ray:?}: {hit:?} {expected}");
            let normal = place.matrix3.inverse().transpose() * alone.normal.as_dvec3();
            assert!(normal.normalize().distance(hit.normal.as_dvec3()) < 1e-3, "{method} {ray:?}: {hit:?}");
        }
    }
}

#[test]
fn vectors_and_adaptive_n_are_refused() {
    for method in IMAGE_SPACE {
        let auto = Settings { method, adaptive: Some(1.0), ..Settings::default() };
        let refused = prepare(Scene { subdivisions: 16, ..waves() }, &auto).expect_err("one N is asked for");
        assert!(matches!(refused, RenderError::MethodOfAuto { .. }), "{refused}");
        assert!(refused.to_string().contains(&format!("--method {method} ")), "{refused}");
        let vectors = Settings { method, displacement: DisplacementKind::Object, ..Settings::default() };
        let refused = prepare(waves(), &vectors).expect_err("heights are asked for");
        assert!(matches!(refused, RenderError::MethodOfVectors { .. }), "{refused}");
    }
}

/// What the maps that are made from heights say of them: as these are between two texels, on a surface of one size of
/// texels.
#[test]
fn maps_made_from_heights_lean_as_these_do() {
    let rays = steep_rays(300);
    let k = 4.0 * TAU;
    // Height of the waves in one direction.
    let amplitude = 0.25 * f64::from(HEIGHT);
    for (method, exaggeration) in
        [(Method::BumpOffset, 1.0), (Method::NormalMap, 1.0), (Method::NormalMap, -2.5)]
    {
        let mut scene = waves();
        scene.reliefs[0].scale *= exaggeration;
        for (ray, hit) in rays.iter().zip(hits(scene, method, &rays)) {
            let slope = |x: f32| f64::from(exaggeration) * amplitude * k * (k * f64::from(x)).cos();
            let normal = DVec3::new(-slope(hit.u), -slope(hit.v), 1.0).normalize();
            // Differences over two texels miss a slope by (k / 1024)² / 6 of it, lines between them by 1/8 of that
            // square, and 16 bits by 2^-15.
            let bound = (0.3 * (k / f64::from(SIDE)).powi(2) + 3e-5) * f64::from(exaggeration.abs()) + 1e-6;
            assert!(
                normal.distance(hit.normal.as_dvec3()) < 2.0 * bound,
                "{method} {ray:?}: {hit:?} {normal}"
            );
        }
    }
}

/// An offset map out of a file shows what the one does that is made from the heights: floats to the bit, 16 bits to
/// half a code of each texel.
#[test]
fn offset_maps_are_what_heights_grow_by() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = waves();
    let map = &scene.reliefs[0].map;
    let texel = |x: u32, y: u32| map.texel(x % SIDE, y % SIDE);
    let offsets = |x: u32, y: u32| {
        let (along_row, down) =
            (texel(x + 1, y) - texel(x + SIDE - 1, y), texel(x, y + 1) - texel(x, y + SIDE - 1));
        [0.5 * along_row, -0.5 * down, 0.0]
    };
    let floats = image::Rgb32FImage::from_fn(SIDE, SIDE, |x, y| image::Rgb(offsets(x, y)));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "codes from 1 to 65535")]
    let code = |offset: f32| (32768.0 + f64::from(offset) * 32767.0).round() as u16;
    let codes = image::ImageBuffer::from_fn(SIDE, SIDE, |x, y| image::Rgb(offsets(x, y).map(code)));
    let [exr, png] = ["offsets.exr", "offsets.png"].map(|name| folder.path().join(name));
    floats.save(&exr).expect("writable");
    codes.save(&png).expect("writable");
    let rays = steep_rays(300);
    let by = |path: Option<&Path>| {
        let offset_map = path.map(|path| OffsetMap::load(path).expect("a picture"));
        hits_with(waves(), Settings { method: Method::BumpOffset, offset_map, ..Settings::default() }, &rays)
    };
    let (made, of_floats, of_codes) = (by(None), by(Some(&exr)), by(Some(&png)));
    assert!(made.iter().any(|hit| hit.normal.truncate().length() > 0.3), "waves that lean");
    assert_eq!(made, of_floats);
    // Half a code either way in u and in v, over SIDE texels a unit; normals turn by no more than slopes grow.
    let bound = 2.0_f32.sqrt() * 0.5 / 32767.0 * SIDE as f32 * HEIGHT + 1e-6;
    let off = made.iter().zip(&of_codes).map(|(a, b)| a.normal.distance(b.normal)).fold(0.0, f32::max);
    assert!(off < bound && off > 0.05 * bound, "{off} of {bound}");
}

/// By hand: offsets that are the same everywhere, of a map of another size than that of heights, which displaces by 2.
#[test]
fn offset_maps_have_texels_of_their_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("offsets.exr");
    image::Rgb32FImage::from_pixel(10, 20, image::Rgb([0.03, -0.01, 0.5])).save(&path).expect("writable");
    let mut scene = waves();
    scene.reliefs[0].scale = 2.0;
    let settings = Settings {
        method: Method::BumpOffset,
        offset_map: Some(OffsetMap::load(&path).expect("a picture")),
        ..Settings::default()
    };
    // 0.03 * 10 * 2 along u, -0.01 * 20 * 2 along v.
    let normal = Vec3::new(-0.6, 0.4, 1.0).normalize();
    for hit in hits_with(scene, settings, &steep_rays(50)) {
        assert!(hit.normal.distance(normal) < 1e-6, "{hit:?}");
    }
}

/// A floor with a wall across it, 0.3 high, between x = 0.625 and 0.6875.
fn wall() -> Scene {
    let texels = (0..64 * 64).map(|i| f32::from(u8::from((40..44).contains(&(i % 64)))).to_bits()).collect();
    let map = HeightMap {
        width: 64,
        height: 64,
        format: height_format::FLOAT32,
        texels,
        range: (0.0, 1.0),
        replaced: 0,
    };
    Scene { reliefs: vec![Relief::new(map, 0.0, 0.3)], subdivisions: 64, ..waves() }
}

/// What rises behind a light does not shadow it, what rises before it does: along one direction over the floor there
/// are a light, the wall, and another light.
#[test]
fn relief_behind_a_light_casts_no_shadow() {
    let floor = Vec3::new(0.3, 0.5, 0.0);
    let toward = Vec3::new(1.0, 0.0, 0.25);
    let lit = |method, distance: f32, shadows| {
        let light = Light {
            position: (floor + toward * distance).as_dvec3(),
            color: Vec3::ONE,
            intensity: Some(1.0),
        };
        let view = View {
            eye: Some((floor + Vec3::Z * 2.0).as_dvec3()),
            target: Some(floor.as_dvec3()),
            up: Some(DVec3::Y),
            fov: 0.1,
            ..View::default()
        };
        let (width, height, ambient) = (1, 1, 0.0);
        let lights = vec![light];
        let settings =
            Settings { method, view, lights, shadows, width, height, ambient, ..Settings::default() };
        rendered(&mut CpuBackend::new(), &job(wall(), &settings), 1).pixels[0].x
    };
    for method in [Method::Steep, Method::Relief, Method::Occlusion, Method::Pyramid, Method::Sphere] {
        let (near, far) = (lit(method, 0.2, true), lit(method, 0.6, true));
        assert_eq!(near, lit(method, 0.2, false), "{method}: the wall is behind the light");
        assert!(near > 1.0, "{method}: {near}");
        // The soft shadow of so high a wall is whole too.
        assert_eq!(far, 0.0, "{method}: the wall is before the light");
        assert!(lit(method, 0.6, false) > 0.1, "{method}");
    }
}

/// The place that parallax mapping takes is never behind the eye, also where that is within the relief.
#[test]
fn parallax_looks_at_nothing_behind_the_eye() {
    let texels = waves().reliefs[0].map.texels.clone();
    let (reach, mut held) = (0.005, 0);
    let nearer = |ray: Ray| Ray { origin: ray.origin + ray.direction * (0.2 - reach), ..ray };
    let rays: Vec<Ray> = steep_rays(300).into_iter().map(nearer).collect();
    for (method, is_limited) in [(Method::Parallax, false), (Method::ParallaxLimited, true)] {
        for (ray, hit) in rays.iter().zip(hits(waves(), method, &rays)) {
            let d = ray.direction.as_dvec3();
            let t = -f64::from(ray.origin.z) / d.z;
            let at = ray.origin.as_dvec3() + d * t;
            let rise = height(&texels, at.truncate()) * d.z.signum();
            let t = t + if is_limited { rise / d.length() } else { rise };
            held += usize::from(t < 0.0);
            assert!((f64::from(hit.t) - t.max(0.0)).abs() < 1e-6, "{method} {ray:?}: {t} {hit:?}");
            let seen = ray.origin + ray.direction * hit.t;
            assert!((seen.x - hit.u).abs().max((seen.y - hit.v).abs()) < 1e-6, "{method} {ray:?}: {hit:?}");
        }
    }
    assert!(held > 100, "{held}");
}

/// What [`Shade::Error`] shows of each pixel is the difference of the two pictures that it is named for.
#[test]
fn errors_shown_are_differences_from_the_exact_method() {
    let (scene, settings) = builtin_scene("builtin:cube", 6, 48, 36);
    // The same for all: boxes differ, by which the camera is placed otherwise.
    let view = View { eye: Some(DVec3::new(2.5, 2.0, 3.0)), target: Some(DVec3::ZERO), ..settings.view };
    let lights = vec![Light { position: DVec3::new(4.0, 6.0, 5.0), color: Vec3::ONE, intensity: Some(60.0) }];
    let settings = Settings { view, lights, ..settings };
    let pixels = |method, shade| {
        let settings = Settings { method, shade, ..settings.clone() };
        rendered(&mut CpuBackend::new(), &job(scene.clone(), &settings), 1).pixels
    };
    let luminance = |pixel: Vec4| pixel.truncate().dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let exact = pixels(Method::Quadtree, Shade::Lit);
    for method in [Method::None, Method::Bump, Method::Occlusion, Method::GridWalk] {
        let (lit, shown) = (pixels(method, Shade::Lit), pixels(method, Shade::Error));
        let mut differing = 0;
        for ((lit, exact), shown) in lit.iter().zip(&exact).zip(&shown) {
            let x = (4.0 * (luminance(*lit) - luminance(*exact)).abs()).min(1.0);
            let color =
                Vec3::new((2.0 * x - 1.0).max(0.0), 1.0 - (2.0 * x - 1.0).abs(), (1.0 - 2.0 * x).max(0.0));
            let alpha = lit.w.max(exact.w);
            let expected = (color * alpha).extend(alpha);
            // Eight times the rounding of two luminances below 4.
            assert!((*shown - expected).abs().max_element() < 1e-5, "{method}: {shown} {expected}");
            differing += usize::from(x > 0.1);
        }
        assert!(method == Method::GridWalk || differing > 100, "{method}: {differing} pixels differ");
    }
    let none: Vec<Vec4> = exact.iter().map(|pixel| Vec4::new(0.0, 0.0, pixel.w, pixel.w)).collect();
    assert_eq!(pixels(Method::Quadtree, Shade::Error), none);
}
