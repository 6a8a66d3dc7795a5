//! Reconstruction methods: one file each, one line in [`METHODS`].

pub mod deformable;
mod dynamic;
pub mod feed_forward;
pub mod odgs;
pub mod odgs_published;
pub mod omni4dgs;
pub mod omni4dgs_plus;
pub mod periodic;
mod prepared;

use omnilife_schemas::records::ComponentDecision;

use crate::request::MethodRequest;
use crate::request::PlanChoice;
use crate::{
    components::Supported,
    error::ReconstructError,
    evidence::SceneEvidence,
    learner::{Learner, gaussians::GaussianLearner},
    process::{self, Elapsed},
    request::BackendChoice,
    scene::TrainingScene,
    train::{self, LoopSettings, Session, TrainingOutcome},
};
use omnilife_engine::{model::Model, step::settings::TrainSettings};

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
    /// What the scene shows of itself, where the method asks.
    pub evidence: Option<SceneEvidence>,
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
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// What the scene shows of itself, where the method asks.
    pub evidence: Option<SceneEvidence>,
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
    /// What the scene shows of itself, where the method asks.
    pub evidence: Option<SceneEvidence>,
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
            evidence: self.evidence,
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
    /// Prepares its training.
    pub prepare: PrepareMethod,
}

impl Method {
    /// Trains it on a scene.
    ///
    /// # Errors
    /// When the request makes no sense for the method, the scene is not one for it, or training
    /// fails.
    pub fn train<'a>(
        &self,
        scene: &'a TrainingScene,
        request: &MethodRequest,
        session: &Session<'_>,
    ) -> Result<MethodOutcome<'a>, ReconstructError> {
        let (prepared, planning) =
            process::measured(|| (self.prepare)(scene, request, session.backend));
        let Prepared {
            mut learner,
            length,
            configuration,
            plan,
            evidence,
            remarks,
        } = prepared?;
        for remark in &remarks {
            session.progress.note(remark);
        }
        let session = Session {
            planning,
            ..session.clone()
        };
        let mut training = train::train(scene, &mut *learner, length, &session)?;
        training.remarks.extend(remarks);
        Ok(MethodOutcome {
            learner,
            training,
            iterations: length.iterations,
            configuration,
            plan,
            evidence,
            planning,
        })
    }

    /// The components that it can have.
    pub(crate) const fn supported(&self) -> Supported {
        Supported {
            default: self.components,
            optional: self.optional_components,
        }
    }

    /// Whether the request makes sense for this method.
    ///
    /// # Errors
    /// When it names a component that the method does not have, or one to use and to leave out.
    pub fn check(&self, request: &MethodRequest) -> Result<(), ReconstructError> {
        let in_plan = match &request.plan {
            PlanChoice::Only(names) => &names[..],
            PlanChoice::Auto | PlanChoice::Full => &[],
        };
        let all = || self.components.iter().chain(self.optional_components);
        let mut names = request.without.iter().chain(&request.with).chain(in_plan);
        if let Some(name) = names.find(|name| !all().any(|known| known == name)) {
            return Err(ReconstructError::UnknownComponent {
                method: self.id.to_owned(),
                name: name.clone(),
                known: all().copied().collect::<Vec<_>>().join(", "),
            });
        }
        match request.with.iter().find(|name| request.leaves_out(name)) {
            None => Ok(()),
            Some(name) => Err(ReconstructError::Request {
                reason: format!("{}: {name} is asked for and left out", self.id),
            }),
        }
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
];

/// The method of this name.
///
/// # Errors
/// When there is none; the error lists all names.
pub fn find(id: &str) -> Result<&'static Method, ReconstructError> {
    METHODS
        .iter()
        .find(|method| method.id == id)
        .ok_or_else(|| ReconstructError::UnknownMethod {
            name: id.to_owned(),
            known: METHODS
                .iter()
                .map(|method| method.id)
                .collect::<Vec<_>>()
                .join(", "),
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::COMPONENTS;

    #[test]
    fn methods_are_unique_and_described() {
        for (index, method) in METHODS.iter().enumerate() {
            assert!(METHODS[..index].iter().all(|other| other.id != method.id));
            assert!(!method.title.is_empty() && !method.source.is_empty());
            assert!(method.description.len() > 40, "{}", method.id);
            assert_eq!(find(method.id).map(|found| found.id).ok(), Some(method.id));
        }
        let shared = |name: &&str| COMPONENTS.iter().any(|component| component.id == *name);
        for method in METHODS {
            let (own, optional) = (method.components, method.optional_components);
            assert!(
                optional
                    .iter()
                    .all(|name| shared(name) && !own.contains(name))
            );
        }
        let message = find("nerf").map(|_| ()).expect_err("unknown").to_string();
        assert!(
            message.contains("nerf") && message.contains("odgs"),
            "{message}"
        );
    }

    #[test]
    fn components_that_a_method_lacks_and_contradictions_are_refused() {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let refusal = |method: &Method, with: &[&str], without: &[&str]| {
            let request = MethodRequest {
                with: owned(with),
                without: owned(without),
                ..MethodRequest::new(1, 0)
            };
            let refused = method.check(&request).err();
            refused.map(|error| error.to_string())
        };
        let both = ["exposure-compensation", "pose-refinement"];
        assert_eq!(refusal(&odgs::METHOD, &both, &["sky-shell"]), None);
        let unknown = refusal(&odgs::METHOD, &["static-table"], &[]).unwrap_or_default();
        assert!(unknown.contains("static-table") && unknown.contains("pose-refinement"));
        let contradiction = refusal(&odgs::METHOD, &both, &both).unwrap_or_default();
        assert!(
            contradiction.contains("asked for and left out"),
            "{contradiction}"
        );
        for name in both {
            assert!(refusal(&odgs_published::METHOD, &[name], &[]).is_some());
        }
    }
}
