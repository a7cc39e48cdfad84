//! Instances on lavapipe: what `instances.rs` asks of the CPU, by fewer rays, and the CPU's trees and pictures.

use emboss::backend::Backend;
use emboss::settings::{Normals, Settings};
use emboss_kernels::interface::MISS;
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::instances::{OracleCase, placed, rotation, rough, two_meshes, wild, world_ray};
use emboss_tests::long::on_device;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{job, scaled};
use emboss_tests::{LeakRays, Numbers, meshes};
use glam::{DAffine3, DVec3};

/// In wild places and in crowds; then the same after other heights, by the trees that are built anew.
#[test]
fn rays_through_instances_are_right() {
    on_device(|backend| {
        for round in 0..2 {
            let case = OracleCase::new(round, Normals::Normalized, 60, Oracle::of_vulkan);
            let (job, rays) = (&case.job, &case.rays);
            let mut flat = job.buffers.clone();
            flat.displacements.iter_mut().for_each(|map| (map.scale, map.height_max) = (0.01, 0.011));
            backend.load(&flat, &job.frame, job.features).expect("fits");
            let before = backend.trace_rays(rays).expect("the device traces");
            backend.set_displacements(&job.buffers.displacements).expect("only heights differ");
            let hits = backend.trace_rays(rays).expect("the device traces");
            assert_ne!(before, hits);
            let clear = case.assert_right(&hits);
            // Vulkan may round five times as much as the CPU, far instances leave more rays near edges than not.
            assert!(3 * clear > rays.len(), "{clear} clear");
        }
    });
}

/// Nodes of all trees point where those of the CPU do. Boxes may differ in their last places.
#[test]
fn trees_of_instances_are_the_cpus() {
    on_device(|backend| {
        let mut numbers = Numbers::new(1);
        let places = [(); 2].map(|()| (0..30).map(|_| wild(&mut numbers)).collect());
        let job = job(two_meshes(places).0, &Settings { width: 1, height: 1, ..Settings::default() });
        backend.load(&job.buffers, &job.frame, job.features).expect("fits");
        let links = |bvh: &emboss::bvh::Bvh| -> Vec<_> {
            bvh.nodes.iter().map(|node| (node.first, node.count)).collect()
        };
        let tree = backend.bvh().expect("there is one");
        assert_eq!(links(&tree), links(job.bvh()));
        assert_eq!(tree.primitives, job.bvh().primitives);
        assert_eq!(backend.build_report().nodes as usize, tree.nodes.len());
        assert_eq!(backend.build_report().left_out, 0);
    });
}

#[test]
fn closed_meshes_are_closed_in_wild_places() {
    on_device(|backend| {
        let solid = meshes::icosphere(1);
        let home = solid.placed(1.0, 0.0);
        let settings = Settings { width: 1, height: 1, ..Settings::default() };
        let mesh = job(rough(&solid, 5), &settings);
        for round in 0..2 {
            // Turned and scaled, not so far that rounding takes rays out of the mesh.
            let mut numbers = Numbers::new(round);
            let scale = DVec3::new(0.01, -3.0, 0.7);
            let to = numbers.direction().as_dvec3();
            let place = DAffine3::from_scale_rotation_translation(scale, rotation(&mut numbers), to);
            let job = job(placed(rough(&solid, 5), vec![place]), &settings);
            let rays = LeakRays::new(&mesh, &home.inside, round).rays(0, 2000);
            let rays: Vec<_> = rays.iter().map(|ray| world_ray(place, ray)).collect();
            backend.load(&job.buffers, &job.frame, job.features).expect("fits");
            let hits = backend.trace_rays(&rays).expect("the device traces");
            for (ray, hit) in rays.iter().zip(hits) {
                assert!(hit.primitive != MISS, "{place:?} {ray:?} leaks");
            }
        }
    });
}

/// Shadows from instance to instance and within one.
#[test]
fn pictures_are_alike() {
    on_device(|backend| {
        let mut numbers = Numbers::new(5);
        let mut place = || {
            let scale = DVec3::new(-0.6, 0.4, 0.5);
            let to = numbers.direction().as_dvec3();
            DAffine3::from_scale_rotation_translation(scale, rotation(&mut numbers), to)
        };
        let places = [(); 2].map(|()| (0..4).map(|_| place()).collect());
        let scene = scaled(two_meshes(places).0, 0.2);
        let settings = Settings { smooth: true, width: 64, height: 48, ..Settings::default() };
        let job = job(scene, &settings);
        let picture = rendered(backend, &job, 2);
        against_cpu(&job, 2, &picture).assert_same("lit");
        let hit = picture.pixels.iter().filter(|pixel| pixel.w > 0.0).count();
        assert!(hit * 10 > picture.pixels.len(), "only {hit} pixels show anything");
    });
}
