//! Termination by Ctrl-C, by `kill`, or by a cluster's engine before a job's time is up.

use std::sync::{
    Arc, LazyLock,
    atomic::{AtomicBool, Ordering},
};

use anyhow::Context;
use omnilife_reconstruct::process::TERMINATION;

/// Set when this process has been asked to end.
static REQUESTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Set when SIGUSR1 asked it to end: its time here is up, and it may resume elsewhere.
static TIME_IS_UP: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Set when the command at work ends by itself after a request.
static ENDS_BY_ITSELF: AtomicBool = AtomicBool::new(false);

/// Ends the process with its child programs when it is asked to, and says that the same command goes on: finished
/// stages are kept. Commands that end by themselves replace this with their own end.
///
/// # Errors
/// When the system refuses the handlers.
pub(crate) fn announce() -> anyhow::Result<()> {
    #[cfg(unix)]
    {
        use signal_hook::{
            consts::{SIGINT, SIGTERM},
            iterator::Signals,
        };
        let mut signals = Signals::new([SIGTERM, SIGINT]).context("signals cannot be handled")?;
        let watch = move || {
            for signal in signals.forever() {
                if !ENDS_BY_ITSELF.load(Ordering::Relaxed) {
                    end_with_programs(signal);
                }
            }
        };
        // Without the thread, signals would be lost.
        let thread = std::thread::Builder::new().name("signals".to_owned());
        thread.spawn(watch).context("signals cannot be handled")?;
    }
    Ok(())
}

/// Lets training end with a checkpoint when the process is terminated. At any other time, and on a second request,
/// the process ends at once, with its child programs.
///
/// # Errors
/// When the system refuses the handlers.
pub(crate) fn guard_training() -> anyhow::Result<()> {
    #[cfg(unix)]
    {
        let mut signals =
            signal_hook::iterator::Signals::new(signals()).context("signals cannot be handled")?;
        ENDS_BY_ITSELF.store(true, Ordering::Relaxed);
        std::thread::spawn(move || {
            for signal in signals.forever() {
                if TERMINATION.at_once.swap(true, Ordering::Relaxed) {
                    end_with_programs(signal);
                }
                TERMINATION.requested.store(true, Ordering::Relaxed);
            }
        });
    }
    Ok(())
}

/// Ends child programs with all that they have started, then this process, as the signal would have.
#[cfg(unix)]
fn end_with_programs(signal: i32) {
    use std::io::{self, IsTerminal, Write};

    use omnilife_schemas::plain_text::for_terminal;

    use crate::colour;

    let tell = |line: &str| {
        let line = for_terminal(line);
        // With stderr closed the line cannot be written.
        drop(writeln!(io::stderr(), "{}", colour::for_stderr(&line)));
    };
    if io::stderr().is_terminal() {
        // A bar, or the terminal's ^C, stands on the line.
        drop(writeln!(io::stderr()));
    }
    tell("omnilife: interrupted; run the same command again to go on");
    for what in omnilife_schemas::child::end_all() {
        tell(&format!("omnilife: could not be ended: {what}"));
    }
    drop(signal_hook::low_level::emulate_default_handler(signal));
}

/// Returns a flag that is set when the process is asked to end; a second request ends it at once.
///
/// # Errors
/// When the system refuses the handlers.
pub(crate) fn requested() -> anyhow::Result<&'static AtomicBool> {
    ENDS_BY_ITSELF.store(true, Ordering::Relaxed);
    #[cfg(unix)]
    for signal in signals() {
        use signal_hook::flag::{register, register_conditional_default};
        register_conditional_default(signal, Arc::clone(&REQUESTED))
            .and_then(|_| register(signal, Arc::clone(&REQUESTED)))
            .context("signals cannot be handled")?;
    }
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&TIME_IS_UP))
        .context("signals cannot be handled")?;
    Ok(&REQUESTED)
}

/// Ends child programs, with all that they have started, also when the terminal of this process goes away.
///
/// # Errors
/// When the system refuses the handlers.
pub(crate) fn take_programs_along() -> anyhow::Result<()> {
    #[cfg(unix)]
    {
        use signal_hook::{consts::SIGHUP, iterator::Signals};
        let mut signals = Signals::new([SIGHUP]).context("signals cannot be handled")?;
        std::thread::spawn(move || {
            if let Some(signal) = signals.forever().next() {
                end_with_programs(signal);
            }
        });
    }
    Ok(())
}

/// Returns whether SIGUSR1 came: the time of the process here is up, and it is to resume elsewhere.
pub(crate) fn time_is_up() -> bool {
    TIME_IS_UP.load(Ordering::Relaxed)
}

#[cfg(unix)]
fn signals() -> [i32; 3] {
    use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
    [SIGTERM, SIGINT, SIGUSR1]
}
