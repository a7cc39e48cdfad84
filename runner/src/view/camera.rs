//! A camera that flies, and goes round what it looks at.

use super::tuning::Pose;
use crate::framing::{Framing, View};
use glam::{DQuat, DVec3, Vec3};

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
}

impl Camera {
    /// The camera that a view comes to.
    pub(super) fn new(framing: &Framing, view: &View) -> Camera {
        let forward = framing.camera.forward.as_dvec3();
        let wanted = view.up.unwrap_or(view.usual_up).as_dvec3().normalize_or(DVec3::Y);
        // Straight down a map, say, up is what the picture has there.
        let is_across = forward.cross(wanted).length() > POLE.sin();
        let axis = if is_across { wanted } else { framing.camera.up.as_dvec3().normalize_or(DVec3::Y) };
        let (eye, target) = (framing.camera.eye.as_dvec3(), framing.target.as_dvec3());
        let target = if target == eye { eye + forward } else { target };
        Camera { eye, target, axis, fov: view.fov }
    }

    /// The camera for the settings: rounded to the digits that a command line has.
    pub(super) fn pose(&self) -> Pose {
        Pose {
            eye: self.eye.as_vec3(),
            target: self.target.as_vec3(),
            up: self.axis.as_vec3(),
            fov: self.fov,
        }
    }

    pub(super) fn eye(&self) -> Vec3 {
        self.eye.as_vec3()
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
        if (self.eye + step).abs().max_element() < 1e12 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing::frame;

    /// At (0,0,5), looks at the origin.
    fn camera() -> Camera {
        let (eye, target) = (Some(Vec3::Z * 5.0), Some(Vec3::ZERO));
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

    #[test]
    fn camera_that_looks_straight_down_can_be_turned() {
        let view = View { eye: Some(Vec3::Y), target: Some(Vec3::ZERO), ..View::default() };
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
