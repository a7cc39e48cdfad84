//! The methods of `relief_fields.rs` on lavapipe.

use bytemuck::bytes_of;
use emboss::backend::Backend;
use emboss::render::Scene;
use emboss::settings::{Method, Settings, Wrap};
use emboss_kernels::interface::MISS;
use emboss_kernels::scene::Features;
use emboss_tests::RaySource;
use emboss_tests::changes;
use emboss_tests::compare::{against_cpu, rendered};
use emboss_tests::flat::assert_all_methods_show_the_base_mesh;
use emboss_tests::long::on_device;
use emboss_tests::scenes::{self, builtin_scene};

/// Micro-vertices that one module stores are those that another one computes: the hits of the same device's quadtree,
/// to the bit. After heights have changed the picture is that of the CPU.
#[test]
fn tessellate_is_quadtree() {
    on_device(|backend| {
        let exact = scenes::ready(Scene { subdivisions: 9, ..scenes::builtin("builtin:cube") }, Wrap::Repeat);
        let mut source = RaySource::new(&exact, 1);
        let rays: Vec<_> = (0..1000)
            .flat_map(|_| [source.from_outside(), source.grazing(), source.towards_edge(3.0)])
            .collect();
        let mut traced = |method: Method| {
            let features = Features { method: method.id(), ..exact.features };
            backend.load(&exact.buffers, &exact.frame, features).expect("a small scene fits");
            backend.trace_rays(&rays).expect("no device fails")
        };
        let (expected, found) = (traced(Method::Quadtree), traced(Method::Tessellate));
        for ((ray, expected), found) in rays.iter().zip(&expected).zip(&found) {
            assert_eq!(bytes_of(expected), bytes_of(found), "{ray:?}\n{expected:?}\n{found:?}");
        }
        assert!(2 * expected.iter().filter(|hit| hit.primitive != MISS).count() > rays.len());

        let (scene, settings) = builtin_scene("builtin:cube", 6, 64, 48);
        let settings = Settings { method: Method::Tessellate, ..settings };
        let mut higher = scene.clone();
        higher.reliefs[0].scale *= 1.5;
        let (job, higher) = (scenes::job(scene, &settings), scenes::job(higher, &settings));
        rendered(backend, &job, 1);
        backend.set_displacements(&higher.buffers.displacements).expect("heights alone");
        backend.set_view(&higher.frame, &higher.buffers.lights).expect("a sound view");
        let seen = emboss::render::render(backend, &higher, 2, &mut |_| std::ops::ControlFlow::Continue(()));
        let seen = seen.expect("no device fails").picture;
        against_cpu(&higher, 2, &seen).assert_same("tessellate");
    });
}

#[test]
fn flat_maps_show_the_base_mesh() {
    on_device(|backend| assert_all_methods_show_the_base_mesh(backend, 300));
}

#[test]
fn distance_maps_are_computed_when_they_have_to_be() {
    on_device(|backend| changes::assert_distances_are_kept(backend));
}

/// Pictures of the waves' methods on a curved model, with shadows.
#[test]
fn pictures_are_those_of_the_cpu() {
    on_device(|backend| {
        for (method, n) in [(Method::Inverse, 12), (Method::Pyramid, 8), (Method::Sphere, 64)] {
            let (scene, settings) = builtin_scene("builtin:quilt", n, 64, 48);
            let job = scenes::job(scene, &Settings { method, ..settings });
            let picture = rendered(backend, &job, 1);
            against_cpu(&job, 1, &picture).assert_same(&format!("{method}"));
        }
    });
}
