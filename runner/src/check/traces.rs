//! Rays on a small built-in scene: from within a closed mesh, against the CPU, and by two methods that share no more
//! than the surface and the triangle test.

use super::items::Numbers;
use super::{CheckError, Finding};
use crate::backend::Backend;
use crate::backend::cpu::CpuBackend;
use crate::render::{Job, Scene, load, prepare};
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::{Material, Mesh, Relief};
use crate::settings::Settings;
use emboss_kernels::interface::{Intersection, MISS, Ray, method};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::scene::Features;

/// A cube from -1 to 1 of split normals, all of whose edges are seams, displaced outwards by up to 0.2.
const SCENE: &str = "builtin:cube";
/// Parts of a side.
const N: u32 = 16;
/// Rays from within it, each of which must hit.
const INSIDE: usize = 20_000;
/// Rays from around it.
const AROUND: usize = 5_000;
/// Rays that brute force traces too.
const BY_BRUTE_FORCE: usize = 4_000;
/// By how much rounding can move a ray relative to the surface, here and on the CPU: each moves micro-vertices by 28 u
/// of their coordinates and height, which are at most 1.4, and vertices as seen along a ray by 10 u of the distance,
/// which is at most 8.
const MOVED: f32 = 2.0 * (28.0 * 1.4 + 10.0 * 8.0) * UNIT_ROUNDOFF;

pub(super) fn findings(backend: &mut dyn Backend) -> Result<Vec<Finding>, CheckError> {
    let (mut job, mesh) = scene()?;
    load(backend, &mut job)?;
    let mut rays = rays(&mesh);
    let hits = backend.trace_rays(&rays)?;
    let mut findings = vec![leaks(&hits[..INSIDE])];
    if backend.device().backend != "cpu" {
        findings.push(parity(&mut job, &rays, &hits)?);
    }
    // Some of each kind.
    rays.rotate_left(INSIDE - BY_BRUTE_FORCE / 2);
    rays.truncate(BY_BRUTE_FORCE);
    findings.push(brute_force(backend, &job, &rays)?);
    Ok(findings)
}

