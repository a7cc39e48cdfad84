//! What is rendered: a scene made ready for the backend, as it is wanted, and made ready again when that changes.

use super::thread::{Read, Shared};
use super::{PATIENCE, Renderer, Report, Wanted};
use crate::backend::{Backend, BackendError, SceneBuffers};
use crate::distance_files;
use crate::heights::set_heights;
use crate::render::{Job, RenderError, prepare};
use crate::settings::Subdivisions;
use crate::view::Loaded;
use crate::view::state::SceneInfo;
use crate::view::tuning::Tuning;
use crate::view::zeros::Zeros;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::scene::Features;

/// Makes a scene ready for the backend, and keeps of it what views need. Nothing where the viewer is to end before
/// that.
pub(super) fn load(
    backend: &mut dyn Backend,
    loaded: &Loaded,
    wanted: &Wanted,
    shared: &Shared,
) -> Result<Option<(Job, Vec<Aabb>)>, RenderError> {
    let settings = wanted.tuning.settings(&loaded.settings, wanted.size);
    let mut job = prepare(wanted.tuning.scene(loaded), &settings)?;
    if shared.is_quitting() {
        return Ok(None);
    }
    distance_files::load(backend, &mut job)?;
    let displacements = std::mem::take(&mut job.buffers.displacements);
    job.buffers = SceneBuffers { displacements, ..SceneBuffers::default() };
    Ok(Some((job, backend.prism_boxes()?)))
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
            Ok(Some((job, boxes))) => {
                (self.job, self.boxes) = (job, boxes);
                if let Some(read) = read {
                    self.read = read;
                    self.tell_loaded();
                }
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
            Ok(Some((job, boxes))) => (self.job, self.boxes) = (job, boxes),
            Ok(None) => {}
            Err(RenderError::Backend(error)) => return Err(error),
            // It was sound before.
            Err(error) => self.say(error.to_string()),
        }
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
