//! How progress reaches the user: bars on a terminal, plain lines elsewhere, nothing with `--quiet`.
//!
//! Everything goes to stderr, so that stdout carries results only.

use std::{
    io::{self, IsTerminal, Write},
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
    thread,
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use omnilife_schemas::progress::Progress;

/// Work shorter than this gets no bar.
const SHOWN_AFTER: Duration = Duration::from_secs(1);
/// How often bars are redrawn.
const REDRAW_EVERY: Duration = Duration::from_millis(100);
/// Plain lines about one piece of work are at least this far apart.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(10);

/// Reports progress to the user.
pub(crate) struct Terminal {
    output: Output,
}

enum Output {
    Quiet,
    Plain(Mutex<PlainLines>),
    Bars(Arc<Mutex<Bars>>),
}

impl Terminal {
    /// Silence when `quiet`; bars when stderr is a terminal; plain lines otherwise.
    pub(crate) fn new(quiet: bool) -> Self {
        let output = if quiet {
            Output::Quiet
        } else if io::stderr().is_terminal() {
            Output::Bars(Bars::start())
        } else {
            let begun = Instant::now();
            Output::Plain(Mutex::new(PlainLines {
                writer: Box::new(io::stderr()),
                clock: Box::new(move || begun.elapsed()),
                stack: Vec::new(),
            }))
        };
        Self { output }
    }
}

impl Drop for Terminal {
    /// Leaves no bar behind, whatever work was broken off.
    fn drop(&mut self) {
        if let Output::Bars(bars) = &self.output {
            let mut bars = locked(bars);
            while let Some(bar) = bars.stack.pop() {
                bar.bar.finish_and_clear();
            }
        }
    }
}

impl Progress for Terminal {
    fn begin(&self, label: &str, total: Option<u64>) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).begin(label, total),
            Output::Bars(bars) => locked(bars).begin(label, total),
        }
    }

    fn advance(&self, steps: u64) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).advance(steps),
            Output::Bars(bars) => locked(bars).advance(steps),
        }
    }

    fn remark(&self, text: &str) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).remark(text),
            Output::Bars(bars) => locked(bars).remark(text),
        }
    }

    fn end(&self) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).end(),
            Output::Bars(bars) => locked(bars).end(),
        }
    }

    fn note(&self, line: &str) {
        match &self.output {
            Output::Quiet => {}
            Output::Plain(lines) => locked(lines).line(line),
            Output::Bars(bars) => locked(bars).line(line),
        }
    }
}

/// A thread that panicked while reporting must not silence the others.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One line per event, for logs.
struct PlainLines {
    writer: Box<dyn Write + Send>,
    /// Time since some fixed moment.
    clock: Box<dyn Fn() -> Duration + Send>,
    stack: Vec<PlainWork>,
}

struct PlainWork {
    label: String,
    total: Option<u64>,
    done: u64,
    remark: String,
    begun: Duration,
    last_line: Duration,
}

impl PlainWork {
    /// The count, as far as there is one: `12 of 60 (20 %)`, or `12`.
    fn count(&self) -> Option<String> {
        match (self.total, self.done) {
            (Some(total), done) if total > 0 => {
                let percent = 100.0 * done as f64 / total as f64;
                Some(format!("{done} of {total} ({percent:.0} %)"))
            }
            (_, 0) => None,
            (_, done) => Some(done.to_string()),
        }
    }
}

impl PlainLines {
    fn begin(&mut self, label: &str, total: Option<u64>) {
        let now = (self.clock)();
        self.line(&format!("{label} ..."));
        self.stack.push(PlainWork {
            label: label.to_owned(),
            total,
            done: 0,
            remark: String::new(),
            begun: now,
            last_line: now,
        });
    }

    fn advance(&mut self, steps: u64) {
        let now = (self.clock)();
        let Some(work) = self.stack.last_mut() else {
            return;
        };
        work.done = work.done.saturating_add(steps);
        if now.saturating_sub(work.last_line) < PLAIN_LINE_EVERY {
            return;
        }
        work.last_line = now;
        let parts = [work.count(), text_of(&work.remark)];
        let line = format!("{}: {}", work.label, joined(parts));
        self.indented_line(self.stack.len() - 1, &line);
    }

    fn remark(&mut self, text: &str) {
        if let Some(work) = self.stack.last_mut() {
            text.clone_into(&mut work.remark);
        }
    }

    fn end(&mut self) {
        let now = (self.clock)();
        let Some(work) = self.stack.pop() else {
            return;
        };
        let duration = seconds(now.saturating_sub(work.begun));
        // Work that was broken off must not read as complete.
        let incomplete = work.total.is_some_and(|total| work.done < total);
        let state = if incomplete {
            format!("ended after {duration}")
        } else {
            format!("done in {duration}")
        };
        let count = if incomplete { work.count() } else { None };
        let parts = [Some(state), count, text_of(&work.remark)];
        let line = format!("{}: {}", work.label, joined(parts));
        self.line(&line);
    }

