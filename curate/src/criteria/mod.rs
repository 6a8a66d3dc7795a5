//! Admission criteria of datasets, as named profiles.
//!
//! To add a check: one file, and one line in [`CHECKS`]. A [`Profile`] names its checks with their thresholds; a file
//! can do so too ([`criteria`]).

mod duration;
mod file;
mod frame_rate;
mod native_erp;
mod overlays;
mod resolution;
mod undamaged;

use std::path::Path;

use omnilife_schemas::records::{
    Admission, CheckOutcome, DetectedProjection, OverlayReport, Probe, SphereLayout,
};
use serde::Deserialize;

use crate::error::{CurateError, in_words};

/// Rejection of a video: its image is not monoscopic ERP, whatever the criteria require.
pub const PROJECTION: &str = "projection";
/// Rejection of a video: no shot of it is long enough.
pub const SHOT_LENGTH: &str = "shot-length";
/// Rejection of a shot: excluded by people.
pub const LEFT_OUT: &str = "left-out";
/// Threshold of [`LEFT_OUT`] in tables.
pub(crate) const LEFT_OUT_THRESHOLD: &str = "what the ledger keeps";

/// Input of a check. Entries of the analysis pass are `None` before it.
#[derive(Debug, Clone, Copy)]
pub struct Candidate<'a> {
    /// The probe.
    pub probe: &'a Probe,
    /// Layout that stores the sphere, if it is not one equirectangular image.
    pub layout: Option<SphereLayout>,
    /// The ERP projection in force; it records whether the user overrode the evidence.
    pub projection: Option<&'a DetectedProjection>,
    /// Damaged frames.
    pub damaged_frames: Option<u64>,
    /// Persistent overlays.
    pub overlays: Option<&'a OverlayReport>,
}

/// The thresholds of a profile. A check whose threshold is `None` is not evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Thresholds {
    /// The video is stored as monoscopic 2:1 ERP.
    pub native_erp: bool,
    /// Least width in pixels.
    pub least_width_pixels: Option<u32>,
    /// Least frame rate, frames per second.
    pub least_frames_per_second: Option<f64>,
    /// The duration in seconds is longer than this.
    pub longer_than_seconds: Option<f64>,
    /// Every frame decodes without damage.
    pub undamaged: bool,
    /// Largest artificial overlay, steradians.
    pub largest_overlay_steradians: Option<f64>,
    /// Largest share of the examined frames with a larger moving mosaic; zero if `None`.
    pub largest_mosaic_share: Option<f64>,
    /// Prominent overlays are reported and reject nothing. A file of criteria that names their size enforces it.
    #[serde(skip)]
    pub overlays_are_reported_only: bool,
}

/// A named set of thresholds.
#[derive(Debug)]
pub struct Profile {
    /// Unique name, as on the command line.
    pub id: &'static str,
    /// Purpose and source.
    pub summary: &'static str,
    /// The thresholds.
    pub thresholds: Thresholds,
}

/// The criteria of the OmniLife360 dataset (section 3.1 of its paper): native ERP, at least 4K, at least 30 fps, raw
/// duration over 30 s, no prominent artificial overlays. 4K means a width of 3840 pixels, the narrowest that carries
/// the name. Ours are: the prominent size of an overlay, the time limit of mosaics, undamaged decoding. Overlays are
/// reported alone, because their detector has not reached a precision and recall of 0.9 on unseen labels.
pub const OMNILIFE360: Profile = Profile {
    id: "omnilife360",
    summary: "The OmniLife360 dataset, section 3.1 of its paper: native ERP, 4K, 30 fps, over 30 s.",
    thresholds: Thresholds {
        native_erp: true,
        least_width_pixels: Some(3840),
        // 30000/1001 is sold as 30 fps.
        least_frames_per_second: Some(29.97 - 1e-3),
        longer_than_seconds: Some(30.0),
        undamaged: true,
        // 180 x 47 pixels at the equator of 4096 x 2048.
        largest_overlay_steradians: Some(0.02),
        // Three seconds of a minute.
        largest_mosaic_share: Some(0.05),
        overlays_are_reported_only: true,
    },
};

