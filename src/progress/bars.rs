//! Progress as bars on a terminal.

use std::{
    io::{self, Write},
    sync::{Arc, Mutex, Weak},
    thread,
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{locked, wording::closing_line};
use crate::width;

/// Shortest work that gets a bar.
const SHOWN_AFTER: Duration = Duration::from_secs(1);
/// Interval at which bars are redrawn.
const REDRAW_EVERY: Duration = Duration::from_millis(100);
/// Columns of the widest count with its times.
#[cfg(test)]
const COUNT_COLUMNS: usize = "30000/30000 59m (left 59m) ".len();

/// Bars on a terminal, redrawn by a thread of their own that ends with them.
pub(super) struct Bars {
    screen: MultiProgress,
    stack: Vec<Bar>,
    layout: Layout,
}

/// Columns of the parts of a bar, which fit into one line from 60 columns on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    label: usize,
    /// 0 for a line without a bar.
    bar: usize,
}

impl Layout {
    fn of(columns: usize) -> Self {
        let (label, bar) = match columns {
            ..80 => (28, 0),
            80..110 => (30, 12),
            _ => (40, 30),
        };
        Self { label, bar }
    }

    fn template(self, has_total: bool) -> String {
        match (has_total, self.bar) {
            (false, _) => "{spinner} {prefix} {pos} {elapsed} {wide_msg}".to_owned(),
            (true, 0) => "{prefix} {pos}/{len} {elapsed} (left {eta}) {wide_msg}".to_owned(),
            (true, bar) => {
                format!(
                    "{{prefix}} [{{bar:{bar}}}] {{pos}}/{{len}} {{elapsed}} (left {{eta}}) {{wide_msg}}"
                )
            }
        }
    }

    fn apply(self, bar: &ProgressBar, label: &str) {
        // A test shows that the templates parse.
        let style = ProgressStyle::with_template(&self.template(bar.length().is_some()))
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.progress_chars("=> "));
        bar.set_prefix(shortened(label, self.label));
    }
}

/// Returns the label, its middle left out where it has more than `most` characters: ends tell files apart.
fn shortened(label: &str, most: usize) -> String {
    let letters: Vec<char> = label.chars().collect();
    if letters.len() <= most {
        return label.to_owned();
    }
    let head = (most - 1) / 2;
    let tail = letters.len() - (most - 1 - head);
    let part = |range: &[char]| range.iter().collect::<String>();
    format!("{}…{}", part(&letters[..head]), part(&letters[tail..]))
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
            layout: Layout::of(width::of_stderr()),
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
        self.layout.apply(&bar, label);
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
        let layout = Layout::of(width::of_stderr());
        if layout != self.layout {
            self.layout = layout;
            for work in &self.stack {
                layout.apply(&work.bar, &work.label);
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_fit_into_a_line_from_60_columns_on() {
        for columns in 60..200 {
            let layout = Layout::of(columns);
            for has_total in [true, false] {
                assert!(ProgressStyle::with_template(&layout.template(has_total)).is_ok());
            }
            // A blank behind the label, and a blank and two brackets around the bar.
            let bar = if layout.bar == 0 { 0 } else { layout.bar + 3 };
            assert!(
                layout.label + 1 + bar + COUNT_COLUMNS <= columns,
                "{columns}"
            );
        }
    }

    #[test]
    fn long_labels_keep_both_ends() {
        assert_eq!(shortened("training", 8), "training");
        assert_eq!(shortened("analysing walk.mp4", 9), "anal….mp4");
        assert_eq!(shortened("äöüäöüäöü", 5).chars().count(), 5);
    }
}
