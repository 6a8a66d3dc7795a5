//! Measures of curves over the logarithm of time.
//!
//! Between two rows quality is linear in the logarithm of time, so that a measure depends on the method and not on the
//! rows of its trace. Before the first row quality is unknown.

use super::trace::{TraceRow, TracedRun};

/// Qualities whose times are reported, dB.
pub const QUALITIES_DB: [u32; 6] = [20, 22, 24, 26, 28, 30];
/// Times at which the quality is reported, seconds.
pub const MOMENTS_SECONDS: [u32; 5] = [10, 60, 180, 600, 1800];
/// Distances below a run's own final quality whose times are reported, dB.
pub const BELOW_END_DB: [f64; 2] = [1.0, 0.5];

/// A run with the measures of its curve.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCurve {
    /// The run.
    pub run: TracedRun,
    /// First time at each of [`QUALITIES_DB`].
    pub to_quality: Vec<Crossing>,
    /// First time at each of [`BELOW_END_DB`] below its final quality.
    pub to_own_end: Vec<Crossing>,
    /// Quality at each of [`MOMENTS_SECONDS`], dB; none before the first row. After the end of a run it is the final
    /// one.
    pub at_moment: Vec<Option<f64>>,
    /// Area under the curve over the logarithm of time, divided by that of the common span: mean quality, dB. None if
    /// the comparison has no such span or the run no curve.
    pub log_area_db: Option<f64>,
    /// The same of SSIM. None also if the run's rows lack it.
    pub log_area_ssim: Option<f64>,
    /// The same of LPIPS (`AlexNet`).
    pub log_area_lpips_alex: Option<f64>,
    /// True for a known training time without a dominating run of the comparison. That would be as good in training
    /// time, final quality and peak memory, and better in one of them.
    pub on_front: bool,
}

/// First time at which a curve reaches a quality.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Crossing {
    /// At no row.
    Never,
    /// At or before the first row with a time: nothing more is known.
    AtMost {
        /// Training time of that row, seconds.
        seconds: f64,
    },
    /// Between two rows, or at the start of a run that takes no time.
    At {
        /// Training time, seconds.
        seconds: f64,
        /// Iterations done, if counted.
        iteration: Option<u64>,
    },
}

impl Crossing {
    /// Returns the training time in seconds, if known.
    pub fn seconds(&self) -> Option<f64> {
        match self {
            Self::At { seconds, .. } => Some(*seconds),
            Self::Never | Self::AtMost { .. } => None,
        }
    }

    /// Returns the iterations done, if known.
    pub fn iteration(&self) -> Option<u64> {
        match self {
            Self::At { iteration, .. } => *iteration,
            Self::Never | Self::AtMost { .. } => None,
        }
    }
}

/// The common time of all curves of a comparison: from the latest first row to the earliest last one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Its start, seconds; above 0.
    pub from_seconds: f64,
    /// Its end, seconds; after the start.
    pub until_seconds: f64,
}

#[derive(Debug, Clone, Copy)]
struct Moment {
    seconds: f64,
    iteration: Option<u64>,
    quality: f64,
}

/// Returns the PSNR of a run's rows; for a run without rows only its end, if its time is known.
fn moments(run: &TracedRun) -> Vec<Moment> {
    let end = run.training_seconds.map(|seconds| Moment {
        seconds,
        iteration: run.iterations,
        quality: run.final_scores.psnr_db,
    });
    if run.rows.is_empty() {
        end.into_iter().collect()
    } else {
        moments_of(run, |row| Some(row.psnr_db))
    }
}

fn moments_of(run: &TracedRun, quality: fn(&TraceRow) -> Option<f64>) -> Vec<Moment> {
    let moment = |row: &TraceRow| {
        Some(Moment {
            seconds: row.seconds,
            iteration: Some(row.iteration),
            quality: quality(row)?,
        })
    };
    run.rows.iter().filter_map(moment).collect()
}

/// Measures runs of one scene and protocol against each other; `span` is that of [`common_span`].
pub(super) fn measured(runs: &[TracedRun], span: Option<Span>) -> Vec<RunCurve> {
    runs.iter()
        .map(|run| RunCurve {
            on_front: run.training_seconds.is_some()
                && !runs.iter().any(|other| dominates(other, run)),
            ..curve_of(run, span)
        })
        .collect()
}

/// Returns the common time of all runs with a curve.
///
/// # Errors
/// With a line on the reason: fewer than two runs have two rows at different times, or one ends before another starts.
pub(super) fn common_span(runs: &[TracedRun]) -> Result<Span, &'static str> {
    let spans: Vec<Span> = runs
        .iter()
        .filter_map(|run| span_of(&moments(run)))
        .collect();
    if spans.len() < 2 {
        return Err("fewer than two runs have scores along their training");
    }
    let (begins, ends) = (
        spans.iter().map(|span| span.from_seconds),
        spans.iter().map(|span| span.until_seconds),
    );
    let common = Span {
        from_seconds: begins.fold(0.0, f64::max),
        until_seconds: ends.fold(f64::INFINITY, f64::min),
    };
    if common.from_seconds < common.until_seconds {
        Ok(common)
    } else {
        Err("one run ends before another has its first row")
    }
}

