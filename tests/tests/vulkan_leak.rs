//! A closed mesh stays closed on a Vulkan device: the rays of `leak.rs`, on lavapipe.
//!
//! With `EMBOSS_LONG=1` in the environment it is 10^9 rays, on the first hardware device or the one that `EMBOSS_DEVICE`
//! names.

use emboss::backend::Backend;
use emboss::backend::vulkan::{Selection, VulkanBackend};
use emboss::render::Scene;
use emboss::scene::Relief;
use emboss::settings::{Normals, Settings, Wrap};
use emboss_kernels::interface::MISS;
use emboss_tests::meshes::{self, Solid};
use emboss_tests::scenes::{ReadyJob, WildMap, job};
use emboss_tests::{LeakRays, Numbers, finish, lavapipe};
use glam::Vec3;
use std::env;
use std::time::Instant;

/// Scale, and distance from the origin in extents.
const PLACES: [(f64, f64); 4] = [(1.0, 0.0), (1e-6, 1e2), (1e6, 1.0), (1.0, 1e2)];
const SUBDIVISIONS: [u32; 5] = [1, 3, 7, 64, 1000];

/// Every solid at every place for every N, with the points that rays start from.
fn scenes() -> Vec<(String, ReadyJob, Vec<Vec3>)> {
    let solids: [(&str, Solid); 4] = [
        ("sphere", meshes::icosphere(2)),
        ("cube", meshes::cube()),
        ("knot", meshes::knot()),
        ("solid of genus three", meshes::genus_three(1)),
    ];
    let mut scenes = Vec::new();
    for (name, solid) in &solids {
        for (scale, offset) in PLACES {
            for n in SUBDIVISIONS {
                let turn = scenes.len();
                let placed = solid.placed(scale, offset);
                // Two maps on triangles in turns, no higher than half the way from rays' origins to the base mesh, and
                // much lower where there are many micro-triangles.
                let share = if n < 1000 { 0.5 } else { 0.02 };
                #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
                let relief = |map: WildMap| Relief {
                    map: map.map(&mut Numbers::new(turn as u64)),
                    zero: 0.0,
                    scale: (share * placed.room) as f32,
                };
                let reliefs = vec![relief(WildMap::ALL[turn % 5]), relief(WildMap::ALL[(turn + 1) % 5])];
                let mut mesh = placed.mesh;
                mesh.triangles.iter_mut().step_by(2).for_each(|triangle| triangle.displacement = 1);
                let normals = [Normals::Normalized, Normals::Linear][turn % 2];
                let wrap = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror][turn % 3];
                let settings = Settings { normals, wrap, width: 1, height: 1, ..Settings::default() };
                let scene = Scene { mesh, reliefs, color_map: None, subdivisions: n };
                let what = format!("{name}, scale {scale}, offset {offset}, N = {n}");
                scenes.push((what, job(scene, &settings), placed.inside));
            }
        }
    }
    scenes
}

/// Traces `rays` rays in all, so many at a time, and asserts that none of them leaks.
#[expect(clippy::print_stdout, reason = "the long mode takes hours and says how far it is")]
fn assert_closed(
    backend: &mut VulkanBackend,
    scenes: &[(String, ReadyJob, Vec<Vec3>)],
    rays: usize,
    batch: usize,
) {
    let each = rays.div_ceil(scenes.len());
    let (start, mut done) = (Instant::now(), 0);
    for (i, (what, job, inside)) in scenes.iter().enumerate() {
        backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
        let source = LeakRays::new(job, inside, i as u64);
        for first in (0..each).step_by(batch) {
            let rays = source.rays(first as u64, batch.min(each - first));
            let hits = backend.trace_rays(&rays).expect("the device traces");
            for (ray, hit) in rays.iter().zip(hits) {
                assert!(hit.primitive != MISS, "{what}: {ray:?} leaks");
            }
            done += rays.len();
        }
        println!("{done} rays, {:.0} s: none leaks, {what}", start.elapsed().as_secs_f64());
    }
}

#[test]
#[expect(clippy::print_stdout, reason = "the long mode says which device it runs on")]
fn closed_meshes_are_closed_on_a_device() {
    if env::var_os("EMBOSS_LONG").is_none() {
        let mut backend = lavapipe();
        // Some of each, since a device takes seconds to make its pipelines for a scene. Not those that take most work:
        // lavapipe leaves all loops of eight rays after 65535 iterations together (LP_MAX_TGSI_LOOP_ITERATIONS), and what
        // they would have found then is missed.
        let is_light = |job: &ReadyJob| job.frame.subdivisions < 64;
        let some: Vec<_> = scenes().into_iter().filter(|(_, job, _)| is_light(job)).step_by(7).collect();
        assert_closed(&mut backend, &some, 100_000, 1 << 16);
        finish(backend);
        return;
    }
    let selection = env::var("EMBOSS_DEVICE").map_or(Selection::Auto, Selection::Named);
    let mut backend = VulkanBackend::new(&selection, false).expect("the long mode needs a Vulkan device");
    println!("{}", backend.device().name);
    assert_closed(&mut backend, &scenes(), 1_000_000_000, 1 << 20);
}
