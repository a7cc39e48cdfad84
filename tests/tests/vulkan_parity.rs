//! One source, two targets: the CPU backend and lavapipe make the same pictures and find the same hits. What "the
//! same" means is said in [`emboss_tests::compare`].

use emboss::backend::cpu::CpuBackend;
use emboss::backend::vulkan::VulkanBackend;
use emboss::backend::{Backend, Totals};
use emboss::picture::Picture;
use emboss::render::{Job, Scene};
use emboss::scene::{ColorMap, HeightMap, Material, Relief};
use emboss::settings::{Filter, Method, Normals, Settings, Shade, Weld, Wrap};
use emboss_kernels::interface::{Intersection, MISS, Ray, color_format, counter, height_format, wrap};
use emboss_kernels::math::{UNIT_ROUNDOFF, gamma, max_abs};
use emboss_kernels::scene::Features;
use emboss_tests::compare::{Comparison, VISIBLE, against_cpu, rendered};
use emboss_tests::scenes::{ReadyJob, builtin_scene, job};
use emboss_tests::{Numbers, finish, lavapipe};
use glam::{Vec3, Vec4};
use std::ops::ControlFlow;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
const SAMPLES: u32 = 2;
const METHODS: [Method; 4] = [Method::Quadtree, Method::GridWalk, Method::BruteForce, Method::None];
const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];

/// Asserts that `backend` makes the CPU's picture of a job, of which a fair part is surface.
fn assert_alike(backend: &mut VulkanBackend, job: &Job, what: &str) -> Picture {
    let picture = rendered(backend, job, SAMPLES);
    against_cpu(job, SAMPLES, &picture).assert_same(what);
    let hit = picture.pixels.iter().filter(|pixel| pixel.w > 0.0).count();
    assert!(hit * 4 > picture.pixels.len(), "{what}: only {hit} pixels show anything");
    picture
}

/// Asserts that the work was the same: rays exactly, hits but for the few rays on whose way rounding decides. The boxes
/// of prisms differ by last places, which decide between planes of equal cost, of which a cube has many: so the trees
/// may differ, and what rays test on their way by as much as trees that are held to be equally good (`bvh_quality.rs`:
/// a tenth).
fn assert_same_work(device: &Totals, cpu: &Totals, what: &str) {
    assert_eq!(device[counter::PRIMARY_RAYS as usize], cpu[counter::PRIMARY_RAYS as usize], "{what}");
    for (i, (&device, &cpu)) in device.iter().zip(cpu).enumerate() {
        let part = if i >= counter::BOXES as usize { 10 } else { 200 };
        assert!(
            device.abs_diff(cpu) * part <= cpu + 200,
            "{what}: counter {i} is {device}, on the CPU {cpu}"
        );
    }
}

/// Some methods on a built-in scene, lit and with shadows.
fn assert_methods_alike(name: &str, subdivisions: u32, methods: &[Method]) {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene(name, subdivisions, WIDTH, HEIGHT);
    for &method in methods {
        let job = job(scene.clone(), &Settings { method, counting: true, ..settings.clone() });
        let what = format!("{name} by {method:?}");
        assert_alike(&mut backend, &job, &what);
        let mut cpu = CpuBackend::new();
        rendered(&mut cpu, &job, SAMPLES);
        assert_same_work(&backend.totals().unwrap(), &cpu.totals().unwrap(), &what);
    }
    finish(backend);
}

#[test]
fn cube_is_alike_by_every_method() {
    assert_methods_alike("builtin:cube", 16, &METHODS);
}

#[test]
fn quilt_is_alike() {
    assert_methods_alike("builtin:quilt", 16, &METHODS[..1]);
}

#[test]
fn knot_is_alike() {
    assert_methods_alike("builtin:knot", 8, &METHODS[..2]);
}

