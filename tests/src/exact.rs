//! Whether a backend's nearest hits are those of the micro-triangle surface: rays by the million, judged by the oracle.

use crate::long::Cases;
use crate::oracle::{Answer, Clarity, Disagreement, Oracle};
use crate::scenes::{self, ReadyJob};
use crate::{Numbers, RaySource};
use emboss::backend::cpu::CpuBackend;
use emboss::backend::{Backend, SceneBuffers};
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{DisplacementKind, Filter, Normals, Settings, Weld, Wrap};
use emboss_kernels::interface::{
    Frame, Intersection, MISS, Ray, Vertex, displacement_kind, height_format, method, wrap,
};
use emboss_kernels::scene::Features;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::fmt;
use std::ops::AddAssign;

/// Rays that are traced and judged at a time: memory stays the same however many there are.
const BATCH: usize = 65_536;
/// Rays that one source makes.
const RUN: usize = 1024;
/// Rays of a kind that stand side by side: a workgroup's. A device that has its threads go round loops together is a
/// quarter faster over rays that are alike.
const ALIKE: usize = 64;

/// What became of rays.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// How many there were.
    pub rays: u64,
    /// Rays that hit.
    pub hits: u64,
    /// Rays that rounding does not let through, whatever they hit.
    pub must_hit: u64,
    /// Rays for which rounding left no choice.
    pub clear: u64,
    /// Hits on the micro-triangle that exact arithmetic finds nearest.
    pub same: u64,
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Tally) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.must_hit += other.must_hit;
        self.clear += other.clear;
        self.same += other.same;
    }
}

impl Tally {
    /// Asserts that rays at random were a test: enough hits, and so few close calls that wrong answers had nowhere to
    /// hide.
    ///
    /// # Panics
    /// Where they were not.
    pub fn assert_clear(&self) {
        assert!(2 * self.hits > self.rays, "too few hits: {self:?}");
        assert!(100 * self.clear > 98 * self.rays, "too many close calls: {self:?}");
        assert!(1000 * self.same > 998 * self.hits, "too many other micro-triangles: {self:?}");
    }

    /// Asserts the same of rays that are aimed at edges: close calls, of which most must be hits of something.
    ///
    /// # Panics
    /// Where they are not.
    pub fn assert_tight(&self) {
        assert!(4 * self.must_hit > 3 * self.rays, "too few hits that are sure: {self:?}");
    }
}

/// The tallies of rays of all kinds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tallies {
    /// From outside, from within the relief, and grazing it.
    pub random: Tally,
    /// Along normals through micro-vertices, and towards base edges.
    pub aimed: Tally,
    /// Away from hits: rounding always leaves those a choice.
    pub leaving: Tally,
}

impl Tallies {
    /// Asserts that the rays were a test: of random ones at least two in five hit, more than half have no choice, and
    /// nearly all hits are sure to be hits of something. The floors lie below the least that was measured: clear are
    /// 3/4 on the knot at N = 64 by the CPU's bounds and 0.59 by Vulkan's, and sure of the aimed ones 0.27 on the quilt
    /// at N = 1. Of random hits more than `sure` in a hundred must be: 99 under heights, 98 under vectors, since these
    /// fold the knot so that there are outlines everywhere, and 0.99 was measured. Of rays that leave a surface some
    /// come back to it, unless it `is_plane`.
    ///
    /// # Panics
    /// Where they were not.
    pub fn assert_telling(&self, sure: u64, is_plane: bool) {
        let Tallies { random, aimed, leaving } = self;
        assert!(5 * random.hits > 2 * random.rays, "too few hits: {self:?}");
        assert!(2 * random.clear > random.rays, "too many close calls: {self:?}");
        assert!(100 * random.must_hit > sure * random.hits, "too few hits that are sure: {self:?}");
        assert!(1000 * random.same > 998 * random.hits, "too many other micro-triangles: {self:?}");
        // A sheet's edges are a border that rays may miss.
        assert!(5 * aimed.must_hit > aimed.rays, "too few hits that are sure: {self:?}");
        assert!(is_plane || leaving.hits > 0, "no ray comes back: {self:?}");
    }
}

