//! Reconstruction methods: what the row of a method says, and how it trains.

pub mod group;
mod prepared;
pub mod requirement;

use omnilife_schemas::{
    elapsed::{Elapsed, Stopwatch},
    names,
    records::{ComponentDecision, Lift},
};

use crate::{
    components::{MotionEvidenceUse, Supported},
    error::ReconstructError,
    evidence::SceneEvidence,
    learner::{Learner, gaussians::GaussianLearner},
    method::{
        group::{Group, Interpolated},
        requirement::Requirement,
    },
    models::ModelFormat,
    options::MethodOption,
    request::{BackendChoice, DefaultPlan, MethodRequest, PlanChoice},
    scene::{CameraExtent, TrainingScene},
    train::{self, LoopSettings, Session, TrainingOutcome},
};
use omnilife_engine::{EngineError, model::Model, step::settings::TrainSettings};

/// What a method gives back.
#[derive(Debug)]
pub struct MethodOutcome<'a> {
    /// The trained model, ready to render.
    pub learner: Box<dyn Learner + 'a>,
    /// How its training ended.
    pub training: TrainingOutcome,
    /// Iterations of the schedule.
    pub iterations: u64,
    /// Every setting as resolved.
    pub configuration: serde_json::Value,
    /// Decisions and their evidence; its warnings are among those of the training.
    pub findings: Findings,
    /// What deciding and placing the first Gaussians took, the pilot fit included; training time
    /// includes it.
    pub planning: Elapsed,
}

/// What a method begins with on a scene.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// The model before its first step.
    pub learner: Box<dyn Learner + 'a>,
    /// How long it is trained.
    pub length: LoopSettings,
    /// Every setting as resolved, for the run's record.
    pub configuration: serde_json::Value,
    /// Decisions and their evidence.
    pub findings: Findings,
}

/// Decisions that a method makes on a scene before it trains, with their evidence.
#[derive(Debug, Default)]
pub struct Findings {
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// Evidence of the scene, where the method gathers it.
    pub evidence: Option<SceneEvidence>,
    /// Counts of lifted pixels, where the method begins with them.
    pub lift: Option<Lift>,
    /// Lines that a reader of the scores should know.
    pub warnings: Vec<String>,
}

/// What a method of Gaussians begins with on a scene.
#[derive(Debug)]
pub struct PreparedGaussians {
    /// The first Gaussians.
    pub model: Model,
    /// Every setting as resolved.
    pub settings: TrainSettings,
    /// Decisions and their evidence.
    pub findings: Findings,
}

impl PreparedGaussians {
    /// Lets them learn on a backend.
    ///
    /// # Errors
    /// When the backend cannot train them.
    pub fn on(
        self,
        scene: &TrainingScene,
        backend: BackendChoice,
    ) -> Result<Prepared<'_>, ReconstructError> {
        let configuration =
            serde_json::to_value(&self.settings).map_err(|error| ReconstructError::Request {
                reason: format!("settings that cannot be recorded: {error}"),
            })?;
        let length = LoopSettings::from(&self.settings);
        let learner = GaussianLearner::new(scene, self.model, self.settings, backend)?;
        let mut findings = self.findings;
        findings.warnings.extend(learner.room());
        Ok(Prepared {
            length,
            learner: Box::new(learner),
            configuration,
            findings,
        })
    }
}

/// Decides a method's settings and components on a scene and makes its first Gaussians.
pub type PrepareMethod = for<'a> fn(
    &'a TrainingScene,
    &MethodRequest,
    BackendChoice,
) -> Result<Prepared<'a>, ReconstructError>;

/// Makes the novel views of a group from its two given ones.
pub type InterpolateGroup = fn(&Group) -> Result<Interpolated, ReconstructError>;

/// A method that can be asked for by name.
#[derive(Debug, Clone, Copy)]
pub struct Method {
    /// Name on the command line and in tables.
    pub id: &'static str,
    /// Full name.
    pub title: &'static str,
    /// Where it was published.
    pub source: &'static str,
    /// What this implementation is, and where it departs from the source.
    pub description: &'static str,
    /// Components that it has by itself; they can be left out by name.
    pub components: &'static [&'static str],
    /// Components that it can be asked for by name.
    pub optional_components: &'static [&'static str],
    /// How its components are decided where a request does not say.
    pub default_plan: DefaultPlan,
    /// What it runs on.
    pub backends: &'static [BackendChoice],
    /// Inputs that it needs beside posed frames and a split, in the order in which they are prepared.
    pub requires: &'static [Requirement],
    /// Options that it understands beside what all methods do.
    pub options: &'static [MethodOption],
    /// How it comes to its views.
    pub kind: MethodKind,
}

/// Backends of methods that have no kernels on a GPU.
pub const ON_CPU: &[BackendChoice] = &[BackendChoice::Cpu];
/// Backends of methods whose every part has.
pub const ON_CPU_AND_GPU: &[BackendChoice] = &[BackendChoice::Cpu, BackendChoice::Gpu];

