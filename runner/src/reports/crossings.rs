//! How often rays from a point pass through a surface, outwards less inwards: the surface's winding number around it
//! where the surface is closed, and whatever the ray.

use super::Ground;
use crate::backend::{Backend, BackendError};
use emboss_kernels::interface::{FLIPPED, Instance, MISS, Ray, Triangle};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// How many surfaces a ray is followed through: what lies behind so many says no more of where it starts.
const MOST_SURFACES: u32 = 64;
/// How many rays and base triangles are tested against each other at most, which takes a second or two.
const MOST_TESTS: u64 = 200_000_000;

/// Some directions, evenly spread over the sphere: a Fibonacci lattice (Swinbank and Purser 2006).
pub(super) fn directions(count: u32) -> Vec<Vec3> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sine, cosine) = (golden_angle * f64::from(i)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cosine, r * sine, z).as_vec3()
    };
    (0..count).map(direction).collect()
}

/// For each unit direction how often a ray from `origin` passes through the surface that the backend traces, outwards
/// less inwards.
pub(super) fn of_surface(
    backend: &mut dyn Backend,
    origin: Vec3,
    directions: &[Vec3],
) -> Result<Vec<i32>, BackendError> {
    let mut counts = vec![0; directions.len()];
    let ray = |origin, direction| Ray { origin, t_max: f32::INFINITY, direction, padding: 0 };
    let mut rays: Vec<(usize, Ray)> =
        directions.iter().enumerate().map(|(i, &direction)| (i, ray(origin, direction))).collect();
    for _ in 0..MOST_SURFACES {
        let traced = backend.trace_rays(&rays.iter().map(|(_, ray)| *ray).collect::<Vec<_>>())?;
        let on = rays.iter().zip(traced).filter(|(_, hit)| hit.primitive != MISS);
        rays = on
            .map(|(&(i, Ray { direction, .. }), hit)| {
                counts[i] += if hit.normal.dot(direction) > 0.0 { 1 } else { -1 };
                let room = hit.point.abs().max_element() + hit.t;
                let step = 4.0 * hit.point_error.max_element() + 8.0 * f32::EPSILON * room;
                (i, ray(hit.point + direction * step, direction))
            })
            .collect();
        if rays.is_empty() {
            break;
        }
    }
    Ok(counts)
}

/// The same of the base mesh; `None` where it is too large to be tested in a moment.
pub(super) fn of_base(ground: &Ground<'_>, origin: Vec3, directions: &[Vec3]) -> Option<Vec<i32>> {
    let places = ground.instances.iter().map(|instance| u64::from(instance.triangle_count));
    let triangles = if ground.instances.is_empty() { ground.triangles.len() as u64 } else { places.sum() };
    if triangles.saturating_mul(directions.len() as u64) > MOST_TESTS {
        return None;
    }
    let count = |direction: &Vec3| {
        let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
        if ground.instances.is_empty() {
            return crossings(ground, ground.triangles, origin, direction);
        }
        let of_instance = |instance: &Instance| {
            let [x, y, z] = instance.object_from_world.map(|row| row.map(f64::from));
            let rows = [x, y, z].map(|row| DVec3::new(row[0], row[1], row[2]));
            let matrix = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            let first = instance.first_triangle as usize;
            let mesh = &ground.triangles[first..first + instance.triangle_count as usize];
            // Which side of a triangle is outside is the same in its own space, also of a mirrored one.
            crossings(ground, mesh, matrix * origin + DVec3::new(x[3], y[3], z[3]), matrix * direction)
        };
        ground.instances.iter().map(of_instance).sum()
    };
    Some(directions.par_iter().map(count).collect())
}

/// How often a ray passes through triangles, outwards less inwards: Möller and Trumbore 1997.
fn crossings(ground: &Ground<'_>, triangles: &[Triangle], origin: DVec3, direction: DVec3) -> i32 {
    let crossing = |triangle: &Triangle| {
        let [a, b, c] = triangle.vertices.map(|v| ground.vertices[v as usize].position.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let p = direction.cross(e2);
        let determinant = e1.dot(p);
        let s = origin - a;
        let q = s.cross(e1);
        let (b1, b2, t) = (s.dot(p) / determinant, direction.dot(q) / determinant, e2.dot(q) / determinant);
        if !(b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 && t > 0.0) {
            return 0;
        }
        // The determinant is that of the normal with the direction, turned round.
        if (determinant < 0.0) != (triangle.flags & FLIPPED != 0) { 1 } else { -1 }
    };
    triangles.iter().map(crossing).sum()
}
