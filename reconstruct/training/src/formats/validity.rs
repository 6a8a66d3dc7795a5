//! Validity of Gaussians: one rule for all readers of files and for exports.
//!
//! * An opacity logit of infinity is an opacity of 1, and valid. One of minus infinity is an opacity of 0: the
//!   Gaussian is left out.
//! * A quaternion of zeros is read as the identity, as renderers draw it. If log scales and opacity are 0 as
//!   well, which training never produces, the row is padding and left out.
//! * An axis of size 0 becomes as thin as f32 allows.
//! * A Gaussian farther out than [`REACH`] is left out.
//! * Readers refuse a file with NaN, or with infinity elsewhere.

use std::path::Path;

use omnilife_engine::gaussians::static_gaussians::NO_ROTATION;
use omnilife_schemas::{plain_text, records::InvalidGaussians};

/// Largest coordinate of a centre: f32 holds the sum of the squares of three.
pub const REACH: f64 = 1e18;
/// Minimum logarithm of a size; smaller ones are raised to it. Below it f32 loses bits; normal numbers end at
/// exp(-87.34).
const LEAST_LOG_SCALE: f64 = -87.4;
const LEAST_REPAIRED_LOG_SCALE: f64 = -87.0;
/// A logit whose opacity is 1 in f32.
const OPAQUE_LOGIT: f64 = 20.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FileGaussian {
    /// Centre, in the units of its storage.
    pub(crate) position: [f64; 3],
    /// Logarithms of the standard deviations, in units of the file.
    pub(crate) log_scales: [f64; 3],
    /// Opacity before the sigmoid.
    pub(crate) opacity_logit: f64,
    /// Rotation (w, x, y, z), not normalized.
    pub(crate) quaternion: [f64; 4],
}

/// Returns the valid form of a Gaussian, or `None` if it is left out; counts invalid values. All returned values
/// are finite in f32.
pub(crate) fn valid(given: &FileGaussian, invalid: &mut InvalidGaussians) -> Option<FileGaussian> {
    let is_unrotated = given.quaternion == [0.0; 4];
    if is_unrotated && given.log_scales == [0.0; 3] && given.opacity_logit == 0.0 {
        invalid.padding += 1;
        return None;
    }
    if given.opacity_logit as f32 == f32::NEG_INFINITY {
        invalid.transparent += 1;
        return None;
    }
    if !is_within_reach(given) {
        invalid.out_of_reach += 1;
        return None;
    }
    let log_scales = given.log_scales.map(|log| {
        if log < LEAST_LOG_SCALE {
            LEAST_REPAIRED_LOG_SCALE
        } else {
            log
        }
    });
    invalid.unrotated += u64::from(is_unrotated);
    invalid.flat += u64::from(log_scales != given.log_scales);
    let is_opaque = given.opacity_logit as f32 == f32::INFINITY;
    Some(FileGaussian {
        log_scales,
        opacity_logit: if is_opaque {
            OPAQUE_LOGIT
        } else {
            given.opacity_logit
        },
        quaternion: rotation(given.quaternion),
        ..*given
    })
}

/// Returns true if a centre is within reach; in this form NaN is out of reach.
fn is_within_reach(gaussian: &FileGaussian) -> bool {
    gaussian.position.iter().all(|place| place.abs() <= REACH)
        && gaussian
            .log_scales
            .iter()
            .all(|&log| (log as f32) < f32::INFINITY)
        && gaussian.quaternion.iter().all(|part| part.is_finite())
        && !gaussian.opacity_logit.is_nan()
}

/// Returns the same rotation, with a length whose square f32 holds.
fn rotation(quaternion: [f64; 4]) -> [f64; 4] {
    let largest = quaternion.into_iter().map(f64::abs).fold(0.0, f64::max);
    if largest == 0.0 {
        NO_ROTATION.map(f64::from)
    } else if (1e-6..=1e6).contains(&largest) {
        quaternion
    } else {
        quaternion.map(|part| part / largest)
    }
}

