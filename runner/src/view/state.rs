//! What the viewer knows and does, apart from the window.

use super::camera::Camera;
use super::controls::{Controls, Wish};
use super::input::Input;
use super::tuning::Tuning;
use super::zeros::Zeros;
use crate::framing::{Framing, View, intensity_for, key_light};
use crate::settings::{Light, Method, Settings, Subdivisions};
use glam::{DQuat, DVec3};

/// The share of the target's distance that the camera flies in a second.
const FLIGHT: f64 = 0.6;
/// How much a notch of the wheel changes the speed.
const SPEED_STEP: f64 = 1.25;
/// By what angle arrow keys go round in a second, in radians.
const ROUND: f64 = 1.2;
/// By what angle a step turns the light, in radians.
const LIGHT_STEP: f64 = 0.15;
/// The longest time that a movement is computed for, in seconds: after a pause it goes on, it does not jump.
const LONGEST_TICK: f64 = 0.1;

/// The scene as it was loaded.
#[derive(Clone, Debug)]
pub(super) struct SceneInfo {
    pub(super) settings: Settings,
    pub(super) triangles: usize,
    pub(super) subdivisions: Subdivisions,
    /// What the scales are multiplied by.
    pub(super) exaggeration: f32,
    /// Before that, where it is one.
    pub(super) scale: Option<f32>,
    pub(super) zeros: Zeros,
}

/// What is to be done outside after an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effect {
    Nothing,
    /// The picture is another.
    Render,
    /// The panel is.
    Redraw,
    Save,
    CopyCommand,
    Capture(bool),
    Quit,
}

/// All that the viewer knows.
#[derive(Debug)]
pub(super) struct State {
    pub(super) tuning: Tuning,
    pub(super) is_panel_open: bool,
    /// What was done last, for the panel.
    pub(super) message: String,
    pub(super) scene: Option<SceneInfo>,
    /// What the newest picture's camera is.
    pub(super) framing: Option<Framing>,
    controls: Controls,
    camera: Option<Camera>,
    /// The method that was taken back last, until another is wanted.
    refused: Option<Method>,
    /// How fast the camera flies; 1 at first.
    speed: f64,
}

impl State {
    pub(super) fn new() -> State {
        State {
            tuning: Tuning::default(),
            is_panel_open: true,
            message: String::new(),
            scene: None,
            framing: None,
            controls: Controls::default(),
            camera: None,
            refused: None,
            speed: 1.0,
        }
    }

    pub(super) fn speed(&self) -> f64 {
        self.speed
    }

    /// Whether the camera moves by itself, so that [`tick`](Self::tick) is to be called.
    pub(super) fn is_moving(&self) -> bool {
        self.controls.flight().is_some() || self.controls.orbit().is_some()
    }

    /// Moves the camera by what is held down for some seconds. Whether it was.
    pub(super) fn tick(&mut self, seconds: f64) -> bool {
        let seconds = seconds.min(LONGEST_TICK);
        let (flight, orbit, speed) = (self.controls.flight(), self.controls.orbit(), self.speed);
        if flight.is_none() && orbit.is_none() {
            return false;
        }
        self.move_camera(|camera| {
            if let Some(way) = flight {
                camera.fly(way * (FLIGHT * speed * seconds * camera.distance()));
            }
            if let Some((right, up)) = orbit {
                camera.orbit(ROUND * right * seconds, ROUND * up * seconds);
            }
        })
    }

    /// What an input does.
    pub(super) fn hear(&mut self, input: Input) -> Effect {
        let Some(wish) = self.controls.hear(input) else { return Effect::Nothing };
        let is_moved = |moved| if moved { Effect::Render } else { Effect::Nothing };
        match wish {
            Wish::Look(right, up) => is_moved(self.move_camera(|camera| camera.look(right, up))),
            Wish::Orbit(right, up) => is_moved(self.move_camera(|camera| camera.orbit(right, up))),
            Wish::Zoom(notches) => is_moved(self.move_camera(|camera| camera.zoom(notches))),
            Wish::Speed(notches) => {
                self.speed = (self.speed * SPEED_STEP.powf(f64::from(notches))).clamp(1e-3, 1e3);
                Effect::Redraw
            }
            Wish::Panel => {
                self.is_panel_open = !self.is_panel_open;
                Effect::Redraw
            }
            Wish::Save => Effect::Save,
            Wish::CopyCommand => Effect::CopyCommand,
            Wish::Capture(is_captured) => Effect::Capture(is_captured),
            Wish::Quit => Effect::Quit,
            Wish::Reset => {
                (self.camera, self.tuning.pose) = (None, None);
                Effect::Render
            }
            wish => self.tune(wish),
        }
    }

