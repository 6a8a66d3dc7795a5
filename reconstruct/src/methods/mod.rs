//! Reconstruction methods: one file each, one line in [`METHODS`].

pub mod deformable;
mod dynamic;
pub mod feed_forward;
pub mod odgs;
pub mod odgs_published;
pub mod omni4dgs;
pub mod omni4dgs_plus;
pub mod periodic;

use omnilife_schemas::{names, records::ComponentDecision};

use crate::{
    error::ReconstructError,
    learner::{Learner, gaussians::GaussianLearner},
    methods::feed_forward::{Group, Interpolated},
    options::MethodOption,
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
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
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
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
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// Lines that a reader of the scores should know.
    pub remarks: Vec<String>,
}

/// What a method of Gaussians begins with on a scene.
#[derive(Debug)]
pub struct PreparedGaussians {
    /// The first Gaussians.
    pub model: Model,
    /// Every setting as resolved.
    pub settings: TrainSettings,
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// Lines that a reader of the scores should know.
    pub remarks: Vec<String>,
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
        Ok(Prepared {
            length: LoopSettings::from(&self.settings),
            learner: Box::new(GaussianLearner::new(
                scene,
                self.model,
                self.settings,
                backend,
            )?),
            configuration,
            plan: self.plan,
            remarks: self.remarks,
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
    /// Components that can be left out by name.
    pub components: &'static [&'static str],
    /// Options that it understands beside what all methods do.
    pub options: &'static [MethodOption],
    /// How it comes to its views.
    pub kind: MethodKind,
}

/// How a method comes to its views.
#[derive(Debug, Clone, Copy)]
pub enum MethodKind {
    /// It learns a model of each scene.
    Trained {
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
    /// Whether it learns a model of each scene; another seed gives another one.
    pub fn is_trained(&self) -> bool {
        matches!(self.kind, MethodKind::Trained { .. })
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
        match self.kind {
            MethodKind::Trained { prepare } => prepare(scene, request, backend),
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
        let Prepared {
            mut learner,
            length,
            configuration,
            plan,
            remarks,
        } = self.prepare(scene, request, session.backend)?;
        for remark in &remarks {
            session.progress.note(remark);
        }
        let mut training = train::train(scene, &mut *learner, length, session)?;
        training.remarks.extend(remarks);
        Ok(MethodOutcome {
            learner,
            training,
            iterations: length.iterations,
            configuration,
            plan,
        })
    }

    /// Checks that a request makes sense for this method, before anything is computed.
    ///
    /// # Errors
    /// When it names a component or option that the method does not have, or a backend that it never runs on.
    pub fn check(
        &self,
        request: &MethodRequest,
        backend: BackendChoice,
    ) -> Result<(), ReconstructError> {
        let named = match &request.plan {
            PlanChoice::Only(names) => &names[..],
            PlanChoice::Auto | PlanChoice::Full => &[],
        };
        let kind = format!("{} component", self.id);
        for name in request.without.iter().chain(named) {
            names::find(&kind, name, self.components, |component| component)?;
        }
        let kind = format!("{} option", self.id);
        for name in request.options.names() {
            names::find(&kind, name, self.options, |option| option.id)?;
        }
        if !self.is_trained() && backend != BackendChoice::Cpu {
            return Err(EngineError::Backend {
                reason: format!("{} runs on the CPU only", self.id),
            }
            .into());
        }
        Ok(())
    }
}

/// All methods.
pub const METHODS: &[Method] = &[
    odgs::METHOD,
    odgs_published::METHOD,
    deformable::METHOD,
    periodic::METHOD,
    omni4dgs::METHOD,
    omni4dgs_plus::METHOD,
    feed_forward::sweep::METHOD,
    feed_forward::infinity::METHOD,
    feed_forward::cross_fade::METHOD,
    feed_forward::nearest::METHOD,
];

/// The method of this name.
///
/// # Errors
/// When there is none; the error lists all names.
pub fn find(id: &str) -> Result<&'static Method, ReconstructError> {
    Ok(names::find("method", id, METHODS, |method| method.id)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_unique_and_described() {
        for (index, method) in METHODS.iter().enumerate() {
            assert!(METHODS[..index].iter().all(|other| other.id != method.id));
            assert!(!method.title.is_empty() && !method.source.is_empty());
            assert!(method.description.len() > 40, "{}", method.id);
            assert!(method.options.iter().all(|option| option.doc.len() > 20));
            assert_eq!(find(method.id).map(|found| found.id).ok(), Some(method.id));
        }
        let message = find("nerf").map(|_| ()).expect_err("unknown").to_string();
        assert!(
            message.contains("nerf") && message.contains("odgs"),
            "{message}"
        );
    }
}
