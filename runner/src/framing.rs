//! Where the camera and the light stand when the user does not say.

use crate::bvh::HostAabb;
use crate::space::RenderSpace;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::{Camera, PointLight};
use glam::{DVec3, Vec3};

/// The share of the film that the framed model fills along its longer side.
const FILLED: f64 = 0.92;

/// The box of an empty model.
const NOTHING: Aabb = Aabb { min: Vec3::ZERO, max: Vec3::ZERO };

/// What the user asked of the view; the rest is chosen so that the whole model is in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the camera is, in world units.
    pub eye: Option<DVec3>,
    /// What is in the middle of the picture, in world units.
    pub target: Option<DVec3>,
    /// What is up in the picture.
    pub up: Option<DVec3>,
    /// Angle between the picture's upper and lower edge, in degrees, above 0 and below 180.
    pub fov: f32,
    /// From the model towards the camera: used without an eye. Not zero.
    pub from: Vec3,
    /// What is up where the user does not say and the camera does not look along it.
    pub usual_up: Vec3,
}

impl View {
    /// From the front, a little from the right and from above: three sides of a cube show, the front one most.
    pub const THREE_QUARTER: Vec3 = Vec3::new(0.55, 0.45, 1.0);

    /// Field of view unless the user chooses one: that of a 57 mm lens on 35 mm film, a little narrower than what
    /// fills the eye, so that perspective does not exaggerate.
    pub const FOV: f32 = 35.0;
}

impl Default for View {
    fn default() -> Self {
        View {
            eye: None,
            target: None,
            up: None,
            fov: View::FOV,
            from: View::THREE_QUARTER,
            usual_up: Vec3::Y,
        }
    }
}

/// Why there is no camera.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FramingError {
    /// The eye is at the target.
    #[error("--eye and --target are the same point ({0}); move one of them")]
    EyeAtTarget(DVec3),
    /// No side of the picture is up.
    #[error("--up {0} points along the view; choose another direction")]
    UpAlongView(DVec3),
    /// The model's coordinates are so large that the camera's overflow.
    #[error(
        "the model reaches from {min} to {max}, too far to be framed; scale it down, or give --eye and --target"
    )]
    TooLarge {
        /// Lower corner of its box, in world units.
        min: DVec3,
        /// Upper corner.
        max: DVec3,
    },
}

/// A camera and what it looks at, in render space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// The camera.
    pub camera: Camera,
    /// A point in the middle of the picture, on the model's middle plane unless the user chose it.
    pub target: Vec3,
    /// The render space.
    pub space: RenderSpace,
}

impl Framing {
    /// Where the camera is in the world.
    pub fn world_eye(&self) -> DVec3 {
        self.space.world(self.camera.eye.as_dvec3())
    }

    /// The target in the world.
    pub fn world_target(&self) -> DVec3 {
        self.space.world(self.target.as_dvec3())
    }
}

/// [`Frame::detail`](emboss_kernels::interface::Frame::detail) with which a micro-triangle covers no more than
/// `pixels`² of a pixel on a film of `width` by `height`, as long as it is not displaced.
///
/// At distance 1 a part of an edge may be as long as `pixels` pixels are wide there in the middle of the film. Then a
/// micro-triangle, no angle of whose corners matters, has at most half the square of that for its area, and the film at
/// an angle a from its middle shows it 1/cos³ a times as large: at an angle of 37 degrees, of pictures of 4:3 with a
/// field of view above 49, that is up to the whole square, and where the film's corners are farther out lengths are the
/// shorter.
pub fn detail(view: &View, width: u32, height: u32, pixels: f32) -> f32 {
    let up = (f64::from(view.fov).to_radians() * 0.5).tan();
    let right = up * f64::from(width) / f64::from(height);
    let cosine = 1.0 / (1.0 + up * up + right * right).sqrt();
    let length = f64::from(pixels) * 2.0 * up / f64::from(height);
    #[expect(clippy::cast_possible_truncation, reason = "rounded")]
    let detail = (1.0 / (length * length * (2.0 * cosine.powi(3)).min(1.0))) as f32;
    detail
}

