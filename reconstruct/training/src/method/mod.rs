//! Reconstruction methods: the row of a method, and its training.

pub mod group;
mod prepared;
pub mod requirement;

use omnilife_schemas::{
    elapsed::{Elapsed, Stopwatch},
    names::{self, UnknownName},
    records::{ComponentDecision, Lift},
};

use crate::{
    components::{self, MotionEvidenceUse, Supported, aids},
    error::ReconstructError,
    evidence::SceneEvidence,
    learner::{Learner, gaussians::GaussianLearner},
    method::{
        group::{Group, GroupOutput},
        requirement::Requirement,
    },
    models::ModelFormat,
    options::MethodOption,
    request::{BackendChoice, DefaultPlan, MethodRequest, PlanChoice},
    scene::{CameraExtent, TrainingScene},
    train::{self, LoopSettings, Session, TrainingOutcome},
};
use omnilife_engine::{
    EngineError,
    model::{Model, camera_response::CameraResponse},
    step::settings::TrainSettings,
};

/// Outcome of a method's training.
#[derive(Debug)]
pub struct MethodOutcome<'a> {
    /// The trained model, ready to render.
    pub learner: Box<dyn Learner + 'a>,
    /// End of its training.
    pub training: TrainingOutcome,
    /// Iterations of the schedule.
    pub iterations: u64,
    /// Every setting as resolved.
    pub configuration: serde_json::Value,
    /// Decisions and their evidence; its warnings are among those of the training.
    pub findings: Findings,
    /// Time of deciding and placing the first Gaussians, the pilot fit included; training time includes it.
    pub planning: Elapsed,
}

/// Start of a method on a scene.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// The model before its first step.
    pub learner: Box<dyn Learner + 'a>,
    /// Length of its training.
    pub length: LoopSettings,
    /// Every setting as resolved, for the run's record.
    pub configuration: serde_json::Value,
    /// Decisions and their evidence.
    pub findings: Findings,
}

/// Decisions of a method on a scene before training, with their evidence.
#[derive(Debug, Default)]
pub struct Findings {
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// Evidence of the scene, if the method gathers it.
    pub evidence: Option<SceneEvidence>,
    /// Counts of lifted pixels, if the method starts with them.
    pub lift: Option<Lift>,
    /// Warnings for readers of the scores.
    pub warnings: Vec<String>,
}

/// Start of a method of Gaussians on a scene.
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
    /// Makes a learner of them on a backend.
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

/// Makes the novel views of a group from its two input views.
pub type InterpolateGroup = fn(&Group) -> Result<GroupOutput, ReconstructError>;

/// A method with a name.
#[derive(Debug, Clone, Copy)]
pub struct Method {
    /// Name on the command line and in tables.
    pub id: &'static str,
    /// Full name.
    pub title: &'static str,
    /// Publication.
    pub source: &'static str,
    /// Description of this implementation, and its deviations from the source.
    pub description: &'static str,
    /// Default components; they can be left out by name.
    pub components: &'static [&'static str],
    /// Optional components, used by name.
    pub optional_components: &'static [&'static str],
    /// Components that the ablation in its publication leaves out; empty if it has none.
    pub ablation: &'static [&'static str],
    /// Default decision on its components.
    pub default_plan: DefaultPlan,
    /// Supported backends.
    pub backends: &'static [BackendChoice],
    /// Required inputs beside posed frames and a split, in the order of their preparation.
    pub requires: &'static [Requirement],
    /// Its options beside those of all methods.
    pub options: &'static [MethodOption],
    /// Kind: trained or feed-forward.
    pub kind: MethodKind,
}

/// Backends of methods without kernels on a GPU.
pub const ON_CPU: &[BackendChoice] = &[BackendChoice::Cpu];
/// Backends of methods with kernels for every part.
pub const ON_CPU_AND_GPU: &[BackendChoice] = &[BackendChoice::Cpu, BackendChoice::Gpu];

/// Kind of a method.
#[derive(Debug, Clone, Copy)]
pub enum MethodKind {
    /// It trains a model of each scene.
    Trained {
        /// Cameras of a scene's extent.
        extent: CameraExtent,
        /// Its use for the evidence of motion.
        motion: MotionEvidenceUse,
        /// Kind of model that it leaves in the run's folder.
        model: &'static ModelFormat,
        /// Prepares its training.
        prepare: PrepareMethod,
    },
    /// It predicts the views between two input views, without training and without a seed.
    FeedForward {
        /// Its settings, for the run's record.
        settings: fn() -> serde_json::Value,
        /// Makes the views of a group.
        interpolate: InterpolateGroup,
    },
}

impl Method {
    /// Returns true if it requires this input beside posed frames and a split.
    pub fn needs(&self, requirement: Requirement) -> bool {
        self.requires.contains(&requirement)
    }

    /// Returns true if a request lets it have a component that trains on masks of moving content.
    pub fn uses_masks(&self, request: &MethodRequest) -> bool {
        components::FED_BY_MASKS.iter().any(|component| {
            self.components.contains(component) && request.allows(component)
                || self.optional_components.contains(component) && request.names(component)
        })
    }

