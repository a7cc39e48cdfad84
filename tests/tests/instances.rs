//! Instances: rays through them against oracles in f64, closed meshes in wild places, rays that leave them, trees over
//! many, ties, memory.

use emboss::backend::cpu::CpuBackend;
use emboss::backend::{Backend, SceneBuffers};
use emboss::instances::Part;
use emboss::render::{Job, Scene, prepare};
use emboss::scene::Mesh;
use emboss::settings::{Filter, Normals, Settings, Shade};
use emboss_kernels::bvh::traverse::{Query, traverse};
use emboss_kernels::counters::Counts;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
use emboss_kernels::hit::Hit;
use emboss_kernels::interface::{BvhNode, Instance, Intersection, MISS, Ray};
use emboss_kernels::ray::TraversalRay;
use emboss_kernels::scene::SceneView;
use emboss_tests::instances::{OracleCase, object_from_world, placed, rotation, rough, wild, world_ray};
use emboss_tests::meshes;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{self, ReadyJob, job};
use emboss_tests::{LeakRays, Numbers, RaySource};
use glam::{DAffine3, DMat3, DVec3, Vec3};

fn settings() -> Settings {
    Settings { width: 1, height: 1, ..Settings::default() }
}

fn hits(job: &ReadyJob, rays: &[Ray]) -> Vec<Intersection> {
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    backend.trace_rays(rays).expect("the CPU does not fail")
}

/// Every ray's answer is one that rounding allows, by oracles of each mesh in object space.
#[test]
fn the_oracle_accepts_rays_through_instances_in_wild_places() {
    let mut clear = 0;
    for (i, round) in (0..12).enumerate() {
        let normals = [Normals::Normalized, Normals::Linear][i / 2 % 2];
        let case = OracleCase::new(round, normals, 150, Oracle::new);
        clear += case.assert_right(&hits(&case.job, &case.rays));
    }
    // A judge that lets everything pass would be none: far from edges there is one answer.
    assert!(clear > 12 * 6 * 450 * 3 / 4, "{clear} clear");
}

/// The nearest hit by the tree over one instance alone, whose box is everything.
fn through_one(view: &SceneView<'_>, job: &ReadyJob, instance: u32, ray: &TraversalRay) -> Hit {
    let mut nodes = view.nodes.to_vec();
    let (min, max) = (Vec3::splat(-1e30), Vec3::splat(1e30));
    nodes[0] = BvhNode { min, max, first: instance, count: 1 };
    let view = SceneView { nodes: &nodes, ..*view };
    traverse(&view, job.features, ray, Query::Nearest, &mut Counts::default())
}

/// Rays from afar past a vertex that is an instance's farthest along an axis, at right angles to that, beside it by no
/// more than rounding in object space may make of the distance: there the world and object space tell hits from misses
/// apart.
fn past_extremes(place: DAffine3, mesh: &Mesh, numbers: &mut Numbers) -> Vec<Ray> {
    let points: Vec<DVec3> =
        mesh.vertices.iter().map(|v| place.transform_point3(v.position.as_dvec3())).collect();
    let radius = points[0].distance(points[points.len() / 2]);
    let mut rays = Vec::new();
    for axis in DVec3::AXES {
        for side in [axis, -axis] {
            let along = |p: &&DVec3| p.dot(side);
            let extreme = points.iter().max_by(|a, b| along(a).total_cmp(&along(b))).expect("not empty");
            for _ in 0..10 {
                let direction = numbers.direction().as_dvec3().reject_from(axis).normalize();
                let distance = 1e3 * radius;
                let beside = f64::from(numbers.unit()) * 2e-7 * distance;
                let origin = *extreme + side * beside - direction * distance;
                rays.push(Ray {
                    origin: origin.as_vec3(),
                    t_max: f32::INFINITY,
                    direction: direction.as_vec3(),
                    padding: 0,
                });
            }
        }
    }
    rays
}

