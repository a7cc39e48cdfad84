//! Rays that leave a hit, as shadow rays do, do not hit the same spot again.
//!
//! A ray that leaves a point of a micro-triangle to one side of its plane stays on that side. So it cannot hit a
//! micro-triangle whose corners are all on the other side, or in the plane: not the one that it leaves, none that the
//! surface bends away to, and none at all where it is convex. Corners are taken as the kernels compute them, since they
//! are the surface, and sides are computed in f64.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{Normals, Settings};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{Intersection, MISS, Ray};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::ray::TraversalRay;
use emboss_tests::meshes::{self, Solid};
use emboss_tests::scenes::{ReadyJob, WildMap, job};
use emboss_tests::{Numbers, RaySource};
use glam::DVec3;

const SCALES: [f64; 3] = [1e-6, 1.0, 1e6];
/// Distances from the origin, in extents.
const OFFSETS: [f64; 3] = [0.0, 1e2, 1e5];
const SUBDIVISIONS: [u32; 3] = [1, 8, 64];
/// Micro-triangles that a scene's rays may be tested against at the greatest distance from the origin, where most are.
const TESTS: usize = 20_000_000;

/// What became of the rays of a test.
#[derive(Debug, Default)]
struct Tally {
    rays: usize,
    /// Rays that hit something again.
    seconds: usize,
    /// Those of them that have risen farther above the plane by then than rounding lifts a micro-vertex. Not counted
    /// where it moves micro-vertices by more than a side: such micro-triangles lean any way.
    risen: usize,
    /// Rays that hit what lies on the other side of the plane that they leave.
    behind: usize,
    /// The first of these.
    example: Option<String>,
}

/// A micro-triangle's corners as the kernels compute them.
fn corners(job: &ReadyJob, primitive: u32, cell: u32) -> [DVec3; 3] {
    let view = job.view();
    let field = HeightField::new(&view, job.features);
    let corners = BaseTriangle::load(&view, primitive).micro_triangle(&field, Cell::unpack(cell));
    corners.map(|corner| corner.as_dvec3())
}

/// Lets a ray leave a hit and counts what it meets.
fn leave(job: &ReadyJob, hit: &Intersection, ray: &Ray, tally: &mut Tally) {
    let left = Hit {
        t: hit.t,
        primitive: hit.primitive,
        cell: hit.cell,
        b1: hit.b1,
        b2: hit.b2,
        instance: hit.instance,
    };
    let [a, b, c] = corners(job, hit.primitive, hit.cell);
    let normal = (b - a).cross(c - a);
    let direction = ray.direction.as_dvec3();
    // Where f32 takes another side than f64 the ray leaves to neither.
    let sine = direction.dot(normal) / (direction.length() * normal.length());
    if normal == DVec3::ZERO || sine.abs() < 1e-5 {
        return;
    }
    tally.rays += 1;
    let (ray, _) = TraversalRay::from_ray(*ray);
    let view = job.view();
    let side = (normal.normalize() * sine.signum()).as_vec3();
    let second =
        traverse(&view, job.features, &ray.leaving(left, side), Query::Nearest, &mut Counts::default());
    if !second.is_some() {
        return;
    }
    tally.seconds += 1;
    // Two micro-vertices may be off by 28 u each: see `BaseTriangle::bounds`.
    let coordinate = [a, b, c].map(|p| p.abs().max_element()).into_iter().fold(0.0, f64::max);
    let rounding = 56.0 * f64::from(UNIT_ROUNDOFF) * coordinate;
    let side = (b - a).length().min((c - b).length()).min((a - c).length());
    tally.risen += usize::from(side > rounding && f64::from(second.t) * sine.abs() > rounding);
    let above = |p: DVec3| (p - a).dot(normal) * sine > 0.0;
    if !corners(job, second.primitive, second.cell).into_iter().any(above) {
        tally.behind += 1;
        tally
            .example
            .get_or_insert_with(|| format!("{ray:?}\nleaves {hit:?}\nhits {second:?}\n{:?}", job.frame));
    }
}

