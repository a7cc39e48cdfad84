//! What is asked of stored bounds on every backend: that they do not show.

use crate::scenes::{self, VECTORS, with_vectors};
use crate::{Numbers, RaySource};
use bytemuck::bytes_of;
use emboss::backend::Backend;
use emboss::render::Scene;
use emboss::settings::{DisplacementKind, Normals, Settings};
use emboss_kernels::interface::{MISS, bounds};
use emboss_kernels::scene::Features;

/// Asserts that rays of all kinds find the same, bit for bit, whatever is stored of the bounds: on scenes of heights
/// and of vectors, with seams and without, in both directions of displacement, at N of every remainder.
///
/// # Panics
/// With the first ray that finds something else.
pub fn assert_stored_bounds_do_not_show(backend: &mut dyn Backend, ns: &[u32], of_each_kind: usize) {
    let mut numbers = Numbers::new(41);
    let mut hits = 0;
    let mut rays_in_all = 0;
    for (turn, &n) in ns.iter().enumerate() {
        for (i, name) in ["builtin:cube", "builtin:quilt", "tiles", "builtin:cube"].into_iter().enumerate() {
            let plain = if name == "tiles" { scenes::tiles() } else { scenes::builtin(name) };
            let plain = Scene { subdivisions: n, ..plain };
            let vectors = i == 3;
            let displacement = if vectors { VECTORS[turn % 2] } else { DisplacementKind::Height };
            let scene = if vectors { with_vectors(plain, &mut numbers) } else { plain };
            let normals = [Normals::Normalized, Normals::Linear][(turn + i) % 2];
            let settings = Settings { displacement, normals, width: 1, height: 1, ..Settings::default() };
            let job = scenes::job(scene, &settings);
            let rays = RaySource::new(&job, 3).of_each_kind(of_each_kind);
            let mut traced = |stored| {
                let features = Features { bounds: stored, ..job.features };
                backend.load(&job.buffers, &job.frame, features).expect("a small scene fits");
                backend.trace_rays(&rays).expect("no device fails")
            };
            let expected = traced(bounds::NONE);
            for stored in [bounds::BOXES, bounds::ALL] {
                for ((ray, expected), found) in rays.iter().zip(&expected).zip(traced(stored)) {
                    assert_eq!(
                        bytes_of(expected),
                        bytes_of(&found),
                        "{name}, N = {n}, {settings:?}, stored {stored}: {ray:?}\n{expected:?}\n{found:?}"
                    );
                }
            }
            hits += expected.iter().filter(|hit| hit.primitive != MISS).count();
            rays_in_all += rays.len();
        }
    }
    assert!(3 * hits > rays_in_all, "{hits} hits of {rays_in_all} rays are no test");
}
