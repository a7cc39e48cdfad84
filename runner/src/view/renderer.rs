//! The thread that renders.

use super::canvas::Canvas;
use super::present::Engine;
use super::reload::Watcher;
use super::state::SceneInfo;
use super::tuning::Tuning;
use super::{Loaded, Shot, Source, ViewError};
use crate::backend::{Backend, BackendError, SceneBuffers};
use crate::framing::{self, Framing};
use crate::heights::set_heights;
use crate::picture::{Destination, Picture};
use crate::render::{Job, RenderError, prepare};
use crate::settings::Subdivisions;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::Frame;
use emboss_kernels::scene::Features;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the first pass after a change should take: films get as many pixels as that allows.
const PREVIEW: Duration = Duration::from_millis(30);
/// How long the first pass goes on though something has changed again: were it always broken off, a camera that moves would
/// show nothing.
const PATIENCE: Duration = Duration::from_millis(200);
/// A film has at least 1/2^LEAST_LEVEL of the window's columns and rows.
const LEAST_LEVEL: u32 = 5;
/// The level at first, when nothing was measured.
const FIRST_LEVEL: u32 = 3;
/// How often pictures come while samples are added: as often as screens show them.
const REFRESH: Duration = Duration::from_millis(16);
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
    /// It has ended.
    Failed(Box<ViewError>),
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

/// What the window's thread asks for.
#[derive(Default)]
struct Orders {
    wanted: Option<Wanted>,
    reload: bool,
    save: bool,
    quit: bool,
}

/// What both threads see.
#[derive(Default)]
pub(super) struct Shared {
    orders: Mutex<Orders>,
    arrived: Condvar,
    /// Whether something came that the pass under way is not for.
    is_interrupted: AtomicBool,
    is_quitting: AtomicBool,
}

impl Shared {
    fn order(&self, change: impl FnOnce(&mut Orders)) {
        change(&mut self.lock());
        self.arrived.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What has come. Waits for something where `is_idle`.
    fn take(&self, is_idle: bool) -> Orders {
        let nothing = |orders: &mut Orders| {
            is_idle && orders.wanted.is_none() && !orders.reload && !orders.save && !orders.quit
        };
        let waited = self.arrived.wait_while(self.lock(), nothing);
        let mut orders = waited.unwrap_or_else(PoisonError::into_inner);
        self.is_interrupted.store(false, Ordering::Relaxed);
        std::mem::take(&mut *orders)
    }

    fn interrupt(&self) {
        self.is_interrupted.store(true, Ordering::Relaxed);
    }
}

/// The thread, as the window's thread has it.
pub(super) struct Handle {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread is started with.
pub(super) struct Setup {
    pub(super) engine: Engine,
    pub(super) source: Arc<dyn Source>,
    /// After how many samples a picture is left as it is.
    pub(super) samples: u32,
    /// Where pictures are saved.
    pub(super) output: Destination,
    pub(super) report: Box<dyn Fn(Report) + Send>,
}

impl Handle {
    pub(super) fn start(setup: Setup) -> Handle {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            let Setup { engine, source, samples, output, report } = setup;
            if let Err(error) = run(engine, &of_thread, source, samples, output, &report) {
                report(Report::Failed(Box::new(error)));
            }
        });
        Handle { shared, thread: Some(thread) }
    }

    pub(super) fn want(&self, wanted: Wanted) {
        self.shared.order(|orders| orders.wanted = Some(wanted));
        self.shared.interrupt();
    }

    pub(super) fn save(&self) {
        self.shared.order(|orders| orders.save = true);
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.shared.is_quitting.store(true, Ordering::Relaxed);
        self.shared.order(|orders| orders.quit = true);
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join)
            && !std::thread::panicking()
        {
            std::panic::resume_unwind(panic);
        }
    }
}

