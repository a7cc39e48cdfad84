//! Smooth shading of few base triangles, against a sphere in closed form: facets of the base do not show in normals,
//! nor in where light ends.

#![expect(clippy::cast_possible_truncation, reason = "rounded to what kernels read")]

use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{DisplacementKind, Light, Method, Normals, Settings};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::height_format;
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::render::sample_ray;
use emboss_kernels::shading::SurfaceInteraction;
use emboss_tests::Numbers;
use emboss_tests::meshes;
use emboss_tests::scenes::{ReadyJob, job};
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

/// Prints what a test measured, for `--nocapture`.
#[expect(clippy::print_stdout, reason = "docs/SHADING.md shows these numbers")]
fn say(line: std::fmt::Arguments<'_>) {
    println!("{line}");
}

/// Texels of a row of the sine's map.
const TEXELS: u32 = 1024;
/// Periods of the sine from x = -1 to 1.
const PERIODS: f64 = 3.0;
/// Its height.
const HEIGHT: f64 = 0.01;

/// A unit sphere of few triangles, its normals exact, under a sine of x: u is (x + 1) / 2, so that it is of the point
/// itself.
fn sphere(levels: u32, height: f64) -> Scene {
    let solid = meshes::icosphere(levels);
    let mut vertices = solid.vertices;
    for vertex in &mut vertices {
        vertex.normal = vertex.position.normalize();
        (vertex.u, vertex.v) = (0.5 + vertex.position.x * 0.5, 0.5);
    }
    let texel = |i: u32| {
        let u = (f64::from(i) + 0.5) / f64::from(TEXELS);
        ((0.5 + 0.5 * (TAU * PERIODS * u).sin()) as f32).to_bits()
    };
    let map = HeightMap {
        width: TEXELS,
        height: 1,
        format: height_format::FLOAT32,
        texels: (0..TEXELS).map(texel).collect(),
        range: (0.0, 1.0),
        replaced: 0,
    };
    Scene {
        mesh: Mesh::from_triangles(&vertices, &solid.triangles),
        // Texels go from 0 to 1, the sine from -1 to 1.
        reliefs: vec![Relief::new(map, 0.5, (2.0 * height) as f32)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 16,
    }
}

/// The same with vectors along the normal alone.
fn with_vectors(mut scene: Scene) -> Scene {
    let relief = scene.reliefs[0].clone();
    let none = Relief { scale: 0.0, ..relief.clone() };
    scene.reliefs = vec![none.clone(), none, relief];
    scene
}

/// The normal of the true surface (1 + h(d)) d in the direction d: d - grad h / (1 + h), the gradient along the sphere.
fn true_normal(d: DVec3) -> DVec3 {
    let k = TAU * PERIODS / 2.0;
    let phase = k * (d.x + 1.0);
    let gradient = DVec3::X * (HEIGHT * k * phase.cos());
    let along = gradient - d * gradient.dot(d);
    (d - along / (1.0 + HEIGHT * phase.sin())).normalize()
}

fn hit_at(primitive: u32, w: DVec3, n: u32) -> Hit {
    let (alpha, beta) = (w.y as f32, w.z as f32);
    let cell = Cell::containing(alpha, beta, n);
    let [(j0, k0), (j1, k1), (j2, k2)] = [0, 1, 2].map(|e| cell.vertex(e));
    // Solves the cell's own barycentrics from its corners on the grid.
    let n = f64::from(n);
    let corner = |j: u32, k: u32| (f64::from(j) / n, f64::from(k) / n);
    let ((x0, y0), (x1, y1), (x2, y2)) = (corner(j0, k0), corner(j1, k1), corner(j2, k2));
    let determinant = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
    let b1 = ((w.y - x0) * (y2 - y0) - (x2 - x0) * (w.z - y0)) / determinant;
    let b2 = ((x1 - x0) * (w.z - y0) - (w.y - x0) * (y1 - y0)) / determinant;
    let (b1, b2) = (b1 as f32, b2 as f32);
    Hit { t: 0.0, primitive, cell: cell.pack(), b1, b2, instance: 0 }
}

fn shaded(job: &ReadyJob, primitive: u32, w: DVec3) -> SurfaceInteraction {
    let ray = TraversalRay::new(Vec3::ZERO, Vec3::X, f32::INFINITY);
    let hit = hit_at(primitive, w, job.frame.subdivisions);
    SurfaceInteraction::new(&job.view(), job.features, &ray, hit)
}

/// A point of the base.
struct Place {
    /// Its direction, which its interpolated normal is along.
    direction: DVec3,
    /// By how much the sphere is above it.
    below: f64,
    /// The tangent of the angle between its facet and the sphere.
    lean: f64,
}

fn place(job: &ReadyJob, primitive: u32, w: DVec3) -> Place {
    let [a, b, c] = job.buffers.triangles[primitive as usize]
        .vertices
        .map(|v| job.buffers.vertices[v as usize].position.as_dvec3());
    let p = a * w.x + b * w.y + c * w.z;
    let (direction, facet) = (p.normalize(), (b - a).cross(c - a).normalize());
    let cos = direction.dot(facet).abs();
    Place { direction, below: 1.0 - p.length(), lean: (1.0 / (cos * cos) - 1.0).max(0.0).sqrt() }
}

/// A random point of a triangle.
fn weights(numbers: &mut Numbers) -> DVec3 {
    let w = numbers.barycentric().as_dvec3();
    w / (w.x + w.y + w.z)
}

/// Against the true normals of a sphere with a sine on it. The map is read at the point p of the base instead of d,
/// which lies s above it, and tangents are as long as |p| = 1 - s says: so a slope g of up to k HEIGHT is off by k s g
/// for the place, and by some s g for the length; by g times the lean of the facet, since texture coordinates grow
/// along the facet, and by k g / (texels a unit) for the bilinear filter. A unit normal is off by no more than its
/// slope.
#[test]
fn normals_on_few_triangles_are_those_of_a_sphere() {
    let k = TAU * PERIODS / 2.0;
    for (levels, kind, normals) in [
        (1, DisplacementKind::Height, Normals::Normalized),
        (2, DisplacementKind::Height, Normals::Normalized),
        (2, DisplacementKind::Height, Normals::Linear),
        (1, DisplacementKind::Tangent, Normals::Normalized),
        (2, DisplacementKind::Tangent, Normals::Linear),
    ] {
        let scene = sphere(levels, HEIGHT);
        let scene = if kind == DisplacementKind::Height { scene } else { with_vectors(scene) };
        let settings = Settings { displacement: kind, normals, smooth: true, ..Settings::default() };
        let job = job(scene, &settings);
        let mut numbers = Numbers::new(61);
        let (mut facets, mut smooth, mut worst) = (0.0, 0.0, 0.0_f64);
        const POINTS: u32 = 4000;
        for _ in 0..POINTS {
            let primitive = numbers.below(job.frame.triangle_count);
            let w = weights(&mut numbers);
            let Place { direction: d, below: s, lean } = place(&job, primitive, w);
            let surface = shaded(&job, primitive, w);
            let expected = true_normal(d);
            let error = surface.ns.as_dvec3().distance(expected);
            let g = k * HEIGHT;
            // Linear directions are |p| long, and so are their heights.
            let shorter = if normals == Normals::Linear { s } else { 0.0 };
            let bound = g * (lean + k * s + 2.0 * s + shorter + k * 2.0 / f64::from(TEXELS)) + 1e-5;
            assert!(
                error <= bound,
                "{kind:?} {normals:?} {levels}: {error} above {bound} at {w} of {primitive}"
            );
            worst = worst.max(error);
            smooth += error / f64::from(POINTS);
            facets += surface.ng.as_dvec3().distance(expected) / f64::from(POINTS);
        }
        say(format_args!(
            "{kind:?} {normals:?} {levels}: {facets:.4} of facets, {smooth:.5} smooth, {worst:.5} worst"
        ));
        assert!(smooth * 8.0 <= facets, "{kind:?} {normals:?} {levels}: {smooth} {facets}");
    }
}

/// The normals on both sides of a base edge are one without relief. With it only the map's slope jumps, by what it is
/// off on both sides.
#[test]
fn normals_do_not_jump_across_base_edges() {
    for height in [0.0, HEIGHT] {
        let job = job(sphere(1, height), &Settings { smooth: true, ..Settings::default() });
        let triangles = &job.buffers.triangles;
        let (mut edges, mut worst, mut facets) = (0, 0.0_f64, 0.0_f64);
        let slope = height * TAU * PERIODS / 2.0;
        for (i, a) in triangles.iter().enumerate() {
            for (j, b) in triangles.iter().enumerate().skip(i + 1) {
                let shared: Vec<u32> = a.vertices.into_iter().filter(|v| b.vertices.contains(v)).collect();
                let [v0, v1] = shared[..] else { continue };
                edges += 1;
                for share in [0.1, 0.37, 0.5, 0.93] {
                    let on = |t: &[u32; 3]| {
                        let weight = |v: u32| {
                            if v == v0 {
                                share
                            } else if v == v1 {
                                1.0 - share
                            } else {
                                0.0
                            }
                        };
                        DVec3::from(t.map(weight))
                    };
                    let index = |i: usize| u32::try_from(i).expect("few");
                    let sides = [(index(i), on(&a.vertices)), (index(j), on(&b.vertices))];
                    let [p, q] = sides.map(|(i, w)| shaded(&job, i, w));
                    let [lean_p, lean_q] = sides.map(|(i, w)| place(&job, i, w).lean);
                    let jump = p.ns.as_dvec3().distance(q.ns.as_dvec3());
                    // Some ten roundings.
                    assert!(jump <= slope * (lean_p + lean_q) + 1e-6, "{jump} at {sides:?}");
                    worst = worst.max(jump);
                    facets = facets.max(p.ng.as_dvec3().distance(q.ng.as_dvec3()));
                }
            }
        }
        say(format_args!("height {height}: {worst} jumps where facets jump {facets}"));
        assert!(edges == 120 && worst * 8.0 <= facets && facets > 0.2, "{edges} {worst} {facets}");
    }
}

/// The nearest hit of a ray.
fn traced(job: &ReadyJob, ray: TraversalRay) -> Hit {
    traverse(&job.view(), job.features, &ray, Query::Nearest, &mut Counts::default())
}

/// On a convex base without relief each point is lit by Lambert's law at the interpolated normal, up to where that
/// turns away from the light, and nowhere else: no facet shadows itself or another, from whichever side light comes.
#[test]
fn light_ends_where_the_smooth_base_turns_away() {
    let mut numbers = Numbers::new(62);
    let (mut lit, mut dark, mut behind) = (0, 0, 0);
    for (levels, method, inside_out) in [
        (0, Method::None, false),
        (1, Method::None, false),
        (1, Method::Quadtree, false),
        (1, Method::Bump, false),
        (2, Method::Tessellate, false),
        (1, Method::None, true),
        (1, Method::Quadtree, true),
    ] {
        let light = Light { position: DVec3::X, color: Vec3::ONE, intensity: Some(1.0) };
        let settings =
            Settings { method, lights: vec![light], smooth: true, ambient: 0.0, ..Settings::default() };
        let mut scene = sphere(levels, 0.0);
        scene.subdivisions = 4;
        if inside_out {
            scene.mesh.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.normal);
            scene
                .mesh
                .triangles
                .iter_mut()
                .for_each(|triangle| triangle.flags ^= emboss_kernels::interface::FLIPPED);
        }
        let mut ready = job(scene, &settings);
        let albedo = f64::from(Material::default().albedo.x);
        for _ in 0..3000 {
            let light = numbers.direction() * numbers.between(2.0, 6.0);
            ready.move_light(light);
            let eye = numbers.direction() * 3.0;
            let ray = TraversalRay::new(eye, (numbers.in_cube() * 0.6 - eye).normalize(), f32::INFINITY);
            let hit = traced(&ready, ray);
            if !hit.is_some() {
                continue;
            }
            let surface = SurfaceInteraction::new(&ready.view(), ready.features, &ray, hit);
            let radiance = sample_ray(&ready.view(), ready.features, ray, &mut Counts::default()).radiance.x;
            let n = surface.point.as_dvec3().normalize();
            let to_light = (light - surface.point).as_dvec3();
            let cosine = n.dot(to_light.normalize());
            let expected = albedo * cosine.max(0.0) / to_light.length_squared();
            // Some thirty roundings of numbers up to 1: the point, its normal, the direction to the light.
            let bound = 2e-5 / to_light.length_squared();
            assert!(
                (f64::from(radiance) - expected).abs() <= bound,
                "{levels} {method:?}: {radiance}, not {expected}, cosine {cosine}, over the facet {}",
                surface.ng.as_dvec3().dot(to_light.normalize())
            );
            lit += u32::from(cosine > 0.0);
            dark += u32::from(cosine <= 0.0);
            let side = if inside_out { -1.0 } else { 1.0 };
            behind += u32::from(cosine > 1e-3 && side * surface.ng.as_dvec3().dot(to_light) < -1e-3);
        }
    }
    say(format_args!("{lit} lit, {behind} of them from behind the facet, {dark} dark"));
    assert!(lit > 3000 && dark > 1000 && behind > 100, "{lit} {behind} {dark}");
}

