//! `emboss render`.

use super::arguments::RenderArgs;
use super::interrupt::Interrupt;
use super::reports::{warn_of_undersampled, warn_of_useless};
use super::{CliError, progress, say};
use crate::backend::DeviceInfo;
use crate::picture::Destination;
use crate::render::{Cuts, Rendering, load, prepare, render};
use crate::reports::{Ground, Reports, undersampled, useless};
use crate::stats::{SettingsUsed, Stats};
use emboss_kernels::interface::counter;
use std::ops::ControlFlow;

impl RenderArgs {
    /// Renders: first everything that can be refused quickly, then the work.
    pub(super) fn run(mut self) -> Result<(), CliError> {
        self.check_quality()?;
        if let Some(method) = self.method {
            self.check_own_maps(method)?;
        }
        let destination = self.destination()?;
        destination.check()?;
        if let Some(path) = &self.stats {
            if *path == destination.path {
                return Err(CliError::StatsOverPicture(path.clone()));
            }
            Stats::check(path)?;
        }
        let interrupt = Interrupt::install();
        let mut backend = self.open_backend()?;
        let (mut settings, mut inputs, samples) = self.read(false)?;
        let wanted = Some(samples);
        if self.choose_quality(backend.as_mut(), &inputs.scene, &settings, wanted, Some(&interrupt))? {
            (settings, inputs, _) = self.read(false)?;
        }
        self.check_own_maps(settings.method)?;
        self.report(&inputs);
        let (scene, is_own_n) = (inputs.scene, inputs.has_own_subdivisions);
        let used = SettingsUsed::new(&settings, samples, &scene);
        let mut job = prepare(scene, &settings)?;
        load(backend.as_mut(), &mut job)?;
        let build = backend.build_report();
        tracing::debug!("BVH of {} nodes built in {:.1?}", build.nodes, build.duration);
        if build.left_out > 0 {
            tracing::warn!(
                "{} triangles have no finite box, or one too far away, and are left out",
                build.left_out
            );
        }
        let undersampled = undersampled(&job);
        warn_of_undersampled(&undersampled, is_own_n);
        if interrupt.requested() {
            return Err(CliError::InterruptedEarly);
        }

        tracing::debug!("rendering on {}", backend.device().name);
        let bar = progress::bar(self.quiet);
        let rendering = render(backend.as_mut(), &job, samples, &mut |share| {
            bar.set_position(progress::position(f64::from(share)));
            if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        let rendering =
            rendering.map_err(|source| CliError::Unfinished { source, path: destination.path.clone() })?;

        warn_of_caps(&rendering);
        destination.write(&rendering.picture, &self.command_line())?;
        let stats =
            self.stats.as_deref().map(|path| (path, Stats::new(&job, &rendering, backend.as_ref(), used)));
        let useless = if rendering.interrupted {
            None
        } else {
            let mut watch =
                || if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            let (ground, pixels) = (Ground::of_job(&job), &rendering.picture.pixels);
            let found = useless(backend.as_mut(), &job, &ground, pixels, samples, &mut watch);
            warn_of_useless(backend.as_ref(), found)
        };
        if let Some((path, stats)) = stats {
            let warnings = Reports { repeated: inputs.repeated.repeated, undersampled, useless };
            Stats { warnings, ..stats }.write(path)?;
        }
        if rendering.interrupted {
            return Err(CliError::Interrupted(destination.path));
        }
        self.report_done(&destination, &rendering, samples, backend.device());
        if job.features.adaptive != 0 && !self.quiet {
            let Cuts { least, greatest, micro_triangles } = job.cuts();
            say(format_args!("N was {least} to {greatest}: {micro_triangles} micro-triangles"));
        }
        Ok(())
    }

    fn report_done(
        &self,
        destination: &Destination,
        rendering: &Rendering,
        samples: u32,
        device: &DeviceInfo,
    ) {
        if self.quiet {
            return;
        }
        say(format_args!(
            "Wrote {}: {}x{}, {} samples a pixel in {:.2} s on {} ({})",
            destination.path.display(),
            rendering.picture.width,
            rendering.picture.height,
            samples,
            rendering.elapsed.as_secs_f64(),
            device.name,
            device.backend
        ));
    }
}

/// A walk that meets its cap may have missed a hit: never silently.
fn warn_of_caps(rendering: &Rendering) {
    let hits = rendering.totals[counter::CAP_HITS as usize];
    if hits > 0 {
        tracing::warn!(
            "{hits} walks met their cap on steps and may have missed the surface; compare with --method quadtree"
        );
    }
}
