//! Rejection of single shots: those without content, title cards, and those in another projection than their video.
//!
//! The analysis keeps measures of a frame every 0.4 s (`samples.rs`). Once boundaries are known, the checks of
//! [`CHECKS`] examine the samples of each shot. A shot is rejected on proof only: dark, foggy, still and short shots
//! stay. `scripts/calibrate/shots.py` has the same limits and counts how often they are right.

mod content;
mod list;
mod samples;

use omnilife_schemas::{
    records::{CheckOutcome, RejectedShot, TimeRange},
    statistics,
};

pub(crate) use list::ShotList;
pub use samples::SamplePass;
pub(crate) use samples::{SETTINGS, Samples};

use crate::projection::{FLAT_SEAM, Proof, proof};

/// Least difference between the darkest and brightest part of a frame that is not a single colour, 8-bit levels.
const LEAST_SPREAD_LEVELS: f64 = 8.0;
/// Quantile of the frames that decides on the content of a shot.
const BETTER_SHARE: f64 = 0.75;
/// Least share of a frame's blocks in the background of a title card.
const CARD_BACKGROUND_SHARE: f64 = 0.6;
/// Letters stand out by this much, 8-bit levels; dark shots do not span it, and their blacks may be of one level.
const CARD_SPREAD_LEVELS: f64 = 64.0;
/// Largest share of cells that change from one sample to the next in a mostly still shot: cards fade in and out.
const STILL_SHARE: f64 = 0.002;
/// Least number of frames for judging a projection.
const LEAST_SAMPLES: usize = 2;

/// Statistics of the samples of a shot.
struct Numbers {
    samples: usize,
    spread_levels: f64,
    background_share: f64,
    /// `None` for a single sample.
    changed_share: Option<f64>,
    proof: Proof,
}

/// A check of single shots.
pub struct ShotCheck {
    /// Unique id, recorded in `boundaries.json`, `slices.json` and `attrition.csv`.
    pub id: &'static str,
    /// Condition of failure, in one sentence.
    pub summary: &'static str,
    /// Content of a shot that fails it, and meaning of the value.
    pub reading: &'static str,
    /// The limit that the value is beyond.
    pub limit: f64,
    /// True for a check of the projection, which the user may override.
    is_of_projection: bool,
    /// Returns the value of a shot that fails it.
    failing: fn(&Numbers) -> Option<f64>,
}

/// All checks, in the order in which they are tried.
pub static CHECKS: &[ShotCheck] = &[
    ShotCheck {
        id: "blank",
        summary: "Shots of one colour: the darkest and the brightest cell of a frame hardly differ, in three of four \
                  frames and more.",
        reading: "shows one colour, whose levels span",
        limit: LEAST_SPREAD_LEVELS,
        is_of_projection: false,
        failing: |numbers| {
            (numbers.spread_levels < LEAST_SPREAD_LEVELS).then_some(numbers.spread_levels)
        },
    },
    ShotCheck {
        id: "title-card",
        summary: "Letters on one colour: most of the frame is of one level, something stands out from it, and hardly \
                  anything changes.",
        reading: "is a still card, and its background covers a share of",
        limit: CARD_BACKGROUND_SHARE,
        is_of_projection: false,
        failing: |numbers| {
            let is_still = numbers
                .changed_share
                .is_some_and(|share| share <= STILL_SHARE);
            let is_card = numbers.spread_levels >= CARD_SPREAD_LEVELS
                && numbers.background_share > CARD_BACKGROUND_SHARE;
            (is_still && is_card).then_some(numbers.background_share)
        },
    },
    ShotCheck {
        id: "shot-projection",
        summary: "Images of an ordinary camera: the left and the right edge do not meet, and the top or the \
                  bottom row is not a pole. Not asked where the user states the projection.",
        reading: "is a flat image without poles, whose left and right edge differ by",
        limit: FLAT_SEAM,
        is_of_projection: true,
        failing: |numbers| match numbers.proof {
            Proof::Flat { seam } if numbers.samples >= LEAST_SAMPLES => Some(seam),
            _ => None,
        },
    },
];

impl Samples {
    /// Returns the statistics of a shot's samples; `None` without samples.
    fn numbers(&self, shot: TimeRange) -> Option<Numbers> {
        let inside = self.inside(shot);
        Some(Numbers {
            samples: inside.count(),
            spread_levels: statistics::quantile(&inside.spreads_levels(), BETTER_SHARE)?,
            background_share: statistics::quantile(
                &inside.background_shares(),
                1.0 - BETTER_SHARE,
            )?,
            changed_share: statistics::median(&inside.changed_shares()),
            proof: proof(inside.readings()),
        })
    }

    /// Returns the first check that a shot fails; without `judges_projection`, those about the projection do not count.
    pub(crate) fn rejected(
        &self,
        shot: TimeRange,
        judges_projection: bool,
    ) -> Option<RejectedShot> {
        let numbers = self.numbers(shot)?;
        CHECKS
            .iter()
            .filter(|check| judges_projection || !check.is_of_projection)
            .find_map(|check| {
                Some(RejectedShot {
                    range: shot,
                    check: check.id.to_owned(),
                    value: (check.failing)(&numbers)?,
                    limit: check.limit,
                    reading: check.reading.to_owned(),
                })
            })
    }