/// Boxes of instances lose no hit, also where rounding in the world and in object space decides apart; and the nearest
/// of all is found, the lowest instance where several are.
#[test]
fn the_tree_over_instances_finds_what_each_of_them_holds() {
    for (round, scene) in [scenes::tiles(), rough(&meshes::icosphere(0), 3)].into_iter().enumerate() {
        let scene = scenes::scaled(scene, 0.0);
        let mut numbers = Numbers::new(round as u64);
        let mesh = job(scene.clone(), &settings());
        let mut places: Vec<DAffine3> = (0..20).map(|_| wild(&mut numbers)).collect();
        // A crowd, and some of it twice.
        places.extend((0..20).map(|_| {
            let (turned, to) = (rotation(&mut numbers), numbers.direction().as_dvec3() * 3.0);
            DAffine3::from_scale_rotation_translation(DVec3::splat(0.3), turned, to)
        }));
        places.extend_from_within(35..);
        let job = job(placed(scene.clone(), places.clone()), &settings());
        let view = job.view();
        let (mut hit, mut beside) = (0, 0);
        for &place in &places {
            let mut source = RaySource::new(&mesh, 5);
            let ordinary = (0..20).flat_map(|_| [source.from_outside(), source.towards_edge(1e4)]);
            let mut rays: Vec<Ray> = ordinary.map(|ray| world_ray(place, &ray)).collect();
            rays.extend(past_extremes(place, &scene.mesh, &mut numbers));
            for (i, ray) in rays.into_iter().enumerate() {
                let (ray, _) = TraversalRay::from_ray(ray);
                let nearest = |query| traverse(&view, job.features, &ray, query, &mut Counts::default());
                let expected = (0..)
                    .zip(&job.buffers.instances)
                    .map(|(i, _)| through_one(&view, &job, i, &ray))
                    .fold(Hit::NONE, Hit::nearer);
                assert_eq!(nearest(Query::Nearest), expected, "{ray:?}");
                assert_eq!(nearest(Query::Any).is_some(), expected.is_some(), "{ray:?}");
                hit += usize::from(expected.is_some());
                beside += usize::from(i >= 40 && expected.is_some());
            }
        }
        assert!(hit > 1000 && beside > 100, "{hit} hits, {beside} beside vertices, are no test");
    }
}

/// Of equal instances the first is hit, and a ray that leaves one of them meets the other.
#[test]
fn equal_instances_part_by_their_numbers() {
    let mut numbers = Numbers::new(3);
    let place = wild(&mut numbers);
    let scene = rough(&meshes::icosphere(1), 4);
    let mesh = job(scene.clone(), &settings());
    let alone = job(placed(scene.clone(), vec![place]), &settings());
    let twins = job(placed(scene, vec![place; 3]), &settings());
    let mut source = RaySource::new(&mesh, 1);
    let rays: Vec<Ray> = (0..300).map(|_| world_ray(place, &source.from_outside())).collect();
    assert_eq!(hits(&twins, &rays), hits(&alone, &rays));
    for ray in rays {
        let (ray, _) = TraversalRay::from_ray(ray);
        let nearest = |ray: &TraversalRay| {
            traverse(&twins.view(), twins.features, ray, Query::Nearest, &mut Counts::default())
        };
        let first = nearest(&ray);
        if first.is_some() {
            assert_eq!(nearest(&blind_to(first, ray)), Hit { instance: 1, ..first });
            let second = Hit { instance: 1, ..first };
            assert_eq!(nearest(&blind_to(second, ray)), first);
        }
    }
}

/// In its own space a closed mesh is closed; so it is in any place. Rays that rounding in the world takes out of the
/// mesh are none of it. Their outside stays outside,
/// mirrored or not.
#[test]
fn closed_meshes_are_closed_in_wild_places() {
    let (mut traced, mut sides) = (0, 0);
    for (i, solid) in [meshes::icosphere(1), meshes::cube(), meshes::genus_three(1)].iter().enumerate() {
        let home = solid.placed(1.0, 0.0);
        for (turn, round) in (0..20).enumerate() {
            let mut numbers = Numbers::new(100 * i as u64 + round);
            let scene = rough(solid, [1, 3, 8][turn % 3]);
            let mesh = job(scene.clone(), &settings());
            let place = wild(&mut numbers);
            let job = job(placed(scene, vec![place]), &settings());
            let back = object_from_world(&job.buffers.instances[0]);
            let rays = LeakRays::new(&mesh, &home.inside, round).rays(0, 3000);
            let is_inside = |ray: &Ray, moved: &Ray| {
                let origin = back.transform_point3(moved.origin.as_dvec3());
                origin.distance(ray.origin.as_dvec3()) < 0.5 * home.room
            };
            let (home_rays, rays): (Vec<Ray>, Vec<Ray>) = rays
                .into_iter()
                .map(|ray| (ray, world_ray(place, &ray)))
                .filter(|(ray, moved)| is_inside(ray, moved))
                .unzip();
            traced += rays.len();
            let at_home = hits(&mesh, &home_rays);
            for ((ray, home_ray), (hit, at_home)) in
                rays.iter().zip(&home_rays).zip(hits(&job, &rays).iter().zip(&at_home))
            {
                assert!(hit.primitive != MISS, "{place:?} {ray:?} leaks");
                if (hit.primitive, hit.cell) == (at_home.primitive, at_home.cell) {
                    let sines = [(ray, hit), (home_ray, at_home)]
                        .map(|(ray, hit)| hit.normal.dot(ray.direction.normalize()));
                    // Well above the rounding of either.
                    let is_sure = sines.iter().all(|sine| sine.abs() > 1e-4);
                    assert!(!is_sure || sines[0] * sines[1] > 0.0, "{place:?} {ray:?} {hit:?}");
                    sides += usize::from(is_sure);
                }
            }
        }
    }
    assert!(traced > 100_000 && sides > 50_000, "{traced} rays, {sides} sides");
}

