//! Texts of progress lines.

use std::time::Duration;

/// Returns the line of the log at the end of work. Interrupted work does not read as done.
pub(super) fn closing_line(
    label: &str,
    duration: Duration,
    done: u64,
    total: Option<u64>,
    status: &str,
) -> String {
    let duration = seconds(duration);
    let parts = if total.is_some_and(|total| done < total) {
        let count = count_of(done, total);
        [
            Some(format!("ended after {duration}")),
            count,
            text_of(status),
        ]
    } else {
        [Some(format!("done in {duration}")), None, text_of(status)]
    };
    format!("{label}: {}", joined(parts))
}

/// Returns the count as far as it is known: `12 of 60 (20 %)`, or `12`.
pub(super) fn count_of(done: u64, total: Option<u64>) -> Option<String> {
    match total {
        Some(total) if total > 0 => {
            let percent = 100.0 * done as f64 / total as f64;
            Some(format!("{done} of {total} ({percent:.0} %)"))
        }
        _ if done == 0 => None,
        _ => Some(done.to_string()),
    }
}

/// Returns the time so far, and an estimate of the rest where the total is known: `after 10 s, left 20 s`.
pub(super) fn times_of(done: u64, total: Option<u64>, elapsed: Duration) -> String {
    let after = format!("after {}", seconds(elapsed));
    let left = total
        .filter(|&total| 0 < done && done < total)
        .map(|total| {
            let ratio = (total - done) as f64 / done as f64;
            Duration::try_from_secs_f64(elapsed.as_secs_f64() * ratio)
        });
    match left {
        Some(Ok(left)) => format!("{after}, left {}", seconds(left)),
        // A total without sense gives no duration.
        Some(Err(_)) | None => after,
    }
}

pub(super) fn text_of(status: &str) -> Option<String> {
    (!status.is_empty()).then(|| status.to_owned())
}

pub(super) fn joined<const N: usize>(parts: [Option<String>; N]) -> String {
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Returns a duration in words: `0.4 s`, `83 s`, `12 min 5 s`.
pub(super) fn seconds(duration: Duration) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_is_estimated_where_it_can_be() {
        let minute = Duration::from_secs(60);
        assert_eq!(times_of(2, Some(6), minute), "after 60 s, left 120 s");
        for (done, total) in [(0, Some(6)), (6, Some(6)), (2, None), (1, Some(u64::MAX))] {
            assert_eq!(times_of(done, total, minute), "after 60 s");
        }
    }

    #[test]
    fn durations_read_well() {
        let read = |milliseconds| seconds(Duration::from_millis(milliseconds));
        assert_eq!(read(0), "0.0 s");
        assert_eq!(read(9_960), "10 s");
        assert_eq!(read(83_400), "83 s");
        assert_eq!(read(725_000), "12 min 5 s");
    }
}
