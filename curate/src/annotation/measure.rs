//! Measurement of camera motion and of dynamic content.
//!
//! Motion is measured from poses and masks where there are any, and from frames otherwise. Rotations come from poses
//! that are close in time, else from registered frames. Translation is a speed in metres per second where the scale is
//! known, else the angular speed of the surroundings. A class is `unknown` where less than half of the pairs of frames
//! can be registered.
//!
//! The paper names four classes: minimal motion, mild changes, fast translation, and abrupt or large motion. It gives
//! no numbers. The limits here follow the meaning of the words: a standing person sways by about 0.1 m/s, people run
//! at up to 6 m/s, and heads rarely turn faster than 90 degrees per second. They are recorded beside every value, so
//! that values remain usable with other limits.

mod dynamics;
mod from_frames;
mod from_poses;

use std::path::Path;

use omnilife_schemas::{
    layout::SCENE_FILE,
    progress::Progress,
    records::{Dynamics, Evidence, Measured, Scene, Sequence},
    statistics::{median, quantile},
    store,
};

pub(super) use self::dynamics::LEVELS as DYNAMICS_LEVELS;
use self::{from_frames::FrameMotion, from_poses::PoseMotion};
use crate::error::CurateError;

/// Class where nothing could be measured.
pub const UNKNOWN: &str = "unknown";

/// Limits between classes of motion.
struct Limits {
    /// Turns faster than this are abrupt, degrees per second, 90th percentile.
    extreme_turn: f64,
    /// A camera that rotates no faster than this may be static, degrees per second, median.
    static_turn: f64,
    /// A camera whose surroundings pass no faster than this may be static, degrees per second, median over the sphere.
    static_parallax: f64,
    /// Surroundings that pass faster than this belong to a fast camera, degrees per second.
    fast_parallax: f64,
    /// A camera that moves no faster than this may be static, metres per second.
    static_speed: f64,
    /// Speeds above this are fast, metres per second: faster than people run.
    fast_speed: f64,
    /// Less of the sphere moving than this is a low level of dynamic content.
    low_dynamics: f64,
    /// More than this is a high level.
    high_dynamics: f64,
    /// Share of the pairs of frames that must be registered.
    least_registered: f64,
}

const LIMITS: Limits = Limits {
    extreme_turn: 90.0,
    static_turn: 3.0,
    static_parallax: 0.7,
    fast_parallax: 40.0,
    static_speed: 0.15,
    fast_speed: 6.0,
    low_dynamics: 0.01,
    high_dynamics: 0.05,
    least_registered: 0.5,
};

/// Median over the sphere of the sine of the angle to the heading: points at a distance pass at this share of the
/// camera's speed over that distance.
const MEDIAN_SINE: f64 = 0.866;

/// Measured classes.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Ego-motion class.
    pub ego_motion: Measured,
    /// Level of dynamic content.
    pub dynamics: Dynamics,
}

