//! Evidence of a scene before its training.
//!
//! * [`masks`]: motion in masks. [`pilot`]: a short static training, the base of the rest; `rendered_view`: a
//!   view compared with its render. [`once`]: one pilot fit for many runs on a scene.
//! * [`motion`]: motion and its places. [`coverage`]: numbers of views that see a point. [`poses`]: errors of
//!   poses. [`view_dependence`]: colours that depend on the direction. [`exposure`]: brightness of whole views.
//!   [`changing_light`]: light that changes in them.
//!
//! [`gather`] gathers all of it in one order and never changes it afterwards: every method has the same evidence
//! on one scene and seed, whatever it uses of it.

pub mod changing_light;
pub mod coverage;
pub mod exposure;
mod flat_surfaces;
pub mod masks;
pub mod motion;
pub mod once;
pub mod pilot;
pub mod poses;
mod rendered_view;
pub mod view_dependence;

use serde::Serialize;

use self::{
    changing_light::ChangingLight,
    coverage::Coverage,
    exposure::ExposureEvidence,
    masks::MaskEvidence,
    motion::{ChangingPoints, MotionEvidence},
    pilot::PilotFit,
    poses::PoseEvidence,
    view_dependence::ViewDependence,
};
use crate::{error::ReconstructError, scene::TrainingScene};

/// Iterations of the pilot fit: enough for colours, and for edges in their places.
pub const PILOT_ITERATIONS: u64 = 120;
/// Minimum number of views of a point for a median.
pub(crate) const LEAST_VIEWS: usize = 6;
/// Median level of a scene from which on limits in levels hold as they are; those of darker ones are as much smaller.
/// Scenes by day have 0.32 to 0.72, the same by night 0.06 to 0.18.
const DAY_LEVEL: f32 = 0.25;
/// Minimum share of a limit that is left in the dark: steps of bytes are a half of 0.1 times the limits.
const DARKEST_SHARE: f32 = 0.1;
/// Standard deviation of a normal distribution over its median absolute deviation.
pub(crate) const PER_MEDIAN: f32 = 1.4826;

/// Returns the share of limits in levels that holds for a scene of a median level: 1 by day.
fn share_of_limits(median_level: f32) -> f32 {
    (median_level / DAY_LEVEL).clamp(DARKEST_SHARE, 1.0)
}

/// The evidence on a scene, as written to the run's record.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneEvidence {
    /// Seed of the pilot fit.
    pub seed: u64,
    /// Evidence of the masks.
    pub masks: MaskEvidence,
    /// Evidence of a pilot fit, if one was needed.
    pub pilot: Option<PilotEvidence>,
}

/// Evidence of a pilot fit; each item takes the ones before it into account.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PilotEvidence {
    /// Brightness of the views; `None` where too few of them can be compared.
    pub exposure: Option<ExposureEvidence>,
    /// Errors of the poses, after gains that drift are removed.
    pub poses: PoseEvidence,
    /// Motion, after the correction of inaccurate poses too: neither automatic exposure nor a displaced edge is
    /// motion.
    pub motion: MotionEvidence,
    /// Scene points that change outside the masks.
    pub changing: ChangingPoints,
    /// Numbers of views that see them.
    pub coverage: Coverage,
    /// Dependence of colours on the direction.
    pub view_dependence: ViewDependence,
    /// Changes of light.
    pub changing_light: ChangingLight,
}

/// Gathers the evidence on a scene, with or without a pilot fit, which takes seconds.
///
/// # Errors
/// When the pilot fit diverges or is interrupted.
pub fn gather(
    scene: &TrainingScene,
    seed: u64,
    masks: MaskEvidence,
    with_pilot: bool,
) -> Result<SceneEvidence, ReconstructError> {
    let gather = || PilotEvidence::gather(scene, seed);
    let pilot = with_pilot.then(|| once::gathered(scene, seed, gather));
    Ok(SceneEvidence {
        seed,
        masks,
        pilot: pilot.transpose()?,
    })
}

impl PilotEvidence {
    fn gather(scene: &TrainingScene, seed: u64) -> Result<Self, ReconstructError> {
        let mut fit = PilotFit::of(scene, seed)?;
        let exposure = fit.exposure();
        if let Some(found) = exposure
            .as_ref()
            .filter(|found| found.is_worth_compensating())
        {
            fit.normalize(found.gains.clone());
        }
        let poses = fit.poses();
        if poses.are_off() {
            fit.correct_poses(&poses);
        }
        let (view_dependence, changing_light) = fit.colours();
        let (changing, coverage) = fit.points();
        Ok(Self {
            motion: fit.motion(),
            changing,
            coverage,
            view_dependence,
            changing_light,
            exposure,
            poses,
        })
    }
}

impl SceneEvidence {
    /// Returns true if something moves or changes, or may: by the masks, or by the pilot fit if they show
    /// nothing.
    pub fn moves(&self) -> bool {
        let by_fit = self
            .pilot
            .as_ref()
            .is_none_or(|pilot| pilot.motion.moves() || pilot.changing_light.is_seen());
        self.masks.show_something() || by_fit
    }

    /// Returns the reason for [`SceneEvidence::moves`].
    pub fn motion_reason(&self) -> String {
        match &self.pilot {
            Some(pilot) if !self.masks.show_something() => {
                format!("{}; {}; {}", self.masks, pilot.motion, pilot.changing_light)
            }
            _ => self.masks.to_string(),
        }
    }
}
