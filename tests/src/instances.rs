//! Meshes in many places.

use crate::Numbers;
use crate::oracle::{Clarity, Disagreement, Oracle, WideRay};
use crate::scenes::ReadyJob;
use emboss::instances::Part;
use emboss::render::Scene;
use emboss_kernels::interface::{Instance, Intersection, MISS, Ray};
use emboss_kernels::math::UNIT_ROUNDOFF;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// The scene's mesh in places of its own.
pub fn placed(scene: Scene, places: Vec<DAffine3>) -> Scene {
    let triangle_count = u32::try_from(scene.mesh.triangles.len()).expect("indices are of 32 bits");
    Scene { parts: vec![Part { triangle_count, places }], ..scene }
}

/// A random rotation.
pub fn rotation(numbers: &mut Numbers) -> DQuat {
    let axis = numbers.direction().as_dvec3().normalize();
    DQuat::from_axis_angle(axis, f64::from(numbers.between(0.0, 6.28)))
}

/// Scales from 1e-3 to 1e3, one for all axes or one for each, some of them mirrored; turned anyhow; moved by up to a
/// thousand of what a mesh of the extent 1 has along its shortest axis.
pub fn wild(numbers: &mut Numbers) -> DAffine3 {
    let factor = |numbers: &mut Numbers| {
        let magnitude = 10_f64.powf(f64::from(numbers.between(-3.0, 3.0)));
        if numbers.unit() < 0.25 { -magnitude } else { magnitude }
    };
    let scale = if numbers.unit() < 0.5 {
        DVec3::splat(factor(numbers))
    } else {
        DVec3::new(factor(numbers), factor(numbers), factor(numbers))
    };
    let matrix = DMat3::from_quat(rotation(numbers)) * DMat3::from_diagonal(scale);
    let far = scale.abs().min_element() * 10_f64.powf(f64::from(numbers.between(-1.0, 3.0)));
    DAffine3::from_mat3_translation(matrix, numbers.direction().as_dvec3() * far)
}

/// The ray of an instance's object space in the world, rounded. It has the same distances.
pub fn world_ray(place: DAffine3, ray: &Ray) -> Ray {
    let origin = place.transform_point3(ray.origin.as_dvec3()).as_vec3();
    let direction = place.transform_vector3(ray.direction.as_dvec3()).as_vec3();
    Ray { origin, direction, ..*ray }
}

/// The transform that kernels have for the way to the world.
pub fn stored(instance: &Instance) -> DAffine3 {
    affine(instance.world_from_object)
}

/// The transform that kernels take rays to object space by.
pub fn object_from_world(instance: &Instance) -> DAffine3 {
    affine(instance.object_from_world)
}

fn affine(rows: [[f32; 4]; 3]) -> DAffine3 {
    let column = |i: usize| DVec3::from(rows.map(|row| f64::from(row[i])));
    DAffine3::from_cols(column(0), column(1), column(2), column(3))
}

/// Judges rays through instances: an oracle for each mesh in its own space.
///
/// The truth is the transform that was asked for, in f64. What f32 makes of it moves the ray in object space. Let W be its
/// matrix, O the inverse, T and T' the translations, x what is hit, o the origin, d the direction. Rounding W and T moves the
/// surface by u |O| (|W||x| + |T|) in object space; rounding O and T' moves the ray's origin by u (|O||o| + |T'|), and
/// computing it by four to six times that, |T'| <= |O||T|. The direction is off by u (|O||W||O||d| + |O||d|) for the matrices,
/// 5 u |O||d| for products and sums, and each component by 10 u of itself (two quotients; the CPU's are 2 u).
pub struct InstanceOracle {
    meshes: Vec<Oracle>,
    /// The greatest coordinate of each mesh's surface.
    reach: Vec<f64>,
    places: Vec<Place>,
}

struct Place {
    mesh: usize,
    first_triangle: u32,
    world_from_object: DAffine3,
}

impl InstanceOracle {
    /// From `parts` as asked for, and a job of each part's mesh alone without instances, in their order.
    pub fn new(parts: &[Part], meshes: &[ReadyJob], oracle: impl Fn(&ReadyJob) -> Oracle) -> Self {
        let mut first_triangle = 0;
        let mut places = Vec::new();
        for (mesh, part) in parts.iter().enumerate() {
            let place = |&world_from_object| Place { mesh, first_triangle, world_from_object };
            places.extend(part.places.iter().map(place));
            first_triangle += part.triangle_count;
        }
        let reach = |job: &ReadyJob| {
            let bounds = job.bounds();
            f64::from(bounds.min.abs().max(bounds.max.abs()).max_element())
        };
        InstanceOracle {
            meshes: meshes.iter().map(oracle).collect(),
            reach: meshes.iter().map(reach).collect(),
            places,
        }
    }

    /// Whether a reported hit is what rounding allows: right in its instance, and nothing certain before it in another.
    ///
    /// # Errors
    /// Where it is not: the instance that says so, and why.
    pub fn judge(&self, ray: &Ray, reported: &Intersection) -> Result<Clarity, (usize, Disagreement)> {
        let mut clarity = Clarity::Clear;
        for (i, place) in self.places.iter().enumerate() {
            let own = reported.primitive != MISS && reported.instance as usize == i;
            let mut wide = self.object_ray(place, ray);
            let mut local = *reported;
            if own {
                local.primitive = reported.primitive.wrapping_sub(place.first_triangle);
            } else {
                // Nothing certain may end before what was hit.
                wide.t_max = wide.t_max.min(f64::from(reported.t));
                local.primitive = MISS;
            }
            let verdict = self.meshes[place.mesh].trace_wide(&wide).judge(&local);
            if verdict.map_err(|wrong| (i, wrong))? == Clarity::Close {
                clarity = Clarity::Close;
            }
        }
        Ok(clarity)
    }

    fn object_ray(&self, place: &Place, ray: &Ray) -> WideRay {
        let u = f64::from(UNIT_ROUNDOFF);
        let there = place.world_from_object;
        let back = there.inverse();
        let magnitudes = |m: DMat3| DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
        let (w, o) = (magnitudes(there.matrix3), magnitudes(back.matrix3));
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let surface = o * (w * DVec3::splat(self.reach[place.mesh]) + there.translation.abs());
        let start = o * (origin.abs() + there.translation.abs());
        let object_direction = back.transform_vector3(direction);
        let of_matrices = o * direction.abs();
        let turned = 6.0 * of_matrices + o * (w * of_matrices) + 10.0 * object_direction.abs();
        WideRay {
            origin: back.transform_point3(origin),
            direction: object_direction,
            t_max: ray.t_max.into(),
            start_error: u * (surface + 7.0 * start).length(),
            slope_error: u * turned.length() / object_direction.length(),
        }
    }
}