/// The corners of a micro-triangle in object space.
fn corners(job: &ReadyJob, primitive: u32, cell: u32) -> [DVec3; 3] {
    let view = job.view();
    let field = HeightField::new(&view, job.features);
    let corners = BaseTriangle::load(&view, primitive).micro_triangle(&field, Cell::unpack(cell));
    corners.map(|corner| corner.as_dvec3())
}

/// A ray that leaves a hit to one side of its micro-triangle hits nothing of the same instance that lies wholly on the
/// other (`reintersection.rs`), whatever rounding does on the way to the world and back. Sides are told in object
/// space, in f64.
#[test]
fn rays_that_leave_instances_do_not_meet_what_they_leave() {
    let (mut left, mut seconds) = (0, 0);
    for (round, solid) in
        [meshes::cube(), meshes::icosphere(1), meshes::icosphere(2)].iter().cycle().take(60).enumerate()
    {
        let mut numbers = Numbers::new(round as u64);
        let scene = rough(solid, [1, 8, 64][round / 3 % 3]);
        // Far away there is most to lose on the way.
        let far = rotation(&mut numbers) * DVec3::X * 3e3;
        let place = match round % 2 {
            0 => wild(&mut numbers),
            _ => DAffine3::from_scale_rotation_translation(DVec3::ONE, rotation(&mut numbers), far),
        };
        let mesh = job(scene.clone(), &settings());
        let job = job(placed(scene, vec![place]), &settings());
        let back = object_from_world(&job.buffers.instances[0]).matrix3;
        let mut source = RaySource::new(&mesh, round as u64);
        let towards: Vec<Ray> = (0..1500).map(|_| world_ray(place, &source.from_outside())).collect();
        for hit in hits(&job, &towards).iter().filter(|hit| hit.primitive != MISS) {
            let ray = source.leaving(hit);
            let [a, b, c] = corners(&job, hit.primitive, hit.cell);
            let normal = (b - a).cross(c - a);
            let direction = back * ray.direction.as_dvec3();
            let in_world = (back.transpose() * normal).normalize();
            let sine = direction.dot(normal) / (direction.length() * normal.length());
            // Where f32 takes another side than f64 the ray leaves to neither.
            if normal == DVec3::ZERO || in_world.dot(ray.direction.as_dvec3()).abs() < 1e-5 {
                continue;
            }
            left += 1;
            let Intersection { t, primitive, cell, b1, b2, instance, .. } = *hit;
            let (ray, _) = TraversalRay::from_ray(ray);
            let side = (in_world * sine.signum()).as_vec3();
            let ray = ray.leaving(Hit { t, primitive, cell, b1, b2, instance }, side);
            let second = traverse(&job.view(), job.features, &ray, Query::Nearest, &mut Counts::default());
            if second.is_some() {
                seconds += 1;
                let above = |p: DVec3| (p - a).dot(normal) * sine > 0.0;
                let [d, e, f] = corners(&job, second.primitive, second.cell);
                assert!(
                    above(d) || above(e) || above(f),
                    "{place:?}\n{ray:?}\nleaves {hit:?}\nhits {second:?}"
                );
            }
        }
    }
    assert!(left > 40_000 && seconds > 10_000, "{left} rays, {seconds} hit again");
}