/// How a method comes to its views.
#[derive(Debug, Clone, Copy)]
pub enum MethodKind {
    /// It learns a model of each scene.
    Trained {
        /// Which cameras give a scene its extent.
        extent: CameraExtent,
        /// Its use for the evidence of motion.
        motion: MotionEvidenceUse,
        /// Kind of model that it leaves in the run's folder.
        model: &'static ModelFormat,
        /// Prepares its training.
        prepare: PrepareMethod,
    },
    /// It learns nothing of a scene: from two given views those between them. It has no seed.
    FeedForward {
        /// Its settings, for the run's record.
        settings: fn() -> serde_json::Value,
        /// Makes the views of a group.
        interpolate: InterpolateGroup,
    },
}

impl Method {
    /// Returns true where it needs this input beside posed frames and a split.
    pub fn needs(&self, requirement: Requirement) -> bool {
        self.requires.contains(&requirement)
    }

    /// Whether it learns a model of each scene; another seed gives another one.
    pub fn is_trained(&self) -> bool {
        matches!(self.kind, MethodKind::Trained { .. })
    }

    /// Returns the kind of model that its runs leave; `None` where it learns nothing.
    pub fn model(&self) -> Option<&'static ModelFormat> {
        match self.kind {
            MethodKind::Trained { model, .. } => Some(model),
            MethodKind::FeedForward { .. } => None,
        }
    }

    /// Returns its use for the evidence of motion; [`MotionEvidenceUse::None`] where it learns nothing.
    pub fn motion(&self) -> MotionEvidenceUse {
        match self.kind {
            MethodKind::Trained { motion, .. } => motion,
            MethodKind::FeedForward { .. } => MotionEvidenceUse::None,
        }
    }

    /// Which cameras give a scene its extent. [`CameraExtent::Most`] where it learns nothing.
    pub fn camera_extent(&self) -> CameraExtent {
        match self.kind {
            MethodKind::Trained { extent, .. } => extent,
            MethodKind::FeedForward { .. } => CameraExtent::Most,
        }
    }

    /// Decides its settings and components on a scene and makes its first model.
    ///
    /// # Errors
    /// When the request makes no sense for it, the scene is not one for it, or it is not trained.
    pub fn prepare<'a>(
        &self,
        scene: &'a TrainingScene,
        request: &MethodRequest,
        backend: BackendChoice,
    ) -> Result<Prepared<'a>, ReconstructError> {
        self.check_backend(backend)?;
        match self.kind {
            MethodKind::Trained { prepare, .. } => prepare(scene, request, backend),
            MethodKind::FeedForward { .. } => Err(ReconstructError::Request {
                reason: format!("{} learns nothing of a scene: it has no training", self.id),
            }),
        }
    }

    /// Trains it on a scene.
    ///
    /// # Errors
    /// When the request makes no sense for the method, the scene is not one for it, it is not
    /// trained, or training fails.
    pub fn train<'a>(
        &self,
        scene: &'a TrainingScene,
        request: &MethodRequest,
        session: &Session<'_>,
    ) -> Result<MethodOutcome<'a>, ReconstructError> {
        let begun = Stopwatch::of_own_process();
        session.progress.begin("planning", None);
        let prepared = self.prepare(scene, request, session.backend);
        session.progress.end();
        let planning = begun.elapsed();
        let Prepared {
            mut learner,
            length,
            configuration,
            findings,
        } = prepared?;
        for warning in &findings.warnings {
            session.progress.note(warning);
        }
        let planning = session.planning.plus(planning);
        let session = Session {
            planning,
            ..session.clone()
        };
        let mut training = train::train(scene, &mut *learner, length, &session)?;
        training.warnings.extend(findings.warnings.iter().cloned());
        Ok(MethodOutcome {
            learner,
            training,
            iterations: length.iterations,
            configuration,
            findings,
            planning,
        })
    }

    /// Returns the components that it can have.
    pub const fn supported(&self) -> Supported {
        Supported {
            default: self.components,
            optional: self.optional_components,
        }
    }

    /// Checks that a request makes sense for this method, before anything is computed.
    ///
    /// # Errors
    /// When it names a component or option that the method does not have, a component to use and to leave
    /// out, or a backend that it never runs on.
    pub fn check(
        &self,
        request: &MethodRequest,
        backend: BackendChoice,
    ) -> Result<(), ReconstructError> {
        let in_plan = match &request.plan {
            PlanChoice::Only(names) => &names[..],
            PlanChoice::Auto | PlanChoice::Full => &[],
        };
        let kind = format!("{} component", self.id);
        let all: Vec<&str> = [self.components, self.optional_components].concat();
        for name in request.without.iter().chain(&request.with).chain(in_plan) {
            names::find(&kind, name, &all, |component| component)?;
        }
        if let Some(name) = request.with.iter().find(|name| request.leaves_out(name)) {
            return Err(ReconstructError::Request {
                reason: format!("{}: {name} is asked for and left out", self.id),
            });
        }
        let kind = format!("{} option", self.id);
        for name in request.options.names() {
            names::find(&kind, name, self.options, |option| option.id)?;
        }
        self.check_backend(backend)
    }

    fn check_backend(&self, backend: BackendChoice) -> Result<(), ReconstructError> {
        if self.backends.contains(&backend) {
            return Ok(());
        }
        Err(EngineError::Backend {
            reason: format!(
                "{} has no GPU kernels: it runs on the CPU only; use the backend cpu",
                self.id
            ),
        }
        .into())
    }
}
