//! The exact method on the CPU against the oracle: every one of many rays finds the micro-triangle that exact arithmetic
//! finds, or one that is as near to within the stated errors.
//!
//! With `EMBOSS_LONG=1` in the environment each case has 10^8 rays.

use emboss::backend::cpu::CpuBackend;
use emboss::render::{Job, Scene};
use emboss::settings::{Normals, Settings, Weld, Wrap};
use emboss_kernels::interface::{height_format, method};
use emboss_tests::exact::{Tallies, judge_rays, patchwork};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes;

/// The numbers of subdivisions of the grid cases: one, odd ones, powers of two, and one above.
const SUBDIVISIONS: [u32; 5] = [1, 3, 8, 17, 64];
/// Directions of both kinds.
const NORMALS: [Normals; 2] = [Normals::Normalized, Normals::Linear];

/// So many rays, or 10^8 in the long mode.
fn rays(count: usize) -> usize {
    if std::env::var("EMBOSS_LONG").is_ok_and(|long| long == "1") { 100_000_000 } else { count }
}

fn judged(job: &Job, seed: u64, count: usize) -> Tallies {
    let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
    let t = std::time::Instant::now();
    let x = judge_rays(job, &oracle, &mut CpuBackend::new(), method::QUADTREE, seed, count);
    println!("{} rays {:?} {:?} {:?}", job.frame.subdivisions, t.elapsed(), x, job.features);
    x
}

/// A built-in scene at every N.
fn judge_builtin(name: &str, count: usize) {
    for (n, seed) in SUBDIVISIONS.into_iter().zip(1..) {
        let scene = Scene { subdivisions: n, ..scenes::builtin(name) };
        let job = scenes::ready(scene, Wrap::Repeat);
        judged(&job, seed, rays(count));
    }
}

#[test]
fn cube_is_exact() {
    judge_builtin("builtin:cube", 100_000);
}

#[test]
fn quilt_is_exact() {
    judge_builtin("builtin:quilt", 100_000);
}

#[test]
fn knot_is_exact() {
    judge_builtin("builtin:knot", 100_000);
}

/// Both kinds of direction, welded and not, on a scene that splits everything, and all wraps.
#[test]
fn patchwork_is_exact() {
    let formats = [
        [height_format::UNORM8, height_format::UNORM8],
        [height_format::UNORM16, height_format::FLOAT32],
        [height_format::UNORM16, height_format::UNORM16],
    ];
    for (i, wrap) in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror].into_iter().enumerate() {
        for normals in NORMALS {
            for weld in [Weld::On, Weld::Off] {
                for n in [1, 6, 17] {
                    let settings =
                        Settings { wrap, normals, weld, width: 1, height: 1, ..Settings::default() };
                    let job = scenes::job(patchwork(i as u64, formats[i], n), &settings);
                    assert_eq!(job.features.seams, u32::from(weld == Weld::On));
                    judged(&job, u64::from(n), rays(20_000));
                }
            }
        }
    }
}

#[test]
fn linear_normals_are_exact() {
    for name in ["builtin:knot", "builtin:cube"] {
        for n in [1, 6, 17] {
            let settings = Settings { normals: Normals::Linear, width: 1, height: 1, ..Settings::default() };
            let job = scenes::job(Scene { subdivisions: n, ..scenes::builtin(name) }, &settings);
            judged(&job, u64::from(n), rays(20_000));
        }
    }
}
