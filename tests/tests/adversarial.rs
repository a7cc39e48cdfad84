//! Rays, meshes and maps that have every reason to go wrong: the quadtree against brute force, which shares the surface
//! and the triangle test with it and nothing else, bit for bit; and against the surface in f64. Planes that lie in one
//! another, and closed rooms.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Mesh, Relief};
use emboss::settings::{DisplacementKind, Method, Normals, Settings, Weld, Wrap};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::interface::{BvhNode, Intersection, MISS, Ray, height_format, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::scene::{Features, SceneView};
use emboss_tests::compare::rendered;
use emboss_tests::meshes::{self, Solid};
use emboss_tests::oracle::Oracle;
use emboss_tests::planes::{self, Pair, Plane, Planes, Tally, assert_dark, assert_unshadowed};
use emboss_tests::scenes::{ReadyJob, VECTORS, WildMap, job, random_solid, with_vectors};
use emboss_tests::{HardRays, Hardship, Numbers, RaySource};
use glam::{Vec3, Vec4};

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

const SCALES: [f64; 3] = [1e-6, 1.0, 1e6];
/// Distances from the origin, in extents.
const OFFSETS: [f64; 4] = [0.0, 1.0, 1e2, 1e5];

/// Every plane with everything that lies in it, by every method: shadows change nothing. Scales, offsets and N go
/// round.
fn assert_planes_are_unshadowed(pairs: &[Pair]) {
    let (mut backend, mut tally, mut turn) = (CpuBackend::new(), Tally::default(), 0);
    for plane in Plane::ALL {
        for &pair in pairs {
            for method in planes::methods() {
                if pair.is_of_instances() && method.is_stored() {
                    continue;
                }
                let (scale, offset) = (SCALES[turn % 3], OFFSETS[turn / 3 % 4]);
                let subdivisions = [1, 7][turn / 12 % 2];
                turn += 1;
                let planes = Planes { plane, pair, scale, offset };
                assert_unshadowed(&mut backend, &planes, method, subdivisions, (16, 12), 1, &mut tally);
            }
        }
    }
    assert!(tally.shadow_rays > 100 * tally.pictures, "{tally:?}");
}

#[test]
fn planes_cast_no_shadow_on_themselves() {
    assert_planes_are_unshadowed(&[Pair::Alone, Pair::Neighbours, Pair::Decal]);
}

#[test]
fn coincident_faces_cast_no_shadow_on_one_another() {
    assert_planes_are_unshadowed(&[Pair::Same, Pair::Reversed, Pair::Back]);
    assert_planes_are_unshadowed(&[Pair::OtherDiagonal, Pair::BackOtherDiagonal]);
}

#[test]
fn coincident_models_and_instances_cast_no_shadow_on_one_another() {
    assert_planes_are_unshadowed(&[Pair::Models, Pair::Instances, Pair::InstanceAndModel]);
}

/// The kernels get a square so far from their origin that it is sixty steps of a float wide. Inverse mapping, which
/// finds its surface by iteration, keeps to the rule of the triangle test.
#[test]
fn instances_and_models_far_away_cast_no_shadow_on_one_another() {
    let planes =
        Planes { plane: Plane::Tilted, pair: Pair::InstanceAndModel, scale: SCALES[2], offset: OFFSETS[3] };
    let mut tally = Tally::default();
    for method in [Method::Inverse, Method::Quadtree] {
        assert_unshadowed(&mut CpuBackend::new(), &planes, method, 1, (64, 48), 1, &mut tally);
    }
}

/// Solids whose faces meet at right angles, at any, and hardly; flat, rough and spiky; at scales and places that go
/// round.
fn solids() -> [(&'static str, Solid); 4] {
    [
        ("cube", meshes::cube()),
        ("sphere", meshes::icosphere(2)),
        ("knot", meshes::knot()),
        ("solid of genus three", meshes::genus_three(1)),
    ]
}

#[test]
fn closed_rooms_are_dark() {
    let (mut backend, mut tally, mut turn) = (CpuBackend::new(), Tally::default(), 0);
    for (name, solid) in solids() {
        for relief in [(WildMap::Single, 0.0), (WildMap::Noise, 0.3), (WildMap::Spikes, 0.5)] {
            for subdivisions in [1, 6] {
                // Where a relief is rough, no farther than its crevices are wider than rounding.
                let most = if relief.1 > 0.0 { 1.0 } else { 1e2 };
                let (scale, offset) = (SCALES[turn % 3], OFFSETS[turn % 4].min(most));
                turn += 1;
                let what = format!("{name}, scale {scale}, {offset} extents away");
                let placed = solid.placed(scale, offset);
                let room = (what.as_str(), &placed);
                assert_dark(&mut backend, room, relief, subdivisions, (32, 32), 2, &mut tally);
            }
        }
    }
    assert!(tally.shadow_rays > 100_000, "{tally:?}");
}

/// A job's trees with the children of each node, and what its leaves hold, the other way round.
fn turned_tree(job: &ReadyJob) -> (Vec<BvhNode>, Vec<u32>) {
    let view = job.view();
    let (mut nodes, mut primitives) = (view.nodes.to_vec(), view.primitives.to_vec());
    let mut roots = vec![0];
    if job.features.instances != 0 {
        roots.extend(view.instances.iter().map(|instance| instance.first_node as usize));
    }
    roots.dedup();
    for (i, &root) in roots.iter().enumerate() {
        let end = roots.get(i + 1).copied().unwrap_or(nodes.len());
        let inner = view.nodes[root..end].iter().filter(|node| node.count == 0);
        for first in inner.map(|node| root + node.first as usize) {
            nodes.swap(first, first + 1);
        }
    }
    if job.features.instances == 0 {
        for node in view.nodes.iter().filter(|node| node.count > 1) {
            primitives[node.first as usize..][..node.count as usize].reverse();
        }
    }
    (nodes, primitives)
}

/// Of faces with the same corners, listed from the same one, the first is seen: by every exact method, from both sides
/// and with every tree, since their distances are the same to the bit.
#[test]
fn first_of_coincident_faces_is_seen() {
    let pairs = Pair::ALL.into_iter().filter(|pair| pair.has_the_same_corners());
    for (turn, pair) in pairs.enumerate() {
        for (i, plane) in Plane::ALL.into_iter().enumerate() {
            let planes = Planes { plane, pair, scale: SCALES[i % 3], offset: OFFSETS[(i + turn) % 3] };
            for method in [Method::None, Method::Quadtree, Method::BruteForce] {
                let job = planes.job(method, planes::level(), 5, (1, 1), true);
                let mut source = RaySource::new(&job, turn as u64);
                let rays: Vec<Ray> = (0..300).map(|_| source.from_outside()).collect();
                let found = traced(&job, job.features.method, &rays);
                let hits = found.iter().filter(|hit| hit.primitive != MISS);
                assert!(hits.clone().count() > 30, "{planes:?}");
                let others = hits.filter(|hit| hit.primitive >= 2 || hit.instance > 0).count();
                assert_eq!(others, 0, "{planes:?} by {method}");
                let (nodes, primitives) = turned_tree(&job);
                let view = SceneView { nodes: &nodes, primitives: &primitives, ..job.view() };
                for (ray, hit) in rays.iter().zip(&found) {
                    let (ray, _) = TraversalRay::from_ray(*ray);
                    let other = traverse(&view, job.features, &ray, Query::Nearest, &mut Counts::default());
                    let what = format!("{planes:?} by {method}, its tree turned");
                    assert_eq!((other.primitive, other.instance), (hit.primitive, hit.instance), "{what}");
                }
            }
        }
    }
}

/// A leaf: a front and a back, displaced away from each other by a relief that is 0 in places. From in front it looks
/// as its front alone does, however the places where both are one are come upon.
#[test]
fn back_of_a_leaf_does_not_shadow_its_front() {
    // Veins in both directions: flat in between, and contact along curves. Flat at the border, where one could look
    // between the two.
    let texel = |i: u32| {
        let (x, y) = ((i % 16) as f32, (i / 16) as f32);
        let inside = (2.0..14.0).contains(&x) && (2.0..14.0).contains(&y);
        if inside { (1.0 - (x - 5.0).abs() / 3.0).max(1.0 - (y - 9.0).abs() / 2.0).max(0.0) } else { 0.0 }
    };
    let texels: Vec<u32> = (0..256).map(|i| texel(i).to_bits()).collect();
    let map = HeightMap {
        width: 16,
        height: 16,
        format: height_format::FLOAT32,
        texels,
        range: (0.0, 1.0),
        replaced: 0,
    };
    let mut backend = CpuBackend::new();
    for (turn, plane) in Plane::ALL.into_iter().enumerate() {
        for pair in [Pair::Back, Pair::BackOtherDiagonal] {
            for height in [1e-3, 0.2] {
                let scale = SCALES[turn % 3];
                #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
                let relief = Relief::new(map.clone(), 0.0, (height * scale) as f32);
                let [leaf, front] = [pair, Pair::Alone].map(|pair| {
                    let planes = Planes { plane, pair, scale, offset: OFFSETS[turn % 3] };
                    let job = planes.job(Method::Quadtree, relief.clone(), 16, (80, 60), true);
                    rendered(&mut backend, &job, 2)
                });
                // A sample in a wrong shadow loses at least a hundredth of its light, half a hundredth of a pixel's.
                let differs = |(a, b): (&Vec4, &Vec4)| (a - b).abs().max_element() > 2e-3 * b.max_element();
                let wrong = leaf.pixels.iter().zip(&front.pixels).filter(|&pair| differs(pair)).count();
                assert_eq!(wrong, 0, "{plane:?}, {pair:?}, height {height}");
            }
        }
    }
}
