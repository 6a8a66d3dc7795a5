//! Progress as JSON, an object per line, for programs that start this one.
//!
//! ```text
//! {"event":"progress","depth":0,"label":"training","done":120,"total":1500,"status":"..."}
//! {"event":"end","depth":0,"label":"training","done":1500,"total":1500,"status":"..."}
//! {"event":"note","line":"street.mp4: 60 frames"}
//! ```
//!
//! `total` is null where it is unknown. `depth` counts the pieces of work around this one. A piece of work has an
//! object at its begin, at most five in a second on its way, and one at its end.

use std::{io::Write, time::Duration};

use serde::Serialize;

/// Shortest time between objects about one piece of work.
const OBJECT_EVERY: Duration = Duration::from_millis(200);

/// Progress as a JSON object per event.
pub(super) struct JsonLines {
    writer: Box<dyn Write + Send>,
    clock: Box<dyn Fn() -> Duration + Send>,
    stack: Vec<Work>,
}

struct Work {
    label: String,
    total: Option<u64>,
    done: u64,
    status: String,
    last_object: Duration,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase", tag = "event")]
enum Event<'a> {
    Progress(Count<'a>),
    End(Count<'a>),
    Note { line: &'a str },
}

#[derive(Serialize)]
struct Count<'a> {
    depth: usize,
    label: &'a str,
    done: u64,
    total: Option<u64>,
    status: &'a str,
}

impl JsonLines {
    /// Writes objects to `writer`, timed by `clock`, which returns the time since some fixed moment.
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
        self.stack.push(Work {
            label: label.to_owned(),
            total,
            done: 0,
            status: String::new(),
            last_object: (self.clock)(),
        });
        self.progress();
    }

    pub(super) fn advance(&mut self, steps: u64) {
        let now = (self.clock)();
        let Some(work) = self.stack.last_mut() else {
            return;
        };
        work.done = work.done.saturating_add(steps);
        if now.saturating_sub(work.last_object) >= OBJECT_EVERY {
            work.last_object = now;
            self.progress();
        }
    }

    pub(super) fn status(&mut self, text: &str) {
        if let Some(work) = self.stack.last_mut() {
            text.clone_into(&mut work.status);
        }
    }

    pub(super) fn end(&mut self) {
        if let Some(work) = self.stack.pop() {
            let count = work.count(self.stack.len());
            write(&mut self.writer, &Event::End(count));
        }
    }

    pub(super) fn line(&mut self, line: &str) {
        write(&mut self.writer, &Event::Note { line });
    }

    fn progress(&mut self) {
        if let Some(work) = self.stack.last() {
            let count = work.count(self.stack.len() - 1);
            write(&mut self.writer, &Event::Progress(count));
        }
    }
}

impl Work {
    fn count(&self, depth: usize) -> Count<'_> {
        Count {
            depth,
            label: &self.label,
            done: self.done,
            total: self.total,
            status: &self.status,
        }
    }
}

fn write(writer: &mut dyn Write, event: &Event<'_>) {
    // With stderr closed the object is lost; the work itself continues.
    if let Ok(text) = serde_json::to_string(event) {
        drop(writeln!(writer, "{text}"));
        drop(writer.flush());
    }
}
