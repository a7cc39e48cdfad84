//! Adaptive N: triangles that are cut differently meet without a crack, and are intersected exactly.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::settings::{DisplacementKind, Normals, Settings};
use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
use emboss_kernels::interface::{Intersection, MISS, Ray, height_format, method};
use emboss_kernels::scene::Features;
use emboss_tests::exact::{Court, patchwork};
use emboss_tests::meshes::{self, Solid};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{self, ReadyJob, with_vectors};
use emboss_tests::views::{cuts, cuts_from, greatest_step, near_a_vertex, rough, seen};
use emboss_tests::{HardRays, Hardship, LeakRays, Numbers, RaySource};
use glam::Vec3;
use std::collections::HashMap;

const KINDS: [DisplacementKind; 3] =
    [DisplacementKind::Height, DisplacementKind::Tangent, DisplacementKind::Object];

/// Closed meshes with seams of every kind; the last one has two maps.
fn solids() -> [(Solid, bool); 4] {
    [
        (meshes::cube(), false),
        (meshes::icosphere(2), false),
        (meshes::genus_three(1), false),
        (meshes::icosphere(1), true),
    ]
}

/// Settings of a turn: heights and vectors, unit and linear directions.
fn settings(turn: usize) -> Settings {
    let normals = [Normals::Normalized, Normals::Linear][turn / 3 % 2];
    Settings { displacement: KINDS[turn % 3], normals, ..Settings::default() }
}

/// A position's bits, which -0 shares with 0.
fn key(p: Vec3) -> [u32; 3] {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// The polylines that triangles have over each edge of the base mesh, by the positions of its ends.
fn polylines(job: &ReadyJob) -> HashMap<[[u32; 3]; 2], Vec<Vec<[u32; 3]>>> {
    let view = job.view();
    let whole = HeightField::new(&view, job.features);
    let mut polylines: HashMap<_, Vec<_>> = HashMap::new();
    for primitive in 0..view.frame.triangle_count {
        let field = whole.of_triangle(&view, primitive, 0);
        let (base, n) = (BaseTriangle::load(&view, primitive), field.subdivisions);
        for (edge, ends) in [(0, [1, 2]), (1, [0, 2]), (2, [0, 1])] {
            let point = |m: u32| [(n - m, m), (0, m), (m, 0)][edge];
            let mut line: Vec<_> = (0..=n)
                .map(|m| {
                    let (j, k) = point(m);
                    key(base.micro_vertex(&field, j, k))
                })
                .collect();
            line.dedup();
            let ends = ends.map(|e| key(base.position(e)));
            polylines.entry(ends).or_default().push(line);
        }
    }
    polylines
}

/// The surface's border over each edge is the same to the bit for all triangles there, however differently they are
/// cut.
#[test]
fn triangles_have_one_polyline_over_an_edge() {
    let mut numbers = Numbers::new(1);
    let mut greatest = 0;
    for (turn, (solid, second_map)) in solids().into_iter().cycle().take(16).enumerate() {
        let placed = solid.placed([1.0, 1e-6, 1e6][turn / 4 % 3], [0.0, 1e2][turn % 2]);
        let settings = settings(turn);
        let scene = rough(&placed, settings.displacement, second_map, &mut numbers);
        let eye = near_a_vertex(&placed, [0.1, 0.5][turn / 2 % 2], &mut numbers);
        let job = seen(scene, eye, [0.02, 0.2, 1.0][turn % 3], 512, &settings);
        greatest = greatest.max(greatest_step(&job));
        for (ends, lines) in polylines(&job) {
            assert!(lines.len() >= 2, "the mesh is closed");
            let agree = lines.iter().all(|line| *line == lines[0]);
            let lengths: Vec<_> = lines.iter().map(Vec::len).collect();
            assert!(agree, "{lengths:?} points over {:?}", ends.map(|p| p.map(f32::from_bits)));
        }
    }
    assert!(greatest >= 64, "neighbours are alike: {greatest}");
}

/// Rays from within closed meshes, most of them aimed at edges of the base mesh.
#[test]
fn solids_seen_from_nearby_are_closed() {
    const RAYS: usize = 6_000;
    let (mut numbers, mut greatest) = (Numbers::new(2), 0);
    for (turn, (solid, second_map)) in solids().into_iter().cycle().take(24).enumerate() {
        let placed = solid.placed([1.0, 1e-6, 1e6][turn / 4 % 3], [0.0, 1e2][turn / 2 % 2]);
        let settings = settings(turn);
        let scene = rough(&placed, settings.displacement, second_map, &mut numbers);
        let eye = near_a_vertex(&placed, [0.1, 0.3, 1.0][turn % 3], &mut numbers);
        let job = seen(scene, eye, [0.05, 0.2, 1.0][turn / 3 % 3], 256, &settings);
        greatest = greatest.max(greatest_step(&job));
        let rays = LeakRays::new(&job, &placed.inside, numbers.bits()).rays(0, RAYS);
        let leaks = traced(&job, method::QUADTREE, &rays).iter().filter(|hit| hit.primitive == MISS).count();
        assert_eq!(leaks, 0, "turn {turn}: {:?}", job.frame);
    }
    assert!(greatest >= 64, "neighbours are alike: {greatest}");
}

/// The nearest hits by a method.
fn traced(job: &ReadyJob, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, Features { method, ..job.features }).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// Scenes of seams, fins and sheets, seen from somewhere.
fn patchworks() -> impl Iterator<Item = (String, ReadyJob)> {
    let formats = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];
    (0..12).map(move |turn| {
        let mut numbers = Numbers::new(100 + turn as u64);
        let settings = settings(turn);
        let scene = patchwork(turn as u64, [formats[turn % 3]; 2], 1);
        let scene = match settings.displacement {
            DisplacementKind::Height => scene,
            _ => with_vectors(scene, &mut numbers),
        };
        let eye = numbers.direction() * [1.8, 2.5, 6.0][turn % 3];
        (format!("patchwork {turn}"), seen(scene, eye, 0.4, 32, &settings))
    })
}

