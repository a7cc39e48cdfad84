//! A closed mesh stays closed on a Vulkan device: the rays of `leak.rs`, on lavapipe.
//!
//! In the [long mode](emboss_tests::long) it is 10^9 rays in 88 cases, on a hardware device: every solid at every place
//! for every N (0 to 79), then the extremes, 10^5 extents from the origin and N = 4096 (80 to 87). Cases share the rays
//! evenly, but for the dear ones: N = 1000 a hundred extents from the origin, where bounds are as wide as tens of
//! micro-triangles and a ray is tested against ten times as many, and the extremes. These have a tenth of the
//! others' share.

use emboss::backend::Backend;
use emboss::backend::vulkan::VulkanBackend;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{Normals, Settings, Wrap};
use emboss_kernels::interface::MISS;
use emboss_tests::long::{self, Cases};
use emboss_tests::meshes::{self, Solid};
use emboss_tests::scenes::{ReadyJob, WildMap, job};
use emboss_tests::{LeakRays, Numbers};
use glam::Vec3;

/// Scale, and distance from the origin in extents.
const PLACES: [(f64, f64); 4] = [(1.0, 0.0), (1e-6, 1e2), (1e6, 1.0), (1.0, 1e2)];
const SUBDIVISIONS: [u32; 5] = [1, 3, 7, 64, 1000];

/// Where nothing but the long mode has been: scale, distance from the origin in extents, and N.
const EXTREMES: [(f64, f64, u32); 4] = [(1.0, 0.0, 4096), (1.0, 1e5, 1), (1e-6, 1e5, 7), (1e6, 1e5, 3)];

/// A scene, and what rays it is due.
struct LeakScene {
    what: String,
    job: ReadyJob,
    /// Where rays start.
    inside: Vec<Vec3>,
    /// Its share of the rays, in tenths of most others'.
    share: usize,
}

/// A solid at a place, under two maps on triangles in turns; which ones, and the rest of the settings, go round with
/// `turn`.
fn scene(turn: usize, (name, solid): &(&str, Solid), (scale, offset): (f64, f64), n: u32) -> LeakScene {
    let placed = solid.placed(scale, offset);
    // No higher than half the way from rays' origins to the base mesh, and much lower where there are many
    // micro-triangles.
    let height = if n < 1000 { 0.5 } else { 0.02 };
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let scale = (height * placed.room) as f32;
    let relief = |map: WildMap| Relief::new(map.map(&mut Numbers::new(turn as u64)), 0.0, scale);
    let reliefs = vec![relief(WildMap::ALL[turn % 5]), relief(WildMap::ALL[(turn + 1) % 5])];
    let mut mesh = placed.mesh;
    mesh.triangles.iter_mut().step_by(2).for_each(|triangle| triangle.displacement = 1);
    let normals = [Normals::Normalized, Normals::Linear][turn % 2];
    let wrap = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror][turn % 3];
    let settings = Settings { normals, wrap, width: 1, height: 1, ..Settings::default() };
    let scene = Scene { mesh, reliefs, materials: vec![Material::default()], parts: vec![], subdivisions: n };
    let what = format!("{name}, scale {scale}, offset {offset}, N = {n}");
    let dear = offset > 1e4 || n > 1000 || offset > 1.0 && n == 1000;
    let share = if dear { 1 } else { 10 };
    LeakScene { what, job: job(scene, &settings), inside: placed.inside, share }
}

/// Every solid at every place for every N, then two of them at the extremes.
fn scenes() -> Vec<LeakScene> {
    let solids: [(&str, Solid); 4] = [
        ("sphere", meshes::icosphere(2)),
        ("cube", meshes::cube()),
        ("knot", meshes::knot()),
        ("solid of genus three", meshes::genus_three(1)),
    ];
    let mut scenes = Vec::new();
    for solid in &solids {
        for place in PLACES {
            for n in SUBDIVISIONS {
                scenes.push(scene(scenes.len(), solid, place, n));
            }
        }
    }
    for solid in &solids[..2] {
        for (scale, offset, n) in EXTREMES {
            scenes.push(scene(scenes.len(), solid, (scale, offset), n));
        }
    }
    scenes
}

/// Traces at least `rays` rays in all, so many at a time, and asserts that none of them leaks.
fn assert_closed(backend: &mut VulkanBackend, scenes: &[LeakScene], rays: usize, batch: usize) {
    let shares: usize = scenes.iter().map(|scene| scene.share).sum();
    let mut cases = Cases::new();
    for (i, LeakScene { what, job, inside, share }) in scenes.iter().enumerate() {
        cases.run(what, || {
            let count = (rays * share).div_ceil(shares);
            backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
            let source = LeakRays::new(job, inside, i as u64);
            for first in (0..count).step_by(batch) {
                let rays = source.rays(first as u64, batch.min(count - first));
                let hits = backend.trace_rays(&rays).expect("the device traces");
                for (ray, hit) in rays.iter().zip(hits) {
                    assert!(hit.primitive != MISS, "{what}: {ray:?} leaks");
                }
            }
            format!("{count} rays, none leaks")
        });
    }
    cases.finish();
}

#[test]
fn closed_meshes_are_closed_on_a_device() {
    let mut scenes = scenes();
    if !long::is_long() {
        // Some of each, since a device takes seconds to make its pipelines for a scene. Not those that take most work:
        // lavapipe leaves all loops of eight rays after 65535 iterations together (LP_MAX_TGSI_LOOP_ITERATIONS), and
        // what they would have found then is missed.
        scenes.retain(|scene| scene.job.frame.subdivisions < 64 && scene.share > 1);
        scenes = scenes.into_iter().step_by(7).collect();
    }
    let batch = if long::is_long() { 1 << 20 } else { 1 << 16 };
    long::on_device(|backend| {
        assert_closed(backend, &scenes, long::rays(100_000, 1_000_000_000), batch);
    });
}