/// Returns true if [`valid`] gives a meaning to a value, not finite in f32, of a property of 3DGS.
pub(crate) fn has_meaning(property: &str, value: f64) -> bool {
    match property {
        "x" | "y" | "z" | "opacity" => !value.is_nan(),
        "scale_0" | "scale_1" | "scale_2" => value < 0.0,
        _ => false,
    }
}

/// Count of the Gaussians of a file whose scales and opacities look already activated.
#[derive(Debug, Default)]
pub(crate) struct ActivationCheck {
    gaussians: u64,
    like_activated: u64,
}

impl ActivationCheck {
    /// Counts a Gaussian that is not left out.
    pub(crate) fn add(&mut self, gaussian: &FileGaussian) {
        let are_sizes = gaussian.log_scales.iter().all(|log| *log >= 0.0);
        let is_opacity = (0.0..=1.0).contains(&gaussian.opacity_logit);
        self.gaussians += 1;
        self.like_activated += u64::from(are_sizes && is_opacity);
    }

    /// Returns true if all of them look so.
    pub(crate) fn is_activated(&self) -> bool {
        self.gaussians > 0 && self.like_activated == self.gaussians
    }
}

/// Returns notes on invalid values in a file or a run.
pub fn notes(path: &Path, invalid: &InvalidGaussians) -> Vec<String> {
    let counted = [
        (invalid.padding, "are rows of zeros and left out"),
        (invalid.transparent, "have an opacity of 0 and are left out"),
        (
            invalid.out_of_reach,
            "are farther out or larger than f32 can be reckoned with and left out",
        ),
        (
            invalid.unrotated,
            "have a quaternion of zeros and are drawn without a rotation",
        ),
        (
            invalid.flat,
            "have an axis of size 0 and are drawn as thin as f32 allows",
        ),
        (
            invalid.smoothed,
            "have a filter_3D of Mip-Splatting, which is applied to sizes and opacities",
        ),
    ];
    let counted = counted.into_iter().filter(|(count, _)| *count > 0);
    let mut lines: Vec<String> = counted
        .map(|(count, what)| format!("{}: Gaussians that {what}: {count}", path.display()))
        .collect();
    if invalid.looks_activated {
        lines.push(format!(
            "{}: log scales of 0 or more and opacities in [0, 1] look as if already activated; they are read \
             as 3DGS writes them, before exp and the sigmoid",
            path.display()
        ));
    }
    if invalid.is_antialiased {
        lines.push(format!(
            "{}: states that it was trained with anti-aliasing, and is drawn without it: Gaussians below a pixel look \
             too opaque",
            path.display()
        ));
    }
    let unread = &invalid.unread_properties;
    if !unread.is_empty() {
        lines.push(format!(
            "{}: properties beside those of 3DGS that are not read, and show in no image: {} ({})",
            path.display(),
            unread.len(),
            plain_text::first_of(unread)
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SOUND: FileGaussian = FileGaussian {
        position: [1.0, -2.0, 3.0],
        log_scales: [-2.0, -3.0, 0.5],
        opacity_logit: 0.25,
        quaternion: [0.5, 2.0, -1.0, 0.0],
    };

    fn judged(given: &FileGaussian) -> (Option<FileGaussian>, InvalidGaussians) {
        let mut invalid = InvalidGaussians::default();
        let found = valid(given, &mut invalid);
        (found, invalid)
    }

    #[test]
    fn sound_ones_stay_as_they_are() {
        let faint = FileGaussian {
            opacity_logit: -80.0,
            ..SOUND
        };
        // A round one of size 1 and opacity 1/2 with a rotation is not padding.
        let round = FileGaussian {
            log_scales: [0.0; 3],
            opacity_logit: 0.0,
            ..SOUND
        };
        for given in [SOUND, faint, round] {
            assert_eq!(judged(&given), (Some(given), InvalidGaussians::default()));
        }
    }

    #[test]
    fn an_infinite_logit_is_opaque_or_nothing() {
        let of = |opacity_logit| FileGaussian {
            opacity_logit,
            ..SOUND
        };
        for logit in [f64::INFINITY, 1e300] {
            let (found, invalid) = judged(&of(logit));
            let opacity = found.map(|found| 1.0 / (1.0 + (-found.opacity_logit as f32).exp()));
            assert_eq!((opacity, invalid), (Some(1.0), InvalidGaussians::default()));
        }
        for logit in [f64::NEG_INFINITY, -1e300] {
            let (found, invalid) = judged(&of(logit));
            assert_eq!((found, invalid.transparent), (None, 1));
        }
    }

    #[test]
    fn rows_of_zeros_are_padding_and_other_zero_quaternions_no_rotation() {
        let blank = FileGaussian {
            log_scales: [0.0; 3],
            opacity_logit: 0.0,
            quaternion: [0.0; 4],
            ..SOUND
        };
        let (found, invalid) = judged(&blank);
        assert_eq!((found, invalid.padding), (None, 1));
        let unrotated = FileGaussian {
            quaternion: [0.0; 4],
            ..SOUND
        };
        let (found, invalid) = judged(&unrotated);
        let expected = FileGaussian {
            quaternion: [1.0, 0.0, 0.0, 0.0],
            ..SOUND
        };
        assert_eq!((found, invalid.unrotated), (Some(expected), 1));
        // Short and long ones keep their rotation.
        for factor in [1e-40, 1e25] {
            let given = FileGaussian {
                quaternion: SOUND.quaternion.map(|part| part * factor),
                ..SOUND
            };
            let (found, invalid) = judged(&given);
            let found = found.map(|found| found.quaternion).unwrap_or_default();
            let expected = [0.25, 1.0, -0.5, 0.0];
            assert!(
                found
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-12),
                "{found:?}"
            );
            assert_eq!(invalid, InvalidGaussians::default());
        }
    }

    #[test]
    fn whatever_is_let_in_is_finite_in_f32() {
        let wild = prop_oneof![
            20 => -5.0..5.0,
            1 => any::<f64>(),
            1 => any::<f32>().prop_map(f64::from),
            1 => Just(0.0),
            1 => Just(f64::INFINITY),
            1 => Just(f64::NEG_INFINITY),
            1 => Just(f64::NAN),
        ];
        let rows = prop::collection::vec(wild, 11);
        proptest!(|(row in rows)| {
            let given = FileGaussian {
                position: [row[0], row[1], row[2]],
                log_scales: [row[3], row[4], row[5]],
                opacity_logit: row[6],
                quaternion: [row[7], row[8], row[9], row[10]],
            };
            let (found, invalid) = judged(&given);
            let left_out = invalid.padding + invalid.transparent + invalid.out_of_reach;
            prop_assert_eq!(left_out, u64::from(found.is_none()));
            let Some(found) = found else { return Ok(()) };
            let squares = |values: &[f64]| values.iter().map(|&v| (v as f32).powi(2)).sum::<f32>();
            prop_assert!(squares(&found.position).is_finite());
            let length = squares(&found.quaternion);
            prop_assert!(length.is_finite() && length > 1e-13);
            prop_assert!(found.log_scales.iter().all(|&log| (log as f32).is_finite()));
            prop_assert!(found.log_scales.iter().all(|&log| log.exp() as f32 > 0.0));
            prop_assert!((found.opacity_logit as f32).is_finite());
        });
    }

    #[test]
    fn scales_and_opacities_that_were_activated_are_told_from_raw_ones() {
        let is_activated = |gaussians: &[(f64, f64)]| {
            let mut check = ActivationCheck::default();
            for &(size, opacity_logit) in gaussians {
                check.add(&FileGaussian {
                    log_scales: [size; 3],
                    opacity_logit,
                    ..SOUND
                });
            }
            check.is_activated()
        };
        assert!(is_activated(&[(0.01, 0.9), (3.0, 0.0), (0.2, 1.0)]));
        assert!(!is_activated(&[(0.01, 0.9), (-0.1, 0.5)]));
        assert!(!is_activated(&[(0.01, 0.9), (0.3, 1.5)]));
        assert!(!is_activated(&[]));
    }
}