/// The camera of a view onto a model that lies in `boxes`, on a film `aspect` times as wide as high. Without boxes
/// it looks at the origin. Many small boxes around the parts of a model fit closer than one around all of it.
///
/// Boxes and camera are in render space: what the view says is taken there in double precision, and rounded last.
pub fn frame(view: &View, boxes: &[Aabb], aspect: f64, space: &RenderSpace) -> Result<Framing, FramingError> {
    let Aabb { min, max } = boxes.iter().copied().reduce(Aabb::union).unwrap_or(NOTHING);
    let center = (min.as_dvec3() + max.as_dvec3()) * 0.5;
    let (given_eye, given_target) = (view.eye.map(|p| space.point(p)), view.target.map(|p| space.point(p)));
    let forward = match (given_eye, given_target) {
        (Some(eye), target) => {
            let at_target = FramingError::EyeAtTarget(view.eye.unwrap_or_default());
            (target.unwrap_or(center) - eye).try_normalize().ok_or(at_target)?
        }
        (None, _) => -view.from.as_dvec3().normalize_or(DVec3::Z),
    };
    let (right, up) = screen_axes(forward, view)?;
    let half_height = (f64::from(view.fov).to_radians() * 0.5).tan();
    let axes = Axes { right, up, forward, half_width: half_height * aspect, half_height };
    let eye = match (given_eye, given_target) {
        (Some(eye), _) => eye,
        (None, None) => center + axes.fit(boxes, center),
        // The distance of the fit, but with the target in the middle.
        (None, Some(target)) => target + forward * axes.fit(boxes, center).dot(forward),
    };
    let target = given_target.unwrap_or(eye + forward * (center - eye).dot(forward)).as_vec3();
    let camera = axes.camera(eye);
    let finite = [camera.eye, camera.right, camera.up, camera.forward, target];
    if finite.iter().all(|v| v.is_finite()) {
        Ok(Framing { camera, target, space: *space })
    } else {
        let [min, max] = [min, max].map(|corner| space.world(corner.as_dvec3()));
        Err(FramingError::TooLarge { min, max })
    }
}

/// The light of a scene that names none, in render space: white, over the viewer's left shoulder, at one and a half
/// times the viewer's distance from the target. A surface at the target that faces it has full light, the irradiance 1:
/// a white one looks white.
pub fn key_light(framing: &Framing) -> PointLight {
    let Framing { camera, target, .. } = framing;
    let shoulder = 0.6 * camera.up.normalize() - 0.7 * camera.right.normalize() - camera.forward;
    let position = *target + shoulder.normalize() * (1.5 * camera.eye.distance(*target));
    PointLight { position, color: Vec3::ONE, intensity: intensity_for(position, *target), padding: 0 }
}

/// The intensity with which a light at `position` gives full light, the irradiance 1, at `target`, in the space that
/// these are in.
pub fn intensity_for(position: Vec3, target: Vec3) -> f32 {
    position.distance_squared(target)
}

/// The picture's axes and its half sizes at distance 1.
struct Axes {
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    half_width: f64,
    half_height: f64,
}

