//! Smooth shading: the shading normal is that of the relief over a smooth base, pictures of few micro-triangles look
//! more like those of many, and no light comes through the surface.

use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{Light, Method, Normals, Settings, Wrap};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{FLIPPED, NO_SEAMS, height_format, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::render::sample_ray;
use emboss_kernels::shading::SurfaceInteraction;
use emboss_tests::Numbers;
use emboss_tests::compare::{rendered, rmse};
use emboss_tests::meshes;
use emboss_tests::oracle::LimitSurface;
use emboss_tests::scenes::{ReadyJob, WildMap, builtin_scene, job, random_solid};
use glam::{DQuat, DVec3, Vec3};

const SCALES: [f32; 3] = [1e-6, 1.0, 1e6];
const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
const FORMATS: [u32; 3] = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];

/// Prints what a test measured, for `--nocapture`.
#[expect(clippy::print_stdout, reason = "docs/SHADING.md shows these tables")]
fn say(line: std::fmt::Arguments<'_>) {
    println!("{line}");
}

/// A random solid as large as `scale` makes it, its normals leaning by up to `spread`.
fn solid(numbers: &mut Numbers, format: u32, spread: f32, scale: f32) -> Scene {
    let mut scene = random_solid(numbers, format, spread);
    scene.mesh.vertices.iter_mut().for_each(|vertex| vertex.position *= scale);
    scene.reliefs[0].scale *= scale;
    scene
}

/// A point anywhere on a scene's surface, as a hit.
fn somewhere(job: &ReadyJob, numbers: &mut Numbers) -> Hit {
    let primitive = numbers.below(job.frame.triangle_count);
    let (w, b) = (numbers.barycentric(), numbers.barycentric());
    let cell = Cell::containing(w.y, w.z, job.frame.subdivisions).pack();
    Hit { t: 0.0, primitive, cell, b1: b.y, b2: b.z, instance: 0 }
}

/// What became of the normals that were compared.
#[derive(Debug, Default)]
struct Compared {
    points: usize,
    /// Near kinks, or where f32 cannot tell the normal to within 0.01.
    left_out: usize,
    /// Of flipped triangles.
    flipped: usize,
    /// On the other side of the micro-triangle.
    opposite: usize,
    /// Greatest error, and the greatest share of its bound that an error was.
    error: f64,
    share: f64,
}

/// For hits that no ray found: only methods in image space look at it.
fn any_ray() -> TraversalRay {
    TraversalRay::new(Vec3::ZERO, Vec3::X, f32::INFINITY)
}

/// Compares shading normals all over a scene with finite differences.
fn compare_normals(job: &ReadyJob, numbers: &mut Numbers, points: usize, compared: &mut Compared) {
    let surface = LimitSurface::new(&job.buffers, job.features);
    let view = job.view();
    for _ in 0..points {
        let hit = somewhere(job, numbers);
        let w = LimitSurface::weights(hit.cell, hit.b1, hit.b2, job.frame.subdivisions);
        let interaction = SurfaceInteraction::new(&view, job.features, &any_ray(), hit);
        let (ng, ns) = (interaction.ng.as_dvec3(), interaction.ns.as_dvec3());
        compared.points += 1;
        let expected = match surface.smooth_normal(hit.primitive, w) {
            Some(normal) if normal.error < 0.01 => normal,
            _ => {
                compared.left_out += 1;
                continue;
            }
        };
        compared.flipped += usize::from(job.buffers.triangles[hit.primitive as usize].flags != 0);
        compared.opposite += usize::from(ns.dot(ng) < 0.0);
        let error = ns.distance(expected.direction);
        assert!(error <= expected.error, "{ns}, not {expected:?} at {hit:?} of {:?}", job.frame);
        compared.error = compared.error.max(error);
        compared.share = compared.share.max(error / expected.error);
    }
}