#[test]
fn knot_is_alike_in_every_shade_and_without_shadows() {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene("builtin:knot", 8, WIDTH, HEIGHT);
    for shade in [Shade::Normal, Shade::Height, Shade::Uv, Shade::Cell, Shade::Steps] {
        let job = job(scene.clone(), &Settings { shade, ..settings.clone() });
        assert_alike(&mut backend, &job, &format!("{shade:?}"));
    }
    let shadowed = rendered(&mut CpuBackend::new(), &job(scene.clone(), &settings), SAMPLES);
    let job = job(scene, &Settings { shadows: false, ..settings });
    let unshadowed = assert_alike(&mut backend, &job, "no shadows");
    assert!(!Comparison::new(&unshadowed, &shadowed, VISIBLE).is_same(), "there are shadows to leave out");
    finish(backend);
}

/// The quilt's two triangles with texture coordinates from -0.7 to 1.9, beyond the map on every side.
fn overhanging_quilt() -> (Scene, Settings) {
    let (mut scene, settings) = builtin_scene("builtin:quilt", 12, WIDTH, HEIGHT);
    for vertex in &mut scene.mesh.vertices {
        vertex.u = vertex.u * 2.6 - 0.7;
        vertex.v = vertex.v * 2.6 - 0.7;
    }
    scene.materials = vec![Material::default()];
    (scene, settings)
}

/// Sides of the maps of these tests: odd, so that rows begin within a word.
const MAP: (u32, u32) = (13, 7);

/// 8-bit texels of a map.
fn codes(seed: u32) -> Vec<u32> {
    let mut numbers = Numbers::new(u64::from(seed));
    (0..MAP.0 * MAP.1).map(|_| numbers.word() >> 24).collect()
}

/// The same relief in each format.
fn relief(format: u32) -> HeightMap {
    packed(&codes(5), format)
}

/// A height map of 8-bit texels in a format.
fn packed(codes: &[u32], format: u32) -> HeightMap {
    let unit = |code: u32| code as f32 / 255.0;
    let word = |codes: &[u32], bits: u32| codes.iter().rev().fold(0, |word, code| word << bits | code);
    let texels = match format {
        height_format::UNORM8 => codes.chunks(4).map(|four| word(four, 8)).collect(),
        height_format::UNORM16 => {
            let codes: Vec<u32> = codes.iter().map(|code| code * 257).collect();
            codes.chunks(2).map(|two| if two.len() == 2 { two[0] | two[1] << 16 } else { two[0] }).collect()
        }
        _ => codes.iter().map(|&code| unit(code).to_bits()).collect(),
    };
    let range = (0.0, 1.0);
    HeightMap { width: MAP.0, height: MAP.1, format, texels, range, replaced: 0 }
}

#[test]
fn height_formats_and_wraps_are_alike() {
    let mut backend = lavapipe();
    let (scene, settings) = overhanging_quilt();
    let mut pictures = Vec::new();
    // All wraps of one format, and the other formats.
    let cases = [
        (height_format::UNORM8, 0),
        (height_format::UNORM8, 1),
        (height_format::UNORM8, 2),
        (height_format::UNORM16, 1),
        (height_format::FLOAT32, 2),
    ];
    for (format, wrap) in cases {
        let map = Relief::new(relief(format), scene.reliefs[0].zero, 0.1);
        let scene = Scene { reliefs: vec![map], ..scene.clone() };
        let settings = Settings { wrap: WRAPS[wrap], shade: Shade::Height, ..settings.clone() };
        let job = job(scene, &settings);
        pictures.push(assert_alike(&mut backend, &job, &format!("format {format}, {:?}", WRAPS[wrap])));
    }
    // The three formats hold the same relief; the three wraps show it differently.
    for (picture, (format, wrap)) in pictures.iter().zip(cases) {
        let same_as = |other: usize| Comparison::new(picture, &pictures[other], VISIBLE).strays() < 20;
        assert!(same_as(wrap), "{format}: formats differ");
        assert!(!same_as((wrap + 1) % 3) && !same_as((wrap + 2) % 3), "{format}: wraps agree");
    }
    finish(backend);
}