impl Axes {
    /// Where the eye has to be, relative to `center`, for all corners of the boxes to be in the picture, as near as
    /// possible.
    ///
    /// With a corner's coordinates (x, y, z) along the axes and the eye's (a, b, c), the point is left of the right
    /// edge where x - a <= t (z - c), t the half width: a - t c >= x - t z. The greatest right sides of this and of
    /// the left edge's condition, R and L, give c = -(R + L) / 2t, a = (R - L) / 2. Likewise y; the farther eye wins,
    /// and along the other axis the middle between the edges is taken, which is the same formula.
    fn fit(&self, boxes: &[Aabb], center: DVec3) -> DVec3 {
        let (tx, ty) = (self.half_width * FILLED, self.half_height * FILLED);
        // Right, left, upper, lower edge.
        let mut edges = [f64::NEG_INFINITY; 4];
        for corner in boxes.iter().flat_map(|b| b.corners()) {
            let p = corner.as_dvec3() - center;
            let (x, y, z) = (p.dot(self.right), p.dot(self.up), p.dot(self.forward));
            let needed = [x - tx * z, -x - tx * z, y - ty * z, -y - ty * z];
            edges.iter_mut().zip(needed).for_each(|(edge, needed)| *edge = edge.max(needed));
        }
        let [r, l, u, d] = if boxes.is_empty() { [1.0; 4] } else { edges };
        let depth = (-(r + l) / (2.0 * tx)).min(-(u + d) / (2.0 * ty));
        // A single point would put the eye upon it.
        let depth = if depth < 0.0 { depth } else { -1.0 };
        self.right * (0.5 * (r - l)) + self.up * (0.5 * (u - d)) + self.forward * depth
    }

    fn camera(&self, eye: DVec3) -> Camera {
        Camera {
            eye: eye.as_vec3(),
            right: (self.right * self.half_width).as_vec3(),
            up: (self.up * self.half_height).as_vec3(),
            forward: self.forward.as_vec3(),
            ..Camera::default()
        }
    }
}