/// Against central differences in f64, on curved bases (normals lean by up to a right angle), under maps of all formats
/// and wraps, both directions, both orientations, scales from 1e-6 to 1e6 up to a hundred sizes from the origin.
#[test]
fn shading_normals_are_those_of_the_relief_over_a_smooth_base() {
    let mut numbers = Numbers::new(51);
    for normals in [Normals::Normalized, Normals::Linear] {
        let mut compared = Compared::default();
        for round in 0..270 {
            let (scale, wrap, format) = (SCALES[round % 3], WRAPS[round / 3 % 3], FORMATS[round / 9 % 3]);
            let scene = solid(&mut numbers, format, [0.0, 0.3, 1.0][round % 5 % 3], scale);
            let settings = Settings { normals, wrap, smooth: true, ..Settings::default() };
            compare_normals(&job(scene, &settings), &mut numbers, 400, &mut compared);
        }
        say(format_args!("{normals:?}: {compared:?}"));
        assert!(compared.left_out * 10 < compared.points, "{compared:?}");
        assert!(compared.flipped * 10 > compared.points, "{compared:?}");
        assert!(compared.error > 0.0, "nothing is exact: {compared:?}");
    }
}

/// The hit of a ray from the camera of a job's frame, if any.
fn traced(job: &ReadyJob, origin: Vec3, direction: Vec3) -> Option<(TraversalRay, Hit)> {
    let ray = TraversalRay::new(origin, direction, f32::INFINITY);
    let hit = traverse(&job.view(), job.features, &ray, Query::Nearest, &mut Counts::default());
    hit.is_some().then_some((ray, hit))
}

/// The normal of a hit's micro-triangle as it would stand on the smooth base, by a rotation in f64.
fn on_smooth_base(job: &ReadyJob, hit: Hit, ng: DVec3) -> DVec3 {
    let triangle = job.buffers.triangles[hit.primitive as usize];
    let [a, b, c] = triangle.vertices.map(|v| job.buffers.vertices[v as usize]);
    let w = if job.features.method == method::NONE {
        DVec3::new(f64::from(1.0 - hit.b1 - hit.b2), hit.b1.into(), hit.b2.into())
    } else {
        LimitSurface::weights(hit.cell, hit.b1, hit.b2, job.frame.subdivisions)
    };
    let [p0, p1, p2] = [a, b, c].map(|v| v.position.as_dvec3());
    let n = (p1 - p0).cross(p2 - p0).normalize();
    let flat = if triangle.flags & FLIPPED != 0 { -n } else { n };
    let [n0, n1, n2] = [a, b, c].map(|v| v.normal.as_dvec3());
    let smooth = (n0 * w.x + n1 * w.y + n2 * w.z).normalize();
    DQuat::from_rotation_arc(flat, if smooth.dot(flat) < 0.0 { -smooth } else { smooth }) * ng
}

