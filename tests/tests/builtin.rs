//! The quadtree against brute force on the built-in scenes and on random ones, and what tracing promises whatever the
//! method.

use bytemuck::bytes_of;
use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::Wrap;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{BvhNode, Intersection, MISS, Ray, Vertex, bounds, height_format, method};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::render::trace_ray;
use emboss_kernels::scene::{Features, SceneView};
use emboss_tests::scenes::{self, ReadyJob};
use emboss_tests::{Numbers, RaySource};
use glam::{Quat, Vec3};

/// The nearest hits of rays.
fn traced(job: &ReadyJob, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    let features = Features { method, ..job.features };
    backend.load(&job.buffers, &job.frame, features).expect("a built-in scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// A built-in scene at another N.
fn subdivided(name: &str, subdivisions: u32) -> ReadyJob {
    scenes::ready(Scene { subdivisions, ..scenes::builtin(name) }, Wrap::Repeat)
}

/// Panics with the first of the differences between two lists of answers to the same rays. Every field counts,
/// bit for bit.
fn assert_identical(job: &ReadyJob, rays: &[Ray], left: &[Intersection], right: &[Intersection]) {
    let differences: Vec<_> = rays
        .iter()
        .zip(left.iter().zip(right))
        .filter(|(_, (left, right))| bytes_of(*left) != bytes_of(*right))
        .collect();
    if let Some((ray, (left, right))) = differences.first() {
        let n = job.frame.subdivisions;
        let (count, of) = (differences.len(), rays.len());
        panic!("N = {n}: {count} of {of} rays differ, first\n{ray:?}\n{left:?}\n{right:?}");
    }
}

/// Quadtree and brute force on rays of all kinds, and on those that leave what they hit.
fn compare_methods(job: &ReadyJob, seed: u64, of_each: usize) {
    let first = RaySource::new(job, seed).of_each_kind(of_each);
    let hits = traced(job, method::BRUTE_FORCE, &first);
    assert_identical(job, &first, &traced(job, method::QUADTREE, &first), &hits);

    let mut source = RaySource::new(job, seed + 100);
    let hits: Vec<_> = hits.into_iter().filter(|hit| hit.primitive != MISS).collect();
    assert!(4 * hits.len() > first.len(), "{} hits are no test", hits.len());
    let second: Vec<Ray> = hits.iter().map(|hit| source.leaving(hit)).collect();
    let found = traced(job, method::QUADTREE, &second);
    assert_identical(job, &second, &found, &traced(job, method::BRUTE_FORCE, &second));
}

fn compare_methods_at_all_n(name: &str, of_each: usize) {
    for (n, of_each) in [(1, of_each), (3, of_each), (8, of_each), (17, of_each), (64, of_each / 10)] {
        compare_methods(&subdivided(name, n), u64::from(n), of_each);
    }
}

#[test]
fn quadtree_is_brute_force_on_the_cube() {
    compare_methods_at_all_n("builtin:cube", 2000);
}

#[test]
fn quadtree_is_brute_force_on_the_quilt() {
    compare_methods_at_all_n("builtin:quilt", 2000);
}

#[test]
fn quadtree_is_brute_force_on_the_knot() {
    compare_methods_at_all_n("builtin:knot", 2000);
}

/// Normals that lean from not at all to wildly, every format and wrap.
#[test]
fn quadtree_is_brute_force_on_random_solids() {
    let mut numbers = Numbers::new(4);
    let formats = [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32];
    let wraps = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
    for round in 0..180 {
        let spread = [0.0, 0.1, 0.5, 1.5][round % 4];
        let scene = scenes::random_solid(&mut numbers, formats[round % 3], spread);
        compare_methods(&scenes::ready(scene, wraps[round / 3 % 3]), numbers.bits() >> 1, 50);
    }
}

/// One triangle of constant height, found at random among millions: its normals lean by 60 degrees, the ray's path
/// comes to its nearest at grid point (1, 2), and the micro-triangle that is hit has no more than that point in common
/// with the cells of the path.
#[test]
fn quadtree_finds_a_hit_across_a_micro_vertex() {
    let vertex = |position: [f32; 3], normal: [f32; 3]| Vertex {
        position: position.into(),
        normal: Vec3::from(normal).normalize(),
        ..Vertex::default()
    };
    let vertices = [
        vertex([0.81386554, 0.21584743, 0.029831482], [0.66596794, 0.53668684, -0.51812536]),
        vertex([0.08238638, 0.12679933, -0.71385616], [0.4714612, -0.12922156, -0.8723681]),
        vertex([-0.21616498, 0.7289925, -0.08159051], [0.3496214, 0.6065656, 0.71403295]),
    ];
    let texels = vec![0.7994125_f32.to_bits()];
    let format = height_format::FLOAT32;
    let ray = Ray {
        origin: Vec3::new(2.9840372, 3.0194526, -1.5976778),
        direction: Vec3::new(-0.67480385, -0.6486125, 0.35205334),
        t_max: f32::INFINITY,
        padding: 0,
    };
    for subdivisions in 1..=16 {
        let job = scenes::ready(
            Scene {
                mesh: Mesh::from_triangles(&vertices, &[[0, 1, 2]]),
                reliefs: vec![Relief::new(
                    HeightMap {
                        width: 1,
                        height: 1,
                        format,
                        texels: texels.clone(),
                        range: (0.0, 1.0),
                        replaced: 0,
                    },
                    0.1144588,
                    -0.14865246,
                )],
                materials: vec![Material::default()],
                parts: vec![],
                subdivisions,
            },
            Wrap::Repeat,
        );
        let exact = traced(&job, method::BRUTE_FORCE, &[ray]);
        assert_ne!(exact[0].primitive, MISS);
        assert_identical(&job, &[ray], &traced(&job, method::QUADTREE, &[ray]), &exact);
    }
}

/// The nearest hits of rays by the tree of one leaf that holds all primitives in descending order.
fn traced_in_reverse(job: &ReadyJob, method: u32, rays: &[Ray]) -> Vec<Intersection> {
    let Aabb { min, max } = job.bounds();
    let primitives: Vec<u32> = (0..job.frame.triangle_count).rev().collect();
    let nodes = [BvhNode { min, max, first: 0, count: job.frame.triangle_count }];
    let scene = SceneView { nodes: &nodes, primitives: &primitives, ..job.view() };
    // A stored tree has an order of its own.
    let features = Features { method, bounds: bounds::NONE, ..job.features };
    rays.iter().map(|ray| trace_ray(&scene, features, *ray, &mut Counts::default())).collect()
}

/// Rays towards shared edges are ties by intent: the lower triangle, then the lower cell, wins.
#[test]
fn the_order_of_primitives_does_not_show() {
    for (name, n, of_each) in
        [("builtin:cube", 5, 5000), ("builtin:quilt", 8, 5000), ("builtin:knot", 3, 200)]
    {
        let job = subdivided(name, n);
        let rays = RaySource::new(&job, 7).of_each_kind(of_each);
        for method in [method::BRUTE_FORCE, method::GRID_WALK, method::QUADTREE] {
            let hits = traced(&job, method, &rays);
            assert_identical(&job, &rays, &hits, &traced_in_reverse(&job, method, &rays));
        }
    }
}

/// Hits of rays from outside, and for each a ray that leaves it on the outer side.
fn leaving_outwards(job: &ReadyJob, seed: u64, count: usize) -> Vec<(Intersection, Ray)> {
    let mut source = RaySource::new(job, seed);
    let rays: Vec<Ray> = (0..count).map(|_| source.from_outside()).collect();
    let hits = traced(job, method::QUADTREE, &rays);
    let hits: Vec<_> = hits.into_iter().filter(|hit| hit.primitive != MISS).collect();
    assert!(2 * hits.len() > count, "{} hits are no test", hits.len());
    hits.into_iter().map(|hit| (hit, source.leaving_outwards(&hit))).collect()
}

/// What a ray hits that leaves a hit, traced as shadow rays are: from the spawned origin, and blind to the triangle
/// that it leaves.
fn hit_again(job: &ReadyJob, method: u32, left: &Intersection, ray: &Ray) -> Hit {
    let scene = job.view();
    let normal = left.normal;
    let left = Hit {
        t: left.t,
        primitive: left.primitive,
        cell: left.cell,
        b1: left.b1,
        b2: left.b2,
        instance: left.instance,
    };
    let side = normal * normal.dot(ray.direction).signum();
    let ray = TraversalRay::new(ray.origin, ray.direction, ray.t_max).leaving(left, side);
    let features = Features { method, ..job.features };
    traverse(&scene, features, &ray, Query::Nearest, &mut Counts::default())
}

/// Asserts that rays which leave `scene`, a convex surface, on its outer side hit nothing.
fn assert_nothing_in_the_way(scene: Scene, seed: u64, count: usize) {
    let job = scenes::ready(scene, Wrap::Repeat);
    let left = leaving_outwards(&job, seed, count);
    for method in [method::NONE, method::BRUTE_FORCE, method::GRID_WALK, method::QUADTREE] {
        let hits: Vec<_> = left
            .iter()
            .map(|(hit, ray)| (hit, ray, hit_again(&job, method, hit, ray)))
            .filter(|(_, _, again)| again.is_some())
            .collect();
        if let Some((hit, ray, again)) = hits.first() {
            let n = job.frame.subdivisions;
            let (count, of) = (hits.len(), left.len());
            panic!("method {method}, N = {n}: {count} of {of}\n{hit:?}\n{ray:?}\n{again:?}");
        }
    }
}

/// Its flat faces consist of many micro-triangles: neither these nor those of other faces are in the way.
#[test]
fn rays_that_leave_a_cube_hit_nothing() {
    let mut numbers = Numbers::new(3);
    for round in 0..20 {
        let cube = scenes::scaled(Scene { subdivisions: 1 + round, ..scenes::builtin("builtin:cube") }, 0.0);
        let (axis, angle) = (numbers.direction(), numbers.between(0.0, 6.0));
        let (rotation, translation) = match round % 3 {
            0 => (Quat::IDENTITY, Vec3::ZERO),
            1 => (Quat::from_axis_angle(axis, angle), Vec3::ZERO),
            _ => (Quat::from_axis_angle(axis, angle), numbers.in_cube() * 100.0),
        };
        assert_nothing_in_the_way(scenes::moved(cube, rotation, translation), 5, 2000);
    }
}

/// In the plane z = 0 the stored coordinates are exact, and so is z of every hit: no error box lifts the ray off.
#[test]
fn rays_that_leave_a_plane_hit_nothing() {
    for n in [1, 2, 8, 17] {
        let quilt = scenes::scaled(Scene { subdivisions: n, ..scenes::builtin("builtin:quilt") }, 0.0);
        assert_nothing_in_the_way(quilt, 6, 20_000);
    }
}