    /// A wish that concerns the settings.
    fn tune(&mut self, wish: Wish) -> Effect {
        let Some(scene) = &self.scene else { return Effect::Nothing };
        let before = self.tuning.clone();
        let (settings, tuning) = (&scene.settings, &mut self.tuning);
        match wish {
            Wish::Scale(steps) => tuning.step_scale(steps, scene.exaggeration),
            Wish::Zero(steps) => tuning.zero = Some(scene.zeros.stepped(tuning.zero, steps)),
            Wish::Subdivisions(steps) => tuning.step_subdivisions(steps, scene.subdivisions),
            Wish::Auto => tuning.toggle_auto(settings, scene.subdivisions),
            Wish::Method => tuning.next_method(settings, self.refused.take()),
            Wish::Shade => tuning.next_shade(settings),
            Wish::Shadows => tuning.shadows = Some(!tuning.shadows.unwrap_or(settings.shadows)),
            Wish::Smooth => tuning.smooth = Some(!tuning.smooth.unwrap_or(settings.smooth)),
            Wish::Wrap => tuning.next_wrap(settings),
            Wish::LightHere => {
                let eye = self.framing.map(|framing| self.camera.map_or(framing.world_eye(), |c| c.eye()));
                self.move_light(|_, _| eye);
            }
            Wish::LightRound(steps) => {
                let turn = |position: DVec3, framing: &Framing| {
                    let axis = framing.camera.up.as_dvec3().normalize();
                    let turn = DQuat::from_axis_angle(axis, LIGHT_STEP * f64::from(steps));
                    let target = framing.world_target();
                    Some(target + turn * (position - target))
                };
                self.move_light(turn);
            }
            Wish::LightBack => tuning.light = None,
            // The camera has a key of its own.
            Wish::AsLoaded => *tuning = Tuning { pose: tuning.pose, ..Tuning::default() },
            // The others are no settings.
            _ => return Effect::Nothing,
        }
        if self.tuning == before { Effect::Nothing } else { Effect::Render }
    }

    /// Takes back what was `refused`, in favour of what is `kept`.
    pub(super) fn take_back(&mut self, refused: &Tuning, kept: &Tuning) {
        // Where another is wanted by now, that one is the method to go on from.
        if refused.method != kept.method && self.tuning.method == refused.method {
            self.refused = refused.method;
        }
        self.tuning.take_back(refused, kept);
    }

    /// The mouse cannot be held in the window: it is the pointer's, which drags.
    pub(super) fn release_mouse(&mut self) {
        self.controls.release();
    }

    /// The lights as they are now; empty where the camera's own light shines.
    pub(super) fn lights(&self) -> Vec<Light> {
        let base = self.scene.as_ref().map(|scene| self.tuning.settings(&scene.settings, (1, 1)).lights);
        base.unwrap_or_default()
    }

    /// Puts the first light elsewhere; it keeps its colour and its intensity.
    fn move_light(&mut self, to: impl Fn(DVec3, &Framing) -> Option<DVec3>) {
        let Some(framing) = self.framing else { return };
        let (key, space) = (key_light(&framing), framing.space);
        #[expect(clippy::cast_possible_truncation, reason = "rounded")]
        let in_world = |intensity: f32| space.world_intensity(intensity.into()) as f32;
        let first = self.lights().first().copied();
        let first = first.unwrap_or(Light {
            position: space.world(key.position.as_dvec3()),
            color: key.color,
            intensity: Some(in_world(key.intensity)),
        });
        let Some(position) = to(first.position, &framing) else { return };
        let usual = || in_world(intensity_for(space.point(first.position).as_vec3(), framing.target));
        let intensity = Some(first.intensity.unwrap_or_else(usual));
        self.tuning.light = Some(Light { position, intensity, ..first });
    }