/// Returns the time of the rows; time 0 has no logarithm.
fn span_of(moments: &[Moment]) -> Option<Span> {
    let first = moments.iter().find(|moment| moment.seconds > 0.0)?;
    let span = Span {
        from_seconds: first.seconds,
        until_seconds: moments.last()?.seconds,
    };
    (span.from_seconds < span.until_seconds).then_some(span)
}

/// Returns the measures of one run by itself, with the area over `span`.
fn curve_of(run: &TracedRun, span: Option<Span>) -> RunCurve {
    let moments = moments(run);
    let area = |moments: &[Moment]| {
        span.filter(|_| span_of(moments).is_some())
            .and_then(|span| mean_over_log_time(moments, span))
    };
    RunCurve {
        to_quality: QUALITIES_DB
            .map(|quality| crossing(&moments, f64::from(quality)))
            .into(),
        to_own_end: BELOW_END_DB
            .map(|below| crossing(&moments, run.final_scores.psnr_db - below))
            .into(),
        at_moment: MOMENTS_SECONDS
            .map(|seconds| quality_at(&moments, f64::from(seconds)))
            .into(),
        log_area_db: area(&moments),
        log_area_ssim: area(&moments_of(run, |row| row.ssim)),
        log_area_lpips_alex: area(&moments_of(run, |row| row.lpips_alex)),
        on_front: true,
        run: run.clone(),
    }
}

fn crossing(moments: &[Moment], quality_db: f64) -> Crossing {
    let Some(first) = moments.first() else {
        return Crossing::Never;
    };
    if first.quality >= quality_db {
        return if first.seconds > 0.0 {
            Crossing::AtMost {
                seconds: first.seconds,
            }
        } else {
            Crossing::At {
                seconds: first.seconds,
                iteration: first.iteration,
            }
        };
    }
    // First row at or above it: the one before is below.
    let mut pairs = moments.iter().zip(moments.iter().skip(1));
    let Some((below, above)) = pairs.find(|(_, after)| after.quality >= quality_db) else {
        return Crossing::Never;
    };
    if below.seconds > 0.0 {
        between(below, above, quality_db)
    } else {
        Crossing::AtMost {
            seconds: above.seconds,
        }
    }
}

/// Finds the quality on the line between two moments, over the logarithm of time.
fn between(below: &Moment, above: &Moment, quality_db: f64) -> Crossing {
    let share = (quality_db - below.quality) / (above.quality - below.quality);
    let seconds = below.seconds * (above.seconds / below.seconds).powf(share);
    // Steps take about equally long.
    let of_steps = if above.seconds > below.seconds {
        (seconds - below.seconds) / (above.seconds - below.seconds)
    } else {
        1.0
    };
    let iterations = below.iteration.zip(above.iteration);
    Crossing::At {
        seconds,
        iteration: iterations.map(|(before, after)| {
            before + (of_steps * after.saturating_sub(before) as f64).round() as u64
        }),
    }
}

fn quality_at(moments: &[Moment], seconds: f64) -> Option<f64> {
    let after = moments.partition_point(|moment| moment.seconds <= seconds);
    let before = moments.get(after.checked_sub(1)?)?;
    let Some(next) = moments.get(after) else {
        return Some(before.quality);
    };
    if before.seconds <= 0.0 {
        return None;
    }
    let share = (seconds / before.seconds).ln() / (next.seconds / before.seconds).ln();
    Some(before.quality + share * (next.quality - before.quality))
}

/// Returns the mean quality over the logarithm of time, in its own unit.
fn mean_over_log_time(moments: &[Moment], span: Span) -> Option<f64> {
    let Span {
        from_seconds,
        until_seconds,
    } = span;
    let is_inside =
        |moment: &&Moment| from_seconds < moment.seconds && moment.seconds < until_seconds;
    let mut points = vec![(from_seconds, quality_at(moments, from_seconds)?)];
    points.extend(
        moments
            .iter()
            .filter(is_inside)
            .map(|moment| (moment.seconds, moment.quality)),
    );
    points.push((until_seconds, quality_at(moments, until_seconds)?));
    let pieces = points.iter().zip(points.iter().skip(1));
    let area: f64 = pieces
        .map(|(&(begin, first), &(end, last))| 0.5 * (first + last) * (end / begin).ln())
        .sum();
    Some(area / (until_seconds / from_seconds).ln())
}

/// Returns true if `left` is nowhere worse than `right` and somewhere better. A run of unknown memory is compared by
/// time and quality, one of unknown time with none.
fn dominates(left: &TracedRun, right: &TracedRun) -> bool {
    let times = left.training_seconds.zip(right.training_seconds);
    let Some((time_left, time_right)) = times else {
        return false;
    };
    let (quality_left, quality_right) = (left.final_scores.psnr_db, right.final_scores.psnr_db);
    let memories = left.peak_memory_bytes.zip(right.peak_memory_bytes);
    let (memory_left, memory_right) = memories.unwrap_or((0, 0));
    let is_nowhere_worse =
        time_left <= time_right && quality_left >= quality_right && memory_left <= memory_right;
    let is_better =
        time_left < time_right || quality_left > quality_right || memory_left < memory_right;
    is_nowhere_worse && is_better
}

#[cfg(test)]
mod tests;