impl fmt::Display for Tallies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = self.random;
        all += self.aimed;
        all += self.leaving;
        write!(f, "{} rays, {} hits, none wrong", all.rays, all.hits)
    }
}

/// What the oracle says of one hit of a ray, or of its miss.
fn verdict(oracle: &Oracle, ray: &Ray, hit: &Intersection) -> Result<Tally, (Disagreement, Answer)> {
    let answer = oracle.trace(ray);
    let hit_something = hit.primitive != MISS;
    let judged = answer.judge(hit).and_then(|clarity| {
        if hit_something {
            oracle.judge_surface(ray, &answer, hit)?;
        }
        Ok(clarity)
    });
    match judged {
        Err(disagreement) => Err((disagreement, answer)),
        Ok(clarity) => Ok(Tally {
            rays: 1,
            hits: u64::from(hit_something),
            must_hit: u64::from(answer.must_hit()),
            clear: u64::from(clarity == Clarity::Clear),
            same: u64::from(answer.nearest().is_some_and(|m| (m.base, m.cell) == (hit.primitive, hit.cell))),
        }),
    }
}

/// Has the oracle judge every hit, each of the ray beside it.
///
/// # Panics
/// Where one is not what rounding can make of the exact answer.
pub fn judge(job: &ReadyJob, oracle: &Oracle, rays: &[Ray], hits: &[Intersection]) -> Tally {
    assert_eq!(rays.len(), hits.len(), "each ray has an answer");
    let one = |(ray, hit): (&Ray, &Intersection)| {
        verdict(oracle, ray, hit).map_err(|(disagreement, answer)| {
            let (n, features) = (job.frame.subdivisions, job.features);
            format!("{disagreement:?}: N = {n}, {features:?}\n{ray:?}\n{hit:?}\n{answer:#?}")
        })
    };
    let sum = |mut a: Tally, b: Tally| {
        a += b;
        Ok(a)
    };
    let tally: Result<Tally, String> = rays.par_iter().zip(hits).map(one).try_reduce(Tally::default, sum);
    tally.unwrap_or_else(|wrong| panic!("{wrong}"))
}

/// Why the oracle refuses hits, each of the ray beside it; those that it accepts are left out.
pub fn refused(oracle: &Oracle, rays: &[Ray], hits: &[Intersection]) -> Vec<Disagreement> {
    assert_eq!(rays.len(), hits.len(), "each ray has an answer");
    let one = |(ray, hit): (&Ray, &Intersection)| verdict(oracle, ray, hit).err().map(|(why, _)| why);
    rays.par_iter().zip(hits).filter_map(one).collect()
}

/// The numbers of subdivisions of the grid cases: one, odd ones, powers of two, one above a power of two.
pub const SUBDIVISIONS: [u32; 5] = [1, 3, 8, 17, 64];

/// A backend, and the oracle that knows how it rounds.
pub struct Court<'a> {
    /// The backend whose quadtree method is judged.
    backend: &'a mut dyn Backend,
    /// Makes its oracle.
    oracle: fn(&SceneBuffers, &Frame, Features) -> Oracle,
    cases: Cases,
}

