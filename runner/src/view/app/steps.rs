//! What is done in place of a user.

use super::App;
use crate::view::ViewError;
use crate::view::script::{Script, Step};
use std::io::Write;
use std::time::{Duration, Instant};
use winit::dpi::PhysicalSize;
use winit::event_loop::ActiveEventLoop;

/// How long a step waits.
const PATIENCE: Duration = Duration::from_secs(120);

impl App {
    /// Does the steps of the script that can be done.
    pub(super) fn follow_script(&mut self, event_loop: &ActiveEventLoop) {
        while let Some(step) = self.options.script.as_mut().and_then(Script::next).cloned() {
            let since = *self.step_since.get_or_insert_with(Instant::now);
            if since.elapsed() > PATIENCE {
                return self.fail(event_loop, ViewError::Stuck { step: format!("{step:?}") });
            }
            if !self.do_step(event_loop, step) {
                return;
            }
            (self.shown_before, self.step_since) = (None, None);
            self.options.script.as_mut().map(Script::advance);
        }
    }

    /// Does a step, or waits for what it waits for: then `false`.
    fn do_step(&mut self, event_loop: &ActiveEventLoop, step: Step) -> bool {
        let seen = self.seen.as_ref().filter(|seen| seen.serial == self.serial);
        match step {
            Step::Inputs(inputs) => {
                // Nothing moves, and nothing is tuned, before there is a picture.
                if self.seen.is_none() {
                    return false;
                }
                inputs.into_iter().for_each(|input| self.hear(event_loop, input));
            }
            Step::Size(width, height) => {
                let Some(open) = &self.open else { return false };
                let size = PhysicalSize::new(width, height);
                let current = open.window.inner_size();
                // Some systems have a new size at once, others tell of it later.
                if open.screen.size != Some((width, height)) {
                    if current != size {
                        let _ = open.window.request_inner_size(size);
                    }
                    self.redraw();
                    return false;
                }
            }
            Step::Density(density) => {
                return self.open.as_ref().is_some_and(|open| open.density == density);
            }
            Step::Samples(samples) => {
                let is_shown = self.open.as_ref().is_some_and(|open| open.screen.is_up_to_date());
                return is_shown && seen.is_some_and(|seen| seen.samples >= samples);
            }
            Step::Frames(frames) => {
                let before = *self.shown_before.get_or_insert(self.shown);
                let is_done = self.shown - before >= frames;
                if !is_done {
                    self.redraw();
                }
                return is_done;
            }
            Step::Message(text) => return self.state.message.starts_with(&text),
            Step::Say(text) => {
                let _ = writeln!(std::io::stdout(), "{text} {}", self.status.samples);
            }
            Step::Answers(text) => {
                let (answers, showings) =
                    (std::mem::take(&mut self.answers), std::mem::take(&mut self.showings));
                let _ = writeln!(std::io::stdout(), "{text}: {answers}; {showings}");
            }
            Step::Renew => {
                if let Some(Err(error)) = self.open.as_mut().map(|open| open.presenter.renew()) {
                    self.fail_to_present(event_loop, error);
                }
                self.redraw();
            }
            Step::Grab(path) => {
                let saved = self.compose().map(|canvas| canvas.save(&path));
                if let Some(Err(error)) = saved {
                    let reason = format!("{}: {error}", path.display());
                    self.fail(event_loop, ViewError::Window { reason });
                }
            }
            Step::Quit => event_loop.exit(),
        }
        true
    }
}