/// Quadtree and brute force to the bit, by the hardest rays.
#[test]
fn quadtree_is_brute_force_over_coarse_edges() {
    for (what, job) in patchworks() {
        let mut source = HardRays::new(&job, 3);
        let mut soft = RaySource::new(&job, 4);
        let mut rays: Vec<Ray> = (0..600).map(|i| source.ray(Hardship::ALL[i % 10])).collect();
        rays.extend((0..600).map(|i| if i % 2 == 0 { soft.from_inside() } else { soft.towards_edge(3.0) }));
        let (exact, found) =
            (traced(&job, method::BRUTE_FORCE, &rays), traced(&job, method::QUADTREE, &rays));
        for ((ray, exact), found) in rays.iter().zip(&exact).zip(&found) {
            let same = bytemuck::bytes_of(exact) == bytemuck::bytes_of(found);
            assert!(same, "{what}\n{ray:?}\nbrute force {exact:?}\nquadtree {found:?}\n{:?}", job.frame);
        }
    }
}

/// The oracle works out N of every triangle and edge for itself.
#[test]
fn scenes_seen_from_nearby_are_exact() {
    let mut backend = CpuBackend::new();
    let mut court = Court::new(&mut backend, Oracle::new);
    for (what, job) in patchworks() {
        assert!(greatest_step(&job) > 1, "{what}: {:?}", cuts(&job).collect::<Vec<_>>());
        court.judge_job(&what, &job, 5, 4_000);
    }
    for (name, eye, pixels) in
        [("builtin:cube", Vec3::new(0.9, 0.8, 1.3), 0.4), ("builtin:knot", Vec3::new(1.0, 1.1, 1.2), 0.03)]
    {
        let scene = scenes::builtin(name);
        let job = seen(scene, eye, pixels, 64, &Settings::default());
        assert!(greatest_step(&job) > 1, "{name} is cut alike");
        court.judge_job(name, &job, 6, 4_000);
    }
}

/// While the camera comes nearer in a straight line, no triangle is cut into fewer parts than before: nothing goes back
/// and forth.
#[test]
#[expect(clippy::print_stdout, reason = "the number of changes is what EXACTNESS.md states")]
fn n_only_grows_while_the_camera_approaches() {
    let start = Vec3::new(0.5, 0.6, 5.0);
    let job = seen(scenes::builtin("builtin:knot"), start, 0.003, 4096, &Settings::default());
    let at = |frame: i32| {
        let eye = start * 0.99_f32.powi(frame);
        cuts_from(&job, eye).map(|cut| cut.triangle).collect::<Vec<_>>()
    };
    let (mut before, mut changes, frames) = (at(0), 0, 60);
    for frame in 1..=frames {
        let after = at(frame);
        assert!(before.iter().zip(&after).all(|(a, b)| a <= b), "frame {frame}");
        changes += before.iter().zip(&after).filter(|(a, b)| a != b).count();
        before = after;
    }
    println!("{changes} changes of {} triangles in {frames} frames", before.len());
}
