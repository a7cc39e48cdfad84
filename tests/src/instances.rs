//! Meshes in many places.

use crate::meshes::{self, Solid};
use crate::oracle::{Clarity, Disagreement, Oracle, WideRay};
use crate::scenes::{ReadyJob, WildMap, job};
use crate::{Numbers, RaySource};
use emboss::backend::SceneBuffers;
use emboss::instances::Part;
use emboss::render::Scene;
use emboss::scene::{Material, Mesh, Relief};
use emboss::settings::{Normals, Settings};
use emboss_kernels::interface::{Frame, Instance, Intersection, MISS, Ray};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::scene::Features;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::f32::consts::TAU;

/// The scene's mesh in places of its own.
pub fn placed(scene: Scene, places: Vec<DAffine3>) -> Scene {
    let triangle_count = u32::try_from(scene.mesh.triangles.len()).expect("indices are of 32 bits");
    Scene { parts: vec![Part { triangle_count, places }], ..scene }
}

/// A solid under noise, a tenth of its size high.
pub fn rough(solid: &Solid, n: u32) -> Scene {
    Scene {
        mesh: solid.placed(1.0, 0.0).mesh,
        reliefs: vec![Relief::new(WildMap::Noise.map(&mut Numbers::new(7)), 0.0, 0.1)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: n,
    }
}

/// Two meshes of one scene, the second one's triangles after the first one's, each in `places` of its own.
pub fn two_meshes(places: [Vec<DAffine3>; 2]) -> (Scene, [Scene; 2]) {
    let alone = [rough(&meshes::icosphere(1), 5), rough(&meshes::cube(), 5)];
    let mut mesh = Mesh::default();
    let counts = alone.each_ref().map(|scene| {
        mesh.append(scene.mesh.clone());
        u32::try_from(scene.mesh.triangles.len()).expect("indices are of 32 bits")
    });
    let parts =
        counts.into_iter().zip(places).map(|(triangle_count, places)| Part { triangle_count, places });
    (Scene { mesh, parts: parts.collect(), ..alone[0].clone() }, alone)
}

/// A random rotation.
pub fn rotation(numbers: &mut Numbers) -> DQuat {
    let axis = numbers.direction().as_dvec3().normalize();
    DQuat::from_axis_angle(axis, f64::from(numbers.between(0.0, TAU)))
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

/// The transform that kernels take rays to object space by.
pub fn object_from_world(instance: &Instance) -> DAffine3 {
    let column = |i: usize| DVec3::from(instance.object_from_world.map(|row| f64::from(row[i])));
    DAffine3::from_cols(column(0), column(1), column(2), column(3))
}

/// A scene of two meshes in three places each, rays at all of them, and who judges these.
pub struct OracleCase {
    /// The scene.
    pub job: ReadyJob,
    /// At each instance from outside, from inside, and towards edges.
    pub rays: Vec<Ray>,
    oracle: InstanceOracle,
}

impl OracleCase {
    /// In places that `round` decides: crowds in odd rounds, else wild ones, which overlap less. So many `rays` of
    /// each kind at each instance. `oracle` makes the judge of a mesh.
    pub fn new(
        round: u64,
        normals: Normals,
        rays: usize,
        oracle: fn(&SceneBuffers, &Frame, Features) -> Oracle,
    ) -> OracleCase {
        let mut numbers = Numbers::new(round);
        let mut place = || {
            if round.is_multiple_of(2) {
                return wild(&mut numbers);
            }
            let turned = DAffine3::from_quat(rotation(&mut numbers));
            DAffine3::from_translation(numbers.direction().as_dvec3() * 1.5) * turned
        };
        let places = [(); 2].map(|()| (0..3).map(|_| place()).collect());
        let (scene, alone) = two_meshes(places);
        let parts = scene.parts.clone();
        let settings = Settings { normals, width: 1, height: 1, ..Settings::default() };
        let meshes = alone.map(|scene| job(scene, &settings));
        let mut at_all = Vec::new();
        for (part, mesh) in parts.iter().zip(&meshes) {
            for &place in &part.places {
                let mut source = RaySource::new(mesh, round);
                for _ in 0..rays {
                    let more = [source.from_outside(), source.from_inside(), source.towards_edge(3.0)];
                    at_all.extend(more.iter().map(|ray| world_ray(place, ray)));
                }
            }
        }
        let oracle =
            InstanceOracle::new(&parts, &meshes, |job| oracle(&job.buffers, &job.frame, job.features));
        OracleCase { job: job(scene, &settings), rays: at_all, oracle }
    }

    /// Asserts that hits of the rays are right. How many of them had no other answer.
    ///
    /// # Panics
    /// Where one is wrong.
    pub fn assert_right(&self, hits: &[Intersection]) -> usize {
        let verdict = |(ray, hit): (&Ray, &Intersection)| match self.oracle.judge(ray, hit) {
            Ok(clarity) => clarity == Clarity::Clear,
            Err((instance, wrong)) => panic!("{ray:?}\n{hit:?}\ninstance {instance}: {wrong:?}"),
        };
        self.rays.iter().zip(hits).map(verdict).filter(|&clear| clear).count()
    }
}

/// Judges rays through instances: an oracle for each mesh in its own space.
///
/// The truth is the transform that was asked for, in f64. What f32 makes of it moves the ray in object space. Let W be
/// its matrix, O the inverse, T and T' the translations, x what is hit, o the origin, d the direction. Rounding W and T
/// moves the surface by u |O| (|W||x| + |T|) in object space; rounding O and T' moves the ray's origin by u (|O||o| +
/// |T'|), and computing it by four to six times that, |T'| <= |O||T|. The direction is off by
/// u (|O||W||O||d| + |O||d|) for the matrices, 5 u |O||d| for products and sums, and each component by 10 u of itself
/// (two quotients; the CPU's are 2 u).
struct InstanceOracle {
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
    fn new(parts: &[Part], meshes: &[ReadyJob], oracle: impl Fn(&ReadyJob) -> Oracle) -> Self {
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
    /// Else the instance that says no, and why.
    fn judge(&self, ray: &Ray, reported: &Intersection) -> Result<Clarity, (usize, Disagreement)> {
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
