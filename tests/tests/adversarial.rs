//! Rays, meshes and maps that have every reason to go wrong: the quadtree against brute force, which shares the surface
//! and the triangle test with it and nothing else, bit for bit; and against the surface in f64.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::Mesh;
use emboss::settings::{DisplacementKind, Normals, Settings, Weld, Wrap};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::interface::{Intersection, MISS, Ray, height_format, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::scene::Features;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{ReadyJob, VECTORS, job, random_solid, with_vectors};
use emboss_tests::{HardRays, Hardship, Numbers};
use glam::Vec3;

/// What is wrong with a mesh. All of it is fed to the kernels as it is: a mesh out of a file has no
/// coincident corners, and zero normals only at slivers that touch no triangle with an area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    None,
    /// A triangle a million times as long as it is wide.
    Needle,
    /// Triangles whose corners stand in a line.
    Collinear,
    /// Triangles with two corners at a place.
    Coincident,
    /// All texture coordinates are the same.
    SamePlaceOnMap,
    /// All texture coordinates lie on a line.
    LineOnMap,
    /// Every second vertex has its normal turned round.
    OppositeNormals,
    /// Every second vertex has none.
    SomeZeroNormals,
    /// None has.
    ZeroNormals,
}

const FAULTS: [Fault; 9] = [
    Fault::None,
    Fault::Needle,
    Fault::Collinear,
    Fault::Coincident,
    Fault::SamePlaceOnMap,
    Fault::LineOnMap,
    Fault::OppositeNormals,
    Fault::SomeZeroNormals,
    Fault::ZeroNormals,
];

/// Heights in lengths of an edge, some.
const HEIGHTS: [f32; 4] = [0.0, 1e-7, 0.3, 1e3];

/// Does to a mesh what the fault says.
fn spoil(mesh: &mut Mesh, fault: Fault) {
    let vertices = &mut mesh.vertices;
    let [a, b, c] = mesh.triangles[0].vertices.map(|v| v as usize);
    let (from, to) = (vertices[a].position, vertices[c].position);
    match fault {
        Fault::None => {}
        Fault::Needle => {
            let aside = (vertices[b].position - from).reject_from(to - from);
            vertices[b].position = from + (to - from) * 0.4 + aside * 1e-6;
        }
        // Along an axis, where floats keep them in line.
        Fault::Collinear => {
            vertices[b].position = Vec3::new(0.5 * (from.x + to.x), from.y, from.z);
            vertices[c].position = Vec3::new(to.x, from.y, from.z);
        }
        Fault::Coincident => vertices[b].position = from,
        Fault::SamePlaceOnMap => vertices.iter_mut().for_each(|v| (v.u, v.v) = (0.3, 0.7)),
        Fault::LineOnMap => vertices.iter_mut().for_each(|v| v.v = 0.3),
        Fault::OppositeNormals => vertices.iter_mut().step_by(2).for_each(|v| v.normal = -v.normal),
        Fault::SomeZeroNormals => vertices.iter_mut().step_by(2).for_each(|v| v.normal = Vec3::ZERO),
        Fault::ZeroNormals => vertices.iter_mut().for_each(|v| v.normal = Vec3::ZERO),
    }
}

/// How a scene is displaced.
#[derive(Clone, Copy, Debug)]
struct How {
    displacement: DisplacementKind,
    height: f32,
    normals: Normals,
    wrap: Wrap,
}

/// A small random scene with a fault.
fn spoilt(numbers: &mut Numbers, fault: Fault, how: How) -> ReadyJob {
    let How { displacement, height, normals, wrap } = how;
    let formats = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];
    let format = formats[numbers.below(3) as usize];
    let spread = [0.0, 0.1, 0.5, 1.0][numbers.below(4) as usize];
    let mut scene = random_solid(numbers, format, spread);
    let [a, b, _] = scene.mesh.triangles[0].vertices.map(|v| scene.mesh.vertices[v as usize].position);
    scene.reliefs[0].scale = height * a.distance(b);
    if displacement != DisplacementKind::Height {
        scene = with_vectors(scene, numbers);
    }
    spoil(&mut scene.mesh, fault);
    // Two corners at a place are no edge, so there is no seam to be found either.
    let weld = if fault == Fault::Coincident { Weld::Off } else { Weld::On };
    let subdivisions = [1, 2, 3, 5, 8, 13][numbers.below(6) as usize];
    let settings = Settings { displacement, normals, wrap, weld, width: 1, height: 1, ..Settings::default() };
    job(Scene { subdivisions, ..scene }, &settings)
}

/// The nearest hits by a method.
fn traced(job: &ReadyJob, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, Features { method, ..job.features }).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// Whether a ray hits anything, as shadow rays ask.
fn hits_any(job: &ReadyJob, ray: &Ray) -> bool {
    let view = job.view();
    let (ray, _) = TraversalRay::from_ray(*ray);
    traverse(&view, job.features, &ray, Query::Any, &mut Counts::default()).is_some()
}

