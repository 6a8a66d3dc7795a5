//! Progress as bars on a terminal.

use std::{
    io::{self, Write},
    sync::{Arc, Mutex, Weak},
    thread,
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{locked, wording::closing_line};

/// Shortest work that gets a bar.
const SHOWN_AFTER: Duration = Duration::from_secs(1);
/// Interval at which bars are redrawn.
const REDRAW_EVERY: Duration = Duration::from_millis(100);

/// Bars on a terminal, redrawn by a thread of their own that ends with them.
pub(super) struct Bars {
    screen: MultiProgress,
    stack: Vec<Bar>,
}

struct Bar {
    label: String,
    bar: ProgressBar,
    begun: Instant,
    on_screen: bool,
}

impl Bars {
    pub(super) fn start() -> Arc<Mutex<Self>> {
        let bars = Arc::new(Mutex::new(Self {
            screen: MultiProgress::new(),
            stack: Vec::new(),
        }));
        let watched = Arc::downgrade(&bars);
        // Should the thread not start, no bar shows; the closing lines still do.
        drop(
            thread::Builder::new()
                .name("progress".to_owned())
                .spawn(move || redraw_while_alive(&watched)),
        );
        bars
    }

    pub(super) fn begin(&mut self, label: &str, total: Option<u64>) {
        let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::hidden());
        bar.set_style(style(total.is_some()));
        bar.set_prefix(label.to_owned());
        self.stack.push(Bar {
            label: label.to_owned(),
            bar,
            begun: Instant::now(),
            on_screen: false,
        });
    }

    pub(super) fn advance(&mut self, steps: u64) {
        if let Some(bar) = self.stack.last() {
            bar.bar.inc(steps);
        }
    }

    pub(super) fn status(&mut self, text: &str) {
        if let Some(bar) = self.stack.last() {
            bar.bar.set_message(text.to_owned());
        }
    }

    pub(super) fn end(&mut self) {
        let Some(work) = self.stack.pop() else {
            return;
        };
        // Clearing a bar moves its position to the end.
        let (done, status) = (work.bar.position(), work.bar.message());
        work.bar.finish_and_clear();
        let duration = work.begun.elapsed();
        if duration >= SHOWN_AFTER {
            let total = work.bar.length();
            self.line(&closing_line(&work.label, duration, done, total, &status));
        }
    }

    pub(super) fn line(&mut self, text: &str) {
        self.screen.suspend(|| {
            // With stderr closed the line is lost; the work itself continues.
            drop(writeln!(io::stderr(), "{text}"));
        });
    }

    /// Removes every bar from the screen, even after interrupted work.
    pub(super) fn clear(&mut self) {
        while let Some(work) = self.stack.pop() {
            work.bar.finish_and_clear();
        }
    }

    /// Shows the bars of work that has lasted long enough, and turns the spinners.
    fn redraw(&mut self) {
        for work in &mut self.stack {
            if !work.on_screen && work.begun.elapsed() >= SHOWN_AFTER {
                work.bar = self.screen.add(work.bar.clone());
                work.on_screen = true;
            }
            if work.on_screen {
                work.bar.tick();
            }
        }
    }
}

fn redraw_while_alive(bars: &Weak<Mutex<Bars>>) {
    while let Some(bars) = bars.upgrade() {
        locked(&bars).redraw();
        drop(bars);
        thread::sleep(REDRAW_EVERY);
    }
}

fn template(has_total: bool) -> &'static str {
    if has_total {
        "{prefix} [{bar:30}] {pos}/{len} {elapsed} (left {eta}) {wide_msg}"
    } else {
        "{spinner} {prefix} {pos} {elapsed} {wide_msg}"
    }
}

fn style(has_total: bool) -> ProgressStyle {
    // The templates are constants, and a test shows that they parse.
    ProgressStyle::with_template(template(has_total))
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_parse() {
        for has_total in [true, false] {
            assert!(ProgressStyle::with_template(template(has_total)).is_ok());
        }
    }
}