impl<'a> Court<'a> {
    /// A court without cases so far.
    pub fn new(
        backend: &'a mut dyn Backend,
        oracle: fn(&SceneBuffers, &Frame, Features) -> Oracle,
    ) -> Court<'a> {
        Court { backend, oracle, cases: Cases::new() }
    }

    /// A built-in scene at each N of [`SUBDIVISIONS`], with `count(N)` rays of all kinds each.
    pub fn judge_builtin(&mut self, name: &str, count: impl Fn(u32) -> usize) {
        let scene = scenes::builtin(name);
        for n in SUBDIVISIONS {
            let job = scenes::ready(Scene { subdivisions: n, ..scene.clone() }, Wrap::Repeat);
            self.judge_job(&format!("{name}, N = {n}"), &job, u64::from(n), count(n));
        }
    }

    /// Linear directions on the two built-in scenes whose normals lean or are welded.
    pub fn judge_linear_normals(&mut self, count: usize) {
        let settings = Settings { normals: Normals::Linear, width: 1, height: 1, ..Settings::default() };
        for name in ["builtin:cube", "builtin:knot"] {
            let scene = scenes::builtin(name);
            for n in [1, 6, 17] {
                let job = scenes::job(Scene { subdivisions: n, ..scene.clone() }, &settings);
                self.judge_job(&format!("{name}, linear, N = {n}"), &job, u64::from(n), count);
            }
        }
    }

    /// The [`patchwork`] in all wraps, with directions of both kinds, welded and not. Where its maps are of two formats
    /// they are of two wraps too.
    pub fn judge_patchwork(&mut self, count: usize) {
        let formats = [
            [height_format::UNORM8, height_format::UNORM8],
            [height_format::UNORM16, height_format::FLOAT32],
            [height_format::UNORM16, height_format::UNORM16],
        ];
        let wraps = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
        for ((usual_wrap, formats), seed) in wraps.into_iter().zip(formats).zip(1..) {
            for normals in [Normals::Normalized, Normals::Linear] {
                for weld in [Weld::On, Weld::Off] {
                    let settings = Settings {
                        wrap: usual_wrap,
                        normals,
                        weld,
                        width: 1,
                        height: 1,
                        ..Settings::default()
                    };
                    for n in [1, 6, 17] {
                        let mut scene = patchwork(seed, formats, n);
                        let mixed = formats[0] != formats[1];
                        scene.reliefs[1].wrap = mixed.then_some(Wrap::Mirror);
                        let job = scenes::job(scene, &settings);
                        assert_eq!(job.features.seams, u32::from(weld == Weld::On));
                        assert_eq!(job.features.height_format == height_format::PER_MAP, mixed);
                        assert_eq!(job.features.height_wrap == wrap::PER_MAP, mixed);
                        let what = format!("patchwork, {usual_wrap:?}, {normals:?}, weld {weld:?}, N = {n}");
                        self.judge_job(&what, &job, seed + u64::from(n), count);
                    }
                }
            }
        }
    }

    /// Scenes whose maps are filtered by their levels, seen from near; the first of six where it is to be `short`.
    pub fn judge_filtered(&mut self, short: bool, count: usize) {
        let mut numbers = Numbers::new(8);
        let vectors = scenes::with_vectors(scenes::builtin("builtin:cube"), &mut numbers);
        let patches = |formats| patchwork(4, formats, 6);
        let (height, tangent) = (DisplacementKind::Height, DisplacementKind::Tangent);
        let cases = [
            ("bytes", patches([height_format::UNORM8; 2]), height, Normals::Normalized),
            ("floats", patches([height_format::FLOAT32; 2]), height, Normals::Linear),
            (
                "cube",
                Scene { subdivisions: 17, ..scenes::builtin("builtin:cube") },
                height,
                Normals::Normalized,
            ),
            (
                "quilt",
                Scene { subdivisions: 64, ..scenes::builtin("builtin:quilt") },
                height,
                Normals::Linear,
            ),
            (
                "knot",
                Scene { subdivisions: 8, ..scenes::builtin("builtin:knot") },
                height,
                Normals::Normalized,
            ),
            ("vectors", Scene { subdivisions: 8, ..vectors }, tangent, Normals::Normalized),
        ];
        let most = if short { 1 } else { cases.len() };
        for (name, scene, displacement, normals) in cases.into_iter().take(most) {
            let bilinear = Settings { displacement, normals, width: 1, height: 1, ..Settings::default() };
            let plain = scenes::job(scene.clone(), &bilinear);
            let mut job = scenes::job(scene, &Settings { filter: Filter::Trilinear, ..bilinear });
            job.look_from_near();
            let shown = difference(&job, &plain);
            assert!((0.1..0.99).contains(&shown), "{shown} of {name}'s hits differ by the filter");
            self.judge_job(&format!("{name}, filtered"), &job, 5, count);
        }
    }

    /// One scene, by `count` rays of all kinds, which must have been a test.
    pub fn judge_job(&mut self, what: &str, job: &ReadyJob, seed: u64, count: usize) {
        let Court { backend, oracle, cases } = self;
        let sure = if job.features.displacement == displacement_kind::HEIGHT { 99 } else { 98 };
        cases.run(what, || {
            let oracle = oracle(&job.buffers, &job.frame, job.features);
            let tallies = judge_rays(job, &oracle, *backend, seed, count);
            // Two flat triangles: a ray that leaves them meets nothing.
            let is_plane = job.frame.triangle_count == 2 && job.frame.subdivisions == 1;
            tallies.assert_telling(sure, is_plane);
            tallies
        });
    }
}

