//! Where comparisons are looked at from: the user's camera, one that looks low over the surface, and a path.

use emboss_kernels::interface::{Camera, Intersection, MISS, Ray};
use glam::{Quat, Vec2, Vec3};

/// The angle at which the grazing camera looks at the base surface.
const GRAZING_DEGREES: f32 = 10.0;
/// Its distance, as a share of the user's camera's.
const GRAZING_SHARE: f32 = 0.5;
/// Pictures of the path.
pub const PATH_FRAMES: u32 = 8;
/// The angle between neighbours of the path: a slow turn, of 12 degrees a second at 24 pictures.
const PATH_STEP_DEGREES: f32 = 0.5;

/// Rays through the centres of all pixels, row by row from the top.
pub fn centre_rays(camera: &Camera, width: u32, height: u32) -> Vec<Ray> {
    let ray = |(x, y): (u32, u32)| {
        let film = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        Ray { origin: camera.eye, t_max: f32::INFINITY, direction: camera.ray_direction(film), padding: 0 }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(ray).collect()
}

/// The path: `camera` and a small turn of it round `target`.
pub fn orbit(camera: &Camera, target: Vec3) -> Vec<Camera> {
    let axis = camera.up.normalize();
    let turned = |frame: u32| {
        let turn = Quat::from_axis_angle(axis, (frame as f32 * PATH_STEP_DEGREES).to_radians());
        Camera {
            eye: target + turn * (camera.eye - target),
            right: turn * camera.right,
            up: turn * camera.up,
            forward: turn * camera.forward,
            ..*camera
        }
    };
    (0..PATH_FRAMES).map(turned).collect()
}

/// A camera that looks low over the surface, at what `camera` has nearest to the middle of its picture. `base` are the
/// hits of its [`centre_rays`] on the undisplaced mesh, `lift` is how high the relief rises above that, and `distance`
/// how far off `camera` looks. `None` where it sees nothing.
pub fn grazing(
    camera: &Camera,
    base: &[Intersection],
    width: u32,
    lift: f32,
    distance: f32,
) -> Option<Camera> {
    let height = base.len() as f32 / width as f32;
    let middle = Vec2::new(width as f32, height) * 0.5;
    let off_middle = |i: usize| {
        let (x, y) = (i % width as usize, i / width as usize);
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5).distance_squared(middle)
    };
    let hits = base.iter().enumerate().filter(|(_, hit)| hit.primitive != MISS);
    let (_, hit) = hits.min_by(|(a, _), (b, _)| off_middle(*a).total_cmp(&off_middle(*b)))?;
    let towards_camera = camera.eye - hit.point;
    let up = if hit.normal.dot(towards_camera) < 0.0 { -hit.normal } else { hit.normal };
    // Along the surface, as the camera looks; where it looks straight down, what is up in its picture is ahead.
    let ahead = (camera.forward - up * camera.forward.dot(up))
        .try_normalize()
        .or_else(|| camera.up.reject_from(up).try_normalize())?;
    let angle = GRAZING_DEGREES.to_radians();
    let forward = ahead * angle.cos() - up * angle.sin();
    let right = forward.cross(up).normalize();
    Some(Camera {
        eye: hit.point + up * lift - forward * (GRAZING_SHARE * distance),
        right: right * camera.right.length(),
        up: right.cross(forward) * camera.up.length(),
        forward,
        ..*camera
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(0.0, 4.0, 4.0),
            right: Vec3::X * 0.5,
            up: Vec3::new(0.0, 1.0, -1.0).normalize() * 0.4,
            forward: Vec3::new(0.0, -1.0, -1.0).normalize(),
            ..Camera::default()
        }
    }

    /// A floor below, seen by the middle pixel alone.
    fn floor() -> Vec<Intersection> {
        let miss = Intersection { primitive: MISS, ..Intersection::default() };
        let hit = Intersection { primitive: 0, normal: Vec3::Y, ..Intersection::default() };
        (0..9).map(|i| if i == 4 { hit } else { miss }).collect()
    }

    #[test]
    fn the_grazing_camera_is_low_and_looks_at_the_middle() {
        let low = grazing(&camera(), &floor(), 3, 0.25, 4.0).expect("a floor");
        let sine = GRAZING_DEGREES.to_radians().sin();
        assert!((low.eye.y - (0.25 + 2.0 * sine)).abs() < 1e-6, "{}", low.eye);
        assert!((low.eye + low.forward * 2.0).distance(Vec3::Y * 0.25) < 1e-6);
        assert!(low.forward.z < 0.0 && low.up.y > 0.0 && low.right.x > 0.0);
        assert!(low.up.dot(low.forward).abs() < 1e-6 && (low.up.length() - 0.4).abs() < 1e-6);
    }

    #[test]
    fn where_nothing_is_seen_nothing_is_grazed() {
        let misses = vec![Intersection { primitive: MISS, ..Intersection::default() }; 9];
        assert!(grazing(&camera(), &misses, 3, 0.0, 1.0).is_none());
    }

    #[test]
    fn the_path_begins_at_the_camera_and_keeps_its_distance() {
        let path = orbit(&camera(), Vec3::ZERO);
        assert_eq!((path.len(), path[0]), (PATH_FRAMES as usize, camera()));
        for pair in path.windows(2) {
            let chord = 2.0 * 32.0_f32.sqrt() * (0.5 * PATH_STEP_DEGREES).to_radians().sin();
            assert!((pair[0].eye.distance(pair[1].eye) - chord).abs() < 1e-5);
            assert!((pair[1].eye.length() - 32.0_f32.sqrt()).abs() < 1e-5);
            // The target stays in the middle.
            assert!((pair[1].eye.normalize() + pair[1].forward).length() < 1e-6);
        }
    }

    #[test]
    fn rays_go_through_centres_from_the_top_left() {
        let rays = centre_rays(&camera(), 3, 3);
        assert!(rays[4].direction.distance(camera().forward) < 1e-6);
        assert!(rays[0].direction.dot(camera().right) < 0.0 && rays[0].direction.dot(camera().up) > 0.0);
    }
}
