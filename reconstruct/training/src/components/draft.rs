//! A run in the making.

use omnilife_schemas::records::ComponentDecision;

use crate::{
    baseline,
    components::{COMPONENTS, Component, Decision, DecisionLog, Supported, Turn, aids},
    error::ReconstructError,
    evidence::{self, SceneEvidence, masks::MaskEvidence},
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
    seeds::masks::{MaskSeeds, SeedVelocity},
};
use omnilife_engine::{
    clock::Clock, gaussians::static_gaussians::InitialGaussians, step::settings::TrainSettings,
};

/// Draft of a run before its model: settings, plan and first Gaussians.
#[derive(Debug)]
pub struct Draft<'a> {
    /// The scene.
    pub scene: &'a TrainingScene,
    /// The request.
    pub request: &'a MethodRequest,
    supported: Supported,
    /// Evidence of the scene.
    pub evidence: SceneEvidence,
    /// Settings as resolved so far.
    pub settings: TrainSettings,
    /// Start of dynamic seeds, if Gaussians have times of their own.
    pub seeding: Option<Seeding>,
    /// Gaussians in the dynamic region.
    pub seeds: MaskSeeds,
    /// Gaussians at scene points that have all of the method's parameters.
    pub points: InitialGaussians,
    /// Indices of the scene points of those.
    pub(crate) point_indices: Vec<usize>,
    /// Gaussians without temporal parameters.
    pub fixed: InitialGaussians,
    /// Number of Gaussians that the method adds to those of this draft, within the limit.
    pub reserved: u64,
    /// Pixels of each input view with Gaussians of objects, which need no seeds; views without any have no entries.
    pub explained: Vec<Vec<bool>>,
    /// The decisions so far.
    pub(crate) plan: DecisionLog<'a>,
    motion: MotionEvidenceUse,
}

/// Start of dynamic seeds.
#[derive(Debug, Clone, Copy)]
pub struct Seeding {
    /// Frames of the clip in time.
    pub clock: Clock,
    /// First velocities.
    pub velocity: SeedVelocity,
    /// First lifespan of a seed, frames.
    pub lifespan_frames: f32,
}

/// Use that a method has for the evidence of motion in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionEvidenceUse {
    /// Its Gaussians change with time; a plan may leave time out of static scenes.
    Decides,
    /// The method does not use it.
    None,
}

impl<'a> Draft<'a> {
    /// Takes the baseline's settings, and the evidence that the allowed components need.
    ///
    /// # Errors
    /// When the pilot fit fails.
    pub fn new(
        scene: &'a TrainingScene,
        request: &'a MethodRequest,
        supported: Supported,
        motion: MotionEvidenceUse,
    ) -> Result<Self, ReconstructError> {
        let settings = baseline::settings(scene, request);
        let masks = MaskEvidence::of(scene);
        let looks_for_motion = motion == MotionEvidenceUse::Decides
            && request.plan == PlanChoice::Auto
            && !masks.show_something();
        let with_pilot = looks_for_motion
            || COMPONENTS.iter().any(|component| {
                supported.may_use(component.id, request) && (component.needs_pilot)(request, &masks)
            });
        let mut draft = Self {
            scene,
            request,
            supported,
            evidence: evidence::gather(scene, request.seed, masks, with_pilot)?,
            settings,
            seeding: None,
            seeds: MaskSeeds::default(),
            points: InitialGaussians::default(),
            point_indices: Vec::new(),
            fixed: InitialGaussians::default(),
            reserved: 0,
            explained: Vec::new(),
            plan: DecisionLog::new(request),
            motion,
        };
        let resets = baseline::reset_decision(&draft.settings, request);
        draft.plan.push(resets);
        Ok(draft)
    }

    /// Decides on a part of the method itself, and logs the decision; returns true if it is used.
    pub fn decide(&mut self, component: &str, decision: Decision) -> bool {
        self.plan.decide(component, decision)
    }

    /// Returns true if a component was decided on and is used.
    pub fn is_used(&self, component: &str) -> bool {
        self.plan.is_used(component)
    }

    /// Returns the component if it is not used, as a missing requirement of others.
    pub fn missing(&self, component: &'static str) -> Option<&'static str> {
        (!self.is_used(component)).then_some(component)
    }

    /// Decides on the shared components that the method supports, and applies the used ones. Between the turns it
    /// places Gaussians at the scene's points.
    pub fn add_components(&mut self) {
        self.take_turn(Turn::BeforePoints);
        self.place_points();
        self.take_turn(Turn::AfterPoints);
    }

    fn take_turn(&mut self, turn: Turn) {
        let supported = self.supported;
        let due = |component: &&Component| {
            component.turn == turn && supported.has(component.id, self.request)
        };
        let due: Vec<&Component> = COMPONENTS.iter().filter(due).collect();
        for component in due {
            let decision = (component.decide)(&self.evidence, self);
            if self.decide(component.id, decision) {
                (component.apply)(self);
            }
        }
    }

    /// Returns the room for Gaussians that are neither seeds nor reserved.
    pub(crate) fn room(&self) -> u64 {
        let maximum = self.settings.densify.maximum_gaussians;
        maximum.saturating_sub(self.seeds.gaussians.len() as u64 + self.reserved)
    }

    fn place_points(&mut self) {
        let room = self.room().saturating_sub(self.fixed.len() as u64);
        (self.point_indices, self.points) =
            baseline::gaussians_at_points(self.scene, room as usize);
        let (taken, all) = (self.points.len(), self.scene.points.len());
        if taken < all {
            self.plan.push(ComponentDecision {
                component: "all-points".to_owned(),
                used: false,
                reason: format!(
                    "{taken} of {all} points, evenly spread: no more than {} Gaussians are allowed",
                    self.room()
                ),
            });
        }
    }

    /// Returns warnings for readers of the scores.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let masks = match self.motion {
            MotionEvidenceUse::Decides => self.evidence.masks.warnings(),
            MotionEvidenceUse::None => Vec::new(),
        };
        masks.into_iter().chain(self.plan.refusals()).collect()
    }
}

impl Supported {
    /// Returns true if a run of the method decides on a component.
    pub(crate) fn has(&self, component: &str, request: &MethodRequest) -> bool {
        let is_named =
            request.names(component) || request.asks_for(aids::ALL) && aids::is_aid(component);
        self.default.contains(&component) || self.optional.contains(&component) && is_named
    }

    fn may_use(&self, component: &str, request: &MethodRequest) -> bool {
        self.has(component, request) && request.allows(component)
    }
}
