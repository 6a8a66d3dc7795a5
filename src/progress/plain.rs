//! Progress as plain lines.

use std::{io::Write, time::Duration};

use super::wording::{closing_line, count_of, joined, text_of, times_of};

/// Shortest time between lines about one piece of work.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Progress as one line per event, for logs.
pub(super) struct PlainLines {
    writer: Box<dyn Write + Send>,
    clock: Box<dyn Fn() -> Duration + Send>,
    stack: Vec<PlainWork>,
}

struct PlainWork {
    label: String,
    total: Option<u64>,
    done: u64,
    status: String,
    begun: Duration,
    last_line: Duration,
}

impl PlainLines {
    /// Writes lines to `writer`, timed by `clock`, which returns the time since some fixed moment.
    pub(super) fn new(
        writer: Box<dyn Write + Send>,
        clock: Box<dyn Fn() -> Duration + Send>,
    ) -> Self {
        Self {
            writer,
            clock,
            stack: Vec::new(),
        }
    }

    pub(super) fn begin(&mut self, label: &str, total: Option<u64>) {
        let now = (self.clock)();
        self.line(&format!("{label} ..."));
        self.stack.push(PlainWork {
            label: label.to_owned(),
            total,
            done: 0,
            status: String::new(),
            begun: now,
            last_line: now,
        });
    }

    pub(super) fn advance(&mut self, steps: u64) {
        let now = (self.clock)();
        let Some(work) = self.stack.last_mut() else {
            return;
        };
        work.done = work.done.saturating_add(steps);
        if now.saturating_sub(work.last_line) < LINE_EVERY {
            return;
        }
        work.last_line = now;
        let elapsed = now.saturating_sub(work.begun);
        let parts = [
            count_of(work.done, work.total),
            Some(times_of(work.done, work.total, elapsed)),
            text_of(&work.status),
        ];
        let line = format!("{}: {}", work.label, joined(parts));
        self.indented_line(self.stack.len() - 1, &line);
    }

    pub(super) fn status(&mut self, text: &str) {
        if let Some(work) = self.stack.last_mut() {
            text.clone_into(&mut work.status);
        }
    }

    pub(super) fn end(&mut self) {
        let now = (self.clock)();
        let Some(work) = self.stack.pop() else {
            return;
        };
        let duration = now.saturating_sub(work.begun);
        let line = closing_line(&work.label, duration, work.done, work.total, &work.status);
        self.line(&line);
    }

    /// Writes a line at the depth of the work in progress.
    pub(super) fn line(&mut self, text: &str) {
        self.indented_line(self.stack.len(), text);
    }

    fn indented_line(&mut self, depth: usize, text: &str) {
        // With stderr closed the line is lost; the work itself continues.
        drop(writeln!(self.writer, "{:1$}{text}", "", 2 * depth));
        drop(self.writer.flush());
    }
}
