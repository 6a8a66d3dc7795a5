//! What a scene shows of itself before it is trained.
//!
//! * [`masks`]: what masks say of motion. [`pilot`]: a short static training, in which the rest is seen;
//!   `rendered_view`: a view compared with its render.
//! * [`motion`]: whether anything moves, and where. [`coverage`]: how many views see a point. [`poses`]: how far poses are off.
//!   [`view_dependence`]: whether colours depend on the direction. [`exposure`]: whether whole views are
//!   brighter or darker than others. [`changing_light`]: whether light changes in them.
//!
//! [`gather`] puts it together in one order and never changes it afterwards: every method has the same
//! evidence on one scene and seed, whatever it uses of it.

pub mod changing_light;
pub mod coverage;
pub mod exposure;
mod flat_surfaces;
pub mod masks;
pub mod motion;
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

/// Iterations of the pilot fit: enough for colours, and for edges where they belong.
pub const PILOT_ITERATIONS: u64 = 120;
/// Points seen by fewer views have no median to speak of.
pub(crate) const LEAST_VIEWS: usize = 6;
/// Standard deviation of a normal distribution over its median absolute deviation.
pub(crate) const PER_MEDIAN: f32 = 1.4826;

/// The evidence on a scene; it stands in the run's record.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneEvidence {
    /// Seed of the pilot fit.
    pub seed: u64,
    /// What masks say.
    pub masks: MaskEvidence,
    /// What a pilot fit shows, where one was needed.
    pub pilot: Option<PilotEvidence>,
}

/// What a pilot fit shows, each with what stands before it taken into account.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PilotEvidence {
    /// How bright the views are; `None` where too little of them can be compared.
    pub exposure: Option<ExposureEvidence>,
    /// How far the poses are off, once gains that drift are taken out.
    pub poses: PoseEvidence,
    /// Whether anything moves, once poses that are off are corrected too: neither automatic exposure
    /// nor an edge beside its place is motion.
    pub motion: MotionEvidence,
    /// Which of the scene's points change outside the masks.
    pub changing: ChangingPoints,
    /// How many views see them.
    pub coverage: Coverage,
    /// Whether colours depend on the direction.
    pub view_dependence: ViewDependence,
    /// Whether light changes.
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
    let pilot = with_pilot.then(|| PilotEvidence::gather(scene, seed));
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
    /// Whether something moves or changes, or may: masks say what; where they show nothing, the pilot fit does.
    pub fn moves(&self) -> bool {
        let by_fit = self
            .pilot
            .as_ref()
            .is_none_or(|pilot| pilot.motion.moves() || pilot.changing_light.is_seen());
        self.masks.show_something() || by_fit
    }

    /// Why [`SceneEvidence::moves`] says what it says.
    pub fn motion_reason(&self) -> String {
        match &self.pilot {
            Some(pilot) if !self.masks.show_something() => {
                format!("{}; {}; {}", self.masks, pilot.motion, pilot.changing_light)
            }
            _ => self.masks.to_string(),
        }
    }
}
