//! The exact method on the CPU against the oracle: every one of many rays hits the micro-triangle that exact arithmetic
//! finds, or one that rounding cannot tell from it, within the stated errors.
//!
//! With `EMBOSS_LONG=1` in the environment each case has 10^8 rays.

use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Mesh, Relief};
use emboss::settings::Wrap;
use emboss_kernels::interface::{Vertex, height_format};
use emboss_tests::exact::{Court, rays_a_case};
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes;
use glam::Vec3;

fn court(backend: &mut CpuBackend) -> Court<'_> {
    Court { backend, oracle: Oracle::new }
}

#[test]
fn cube_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:cube", rays_a_case(1_000_000));
}

#[test]
fn quilt_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:quilt", rays_a_case(1_000_000));
}

#[test]
fn knot_is_exact() {
    court(&mut CpuBackend::new()).judge_builtin("builtin:knot", rays_a_case(1_000_000));
}

#[test]
fn linear_normals_are_exact() {
    court(&mut CpuBackend::new()).judge_linear_normals(rays_a_case(100_000));
}

#[test]
fn patchwork_is_exact() {
    court(&mut CpuBackend::new()).judge_patchwork(rays_a_case(100_000));
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
    let reliefs = vec![Relief { map, zero: 0.0, scale: 0.3 }];
    let scene = Scene { mesh, reliefs, color_map: None, subdivisions: 2 };
    court(&mut CpuBackend::new()).judge_job(&scenes::ready(scene, Wrap::Clamp), 1, 10_000);
}