/// What share of rays that hit either scene are at other distances in the other, on the CPU.
fn difference(a: &ReadyJob, b: &ReadyJob) -> f64 {
    let mut source = RaySource::new(a, 3);
    let rays: Vec<Ray> = (0..1000).map(|_| source.from_outside()).collect();
    let [a, b] = [a, b].map(|job| {
        let mut backend = CpuBackend::new();
        backend.load(&job.buffers, &job.frame, job.features).expect("a test's scene fits");
        backend.trace_rays(&rays).expect("the CPU does not fail")
    });
    let hits = a.iter().zip(&b).filter(|(a, b)| a.primitive != MISS || b.primitive != MISS);
    let (mut all, mut others) = (0_u32, 0_u32);
    for (a, b) in hits {
        all += 1;
        others += u32::from((a.t - b.t).abs() > 1e-5 * a.t);
    }
    f64::from(others) / f64::from(all)
}

/// Has a backend trace `count` rays of all kinds, as `seed` decides, through its quadtrees, and every answer
/// judged.
///
/// # Panics
/// Where an answer is wrong, or the backend fails.
fn judge_rays(
    job: &ReadyJob,
    oracle: &Oracle,
    backend: &mut dyn Backend,
    seed: u64,
    count: usize,
) -> Tallies {
    let features = Features { method: method::QUADTREE, ..job.features };
    backend.load(&job.buffers, &job.frame, features).expect("a test's scene fits");
    let mut tallies = Tallies::default();
    let mut trace = |rays: &[Ray], tally: &mut Tally| {
        let hits = backend.trace_rays(rays).expect("no device fails");
        *tally += judge(job, oracle, rays, &hits);
        hits
    };
    let mut seeds = Numbers::new(seed);
    let mut left = count;
    while left > 0 {
        let batch = left.min(BATCH);
        left -= batch;
        // Half of them random, a third aimed, a sixth leave hits of the random ones.
        let (aimed, leaving) = (batch / 3, batch / 6);
        let random = rays(job, seeds.bits(), batch - aimed - leaving, |source, i| match i / ALIKE % 3 {
            0 => source.from_outside(),
            1 => source.from_inside(),
            _ => source.grazing(),
        });
        let hits = trace(&random, &mut tallies.random);
        let aimed = rays(job, seeds.bits(), aimed, |source, i| match i / ALIKE % 2 {
            0 => source.along_normal(),
            _ => source.towards_edge(3.0),
        });
        trace(&aimed, &mut tallies.aimed);
        let starts: Vec<Intersection> = hits.into_iter().filter(|hit| hit.primitive != MISS).collect();
        if !starts.is_empty() {
            let leave = |source: &mut RaySource<'_>, i: usize| source.leaving(&starts[i % starts.len()]);
            trace(&rays(job, seeds.bits(), leaving, leave), &mut tallies.leaving);
        }
    }
    tallies
}