/// Measures a sequence. What poses and masks do not tell is measured in frames.
///
/// # Errors
/// When a frame or a record cannot be read.
pub fn measure(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Motion, CurateError> {
    let record = folder.join(SCENE_FILE);
    let scene: Option<Scene> = match record.is_file() {
        true => Some(store::read_record(&record)?),
        false => None,
    };
    let poses = match &scene {
        Some(scene) => from_poses::measure(folder, scene)?,
        None => None,
    };
    let masks = dynamics::masked_shares(folder, scene.as_ref())?;
    let is_told = poses.as_ref().is_some_and(|poses| {
        let has_speed = poses
            .metres_per_second
            .or(poses.depths_per_second)
            .is_some();
        has_speed && !poses.turns.is_empty()
    });
    // Flow is measured on the whole sphere.
    let needs_frames = !sequence.is_pinhole() && (masks.is_none() || !is_told);
    let frames = match needs_frames {
        true => Some(from_frames::compare(folder, sequence, progress)?),
        false => None,
    };
    let motion = Motion {
        ego_motion: ego_motion(poses.as_ref(), frames.as_ref()),
        dynamics: dynamics::level(masks, frames.as_ref()),
    };
    report_unknown(&motion, sequence, frames.as_ref(), progress);
    Ok(motion)
}

/// Says which classes are unknown, and why.
fn report_unknown(
    motion: &Motion,
    sequence: &Sequence,
    frames: Option<&FrameMotion>,
    progress: &dyn Progress,
) {
    let classes = [
        ("ego-motion", &motion.ego_motion),
        ("dynamic content", &motion.dynamics),
    ];
    let unknown: Vec<&str> = classes
        .iter()
        .filter(|(_, measured)| measured.class == UNKNOWN)
        .map(|(name, _)| *name)
        .collect();
    if unknown.is_empty() {
        return;
    }
    let reason = match frames {
        None => "frames of a pinhole show neither without poses and masks".to_owned(),
        Some(frames) if frames.compared == 0 => {
            "no two of its frames are close enough in time".to_owned()
        }
        Some(frames) => format!(
            "{} of {} pairs of frames could be registered",
            frames.turns.len(),
            frames.compared
        ),
    };
    let names = unknown.join(" and ");
    progress.note(&format!("{}: unknown {names}: {reason}", sequence.id));
}

fn evidence(test: &str, value: f64, limit: f64, reading: &str) -> Evidence {
    Evidence {
        test: test.to_owned(),
        value,
        limit,
        reading: reading.to_owned(),
    }
}

/// Returns an unknown class with the reason for it.
fn unknown(frames: Option<&FrameMotion>) -> Measured {
    Measured {
        class: UNKNOWN.to_owned(),
        from: "frames".to_owned(),
        evidence: vec![evidence(
            "registered_share",
            frames.map_or(0.0, FrameMotion::registered_share),
            LIMITS.least_registered,
            "below is unknown",
        )],
    }
}

/// Translation of the camera in the unit of the limit that decides.
struct Translation {
    test: &'static str,
    value: f64,
    static_limit: f64,
    fast_limit: f64,
    is_of_poses: bool,
}

impl Translation {
    fn of(poses: Option<&PoseMotion>, frames: Option<&FrameMotion>) -> Option<Self> {
        let metric = poses.and_then(|poses| poses.metres_per_second);
        if let Some(value) = metric {
            return Some(Self {
                test: "metres_per_second",
                value,
                static_limit: LIMITS.static_speed,
                fast_limit: LIMITS.fast_speed,
                is_of_poses: true,
            });
        }
        let relative = poses.and_then(|poses| poses.depths_per_second);
        let of_poses = relative.map(|speed| (MEDIAN_SINE * speed).to_degrees());
        let of_frames = || median(&frames?.parallaxes);
        Some(Self {
            test: "parallax_median_degrees_per_second",
            value: of_poses.or_else(of_frames)?,
            static_limit: LIMITS.static_parallax,
            fast_limit: LIMITS.fast_parallax,
            is_of_poses: of_poses.is_some(),
        })
    }
}

fn ego_motion(poses: Option<&PoseMotion>, frames: Option<&FrameMotion>) -> Measured {
    let usable = frames.filter(|frames| frames.registered_share() >= LIMITS.least_registered);
    let turns = match (poses, usable) {
        (Some(poses), _) if !poses.turns.is_empty() => Some((&poses.turns, true)),
        (_, Some(frames)) => Some((&frames.turns, false)),
        _ => None,
    };
    let measured = || {
        let (turns, is_of_poses) = turns?;
        let translation = Translation::of(poses, usable)?;
        Some((
            median(turns)?,
            quantile(turns, 0.9)?,
            is_of_poses,
            translation,
        ))
    };
    let Some((turn, fast_turn, turns_are_of_poses, translation)) = measured() else {
        return unknown(frames);
    };
    let class = if fast_turn > LIMITS.extreme_turn {
        "extreme"
    } else if translation.value > translation.fast_limit {
        "high-speed"
    } else if turn <= LIMITS.static_turn && translation.value <= translation.static_limit {
        "static"
    } else {
        "walking-and-daily"
    };
    let mut found = vec![
        evidence(
            "turn_p90_degrees_per_second",
            fast_turn,
            LIMITS.extreme_turn,
            "above is extreme",
        ),
        evidence(
            "turn_median_degrees_per_second",
            turn,
            LIMITS.static_turn,
            "above is not static",
        ),
        evidence(
            translation.test,
            translation.value,
            translation.static_limit,
            "above is not static",
        ),
        evidence(
            translation.test,
            translation.value,
            translation.fast_limit,
            "above is high-speed",
        ),
    ];
    if let Some(frames) = usable {
        found.push(evidence(
            "registered_share",
            frames.registered_share(),
            LIMITS.least_registered,
            "below is unknown",
        ));
    }
    let from = match (turns_are_of_poses, translation.is_of_poses) {
        (true, true) => "poses",
        (false, false) => "frames",
        _ => "frames and poses",
    };
    Measured {
        class: class.to_owned(),
        from: from.to_owned(),
        evidence: found,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(compared: usize, turns: &[f64], parallax: f64) -> FrameMotion {
        FrameMotion {
            compared,
            turns: turns.to_vec(),
            parallaxes: vec![parallax; turns.len()],
            dynamic_shares: vec![0.002; turns.len()],
        }
    }

    #[test]
    fn classes_follow_their_limits() {
        let class = |turn: f64, parallax: f64| {
            ego_motion(None, Some(&frames(4, &[turn; 4], parallax))).class
        };
        assert_eq!(class(1.0, 0.2), "static");
        assert_eq!(class(12.0, 0.2), "walking-and-daily");
        assert_eq!(class(1.0, 9.0), "walking-and-daily");
        assert_eq!(class(1.0, 60.0), "high-speed");
        assert_eq!(class(120.0, 60.0), "extreme");
    }

    #[test]
    fn speeds_of_poses_come_before_those_of_frames() {
        let mut poses = PoseMotion {
            turns: vec![1.0; 4],
            metres_per_second: Some(9.0),
            depths_per_second: Some(0.001),
        };
        let wrong = frames(4, &[200.0; 4], 50.0);
        let measured = ego_motion(Some(&poses), Some(&wrong));
        assert_eq!((&*measured.class, &*measured.from), ("high-speed", "poses"));
        poses.metres_per_second = None;
        assert_eq!(ego_motion(Some(&poses), None).class, "static");
        // A quarter of the distance of the scene in a second: 12 degrees.
        poses.depths_per_second = Some(0.25);
        let measured = ego_motion(Some(&poses), None);
        assert_eq!(measured.class, "walking-and-daily");
        assert!((measured.evidence[2].value - 12.4).abs() < 0.1);
        // Poses that are far apart in time tell the speed alone.
        poses.turns.clear();
        let measured = ego_motion(Some(&poses), Some(&frames(4, &[20.0; 4], 0.0)));
        assert_eq!(measured.from, "frames and poses");
    }

    #[test]
    fn failed_registration_is_unknown() {
        let few = frames(8, &[449.0; 3], 100.0);
        let measured = ego_motion(None, Some(&few));
        assert_eq!(measured.class, UNKNOWN);
        assert_eq!(measured.evidence[0].value, 0.375);
        assert_eq!(dynamics::level(None, Some(&few)).class, UNKNOWN);
        assert_eq!(ego_motion(None, None).class, UNKNOWN);
        let masks = Some((vec![0.1, 0.2], "masks"));
        assert_eq!(dynamics::level(masks, Some(&few)).class, "high");
    }
}
