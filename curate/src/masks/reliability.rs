//! Measured reliability of mask detectors on labelled footage, and the bar for their use by default.
//!
//! No number, no default: a detector is used without a request only if it was scored on the half of the labels that set
//! none of its limits, and every such score reaches the bar of its target.

use std::fmt;

/// Page with the measurements, their commands and the commit.
pub const SOURCE: &str = "docs/results/curation.md";

/// Half of the labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Half {
    /// Limits were set on it.
    Development,
    /// Unseen while limits were set.
    Test,
}

impl fmt::Display for Half {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Development => "development half",
            Self::Test => "test half",
        })
    }
}

/// Labelled content that a detector is scored by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// People, animals and vehicles that move against the scene.
    Moving,
    /// The person or mount that stays in the camera's frame.
    Operator,
}

impl Target {
    /// Returns the intersection over union that a detector has to reach.
    pub const fn bar(self) -> f64 {
        match self {
            Self::Moving => 0.5,
            Self::Operator => 0.7,
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Moving => "moving content",
            Self::Operator => "the operator",
        })
    }
}

/// Score of a detector on a labelled clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Id of the detector.
    pub detector: &'static str,
    /// Clip, without extension.
    pub clip: &'static str,
    /// Half of the labels that has the clip.
    pub half: Half,
    /// Content that was scored.
    pub target: Target,
    /// Intersection over union over all labelled frames, by solid angle, 0 to 1.
    pub iou: f64,
}

/// All measurements, by `scripts/labels/score.py masks` and `operator`; [`SOURCE`] has the same numbers.
pub const MEASURED: &[Measurement] = &[
    Measurement {
        detector: "residual",
        clip: "congo_stereo",
        half: Half::Development,
        target: Target::Moving,
        iou: 0.480,
    },
    Measurement {
        detector: "residual",
        clip: "bikes",
        half: Half::Test,
        target: Target::Moving,
        iou: 0.390,
    },
    Measurement {
        detector: "deeplab",
        clip: "bikes",
        half: Half::Test,
        target: Target::Moving,
        iou: 0.177,
    },
    Measurement {
        detector: "combined",
        clip: "bikes",
        half: Half::Test,
        target: Target::Moving,
        iou: 0.214,
    },
    Measurement {
        detector: "operator",
        clip: "tunnel",
        half: Half::Development,
        target: Target::Operator,
        iou: 0.780,
    },
    Measurement {
        detector: "operator",
        clip: "reef",
        half: Half::Test,
        target: Target::Operator,
        iou: 0.0,
    },
];

/// Reliability of a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Reliability {
    /// True if it is used without a request.
    pub reaches_bar: bool,
    /// Measurements in words, with their source.
    pub text: String,
}

/// Returns the reliability of a detector by its id, for one target.
pub fn of(detector: &str, target: Target) -> Reliability {
    judged(detector, target, MEASURED)
}

fn judged(detector: &str, target: Target, measured: &[Measurement]) -> Reliability {
    let own = measured.iter();
    let own = own.filter(|score| score.detector == detector && score.target == target);
    let own: Vec<&Measurement> = own.collect();
    let bar = target.bar();
    let unseen = || own.iter().filter(|score| score.half == Half::Test);
    let reaches_bar = unseen().count() > 0 && unseen().all(|score| score.iou >= bar);
    let scores = own.iter().map(|score| {
        let Measurement {
            clip, half, iou, ..
        } = score;
        format!("{iou:.3} on {clip} ({half})")
    });
    let scores: Vec<String> = scores.collect();
    let measured = if scores.is_empty() {
        format!("its IoU with {target} is not measured on labelled footage")
    } else {
        format!("IoU with {target} {}", scores.join(", "))
    };
    Reliability {
        reaches_bar,
        text: format!("{measured}; the bar is {bar} on the test half ({SOURCE})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(half: Half, iou: f64) -> Measurement {
        Measurement {
            detector: "net",
            clip: "bikes",
            half,
            target: Target::Moving,
            iou,
        }
    }

    #[test]
    fn unseen_scores_alone_make_a_default() {
        let reaches = |scores: &[Measurement]| judged("net", Target::Moving, scores).reaches_bar;
        assert!(!reaches(&[]));
        assert!(!reaches(&[score(Half::Development, 0.9)]));
        assert!(reaches(&[score(Half::Test, 0.5)]));
        assert!(!reaches(&[score(Half::Test, 0.9), score(Half::Test, 0.49)]));
        assert!(!judged("other", Target::Moving, &[score(Half::Test, 0.9)]).reaches_bar);
        assert!(!judged("net", Target::Operator, &[score(Half::Test, 0.9)]).reaches_bar);
    }

    #[test]
    fn words_have_the_numbers_and_their_page() {
        let text = judged("net", Target::Moving, &[score(Half::Test, 0.25)]).text;
        assert!(text.contains("0.250 on bikes (test half)") && text.contains(SOURCE));
        let text = judged("other", Target::Moving, &[]).text;
        assert!(text.contains("not measured"), "{text}");
        for score in MEASURED {
            assert!((0.0..=1.0).contains(&score.iou), "{score:?}");
        }
    }
}
