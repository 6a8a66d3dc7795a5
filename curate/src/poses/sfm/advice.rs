//! Advice in words for poses that are not valid, from what the attempts measured.

use omnilife_schemas::records::{SfmAttempt, ValidationStatus};

use crate::poses::validate::ValidationLimits;

/// Facts beside the attempts that advice depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Circumstances {
    /// Parallax of the pair of frames that has most of it, degrees, where it was measured.
    pub(super) parallax_degrees: Option<f64>,
    /// Degrees of a pixel of a panorama; `None` of perspective frames.
    pub(super) pixel_degrees: Option<f64>,
    /// True if the program crashed, was killed, or left invalid files in an attempt.
    pub(super) is_broken: bool,
    /// True if masks of dynamic regions were given.
    pub(super) has_masks: bool,
    /// True if ignored regions were given.
    pub(super) has_ignored: bool,
}

/// Returns advice for the chosen attempt, or for all failed ones; nothing for valid poses.
pub(super) fn advice(
    attempts: &[SfmAttempt],
    chosen: Option<usize>,
    limits: &ValidationLimits,
    circumstances: Circumstances,
) -> Vec<String> {
    let attempt = chosen.and_then(|index| attempts.get(index));
    let validation = attempt.and_then(|attempt| attempt.validation.as_ref());
    if validation.is_some_and(|validation| validation.status == ValidationStatus::Valid) {
        return Vec::new();
    }
    let mut words = Vec::new();
    let parallax = circumstances.parallax_degrees;
    let least = circumstances.pixel_degrees;
    let unmoved = parallax
        .zip(least)
        .filter(|(degrees, least)| degrees < least);
    if let Some((degrees, _)) = unmoved {
        words.push(format!(
            "rotations alone explain frames that share matches to {degrees:.2} degrees: the camera is static, or its \
             frames are too close in time (take fewer, --fps)"
        ));
    }
    let models = attempt.map_or_else(
        || {
            attempts
                .iter()
                .map(|attempt| attempt.models)
                .max()
                .unwrap_or(0)
        },
        |attempt| attempt.models,
    );
    if models > 1 {
        words.push(format!(
            "the frames fell apart into {models} models: look for a cut or a frame without detail between them, or \
             sample more frames (--fps)"
        ));
    }
    let registered = validation.map_or(0.0, |validation| {
        f64::from(validation.registered_frames) / f64::from(validation.total_frames.max(1))
    });
    // A crash says nothing about the frames, and more of them do not help a camera that hardly moves between them.
    let is_judged = validation.is_some() || !circumstances.is_broken;
    if models <= 1 && registered < limits.registered_share && is_judged && unmoved.is_none() {
        words.push(format!(
            "{:.0} % of the frames are registered: sample more frames (--fps), so that neighbours see the same",
            100.0 * registered
        ));
    }
    let measure =
        |name: &str| validation.and_then(|validation| validation.measures.get(name).copied());
    if measure("fewest_points").is_some_and(|points| points < limits.fewest_points) {
        words.push(
            "a frame has hardly any features: curate larger frames (--width) or the sharpest ones (--select sharp)"
                .to_owned(),
        );
    }
    if measure("median_triangulation_degrees")
        .is_some_and(|degrees| degrees < limits.median_triangulation_degrees)
    {
        words.push(
            "the camera hardly moves for the distance of what it sees: take a longer part of the video".to_owned(),
        );
    }
    let disagrees = measure("p90_error_degrees").is_some_and(|p90| p90 > limits.p90_error_degrees);
    if !circumstances.has_masks && (disagrees || validation.is_none()) {
        words.push("mask what moves (`curate masks`, then --masks)".to_owned());
    }
    let is_panorama = circumstances.pixel_degrees.is_some();
    if is_panorama && !circumstances.has_ignored && (disagrees || validation.is_none()) {
        words.push(
            "mask the operator, who stays in the camera's frame (`curate operator`, then --ignore-mask)".to_owned(),
        );
    }
    words
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use omnilife_schemas::records::PoseValidation;

    use super::*;

    /// Degrees of a pixel of a panorama that is 512 wide.
    const PIXEL: f64 = 360.0 / 512.0;
    const NOTHING: Circumstances = Circumstances {
        parallax_degrees: Some(4.0),
        pixel_degrees: Some(PIXEL),
        is_broken: false,
        has_masks: true,
        has_ignored: true,
    };

    fn attempt(models: u32, registered: u32, measures: &[(&str, f64)]) -> SfmAttempt {
        SfmAttempt {
            configuration: "global".to_owned(),
            wall_seconds: 1.0,
            cpu_seconds: None,
            loops: None,
            models,
            validation: Some(PoseValidation {
                status: ValidationStatus::Unstable,
                registered_frames: registered,
                total_frames: 30,
                measures: measures
                    .iter()
                    .map(|(name, value)| ((*name).to_owned(), *value))
                    .collect::<BTreeMap<String, f64>>(),
                problems: vec!["one".to_owned()],
            }),
            held_out: None,
            failure: None,
        }
    }

    fn words(attempt: &SfmAttempt, circumstances: Circumstances) -> Vec<String> {
        let attempts = std::slice::from_ref(attempt);
        advice(
            attempts,
            Some(0),
            &ValidationLimits::default(),
            circumstances,
        )
    }

    /// Every cause has its own advice, and valid poses have none.
    #[test]
    fn every_cause_has_its_own_advice() {
        let all = attempt(1, 30, &[]);
        assert!(words(&all, NOTHING).is_empty());
        for (attempt, option) in [
            (attempt(1, 20, &[]), "--fps"),
            (attempt(3, 20, &[]), "3 models"),
            (attempt(1, 30, &[("fewest_points", 20.0)]), "--select sharp"),
            (
                attempt(1, 30, &[("median_triangulation_degrees", 0.5)]),
                "longer part",
            ),
        ] {
            let words = words(&attempt, NOTHING);
            assert_eq!(words.len(), 1, "{words:?}");
            assert!(words[0].contains(option), "{words:?}");
        }
        let unmasked = Circumstances {
            has_masks: false,
            has_ignored: false,
            ..NOTHING
        };
        assert_eq!(
            words(&attempt(1, 30, &[("p90_error_degrees", 2.0)]), unmasked).len(),
            2
        );
        assert!(words(&attempt(1, 30, &[("p90_error_degrees", 0.1)]), unmasked).is_empty());
        // Perspective frames do not show the operator.
        let perspective = Circumstances {
            pixel_degrees: None,
            ..unmasked
        };
        let masked = words(&attempt(1, 30, &[("p90_error_degrees", 2.0)]), perspective);
        assert_eq!(masked.len(), 1, "{masked:?}");
        assert!(masked[0].contains("`curate masks`"), "{masked:?}");
        let mut valid = attempt(1, 29, &[]);
        if let Some(validation) = &mut valid.validation {
            validation.status = ValidationStatus::Valid;
        }
        let standing = Circumstances {
            parallax_degrees: Some(0.0),
            ..unmasked
        };
        assert!(words(&valid, standing).is_empty());
    }

    /// Frames that rotations explain to less than a pixel are named beside other advice, and not asked to be more.
    #[test]
    fn a_static_camera_is_named() {
        let standing = |degrees| Circumstances {
            parallax_degrees: Some(degrees),
            has_masks: false,
            ..NOTHING
        };
        let limits = ValidationLimits::default();
        let still = advice(&[], None, &limits, standing(0.9 * PIXEL));
        assert_eq!(still.len(), 2, "{still:?}");
        assert!(still[0].contains("static"), "{still:?}");
        assert!(still[1].contains("--masks"), "{still:?}");
        let moving = advice(&[], None, &limits, standing(1.1 * PIXEL));
        assert_eq!(moving.len(), 2, "{moving:?}");
        assert!(moving[0].contains("sample more frames"), "{moving:?}");
    }

    /// Without a model, a program that broke has registered nothing for no reason of the frames.
    #[test]
    fn a_broken_program_is_no_reason_for_more_frames() {
        let broken = |is_broken| Circumstances {
            is_broken,
            ..NOTHING
        };
        let limits = ValidationLimits::default();
        assert!(advice(&[], None, &limits, broken(true)).is_empty());
        assert_eq!(advice(&[], None, &limits, broken(false)).len(), 1);
        let few = attempt(1, 20, &[]);
        assert_eq!(words(&few, broken(true)).len(), 1);
    }
}