/// The same colours in each format.
fn colors(format: u32) -> Option<ColorMap> {
    let (red, green, blue) = (codes(1), codes(2), codes(3));
    // The table of an 8-bit map need not be sRGB for a test: the squares of the codes.
    let linear = |code: u32| (code as f32 / 255.0).powi(2).to_bits();
    let texels = (0..red.len()).map(|i| [red[i], green[i], blue[i]]);
    let texels = match format {
        color_format::NONE => return None,
        color_format::SRGB8 => {
            (0..256).map(linear).chain(texels.map(|[r, g, b]| r | g << 8 | b << 16)).collect()
        }
        _ => texels.flat_map(|texel| texel.map(linear)).collect(),
    };
    Some(ColorMap { width: MAP.0, height: MAP.1, format, texels })
}

#[test]
fn color_formats_and_wraps_are_alike() {
    let mut backend = lavapipe();
    let (scene, settings) = overhanging_quilt();
    let mut pictures = Vec::new();
    for format in [color_format::SRGB8, color_format::FLOAT32, color_format::NONE] {
        for wrap in if format == color_format::NONE { &WRAPS[..1] } else { &WRAPS } {
            let scene = Scene { materials: vec![colors(format).into()], ..scene.clone() };
            let settings = Settings { wrap: *wrap, method: Method::None, shadows: false, ..settings.clone() };
            pictures.push(assert_alike(
                &mut backend,
                &job(scene, &settings),
                &format!("format {format}, {wrap:?}"),
            ));
        }
    }
    let same = |a: usize, b: usize| Comparison::new(&pictures[a], &pictures[b], VISIBLE).strays() < 20;
    assert!(same(0, 3) && same(1, 4) && same(2, 5), "formats differ");
    assert!(!same(0, 1) && !same(1, 2) && !same(2, 0) && !same(0, 6), "wraps or colours do not show");
    finish(backend);
}

/// Materials of every kind side by side: colour maps of two formats and wraps, two colours without a map; height maps
/// of the same relief in three formats, one of them under another wrap, and none.
#[test]
fn materials_are_alike() {
    let mut backend = lavapipe();
    let (mut scene, settings) = builtin_scene("builtin:cube", 7, WIDTH, HEIGHT);
    for vertex in &mut scene.mesh.vertices {
        (vertex.u, vertex.v) = (vertex.u * 2.6 - 0.7, vertex.v * 2.6 - 0.7);
    }
    let colored = |format, wrap| Material { wrap, ..colors(format).into() };
    let plain = |albedo| Material { albedo, ..Material::default() };
    scene.materials = vec![
        colored(color_format::SRGB8, None),
        plain(Vec3::new(0.1, 0.9, 0.4)),
        colored(color_format::FLOAT32, Some(Wrap::Mirror)),
        plain(Vec3::new(0.9, 0.1, 0.4)),
    ];
    let relief = |format, wrap| Relief { wrap, ..Relief::new(relief(format), 0.5, 0.3) };
    scene.reliefs = vec![
        relief(height_format::UNORM8, None),
        relief(height_format::UNORM16, Some(Wrap::Mirror)),
        relief(height_format::FLOAT32, None),
        Relief::new(HeightMap::flat(0.0), 0.0, 0.0),
    ];
    for (triangle, i) in scene.mesh.triangles.iter_mut().zip([0, 1, 2, 3].into_iter().cycle()) {
        *triangle = triangle.with_material(i);
        triangle.displacement = (i + 1) % 4;
    }
    let job = |scene: &Scene| job(scene.clone(), &settings);
    let mixed = job(&scene);
    let Features { height_format, height_wrap, color_format, color_wrap, .. } = mixed.features;
    assert_eq!(
        [height_format, height_wrap, color_format, color_wrap],
        [height_format::PER_MAP, wrap::PER_MAP, color_format::PER_MATERIAL, wrap::PER_MAP]
    );
    let picture = assert_alike(&mut backend, &mixed, "mixed materials");
    assert_rays_alike(&mut backend, &mixed, 20_000);
    // Each of them shows.
    for i in 0..4 {
        let mut other = scene.clone();
        other.materials[i] = plain(Vec3::splat(0.3));
        let other = rendered(&mut CpuBackend::new(), &job(&other), SAMPLES);
        assert!(Comparison::new(&other, &picture, VISIBLE).strays() > 20, "material {i} does not show");
    }
    for i in 0..3 {
        let mut other = scene.clone();
        other.reliefs[i].scale = 0.1;
        let other = rendered(&mut CpuBackend::new(), &job(&other), SAMPLES);
        assert!(Comparison::new(&other, &picture, VISIBLE).strays() > 20, "relief {i} does not show");
    }
    finish(backend);
}

