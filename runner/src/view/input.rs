//! What a user does, whether the window says so or a script.

use winit::keyboard::KeyCode;

/// Something that a user did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Input {
    /// A key went down or up. Keys are known by their place on the keyboard, so that they lie together on any.
    Key {
        key: KeyCode,
        is_down: bool,
        /// Whether it went down long ago, and the system says it again.
        is_repeat: bool,
    },
    /// The left button went down or up.
    Button { is_down: bool },
    /// The pointer is at this place in the window, in pixels of the usual density: the hand goes as far on any screen.
    Pointer { x: f64, y: f64 },
    /// The mouse was moved, whether the pointer can or not.
    Motion { x: f64, y: f64 },
    /// The wheel was turned, away from the user where it is above 0; 1 is a notch.
    Wheel { notches: f32 },
    /// Another window has the keyboard.
    FocusLost,
}

/// The keys that something listens to, with their names in scripts.
const NAMES: &[(&str, KeyCode)] = &[
    ("w", KeyCode::KeyW),
    ("a", KeyCode::KeyA),
    ("s", KeyCode::KeyS),
    ("d", KeyCode::KeyD),
    ("q", KeyCode::KeyQ),
    ("e", KeyCode::KeyE),
    ("space", KeyCode::Space),
    ("ctrl", KeyCode::ControlLeft),
    ("shift", KeyCode::ShiftLeft),
    ("left", KeyCode::ArrowLeft),
    ("right", KeyCode::ArrowRight),
    ("up", KeyCode::ArrowUp),
    ("down", KeyCode::ArrowDown),
    ("escape", KeyCode::Escape),
    ("tab", KeyCode::Tab),
    ("backspace", KeyCode::Backspace),
    ("minus", KeyCode::Minus),
    ("equal", KeyCode::Equal),
    ("bracketleft", KeyCode::BracketLeft),
    ("bracketright", KeyCode::BracketRight),
    ("pageup", KeyCode::PageUp),
    ("pagedown", KeyCode::PageDown),
    ("comma", KeyCode::Comma),
    ("period", KeyCode::Period),
    ("c", KeyCode::KeyC),
    ("h", KeyCode::KeyH),
    ("k", KeyCode::KeyK),
    ("l", KeyCode::KeyL),
    ("m", KeyCode::KeyM),
    ("n", KeyCode::KeyN),
    ("o", KeyCode::KeyO),
    ("p", KeyCode::KeyP),
    ("r", KeyCode::KeyR),
    ("v", KeyCode::KeyV),
    ("x", KeyCode::KeyX),
];

/// The key of a name.
pub(super) fn key_named(name: &str) -> Option<KeyCode> {
    NAMES.iter().find(|(known, _)| *known == name).map(|&(_, key)| key)
}