/// The unit vectors to the right and upwards in a picture with the view direction `forward`. Where the usual up is
/// the view direction itself, -Z is up, as on a map, or Y.
fn screen_axes(forward: DVec3, view: &View) -> Result<(DVec3, DVec3), FramingError> {
    let right = |up: DVec3| {
        let across = forward.cross(up.normalize_or_zero());
        // Nearly parallel vectors leave a cross product of rounding errors only.
        (across.length() > 1e-6).then(|| across.normalize())
    };
    let right = match view.up {
        Some(up) => right(up).ok_or(FramingError::UpAlongView(up))?,
        None => {
            [view.usual_up.as_dvec3(), DVec3::NEG_Z, DVec3::Y].into_iter().find_map(right).unwrap_or(DVec3::X)
        }
    };
    Ok((right, right.cross(forward)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(view: &View, boxes: &[Aabb], aspect: f64) -> Result<Framing, FramingError> {
        frame(view, boxes, aspect, &RenderSpace::default())
    }

    fn cube() -> [Aabb; 1] {
        [Aabb { min: Vec3::new(1.0, 2.0, 3.0), max: Vec3::new(2.0, 4.0, 6.0) }]
    }

    /// Film coordinates in [-1,1] of a point; behind the camera they are NaN.
    fn projected(camera: &Camera, point: Vec3) -> (f32, f32) {
        let p = point - camera.eye;
        let z = p.dot(camera.forward);
        assert!(z > 0.0, "{point} is behind the camera");
        let (x, y) = (p.dot(camera.right), p.dot(camera.up));
        (x / camera.right.length_squared() / z, y / camera.up.length_squared() / z)
    }

    /// All points are in the picture, and two opposite edges are touched: nearer it could not be. The f32 camera
    /// is good to about 1e-6 at these sizes.
    #[test]
    fn the_model_fills_the_picture() {
        for (aspect, from) in [(1.0, View::THREE_QUARTER), (2.0, Vec3::X), (0.3, Vec3::new(-1.0, -2.0, 0.5))]
        {
            let framing = framed(&View { from, ..View::default() }, &cube(), aspect).expect("framed");
            let film = cube()[0].corners().map(|p| projected(&framing.camera, p));
            let max = |f: fn(&(f32, f32)) -> f32| film.iter().map(f).fold(f32::MIN, f32::max);
            let reach = [max(|p| p.0), max(|p| -p.0), max(|p| p.1), max(|p| -p.1)];
            #[expect(clippy::cast_possible_truncation, reason = "0.92 to the nearest f32")]
            let filled = FILLED as f32;
            assert!(reach.iter().all(|&r| r <= filled + 1e-5), "{reach:?}");
            let touched = |a: f32, b: f32| (a - filled).abs() < 1e-5 && (b - filled).abs() < 1e-5;
            assert!(touched(reach[0], reach[1]) || touched(reach[2], reach[3]), "{reach:?}");
        }
    }

    #[test]
    fn the_camera_is_orthogonal_and_has_the_field_of_view() {
        let view = View { fov: 90.0, ..View::default() };
        let camera = framed(&view, &cube(), 1.5).expect("framed").camera;
        assert!((camera.up.length() - 1.0).abs() < 1e-6 && (camera.right.length() - 1.5).abs() < 1e-6);
        assert!(camera.up.dot(camera.right).abs() < 1e-6 && camera.up.dot(camera.forward).abs() < 1e-6);
        // Right-handed: right x up points to the viewer.
        assert!(camera.right.cross(camera.up).dot(camera.forward) < 0.0);
    }

    #[test]
    fn what_the_user_chooses_is_kept() {
        let (eye, target) = (DVec3::new(0.0, 0.0, 10.0), DVec3::new(0.0, 0.0, 1.0));
        let view = View { eye: Some(eye), target: Some(target), ..View::default() };
        let framing = framed(&view, &cube(), 1.0).expect("framed");
        assert_eq!((framing.world_eye(), framing.world_target()), (eye, target));
        assert_eq!(framing.camera.forward, Vec3::NEG_Z);
    }

    #[test]
    fn a_target_alone_is_in_the_middle() {
        let target = Vec3::new(1.0, 2.0, 3.0);
        let view = View { target: Some(target.as_dvec3()), ..View::default() };
        let framing = framed(&view, &cube(), 1.0).expect("framed");
        let (x, y) = projected(&framing.camera, target);
        assert!(x.abs() < 1e-5 && y.abs() < 1e-5);
    }

    #[test]
    fn looking_straight_down_has_an_up() {
        let view = View { from: Vec3::Y, ..View::default() };
        let camera = framed(&view, &cube(), 1.0).expect("framed").camera;
        assert!(camera.up.normalize().distance(Vec3::NEG_Z) < 1e-6, "{}", camera.up);
        let view = View { up: Some(DVec3::Y), ..view };
        assert_eq!(framed(&view, &cube(), 1.0), Err(FramingError::UpAlongView(DVec3::Y)));
    }

    #[test]
    fn impossible_views_are_errors() {
        let view = View { eye: Some(DVec3::ONE), target: Some(DVec3::ONE), ..View::default() };
        assert_eq!(framed(&view, &cube(), 1.0), Err(FramingError::EyeAtTarget(DVec3::ONE)));
        let huge = [Aabb { min: Vec3::splat(-f32::MAX), max: Vec3::splat(f32::MAX) }];
        assert!(matches!(framed(&View::default(), &huge, 1.0), Err(FramingError::TooLarge { .. })));
    }

    #[test]
    fn nothing_and_a_single_point_are_looked_at() {
        let point = [Aabb { min: Vec3::ONE, max: Vec3::ONE }];
        for boxes in [&[][..], &point] {
            let framing = framed(&View::default(), boxes, 1.0).expect("framed");
            assert!(framing.camera.eye.distance(framing.target) > 0.1);
        }
    }

    #[test]
    fn the_key_light_gives_full_light() {
        let framing = framed(&View::default(), &cube(), 1.0).expect("framed");
        let light = key_light(&framing);
        let irradiance = light.intensity / light.position.distance_squared(framing.target);
        assert!((irradiance - 1.0).abs() < 1e-6);
        // Over the left shoulder: behind, above and left of the viewer.
        let from_eye = light.position - framing.camera.eye;
        assert!(from_eye.dot(framing.camera.right) < 0.0 && from_eye.dot(framing.camera.up) > 0.0);
    }
}
