//! How long work takes, on the wall's clock and on the CPU.

use std::time::{Duration, Instant};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Time that some work took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Elapsed {
    /// Wall-clock time, seconds.
    pub wall_seconds: f64,
    /// CPU time (user and system) of all threads of the process and of the programs that it ran meanwhile,
    /// seconds, where the system tells; records of older versions do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_seconds: Option<f64>,
}

/// Wall-clock time alone.
impl From<f64> for Elapsed {
    fn from(wall_seconds: f64) -> Self {
        Self {
            wall_seconds,
            cpu_seconds: None,
        }
    }
}

/// Measures how long work takes from when it is started on.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    begun: Instant,
    cpu_begun: Option<Duration>,
}

impl Stopwatch {
    /// Begins to count.
    pub fn start() -> Self {
        Self {
            begun: Instant::now(),
            cpu_begun: cpu_time(),
        }
    }

    /// The time since.
    pub fn elapsed(&self) -> Elapsed {
        let cpu = cpu_time().zip(self.cpu_begun);
        Elapsed {
            wall_seconds: self.begun.elapsed().as_secs_f64(),
            cpu_seconds: cpu.map(|(now, begun)| now.saturating_sub(begun).as_secs_f64()),
        }
    }
}

/// User and system time of all threads of this process, and of the programs that it has run and that have ended,
/// so far, where the system tells (Unix).
fn cpu_time() -> Option<Duration> {
    #[cfg(unix)]
    {
        use nix::sys::{
            resource::{UsageWho, getrusage},
            time::TimeVal,
        };
        let duration = |time: TimeVal| {
            let seconds = u64::try_from(time.tv_sec()).ok()?;
            let microseconds = u64::try_from(time.tv_usec()).ok()?;
            Some(Duration::from_secs(seconds) + Duration::from_micros(microseconds))
        };
        let of = |who: UsageWho| {
            let usage = getrusage(who).ok()?;
            Some(duration(usage.user_time())? + duration(usage.system_time())?)
        };
        Some(of(UsageWho::RUSAGE_SELF)? + of(UsageWho::RUSAGE_CHILDREN)?)
    }
    #[cfg(not(unix))]
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_of_this_process_takes_time_on_both_clocks() {
        let watch = Stopwatch::start();
        let mut sum = 0.0_f64;
        while watch.begun.elapsed() < Duration::from_millis(60) {
            sum += std::hint::black_box(1.5_f64).sqrt();
        }
        let took = watch.elapsed();
        assert!(sum > 0.0 && took.wall_seconds >= 0.06);
        if cfg!(unix) {
            // Other processes may have had the core for a part of it.
            assert!(took.cpu_seconds.is_some_and(|cpu| cpu > 0.005), "{took:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn work_of_other_programs_counts() {
        let watch = Stopwatch::start();
        let loops = "i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done";
        let status = std::process::Command::new("sh")
            .args(["-c", loops])
            .status();
        assert!(status.is_ok_and(|status| status.success()));
        assert!(watch.elapsed().cpu_seconds.is_some_and(|cpu| cpu > 0.001));
    }

    #[test]
    fn times_of_older_records_are_read() {
        let read = |text: &str| serde_json::from_str::<Elapsed>(text).ok();
        assert_eq!(read(r#"{"wall_seconds": 2.5}"#), Some(2.5.into()));
    }
}