/// Renders until it is told to quit.
fn run(
    engine: Engine,
    shared: &Arc<Shared>,
    source: Arc<dyn Source>,
    samples: u32,
    output: Destination,
    report: &dyn Fn(Report),
) -> Result<(), ViewError> {
    let wanted = loop {
        let orders = shared.take(true);
        if orders.quit {
            return Ok(());
        }
        if let Some(wanted) = orders.wanted {
            break wanted;
        }
    };
    let loaded = source.read(wanted.tuning.zero).map_err(ViewError::Source)?;
    let mut backend = engine.start()?;
    let (job, boxes) = load(backend.as_mut(), &loaded, &wanted)?;
    let changed = Arc::clone(shared);
    let watcher = Watcher::new(move || {
        changed.order(|orders| orders.reload = true);
        changed.interrupt();
    });
    let watcher = watcher.inspect_err(|error| {
        tracing::warn!("changes of the files will not be seen ({error})");
    });
    let pass = Pass { level: 0, sample: 0, is_first: true };
    let mut renderer = Renderer {
        source,
        samples,
        output,
        shared,
        report,
        backend,
        watcher: watcher.ok(),
        loaded,
        job,
        boxes,
        wanted,
        pass,
        framing: None,
        pace: None,
        seen: None,
        is_to_be_saved: false,
    };
    renderer.tell_loaded();
    renderer.begin()?;
    renderer.work().map_err(|error| renderer.lost(error))
}

/// Makes a scene ready for the backend, and keeps of it what views need.
fn load(
    backend: &mut dyn Backend,
    loaded: &Loaded,
    wanted: &Wanted,
) -> Result<(Job, Vec<Aabb>), RenderError> {
    let settings = wanted.tuning.settings(&loaded.settings, wanted.size);
    let mut job = prepare(wanted.tuning.scene(&loaded.scene), &settings)?;
    backend.load(&job.buffers, &job.frame, job.features)?;
    let displacements = std::mem::take(&mut job.buffers.displacements);
    job.buffers = SceneBuffers { displacements, ..SceneBuffers::default() };
    Ok((job, backend.prism_boxes()?))
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
}