    /// Writes a line at the depth of the work in progress.
    fn line(&mut self, text: &str) {
        self.indented_line(self.stack.len(), text);
    }

    fn indented_line(&mut self, depth: usize, text: &str) {
        // A closed stderr leaves nobody to tell; the work itself goes on.
        drop(writeln!(self.writer, "{:1$}{text}", "", 2 * depth));
        drop(self.writer.flush());
    }
}

fn text_of(remark: &str) -> Option<String> {
    (!remark.is_empty()).then(|| remark.to_owned())
}

fn joined<const N: usize>(parts: [Option<String>; N]) -> String {
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// A duration for people: `0.4 s`, `83 s`, `12 min 5 s`.
fn seconds(duration: Duration) -> String {
    let seconds = duration.as_secs_f64();
    if seconds < 9.95 {
        format!("{seconds:.1} s")
    } else if seconds < 599.5 {
        format!("{seconds:.0} s")
    } else {
        let whole = seconds.round() as u64;
        format!("{} min {} s", whole / 60, whole % 60)
    }
}

/// Bars on a terminal, redrawn by a thread of their own that ends with them.
struct Bars {
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
    fn start() -> Arc<Mutex<Self>> {
        let bars = Arc::new(Mutex::new(Self {
            screen: MultiProgress::new(),
            stack: Vec::new(),
        }));
        let watched = Arc::downgrade(&bars);
        // Without the thread, bars still move when work advances.
        drop(
            thread::Builder::new()
                .name("progress".to_owned())
                .spawn(move || redraw_while_alive(&watched)),
        );
        bars
    }

    fn begin(&mut self, label: &str, total: Option<u64>) {
        let bar = ProgressBar::with_draw_target(total, indicatif::ProgressDrawTarget::hidden());
        bar.set_style(style(total.is_some()));
        bar.set_prefix(label.to_owned());
        self.stack.push(Bar {
            label: label.to_owned(),
            bar,
            begun: Instant::now(),
            on_screen: false,
        });
    }

    fn advance(&mut self, steps: u64) {
        if let Some(bar) = self.stack.last() {
            bar.bar.inc(steps);
        }
    }

    fn remark(&mut self, text: &str) {
        if let Some(bar) = self.stack.last() {
            bar.bar.set_message(text.to_owned());
        }
    }

    fn end(&mut self) {
        let Some(work) = self.stack.pop() else {
            return;
        };
        work.bar.finish_and_clear();
        let duration = work.begun.elapsed();
        if duration >= SHOWN_AFTER {
            let remark = text_of(&work.bar.message());
            let state = Some(seconds(duration));
            self.line(&format!("{}: {}", work.label, joined([state, remark])));
        }
    }

    fn line(&mut self, text: &str) {
        self.screen.suspend(|| {
            // A closed stderr leaves nobody to tell; the work itself goes on.
            drop(writeln!(io::stderr(), "{text}"));
        });
    }

    /// Shows what has lasted long enough, and lets the spinners turn.
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
    #![expect(clippy::unwrap_used, reason = "a test may fail loudly")]

    use std::sync::atomic::{AtomicU64, Ordering};

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

    /// A plain terminal that writes to a page, and its clock in milliseconds.
    fn plain() -> (Terminal, Page, Arc<AtomicU64>) {
        let page = Page::default();
        let clock = Arc::new(AtomicU64::new(0));
        let read = Arc::clone(&clock);
        let terminal = Terminal {
            output: Output::Plain(Mutex::new(PlainLines {
                writer: Box::new(page.clone()),
                clock: Box::new(move || Duration::from_millis(read.load(Ordering::Relaxed))),
                stack: Vec::new(),
            })),
        };
        (terminal, page, clock)
    }

    #[test]
    fn long_work_gets_a_line_every_ten_seconds() {
        let (terminal, page, clock) = plain();
        terminal.begin("train", Some(60));
        for step in 1..=60 {
            clock.store(step * 500, Ordering::Relaxed);
            terminal.remark(&format!("loss 1/{step}"));
            terminal.advance(1);
        }
        terminal.end();
        assert_eq!(
            page.lines(),
            [
                "train ...",
                "train: 20 of 60 (33 %), loss 1/20",
                "train: 40 of 60 (67 %), loss 1/40",
                "train: 60 of 60 (100 %), loss 1/60",
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
                "  decode: 2 of 2 (100 %)",
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
    fn calls_without_work_are_harmless() {
        let (terminal, page, _) = plain();
        terminal.advance(1);
        terminal.remark("nothing");
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
        assert_eq!(page.lines()[1], "blocks: 400 of 400 (100 %)");
    }

    #[test]
    fn durations_read_well() {
        let read = |milliseconds| seconds(Duration::from_millis(milliseconds));
        assert_eq!(read(0), "0.0 s");
        assert_eq!(read(9_960), "10 s");
        assert_eq!(read(83_400), "83 s");
        assert_eq!(read(725_000), "12 min 5 s");
    }

    #[test]
    fn templates_parse() {
        for has_total in [true, false] {
            assert!(ProgressStyle::with_template(template(has_total)).is_ok());
        }
    }
}