/// The ray blind to a micro-triangle, but to no plane.
fn blind_to(hit: Hit, ray: TraversalRay) -> TraversalRay {
    TraversalRay { left_primitive: hit.primitive, left_cell: hit.cell, left_instance: hit.instance, ..ray }
}

/// Instances look as copies of the mesh in their places, whose heights are scaled with them: turned, mirrored, and one
/// the other's shadow. Colour maps are read by levels, so that the density of texels tells too.
#[test]
fn instances_look_as_baked_copies() {
    const SCALE: f64 = 0.37;
    let mut numbers = Numbers::new(8);
    let places: Vec<DAffine3> = (0..5)
        .map(|i| {
            let scale = DVec3::new(if i % 2 == 0 { -SCALE } else { SCALE }, SCALE, SCALE);
            let to = DVec3::from([1.0, -0.3, 0.5]) * f64::from(i) + numbers.direction().as_dvec3();
            DAffine3::from_scale_rotation_translation(scale, rotation(&mut numbers), to)
        })
        .collect();
    let (scene, shown) = scenes::builtin_scene("builtin:cube", 8, 96, 72);
    let mut copies = scene.clone();
    copies.mesh = Mesh::default();
    for &place in &places {
        copies.mesh.append(scene.mesh.transformed(place).expect("finite"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "rounded")]
    let scale = copies.reliefs[0].scale * SCALE as f32;
    copies.reliefs[0].scale = scale;
    let instanced = placed(scene, places);
    for (shade, smooth) in
        [(Shade::Lit, false), (Shade::Lit, true), (Shade::Normal, false), (Shade::Uv, false)]
    {
        let settings = Settings { shade, smooth, filter: Filter::Trilinear, lights: vec![], ..shown.clone() };
        let [baked, placed] = [copies.clone(), instanced.clone()].map(|scene| job(scene, &settings));
        // The same camera and light for both: boxes of instances are wider.
        let (frame, lights) = (baked.frame, &baked.buffers.lights);
        let [expected, got] = [&baked, &placed].map(|job| {
            let mut backend = CpuBackend::new();
            backend.load(&job.buffers, &job.frame, job.features).expect("fits");
            backend.set_view(&frame, lights).expect("lights are there");
            let _ = backend.add_sample(0, &mut |_| std::ops::ControlFlow::Continue(())).expect("runs");
            backend.resolve().expect("there is a picture")
        });
        // Rounding tells where next to an edge a ray hits: some 1e-6 of a micro-triangle's width, a share of pixels
        // below 1e-3; a facet's normal is off by as much, and by it light and levels.
        let differ = expected.iter().zip(&got).filter(|(a, b)| (**a - **b).abs().max_element() > 2e-3);
        let shown = expected.iter().filter(|pixel| pixel.w > 0.0).count();
        let differ = differ.count();
        assert!(shown > 1000 && 500 * differ <= shown, "{shade:?}: {differ} of {shown} pixels");
    }
}

fn prepared(scene: Scene) -> Job {
    prepare(scene, &settings()).expect("sound")
}

/// Bytes of the instances alone.
#[test]
fn a_thousand_instances_cost_themselves_and_their_nodes() {
    let mut numbers = Numbers::new(1);
    let places: Vec<DAffine3> = (0..1000).map(|_| wild(&mut numbers)).collect();
    let scene = rough(&meshes::icosphere(2), 4);
    let [one, many] =
        [&places[..1], &places[..]].map(|places| prepared(placed(scene.clone(), places.to_vec())));
    let none = prepared(scene);
    let instances = |job: &Job| job.buffers.instances.len();
    assert_eq!((instances(&none), instances(&one), instances(&many)), (0, 1, 1000));
    assert_eq!((none.features.instances, many.features.instances), (0, 1));
    assert_eq!(size_of::<Instance>(), 112);
    for job in [one, many] {
        let mut backend = CpuBackend::new();
        backend.load(&job.buffers, &job.frame, job.features).expect("fits");
        let nodes = backend.bvh().expect("there is one").nodes.len();
        assert_eq!(nodes, 2 * instances(&job) - 1 + 2 * none.buffers.triangles.len() - 1);
        assert_eq!(backend.build_report().nodes as usize, nodes);
        assert_eq!(SceneBuffers { instances: vec![], ..job.buffers.clone() }.vertices, none.buffers.vertices);
        assert_eq!(job.buffers.triangles.len(), none.buffers.triangles.len());
        assert_eq!(job.buffers.height_texels.len(), none.buffers.height_texels.len());
    }
}

/// Other heights give other boxes, of meshes and of instances.
#[test]
fn instances_follow_their_heights() {
    let mut numbers = Numbers::new(2);
    let places: Vec<DAffine3> = (0..4).map(|_| wild(&mut numbers)).collect();
    let scene = rough(&meshes::icosphere(1), 5);
    let mesh = job(scenes::scaled(scene.clone(), 0.4), &settings());
    let [low, high] = [0.02, 0.4]
        .map(|scale| job(placed(scenes::scaled(scene.clone(), scale), places.clone()), &settings()));
    let mut backend = CpuBackend::new();
    backend.load(&low.buffers, &low.frame, low.features).expect("fits");
    let rays: Vec<Ray> = places
        .iter()
        .flat_map(|&place| {
            let mut source = RaySource::new(&mesh, 4);
            (0..200).map(move |_| world_ray(place, &source.from_outside())).collect::<Vec<_>>()
        })
        .collect();
    for (there, scene) in [(&high, true), (&low, false), (&high, true)] {
        backend.set_displacements(&there.buffers.displacements).expect("only heights differ");
        assert_eq!(backend.trace_rays(&rays).expect("runs"), hits(there, &rays), "high: {scene}");
    }
}

/// A mesh of nothing and one that stands nowhere are as if they were not there.
#[test]
fn empty_meshes_and_meshes_without_places_show_nothing() {
    let mut numbers = Numbers::new(4);
    let places: Vec<DAffine3> = (0..2).map(|_| wild(&mut numbers)).collect();
    let scene = rough(&meshes::icosphere(1), 3);
    let mesh = job(scene.clone(), &settings());
    let expected = job(placed(scene.clone(), places.clone()), &settings());
    let mut others = placed(scene.clone(), places.clone());
    others.mesh.append(scene.mesh);
    let count = others.parts[0].triangle_count;
    others.parts.insert(0, Part { triangle_count: count, places: vec![] });
    others.parts.insert(1, Part { triangle_count: 0, places: places.clone() });
    let others = job(others, &settings());
    let mut source = RaySource::new(&mesh, 4);
    let rays: Vec<Ray> = (0..300).map(|_| world_ray(places[1], &source.from_outside())).collect();
    let behind = |hit: Intersection| match hit.primitive {
        MISS => hit,
        primitive => Intersection { primitive: primitive + count, instance: hit.instance + 2, ..hit },
    };
    let expected: Vec<Intersection> = hits(&expected, &rays).into_iter().map(behind).collect();
    assert!(expected.iter().any(|hit| hit.primitive != MISS));
    assert_eq!(hits(&others, &rays), expected);
    let mut nothing = placed(Scene { mesh: Mesh::default(), ..rough(&meshes::cube(), 1) }, places);
    nothing.parts[0].triangle_count = 0;
    assert!(hits(&job(nothing, &settings()), &rays).iter().all(|hit| hit.primitive == MISS));
}

/// Transforms that floats cannot invert are refused.
#[test]
fn transforms_that_leave_nothing_are_refused() {
    let refused = |matrix: DMat3, to: f64| {
        let place = DAffine3::from_mat3_translation(matrix, DVec3::splat(to));
        prepare(placed(rough(&meshes::cube(), 1), vec![place]), &settings()).is_err()
    };
    let shear = |x: f64| DMat3::from_cols(DVec3::X, DVec3::new(x, 1.0, 0.0), DVec3::Z);
    for (matrix, to) in [
        (DMat3::ZERO, 0.0),
        (DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)), 0.0),
        (DMat3::from_diagonal(DVec3::splat(1e-35)), 0.0),
        (DMat3::from_diagonal(DVec3::splat(1e35)), 0.0),
        (DMat3::from_diagonal(DVec3::splat(f64::NAN)), 0.0),
        (DMat3::IDENTITY, f64::INFINITY),
        (DMat3::IDENTITY, 1e39),
        (DMat3::from_diagonal(DVec3::splat(1e-20)), 1e25),
        (shear(100.0), 0.0),
    ] {
        assert!(refused(matrix, to), "{matrix:?} {to}");
    }
    assert!(!refused(shear(0.5), 1e6) && !refused(DMat3::from_diagonal(DVec3::new(1e-3, -1.0, 1e3)), 1e3));
}