/// The scene, and its mesh as it was.
fn scene() -> Result<(Job, Mesh), CheckError> {
    let Some(BuiltinScene { mesh, height, zero, scale, .. }) = builtin::load(SCENE) else {
        unreachable!("{SCENE} is a built-in scene")
    };
    let scene = Scene {
        mesh: mesh.clone(),
        reliefs: vec![Relief::new(height, zero, scale)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: N,
    };
    let settings = Settings { width: 1, height: 1, ..Settings::default() };
    Ok((prepare(scene, &settings)?, mesh))
}

/// Rays from within, then from around: aimed anywhere, and at vertices and edges of the base mesh.
fn rays(mesh: &Mesh) -> Vec<Ray> {
    let mut numbers = Numbers::new(6);
    let ray = |i: usize| {
        let origin = if i < INSIDE {
            numbers.in_cube() * 0.9
        } else {
            // Not nearer than the corners of the displaced cube.
            let v = numbers.in_cube();
            v * (4.0 / v.abs().max_element().max(0.1))
        };
        let corners = mesh.triangles[numbers.word() as usize % mesh.triangles.len()].vertices;
        let [a, b, _] = corners.map(|vertex| mesh.vertices[vertex as usize].position);
        let target = match i % 4 {
            0 => a,
            1 => a.lerp(b, numbers.unit()),
            _ => numbers.in_cube() * 1.2,
        };
        Ray { origin, t_max: f32::INFINITY, direction: target - origin, padding: 0 }
    };
    (0..INSIDE + AROUND).map(ray).collect()
}

fn leaks(hits: &[Intersection]) -> Finding {
    let leaking = hits.iter().filter(|hit| hit.primitive == MISS).count();
    let found = format!("{leaking} of {} rays from within {SCENE} leak", hits.len());
    Finding::test("leaks", found, leaking == 0)
}

/// The micro-triangle that is hit.
fn place(hit: &Intersection) -> (u32, u32) {
    if hit.primitive == MISS { (MISS, 0) } else { (hit.primitive, hit.cell) }
}

/// Whether each hit is that of the CPU, or one that the CPU has for a ray moved by no more than rounding moves it.
fn parity(job: &mut Job, rays: &[Ray], hits: &[Intersection]) -> Result<Finding, CheckError> {
    let mut cpu = CpuBackend::new();
    load(&mut cpu, job)?;
    let (mut elsewhere, mut wrong) = (0, 0);
    for ((ray, hit), on_cpu) in rays.iter().zip(hits).zip(cpu.trace_rays(rays)?) {
        if place(hit) != place(&on_cpu) {
            elsewhere += 1;
            wrong += usize::from(!is_within_rounding(&mut cpu, ray, hit)?);
        } else if hit.primitive != MISS {
            // Both points are in the micro-triangle's plane, but for rounding.
            let apart = (hit.point - on_cpu.point).dot(on_cpu.normal).abs();
            wrong += usize::from(apart.is_nan() || apart > MOVED);
        }
    }
    let found = format!(
        "{wrong} of {} rays hit what they cannot hit on the CPU; {elsewhere} pass an edge on its other side",
        rays.len()
    );
    Ok(Finding::test("parity", found, wrong == 0))
}

/// Whether some ray that is as near as rounding cannot tell from `ray` hits on the CPU what `hit` is.
fn is_within_rounding(cpu: &mut CpuBackend, ray: &Ray, hit: &Intersection) -> Result<bool, CheckError> {
    // However an edge runs, a fair part of these crosses it; at a vertex with many edges fewer do.
    const TRIES: u32 = 256;
    let mut numbers = Numbers::new(7);
    let moved: Vec<Ray> =
        (0..TRIES).map(|_| Ray { origin: ray.origin + numbers.in_cube() * MOVED, ..*ray }).collect();
    Ok(cpu.trace_rays(&moved)?.iter().any(|other| place(other) == place(hit)))
}

/// Whether brute force, another pipeline, finds the same to the bit.
fn brute_force(backend: &mut dyn Backend, job: &Job, rays: &[Ray]) -> Result<Finding, CheckError> {
    let exact = backend.trace_rays(rays)?;
    backend.set_features(Features { method: method::BRUTE_FORCE, ..job.features })?;
    let by_brute_force = backend.trace_rays(rays)?;
    let bits = |hit: &Intersection| (place(hit), [hit.t, hit.b1, hit.b2].map(f32::to_bits));
    let differing = exact.iter().zip(&by_brute_force).filter(|(a, b)| bits(a) != bits(b)).count();
    let found = format!("{differing} of {} rays hit something else, to the bit", rays.len());
    Ok(Finding::test("brute force", found, differing == 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Verdict;

    /// A hit that no ray nearby has is found, and so is a ray that leaks.
    #[test]
    fn wrong_hits_are_seen() {
        let (mut job, mesh) = scene().expect("a built-in scene");
        let rays = &rays(&mesh)[INSIDE - 50..INSIDE];
        let mut cpu = CpuBackend::new();
        load(&mut cpu, &mut job).expect("fits");
        let right = cpu.trace_rays(rays).expect("traces");
        assert_eq!(parity(&mut job, rays, &right).expect("traces").verdict, Verdict::Holds);
        assert_eq!(leaks(&right).verdict, Verdict::Holds);
        let mut wrong = right.clone();
        wrong[7].primitive = MISS;
        assert!(leaks(&wrong).fails() && parity(&mut job, rays, &wrong).expect("traces").fails());
        let mut wrong = right.clone();
        let normal = wrong[9].normal;
        wrong[9].point += normal * (4.0 * MOVED);
        assert!(parity(&mut job, rays, &wrong).expect("traces").fails());
        let mut wrong = right;
        wrong[3].cell = wrong[4].cell ^ 1;
        wrong[3].primitive = (wrong[3].primitive + 5) % 12;
        assert!(parity(&mut job, rays, &wrong).expect("traces").fails());
    }

    #[test]
    fn the_cpu_is_exact() {
        let findings = crate::check::check(&mut CpuBackend::new()).expect("the CPU does not fail");
        let failures: Vec<_> = findings.iter().filter(|finding| finding.fails()).collect();
        assert!(failures.is_empty(), "{failures:?}");
    }
}