    /// Returns the share of time, 0 to 1, of shots that are whole spheres by their own frames.
    fn sphere_share(&self, shots: &[TimeRange]) -> f64 {
        let is_sphere = |shot: TimeRange| {
            self.numbers(shot)
                .is_some_and(|numbers| numbers.proof == Proof::Sphere)
        };
        let (mut spheres, mut all) = (0.0, 0.0);
        for &shot in shots {
            all += shot.duration_seconds();
            if is_sphere(shot) {
                spheres += shot.duration_seconds();
            }
        }
        if all > 0.0 { spheres / all } else { 0.0 }
    }
}

/// Describes the content of a rejected shot, with its value.
pub(crate) fn described(shot: &RejectedShot) -> String {
    format!("{} {:.3}", shot.reading, shot.value)
}

/// Describes the limit of a check of shots.
pub(crate) fn limit(shot: &RejectedShot) -> String {
    format!("a limit of {}", shot.limit)
}

/// Returns the failed checks of rejected shots, in decreasing order of their time.
pub(crate) fn outcomes(rejected: &[RejectedShot]) -> Vec<CheckOutcome> {
    let mut by_time: Vec<(f64, CheckOutcome)> = CHECKS
        .iter()
        .filter_map(|check| {
            let shots = || rejected.iter().filter(|shot| shot.check == check.id);
            let first = shots().next()?;
            let seconds = shots().map(|shot| shot.range.duration_seconds()).sum();
            let outcome = CheckOutcome {
                check: check.id.to_owned(),
                passed: false,
                value: format!("{} shots of {seconds:.3} s", shots().count()),
                threshold: limit(first),
            };
            Some((seconds, outcome))
        })
        .collect();
    by_time.sort_by(|a, b| b.0.total_cmp(&a.0));
    by_time.into_iter().map(|(_, outcome)| outcome).collect()
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::Probe;
    use omnilife_video::Rgb8Image;

    use super::*;

    fn image(level: impl Fn(usize, usize) -> u8) -> Rgb8Image {
        let (width, height) = (128, 64);
        Rgb8Image {
            width,
            height,
            data: (0..width * height)
                .flat_map(|at| [level(at % width, at / width); 3])
                .collect(),
        }
    }

    fn samples(images: &[Rgb8Image]) -> Samples {
        let probe = Probe {
            frames_per_second: 2.0,
            duration_seconds: 1.0,
            ..Probe::of_size([128, 64])
        };
        let mut pass = SamplePass::default();
        for (number, image) in images.iter().enumerate() {
            pass.observe(&probe, number as f64 * 0.5, image);
        }
        pass.finish()
    }

    fn from_to(begin_seconds: f64, end_seconds: f64) -> TimeRange {
        TimeRange::new(begin_seconds, end_seconds)
    }

    #[test]
    fn what_changes_at_a_cut_is_no_change_of_the_shot() {
        let busy = || image(|x, y| ((x * 37 + y * 91) % 251) as u8);
        let card = || {
            let is_letter = |x: usize, y: usize| (48..80).contains(&x) && (28..36).contains(&y);
            image(|x, y| if is_letter(x, y) { 240 } else { 10 })
        };
        let found = samples(&[busy(), busy(), card(), card()]);
        let rejected = found
            .rejected(from_to(1.0, 2.0), true)
            .map(|shot| shot.check);
        assert_eq!(rejected.as_deref(), Some("title-card"));
        // One sample does not show whether it is still, and no sample shows anything.
        assert_eq!(found.rejected(from_to(1.0, 1.4), true), None);
        assert_eq!(found.rejected(from_to(1.1, 1.4), true), None);
    }

    #[test]
    fn a_shot_that_comes_up_from_black_is_not_blank() {
        let black = || image(|_, _| 2);
        let busy = || image(|x, y| ((x * 37 + y * 91) % 251) as u8);
        let found = samples(&[black(), black(), busy(), busy()]);
        assert_eq!(found.rejected(from_to(0.0, 2.0), false), None);
        let rejected = found.rejected(from_to(0.0, 1.0), false);
        assert_eq!(rejected.map(|shot| shot.check).as_deref(), Some("blank"));
    }

    #[test]
    fn what_takes_most_time_is_named_first() {
        let shot = |check: &ShotCheck, begin: f64, end: f64| RejectedShot {
            range: from_to(begin, end),
            check: check.id.to_owned(),
            value: 1.0,
            limit: check.limit,
            reading: check.reading.to_owned(),
        };
        let rejected = [
            shot(&CHECKS[0], 0.0, 1.0),
            shot(&CHECKS[1], 1.0, 4.0),
            shot(&CHECKS[0], 4.0, 5.0),
        ];
        let failed = outcomes(&rejected);
        let checks: Vec<&str> = failed.iter().map(|outcome| &*outcome.check).collect();
        assert_eq!(checks, [CHECKS[1].id, CHECKS[0].id]);
    }
}
