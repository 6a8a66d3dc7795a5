//! Progress for the user: bars on a terminal, plain lines elsewhere, JSON if asked for, nothing with `--quiet`.
//!
//! Everything goes to stderr, so that stdout carries results only.

mod bars;
mod json;
mod plain;
mod wording;

use std::{
    io::{self, IsTerminal},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use omnilife_schemas::{plain_text::for_terminal, progress::Progress};

use crate::{cli::ProgressArgument, colour};
use bars::Bars;
use json::JsonLines;
use plain::PlainLines;

/// Progress on the user's terminal.
pub(crate) struct Terminal {
    output: Output,
}

enum Output {
    Quiet,
    Plain(Mutex<PlainLines>),
    Json(Mutex<JsonLines>),
    Bars(Arc<Mutex<Bars>>),
}

impl Terminal {
    /// Makes silence when `quiet`, JSON if it is asked for, bars when stderr is a terminal, and plain lines otherwise.
    pub(crate) fn new(quiet: bool, format: ProgressArgument) -> Self {
        let begun = Instant::now();
        let clock = Box::new(move || begun.elapsed());
        let output = if quiet {
            Output::Quiet
        } else if format == ProgressArgument::Json {
            Output::Json(Mutex::new(JsonLines::new(Box::new(io::stderr()), clock)))
        } else if io::stderr().is_terminal() {
            Output::Bars(Bars::start())
        } else {
            Output::Plain(Mutex::new(PlainLines::new(Box::new(io::stderr()), clock)))
        };
        Self { output }
    }
}

impl Drop for Terminal {
    /// Removes all bars, even after interrupted work.
    fn drop(&mut self) {
        if let Output::Bars(bars) = &self.output {
            locked(bars).clear();
        }
    }
}

impl Progress for Terminal {
    fn begin(&self, label: &str, total: Option<u64>) {
        let label = &for_terminal(label);
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).begin(label, total),
            Output::Json(lines) => locked(lines).begin(label, total),
            Output::Bars(bars) => locked(bars).begin(label, total),
        }
    }

    fn advance(&self, steps: u64) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).advance(steps),
            Output::Json(lines) => locked(lines).advance(steps),
            Output::Bars(bars) => locked(bars).advance(steps),
        }
    }

    fn status(&self, text: &str) {
        let text = &for_terminal(text);
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).status(text),
            Output::Json(lines) => locked(lines).status(text),
            Output::Bars(bars) => locked(bars).status(text),
        }
    }

    fn end(&self) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).end(),
            Output::Json(lines) => locked(lines).end(),
            Output::Bars(bars) => locked(bars).end(),
        }
    }

    fn note(&self, line: &str) {
        let line = &for_terminal(line);
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).line(&colour::for_stderr(line)),
            Output::Json(lines) => locked(lines).line(line),
            Output::Bars(bars) => locked(bars).line(&colour::for_stderr(line)),
        }
    }
}