/// Levels of maps with odd sides, in both formats, displaced and not, from so far away that most levels are read.
#[test]
fn filtered_colors_are_alike() {
    let mut backend = lavapipe();
    for (format, method) in
        [color_format::SRGB8, color_format::FLOAT32].into_iter().zip([Method::None, Method::Quadtree])
    {
        let (mut scene, settings) = overhanging_quilt();
        scene.materials = vec![colors(format).into()];
        scene
            .mesh
            .vertices
            .iter_mut()
            .for_each(|vertex| (vertex.u, vertex.v) = (vertex.u * 4.0, vertex.v * 9.0));
        let settings = Settings { method, filter: Filter::Trilinear, ..settings };
        let picture = assert_alike(&mut backend, &job(scene.clone(), &settings), &format!("format {format}"));
        let plain = job(scene, &Settings { filter: Filter::Bilinear, ..settings });
        assert!(against_cpu(&plain, SAMPLES, &picture).strays() > 100, "the filter does not show");
    }
    finish(backend);
}

/// The cube under two maps of 8-bit texels that know nothing of each other, one on every other triangle: at its edges
/// normals, texture coordinates and maps disagree.
fn split_cube() -> (Scene, Settings) {
    let (mut scene, settings) = builtin_scene("builtin:cube", 7, WIDTH, HEIGHT);
    let relief = |seed, zero, scale| Relief::new(packed(&codes(seed), height_format::UNORM8), zero, scale);
    scene.reliefs = vec![relief(6, 0.5, 0.4), relief(7, 0.25, -0.3)];
    for (triangle, map) in scene.mesh.triangles.iter_mut().zip([0, 1].into_iter().cycle()) {
        triangle.displacement = map;
    }
    (scene, settings)
}

#[test]
fn seams_and_both_directions_are_alike() {
    let mut backend = lavapipe();
    let mut alike = |(scene, settings): (Scene, Settings), method, weld, normals: Normals| {
        let job = job(scene, &Settings { method, weld, normals, ..settings });
        assert_eq!((job.features.seams != 0, job.features.normals), (weld == Weld::On, normals.id()));
        assert_alike(&mut backend, &job, &format!("{method:?}, weld {weld:?}, {normals:?}"))
    };
    let by_quadtree = [
        (Weld::On, Normals::Normalized),
        (Weld::On, Normals::Linear),
        (Weld::Off, Normals::Normalized),
        (Weld::Off, Normals::Linear),
    ]
    .map(|(weld, normals)| alike(split_cube(), Method::Quadtree, weld, normals));
    let differ =
        |a: usize, b: usize| Comparison::new(&by_quadtree[a], &by_quadtree[b], VISIBLE).strays() > 20;
    assert!(differ(0, 1), "the direction does not show");
    assert!(differ(0, 2) && differ(1, 3), "seams do not show");
    for method in [Method::GridWalk, Method::BruteForce] {
        alike(split_cube(), method, Weld::On, Normals::Linear);
    }
    let knot = builtin_scene("builtin:knot", 6, WIDTH, HEIGHT);
    alike(knot, Method::Quadtree, Weld::On, Normals::Linear);
    finish(backend);
}

