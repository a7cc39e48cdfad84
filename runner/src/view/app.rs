//! The window.

mod actions;
mod events;
mod showing;
mod steps;

use super::overlay::Status;
use super::present::{self, Opened, Presenter};
use super::renderer::{Handle, Reading, Report, Seen, Setup, Wanted};
use super::screen::{Delays, Screen};
use super::state::State;
use super::{Engine, Failure, Options, Source, ViewError};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use winit::dpi::PhysicalSize;
use winit::event_loop::{ActiveEventLoop, EventLoop, EventLoopProxy};
use winit::window::Window;

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
    /// Whether the window's system says that nobody sees it.
    is_occluded: bool,
    /// Whether it is minimised, which is asked for: it may keep its size, and nothing may be said of it.
    is_minimized: bool,
    /// How many times the usual density the window's screen has, as was told last: what the window itself says may be
    /// older.
    density: f64,
    renderer: Handle,
    reports: Receiver<Report>,
    presenter: Box<dyn Presenter>,
    window: Arc<Window>,
    engine: Engine,
    screen: Screen,
}

impl Open {
    /// Has another one show pictures from now on. What becomes of the one that is under way nobody will tell.
    fn present_by(&mut self, presenter: Box<dyn Presenter>) {
        self.presenter = presenter;
        self.screen.arrived(false, Instant::now());
    }
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
            is_occluded: false,
            is_minimized: false,
            density: window.scale_factor(),
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
                open.engine = engine;
                open.present_by(presenter);
                self.status.device = device;
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    /// Ends with what was seen last, so that nothing is lost.
    fn lose(&mut self, event_loop: &ActiveEventLoop, failure: Failure) {
        let command = self.command().unwrap_or_default();
        self.fail(event_loop, ViewError::Lost { failure, command });
    }
}
