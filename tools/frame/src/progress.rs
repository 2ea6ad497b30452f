//! A progress bar for work that takes more than a second. It appears only on a terminal.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A progress bar on standard error. It appears after one second if standard error is a terminal,
/// and disappears when it is dropped.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    started: Instant,
    /// Whether the bar is still hidden and may appear.
    is_pending: bool,
}

impl Bar {
    /// Creates a bar with the label `what`. If `visible` is false, it never appears.
    pub(crate) fn new(what: &'static str, visible: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{prefix} [{bar:40}] {percent}% {eta} left");
        bar.set_style(style.expect("the template is right").progress_chars("=> "));
        bar.set_prefix(what);
        Bar {
            bar,
            started: Instant::now(),
            is_pending: visible,
        }
    }

    /// Shows that `done` of `total` units of work are done.
    pub fn set(&mut self, done: u64, total: u64) {
        self.bar.set_length(total);
        self.bar.set_position(done);
        if self.is_pending && self.started.elapsed() > Duration::from_secs(1) {
            self.is_pending = false;
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
