//! The window.

mod steps;

use super::canvas::{Canvas, Font};
use super::input::Input;
use super::overlay::{self, Status};
use super::present::{self, Opened, PresentError, Presenter, Progress};
use super::renderer::{Handle, Reading, Report, Seen, Setup, Wanted};
use super::screen::{Delays, RETRY, Screen, UnderWay};
use super::state::{Effect, State};
use super::{Engine, Failure, Options, Shot, Source, ViewError};
use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{
    DeviceEvent, DeviceId, ElementState, MouseButton, MouseScrollDelta, StartCause, WindowEvent,
};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::PhysicalKey;
use winit::window::{CursorGrabMode, Window, WindowId};

/// How often the camera moves while a key is held.
const TICK: Duration = Duration::from_millis(16);
/// How often the window's title changes.
const TITLE: Duration = Duration::from_millis(250);
/// How long a step of a script waits.
const SCRIPT_PATIENCE: Duration = Duration::from_secs(120);
/// How long a turn without an event lasts at least. On X11 the loop is also woken by answers to the thread that shows
/// pictures, and again until that thread has read them: it needs the processor for that.
const IDLE_TURN: Duration = Duration::from_micros(500);
/// What is below a notch of a touchpad, in pixels.
const NOTCH: f64 = 40.0;

/// Opens the window and stays until it is closed.
pub(super) fn run(source: Arc<dyn Source>, options: Options) -> Result<(), ViewError> {
    let event_loop = EventLoop::new().map_err(|error| {
        // Winit says in which line of its source the system said it.
        let error = error.to_string();
        let reason = error.rsplit(": ").next().unwrap_or(&error).trim_end_matches('.').to_owned();
        ViewError::NoDisplay { reason }
    })?;
    let reading = Reading::start(&source);
    let mut app = App::new(source, reading, options, event_loop.create_proxy());
    let ended = event_loop.run_app(&mut app);
    tracing::debug!("the window answered: {}; pictures were shown: {}", app.answers, app.showings);
    match (app.error, ended) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(ViewError::Window { reason: error.to_string() }),
        (None, Ok(())) => Ok(()),
    }
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

struct App {
    source: Arc<dyn Source>,
    /// The scene, until the thread that renders has it.
    reading: Option<Reading>,
    options: Options,
    proxy: EventLoopProxy<()>,
    state: State,
    status: Status,
    open: Option<Open>,
    /// The newest picture.
    seen: Option<Seen>,
    /// Counts what was wanted so far.
    serial: u64,
    /// How many pictures were shown.
    shown: u32,
    /// Of a step of the script that waits: how many there were at its beginning.
    shown_before: Option<u32>,
    /// When it began.
    step_since: Option<Instant>,
    clipboard: Option<arboard::Clipboard>,
    last_tick: Instant,
    /// When the title was set last.
    last_title: Option<Instant>,
    /// Whether it says what was so before.
    is_title_stale: bool,
    /// When the first was due of what is being done.
    turn: Instant,
    /// Whether nothing has happened in this turn.
    is_idle_turn: bool,
    /// From an event until the next can be heard, since the first picture.
    answers: Delays,
    /// From when there is something to show until it is shown, since then.
    showings: Delays,
    error: Option<ViewError>,
}

/// What there is while the window is open. The thread ends first, then what shows its pictures.
struct Open {
    /// Whether the window's system says that nobody sees it. On X11 a minimised window keeps its size.
    is_out_of_sight: bool,
    renderer: Handle,
    reports: Receiver<Report>,
    presenter: Box<dyn Presenter>,
    window: Arc<Window>,
    engine: Engine,
    screen: Screen,
}

impl Drop for Open {
    /// The window closes at once, though the thread may have to finish something first. Where the system hides no
    /// windows it goes when the thread has ended.
    fn drop(&mut self) {
        self.renderer.quit();
        self.window.set_visible(false);
    }
}