/// Which directions rays leave to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Leaving {
    /// To the outer side.
    Outwards,
    /// To either.
    Anywhere,
}

/// Has rays leave hits of a scene.
fn tally(job: &ReadyJob, leaving: Leaving, seed: u64, count: usize, tally: &mut Tally) {
    let mut source = RaySource::new(job, seed);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    let towards: Vec<Ray> = (0..count).map(|_| source.from_outside()).collect();
    for hit in backend.trace_rays(&towards).expect("the CPU does not fail") {
        if hit.primitive != MISS {
            let ray = match leaving {
                Leaving::Outwards => source.leaving_outwards(&hit),
                Leaving::Anywhere => source.leaving(&hit),
            };
            leave(job, &hit, &ray, tally);
        }
    }
}

/// A solid at a place under a map, the height a tenth of its size.
fn displaced(solid: &Solid, scale: f64, offset: f64, map: WildMap, n: u32, normals: Normals) -> ReadyJob {
    let placed = solid.placed(scale, offset);
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let relief = Relief::new(map.map(&mut Numbers::new(7)), 0.0, (0.1 * scale) as f32);
    let scene = Scene {
        mesh: placed.mesh,
        reliefs: vec![relief],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: n,
    };
    job(scene, &Settings { normals, width: 1, height: 1, ..Settings::default() })
}

/// At every scale and place, for every N, at least `rays` rays; returns what became of them.
fn assert_left(solid: &Solid, map: WildMap, leaving: Leaving, rays: usize) -> Tally {
    let each = (2 * rays).div_ceil(SCALES.len() * OFFSETS.len() * SUBDIVISIONS.len());
    let mut total = Tally::default();
    let mut turn = 0;
    for scale in SCALES {
        for offset in OFFSETS {
            for n in SUBDIVISIONS {
                let normals = [Normals::Normalized, Normals::Linear][turn % 2];
                let job = displaced(solid, scale, offset, map, n, normals);
                let mut count = each;
                if offset > 1e4 {
                    count = count.min(TESTS / (job.buffers.triangles.len() * (n * n) as usize));
                }
                let mut found = Tally::default();
                tally(&job, leaving, turn as u64, count, &mut found);
                total.rays += found.rays;
                total.seconds += found.seconds;
                total.risen += found.risen;
                total.behind += found.behind;
                total.example = total.example.or(found.example);
                turn += 1;
            }
        }
    }
    assert!(
        total.behind == 0,
        "{map:?} {leaving:?}: {} of {} rays, {}",
        total.behind,
        total.rays,
        total.example.as_deref().unwrap_or_default()
    );
    assert!(total.rays >= rays, "{} rays", total.rays);
    total
}

/// A solid moved so that one of its vertices is the origin, where coordinates, and with them the bounds on errors,
/// vanish.
fn around_a_vertex(mut solid: Solid) -> Solid {
    let corner = solid.vertices[0].position;
    solid.vertices.iter_mut().for_each(|vertex| vertex.position -= corner);
    solid
}

/// A surface that is convex but for the rounding of its micro-vertices hides nothing from itself but what these hide.
fn assert_convex(solid: &Solid) {
    let tally = assert_left(solid, WildMap::Single, Leaving::Outwards, 150_000);
    assert!(tally.risen == 0 && 100 * tally.seconds < tally.rays, "{tally:?}");
}

#[test]
fn convex_solids_are_left_for_good() {
    for levels in [1, 2] {
        assert_convex(&meshes::icosphere(levels));
    }
}

#[test]
fn convex_solids_at_the_origin_are_left_for_good() {
    for levels in [1, 2] {
        assert_convex(&around_a_vertex(meshes::icosphere(levels)));
    }
}

#[test]
fn rough_solids_are_left_for_good() {
    let solids =
        [meshes::cube(), meshes::icosphere(1), meshes::genus_three(2), around_a_vertex(meshes::cube())];
    for solid in solids {
        let tally = assert_left(&solid, WildMap::Noise, Leaving::Anywhere, 100_000);
        assert!(tally.risen > 20_000, "{tally:?}");
    }
}
