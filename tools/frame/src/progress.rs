//! A progress bar on a terminal, for what takes more than a second; nothing anywhere else.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar that appears on standard error after a second, if that is a terminal, and goes when it is
/// dropped.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    started: Instant,
    /// Whether it may still appear.
    waits: bool,
}

impl Bar {
    /// A bar for work that is called `what`; one that never appears unless `visible`.
    pub(crate) fn new(what: &'static str, visible: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{prefix} [{bar:40}] {percent}% {eta} left");
        bar.set_style(style.expect("the template is right").progress_chars("=> "));
        bar.set_prefix(what);
        Bar {
            bar,
            started: Instant::now(),
            waits: visible,
        }
    }

    /// Says how far the work has come.
    pub fn set(&mut self, done: u64, total: u64) {
        self.bar.set_length(total);
        self.bar.set_position(done);
        if self.waits && self.started.elapsed() > Duration::from_secs(1) {
            self.waits = false;
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
