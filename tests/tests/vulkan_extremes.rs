//! Zero, denormal and enormous numbers on a device: lavapipe, which keeps denormal numbers, and in the
//! [long mode](emboss_tests::long) whatever is there, such as a card that takes them for 0. Both must do.

use emboss::backend::Backend;
use emboss::backend::vulkan::VulkanBackend;
use emboss::render::Scene;
use emboss::settings::Settings;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::interface::{Intersection, MISS, Ray, height_format, method};
use emboss_kernels::math::{UNIT_ROUNDOFF, next_down, next_up};
use emboss_kernels::probe;
use emboss_kernels::scene::Features;
use emboss_tests::long::{on_device, rays};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{job, random_solid};
use emboss_tests::{HardRays, Hardship, Numbers};
use glam::{DVec3, Vec3};

const U: f64 = UNIT_ROUNDOFF as f64;
const IN: usize = probe::IN_STRIDE as usize;
const OUT: usize = probe::OUT_STRIDE as usize;

/// The outputs of a kernel for items of so many floats.
fn probed<const N: usize>(backend: &mut VulkanBackend, kernel: u32, items: &[[f32; N]]) -> Vec<[u32; OUT]> {
    let mut words = vec![0; items.len() * IN];
    for (padded, item) in words.chunks_exact_mut(IN).zip(items) {
        padded[..N].copy_from_slice(&item.map(f32::to_bits));
    }
    let outputs = backend.probe(kernel, &words, u32::try_from(items.len()).unwrap()).unwrap();
    outputs.chunks_exact(OUT).map(|output| output.try_into().unwrap()).collect()
}

fn wide_vec3(words: &[u32]) -> DVec3 {
    DVec3::new(wide(words[0]), wide(words[1]), wide(words[2]))
}

fn wide(word: u32) -> f64 {
    f32::from_bits(word).into()
}

/// Directions of all lengths that floats hold, among them such with components of every other size.
fn directions(numbers: &mut Numbers) -> Vec<Vec3> {
    let mut directions =
        vec![Vec3::new(f32::MAX, -f32::MAX, 1e-45), Vec3::splat(1e-45), Vec3::new(0.0, -1e-40, 0.0)];
    for exponent in -149_i16..=127 {
        for _ in 0..20 {
            let mut v = numbers.in_cube() * f32::from(exponent).exp2();
            v[numbers.below(3) as usize] *= numbers.wide().abs().min(1.0);
            if v != Vec3::ZERO {
                directions.push(v);
            }
        }
    }
    directions
}

/// As a unit vector a component takes a quotient or a product with a reciprocal (5 u, 1 u) by the length: half of a dot
/// product's 3 u and a root's 9 u. Below 20 u.
#[test]
fn directions_of_any_length_are_unit_vectors() {
    on_device(|backend| {
        let mut numbers = Numbers::new(31);
        let directions = directions(&mut numbers);
        let items: Vec<[f32; 4]> = directions.iter().map(|v| [v.x, v.y, v.z, 2.0]).collect();
        let by_ray = probed(backend, probe::DIRECTION, &items);
        let by_unit = probed(backend, probe::UNIT, &items);
        for (v, (ray, unit)) in directions.iter().zip(by_ray.iter().zip(&by_unit)) {
            let exact = v.as_dvec3().normalize();
            for found in [wide_vec3(ray), wide_vec3(unit)] {
                // Not by the greatest component, which of NaN and numbers is a number.
                let is_near = (found - exact).abs().cmple(DVec3::splat(20.0 * U)).all();
                assert!(is_near, "{v:?}: {found} is not {exact}");
            }
            let distance = 2.0 * v.as_dvec3().length();
            if distance > f64::from(f32::MIN_POSITIVE) && distance < f64::from(f32::MAX) {
                assert!((wide(ray[3]) - distance).abs() <= 20.0 * U * distance, "{v:?}: {}", wide(ray[3]));
                // There and back: a product and a quotient.
                assert!((wide(ray[4]) - 2.0).abs() <= 16.0 * U, "{v:?}: {}", wide(ray[4]));
            }
        }
    });
}

#[test]
fn neighbours_are_the_same_to_the_bit() {
    on_device(|backend| {
        let mut numbers = Numbers::new(32);
        let of_zero = [0.0, -0.0, 1e-45, -1e-45, 1e-39, -1e-39, f32::MIN_POSITIVE, -f32::MIN_POSITIVE];
        let items: Vec<[f32; 4]> = of_zero
            .into_iter()
            .chain((0..1000).map(|_| numbers.wide()))
            .map(|x| [x, 1.0, 1.0, 1.0])
            .collect();
        for ([x, ..], output) in items.iter().zip(probed(backend, probe::DIRECTION, &items)) {
            let expected = [next_up(*x), next_down(*x)].map(f32::to_bits);
            assert_eq!(output[5..7], expected, "{x:e}");
        }
    });
}

