//! The exact method on the CPU against the oracle: every one of many rays hits the micro-triangle that exact arithmetic
//! finds, or one that rounding cannot tell from it, within the stated errors.
//!
//! In the [long mode](emboss_tests::long) the built-in scenes have 10^8 rays a case, the others 10^7.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::Wrap;
use emboss_kernels::interface::{Ray, Vertex, height_format, method};
use emboss_kernels::scene::Features;
use emboss_tests::exact::{Court, refused};
use emboss_tests::long::rays;
use emboss_tests::oracle::{Disagreement, Oracle};
use emboss_tests::{RaySource, scenes};
use glam::Vec3;

fn court(backend: &mut CpuBackend) -> Court<'_> {
    Court::new(backend, Oracle::new)
}

/// Rays of a grid case: 10^6 with `EMBOSS_RAYS=1000000`, of which there is time for some otherwise.
fn grid_rays(_: u32) -> usize {
    rays(200_000, 100_000_000)
}

#[test]
fn cube_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:cube", grid_rays);
}

#[test]
fn quilt_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:quilt", grid_rays);
}

#[test]
fn knot_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:knot", grid_rays);
}

#[test]
fn linear_normals_are_exact() {
    court(&mut CpuBackend::new()).judge_linear_normals(rays(100_000, 10_000_000));
}

#[test]
fn patchwork_is_exact() {
    court(&mut CpuBackend::new()).judge_patchwork(rays(100_000, 10_000_000));
}

#[test]
fn filtered_maps_are_exact() {
    court(&mut CpuBackend::new()).judge_filtered(false, rays(20_000, 10_000_000));
}

/// What the grid walk gets wrong on the built-in scenes, by kind of ray: the first row of the accuracy table in
/// EXACTNESS.md, which this prints. The quadtree gets none of the same rays wrong.
///
/// The walk reports no hit that is not there: it misses one, or finds one behind it.
#[test]
#[expect(clippy::print_stdout, reason = "the table is what the test is run by hand for")]
fn grid_walk_is_as_wrong_as_is_said_of_it() {
    let of_each = rays(10_000, 50_000);
    type Make = fn(&mut RaySource<'_>) -> Ray;
    let kinds: [Make; 5] = [
        |source| source.from_outside(),
        |source| source.from_inside(),
        |source| source.grazing(),
        |source| source.towards_edge(3.0),
        |source| source.along_normal(),
    ];
    // Percent of each kind, as stated.
    let cases = [
        ("cube", 8, [0.03, 0.02, 0.16, 0.14, 28.6]),
        ("cube", 64, [0.03, 0.03, 0.26, 0.26, 8.8]),
        ("quilt", 17, [0.0, 0.0, 0.0, 0.01, 0.0]),
        ("quilt", 128, [0.0, 0.0, 0.0, 0.01, 0.0]),
        ("knot", 8, [0.08, 0.08, 0.06, 0.09, 21.0]),
        ("knot", 64, [0.0, 0.01, 0.0, 0.01, 26.3]),
    ];
    for (name, n, stated) in cases {
        let scene = scenes::builtin(&format!("builtin:{name}"));
        let job = scenes::ready(Scene { subdivisions: n, ..scene }, Wrap::Repeat);
        let oracle = Oracle::new(&job.buffers, &job.frame, job.features);
        let mut backend = CpuBackend::new();
        let mut source = RaySource::new(&job, 21);
        let mut row = format!("{name:<6} N = {n:<4}");
        for (make, stated) in kinds.into_iter().zip(stated) {
            let rays: Vec<Ray> = (0..of_each).map(|_| make(&mut source)).collect();
            let mut wrong = |method| {
                let features = Features { method, ..job.features };
                backend.load(&job.buffers, &job.frame, features).expect("a built-in scene fits");
                refused(&oracle, &rays, &backend.trace_rays(&rays).expect("the CPU does not fail"))
            };
            assert_eq!(wrong(method::QUADTREE), [], "{row}");
            let wrong = wrong(method::GRID_WALK);
            let behind = |why: &Disagreement| {
                matches!(why, Disagreement::Missed { .. } | Disagreement::NotNearest { .. })
            };
            assert!(wrong.iter().all(behind), "{wrong:?}");
            let percent = 100.0 * wrong.len() as f64 / of_each as f64;
            row += &format!(" {percent:>6.2} %");
            // Half to twice as many; of shares near 0, five of 10,000 rays more or fewer. Other rays stay within that,
            // a walk that is better or worse than stated does not.
            let close = 0.5 * stated - 0.05..=2.0 * stated + 0.05;
            assert!(close.contains(&percent), "{row}, stated are {stated} %");
        }
        println!("{row}");
    }
}

/// Texture coordinates of 0 and of -0 are one reading, not two of three.
#[test]
fn zeros_of_both_signs_are_the_same() {
    let corner = |x: f32, y: f32, z: f32, normal: Vec3, u: f32| Vertex {
        position: Vec3::new(x, y, z),
        normal: normal.normalize(),
        u,
        v: 0.5,
    };
    // A tent of three sides.
    let foot = [(1.0, 0.0), (-0.5, 0.8), (-0.5, -0.8)];
    let vertices: Vec<Vertex> = (0..3)
        .flat_map(|i| {
            let ((x0, y0), (x1, y1)) = (foot[i], foot[(i + 1) % 3]);
            let normal = Vec3::new(x0 + x1, y0 + y1, 1.0);
            let u = [0.0, -0.0, 0.5][i];
            [corner(0.0, 0.0, 1.0, normal, u), corner(x0, y0, 0.0, normal, u), corner(x1, y1, 0.0, normal, u)]
        })
        .collect();
    let mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    let texels = [0.0_f32, 0.0, 1.0, 1.0].map(f32::to_bits).to_vec();
    let format = height_format::FLOAT32;
    let map = HeightMap { width: 4, height: 1, format, texels, range: (0.0, 1.0), replaced: 0 };
    let reliefs = vec![Relief::new(map, 0.0, 0.3)];
    let scene = Scene { mesh, reliefs, materials: vec![Material::default()], parts: vec![], subdivisions: 2 };
    court(&mut CpuBackend::new()).judge_job("tent", &scenes::ready(scene, Wrap::Clamp), 1, 10_000);
}
