//! Which key does what.

use super::input::Input;
use glam::DVec3;
use winit::keyboard::KeyCode;

/// How far the pointer goes between press and release of a click, in pixels.
const CLICK: f64 = 4.0;
/// How far a pixel of the mouse's way turns the camera, in radians.
const TURN: f64 = 0.004;

/// What is asked for by an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wish {
    /// Look further right and up, in radians.
    Look(f64, f64),
    /// Go round what is looked at, to the right and up, in radians.
    Orbit(f64, f64),
    /// A narrower field of view, by notches of the wheel.
    Zoom(f32),
    /// Another speed of flight, by notches of the wheel.
    Speed(f32),
    /// Higher scales, by steps.
    Scale(i32),
    /// A higher zero, by steps.
    Zero(i32),
    /// A doubled N, or a halved one.
    Subdivisions(i32),
    /// N follows the camera, or no longer.
    Auto,
    Method,
    Shade,
    Shadows,
    Smooth,
    Wrap,
    /// The light where the camera is.
    LightHere,
    /// The light further round the model, by steps.
    LightRound(i32),
    /// The scene's own light.
    LightBack,
    /// All settings as they were loaded.
    AsLoaded,
    /// The camera that shows all.
    Reset,
    Panel,
    Save,
    CopyCommand,
    /// The mouse is the camera's, or the pointer's again.
    Capture(bool),
    Quit,
}

/// What is held down.
#[derive(Clone, Debug, Default)]
pub(super) struct Controls {
    held: Vec<KeyCode>,
    is_captured: bool,
    pointer: (f64, f64),
    press: Option<Press>,
}

/// The left button since it went down.
#[derive(Clone, Copy, Debug)]
struct Press {
    /// Where it did.
    start: (f64, f64),
    /// Whether the pointer has left that place.
    is_drag: bool,
}

impl Controls {
    /// What an input asks for.
    pub(super) fn hear(&mut self, input: Input) -> Option<Wish> {
        match input {
            Input::Key { key, is_down, is_repeat } => self.key(key, is_down, is_repeat),
            Input::Button { is_down } => self.button(is_down),
            Input::Pointer { x, y } => self.pointer_at(x, y),
            Input::Motion { x, y } => self.is_captured.then(|| Wish::Look(TURN * x, -TURN * y)),
            Input::Wheel { notches } if self.is_captured => Some(Wish::Speed(notches)),
            Input::Wheel { notches } => Some(Wish::Zoom(notches)),
            Input::FocusLost => {
                self.held.clear();
                self.press = None;
                self.release()
            }
        }
    }

    /// Which way the camera flies: to the right, up and forward, longer with shift. `None` where it does not.
    pub(super) fn flight(&self) -> Option<DVec3> {
        let any = |keys: &[KeyCode]| f64::from(u8::from(keys.iter().any(|key| self.held.contains(key))));
        let way = DVec3::new(
            any(&[KeyCode::KeyD]) - any(&[KeyCode::KeyA]),
            any(&[KeyCode::KeyE, KeyCode::Space])
                - any(&[KeyCode::KeyQ, KeyCode::ControlLeft, KeyCode::ControlRight]),
            any(&[KeyCode::KeyW]) - any(&[KeyCode::KeyS]),
        );
        let pace = if any(&[KeyCode::ShiftLeft, KeyCode::ShiftRight]) > 0.0 { 5.0 } else { 1.0 };
        (way != DVec3::ZERO).then(|| pace * way.normalize())
    }

    /// Which way the camera goes round: to the right and up, 1 each. `None` where it does not.
    pub(super) fn orbit(&self) -> Option<(f64, f64)> {
        let held = |key| f64::from(u8::from(self.held.contains(&key)));
        let right = held(KeyCode::ArrowRight) - held(KeyCode::ArrowLeft);
        let up = held(KeyCode::ArrowUp) - held(KeyCode::ArrowDown);
        ((right, up) != (0.0, 0.0)).then_some((right, up))
    }

    fn key(&mut self, key: KeyCode, is_down: bool, is_repeat: bool) -> Option<Wish> {
        self.held.retain(|&held| held != key);
        if !is_down {
            return None;
        }
        self.held.push(key);
        match key {
            KeyCode::Minus => return Some(Wish::Scale(-1)),
            KeyCode::Equal => return Some(Wish::Scale(1)),
            KeyCode::BracketLeft => return Some(Wish::Zero(-1)),
            KeyCode::BracketRight => return Some(Wish::Zero(1)),
            KeyCode::Comma => return Some(Wish::LightRound(-1)),
            KeyCode::Period => return Some(Wish::LightRound(1)),
            _ => {}
        }
        if is_repeat {
            return None;
        }
        match key {
            KeyCode::PageUp => Some(Wish::Subdivisions(1)),
            KeyCode::PageDown => Some(Wish::Subdivisions(-1)),
            KeyCode::KeyN => Some(Wish::Auto),
            KeyCode::KeyM => Some(Wish::Method),
            KeyCode::KeyV => Some(Wish::Shade),
            KeyCode::KeyH => Some(Wish::Shadows),
            KeyCode::KeyO => Some(Wish::Smooth),
            KeyCode::KeyX => Some(Wish::Wrap),
            KeyCode::KeyL => Some(Wish::LightHere),
            KeyCode::KeyK => Some(Wish::LightBack),
            KeyCode::Backspace => Some(Wish::AsLoaded),
            KeyCode::KeyR => Some(Wish::Reset),
            KeyCode::Tab => Some(Wish::Panel),
            KeyCode::KeyP => Some(Wish::Save),
            KeyCode::KeyC => Some(Wish::CopyCommand),
            KeyCode::Escape => self.release().or(Some(Wish::Quit)),
            _ => None,
        }
    }

