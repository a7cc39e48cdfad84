//! What the window's system says, and when there is something to do without that.

use super::App;
use crate::view::input::Input;
use crate::view::screen::RETRY;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::event::{
    DeviceEvent, DeviceId, ElementState, MouseButton, MouseScrollDelta, StartCause, WindowEvent,
};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::PhysicalKey;
use winit::window::WindowId;

/// How often the camera moves while a key is held.
const TICK: Duration = Duration::from_millis(16);
/// How long a turn without an event lasts at least. On X11 the loop is also woken by answers to the thread that shows
/// pictures, and again until that thread has read them: it needs the processor for that.
const IDLE_TURN: Duration = Duration::from_micros(500);
/// What is below a notch of a touchpad, in pixels of the usual density.
const NOTCH: f64 = 40.0;

impl ApplicationHandler for App {
    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        self.is_idle_turn = matches!(cause, StartCause::WaitCancelled { .. });
        self.turn = match cause {
            // The system may have let it wait since then.
            StartCause::ResumeTimeReached { requested_resume, .. } => requested_resume,
            _ => Instant::now(),
        };
    }

    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_some() {
            return;
        }
        match self.open(event_loop) {
            Ok(open) => self.open = Some(open),
            Err(error) => self.fail(event_loop, error),
        }
        self.redraw();
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, (): ()) {
        self.is_idle_turn = false;
        self.take_outcome(event_loop);
        self.take_reports(event_loop);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.is_idle_turn = false;
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(_) => self.redraw(),
            WindowEvent::ScaleFactorChanged { scale_factor, inner_size_writer } => {
                self.take_density(scale_factor, inner_size_writer);
            }
            WindowEvent::Occluded(is_occluded) => self.occlude(is_occluded),
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.show() {
                    self.fail_to_present(event_loop, error);
                }
            }
            event => {
                let density = self.open.as_ref().map_or(1.0, |open| open.density);
                if let Some(input) = input_of(&event, density) {
                    self.hear(event_loop, input);
                }
            }
        }
    }

    fn device_event(&mut self, event_loop: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let DeviceEvent::MouseMotion { delta: (x, y) } = event {
            self.is_idle_turn = false;
            self.hear(event_loop, Input::Motion { x, y });
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if self.is_idle_turn {
            return std::thread::sleep(IDLE_TURN);
        }
        self.follow_script(event_loop);
        let elapsed = self.last_tick.elapsed();
        if !self.state.is_moving() {
            self.last_tick = Instant::now();
        } else if elapsed >= TICK {
            self.last_tick = Instant::now();
            if self.state.tick(elapsed.as_secs_f64()) {
                self.want();
            }
        }
        let now = Instant::now();
        if let Some(open) = &self.open
            && open.screen.due(now) == Some(now)
        {
            open.window.request_redraw();
        }
        self.set_title();
        event_loop.set_control_flow(self.next_turn());
        self.answers.add(self.turn.elapsed());
    }

    /// The window goes before its display does.
    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.open = None;
        self.clipboard = None;
    }
}

impl App {
    /// When there is something to do without an event.
    fn next_turn(&self) -> ControlFlow {
        let now = Instant::now();
        let picture = self.open.as_ref().and_then(|open| open.screen.due(now));
        let has_script = self.options.script.as_ref().is_some_and(|script| !script.is_done());
        let script = has_script.then(|| now + RETRY);
        let tick = self.state.is_moving().then(|| self.last_tick + TICK);
        let next = [picture, script, tick, self.title_due()].into_iter().flatten().min();
        next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil)
    }
}

/// What an event of the window means to the viewer, on a screen of so many times the usual density.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn input_of(event: &WindowEvent, density: f64) -> Option<Input> {
    match event {
        WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
            let PhysicalKey::Code(key) = event.physical_key else { return None };
            let (is_down, is_repeat) = (event.state == ElementState::Pressed, event.repeat);
            Some(Input::Key { key, is_down, is_repeat })
        }
        WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
            Some(Input::Button { is_down: *state == ElementState::Pressed })
        }
        WindowEvent::CursorMoved { position, .. } => {
            Some(Input::Pointer { x: position.x / density, y: position.y / density })
        }
        WindowEvent::MouseWheel { delta: MouseScrollDelta::LineDelta(_, y), .. } => {
            Some(Input::Wheel { notches: *y })
        }
        WindowEvent::MouseWheel { delta: MouseScrollDelta::PixelDelta(delta), .. } => {
            Some(Input::Wheel { notches: (delta.y / density / NOTCH) as f32 })
        }
        WindowEvent::Focused(false) => Some(Input::FocusLost),
        _ => None,
    }
}
