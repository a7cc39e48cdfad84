//! The thread that renders.

mod loading;
mod thread;

pub(super) use thread::{Handle, Reading, Setup, Start};

use super::canvas::Canvas;
use super::reload::Watcher;
use super::state::SceneInfo;
use super::tuning::Tuning;
use super::{Engine, Failure, Shot, Source, Unread, ViewError};
use crate::backend::cpu::CpuBackend;
use crate::backend::select::can_be_replaced;
use crate::backend::{Backend, BackendError};
use crate::framing::{self, Framing};
use crate::picture::{Destination, Picture};
use crate::render::{Job, RenderError};
use crate::reports::{Undersampled, Useless};
use crate::settings::Subdivisions;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::Frame;
use loading::{Ready, load};
use std::mem::Discriminant;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use thread::{Ended, Read, Shared};

/// What the first pass after a change should take: films get as many pixels as that allows.
const PREVIEW: Duration = Duration::from_millis(30);
/// How long the first pass goes on though something has changed again: were it always broken off, a camera that moves
/// would show nothing.
const PATIENCE: Duration = Duration::from_millis(200);
/// A film has at least 1/2^LEAST_LEVEL of the window's columns and rows.
const LEAST_LEVEL: u32 = 5;
/// The level at first, when nothing was measured: the built-in scene's 2,700 pixels of a window of 960 x 720 take 0.2 s
/// on lavapipe.
const FIRST_LEVEL: u32 = 4;
/// How often pictures come while samples are added: as often as screens show them.
const REFRESH: Duration = Duration::from_millis(16);
/// A picture of so many samples is one at which the camera rests.
const RESTED: u32 = 2;
/// Share of the time that goes into making pictures of the film, at most.
const RESOLVING: u32 = 4;

/// What is to be seen.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    /// Counts what was wanted so far.
    pub(super) serial: u64,
    pub(super) tuning: Tuning,
    pub(super) size: (u32, u32),
}

/// What the thread tells.
#[derive(Debug)]
pub(super) enum Report {
    Loaded(Box<SceneInfo>),
    Seen(Box<Seen>),
    Message(String),
    /// What was wanted cannot be loaded: what of it is as the first is again as the second.
    Kept(Box<[Tuning; 2]>),
    /// The device could not be used, and the CPU renders in its place.
    Replaced,
    /// There is nothing to render. It has ended.
    Refused(Box<ViewError>),
    /// It has ended.
    Lost(Box<Failure>),
}

/// A picture.
#[derive(Debug)]
pub(super) struct Seen {
    /// Of what was wanted.
    pub(super) serial: u64,
    pub(super) canvas: Canvas,
    /// Samples of a pixel; 0 where there are fewer pixels than were wanted.
    pub(super) samples: u32,
    pub(super) framing: Framing,
    /// What a pass over all pixels takes, as far as is known.
    pub(super) frame_ms: f64,
    pub(super) rays_per_second: f64,
}

/// Renders until it is told to quit.
fn run(setup: Setup, shared: &Arc<Shared>) -> Result<(), Ended> {
    let Setup { start, mut engine, is_replaceable, source, reading, samples, output, report } = setup;
    let wanted = loop {
        let orders = shared.take(true);
        if orders.quit {
            return Ok(());
        }
        if let Some(wanted) = orders.wanted {
            break wanted;
        }
    };
    let began = Instant::now();
    let mut backend = match start() {
        Err(error) if is_replaceable && can_be_replaced(&error) => {
            tracing::info!("rendering on the CPU: {error}");
            engine = Engine::CPU;
            report(Report::Replaced);
            Box::new(CpuBackend::new())
        }
        started => started.map_err(RenderError::from)?,
    };
    let started = Instant::now();
    let Some(loaded) = reading.wait(shared)? else { return Ok(()) };
    let waited = Instant::now();
    let read = Read { loaded, zero: None };
    let Some(ready) = load(backend.as_mut(), &read.loaded, &wanted, shared)? else { return Ok(()) };
    let Ready { job, boxes, undersampled } = ready;
    tracing::debug!(
        "making the device ready took {:.0?}, waiting for the scene {:.0?}, loading it {:.0?}",
        started - began,
        waited - started,
        waited.elapsed()
    );
    let watcher = watch(&source, shared, &report).inspect_err(|error| {
        tracing::warn!("changes of the files will not be seen ({error})");
    });
    let pass = Pass { level: 0, sample: 0, is_first: true, is_looked_at: false };
    let mut renderer = Renderer {
        source,
        engine,
        samples,
        output,
        shared,
        report: report.as_ref(),
        backend,
        watcher: watcher.ok(),
        read,
        job,
        boxes,
        undersampled,
        told: Told::default(),
        wanted,
        pass,
        framing: None,
        pace: None,
        seen: None,
        is_to_be_saved: false,
    };
    renderer.tell_loaded();
    renderer.tell_undersampled();
    renderer.begin()?;
    Ok(renderer.work()?)
}