struct Renderer<'a> {
    source: Arc<dyn Source>,
    samples: u32,
    output: Destination,
    shared: &'a Shared,
    report: &'a dyn Fn(Report),
    backend: Box<dyn Backend>,
    /// `None` where the system watches no files.
    watcher: Option<Watcher>,
    loaded: Loaded,
    job: Job,
    boxes: Vec<Aabb>,
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
            if orders.reload && self.read_again()? {
                (self.report)(Report::Message("read again, since files have changed".to_owned()));
            }
            if let Some(wanted) = orders.wanted {
                self.change(wanted)?;
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

    /// Goes over to what is wanted now.
    fn change(&mut self, wanted: Wanted) -> Result<(), BackendError> {
        let old = std::mem::replace(&mut self.wanted, wanted);
        let (old, new) = (&old.tuning, &self.wanted.tuning);
        let settings = new.settings(&self.loaded.settings, self.wanted.size);
        // Texels that are no numbers are zeros.
        let has_zeros = self.loaded.scene.reliefs.iter().any(|relief| relief.map.replaced > 0);
        if new.zero != old.zero && has_zeros {
            return self.read_again().map(drop);
        }
        if new.needs_other_scene(old, &self.loaded.settings) {
            let old = Wanted { tuning: old.clone(), ..self.wanted.clone() };
            self.load_or_keep(None, &old)?;
            return self.begin();
        }
        let features = Features {
            method: settings.method.id(),
            shade: settings.shade.id(),
            smooth: u32::from(settings.smooth),
            shadows: u32::from(settings.shadows),
            ..self.job.features
        };
        if features != self.job.features {
            self.backend.set_features(features)?;
            self.job.features = features;
            self.pace = None;
        }
        if new.needs_other_heights(old, &self.loaded.settings) {
            let reliefs = self.loaded.scene.reliefs.iter().map(|relief| new.relief(relief));
            for (displacement, relief) in self.job.buffers.displacements.iter_mut().zip(reliefs) {
                set_heights(displacement, &relief, settings.displaces());
            }
            self.backend.set_displacements(&self.job.buffers.displacements)?;
            self.boxes = self.backend.prism_boxes()?;
        }
        self.begin()
    }

    /// Reads the files again. What is wrong with them is said, and the old scene stays. Whether nothing is.
    fn read_again(&mut self) -> Result<bool, BackendError> {
        match self.source.read(self.wanted.tuning.zero) {
            Ok(loaded) => {
                let wanted = self.wanted.clone();
                let is_loaded = self.load_or_keep(Some(loaded), &wanted)?;
                self.begin()?;
                Ok(is_loaded)
            }
            Err(error) => {
                self.say(format!("the files have changed, but the scene stays as it was: {error}"));
                Ok(false)
            }
        }
    }

    /// Loads what is wanted, of `loaded` where it is new. Where that cannot be, it says so, and loads again what there was,
    /// as `before` wanted it. Returns whether it could be.
    fn load_or_keep(&mut self, loaded: Option<Loaded>, before: &Wanted) -> Result<bool, BackendError> {
        self.pace = None;
        let new = loaded.as_ref().unwrap_or(&self.loaded);
        let error = match load(self.backend.as_mut(), new, &self.wanted) {
            Ok((job, boxes)) => {
                (self.job, self.boxes) = (job, boxes);
                self.loaded = loaded.unwrap_or_else(|| self.loaded.clone());
                self.tell_loaded();
                return Ok(true);
            }
            Err(RenderError::Backend(error @ BackendError::DeviceLost { .. })) => return Err(error),
            Err(error) => error,
        };
        self.say(format!("the scene stays as it was: {error}"));
        self.wanted.tuning = before.tuning.clone();
        match load(self.backend.as_mut(), &self.loaded, &self.wanted) {
            Ok((job, boxes)) => (self.job, self.boxes) = (job, boxes),
            Err(RenderError::Backend(error)) => return Err(error),
            // It was sound before.
            Err(error) => self.say(error.to_string()),
        }
        Ok(false)
    }

    fn tell_loaded(&mut self) {
        if let Some(watcher) = &mut self.watcher {
            watcher.watch(&self.loaded.files);
        }
        (self.report)(Report::Loaded(Box::new(SceneInfo {
            settings: self.loaded.settings.clone(),
            triangles: self.loaded.scene.mesh.triangles.len(),
            subdivisions: Subdivisions::of(&self.loaded.settings, &self.loaded.scene),
            scale: self.loaded.scale,
            zero: self.loaded.zero,
        })));
    }

    /// Begins the picture that is wanted: with as many pixels as can be had soon.
    fn begin(&mut self) -> Result<(), BackendError> {
        let settings = self.wanted.tuning.settings(&self.loaded.settings, self.wanted.size);
        let loaded = Subdivisions::of(&self.loaded.settings, &self.loaded.scene);
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
        self.pass = Pass { level, sample: 0, is_first: true };
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
            let ends = is_interrupted || shared.is_quitting.load(Ordering::Relaxed);
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
        match written.write(&picture, &self.command()) {
            Ok(()) => self.say(format!("wrote {}", written.path.display())),
            Err(error) => self.say(error.to_string()),
        }
        Ok(())
    }

    /// The command line of what is seen.
    fn command(&self) -> String {
        let settings = self.wanted.tuning.settings(&self.loaded.settings, self.wanted.size);
        self.source.command(&Shot {
            tuning: &self.wanted.tuning,
            lights: &settings.lights,
            scale: self.loaded.scale,
            size: self.wanted.size,
            samples: self.pass.sample.max(1),
        })
    }

    /// Says something in the panel and in the log.
    fn say(&self, message: String) {
        tracing::info!("{message}");
        (self.report)(Report::Message(message));
    }

    /// What is said at the end of a device.
    fn lost(&self, source: BackendError) -> ViewError {
        ViewError::Lost { source, command: self.command() }
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
mod tests {
    use super::*;

    #[test]
    fn slow_devices_begin_with_fewer_pixels() {
        assert_eq!(level(1e-9, (1000, 1000)), 0);
        // 1 s for all: a quarter of a quarter of a quarter is 16 ms.
        assert_eq!(level(1e-6, (1000, 1000)), 3);
        assert_eq!(level(1.0, (1000, 1000)), LEAST_LEVEL);
    }

    #[test]
    fn pictures_never_replace_each_other() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        let mut names = vec![];
        for _ in 0..3 {
            let name = free_name(&path);
            std::fs::write(&name, "").expect("writable");
            names.push(name.file_name().expect("a file").to_owned());
        }
        assert_eq!(names, ["a.png", "a-1.png", "a-2.png"]);
    }
}
