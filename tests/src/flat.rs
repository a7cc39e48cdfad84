//! What all methods show of a map that displaces nothing: the base mesh.

use crate::RaySource;
use crate::scenes::{self, builtin_scene};
use emboss::backend::Backend;
use emboss::compare::usual_methods;
use emboss::scene::{HeightMap, Relief};
use emboss::settings::{Method, Settings};
use emboss_kernels::interface::MISS;

/// Traces `count` rays from outside by each method.
///
/// # Panics
/// Where a method in image space finds anything else than `none`, to the bit; where hits of another one, or of one
/// that reads distances, are off by more than rounding, or are not there.
pub fn assert_all_methods_show_the_base_mesh(backend: &mut dyn Backend, count: usize) {
    let (mut scene, settings) = builtin_scene("builtin:cube", 4, 1, 1);
    // Texels are neither 0 nor what zero usually is.
    scene.reliefs = vec![Relief::new(HeightMap { width: 1, ..HeightMap::flat(0.25) }, 0.25, 0.3)];
    let by = |method| scenes::job(scene.clone(), &Settings { method, ..settings.clone() });
    let flat = by(Method::None);
    let mut source = RaySource::new(&flat, 3);
    let rays: Vec<_> = (0..count).map(|_| source.from_outside()).collect();
    let mut traced = |method| {
        let job = by(method);
        backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
        backend.trace_rays(&rays).expect("no device fails")
    };
    let expected = traced(Method::None);
    assert!(2 * expected.iter().filter(|hit| hit.primitive != MISS).count() > count);
    let extent = f64::from(flat.bounds().min.abs().max(flat.bounds().max.abs()).max_element());
    let mut methods = usual_methods();
    methods.push(Method::BruteForce);
    for method in methods {
        for ((ray, expected), found) in rays.iter().zip(&expected).zip(traced(method)) {
            // Distances end within the range of heights, which rounding leaves some 1e-8 wide.
            if method.is_image_space() && method != Method::Sphere {
                assert_eq!(*expected, found, "{method}: {ray:?}");
            } else if expected.primitive == MISS {
                assert_eq!(found.primitive, MISS, "{method}: {ray:?}");
            } else {
                let (d, n) = (ray.direction.as_dvec3(), expected.normal.as_dvec3());
                let length = d.length() * f64::from(expected.t);
                // Each of the two distances is off by 12 u of itself, and corners by some 12 u of their coordinates,
                // as seen along the ray; solutions of inverse mapping by no more. Twice that, for rays that come from
                // elsewhere.
                let bound = 2.0 * 2.0 * 12.0 * 6e-8 * (length + extent);
                let off = f64::from(found.t - expected.t).abs() * d.dot(n).abs();
                assert!(off < bound, "{method}: {off} of {bound}, {ray:?}\n{expected:?}\n{found:?}");
                // Corners that are 1/4 of the cube's side apart, off by as much.
                let turned = expected.normal.distance(found.normal);
                assert!(turned < 1e-5, "{method}: {turned}, {ray:?}\n{expected:?}\n{found:?}");
            }
        }
    }
}