#[test]
fn nan_is_told_before_arithmetic() {
    on_device(|backend| {
        let items =
            [f32::NAN, -f32::NAN, 0.5, -1.0, f32::INFINITY, f32::NEG_INFINITY].map(|x| [x, 0.25, 0.75]);
        let outputs = probed(backend, probe::NAN, &items);
        let clamped = |output: &[u32; OUT]| [output[4], output[5]].map(f32::from_bits);
        let expected = [[0.25, 0.0], [0.25, 0.0], [0.5, 0.5], [0.25, 0.0], [0.75, 1.0], [0.25, 0.0]];
        assert_eq!(outputs.iter().map(clamped).collect::<Vec<_>>(), expected);
        // Coordinates that are NaN are in the first cell, and not beyond the grid.
        let words = [f32::NAN, f32::INFINITY].map(f32::to_bits);
        let mut items = vec![0; IN];
        items[..3].copy_from_slice(&[words[0], words[1], 7]);
        let cell = Cell::unpack(backend.probe(probe::CELL, &items, 1).unwrap()[0]);
        assert_eq!((cell.j, cell.k, cell.upper), (0, 6, false));
    });
}

/// Rays of zero and denormal components, and such of all lengths: the quadtree and brute force find the same to the
/// bit, and the oracle accepts it.
#[test]
fn rays_of_extreme_directions_hit_what_is_there() {
    on_device(|backend| {
        let count = rays(400, 20_000);
        let (mut all, mut hits) = (0, 0);
        // Directions have six lengths in turn.
        let mut by_length = [0_usize; 6];
        let formats =
            [height_format::UNORM8, height_format::UNORM16, height_format::FLOAT32, height_format::UNORM8];
        for (seed, (format, subdivisions)) in (0..).zip(formats.into_iter().zip([1, 3, 8, 5])) {
            let mut numbers = Numbers::new(seed);
            let scene = Scene { subdivisions, ..random_solid(&mut numbers, format, 0.3) };
            let job = job(scene, &Settings { width: 1, height: 1, ..Settings::default() });
            let mut source = HardRays::new(&job, seed);
            let lengths = [1.0, f32::from_bits(1 << 22), 1e-38, 1e-30, 1e19, 1e38];
            let batch: Vec<Ray> = (0..count)
                .map(|i| {
                    let hardship = Hardship::ALL[if i % 2 == 0 { 9 } else { i / 2 % 10 }];
                    let ray = source.ray(hardship);
                    // The oracle is asked about the direction that is left, too.
                    let direction =
                        ray.direction / ray.direction.abs().max_element() * lengths[i % lengths.len()];
                    Ray { direction, ..ray }
                })
                .collect();
            let by = |backend: &mut VulkanBackend, method| {
                backend.load(&job.buffers, &job.frame, Features { method, ..job.features }).unwrap();
                backend.trace_rays(&batch).unwrap()
            };
            let exact = by(backend, method::BRUTE_FORCE);
            let found = by(backend, method::QUADTREE);
            let oracle = Oracle::of_vulkan(&job.buffers, &job.frame, job.features);
            let bits = |hit: &Intersection| {
                if hit.primitive == MISS {
                    [MISS; 5]
                } else {
                    [hit.primitive, hit.cell, hit.t.to_bits(), hit.b1.to_bits(), hit.b2.to_bits()]
                }
            };
            for (i, hit) in found.iter().enumerate() {
                by_length[i % 6] += usize::from(hit.primitive != MISS);
            }
            for ((ray, exact), found) in batch.iter().zip(&exact).zip(&found) {
                assert_eq!(bits(exact), bits(found), "seed {seed}: {ray:?}");
                all += 1;
                hits += usize::from(found.primitive != MISS);
                // In lengths of the least directions distances are no floats.
                if (1e-20..1e20).contains(&ray.direction.length()) {
                    let judged = oracle.trace(ray).judge(found);
                    assert!(judged.is_ok(), "seed {seed}: {judged:?} {ray:?} {found:?}");
                }
            }
        }
        assert!(5 * hits > all, "{hits} hits of {all} rays");
        assert!(by_length.iter().all(|&hits| 16 * hits > all), "{by_length:?} of {all}");
    });
}