/// No criteria.
pub const NONE: Profile = Profile {
    id: "none",
    summary: "Asks for nothing.",
    thresholds: Thresholds {
        native_erp: false,
        least_width_pixels: None,
        least_frames_per_second: None,
        longer_than_seconds: None,
        undamaged: false,
        largest_overlay_steradians: None,
        largest_mosaic_share: None,
        overlays_are_reported_only: false,
    },
};

/// All profiles, the default one first; tests walk it.
pub static PROFILES: &[Profile] = &[OMNILIFE360, NONE];

/// One admission check.
pub struct Check {
    /// Unique id.
    pub id: &'static str,
    /// Its condition, in one sentence.
    pub summary: &'static str,
    /// Returns its outcome; `None` if the profile does not require it or its input is not known yet.
    pub evaluate: fn(&Thresholds, &Candidate<'_>) -> Option<CheckOutcome>,
}

/// All checks; tests walk it.
pub static CHECKS: &[Check] = &[
    native_erp::CHECK,
    resolution::CHECK,
    frame_rate::CHECK,
    duration::CHECK,
    undamaged::CHECK,
    overlays::CHECK,
];

/// Criteria that videos are checked against.
#[derive(Debug, Clone, PartialEq)]
pub struct Criteria {
    /// Name for the records.
    pub name: String,
    /// The thresholds.
    pub thresholds: Thresholds,
}

/// Returns the profile of this name, or the criteria in this `.toml` file. `video` is named in the error.
///
/// # Errors
/// [`CurateError::Input`] that lists the known names or the fault in the file.
pub fn criteria(name: &str, video: &Path) -> Result<Criteria, CurateError> {
    let path = Path::new(name);
    if path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
    {
        return file::read(path);
    }
    let profile = PROFILES
        .iter()
        .find(|profile| profile.id == name)
        .ok_or_else(|| {
            let known: Vec<_> = PROFILES.iter().map(|profile| profile.id).collect();
            CurateError::input(
                video,
                format!(
                    "criteria must be {} or a .toml file, got {name:?}",
                    known.join(", ")
                ),
            )
        })?;
    Ok(Criteria {
        name: profile.id.to_owned(),
        thresholds: profile.thresholds,
    })
}

/// Evaluates every required check whose input is known. Those of detectors below their bar decide nothing.
pub fn admit(criteria: &Criteria, candidate: &Candidate<'_>, enforced: bool) -> Admission {
    let thresholds = &criteria.thresholds;
    let (reported, checks): (Vec<CheckOutcome>, Vec<CheckOutcome>) = CHECKS
        .iter()
        .filter_map(|check| (check.evaluate)(thresholds, candidate))
        .partition(|found| {
            thresholds.overlays_are_reported_only && found.check == overlays::CHECK.id
        });
    Admission {
        profile: criteria.name.clone(),
        admitted: checks.iter().all(|check| check.passed),
        checks,
        reported,
        enforced,
    }
}

/// Returns a line on each failed check that decides nothing, with the option that enforces it.
pub fn unenforced(admission: &Admission) -> Vec<String> {
    let failed = admission.reported.iter().filter(|check| !check.passed);
    let line = |check: &CheckOutcome| {
        format!(
            "{}; found and not enforced: the detector is below its bar on labelled footage. A .toml file of \
             --criteria that names largest_overlay_steradians enforces it",
            in_words([check])
        )
    };
    failed.map(line).collect()
}

/// Returns the checks that failed.
pub fn failed(admission: &Admission) -> impl Iterator<Item = &CheckOutcome> {
    admission.checks.iter().filter(|check| !check.passed)
}

/// Returns the failed checks in one line; `None` where all passed.
pub fn failures(admission: &Admission) -> Option<String> {
    let failed: Vec<&CheckOutcome> = failed(admission).collect();
    (!failed.is_empty()).then(|| in_words(failed))
}

fn outcome(check: &Check, passed: bool, value: String, threshold: String) -> CheckOutcome {
    CheckOutcome {
        check: check.id.to_owned(),
        passed,
        value,
        threshold,
    }
}
