//! The CPU backend's closest hits against the surface in f64.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::settings::Wrap;
use emboss_kernels::interface::{Intersection, MISS, Ray, height_format, method};
use emboss_kernels::scene::Features;
use emboss_tests::exact::{self, Tally};
use emboss_tests::oracle::{Clarity, Disagreement, Oracle};
use emboss_tests::scenes::{self, ReadyJob};
use emboss_tests::{Numbers, RaySource};

/// The nearest hits of rays by one method.
fn traced(job: &ReadyJob, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    let features = Features { method, ..job.features };
    backend.load(&job.buffers, &job.frame, features).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// Traces rays by both exact methods and has every answer judged.
fn judge(job: &ReadyJob, rays: &[Ray], tally: &mut Tally) {
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    for method in [method::QUADTREE, method::BRUTE_FORCE] {
        *tally += exact::judge(job, &oracle, rays, &traced(job, method, rays));
    }
}

/// So many rays of each kind.
fn rays(job: &ReadyJob, seed: u64, of_each: usize) -> Vec<Ray> {
    let mut source = RaySource::new(job, seed);
    let three = |_| [source.from_outside(), source.from_inside(), source.grazing()];
    (0..of_each).flat_map(three).collect()
}

/// Rays that leave the hits of `rays`. Each is close to the triangle that it leaves.
fn leaving(job: &ReadyJob, seed: u64, rays: &[Ray]) -> Vec<Ray> {
    let mut source = RaySource::new(job, seed);
    let hits = traced(job, method::BRUTE_FORCE, rays);
    hits.iter().filter(|hit| hit.primitive != MISS).map(|hit| source.leaving(hit)).collect()
}

/// Has rays of all kinds judged; those that leave a hit apart, since rounding always leaves them a choice.
fn judge_all_kinds(job: &ReadyJob, seed: u64, of_each: usize, tally: &mut Tally) {
    let rays = rays(job, seed, of_each);
    judge(job, &rays, tally);
    judge(job, &leaving(job, seed + 1, &rays), &mut Tally::default());
}

fn judge_builtin(name: &str, of_each: usize) {
    let mut tally = Tally::default();
    for n in [1, 3, 8] {
        let job = scenes::ready(Scene { subdivisions: n, ..scenes::builtin(name) }, Wrap::Repeat);
        judge_all_kinds(&job, u64::from(n), of_each, &mut tally);
    }
    tally.assert_clear();
}

#[test]
fn cube_is_met_as_in_f64() {
    judge_builtin("builtin:cube", 1000);
}

#[test]
fn quilt_is_met_as_in_f64() {
    judge_builtin("builtin:quilt", 1000);
}

#[test]
fn knot_is_met_as_in_f64() {
    judge_builtin("builtin:knot", 500);
}

/// Every format, wrap, and normals that lean from not at all to wildly.
#[test]
fn random_solids_are_met_as_in_f64() {
    let mut numbers = Numbers::new(1);
    let mut tally = Tally::default();
    let formats = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];
    let wraps = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
    for round in 0..180 {
        let spread = [0.0, 0.1, 0.5, 1.0][round % 4];
        let scene = scenes::random_solid(&mut numbers, formats[round % 3], spread);
        let job = scenes::ready(scene, wraps[round / 3 % 3]);
        judge_all_kinds(&job, numbers.bits() >> 1, 50, &mut tally);
    }
    tally.assert_clear();
}

/// Rays through micro-vertices, and towards the edges where base triangles meet.
fn judge_edges(radii: f32, spread: f32) {
    let mut numbers = Numbers::new(2);
    let mut tally = Tally::default();
    for _ in 0..100 {
        let scene = scenes::random_solid(&mut numbers, height_format::UNORM8, spread);
        let job = scenes::ready(scene, Wrap::Repeat);
        let mut source = RaySource::new(&job, numbers.bits());
        let two = |_| [source.along_normal(), source.towards_edge(radii)];
        let rays: Vec<Ray> = (0..100).flat_map(two).collect();
        judge(&job, &rays, &mut tally);
    }
    tally.assert_tight();
}

#[test]
fn edges_and_vertices_let_no_ray_through() {
    judge_edges(3.0, 0.0);
    judge_edges(3.0, 0.3);
}