    /// The mouse is the pointer's again, if it was not.
    pub(super) fn release(&mut self) -> Option<Wish> {
        std::mem::take(&mut self.is_captured).then_some(Wish::Capture(false))
    }

    /// A click captures the mouse; a drag does not.
    fn button(&mut self, is_down: bool) -> Option<Wish> {
        if is_down {
            self.press = Some(Press { start: self.pointer, is_drag: false });
            return None;
        }
        let was_click = self.press.take().is_some_and(|press| !press.is_drag);
        if !was_click || self.is_captured {
            return None;
        }
        self.is_captured = true;
        Some(Wish::Capture(true))
    }

    fn pointer_at(&mut self, x: f64, y: f64) -> Option<Wish> {
        let (right, down) = (x - self.pointer.0, y - self.pointer.1);
        self.pointer = (x, y);
        let press = self.press.as_mut().filter(|_| !self.is_captured)?;
        press.is_drag |= (x - press.start.0).hypot(y - press.start.1) > CLICK;
        // The model follows the pointer: the camera goes the other way.
        press.is_drag.then_some(Wish::Orbit(-TURN * right, TURN * down))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(key: KeyCode, is_down: bool) -> Input {
        Input::Key { key, is_down, is_repeat: false }
    }

    #[test]
    fn flight_adds_up_what_is_held() {
        let mut controls = Controls::default();
        assert_eq!(controls.flight(), None);
        controls.hear(key(KeyCode::KeyW, true));
        controls.hear(key(KeyCode::KeyA, true));
        let way = controls.flight().expect("it flies");
        assert!((way - DVec3::new(-1.0, 0.0, 1.0).normalize()).length() < 1e-12);
        controls.hear(key(KeyCode::KeyD, true));
        controls.hear(key(KeyCode::ShiftLeft, true));
        assert_eq!(controls.flight(), Some(DVec3::Z * 5.0));
        controls.hear(Input::FocusLost);
        assert_eq!(controls.flight(), None);
    }

    #[test]
    fn click_captures_and_escape_releases_before_it_quits() {
        let mut controls = Controls::default();
        assert_eq!(controls.hear(Input::Motion { x: 9.0, y: 0.0 }), None);
        controls.hear(Input::Pointer { x: 100.0, y: 100.0 });
        controls.hear(Input::Button { is_down: true });
        controls.hear(Input::Pointer { x: 102.0, y: 100.0 });
        assert_eq!(controls.hear(Input::Button { is_down: false }), Some(Wish::Capture(true)));
        assert!(matches!(controls.hear(Input::Motion { x: 9.0, y: 0.0 }), Some(Wish::Look(..))));
        assert_eq!(controls.hear(Input::Wheel { notches: 1.0 }), Some(Wish::Speed(1.0)));
        assert_eq!(controls.hear(key(KeyCode::Escape, true)), Some(Wish::Capture(false)));
        controls.hear(key(KeyCode::Escape, false));
        assert_eq!(controls.hear(key(KeyCode::Escape, true)), Some(Wish::Quit));
    }

    #[test]
    fn drag_goes_round_without_capture() {
        let mut controls = Controls::default();
        controls.hear(Input::Pointer { x: 0.0, y: 0.0 });
        controls.hear(Input::Button { is_down: true });
        let wish = controls.hear(Input::Pointer { x: 50.0, y: 25.0 });
        assert_eq!(wish, Some(Wish::Orbit(-TURN * 50.0, TURN * 25.0)));
        assert_eq!(controls.hear(Input::Button { is_down: false }), None, "no click");
        assert_eq!(controls.hear(Input::Pointer { x: 0.0, y: 0.0 }), None);
        assert_eq!(controls.hear(Input::Wheel { notches: -1.0 }), Some(Wish::Zoom(-1.0)));
    }

    #[test]
    fn scale_repeats_and_switches_do_not() {
        let mut controls = Controls::default();
        let again = |key| Input::Key { key, is_down: true, is_repeat: true };
        assert_eq!(controls.hear(again(KeyCode::Equal)), Some(Wish::Scale(1)));
        assert_eq!(controls.hear(again(KeyCode::KeyM)), None);
        assert_eq!(controls.hear(key(KeyCode::KeyM, true)), Some(Wish::Method));
    }
}