/// Locks the mutex even if a thread panicked while reporting, so that the others still report.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail loudly")]

    use std::{
        io::Write,
        sync::atomic::{AtomicU64, Ordering},
        thread,
        time::Duration,
    };

    use super::*;

    #[derive(Clone, Default)]
    struct Page(Arc<Mutex<Vec<u8>>>);

    impl Write for Page {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Page {
        fn lines(&self) -> Vec<String> {
            let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
            text.lines().map(str::to_owned).collect()
        }
    }

    /// Makes a plain terminal that writes to a page, and its clock in milliseconds.
    fn plain() -> (Terminal, Page, Arc<AtomicU64>) {
        let page = Page::default();
        let clock = Arc::new(AtomicU64::new(0));
        let read = Arc::clone(&clock);
        let terminal = Terminal {
            output: Output::Plain(Mutex::new(PlainLines::new(
                Box::new(page.clone()),
                Box::new(move || Duration::from_millis(read.load(Ordering::Relaxed))),
            ))),
        };
        (terminal, page, clock)
    }

    #[test]
    fn long_work_gets_a_line_every_ten_seconds() {
        let (terminal, page, clock) = plain();
        terminal.begin("train", Some(60));
        for step in 1..=60 {
            clock.store(step * 500, Ordering::Relaxed);
            terminal.status(&format!("loss 1/{step}"));
            terminal.advance(1);
        }
        terminal.end();
        assert_eq!(
            page.lines(),
            [
                "train ...",
                "train: 20 of 60 (33 %), after 10 s, left 20 s, loss 1/20",
                "train: 40 of 60 (67 %), after 20 s, left 10 s, loss 1/40",
                "train: 60 of 60 (100 %), after 30 s, loss 1/60",
                "train: done in 30 s, loss 1/60",
            ]
        );
    }

    #[test]
    fn nested_work_is_indented_and_notes_stand_where_they_belong() {
        let (terminal, page, clock) = plain();
        terminal.begin("curate", None);
        terminal.note("street.mp4: 60 frames");
        terminal.begin("decode", Some(2));
        terminal.advance(1);
        clock.store(12_000, Ordering::Relaxed);
        terminal.advance(1);
        terminal.end();
        terminal.end();
        terminal.note("all done");
        assert_eq!(
            page.lines(),
            [
                "curate ...",
                "  street.mp4: 60 frames",
                "  decode ...",
                "  decode: 2 of 2 (100 %), after 12 s",
                "  decode: done in 12 s",
                "curate: done in 12 s",
                "all done",
            ]
        );
    }

    #[test]
    fn work_broken_off_does_not_read_as_done() {
        let (terminal, page, clock) = plain();
        terminal.begin("decode", Some(8));
        terminal.advance(2);
        clock.store(2_500, Ordering::Relaxed);
        terminal.end();
        assert_eq!(page.lines()[1], "decode: ended after 2.5 s, 2 of 8 (25 %)");
    }

    #[test]
    fn control_characters_do_not_reach_the_terminal() {
        let (terminal, page, _) = plain();
        terminal.note("a\u{1b}[31mb");
        terminal.begin("c\u{7}", None);
        assert_eq!(page.lines(), ["a\\u{1b}[31mb", "c\\u{7} ..."]);
    }

    #[test]
    fn programs_get_an_object_per_event() {
        let (page, clock) = (Page::default(), Arc::new(AtomicU64::new(0)));
        let read = Arc::clone(&clock);
        let terminal = Terminal {
            output: Output::Json(Mutex::new(JsonLines::new(
                Box::new(page.clone()),
                Box::new(move || Duration::from_millis(read.load(Ordering::Relaxed))),
            ))),
        };
        terminal.begin("curate", None);
        terminal.begin("train \"x\"", Some(60));
        for step in 1..=60 {
            clock.store(step * 10, Ordering::Relaxed);
            terminal.status(&format!("loss 1/{step}"));
            terminal.advance(1);
        }
        terminal.note("a line");
        terminal.end();
        terminal.end();
        terminal.end();
        let count = |event: &str, done: u64, status: &str| {
            format!(
                r#"{{"event":"{event}","depth":1,"label":"train \"x\"","done":{done},"total":60,"status":"{status}"}}"#
            )
        };
        let of_curate = |event: &str| {
            format!(
                r#"{{"event":"{event}","depth":0,"label":"curate","done":0,"total":null,"status":""}}"#
            )
        };
        assert_eq!(
            page.lines(),
            [
                of_curate("progress"),
                count("progress", 0, ""),
                count("progress", 20, "loss 1/20"),
                count("progress", 40, "loss 1/40"),
                count("progress", 60, "loss 1/60"),
                r#"{"event":"note","line":"a line"}"#.to_owned(),
                count("end", 60, "loss 1/60"),
                of_curate("end"),
            ]
        );
    }

    #[test]
    fn calls_without_work_are_harmless() {
        let (terminal, page, _) = plain();
        terminal.advance(1);
        terminal.status("nothing");
        terminal.end();
        assert!(page.lines().is_empty());
    }

    #[test]
    fn counts_from_many_threads_add_up() {
        let (terminal, page, clock) = plain();
        terminal.begin("blocks", Some(400));
        thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..100).for_each(|_| terminal.advance(1)));
            }
        });
        clock.store(10_000, Ordering::Relaxed);
        terminal.advance(0);
        assert_eq!(page.lines()[1], "blocks: 400 of 400 (100 %), after 10 s");
    }
}