/// Light from behind a micro-triangle as it would stand on the smooth base, seen from where the viewer is, gives
/// nothing, wherever the shading normal points; and it is never more than what Lambert's law at the shading normal
/// gives. Without shadows some light from behind the micro-triangle itself does.
#[test]
fn light_from_behind_the_surface_gives_nothing() {
    let mut numbers = Numbers::new(52);
    let (mut behind, mut tempted, mut lit, mut lifted) = (0, 0, 0, 0);
    for round in 0..600 {
        let mut scene = solid(&mut numbers, FORMATS[round % 3], 0.8, SCALES[round / 3 % 3]);
        scene.reliefs[0].scale *= 4.0;
        let normals = [Normals::Normalized, Normals::Linear][round % 2];
        let method = [Method::Quadtree, Method::BruteForce, Method::None][round % 3];
        let lights = vec![Light { position: DVec3::ZERO, color: Vec3::ONE, intensity: Some(1.0) }];
        let settings =
            Settings { normals, method, lights, smooth: true, ambient: 0.0, ..Settings::default() };
        let mut ready = job(scene, &Settings { shadows: round % 4 == 0, ..settings });
        for _ in 0..100 {
            let bounds = ready.bounds();
            let (centre, size) = ((bounds.min + bounds.max) * 0.5, (bounds.max - bounds.min).max_element());
            let light = centre + numbers.in_cube() * size;
            ready.move_light(light);
            let eye = centre + numbers.direction() * size * 2.0;
            let target = centre + numbers.in_cube() * size * 0.3;
            let Some((ray, hit)) = traced(&ready, eye, (target - eye).normalize()) else { continue };
            let surface = SurfaceInteraction::new(&ready.view(), ready.features, &ray, hit);
            let radiance = sample_ray(&ready.view(), ready.features, ray, &mut Counts::default()).radiance.x;
            let (ng, ns) = (surface.ng.as_dvec3(), surface.ns.as_dvec3());
            let to_light = (light - surface.point).as_dvec3();
            let (wi, wo) = (to_light.normalize(), -ray.direction.as_dvec3());
            let side = ng.dot(wo).signum();
            let smoothed = on_smooth_base(&ready, hit, ng);
            let (geometric, shading) = (side * wi.dot(smoothed), side * wi.dot(ns));
            // Which side a light is on is told from unit vectors: to some 4 u.
            // The smooth base's normal is off by some 20 u over its length, which is above 1/16 nearly everywhere.
            if geometric.abs() < 5e-5 || ng.dot(wo).abs() < 1e-6 {
                continue;
            }
            if geometric < 0.0 {
                assert_eq!(radiance, 0.0, "{surface:?} {light}");
                behind += 1;
                tempted += u32::from(shading > 0.0);
            }
            // Light arrives where shadow rays start, beyond the point's error: seen from there cosines up to 1 and
            // distances differ by as much of the distance, which counts twice squared.
            let viewer = ng * side;
            let start = surface.spawn_origin(viewer.as_vec3()).as_dvec3();
            let moved = start.distance(surface.point.as_dvec3()) / to_light.length();
            // Roundings of the cosine, of the distance squared and of the products: some 10 u of cosines up to 1.
            let whole = 0.8 * (shading.max(0.0) + 1e-6 + moved) / to_light.length_squared()
                * (1.0 + 1e-6 + 2.5 * moved);
            assert!(f64::from(radiance) <= whole, "{radiance}, {whole}: {surface:?} {light}");
            lit += u32::from(radiance > 0.0);
            lifted += u32::from(radiance > 0.0 && side * wi.dot(ng) < -1e-6);
        }
    }
    say(format_args!(
        "{behind} behind, {tempted} of them before the shading normal, {lit} lit, {lifted} from behind the facet"
    ));
    assert!(
        behind > 5_000 && tempted > 500 && lit > 5_000 && lifted > 100,
        "{behind} {tempted} {lit} {lifted}"
    );
}

/// Closed meshes with a light inside, displaced by wild maps, are black from outside.
#[test]
fn light_inside_a_closed_mesh_stays_there() {
    let mut numbers = Numbers::new(53);
    for (name, solid) in
        [("sphere", meshes::icosphere(1)), ("cube", meshes::cube()), ("knot", meshes::knot())]
    {
        let placed = solid.placed(1.0, 0.0);
        for (map, subdivisions) in WildMap::ALL.into_iter().zip([1, 2, 4, 3, 8]) {
            #[expect(clippy::cast_possible_truncation, reason = "a height")]
            let scale = (placed.room * 0.5) as f32;
            let scene = Scene {
                mesh: placed.mesh.clone(),
                reliefs: vec![Relief::new(map.map(&mut numbers), 0.5, scale)],
                materials: vec![Material::default()],
                parts: vec![],
                subdivisions,
            };
            let light =
                Light { position: placed.inside[0].as_dvec3(), color: Vec3::ONE, intensity: Some(1.0) };
            let settings = Settings {
                width: 64,
                height: 48,
                lights: vec![light],
                smooth: true,
                ambient: 0.0,
                ..Settings::default()
            };
            let picture = rendered(&mut CpuBackend::new(), &job(scene, &settings), 2);
            let seen = picture.pixels.iter().filter(|pixel| pixel.w > 0.0).count();
            let lit = picture.pixels.iter().filter(|pixel| pixel.truncate() != Vec3::ZERO).count();
            assert!(seen > 300, "{name}, {map:?}: only {seen} pixels show anything");
            assert_eq!(lit, 0, "{name}, {map:?}: light comes out in {lit} pixels");
        }
    }
}