/// Smooth shading, with what shading normals depend on: the direction, the wrap, whether anything is displaced.
#[test]
fn smooth_pictures_are_alike() {
    let mut backend = lavapipe();
    let mut alike = |(scene, settings): (Scene, Settings), method, normals: Normals, wrap| {
        let settings = Settings { method, normals, wrap, smooth: true, ..settings };
        let lit = job(scene.clone(), &settings);
        let picture = assert_alike(&mut backend, &lit, &format!("{method:?}, {normals:?}, {wrap:?}, smooth"));
        let flat = against_cpu(&job(scene, &Settings { smooth: false, ..settings }), SAMPLES, &picture);
        assert!(
            flat.strays() > 100,
            "{method:?}, {normals:?}, {wrap:?}: smooth shading does not show: {flat}"
        );
    };
    for (wrap, format) in
        WRAPS.into_iter().zip([height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32])
    {
        let (mut scene, settings) = overhanging_quilt();
        scene.subdivisions = 5;
        scene.reliefs[0] = Relief::new(relief(format), 0.3, 0.1);
        alike((scene, settings), Method::Quadtree, Normals::Normalized, wrap);
    }
    alike(split_cube(), Method::Quadtree, Normals::Normalized, Wrap::Repeat);
    alike(split_cube(), Method::BruteForce, Normals::Linear, Wrap::Repeat);
    let knot = builtin_scene("builtin:knot", 4, WIDTH, HEIGHT);
    alike(knot.clone(), Method::GridWalk, Normals::Linear, Wrap::Repeat);
    alike(knot.clone(), Method::None, Normals::Normalized, Wrap::Repeat);
    let (scene, settings) = knot;
    let normals = job(scene, &Settings { shade: Shade::Normal, smooth: true, ..settings });
    assert_alike(&mut backend, &normals, "smooth normals");
    finish(backend);
}

/// Rays see the seams and the directions that pictures do.
#[test]
fn rays_meet_seams_as_pictures_do() {
    let mut backend = lavapipe();
    let (scene, settings) = split_cube();
    for (weld, normals) in [(Weld::On, Normals::Linear), (Weld::On, Normals::Normalized)] {
        let job = job(scene.clone(), &Settings { weld, normals, ..settings.clone() });
        assert_rays_alike(&mut backend, &job, 20_000);
    }
    finish(backend);
}

/// What spoils the pixels of a picture.
type Fault<'a> = &'a dyn Fn(&mut Vec<Vec4>);

/// The comparison sees on a real picture what it is there to see.
#[test]
fn faults_in_a_picture_are_seen() {
    let (scene, settings) = builtin_scene("builtin:cube", 8, WIDTH, HEIGHT);
    let job = job(scene, &settings);
    let picture = rendered(&mut CpuBackend::new(), &job, SAMPLES);
    let middle = (HEIGHT / 2 * WIDTH + WIDTH / 2) as usize;
    let faulty = |fault: Fault<'_>| {
        let mut picture = picture.clone();
        fault(&mut picture.pixels);
        against_cpu(&job, SAMPLES, &picture)
    };
    assert!(faulty(&|_| {}).is_same());
    let swapped = picture.pixels.iter().position(|pixel| (*pixel - picture.pixels[middle]).x.abs() > 0.01);
    let faults: [(&str, Fault<'_>); 6] = [
        ("a pixel a little darker", &|pixels| pixels[middle] *= Vec4::new(0.95, 0.95, 0.95, 1.0)),
        ("a hole", &|pixels| pixels[middle] = Vec4::ZERO),
        ("swapped pixels", &|pixels| pixels.swap(middle, swapped.unwrap())),
        ("shifted right", &|pixels| pixels.rotate_right(1)),
        ("shifted down", &|pixels| pixels.rotate_right(WIDTH as usize)),
        ("alpha lost", &|pixels| pixels.iter_mut().for_each(|pixel| pixel.w = 1.0)),
    ];
    for (what, fault) in faults {
        assert!(!faulty(fault).is_same(), "{what}");
    }
}

