//! What a user asks for, done.

use super::App;
use crate::view::Shot;
use crate::view::input::Input;
use crate::view::state::Effect;
use std::io::Write;
use winit::event_loop::ActiveEventLoop;
use winit::window::CursorGrabMode;

impl App {
    pub(super) fn hear(&mut self, event_loop: &ActiveEventLoop, input: Input) {
        match self.state.hear(input) {
            Effect::Nothing => {}
            Effect::Render => {
                self.want();
                self.redraw();
            }
            Effect::Redraw => self.redraw(),
            Effect::Save => {
                if let Some(open) = &self.open {
                    open.renderer.save();
                }
            }
            Effect::CopyCommand => self.copy_command(),
            Effect::Capture(is_captured) => self.capture(is_captured),
            Effect::Quit => event_loop.exit(),
        }
    }

    /// The command line of what is wanted now.
    pub(super) fn command(&self) -> Option<String> {
        let (open, lights) = (self.open.as_ref()?, self.state.lights());
        Some(self.source.command(&Shot {
            tuning: &self.state.tuning,
            lights: &lights,
            size: open.screen.size.unwrap_or(self.options.size),
            samples: self.status.samples.max(1),
            engine: &open.engine,
            output: None,
        }))
    }

    /// The command line of what is seen, in the terminal and on the clipboard.
    fn copy_command(&mut self) {
        let Some(command) = self.command() else { return };
        // A terminal that is closed is no reason to end.
        let _ = writeln!(std::io::stdout(), "{command}");
        let copied = match &mut self.clipboard {
            Some(clipboard) => clipboard.set_text(command),
            // Kept: on X11 what was copied is there for as long as its program.
            none => arboard::Clipboard::new().and_then(|new| none.insert(new).set_text(command)),
        };
        self.state.message = match copied {
            Ok(()) => "copied the command line, and printed it".to_owned(),
            Err(error) => format!("printed the command line; it could not be copied ({error})"),
        };
        self.redraw();
    }

    fn capture(&mut self, is_captured: bool) {
        let Some(open) = &self.open else { return };
        let window = &open.window;
        let grabbed = if is_captured {
            window
                .set_cursor_grab(CursorGrabMode::Locked)
                .or_else(|_| window.set_cursor_grab(CursorGrabMode::Confined))
        } else {
            window.set_cursor_grab(CursorGrabMode::None)
        };
        let is_held = is_captured && grabbed.is_ok();
        window.set_cursor_visible(!is_held);
        if let Err(error) = grabbed {
            tracing::debug!("the mouse cannot be held in the window: {error}");
            self.state.release_mouse();
        }
        self.redraw();
    }
}