/// Reads the scene whenever its files have changed, beside the thread that renders: what is half written breaks off
/// nothing.
fn watch(
    source: &Arc<dyn Source>,
    shared: &Arc<Shared>,
    report: &Arc<dyn Fn(Report) + Send + Sync>,
) -> notify::Result<Watcher> {
    let (source, shared, report) = (Arc::clone(source), Arc::clone(shared), Arc::clone(report));
    Watcher::new(move || {
        let zero = *shared.zero();
        match source.read(zero) {
            Ok(loaded) => {
                shared.order(true, |orders| orders.read = Some(Read { loaded, zero }));
                None
            }
            Err(Unread { error, file }) => {
                let message = format!("the files have changed, but the scene stays as it was: {error}");
                tracing::info!("{message}");
                report(Report::Message(message));
                file
            }
        }
    })
}

/// Where the rendering is.
#[derive(Clone, Copy, Debug)]
struct Pass {
    /// The film has 1/2^level of the window's columns and rows.
    level: u32,
    /// The number of the sample; with a level above 0 it is 0.
    sample: u32,
    /// Whether nothing was seen of what is wanted.
    is_first: bool,
    /// Whether it was found out if the picture shows anything.
    is_looked_at: bool,
}

/// What was said last of pictures that show less than was meant.
#[derive(Default)]
struct Told {
    undersampled: Vec<Undersampled>,
    useless: Option<Discriminant<Useless>>,
}

struct Renderer<'a> {
    source: Arc<dyn Source>,
    engine: Engine,
    samples: u32,
    output: Destination,
    shared: &'a Shared,
    report: &'a dyn Fn(Report),
    backend: Box<dyn Backend>,
    /// `None` where the system watches no files.
    watcher: Option<Watcher>,
    read: Read,
    /// Of what was read, as it is wanted.
    job: Job,
    boxes: Vec<Aabb>,
    undersampled: Vec<Undersampled>,
    told: Told,
    wanted: Wanted,
    pass: Pass,
    /// `None` where there is no camera as wanted.
    framing: Option<Framing>,
    /// Seconds of a pixel, measured last.
    pace: Option<f64>,
    /// When the newest picture was made, and what making it took.
    seen: Option<(Instant, Duration)>,
    is_to_be_saved: bool,
}

