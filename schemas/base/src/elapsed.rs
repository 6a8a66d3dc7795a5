//! Wall-clock time and CPU time of work.

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

/// From wall-clock time alone.
impl From<f64> for Elapsed {
    fn from(wall_seconds: f64) -> Self {
        Self {
            wall_seconds,
            cpu_seconds: None,
        }
    }
}

impl Elapsed {
    /// Returns the wall-clock time; zero for seconds that are negative or not finite.
    pub fn wall(self) -> Duration {
        Duration::try_from_secs_f64(self.wall_seconds).unwrap_or_default()
    }

    /// Returns the CPU time, if known.
    pub fn cpu(self) -> Option<Duration> {
        let seconds = self.cpu_seconds?;
        Some(Duration::try_from_secs_f64(seconds).unwrap_or_default())
    }

    /// Returns the sum of both times, of work one after the other; CPU time as far as it is known.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let cpu = [self.cpu_seconds, other.cpu_seconds];
        let is_known = cpu.iter().any(Option::is_some);
        Self {
            wall_seconds: self.wall_seconds + other.wall_seconds,
            cpu_seconds: is_known.then(|| cpu.into_iter().flatten().sum()),
        }
    }
}

/// Measures the time of work from its start.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    begun: Instant,
    cpu_begun: Option<Duration>,
    cpu_time: fn() -> Option<Duration>,
}

impl Stopwatch {
    /// Starts to count the time of this process and of the programs that it runs, once they have ended.
    pub fn with_children() -> Self {
        Self::by(cpu_time_with_children)
    }

    /// Starts to count the time of this process alone, for comparisons of its parts.
    pub fn of_own_process() -> Self {
        Self::by(own_cpu_time)
    }

    fn by(cpu_time: fn() -> Option<Duration>) -> Self {
        Self {
            begun: Instant::now(),
            cpu_begun: cpu_time(),
            cpu_time,
        }
    }

    /// Returns the time since the start.
    pub fn elapsed(&self) -> Elapsed {
        let cpu = (self.cpu_time)().zip(self.cpu_begun);
        Elapsed {
            wall_seconds: self.begun.elapsed().as_secs_f64(),
            cpu_seconds: cpu.map(|(now, begun)| now.saturating_sub(begun).as_secs_f64()),
        }
    }
}

/// Returns the user and system time of all threads of this process so far, where the system reports it (Unix).
pub fn own_cpu_time() -> Option<Duration> {
    #[cfg(unix)]
    {
        cpu_time_of(nix::sys::resource::UsageWho::RUSAGE_SELF)
    }
    #[cfg(not(unix))]
    None
}

/// Returns [`own_cpu_time`] plus the CPU time of programs that this process has run and that have ended.
fn cpu_time_with_children() -> Option<Duration> {
    #[cfg(unix)]
    {
        Some(own_cpu_time()? + cpu_time_of(nix::sys::resource::UsageWho::RUSAGE_CHILDREN)?)
    }
    #[cfg(not(unix))]
    None
}

#[cfg(unix)]
fn cpu_time_of(who: nix::sys::resource::UsageWho) -> Option<Duration> {
    use nix::sys::{resource::getrusage, time::TimeVal};
    let duration = |time: TimeVal| {
        let seconds = u64::try_from(time.tv_sec()).ok()?;
        let microseconds = u64::try_from(time.tv_usec()).ok()?;
        Some(Duration::from_secs(seconds) + Duration::from_micros(microseconds))
    };
    let usage = getrusage(who).ok()?;
    Some(duration(usage.user_time())? + duration(usage.system_time())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_of_this_process_takes_time_on_both_clocks() {
        let watch = Stopwatch::with_children();
        let mut sum = 0.0_f64;
        while watch.begun.elapsed() < Duration::from_millis(60) {
            sum += std::hint::black_box(1.5_f64).sqrt();
        }
        let took = watch.elapsed();
        assert!(sum > 0.0 && took.wall_seconds >= 0.06);
        if cfg!(unix) {
            // Other processes may have used the core for a part of it.
            assert!(took.cpu_seconds.is_some_and(|cpu| cpu > 0.005), "{took:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn only_one_of_the_clocks_counts_other_programs() {
        let (watch, own) = (Stopwatch::with_children(), Stopwatch::of_own_process());
        let loops = "i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done";
        let status = std::process::Command::new("sh")
            .args(["-c", loops])
            .status();
        assert!(status.is_ok_and(|status| status.success()));
        let [with, without] = [watch, own].map(|watch| watch.elapsed().cpu_seconds);
        // Other tests run in this process at the same time, and count for both.
        let programs = with.zip(without).map(|(with, without)| with - without);
        assert!(programs.is_some_and(|cpu| cpu > 0.001), "{programs:?}");
    }

    #[test]
    fn times_add_up_as_far_as_they_are_known() {
        let known = Elapsed {
            wall_seconds: 2.0,
            cpu_seconds: Some(3.5),
        };
        let both = known.plus(0.5.into());
        assert_eq!((both.wall_seconds, both.cpu_seconds), (2.5, Some(3.5)));
        assert_eq!(known.plus(known).cpu(), Some(Duration::from_secs(7)));
        let unknown = Elapsed::from(1.0).plus(f64::NAN.into());
        assert_eq!((unknown.wall(), unknown.cpu()), (Duration::ZERO, None));
    }

    #[test]
    fn times_of_older_records_are_read() {
        let read = |text: &str| serde_json::from_str::<Elapsed>(text).ok();
        assert_eq!(read(r#"{"wall_seconds": 2.5}"#), Some(2.5.into()));
    }
}
