//! No surface shadows its own plane on a Vulkan device, and no light enters a closed room: what `adversarial.rs` asks
//! of the CPU.
//!
//! In the [long mode](emboss_tests::long) it is 10^8 shadow rays on a hardware device, half of them from planes.

use emboss::backend::Backend;
use emboss::backend::vulkan::VulkanBackend;
use emboss::settings::Method;
use emboss_kernels::interface::MISS;
use emboss_tests::RaySource;
use emboss_tests::long::{self, Cases};
use emboss_tests::meshes;
use emboss_tests::planes::{self, Pair, Plane, Planes, Tally, assert_dark, assert_unshadowed, level};
use emboss_tests::scenes::WildMap;

const SCALES: [f64; 3] = [1e-6, 1.0, 1e6];
/// Distances from the origin, in extents.
const OFFSETS: [f64; 4] = [0.0, 1.0, 1e2, 1e5];

/// Planes, with what lies in them and by which method: all of them in the long mode, else some of each.
fn cases() -> Vec<(Planes, Method, u32)> {
    let mut cases = Vec::new();
    for pair in Pair::ALL {
        for plane in Plane::ALL {
            for method in planes::methods() {
                if pair.is_of_instances() && method.is_stored() {
                    continue;
                }
                let turn = cases.len();
                let (scale, offset) = (SCALES[turn % 3], OFFSETS[turn / 3 % 4]);
                cases.push((Planes { plane, pair, scale, offset }, method, [1, 7][turn / 12 % 2]));
            }
        }
    }
    if !long::is_long() {
        // Every pair and every plane; pipelines take a device most of the time.
        cases = cases.into_iter().step_by(59).collect();
    }
    cases
}

fn planes_are_unshadowed(backend: &mut VulkanBackend) {
    let cases = cases();
    let (size, samples) = if long::is_long() { ((320, 240), 4) } else { ((24, 18), 1) };
    let mut runs = Cases::new();
    for (planes, method, subdivisions) in cases {
        runs.run(format!("{planes:?} by {method}"), || {
            let mut tally = Tally::default();
            assert_unshadowed(backend, &planes, method, subdivisions, size, samples, &mut tally);
            assert!(tally.shadow_rays > 0, "{planes:?}");
            format!("{} shadow rays, none hits", tally.shadow_rays)
        });
    }
    // As on the CPU: squares so far from the kernels' origin that they are sixty steps of a float wide.
    for method in [Method::Inverse, Method::Quadtree] {
        let planes = Planes { plane: Plane::Tilted, pair: Pair::InstanceAndModel, scale: 1e6, offset: 1e5 };
        runs.run(format!("{planes:?} by {method}"), || {
            let mut tally = Tally::default();
            assert_unshadowed(backend, &planes, method, 1, (64, 48), 1, &mut tally);
            format!("{} shadow rays, none hits", tally.shadow_rays)
        });
    }
    runs.finish();
}

#[test]
fn planes_cast_no_shadow_on_themselves_on_a_device() {
    long::on_device(planes_are_unshadowed);
}

#[test]
fn closed_rooms_are_dark_on_a_device() {
    let solids = [
        ("cube", meshes::cube()),
        ("sphere", meshes::icosphere(2)),
        ("knot", meshes::knot()),
        ("solid of genus three", meshes::genus_three(1)),
    ];
    let reliefs = [(WildMap::Single, 0.0), (WildMap::Noise, 0.3), (WildMap::Spikes, 0.5)];
    long::on_device(|backend| {
        let (size, samples) = if long::is_long() { ((512, 512), 4) } else { ((24, 24), 1) };
        let mut runs = Cases::new();
        let mut turn = 0;
        for (name, solid) in &solids {
            for relief in reliefs {
                for subdivisions in [1, 6] {
                    // As on the CPU: not beyond where crevices are wider than rounding.
                    let most = if relief.1 > 0.0 { 1.0 } else { 1e2 };
                    let (scale, offset) = (SCALES[turn % 3], OFFSETS[turn % 4].min(most));
                    turn += 1;
                    if !long::is_long() && turn % 8 != 1 {
                        continue;
                    }
                    let what = format!("{name}, scale {scale}, {offset} extents away");
                    runs.run(&what, || {
                        let (placed, mut tally) = (solid.placed(scale, offset), Tally::default());
                        let room = (what.as_str(), &placed);
                        assert_dark(backend, room, relief, subdivisions, size, samples, &mut tally);
                        format!("{} shadow rays, none leaks", tally.shadow_rays)
                    });
                }
            }
        }
        runs.finish();
    });
}

/// As on the CPU: of faces with the same corners the first is seen.
#[test]
fn first_of_coincident_faces_is_seen_on_a_device() {
    long::on_device(|backend| {
        let pairs = Pair::ALL.into_iter().filter(|pair| pair.has_the_same_corners());
        for (turn, pair) in pairs.enumerate() {
            let planes = Planes { plane: Plane::ALL[turn % 4], pair, scale: 1.0, offset: 1.0 };
            let job = planes.job(Method::Quadtree, level(), 5, (1, 1), true);
            let mut source = RaySource::new(&job, 5);
            let rays: Vec<_> = (0..500).map(|_| source.from_outside()).collect();
            backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
            let hits = backend.trace_rays(&rays).expect("the device traces");
            assert!(hits.iter().filter(|hit| hit.primitive != MISS).count() > 50);
            let first = |primitive, instance| primitive == MISS || (primitive < 2 && instance == 0);
            assert!(hits.iter().all(|hit| first(hit.primitive, hit.instance)), "{pair:?}");
        }
    });
}
