//! The CPU backend's closest hits against the surface in f64.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::{Job, Scene};
use emboss::settings::Wrap;
use emboss_kernels::interface::{Intersection, MISS, Ray, height_format, method};
use emboss_kernels::scene::Features;
use emboss_tests::oracle::{Clarity, Oracle};
use emboss_tests::{Numbers, RaySource, scenes};

/// What became of the rays of a test.
#[derive(Debug, Default)]
struct Tally {
    rays: u64,
    hits: u64,
    /// Rays for which rounding left no choice.
    clear: u64,
    /// Hits on the micro-triangle that exact arithmetic finds nearest.
    same: u64,
}

impl Tally {
    /// Asserts that the rays were a test: enough hits, and so few close calls that wrong answers had nowhere to hide.
    fn assert_meaningful(&self) {
        assert!(2 * self.hits > self.rays, "too few hits: {self:?}");
        assert!(20 * self.clear > 19 * self.rays, "too many close calls: {self:?}");
        assert!(100 * self.same > 99 * self.hits, "too many other micro-triangles: {self:?}");
    }
}

/// The nearest hits of rays by one method.
fn traced(job: &Job, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    let features = Features { method, ..job.features };
    backend.load(&job.buffers, &job.frame, features).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// Traces rays by both methods and has every answer judged.
fn judge(job: &Job, rays: &[Ray], tally: &mut Tally) {
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let answers: Vec<_> = rays.iter().map(|ray| oracle.trace(ray)).collect();
    for method in [method::BRUTE_FORCE, method::GRID_WALK] {
        for ((ray, answer), hit) in rays.iter().zip(&answers).zip(traced(job, method, rays)) {
            let context = || {
                let n = job.frame.displacement.subdivisions;
                format!("method {method}, N = {n}\n{ray:?}\n{hit:?}\n{answer:#?}")
            };
            match answer.judge(&hit) {
                Ok(clarity) => tally.clear += u64::from(clarity == Clarity::Clear),
                Err(disagreement) => panic!("{disagreement:?}: {}", context()),
            }
            tally.rays += 1;
            if hit.primitive == MISS {
                continue;
            }
            tally.hits += 1;
            let same = answer.nearest().is_some_and(|m| (m.base, m.cell) == (hit.primitive, hit.cell));
            tally.same += u64::from(same);
            if let Err(disagreement) = oracle.judge_surface(ray, answer, &hit) {
                panic!("{disagreement:?}: {}", context());
            }
        }
    }
}

/// So many rays of each kind.
fn rays(job: &Job, seed: u64, of_each: usize) -> Vec<Ray> {
    let mut source = RaySource::new(job, seed);
    let mut rays = Vec::new();
    for _ in 0..of_each {
        rays.extend([source.from_outside(), source.from_inside(), source.grazing()]);
    }
    let hits = traced(job, method::BRUTE_FORCE, &rays);
    let leaving: Vec<Ray> = hits
        .iter()
        .filter(|hit| hit.primitive != MISS)
        .take(of_each)
        .map(|hit| source.leaving(hit))
        .collect();
    rays.extend(leaving);
    rays
}

fn judge_builtin(name: &str, of_each: usize) {
    let mut tally = Tally::default();
    for n in [1, 3, 8] {
        let job = scenes::ready(Scene { subdivisions: n, ..scenes::builtin(name) }, Wrap::Repeat);
        judge(&job, &rays(&job, u64::from(n), of_each), &mut tally);
    }
    tally.assert_meaningful();
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
        judge(&job, &rays(&job, numbers.bits(), 50), &mut tally);
    }
    tally.assert_meaningful();
}

/// Rays through micro-vertices, and towards the edges where base triangles meet: mostly close calls, so that what is
/// asked is that no ray gets through, and that what is hit can be.
#[test]
fn edges_and_vertices_let_no_ray_through() {
    let mut numbers = Numbers::new(2);
    let mut tally = Tally::default();
    for round in 0..180 {
        let scene = scenes::random_solid(&mut numbers, height_format::UNORM8, [0.0, 0.3][round % 2]);
        let job = scenes::ready(scene, Wrap::Repeat);
        let mut source = RaySource::new(&job, numbers.bits());
        let rays: Vec<Ray> =
            (0..50).flat_map(|_| [source.along_normal(), source.towards_edge()]).collect();
        judge(&job, &rays, &mut tally);
    }
    assert!(10 * tally.hits > 9 * tally.rays, "too few hits: {tally:?}");
}
