//! A camera that flies, and goes round what it looks at.

use super::tuning::Pose;
use crate::framing::{Framing, View};
use crate::space::RenderSpace;
use glam::{DQuat, DVec3};

/// How near to straight up or down the camera may look, in radians.
const POLE: f64 = 0.02;
/// Fields of view in degrees, from a long lens to a wide one.
const FOV: (f32, f32) = (1.0, 150.0);
/// How much a notch of the wheel changes the field of view.
const FOV_STEP: f32 = 1.08;

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Camera {
    eye: DVec3,
    /// What it goes round.
    target: DVec3,
    /// What is up: turns go round it.
    axis: DVec3,
    fov: f32,
    /// What it is rendered in.
    space: RenderSpace,
}

impl Camera {
    /// The camera that a view comes to.
    pub(super) fn new(framing: &Framing, view: &View) -> Camera {
        let forward = framing.camera.forward.as_dvec3();
        let wanted = view.up.unwrap_or(view.usual_up.as_dvec3()).normalize_or(DVec3::Y);
        // Straight down a map, say, up is what the picture has there.
        let is_across = forward.cross(wanted).length() > POLE.sin();
        let axis = if is_across { wanted } else { framing.camera.up.as_dvec3().normalize_or(DVec3::Y) };
        let space = framing.space;
        let (eye, target) = (framing.world_eye(), framing.world_target());
        let target = if target == eye { eye + forward * space.world_length(1.0) } else { target };
        Camera { eye, target, axis, fov: view.fov, space }
    }

    /// The camera for the settings: with no more digits than floats have of the way to the target.
    pub(super) fn pose(&self) -> Pose {
        let distance = self.distance();
        Pose {
            eye: short(self.eye, distance),
            target: short(self.target, distance),
            up: short(self.axis, 1.0),
            fov: self.fov,
        }
    }

    pub(super) fn eye(&self) -> DVec3 {
        short(self.eye, self.distance())
    }

    /// Looks elsewhere from where it is: by angles in radians, to the right and upwards.
    pub(super) fn look(&mut self, right: f64, up: f64) {
        self.target = self.eye + self.turned(self.target - self.eye, -right, up);
    }

    /// Goes round the target: by angles in radians, to the right and upwards.
    pub(super) fn orbit(&mut self, right: f64, up: f64) {
        self.eye = self.target - self.turned(self.target - self.eye, right, -up);
    }

    /// Goes along its own axes (right, up, forward) by model units. The target goes with it.
    pub(super) fn fly(&mut self, way: DVec3) {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(self.axis).normalize();
        let step = right * way.x + self.axis * way.y + forward * way.z;
        // Beyond what floats can tell from where it was the picture would be none.
        if self.space.point(self.eye + step).abs().max_element() < 1e12 {
            self.eye += step;
            self.target += step;
        }
    }

    /// Narrows the field of view, or widens it.
    pub(super) fn zoom(&mut self, notches: f32) {
        self.fov = (self.fov * FOV_STEP.powf(-notches)).clamp(FOV.0, FOV.1);
    }

    /// How far the target is.
    pub(super) fn distance(&self) -> f64 {
        self.eye.distance(self.target)
    }

    /// A view direction turned round the axis, then upwards; not over the poles. Keeps its length.
    fn turned(&self, forward: DVec3, left: f64, up: f64) -> DVec3 {
        let level = DQuat::from_axis_angle(self.axis, left) * forward;
        let right = level.cross(self.axis).normalize();
        let from_pole = level.angle_between(self.axis);
        let up = up.clamp(from_pole - (std::f64::consts::PI - POLE), from_pole - POLE);
        DQuat::from_axis_angle(right, up) * level
    }
}