impl App {
    fn new(source: Arc<dyn Source>, reading: Reading, options: Options, proxy: EventLoopProxy<()>) -> App {
        App {
            source,
            reading: Some(reading),
            options,
            proxy,
            state: State::new(),
            status: Status::default(),
            open: None,
            seen: None,
            serial: 0,
            shown: 0,
            shown_before: None,
            step_since: None,
            clipboard: None,
            last_tick: Instant::now(),
            last_title: None,
            is_title_stale: true,
            turn: Instant::now(),
            is_idle_turn: false,
            answers: Delays::default(),
            showings: Delays::default(),
            error: None,
        }
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Open, ViewError> {
        let options = &self.options;
        let size = PhysicalSize::new(options.size.0, options.size.1);
        let attributes = Window::default_attributes().with_title(&options.title).with_inner_size(size);
        let failed = |error: winit::error::OsError| ViewError::Window { reason: error.to_string() };
        let window = Arc::new(event_loop.create_window(attributes).map_err(failed)?);
        let proxy = self.proxy.clone();
        // Where the loop has ended nobody waits for it.
        let wake = move || proxy.send_event(()).unwrap_or_default();
        let opened = present::open(&window, options, wake)?;
        let Opened { presenter, start, engine, device: name } = opened;
        let took = milliseconds(options.start.elapsed());
        tracing::debug!("the window was open, with what shows pictures in it, after {took:.0} ms");
        self.status.device = name;
        let (sender, reports) = channel();
        let proxy = self.proxy.clone();
        let report = Arc::new(move |report| {
            // Where the window is gone no one wants to know.
            let _ = sender.send(report);
            let _ = proxy.send_event(());
        });
        let renderer = Handle::start(Setup {
            start,
            engine: engine.clone(),
            is_replaceable: present::is_replaceable(options.backend, options.device.as_deref()),
            source: Arc::clone(&self.source),
            reading: self.reading.take().unwrap_or_else(|| Reading::start(&self.source)),
            samples: options.samples,
            output: options.output.clone(),
            report,
        });
        Ok(Open {
            is_out_of_sight: false,
            renderer,
            reports,
            presenter,
            window,
            engine,
            screen: Screen::new(),
        })
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: ViewError) {
        self.error.get_or_insert(error);
        event_loop.exit();
    }

    /// Asks the renderer for what is to be seen now.
    fn want(&mut self) {
        let Some(open) = &self.open else { return };
        let Some(size) = open.screen.size else { return };
        self.serial += 1;
        open.renderer.want(Wanted { serial: self.serial, tuning: self.state.tuning.clone(), size });
    }

    /// The window's system says whether anyone can see the window.
    fn is_seen(&mut self, is_seen: bool) {
        if let Some(open) = &mut self.open {
            open.is_out_of_sight = !is_seen;
        }
        self.redraw();
    }

    fn redraw(&mut self) {
        if let Some(open) = &mut self.open {
            open.screen.ask(Instant::now());
            if !open.screen.is_busy() {
                open.window.request_redraw();
            }
        }
    }

    fn hear(&mut self, event_loop: &ActiveEventLoop, input: Input) {
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
    fn command(&self) -> Option<String> {
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

    /// Takes what the renderer has told.
    fn take_reports(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &self.open else { return };
        let reports: Vec<_> = open.reports.try_iter().collect();
        for report in reports {
            match report {
                Report::Loaded(scene) => self.state.scene = Some(*scene),
                Report::Message(message) => self.state.message = message,
                Report::Kept(tunings) => self.state.take_back(&tunings[0], &tunings[1]),
                Report::Replaced => self.replace(event_loop),
                Report::Refused(error) => self.fail(event_loop, *error),
                Report::Lost(failure) => self.lose(event_loop, *failure),
                Report::Seen(seen) => {
                    self.state.framing = Some(seen.framing);
                    self.status.samples = seen.samples;
                    self.status.frame_ms = seen.frame_ms;
                    self.status.rays_per_second = seen.rays_per_second;
                    self.seen = Some(*seen);
                }
            }
            self.redraw();
        }
        self.is_title_stale = true;
    }

    /// The CPU renders in place of the device, which may be of no more use to show pictures either.
    fn replace(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        match present::on_cpu(&open.window) {
            Ok(Opened { presenter, engine, device, .. }) => {
                (open.presenter, open.engine) = (presenter, engine);
                // What becomes of it nobody will tell.
                open.screen.arrived(false, Instant::now());
                self.status.device = device;
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    /// When the title may change again, if it has to.
    fn title_due(&self) -> Option<Instant> {
        self.is_title_stale.then(|| self.last_title.map_or_else(Instant::now, |last| last + TITLE))
    }

    fn set_title(&mut self) {
        if self.title_due().is_none_or(|due| due > Instant::now()) {
            return;
        }
        (self.last_title, self.is_title_stale) = (Some(Instant::now()), false);
        // Of a window that is minimised X11 tells nothing until it is seen again.
        let is_minimized = self.open.as_ref().and_then(|open| open.window.is_minimized());
        if is_minimized == Some(true) {
            self.is_seen(false);
        }
        if let Some(open) = &self.open {
            open.window.set_title(&overlay::title(&self.options.title, &self.state, &self.status));
        }
    }

    /// Shows the newest picture with the panel.
    fn show(&mut self) -> Result<(), PresentError> {
        let Some(open) = self.open.as_mut() else { return Ok(()) };
        if open.screen.is_busy() {
            // The window's system wants it again: what is under way may be there before that.
            open.screen.ask(Instant::now());
            return Ok(());
        }
        let was_hidden = open.screen.is_hidden;
        let size = if open.is_out_of_sight { None } else { open.presenter.size()? };
        let is_other = open.screen.takes(size);
        let is_hidden = open.screen.is_hidden;
        if was_hidden != is_hidden {
            open.renderer.hide(is_hidden);
        }
        if is_other {
            self.want();
        }
        if is_hidden {
            return Ok(());
        }
        let canvas = self.compose();
        if let (Some(canvas), Some(open)) = (canvas, &mut self.open) {
            open.screen.hand_over(self.seen.is_some(), Instant::now());
            let progress = open.presenter.show(canvas)?;
            self.note(progress);
        }
        Ok(())
    }

    /// Takes what became of the picture that was under way.
    fn take_outcome(&mut self, event_loop: &ActiveEventLoop) {
        let outcome = self.open.as_mut().map(|open| open.presenter.outcome());
        match outcome {
            Some(Ok(Some(progress))) => self.note(progress),
            Some(Err(error)) => self.fail_to_present(event_loop, error),
            Some(Ok(None)) | None => {}
        }
    }

    /// Counts pictures that are shown, from the first one of the model.
    fn note(&mut self, progress: Progress) {
        let Some(open) = &mut self.open else { return };
        if progress == Progress::UnderWay {
            return;
        }
        let now = Instant::now();
        let arrived = open.screen.arrived(progress == Progress::Shown, now);
        let Some(UnderWay { asked, is_of_model: true }) = arrived else { return };
        if self.shown == 0 {
            let took = self.options.start.elapsed();
            tracing::debug!("the first picture was shown after {:.0} ms", milliseconds(took));
            (self.answers, self.showings) = (Delays::default(), Delays::default());
            self.turn = now;
        } else {
            self.showings.add(now - asked);
        }
        self.shown += 1;
    }

    /// The newest picture with the panel, of the size that the window takes.
    fn compose(&self) -> Option<Canvas> {
        let open = self.open.as_ref()?;
        let (width, height) = open.screen.size?;
        let nothing = Canvas::default();
        let picture = self.seen.as_ref().map_or(&nothing, |seen| &seen.canvas);
        let mut canvas = picture.scaled(width, height);
        if self.state.is_panel_open {
            let font = Font::for_scale(open.window.scale_factor());
            overlay::draw(&mut canvas, font, &self.state, &self.status);
        }
        Some(canvas)
    }

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
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.redraw(),
            WindowEvent::Occluded(is_occluded) => self.is_seen(!is_occluded),
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.show() {
                    self.fail_to_present(event_loop, error);
                }
            }
            event => {
                if let Some(input) = input_of(&event) {
                    self.hear(event_loop, input);
                }
            }
        }
    }

    fn device_event(&mut self, event_loop: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let DeviceEvent::MouseMotion { delta: (x, y) } = event {
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
    fn fail_to_present(&mut self, event_loop: &ActiveEventLoop, error: PresentError) {
        match error {
            PresentError::Window(reason) => self.fail(event_loop, ViewError::Window { reason }),
            PresentError::Backend(source) => self.lose(event_loop, source.into()),
        }
    }

    /// Ends with what was seen last, so that nothing is lost.
    fn lose(&mut self, event_loop: &ActiveEventLoop, failure: Failure) {
        let command = self.command().unwrap_or_default();
        self.fail(event_loop, ViewError::Lost { failure, command });
    }
}

/// What an event of the window means to the viewer.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn input_of(event: &WindowEvent) -> Option<Input> {
    match event {
        WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
            let PhysicalKey::Code(key) = event.physical_key else { return None };
            let (is_down, is_repeat) = (event.state == ElementState::Pressed, event.repeat);
            Some(Input::Key { key, is_down, is_repeat })
        }
        WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
            Some(Input::Button { is_down: *state == ElementState::Pressed })
        }
        WindowEvent::CursorMoved { position, .. } => Some(Input::Pointer { x: position.x, y: position.y }),
        WindowEvent::MouseWheel { delta: MouseScrollDelta::LineDelta(_, y), .. } => {
            Some(Input::Wheel { notches: *y })
        }
        WindowEvent::MouseWheel { delta: MouseScrollDelta::PixelDelta(delta), .. } => {
            Some(Input::Wheel { notches: (delta.y / NOTCH) as f32 })
        }
        WindowEvent::Focused(false) => Some(Input::FocusLost),
        _ => None,
    }
}