/// Tiles are cut by the clock; pixels must not know. Each sample comes once in a first pass, which is cut into many
/// tiles, and once after another, by when the pace is known. A sum of two floats has no order.
#[test]
fn picture_does_not_depend_on_tiles() {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene("builtin:knot", 8, WIDTH, HEIGHT);
    let job = job(scene, &settings);
    let mut film = |samples: [u32; 2]| {
        backend.load(&job.buffers, &job.frame, job.features).unwrap();
        let cuts = samples.map(|sample| {
            let mut shares = Vec::new();
            let flow = backend.add_sample(sample, &mut |share| {
                shares.push(share);
                ControlFlow::Continue(())
            });
            assert_eq!(flow.unwrap(), ControlFlow::Continue(()));
            shares
        });
        (backend.film().unwrap(), cuts)
    };
    let ((forwards, [cut_0, cut_1]), (backwards, [other_cut_1, other_cut_0])) = (film([0, 1]), film([1, 0]));
    assert!(cut_0 != other_cut_0 || cut_1 != other_cut_1, "the test cuts a sample in two ways");
    assert!(forwards == backwards);
    finish(backend);
}

#[test]
fn seed_decides_the_bytes() {
    let (scene, settings) = builtin_scene("builtin:cube", 8, WIDTH, HEIGHT);
    let with_seed = |seed| job(scene.clone(), &Settings { seed, ..settings.clone() });
    let mut vulkan = lavapipe();
    let backends: [&mut dyn Backend; 2] = [&mut vulkan, &mut CpuBackend::new()];
    for backend in backends {
        let first = rendered(backend, &with_seed(1), SAMPLES);
        let other = rendered(backend, &with_seed(2), SAMPLES);
        assert!(!Comparison::new(&first, &other, VISIBLE).is_same());
        assert_eq!(rendered(backend, &with_seed(1), SAMPLES), first);
    }
    finish(vulkan);
}

/// Rays from a sphere around the knot to points near it.
fn rays_at(job: &ReadyJob, count: usize) -> Vec<Ray> {
    let root = job.bounds();
    let (center, size) = ((root.min + root.max) * 0.5, (root.max - root.min) * 0.5);
    let mut numbers = Numbers::new(11);
    let ray = |_| {
        let origin = center + numbers.direction() * size.length() * 1.5;
        let direction = center + numbers.in_cube() * size - origin;
        Ray { origin, t_max: f32::INFINITY, direction, padding: 0 }
    };
    (0..count).map(ray).collect()
}

/// Bound on the difference of two computed distances to the micro-triangle of `hit`, in units of distance: each is off
/// by gamma(12) of the greatest depth (`triangle::intersect`), and by the error of the micro-vertices, 24 u of their
/// coordinates (`BaseTriangle::bounds`), over the cosine at which the ray meets the plane.
fn distance_bound(ray: &Ray, hit: &Intersection) -> f32 {
    let unit = ray.direction.normalize();
    let depth = 1.1 * hit.t * ray.direction.length();
    let vertices = 24.0 * UNIT_ROUNDOFF * 1.1 * max_abs(hit.point);
    2.0 * (gamma(12) * depth + vertices * 3f32.sqrt()) / unit.dot(hit.normal).abs()
}

/// Whether two backends' answers to a ray agree: both miss, or both are equally far.
fn agree(ray: &Ray, a: &Intersection, b: &Intersection) -> bool {
    if a.primitive == MISS || b.primitive == MISS {
        return a.primitive == b.primitive;
    }
    let bound = distance_bound(ray, a).max(distance_bound(ray, b));
    (a.t - b.t).abs() * ray.direction.length() <= bound
}