    /// Returns true if it trains a model of each scene; another seed gives another one.
    pub fn is_trained(&self) -> bool {
        matches!(self.kind, MethodKind::Trained { .. })
    }

    /// Returns the kind of model of its runs; `None` for feed-forward methods.
    pub fn model(&self) -> Option<&'static ModelFormat> {
        match self.kind {
            MethodKind::Trained { model, .. } => Some(model),
            MethodKind::FeedForward { .. } => None,
        }
    }

    /// Returns its use for the evidence of motion; [`MotionEvidenceUse::None`] for feed-forward methods.
    pub fn motion(&self) -> MotionEvidenceUse {
        match self.kind {
            MethodKind::Trained { motion, .. } => motion,
            MethodKind::FeedForward { .. } => MotionEvidenceUse::None,
        }
    }

    /// Returns the cameras of a scene's extent; [`CameraExtent::Most`] for feed-forward methods.
    pub fn camera_extent(&self) -> CameraExtent {
        match self.kind {
            MethodKind::Trained { extent, .. } => extent,
            MethodKind::FeedForward { .. } => CameraExtent::Most,
        }
    }

    /// Decides its settings and components on a scene and makes its first model.
    ///
    /// # Errors
    /// When the request or the scene does not suit it, or it is not a trained method.
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
    /// When the request or the scene does not suit the method, it is not a trained method, or training fails.
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
            mut configuration,
            mut findings,
        } = prepared?;
        let idle = self.idle_constants(request, &findings.plan);
        findings.warnings.extend(idle);
        for warning in &findings.warnings {
            session.progress.note(&format!("warning: {warning}"));
        }
        let planning = session.planning.plus(planning);
        let session = Session {
            planning,
            ..session.clone()
        };
        let mut training = train::train(scene, &mut *learner, length, &session)?;
        training.warnings.extend(findings.warnings.iter().cloned());
        record_response(&mut configuration, &mut *learner)?;
        Ok(MethodOutcome {
            learner,
            training,
            iterations: length.iterations,
            configuration,
            findings,
            planning,
        })
    }

    /// Returns a line for each changed constant of a component that a plan does not use.
    fn idle_constants(&self, request: &MethodRequest, plan: &[ComponentDecision]) -> Vec<String> {
        let is_used = |component: &str| {
            let mut used = plan.iter().filter(|decision| decision.used);
            used.any(|decision| decision.component == component)
        };
        let changed = request.options.changed_constants(self.options);
        let names: Vec<&str> = changed.names().collect();
        let options = self.options.iter();
        let changed = options.filter(|option| names.contains(&option.id));
        let line = |option: &MethodOption| {
            let component = option.constant?.component?;
            (!is_used(component)).then(|| {
                format!(
                    "{} was set and has no effect: {component} is not used",
                    option.id
                )
            })
        };
        changed.filter_map(line).collect()
    }

    /// Returns its default and optional components.
    pub const fn supported(&self) -> Supported {
        Supported {
            default: self.components,
            optional: self.optional_components,
        }
    }

    /// Checks that a request suits this method, before any computation.
    ///
    /// # Errors
    /// When it names a component or option that the method does not have, or a component to use and to leave out.
    /// When it names an unsupported backend.
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
        let mut all: Vec<&str> = [self.components, self.optional_components].concat();
        // One name may be a misspelt plan.
        let plans: &[&str] = if in_plan.len() == 1 {
            &["auto", "full"]
        } else {
            &[]
        };
        for name in in_plan {
            if !all.contains(&name.as_str()) {
                let known = plans.iter().chain(&all).copied();
                return Err(UnknownName::new(&kind, name, known).into());
            }
        }
        all.extend(self.supported().aids().next().map(|_| aids::ALL));
        for name in request.without.iter().chain(&request.with) {
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
        self.check_backend(backend)?;
        let has_word = |option: &&MethodOption| {
            let word = request.options.word(option);
            word.is_some_and(|word| option.cpu_only.contains(&word))
        };
        match self.options.iter().find(has_word) {
            Some(option) if backend != BackendChoice::Cpu => Err(EngineError::Backend {
                reason: format!(
                    "{} has {}={} on the CPU only; use the backend cpu",
                    self.id,
                    option.id,
                    request.options.word(option).unwrap_or_default()
                ),
            }
            .into()),
            _ => Ok(()),
        }
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

/// Adds the learnt response of the camera to the settings in a run's record, if they have one.
fn record_response(
    configuration: &mut serde_json::Value,
    learner: &mut dyn Learner,
) -> Result<(), ReconstructError> {
    let Some(settings) = configuration.get_mut("response") else {
        return Ok(());
    };
    let model = learner.gaussians()?;
    let response = model.and_then(|model| model.response.as_ref());
    let learnt = response.and_then(CameraResponse::learnt);
    settings["learnt"] =
        serde_json::to_value(learnt).map_err(|error| ReconstructError::Request {
            reason: format!("a camera's response that cannot be recorded: {error}"),
        })?;
    Ok(())
}