/// From a thousand radii away rounding moves a vertex a thousand times as far as from nearby, far beyond the rounding
/// of the vertex itself.
#[test]
fn edges_and_vertices_let_no_ray_through_from_afar() {
    judge_edges(1000.0, 0.0);
    judge_edges(1000.0, 0.3);
}

/// The same where edges run along the axes, so that they lie on the faces of their triangles' boxes: boxes have to
/// reach as far as rounding moves vertices.
fn judge_aligned_edges(radii: f32, scale: f32) {
    let mut tally = Tally::default();
    for n in [1, 2, 5] {
        let tiles = scenes::scaled(Scene { subdivisions: n, ..scenes::tiles() }, scale);
        let job = scenes::ready(tiles, Wrap::Repeat);
        let mut source = RaySource::new(&job, u64::from(n));
        let rays: Vec<Ray> = (0..3000).map(|_| source.towards_edge(radii)).collect();
        judge(&job, &rays, &mut tally);
    }
    // Half of the directions come from below, and an eighth of the edges are the sheet's border.
    assert!(2 * tally.must_hit > tally.rays, "too few hits that are sure: {tally:?}");
}

#[test]
fn aligned_edges_let_no_ray_through() {
    judge_aligned_edges(3.0, 0.0);
    judge_aligned_edges(3.0, 0.1);
}

#[test]
fn aligned_edges_let_no_ray_through_from_afar() {
    judge_aligned_edges(1000.0, 0.0);
    judge_aligned_edges(1000.0, 0.1);
}

/// The judge itself: each way of being wrong is found on clear rays.
#[test]
fn wrong_answers_are_found() {
    let job = scenes::ready(Scene { subdivisions: 3, ..scenes::builtin("builtin:cube") }, Wrap::Repeat);
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let rays: Vec<Ray> = rays(&job, 9, 100);
    let (mut judged, mut seconds) = (0, 0);
    for (ray, hit) in rays.iter().zip(traced(&job, method::BRUTE_FORCE, &rays)) {
        let answer = oracle.trace(ray);
        if hit.primitive == MISS || answer.judge(&hit) != Ok(Clarity::Clear) {
            continue;
        }
        judged += 1;
        // The ray passes the neighbour by, or meets it elsewhere.
        let elsewhere = |wrong| {
            let found = answer.judge(&wrong);
            assert!(
                matches!(found, Err(Disagreement::PassedBy | Disagreement::Distance { .. })),
                "{found:?}"
            );
        };
        elsewhere(Intersection { cell: hit.cell ^ 1, ..hit });
        elsewhere(Intersection { primitive: hit.primitive ^ 1, ..hit });
        let missed = answer.judge(&Intersection { primitive: MISS, ..hit });
        assert!(matches!(missed, Err(Disagreement::Missed { .. })));
        let farther = answer.judge(&Intersection { t: 2.0 * hit.t + 20.0, ..hit });
        assert!(matches!(farther, Err(Disagreement::Distance { .. })));
        let nearest = answer.nearest().expect("it is hit");
        if let Some(behind) = answer.meetings.iter().find(|m| m.margin > 0.0 && m.t_low > nearest.t_high) {
            #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
            let t = (behind.t / ray.direction.as_dvec3().length()) as f32;
            let second = answer.judge(&Intersection { primitive: behind.base, cell: behind.cell, t, ..hit });
            assert!(matches!(second, Err(Disagreement::NotNearest { .. })), "{second:?}");
            seconds += 1;
        }
        let surface = |wrong| oracle.judge_surface(ray, &answer, &wrong);
        let moved = surface(Intersection { point: hit.point + hit.normal * 1e-3, ..hit });
        assert!(matches!(moved, Err(Disagreement::Point { .. })));
        let slid = surface(Intersection { b1: hit.b2, b2: 1.0 - hit.b1 - hit.b2, ..hit });
        assert!(matches!(slid, Err(Disagreement::Point { .. })));
        let inverted = surface(Intersection { normal: -hit.normal, ..hit });
        assert!(matches!(inverted, Err(Disagreement::Normal { .. })));
        let shifted = surface(Intersection { u: hit.u + 1e-4, ..hit });
        assert!(matches!(shifted, Err(Disagreement::TextureCoordinates { .. })));
    }
    assert!(judged > 100 && seconds > 50, "{judged} {seconds}");
}
