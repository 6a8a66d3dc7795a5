//! Advice in words for poses that are not valid, from what the attempts measured.

use omnilife_schemas::records::{SfmAttempt, ValidationStatus};

use crate::poses::validate::ValidationLimits;

/// A camera whose frames the best rotation leaves apart by less than this is static, degrees: about a pixel of a
/// panorama of 1,024.
pub(super) const STATIC_DEGREES: f64 = 0.35;

/// Facts beside the attempts that advice depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Circumstances {
    /// Parallax of the pair of frames that has most of it, degrees, where it was measured.
    pub(super) parallax_degrees: Option<f64>,
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
    if let Some(degrees) = circumstances
        .parallax_degrees
        .filter(|degrees| *degrees < STATIC_DEGREES)
    {
        return vec![format!(
            "the camera is static: rotations alone leave {degrees:.2} degrees between its frames; it cannot be \
             posed by structure from motion, give its poses (--poses)"
        )];
    }
    let mut words = Vec::new();
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
    if models <= 1 && registered < limits.registered_share {
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
    if !circumstances.has_ignored && (disagrees || validation.is_none()) {
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

    const NOTHING: Circumstances = Circumstances {
        parallax_degrees: Some(4.0),
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

    /// A static camera is named by itself, whatever else is missing, and only below the limit.
    #[test]
    fn a_static_camera_is_named() {
        let standing = |degrees| Circumstances {
            parallax_degrees: Some(degrees),
            ..NOTHING
        };
        let limits = ValidationLimits::default();
        let still = advice(&[], None, &limits, standing(0.9 * STATIC_DEGREES));
        assert_eq!(still.len(), 1);
        assert!(still[0].contains("static"), "{still:?}");
        let moving = advice(&[], None, &limits, standing(1.1 * STATIC_DEGREES));
        assert!(
            !moving.is_empty() && !moving[0].contains("static"),
            "{moving:?}"
        );
    }
}