impl Renderer<'_> {
    /// Does what is asked for, pass by pass.
    fn work(&mut self) -> Result<(), BackendError> {
        loop {
            let is_idle = self.framing.is_none() || self.pass.sample >= self.samples;
            let orders = self.shared.take(is_idle);
            if orders.quit {
                return Ok(());
            }
            self.is_to_be_saved |= orders.save;
            if orders.wanted.is_some() || orders.read.is_some() {
                let before = self.wanted.tuning.clone();
                self.wanted = orders.wanted.unwrap_or_else(|| self.wanted.clone());
                self.adapt(&before, orders.read)?;
                self.begin()?;
            }
            if self.framing.is_some() && self.pass.sample < self.samples {
                self.sample()?;
            }
            if self.is_to_be_saved && self.pass.sample > 0 {
                self.is_to_be_saved = false;
                self.save()?;
            }
        }
    }

    /// Begins the picture that is wanted: with as many pixels as can be had soon.
    fn begin(&mut self) -> Result<(), BackendError> {
        let settings = self.wanted.tuning.settings(&self.read.loaded.settings, self.wanted.size);
        let loaded = Subdivisions::of(&self.read.loaded.settings, &self.read.loaded.scene);
        let n = self.wanted.tuning.subdivisions.unwrap_or(loaded).most();
        let frame = &mut self.job.frame;
        (frame.width, frame.height) = self.wanted.size;
        frame.steps_scale = settings.method.many_steps(n);
        // Pixels of a smaller film, or of a wider view, are wider.
        let detail = |pixels| framing::detail(&settings.view, frame.width, frame.height, pixels);
        frame.detail = settings.adaptive.map_or(0.0, detail);
        (self.job.view, self.job.lights) = (settings.view, settings.lights);
        self.framing = match self.job.frame_view(&self.boxes) {
            Ok(framing) => Some(framing),
            Err(error) => {
                self.say(error.to_string());
                None
            }
        };
        let level = self.pace.map_or(FIRST_LEVEL, |pace| level(pace, self.wanted.size));
        self.pass = Pass { level, sample: 0, is_first: true, is_looked_at: false };
        self.set_film()
    }

    /// A film of the pass's size, empty.
    fn set_film(&mut self) -> Result<(), BackendError> {
        let part = |length: u32| length.div_ceil(1 << self.pass.level);
        let (width, height) = (part(self.wanted.size.0), part(self.wanted.size.1));
        let frame = Frame { width, height, ..self.job.frame };
        self.backend.set_view(&frame, &self.job.buffers.lights)
    }

    /// Adds a sample, and shows what came of it.
    fn sample(&mut self) -> Result<(), BackendError> {
        let (start, mut share_done) = (Instant::now(), 0.0);
        let (shared, is_first) = (self.shared, self.pass.is_first);
        let flow = self.backend.add_sample(self.pass.sample, &mut |share| {
            share_done = share;
            let is_interrupted =
                shared.is_interrupted.load(Ordering::Relaxed) && (!is_first || start.elapsed() > PATIENCE);
            let ends = is_interrupted || shared.is_quitting();
            if ends { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        let pixels = self.film_pixels();
        if share_done > 0.0 {
            self.pace = Some(start.elapsed().as_secs_f64() / (pixels * f64::from(share_done)));
        }
        if flow.is_break() {
            // What comes next begins anew. Should nothing come, so does this.
            self.pass = Pass { is_first: false, sample: 0, ..self.pass };
            return self.set_film();
        }
        self.pass.is_first = false;
        if self.pass.level > 0 {
            self.show(0)?;
            self.pass.level -= 1;
            return self.set_film();
        }
        self.pass.sample += 1;
        let (is_new, is_last) = (self.pass.sample == 1, self.pass.sample == self.samples);
        if is_new || is_last || self.is_time_to_show() {
            self.show(self.pass.sample)?;
        }
        if !self.pass.is_looked_at && self.pass.sample == RESTED.min(self.samples) {
            self.pass.is_looked_at = true;
            self.look_for_useless()?;
        }
        Ok(())
    }

    fn film_pixels(&self) -> f64 {
        let part = |length: u32| f64::from(length.div_ceil(1 << self.pass.level));
        part(self.wanted.size.0) * part(self.wanted.size.1)
    }

    fn is_time_to_show(&self) -> bool {
        self.seen.is_none_or(|(when, cost)| when.elapsed() > REFRESH.max(RESOLVING * cost))
    }

    /// Tells what the film shows.
    fn show(&mut self, samples: u32) -> Result<(), BackendError> {
        let Some(framing) = self.framing else { return Ok(()) };
        let start = Instant::now();
        let pixels = self.backend.resolve()?;
        let part = |length: u32| length.div_ceil(1 << self.pass.level);
        let canvas = Canvas::of_picture(part(self.wanted.size.0), part(self.wanted.size.1), &pixels);
        let (width, height) = self.wanted.size;
        let pace = self.pace.unwrap_or(0.0);
        (self.report)(Report::Seen(Box::new(Seen {
            serial: self.wanted.serial,
            canvas,
            samples,
            framing,
            frame_ms: 1e3 * pace * f64::from(width) * f64::from(height),
            rays_per_second: if pace > 0.0 { 1.0 / pace } else { 0.0 },
        })));
        self.seen = Some((Instant::now(), start.elapsed()));
        Ok(())
    }

    /// Saves the picture. Where that fails, it says so.
    fn save(&mut self) -> Result<(), BackendError> {
        let (width, height) = self.wanted.size;
        let picture = Picture { width, height, pixels: self.backend.resolve()? };
        let path = free_name(&self.output.path);
        let written = Destination { path, ..self.output.clone() };
        match written.write(&picture, &self.command(&written.path)) {
            Ok(()) => self.say(format!("wrote {}", written.path.display())),
            Err(error) => self.say(error.to_string()),
        }
        Ok(())
    }

    /// The command line of what is seen, which writes it to `output`.
    fn command(&self, output: &Path) -> String {
        let settings = self.wanted.tuning.settings(&self.read.loaded.settings, self.wanted.size);
        self.source.command(&Shot {
            tuning: &self.wanted.tuning,
            lights: &settings.lights,
            size: self.wanted.size,
            samples: self.pass.sample.max(1),
            engine: &self.engine,
            output: Some(output),
        })
    }

    /// Says something in the panel and in the log.
    fn say(&self, message: String) {
        tracing::info!("{message}");
        (self.report)(Report::Message(message));
    }
}

/// The level whose film takes no longer than a preview may, at so many seconds a pixel.
fn level(pace: f64, (width, height): (u32, u32)) -> u32 {
    let seconds = |level: u32| pace * f64::from(width) * f64::from(height) / 4_f64.powi(level as i32);
    (0..LEAST_LEVEL).find(|&level| seconds(level) <= PREVIEW.as_secs_f64()).unwrap_or(LEAST_LEVEL)
}

/// The path, or the next one with a number that is free: no picture is lost.
fn free_name(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let numbered = (1_u32..).map(|number| path.with_file_name(format!("{stem}-{number}.{ending}")));
    let free = std::iter::once(path.to_owned()).chain(numbered).find(|path| !path.exists());
    free.unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests;
