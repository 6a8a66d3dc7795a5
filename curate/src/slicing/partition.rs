//! From boundaries to shots: the continuous takes of a video, and the segments between them.

use omnilife_schemas::records::{Boundary, RejectedShot, Segment, SegmentOutcome, TimeRange};

/// The shots of a video.
#[derive(Debug, Clone, PartialEq)]
pub struct Shots {
    /// Long enough to become sequences, in order of time.
    pub kept: Vec<TimeRange>,
    /// Too short.
    pub dropped: Vec<TimeRange>,
    /// Long enough, but excluded by people.
    pub left_out: Vec<TimeRange>,
    /// Long enough, but rejected by a check of single shots.
    pub rejected: Vec<RejectedShot>,
}

impl Shots {
    /// Moves shots that people exclude to the excluded ones.
    pub fn leave_out(&mut self, is_left_out: impl Fn(TimeRange) -> bool) {
        let kept = std::mem::take(&mut self.kept);
        (self.left_out, self.kept) = kept.into_iter().partition(|&shot| is_left_out(shot));
    }

    /// Moves shots that fail a check to the rejected ones.
    pub fn reject(&mut self, check: impl Fn(TimeRange) -> Option<RejectedShot>) {
        for shot in std::mem::take(&mut self.kept) {
            match check(shot) {
                Some(rejected) => self.rejected.push(rejected),
                None => self.kept.push(shot),
            }
        }
    }
}

/// Cuts a video into shots at its boundaries.
///
/// `times` are the timestamps of all frames in order, `range` their whole segment, and `boundaries` are in order of
/// time. The interior of a gradual transition belongs to no shot: the old one ends after the frame at `begin_seconds`,
/// the new one starts with the frame at `end_seconds`. Shots shorter than `minimum_seconds` are dropped.
pub fn shots(
    times: &[f64],
    range: TimeRange,
    boundaries: &[Boundary],
    minimum_seconds: f64,
) -> Shots {
    let mut all = Vec::new();
    let mut begin = range.begin_seconds;
    for boundary in boundaries {
        let after = times.partition_point(|&time| time <= boundary.begin_seconds);
        let end = times.get(after).copied().unwrap_or(range.end_seconds);
        if end > begin {
            all.push(TimeRange::new(begin, end));
        }
        begin = boundary.end_seconds.max(begin);
    }
    if range.end_seconds > begin {
        all.push(TimeRange::new(begin, range.end_seconds));
    }
    let (kept, dropped) = all
        .into_iter()
        .partition(|shot| shot.duration_seconds() >= minimum_seconds - 1e-9);
    Shots {
        kept,
        dropped,
        left_out: Vec::new(),
        rejected: Vec::new(),
    }
}