/// Two shells with a gap that is narrower than the lift from the inner one: what is seen of it from within the gap gets
/// no light from outside of the outer one.
#[test]
fn light_does_not_come_through_a_shell_that_the_lift_reaches_beyond() {
    let mut scene = sphere(0, 0.0);
    let vertices = scene.mesh.vertices.clone();
    let outer: Vec<_> = vertices
        .iter()
        .map(|vertex| emboss_kernels::interface::Vertex { position: vertex.position * 1.02, ..*vertex })
        .collect();
    let triangles = |mesh: &Mesh| -> Vec<[u32; 3]> {
        let flipped =
            |t: &emboss_kernels::interface::Triangle| t.flags & emboss_kernels::interface::FLIPPED != 0;
        mesh.triangles
            .iter()
            .map(|t| if flipped(t) { [t.vertices[0], t.vertices[2], t.vertices[1]] } else { t.vertices })
            .collect()
    };
    let shell = Mesh::from_triangles(&outer, &triangles(&scene.mesh));
    scene.mesh.append(shell);
    let light = Light { position: DVec3::X, color: Vec3::ONE, intensity: Some(1.0) };
    let settings = Settings {
        method: Method::None,
        lights: vec![light],
        smooth: true,
        ambient: 0.0,
        ..Settings::default()
    };
    let mut ready = job(scene, &settings);
    let mut numbers = Numbers::new(63);
    let mut tempted = 0;
    for _ in 0..20_000 {
        // From the gap, onto the inner shell.
        let primitive = numbers.below(20);
        let w = weights(&mut numbers);
        let Place { direction: d, below: s, .. } = place(&ready, primitive, w);
        let lean = numbers.in_cube().as_dvec3() * 0.3;
        let from = d * (1.0 - s) * 1.008 + lean.reject_from_normalized(d) * 0.02;
        let (eye, view) = (from.as_vec3(), (d * (1.0 - s) - from).normalize().as_vec3());
        let ray = TraversalRay::new(eye, view, f32::INFINITY);
        let hit = traced(&ready, ray);
        let light = numbers.direction() * 3.0;
        ready.move_light(light);
        if !hit.is_some() || hit.primitive >= 20 {
            continue;
        }
        let radiance = sample_ray(&ready.view(), ready.features, ray, &mut Counts::default()).radiance.x;
        assert_eq!(radiance, 0.0, "{eye} {view} {light}");
        let wi = (light.as_dvec3() - from).normalize();
        let surface = SurfaceInteraction::new(&ready.view(), ready.features, &ray, hit);
        let reaches = surface.base.lift.length() > 0.05;
        tempted += u32::from(reaches && d.dot(wi) > 0.1 && surface.ng.as_dvec3().dot(wi) < 0.0);
    }
    assert!(tempted > 300, "{tempted}");
}
