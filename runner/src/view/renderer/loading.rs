//! What is rendered: a scene made ready for the backend, as it is wanted, and made ready again when that changes.

use super::thread::{Read, Shared};
use super::{PATIENCE, Renderer, Report, Wanted};
use crate::backend::{Backend, BackendError, SceneBuffers};
use crate::distance_files;
use crate::heights::set_heights;
use crate::render::{Job, RenderError, prepare};
use crate::reports::{Ground, Undersampled, undersampled, useless};
use crate::settings::Subdivisions;
use crate::view::Loaded;
use crate::view::state::SceneInfo;
use crate::view::tuning::Tuning;
use crate::view::zeros::Zeros;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::scene::Features;
use std::ops::ControlFlow;
use std::sync::atomic::Ordering;

/// Makes a scene ready for the backend, and keeps of it what views need. Nothing where the viewer is to end before
/// that.
pub(super) fn load(
    backend: &mut dyn Backend,
    loaded: &Loaded,
    wanted: &Wanted,
    shared: &Shared,
) -> Result<Option<Ready>, RenderError> {
    let settings = wanted.tuning.settings(&loaded.settings, wanted.size);
    let mut job = prepare(wanted.tuning.scene(loaded), &settings)?;
    if shared.is_quitting() {
        return Ok(None);
    }
    distance_files::load(backend, &mut job)?;
    let boxes = backend.prism_boxes()?;
    // Which N an adaptive one is depends on the camera. Where there is none as wanted, it is said when it is looked by.
    let is_framed = job.frame_view(&boxes).is_ok();
    let undersampled = if is_framed { undersampled(&job) } else { Vec::new() };
    let SceneBuffers { displacements, instances, .. } = std::mem::take(&mut job.buffers);
    job.buffers = SceneBuffers { displacements, instances, ..SceneBuffers::default() };
    Ok(Some(Ready { job, boxes, undersampled }))
}

/// A scene that is ready.
pub(super) struct Ready {
    /// What views need of it: displacements and instances.
    pub(super) job: Job,
    pub(super) boxes: Vec<Aabb>,
    /// Maps with relief between micro-vertices.
    pub(super) undersampled: Vec<Undersampled>,
}