/// So many rays, made on all threads, the same on any number of them; `make` is told the number of the ray.
fn rays(
    job: &ReadyJob,
    seed: u64,
    count: usize,
    make: impl Fn(&mut RaySource<'_>, usize) -> Ray + Sync,
) -> Vec<Ray> {
    let runs: Vec<usize> = (0..count).step_by(RUN).collect();
    let run = |&first: &usize| {
        let mut source = RaySource::new(job, Numbers::new(seed.wrapping_add(first as u64)).bits());
        (first..(first + RUN).min(count)).map(|i| make(&mut source, i)).collect::<Vec<Ray>>()
    };
    runs.par_iter().flat_map_iter(run).collect()
}

/// A solid whose neighbours agree on nothing but where they are: a cube of 12 triangles with leaning normals and
/// texture charts of their own on each face, the faces alternating between two maps of random texels; a fin at one of
/// its edges, which so has three sides; and beside it a triangle with its back, whose normals cancel.
pub fn patchwork(seed: u64, formats: [u32; 2], subdivisions: u32) -> Scene {
    let mut numbers = Numbers::new(seed);
    let (mut vertices, mut triangles, mut maps) = (Vec::new(), Vec::new(), Vec::new());
    // A polygon with a chart that is turned, stretched and moved at random, several copies of the map wide.
    let mut add = |normal: Vec3, lean: f32, corners: &[Vec3], map: u32, numbers: &mut Numbers| {
        let first = u32::try_from(vertices.len()).expect("a handful");
        let [at, right, up] = [(); 3].map(|()| numbers.in_cube().truncate() * 2.0);
        let x = (corners[1] - corners[0]).normalize();
        let y = x.cross(normal);
        vertices.extend(corners.iter().map(|&position| {
            let uv: Vec2 = at + right * position.dot(x) + up * position.dot(y);
            let normal = (normal + numbers.in_cube() * lean).normalize();
            Vertex { position, normal, u: uv.x, v: uv.y }
        }));
        let fan = (first + 1..first + u32::try_from(corners.len()).expect("a handful") - 1)
            .map(|v| [first, v, v + 1]);
        triangles.extend(fan.clone());
        maps.extend(fan.map(|_| map));
    };
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for (i, map) in (0..6).zip([0, 1].into_iter().cycle()) {
        let side = if i < 3 { 1.0 } else { -1.0 };
        let (n, a, b) = (axes[i % 3] * side, axes[(i + 1) % 3] * side, axes[(i + 2) % 3]);
        add(n, 0.3, &[n - a - b, n + a - b, n + a + b, n - a + b], map, &mut numbers);
    }
    let edge = [Vec3::new(1.0, 1.0, -1.0), Vec3::ONE];
    add(
        Vec3::new(1.0, -1.0, 0.0).normalize(),
        0.3,
        &[edge[0], edge[1], Vec3::new(2.0, 2.0, 0.0)],
        1,
        &mut numbers,
    );
    let sheet = [Vec3::new(-3.0, -1.0, 0.0), Vec3::new(-1.5, -1.0, 0.3), Vec3::new(-2.0, 1.0, 0.0)];
    let normal = (sheet[1] - sheet[0]).cross(sheet[2] - sheet[0]).normalize();
    add(normal, 0.0, &sheet, 0, &mut numbers);
    add(-normal, 0.0, &[sheet[0], sheet[2], sheet[1]], 1, &mut numbers);
    let mut mesh = Mesh::from_triangles(&vertices, &triangles);
    for (triangle, map) in mesh.triangles.iter_mut().zip(maps) {
        triangle.displacement = map;
    }
    let sizes = [(7, 5), (6, 9)];
    let reliefs = [0, 1].map(|i| {
        let (width, height) = sizes[i];
        let texels = random_texels(&mut numbers, formats[i], width * height);
        let format = formats[i];
        let map = HeightMap { width, height, format, texels, range: (0.0, 1.0), replaced: 0 };
        Relief::new(map, [0.5, 0.2][i], [0.3, -0.2][i])
    });
    Scene { mesh, reliefs: reliefs.into(), materials: vec![Material::default()], parts: vec![], subdivisions }
}

/// Packed texels between 0 and 1.
fn random_texels(numbers: &mut Numbers, format: u32, count: u32) -> Vec<u32> {
    let (count, per_word) = (count as usize, if format == height_format::UNORM8 { 4 } else { 2 });
    if format == height_format::FLOAT32 {
        (0..count).map(|_| numbers.unit().to_bits()).collect()
    } else {
        (0..count.div_ceil(per_word)).map(|_| numbers.word()).collect()
    }
}