/// Returns the whole of `range` without gaps or overlaps: shots as [`shots`] finds them, and the interiors of the
/// transitions between them. `name` gives the sequence of a kept shot by its number.
pub fn segments(range: TimeRange, shots: &Shots, name: impl Fn(usize) -> String) -> Vec<Segment> {
    let kept = shots
        .kept
        .iter()
        .enumerate()
        .map(|(index, &range)| Segment {
            range,
            outcome: SegmentOutcome::Kept {
                sequence: name(index),
                slice: None,
            },
        });
    let dropped = shots.dropped.iter().map(|&range| Segment {
        range,
        outcome: SegmentOutcome::TooShort,
    });
    let left_out = shots.left_out.iter().map(|&range| Segment {
        range,
        outcome: SegmentOutcome::LeftOut,
    });
    let rejected = shots.rejected.iter().map(|shot| Segment {
        range: shot.range,
        outcome: SegmentOutcome::Rejected {
            check: shot.check.clone(),
            value: shot.value,
            limit: shot.limit,
            reading: shot.reading.clone(),
        },
    });
    let known = kept.chain(dropped).chain(left_out).chain(rejected);
    let mut known: Vec<Segment> = known.collect();
    known.sort_by(|a, b| a.range.begin_seconds.total_cmp(&b.range.begin_seconds));
    let mut all = Vec::with_capacity(2 * known.len() + 1);
    let mut reached = range.begin_seconds;
    let transition = |begin_seconds, end_seconds| Segment {
        range: TimeRange::new(begin_seconds, end_seconds),
        outcome: SegmentOutcome::Transition,
    };
    for segment in known {
        if segment.range.begin_seconds > reached {
            all.push(transition(reached, segment.range.begin_seconds));
        }
        reached = segment.range.end_seconds;
        all.push(segment);
    }
    if range.end_seconds > reached {
        all.push(transition(reached, range.end_seconds));
    }
    all
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::BoundaryKind;
    use proptest::prelude::*;

    use super::*;

    fn boundary(begin_seconds: f64, end_seconds: f64) -> Boundary {
        Boundary {
            begin_seconds,
            end_seconds,
            kind: BoundaryKind::Gradual,
            score: 1.0,
        }
    }

    #[test]
    fn transitions_belong_to_no_shot_and_short_shots_are_dropped() {
        let times: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.1).collect();
        let range = TimeRange::new(0.0, 10.0);
        let found = shots(
            &times,
            range,
            &[
                boundary(times[29], times[30]),
                boundary(times[34], times[40]),
            ],
            1.0,
        );
        let span = |begin: usize, end| TimeRange::new(times[begin], end);
        assert_eq!(found.kept, [span(0, times[30]), span(40, 10.0)]);
        assert_eq!(found.dropped, [span(30, times[35])]);
        let all = segments(range, &found, |index| format!("seq-{index:03}"));
        let outcomes: Vec<&SegmentOutcome> = all.iter().map(|segment| &segment.outcome).collect();
        assert!(matches!(
            outcomes[..],
            [
                SegmentOutcome::Kept { .. },
                SegmentOutcome::TooShort,
                SegmentOutcome::Transition,
                SegmentOutcome::Kept { .. }
            ]
        ));
        assert_eq!(all[2].range, span(35, times[40]));
        let mut fewer = found;
        fewer.leave_out(|shot| shot.begin_seconds == 0.0);
        assert_eq!(
            (&fewer.kept[..], &fewer.left_out[..]),
            (&[span(40, 10.0)][..], &[span(0, times[30])][..])
        );
        let all = segments(range, &fewer, |index| format!("seq-{index:03}"));
        assert_eq!(all[0].outcome, SegmentOutcome::LeftOut);
        assert_eq!(all.len(), 4, "and all of the video is accounted for");
    }

    proptest! {
        /// Shots are disjoint, in order, inside the range, and hold every frame that is strictly
        /// inside no transition.
        #[test]
        fn shots_partition_the_frames(cuts in proptest::collection::vec((1_usize..199, 1_usize..9), 0..6)) {
            let times: Vec<f64> = (0..200).map(|i| f64::from(i) / 25.0 + 3.0).collect();
            let range = TimeRange { begin_seconds: times[0], end_seconds: 11.0 };
            let mut last = 0;
            let mut boundaries = Vec::new();
            let mut inside = Vec::new();
            let mut cuts = cuts;
            cuts.sort_unstable();
            for (begin, length) in cuts {
                let end = (begin + length).min(199);
                if begin < last { continue; }
                boundaries.push(boundary(times[begin], times[end]));
                inside.extend(begin + 1..end);
                last = end;
            }
            let found = shots(&times, range, &boundaries, 0.0);
            prop_assert!(found.dropped.is_empty());
            let all = segments(range, &found, |index| index.to_string());
            prop_assert_eq!(all[0].range.begin_seconds, range.begin_seconds);
            prop_assert_eq!(all[all.len() - 1].range.end_seconds, range.end_seconds);
            for pair in all.windows(2) {
                prop_assert_eq!(pair[0].range.end_seconds, pair[1].range.begin_seconds);
            }
            for pair in found.kept.windows(2) {
                prop_assert!(pair[0].end_seconds <= pair[1].begin_seconds);
            }
            for (index, &time) in times.iter().enumerate() {
                let holders = found.kept.iter().filter(|shot| shot.contains(time)).count();
                prop_assert_eq!(holders, usize::from(!inside.contains(&index)), "frame {}", index);
            }
        }
    }
}