/// Of `count` rays all must agree, but for those that pass an edge within rounding: they must agree with what the CPU
/// finds on a ray turned by 2^-17 to some side (as in [`against_cpu`]).
fn assert_rays_alike(backend: &mut VulkanBackend, job: &ReadyJob, count: usize) {
    let rays = rays_at(job, count);
    let mut cpu = CpuBackend::new();
    cpu.load(&job.buffers, &job.frame, job.features).unwrap();
    backend.load(&job.buffers, &job.frame, job.features).unwrap();
    let (on_device, on_cpu) = (backend.trace_rays(&rays).unwrap(), cpu.trace_rays(&rays).unwrap());

    let hits = on_cpu.iter().filter(|hit| hit.primitive != MISS).count();
    assert!((count / 5..count * 19 / 20).contains(&hits), "{hits} hits");
    let (mut other_cell, mut flips) = (0, 0);
    for ((ray, device), cpu_hit) in rays.iter().zip(&on_device).zip(&on_cpu) {
        other_cell += usize::from((device.primitive, device.cell) != (cpu_hit.primitive, cpu_hit.cell));
        if !agree(ray, device, cpu_hit) {
            let turned = cpu.trace_rays(&turned(ray)).unwrap();
            let excused = turned.iter().any(|other| agree(ray, device, other));
            assert!(excused, "{ray:?}: {device:?} on the device, {cpu_hit:?} on the CPU");
            flips += 1;
        }
    }
    // An edge lies within 2^-17 of a ray's length from it with a probability of about two lengths of micro-edge per
    // area of micro-triangle, some 200 on the knot, times that: below 2^-9.
    assert!(other_cell * 512 <= rays.len(), "{other_cell} rays meet another cell");
    assert!(flips * 512 <= rays.len(), "{flips} rays are off");
}

#[test]
fn rays_meet_the_knot_alike() {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene("builtin:knot", 8, WIDTH, HEIGHT);
    for method in [Method::Quadtree, Method::GridWalk] {
        let job = job(scene.clone(), &Settings { method, ..settings.clone() });
        assert_rays_alike(&mut backend, &job, 100_000);
    }
    finish(backend);
}

/// The ray turned by 2^-17 to eight sides.
fn turned(ray: &Ray) -> [Ray; 8] {
    let (x, y) = ray.direction.normalize().any_orthonormal_pair();
    let length = ray.direction.length() / 131_072.0;
    std::array::from_fn(|i| {
        let (sin, cos) = (i as f32 * std::f32::consts::FRAC_PI_4).sin_cos();
        Ray { direction: ray.direction + (x * cos + y * sin) * length, ..*ray }
    })
}

/// The point of a hit is where its distance says.
#[test]
fn points_lie_on_their_rays() {
    let mut backend = lavapipe();
    let (scene, settings) = builtin_scene("builtin:knot", 8, WIDTH, HEIGHT);
    let job = job(scene, &settings);
    let rays = rays_at(&job, 10_000);
    backend.load(&job.buffers, &job.frame, job.features).unwrap();
    for (ray, hit) in rays.iter().zip(backend.trace_rays(&rays).unwrap()) {
        if hit.primitive == MISS {
            continue;
        }
        let along = ray.origin + ray.direction * hit.t;
        let off_plane = (hit.point - along).dot(hit.normal).abs();
        let depth = hit.t * ray.direction.length();
        let bound = hit.point_error.dot(hit.normal.abs()) + gamma(16) * (depth + sum(hit.point.abs()));
        assert!(off_plane <= bound, "{ray:?} {hit:?}: {off_plane} {bound}");
    }
    finish(backend);
}

fn sum(v: Vec3) -> f32 {
    v.x + v.y + v.z
}