/// The error of pictures of few micro-triangles against those of N = 256, with and without smooth shading: measured to
/// be from a half to nine tenths, and asserted to be less by a twentieth at the least. The cube's and the quilt's base
/// triangles are flat with parallel normals, and the reference is of micro-triangles' own normals; the knot is round,
/// and its reference is of a smooth base.
///
/// Not so for the cube's bumps of full height at N = 4 and 8, where a micro-triangle is wider than half a bump: what is
/// not displaced stands elsewhere in the picture, so that finding light and shade there makes its error no less. A
/// tenth as high they stay in place, and the error is that of shading.
#[test]
fn smooth_pictures_of_few_micro_triangles_are_nearer_to_those_of_many() {
    say(format_args!("| Scene | N | flat | smooth | smooth / flat |"));
    for (name, share) in
        [("builtin:cube", 1.0), ("builtin:cube", 0.1), ("builtin:quilt", 1.0), ("builtin:knot", 1.0)]
    {
        let picture = |n, smooth| {
            let (mut scene, settings) = builtin_scene(name, n, 120, 90);
            scene.reliefs[0].scale *= share;
            rendered(&mut CpuBackend::new(), &job(scene, &Settings { smooth, ..settings }), 4)
        };
        let reference = picture(256, name == "builtin:knot");
        for n in [4, 8, 16] {
            let [flat, smooth] = [false, true].map(|smooth| rmse(&picture(n, smooth), &reference));
            let ratio = smooth / flat;
            say(format_args!(
                "| {name}, {share} of its height | {n} | {flat:.4} | {smooth:.4} | {ratio:.2} |"
            ));
            let resolved = n == 16 || name != "builtin:cube" || share < 1.0;
            assert!(!resolved || ratio < 0.95, "{name}, {share}, N = {n}: {smooth} instead of {flat}");
        }
    }
}

/// How far micro-triangles' normals are from those of the surface that they approach, in degrees: the median over
/// points on cells at seams, and over points on the others. Shading normals are the same where the base is flat.
fn leaning(job: &ReadyJob, points: usize) -> [f64; 2] {
    let mut numbers = Numbers::new(54);
    let view = job.view();
    let limit = LimitSurface::new(&job.buffers, job.features);
    let n = job.frame.subdivisions;
    let (mut at_seams, mut inside) = (Vec::new(), Vec::new());
    while at_seams.len().min(inside.len()) < points {
        let mut hit = somewhere(job, &mut numbers);
        let cell = Cell::unpack(hit.cell);
        // Every other one is moved to the border.
        let cell = if numbers.below(2) == 0 { Cell { j: 0, upper: false, ..cell } } else { cell };
        hit.cell = cell.pack();
        let surface = SurfaceInteraction::new(&view, job.features, &any_ray(), hit);
        let w = LimitSurface::weights(hit.cell, hit.b1, hit.b2, n);
        let Some(approached) = limit.normal(hit.primitive, w) else { continue };
        let angle = surface.ng.as_dvec3().angle_between(approached.direction).to_degrees();
        let seams = job.buffers.triangles[hit.primitive as usize].seams;
        let on_border = |e| {
            let (j, k) = cell.vertex(e);
            j == 0 || k == 0 || j + k == n
        };
        let seam_at_j = seams != NO_SEAMS && job.buffers.seams[seams as usize].flags >> 4 & 1 != 0;
        if !(0..3).any(on_border) {
            inside.push(angle);
        } else if cell.j == 0 && !cell.upper && seam_at_j {
            at_seams.push(angle);
        }
    }
    [at_seams, inside].map(|mut angles| {
        let middle = angles.len() / 2;
        *angles.select_nth_unstable_by(middle, f64::total_cmp).1
    })
}

/// Micro-triangles come nearer to a triangle's own height field, whose slope shading normals have, in proportion to 1 /
/// N (asserted: by half for N four times as large), but for those at a seam that has heights or directions of its own.
#[test]
fn micro_triangles_approach_their_height_field_but_for_seams() {
    let mut before = [f64::INFINITY; 2];
    for n in [16, 64, 256] {
        let (scene, settings) = builtin_scene("builtin:cube", n, 1, 1);
        let settings = Settings { smooth: true, ..settings };
        let cube = leaning(&job(scene.clone(), &settings), 4000);
        let mesh = meshes::icosphere(2).placed(1.0, 0.0).mesh;
        let sphere = leaning(&job(Scene { mesh, ..scene }, &settings), 4000);
        say(format_args!("N = {n}, degrees at seams and inside: cube {cube:.2?}, sphere {sphere:.2?}"));
        for (inside, before) in [cube[1], sphere[1]].into_iter().zip(&mut before) {
            assert!(inside < 0.5 * *before, "N = {n}: {inside} after {before}");
            *before = inside;
        }
    }
}