    /// Moves the camera, from where the newest picture was taken at first. Not before there is one.
    fn move_camera(&mut self, change: impl FnOnce(&mut Camera)) -> bool {
        let camera = match (self.camera, self.framing, &self.scene) {
            (Some(camera), ..) => Some(camera),
            (None, Some(framing), Some(scene)) => {
                let view: &View = &scene.settings.view;
                Some(Camera::new(&framing, view))
            }
            _ => None,
        };
        let Some(mut camera) = camera else { return false };
        change(&mut camera);
        let is_moved = self.camera != Some(camera);
        self.camera = Some(camera);
        self.tuning.pose = Some(camera.pose());
        is_moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing::frame;
    use crate::scene::{HeightMap, Relief};
    use crate::space::RenderSpace;
    use emboss_kernels::interface::height_format;
    use winit::keyboard::KeyCode;

    fn key(key: KeyCode, is_down: bool) -> Input {
        Input::Key { key, is_down, is_repeat: false }
    }

    /// With a scene of one map and no light of its own.
    fn state() -> State {
        let settings = Settings::default();
        let framing = frame(&settings.view, &[], 1.5, &RenderSpace::default()).expect("a camera");
        let subdivisions = Subdivisions::Fixed(16);
        let map = HeightMap { format: height_format::UNORM8, ..HeightMap::flat(0.5) };
        let zeros = Zeros::of(&[Relief::new(map, 0.5, 1.0)]);
        let scene =
            SceneInfo { settings, triangles: 1, subdivisions, exaggeration: 1.0, scale: Some(0.5), zeros };
        State { scene: Some(scene), framing: Some(framing), ..State::new() }
    }

    #[test]
    fn nothing_is_tuned_before_the_scene_is_there() {
        let mut state = State::new();
        for code in [KeyCode::KeyM, KeyCode::Equal, KeyCode::KeyL, KeyCode::Period] {
            assert_eq!(state.hear(key(code, true)), Effect::Nothing);
        }
        state.hear(key(KeyCode::KeyW, true));
        assert!(!state.tick(0.01) && state.tuning == Tuning::default());
    }

    #[test]
    fn flight_goes_on_while_the_key_is_held_and_reset_ends_it() {
        let mut state = state();
        state.hear(key(KeyCode::KeyW, true));
        assert!(state.is_moving() && state.tick(0.05) && state.tick(0.05));
        let (first, pose) = (state.framing.expect("framed").world_eye(), state.tuning.pose.expect("posed"));
        let distance = first.distance(state.framing.expect("framed").world_target());
        // FLIGHT x distance a second, for a tenth of one.
        assert!((first.distance(pose.eye) - 0.1 * FLIGHT * distance).abs() < 1e-5);
        state.hear(key(KeyCode::KeyW, false));
        assert!(!state.is_moving());
        assert_eq!(state.hear(key(KeyCode::KeyR, true)), Effect::Render);
        assert_eq!(state.tuning, Tuning::default());
    }

    #[test]
    fn one_key_brings_back_what_was_loaded() {
        let mut state = state();
        for code in [KeyCode::BracketRight, KeyCode::Equal, KeyCode::KeyM, KeyCode::Period] {
            assert_eq!(state.hear(key(code, true)), Effect::Render);
        }
        assert_eq!(state.tuning.zero, Some(0.52));
        state.hear(Input::Wheel { notches: 1.0 });
        let pose = state.tuning.pose;
        assert_eq!(state.hear(key(KeyCode::Backspace, true)), Effect::Render);
        assert_eq!(state.tuning, Tuning { pose, ..Tuning::default() });
        assert!(pose.is_some() && state.hear(key(KeyCode::Backspace, true)) == Effect::Nothing);
    }

    /// The key comes past a method that cannot be loaded, and forgets it then.
    #[test]
    fn method_that_is_refused_is_passed() {
        let mut state = state();
        let kept = Tuning { method: Some(Method::GridWalk), ..Tuning::default() };
        let refused = Tuning { method: Some(Method::Tessellate), ..Tuning::default() };
        state.tuning = refused.clone();
        state.take_back(&refused, &kept);
        assert_eq!(state.tuning, kept);
        for method in [Method::BruteForce, Method::Inverse] {
            assert_eq!(state.hear(key(KeyCode::KeyM, true)), Effect::Render);
            state.hear(key(KeyCode::KeyM, false));
            assert_eq!(state.tuning.method, Some(method));
        }
        // It was refused too late: another is wanted.
        state.take_back(&refused, &kept);
        state.hear(key(KeyCode::KeyM, true));
        assert_eq!(state.tuning.method, Some(Method::Bump));
    }

    /// Where the system lends the mouse to no window a click is nothing, and a drag still goes round.
    #[test]
    fn mouse_that_cannot_be_held_drags() {
        let mut state = state();
        state.hear(Input::Button { is_down: true });
        assert_eq!(state.hear(Input::Button { is_down: false }), Effect::Capture(true));
        state.release_mouse();
        assert_eq!(state.hear(Input::Motion { x: 9.0, y: 9.0 }), Effect::Nothing);
        state.hear(Input::Button { is_down: true });
        assert_eq!(state.hear(Input::Pointer { x: 50.0, y: 0.0 }), Effect::Render);
        state.hear(Input::Button { is_down: false });
        assert_eq!(state.hear(key(KeyCode::Escape, true)), Effect::Quit);
    }

    #[test]
    fn light_stays_where_it_is_put() {
        let mut state = state();
        assert!(state.lights().is_empty());
        assert_eq!(state.hear(key(KeyCode::Period, true)), Effect::Render);
        let (light, framing) = (state.lights()[0], state.framing.expect("framed"));
        let key_light = key_light(&framing);
        assert_eq!(light.intensity, Some(key_light.intensity));
        let (target, key_light) = (framing.world_target(), key_light.position.as_dvec3());
        let (a, b) = (light.position.distance(target), key_light.distance(target));
        assert!((a - b).abs() < 1e-5 * a && light.position != key_light);
        state.hear(key(KeyCode::KeyL, true));
        assert_eq!(state.lights()[0].position, framing.world_eye());
        state.hear(key(KeyCode::KeyK, true));
        assert!(state.lights().is_empty());
    }
}