/// A point in short decimals: those of its floats, where these are as near to it as floats tell lengths of `distance`
/// apart, else with digits up to there.
fn short(p: DVec3, distance: f64) -> DVec3 {
    let apart = distance * f64::from(f32::EPSILON) * 0.5;
    p.map(|x| {
        #[expect(clippy::cast_possible_truncation, reason = "rounded, and compared")]
        let rounded = x as f32;
        let decimal: f64 = rounded.to_string().parse().unwrap_or(x);
        if (decimal - x).abs() <= apart {
            return decimal;
        }
        // The least place that is below what floats tell apart.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 300")]
        let places = (-apart.log10()).ceil().clamp(0.0, 300.0) as usize;
        format!("{x:.places$}").parse().unwrap_or(x)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing;
    use glam::Vec3;

    fn frame(
        view: &View,
        boxes: &[emboss_kernels::aabb::Aabb],
        aspect: f64,
    ) -> Result<Framing, framing::FramingError> {
        framing::frame(view, boxes, aspect, &RenderSpace::default())
    }

    /// At (0,0,5), looks at the origin.
    fn camera() -> Camera {
        let (eye, target) = (Some(DVec3::Z * 5.0), Some(DVec3::ZERO));
        let view = View { eye, target, ..View::default() };
        Camera::new(&frame(&view, &[], 1.5).expect("a camera"), &view)
    }

    fn near(a: DVec3, b: Vec3) -> bool {
        // A few roundings of coordinates of at most 5.
        (a - b.as_dvec3()).length() < 1e-9
    }

    #[test]
    fn orbit_keeps_the_target_and_the_distance() {
        let mut camera = camera();
        camera.orbit(std::f64::consts::FRAC_PI_2, 0.0);
        assert!(near(camera.eye, Vec3::X * 5.0), "{camera:?}");
        camera.orbit(0.0, 10.0);
        assert!(camera.eye.y > 4.99 && near(camera.target, Vec3::ZERO), "not over the pole: {camera:?}");
        assert!((camera.distance() - 5.0).abs() < 1e-9);
    }

    #[test]
    fn look_keeps_the_eye() {
        let mut camera = camera();
        camera.look(std::f64::consts::FRAC_PI_2, 0.0);
        assert!(
            near(camera.eye, Vec3::Z * 5.0) && near(camera.target, Vec3::new(5.0, 0.0, 5.0)),
            "{camera:?}"
        );
        camera.look(0.0, 0.1);
        assert!(camera.target.y > 0.0, "{camera:?}");
        camera.look(0.0, -10.0);
        assert!(camera.target.y < -4.99, "not over the pole: {camera:?}");
    }

    #[test]
    fn flight_is_along_the_view() {
        let mut camera = camera();
        camera.fly(DVec3::new(1.0, 2.0, 3.0));
        assert!(near(camera.eye, Vec3::new(1.0, 2.0, 2.0)), "{camera:?}");
        assert!((camera.distance() - 5.0).abs() < 1e-9);
        let before = camera;
        camera.fly(DVec3::Z * 1e13);
        assert_eq!(camera, before);
    }

    /// What the pose says is framed as the camera it came from.
    #[test]
    fn pose_is_the_view_it_was_made_of() {
        let view = View::default();
        let framing = frame(&view, &[], 1.5).expect("a camera");
        let Pose { eye, target, up, fov } = Camera::new(&framing, &view).pose();
        let posed = View { eye: Some(eye), target: Some(target), up: Some(up), fov, ..view };
        let again = frame(&posed, &[], 1.5).expect("a camera");
        assert_eq!(again.camera.eye, framing.camera.eye);
        // The direction is taken from rounded points: an ulp of each coordinate.
        assert!((again.camera.forward - framing.camera.forward).abs().max_element() < 1e-6);
    }

    /// Far from the origin it keeps the digits of what is near to it, in decimals that are no longer than that asks.
    #[test]
    fn pose_has_the_digits_of_the_way_to_the_target() {
        let space = RenderSpace { origin: DVec3::new(412_344.0, 0.0, -5e9), exponent: 3 };
        let at = |offset: DVec3| Some(space.origin + offset);
        let (eye, target) = (at(DVec3::new(0.1, 0.7, 1.3)), at(DVec3::splat(1.0 / 3.0)));
        let view = View { eye, target, ..View::default() };
        let framing = framing::frame(&view, &[], 1.5, &space).expect("a camera");
        let camera = Camera::new(&framing, &view);
        let pose = camera.pose();
        for (short, given) in [(pose.eye, eye), (pose.target, target)] {
            let off = (short - given.expect("given")).abs();
            // A rounding of the short decimal, one of the float, and those of doubles 5e9 away: 2^-21.
            assert!(off.max_element() <= 2e-7 * camera.distance() + 5e-7, "{short} {off}");
            assert!(short.x.to_string().len() <= 15 && short.y.to_string().len() <= 11, "{short}");
        }
        let again = View { eye: Some(pose.eye), target: Some(pose.target), up: Some(pose.up), ..view };
        let again = framing::frame(&again, &[], 1.5, &space).expect("a camera");
        assert!(again.camera.eye.distance(framing.camera.eye) < 1e-5);
    }

    #[test]
    fn camera_that_looks_straight_down_can_be_turned() {
        let view = View { eye: Some(DVec3::Y), target: Some(DVec3::ZERO), ..View::default() };
        let mut camera = Camera::new(&frame(&view, &[], 1.0).expect("a camera"), &view);
        camera.orbit(0.3, 0.2);
        assert!(camera.eye.is_finite() && (camera.distance() - 1.0).abs() < 1e-9, "{camera:?}");
    }

    #[test]
    fn lenses_have_limits() {
        let mut camera = camera();
        camera.zoom(1.0);
        assert!(camera.fov < View::FOV);
        camera.zoom(1000.0);
        assert_eq!(camera.fov, FOV.0);
        camera.zoom(-1000.0);
        assert_eq!(camera.fov, FOV.1);
    }
}
