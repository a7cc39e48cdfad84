//! Scenes whose triangles are cut as finely as they are near to a camera.

use crate::Numbers;
use crate::meshes::Placed;
use crate::scenes::{self, ReadyJob, WildMap};
use emboss::framing::View;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{DisplacementKind, Settings};
use emboss_kernels::displacement::subdivisions::{Subdivisions, Viewpoint};
use glam::Vec3;

/// The scene as it is seen from `eye` on a film of one pixel, of which parts of a triangle's side may be `pixels` long:
/// the pixel is
/// 0.63 wide at distance 1. N is at most `most`, a power of two.
pub fn seen(scene: Scene, eye: Vec3, pixels: f32, most: u32, settings: &Settings) -> ReadyJob {
    let view = View { eye: Some(eye.as_dvec3()), ..View::default() };
    let settings = Settings { adaptive: Some(pixels), view, width: 1, height: 1, ..settings.clone() };
    scenes::job(Scene { subdivisions: most, ..scene }, &settings)
}

/// How each of the job's triangles is cut.
pub fn cuts(job: &ReadyJob) -> impl Iterator<Item = Subdivisions> {
    cuts_from(job, job.frame.camera.eye)
}

/// The same were its camera elsewhere.
pub fn cuts_from(job: &ReadyJob, eye: Vec3) -> impl Iterator<Item = Subdivisions> {
    let viewpoint = Viewpoint { eye, ..Viewpoint::new(&job.frame) };
    let position = |v: u32| job.buffers.vertices[v as usize].position;
    job.buffers.triangles.iter().map(move |triangle| {
        let [a, b, c] = triangle.vertices.map(position);
        viewpoint.subdivisions(a, b, c)
    })
}

/// The most parts of a triangle that make one of its edges'.
pub fn greatest_step(job: &ReadyJob) -> u32 {
    cuts(job).flat_map(|cut| cut.steps).max().unwrap_or(1)
}

/// A placed solid under noise that displaces it by up to a tenth of its room, with a second map on every other triangle
/// where `second_map` says so.
pub fn rough(placed: &Placed, kind: DisplacementKind, second_map: bool, numbers: &mut Numbers) -> Scene {
    let components = if kind == DisplacementKind::Height { 1_u8 } else { 3 };
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let scale = (0.1 * placed.room / f64::from(components).sqrt()) as f32;
    let maps: &[WildMap] = if second_map { &[WildMap::Noise, WildMap::Odd] } else { &[WildMap::Noise] };
    let mut mesh = placed.mesh.clone();
    for (i, triangle) in mesh.triangles.iter_mut().enumerate() {
        triangle.displacement = if second_map && i % 2 == 1 { u32::from(components) } else { 0 };
    }
    let relief = |map: &WildMap| {
        (0..components).map(|_| Relief::new(map.map(numbers), 0.0, scale)).collect::<Vec<_>>()
    };
    let reliefs = maps.iter().flat_map(relief).collect();
    Scene { mesh, reliefs, materials: vec![Material::default()], parts: vec![], subdivisions: 1 }
}

/// An eye next to a vertex of the mesh, `away` times the size of its box from it: some triangles are near, most are
/// far.
pub fn near_a_vertex(placed: &Placed, away: f32, numbers: &mut Numbers) -> Vec3 {
    let vertices = &placed.mesh.vertices;
    let [low, high] = [Vec3::min, Vec3::max]
        .map(|fold| vertices.iter().map(|vertex| vertex.position).reduce(fold).unwrap_or_default());
    let one = numbers.below(u32::try_from(vertices.len()).expect("a small mesh"));
    vertices[one as usize].position + numbers.direction() * (away * (high - low).max_element())
}
