//! The progress bar.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Steps of a bar: finer than any terminal is wide.
const STEPS: u64 = 1000;

/// A bar on standard error; indicatif shows it only where that is a terminal.
pub(super) fn bar(quiet: bool) -> ProgressBar {
    let bar = ProgressBar::new(STEPS);
    if quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {eta} left") {
        bar.set_style(style);
    }
    bar
}

/// The bar's position for a share from 0 to 1.
#[expect(clippy::cast_possible_truncation, reason = "0 to STEPS, saturating")]
pub(super) fn position(share: f64) -> u64 {
    (share * STEPS as f64) as u64
}