impl Renderer<'_> {
    /// Loads what is wanted now, `before` being what is loaded, and `read` a newer scene. What cannot be is taken back.
    pub(super) fn adapt(&mut self, before: &Tuning, mut read: Option<Read>) -> Result<(), BackendError> {
        let is_reload = read.is_some();
        let zero = self.wanted.tuning.zero;
        if read.as_ref().unwrap_or(&self.read).is_other_with(zero) {
            match self.source.read(zero) {
                Ok(loaded) => read = Some(Read { loaded, zero }),
                Err(error) => {
                    self.say(format!("the scene stays as it was: {error}"));
                    self.take_back(&before.with_colors_of(&self.wanted.tuning));
                    read = None;
                }
            }
        }
        let base = &self.read.loaded.settings;
        let (space, step) = (self.read.loaded.scene.mesh.space, self.job.view_step);
        let eye = self.wanted.tuning.settings(base, self.wanted.size).view.eye;
        let is_elsewhere = eye.map_or(space, |eye| space.moved_to(eye, step)) != self.job.space;
        if read.is_some() || is_elsewhere || self.wanted.tuning.needs_other_scene(before, base) {
            let is_loaded = self.load_or_keep(read, before)?;
            if is_reload && is_loaded {
                (self.report)(Report::Message("read again, since files have changed".to_owned()));
            }
            return Ok(());
        }
        let new = &self.wanted.tuning;
        let settings = new.settings(base, self.wanted.size);
        let features = Features {
            method: settings.method.id(),
            shade: settings.shade.id(),
            smooth: u32::from(settings.smooth),
            shadows: u32::from(settings.shadows),
            ..self.job.features
        };
        if features != self.job.features {
            if let Err(error) = self.backend.set_features(features) {
                return self.fall_back(error, before);
            }
            self.job.features = features;
            self.pace = None;
        }
        if new.needs_other_heights(before, base) {
            let reliefs = new.reliefs(&self.read.loaded);
            for (displacement, relief) in self.job.buffers.displacements.iter_mut().zip(&reliefs) {
                set_heights(displacement, relief, settings.displaces());
            }
            if let Err(error) = self.backend.set_displacements(&self.job.buffers.displacements) {
                return self.fall_back(error, &before.with_colors_of(new));
            }
            self.boxes = self.backend.prism_boxes()?;
        }
        Ok(())
    }

    /// Loads what is wanted, of `read` where that is new. Where that cannot be, it says so, and loads again what there
    /// was, as `before` wanted it. Returns whether it could be.
    fn load_or_keep(&mut self, read: Option<Read>, before: &Tuning) -> Result<bool, BackendError> {
        self.pace = None;
        let new = read.as_ref().unwrap_or(&self.read);
        let error = match load(self.backend.as_mut(), &new.loaded, &self.wanted, self.shared) {
            Ok(Some(ready)) => {
                self.take(ready);
                if let Some(read) = read {
                    self.read = read;
                    self.tell_loaded();
                }
                self.tell_undersampled();
                return Ok(true);
            }
            Ok(None) => return Ok(false),
            Err(error) => error,
        };
        let before = before.with_colors_of(&self.wanted.tuning);
        self.fall_back(error, &before)?;
        Ok(false)
    }

    /// What is wanted cannot be had: says so, and loads again what there was, as it is `kept`. The backend may hold
    /// nothing any more.
    fn fall_back(&mut self, error: impl Into<RenderError>, kept: &Tuning) -> Result<(), BackendError> {
        let error = match error.into() {
            RenderError::Backend(error @ BackendError::DeviceLost { .. }) => return Err(error),
            error => error,
        };
        self.pace = None;
        self.say(format!("the scene stays as it was: {error}"));
        self.take_back(kept);
        match load(self.backend.as_mut(), &self.read.loaded, &self.wanted, self.shared) {
            Ok(Some(ready)) => self.take(ready),
            Ok(None) => {}
            Err(RenderError::Backend(error)) => return Err(error),
            // It was sound before.
            Err(error) => self.say(error.to_string()),
        }
        Ok(())
    }

    fn take(&mut self, ready: Ready) {
        (self.job, self.boxes, self.undersampled) = (ready.job, ready.boxes, ready.undersampled);
    }

    /// Says which maps have relief between micro-vertices, where that is new. N of a built-in scene is as its maker
    /// chose.
    pub(super) fn tell_undersampled(&mut self) {
        let is_own = self.read.loaded.has_own_subdivisions && self.wanted.tuning.subdivisions.is_none();
        if self.undersampled == self.told.undersampled || is_own {
            return;
        }
        for map in &self.undersampled {
            self.say(map.to_string());
        }
        self.told.undersampled.clone_from(&self.undersampled);
    }

    /// Says why the picture shows nothing of what was meant, unless that was what was said last. It is looked at only
    /// where the camera rests, since that may take as long as the picture did.
    pub(super) fn look_for_useless(&mut self) -> Result<(), BackendError> {
        let pixels = self.backend.resolve()?;
        let ground = Ground::of_scene(&self.read.loaded.scene, &self.job.buffers.instances);
        let shared = self.shared;
        let mut watch = || {
            let ends = shared.is_interrupted.load(Ordering::Relaxed) || shared.is_quitting();
            if ends { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let samples = self.pass.sample;
        let found = useless(self.backend.as_mut(), &self.job, &ground, &pixels, samples, &mut watch)?;
        if found.film_is_cleared {
            self.pass.sample = 0;
            self.set_film()?;
        }
        let is_interrupted = found.film_is_cleared && shared.is_interrupted.load(Ordering::Relaxed);
        if is_interrupted && found.useless.is_none() {
            // It was not found out.
            return Ok(());
        }
        let kind = found.useless.as_ref().map(std::mem::discriminant);
        if let Some(useless) = found.useless.filter(|_| kind != self.told.useless) {
            self.say(useless.to_string());
        }
        self.told.useless = kind;
        Ok(())
    }

    /// Wants again what is loaded; also the window learns of it, so that it shows no settings that the picture has not.
    fn take_back(&mut self, kept: &Tuning) {
        let refused = self.wanted.tuning.clone();
        self.wanted.tuning.take_back(&refused, kept);
        (self.report)(Report::Kept(Box::new([refused, kept.clone()])));
    }

    pub(super) fn tell_loaded(&mut self) {
        let loaded = &self.read.loaded;
        if let Some(watcher) = &self.watcher {
            // What is changed once there is a picture is to be seen.
            let _ = watcher.watch(&loaded.files).recv_timeout(PATIENCE);
        }
        (self.report)(Report::Loaded(Box::new(SceneInfo {
            settings: loaded.settings.clone(),
            triangles: loaded.scene.mesh.triangles.len(),
            subdivisions: Subdivisions::of(&loaded.settings, &loaded.scene),
            exaggeration: loaded.exaggeration,
            scale: loaded.scale,
            zeros: Zeros::of(&loaded.scene.reliefs),
        })));
    }
}
