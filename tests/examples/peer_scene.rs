//! Writes what `cargo xtask peers` gives to another ray tracer: the micro-triangles of a built-in scene, the rays of a
//! picture and what Emboss's exact method finds along them.
//!
//! `peer_scene SCENE N WxH FOLDER` writes raw little-endian files: `positions.f32` (three a vertex), `faces.u32` (three
//! a micro-triangle), `rays.f32` (origin and unit direction of a ray through each pixel's centre, row by row from the
//! top), and `hits.f32` (the distance of each ray's nearest hit, infinite where there is none). N = 0: the base mesh.
#![allow(clippy::print_stderr, reason = "a program of its own")]

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::settings::{Bounds, Method, Settings};
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::displacement::tessellate::{vertex_place, vertices_of};
use emboss_kernels::interface::{Ray, bounds, method};
use emboss_kernels::scene::Features;
use emboss_tests::scenes::{ReadyJob, builtin_scene, job};
use glam::{Vec2, Vec3};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    match run(&std::env::args().skip(1).collect::<Vec<_>>()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [scene, n, size, folder] = arguments else {
        return Err("usage: peer_scene SCENE N WxH FOLDER".into());
    };
    let (width, height) = size.split_once('x').ok_or("the size has no x between width and height")?;
    let (n, width, height): (u32, u32, u32) = (n.parse()?, width.parse()?, height.parse()?);
    let (scene, settings) = builtin_scene(&format!("builtin:{scene}"), n.max(1), width, height);
    let method = if n == 0 { Method::None } else { Method::Quadtree };
    let job = job(scene, &Settings { method, bounds: Bounds::Mib(256), shadows: false, ..settings });
    let (positions, faces) = if n == 0 { base_mesh(&job) } else { micro_triangles(&job) };
    let rays = rays(&job);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features)?;
    let hits: Vec<f32> = backend.trace_rays(&rays)?.iter().map(|hit| hit.t).collect();
    let rays: Vec<Vec3> = rays.iter().flat_map(|ray| [ray.origin, ray.direction]).collect();
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("positions.f32"), bytemuck::cast_slice(&positions))?;
    std::fs::write(folder.join("faces.u32"), bytemuck::cast_slice(&faces))?;
    std::fs::write(folder.join("rays.f32"), bytemuck::cast_slice(&rays))?;
    std::fs::write(folder.join("hits.f32"), bytemuck::cast_slice(&hits))?;
    Ok(())
}

/// The positions and corners of the base triangles.
fn base_mesh(job: &ReadyJob) -> (Vec<Vec3>, Vec<u32>) {
    let buffers = &job.buffers;
    let positions = buffers.vertices.iter().map(|vertex| vertex.position).collect();
    (positions, buffers.triangles.iter().flat_map(|triangle| triangle.vertices).collect())
}

/// The positions and corners of all micro-triangles, as vertex displacement stores them.
fn micro_triangles(job: &ReadyJob) -> (Vec<Vec3>, Vec<u32>) {
    let features = Features { method: method::TESSELLATE, bounds: bounds::NONE, ..job.features };
    let stored = job.with_features(features);
    let (view, n) = (stored.view(), job.frame.subdivisions);
    let vertices = view.frame.triangle_count * vertices_of(n);
    let positions =
        view.micro_vertices.chunks_exact(3).take(vertices as usize).map(Vec3::from_slice).collect();
    let mut faces = Vec::new();
    for triangle in 0..view.frame.triangle_count {
        for j in 0..n {
            for (k, upper) in (0..n - j).flat_map(|k| [(k, false), (k, true)]) {
                if j + k + u32::from(upper) < n {
                    let cell = Cell { j, k, upper };
                    faces.extend([0, 1, 2].map(|corner| {
                        let (j, k) = cell.vertex(corner);
                        triangle * vertices_of(n) + vertex_place(n, j, k)
                    }));
                }
            }
        }
    }
    (positions, faces)
}

/// A ray through the centre of each pixel.
fn rays(job: &ReadyJob) -> Vec<Ray> {
    let frame = &job.frame;
    let pixels = (0..frame.height).flat_map(|y| (0..frame.width).map(move |x| (x, y)));
    let ray = |(x, y): (u32, u32)| {
        let film = Vec2::new((x as f32 + 0.5) / frame.width as f32, (y as f32 + 0.5) / frame.height as f32);
        let direction = frame.camera.ray_direction(film);
        Ray { origin: frame.camera.eye, t_max: f32::INFINITY, direction, padding: 0 }
    };
    pixels.map(ray).collect()
}
