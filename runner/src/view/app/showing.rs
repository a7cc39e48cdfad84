//! Pictures, and the window's title.

use super::{App, milliseconds};
use crate::backend::BackendError;
use crate::view::ViewError;
use crate::view::canvas::{Canvas, Font};
use crate::view::overlay;
use crate::view::present::{self, PresentError, Progress};
use crate::view::screen::{Delays, UnderWay};
use std::time::{Duration, Instant};
use winit::event::InnerSizeWriter;
use winit::event_loop::ActiveEventLoop;

/// How often the window's title changes, and it is asked whether it is minimised.
const TITLE: Duration = Duration::from_millis(250);

impl App {
    /// The window's system says whether nobody can see the window.
    pub(super) fn occlude(&mut self, is_occluded: bool) {
        if let Some(open) = &mut self.open {
            open.is_occluded = is_occluded;
        }
        self.redraw();
    }

    /// Asks whether the window is minimised. Where X11 has a compositor that goes on showing it, smaller and elsewhere,
    /// nothing else tells; and what tells that it is seen again may come before the answer has changed.
    fn look_whether_minimized(&mut self) {
        let Some(open) = &mut self.open else { return };
        let is_minimized = !open.is_occluded && open.window.is_minimized() == Some(true);
        if is_minimized != open.is_minimized {
            open.is_minimized = is_minimized;
            self.redraw();
        }
    }

    /// The window's screen has that density. The window is given the size that winit proposes, once: on X11 it tells
    /// the same again when the window is moved, and would have it grow again.
    pub(super) fn take_density(&mut self, density: f64, mut size: InnerSizeWriter) {
        if let Some(open) = &mut self.open {
            if density == open.density {
                // Where that cannot be written any more nothing is proposed.
                let _ = size.request_inner_size(open.window.inner_size());
            }
            open.density = density;
        }
        self.redraw();
    }

    pub(super) fn redraw(&mut self) {
        if let Some(open) = &mut self.open {
            open.screen.ask(Instant::now());
            if !open.screen.is_busy() {
                open.window.request_redraw();
            }
        }
    }

    /// Shows the newest picture with the panel.
    pub(super) fn show(&mut self) -> Result<(), PresentError> {
        let Some(open) = self.open.as_mut() else { return Ok(()) };
        if open.screen.is_busy() {
            // The window's system wants it again: what is under way may be there before that.
            open.screen.ask(Instant::now());
            return Ok(());
        }
        let was_hidden = open.screen.is_hidden;
        let is_out_of_sight = open.is_occluded || open.is_minimized;
        let size = if is_out_of_sight { None } else { open.presenter.size()? };
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
    pub(super) fn take_outcome(&mut self, event_loop: &ActiveEventLoop) {
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
    pub(super) fn compose(&self) -> Option<Canvas> {
        let open = self.open.as_ref()?;
        let (width, height) = open.screen.size?;
        let nothing = Canvas::default();
        let picture = self.seen.as_ref().map_or(&nothing, |seen| &seen.canvas);
        let mut canvas = picture.scaled(width, height);
        if self.state.is_panel_open {
            let font = Font::for_scale(open.density);
            overlay::draw(&mut canvas, font, &self.state, &self.status);
        }
        Some(canvas)
    }

    pub(super) fn fail_to_present(&mut self, event_loop: &ActiveEventLoop, error: PresentError) {
        match error {
            PresentError::Window(reason) => self.fail(event_loop, ViewError::Window { reason }),
            PresentError::Backend(source @ BackendError::DeviceLost { .. }) => {
                self.lose(event_loop, source.into());
            }
            PresentError::Backend(error) => self.present_otherwise(event_loop, &error),
        }
    }

    /// The device shows no pictures any more, which is no reason why it should not render them.
    fn present_otherwise(&mut self, event_loop: &ActiveEventLoop, error: &BackendError) {
        let Some(open) = &mut self.open else { return };
        match present::instead_of_swapchain(&open.window, error) {
            Ok(presenter) => open.present_by(presenter),
            Err(error) => self.fail(event_loop, error),
        }
        self.redraw();
    }

    /// When the title may change again, if it has to, or the window may no longer be minimised.
    pub(super) fn title_due(&self) -> Option<Instant> {
        let is_minimized = self.open.as_ref().is_some_and(|open| open.is_minimized);
        (self.is_title_stale || is_minimized)
            .then(|| self.last_title.map_or_else(Instant::now, |last| last + TITLE))
    }

    pub(super) fn set_title(&mut self) {
        if self.title_due().is_none_or(|due| due > Instant::now()) {
            return;
        }
        (self.last_title, self.is_title_stale) = (Some(Instant::now()), false);
        self.look_whether_minimized();
        if let Some(open) = &self.open {
            open.window.set_title(&overlay::title(&self.options.title, &self.state, &self.status));
        }
    }
}