/// Asserts that both methods find the same, to the bit, and returns it.
fn assert_same(job: &ReadyJob, rays: &[Ray], what: &str) -> Vec<Intersection> {
    assert_eq!(job.features.method, method::QUADTREE);
    let exact = traced(job, method::BRUTE_FORCE, rays);
    let found = traced(job, method::QUADTREE, rays);
    for ((ray, exact), found) in rays.iter().zip(&exact).zip(&found) {
        let same = bytemuck::bytes_of(exact) == bytemuck::bytes_of(found);
        assert!(same, "{what}\n{ray:?}\nbrute force {exact:?}\nquadtree {found:?}\n{:?}", job.frame);
        assert_eq!(hits_any(job, ray), exact.primitive != MISS, "{what}\n{ray:?}\nbrute force {exact:?}");
    }
    exact
}

/// Every hardship on every fault at every height, both directions.
fn compare(hardship: Hardship, rounds: usize) {
    compare_under(DisplacementKind::Height, hardship, rounds);
}

/// The same for a kind of displacement.
fn compare_under(displacement: DisplacementKind, hardship: Hardship, rounds: usize) {
    let (mut rays, mut hits) = (0, 0);
    for round in 0..rounds {
        for (seed, fault) in (round as u64 * 100..).zip(FAULTS) {
            for height in HEIGHTS {
                let mut numbers = Numbers::new(seed);
                let normals = [Normals::Normalized, Normals::Linear][round % 2];
                let wrap = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror][round % 3];
                let how = How { displacement, height, normals, wrap };
                let job = spoilt(&mut numbers, fault, how);
                let mut source = HardRays::new(&job, numbers.bits());
                let batch: Vec<Ray> = (0..40).map(|_| source.ray(hardship)).collect();
                let what = format!("{hardship:?}, {fault:?}, {how:?}, seed {seed}");
                let found = assert_same(&job, &batch, &what);
                rays += batch.len();
                hits += found.iter().filter(|hit| hit.primitive != MISS).count();
            }
        }
    }
    assert!(5 * hits > rays, "{hardship:?} is no test: {hits} hits of {rays} rays");
}

const ROUNDS: usize = 30;

#[test]
fn along_the_normal() {
    compare(Hardship::AlongNormal, ROUNDS);
}

#[test]
fn along_grid_lines() {
    compare(Hardship::AlongGridLine, ROUNDS);
}

#[test]
fn through_micro_vertices() {
    compare(Hardship::ThroughMicroVertex, ROUNDS);
}

#[test]
fn in_the_plane_of_a_micro_triangle() {
    compare(Hardship::InPlane, ROUNDS);
}

#[test]
fn from_the_base() {
    compare(Hardship::FromBase, ROUNDS);
}

#[test]
fn from_within_the_prism() {
    compare(Hardship::FromPrism, ROUNDS);
}

#[test]
fn from_a_cap() {
    compare(Hardship::FromCap, ROUNDS);
}

#[test]
fn from_the_surface() {
    compare(Hardship::FromSurface, ROUNDS);
}

#[test]
fn grazing() {
    compare(Hardship::Grazing, ROUNDS);
}

#[test]
fn along_axes_and_nearly_so() {
    compare(Hardship::Axis, ROUNDS);
}

/// Every hardship, in tangent and in object space.
#[test]
fn vectors() {
    for displacement in VECTORS {
        for hardship in Hardship::ALL {
            compare_under(displacement, hardship, 6);
        }
    }
}

/// Meshes as files give them, with every kind of ray, judged by the surface in f64.
#[test]
fn hard_rays_meet_what_is_there_in_f64() {
    for (displacement, seeds) in
        [(DisplacementKind::Height, 60), (DisplacementKind::Tangent, 20), (DisplacementKind::Object, 20)]
    {
        judge_hard_rays(displacement, seeds);
    }
}

fn judge_hard_rays(displacement: DisplacementKind, seeds: u64) {
    let (mut rays, mut sure) = (0, 0);
    for seed in 0..seeds {
        for fault in [Fault::None, Fault::SamePlaceOnMap, Fault::LineOnMap, Fault::OppositeNormals] {
            for height in [0.0, 1e-7, 0.3] {
                let mut numbers = Numbers::new(seed);
                let (normals, wrap) = (Normals::Normalized, Wrap::Repeat);
                let job = spoilt(&mut numbers, fault, How { displacement, height, normals, wrap });
                let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
                let mut source = HardRays::new(&job, seed);
                let batch: Vec<Ray> =
                    Hardship::ALL.into_iter().map(|hardship| source.ray(hardship)).collect();
                for (ray, hit) in batch.iter().zip(traced(&job, method::QUADTREE, &batch)) {
                    let answer = oracle.trace(ray);
                    let context =
                        || format!("{fault:?}, height {height}, seed {seed}\n{ray:?}\n{hit:?}\n{answer:#?}");
                    if let Err(disagreement) = answer.judge(&hit) {
                        panic!("{disagreement:?}: {}", context());
                    }
                    rays += 1;
                    sure += usize::from(answer.must_hit());
                    if hit.primitive != MISS {
                        let surface = oracle.judge_surface(ray, &answer, &hit);
                        assert!(surface.is_ok(), "{surface:?}: {}", context());
                    }
                }
            }
        }
    }
    assert!(4 * sure > rays, "{sure} hits are sure of {rays} rays");
}
