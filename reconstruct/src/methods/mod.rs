//! Reconstruction methods: one file each, one line in [`METHODS`].

pub mod deformable;
mod dynamic;
pub mod feed_forward;
pub mod odgs;
pub mod odgs_published;
pub mod omni4dgs;
pub mod omni4dgs_plus;
pub mod periodic;

use omnilife_schemas::records::ComponentDecision;

use crate::request::MethodRequest;
use crate::request::PlanChoice;
use crate::{
    error::ReconstructError,
    request::BackendChoice,
    scene::TrainingScene,
    train::{self, Session, Trained},
};
use omnilife_engine::{model::Model, step::settings::TrainSettings};

/// What a method gives back.
#[derive(Debug)]
pub struct MethodOutcome<'a> {
    /// The trained model.
    pub trained: Trained<'a>,
    /// Every setting as resolved.
    pub settings: TrainSettings,
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
}

/// What a method begins with on a scene.
#[derive(Debug)]
pub struct Prepared {
    /// The first Gaussians.
    pub model: Model,
    /// Every setting as resolved.
    pub settings: TrainSettings,
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
    /// Lines that a reader of the scores should know.
    pub remarks: Vec<String>,
}

/// Decides a method's settings and components on a scene and makes its first Gaussians.
pub type PrepareMethod =
    fn(&TrainingScene, &MethodRequest, BackendChoice) -> Result<Prepared, ReconstructError>;

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
        let Prepared {
            model,
            settings,
            plan,
            remarks,
        } = (self.prepare)(scene, request, session.backend)?;
        for remark in &remarks {
            session.progress.note(remark);
        }
        let mut trained = train::train(scene, model, &settings, session)?;
        trained.remarks.extend(remarks);
        Ok(MethodOutcome {
            trained,
            settings,
            plan,
        })
    }

    /// Whether the request makes sense for this method.
    ///
    /// # Errors
    /// When it names a component that the method does not have.
    pub fn check(&self, request: &MethodRequest) -> Result<(), ReconstructError> {
        let known = |name: &String| self.components.contains(&name.as_str());
        let named = match &request.plan {
            PlanChoice::Only(names) => &names[..],
            PlanChoice::Auto | PlanChoice::Full => &[],
        };
        let mut names = request.without.iter().chain(named);
        match names.find(|name| !known(name)) {
            None => Ok(()),
            Some(name) => Err(ReconstructError::UnknownComponent {
                method: self.id.to_owned(),
                name: name.clone(),
                known: self.components.join(", "),
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

    #[test]
    fn methods_are_unique_and_described() {
        for (index, method) in METHODS.iter().enumerate() {
            assert!(METHODS[..index].iter().all(|other| other.id != method.id));
            assert!(!method.title.is_empty() && !method.source.is_empty());
            assert!(method.description.len() > 40, "{}", method.id);
            assert_eq!(find(method.id).map(|found| found.id).ok(), Some(method.id));
        }
        let message = find("nerf").map(|_| ()).expect_err("unknown").to_string();
        assert!(
            message.contains("nerf") && message.contains("odgs"),
            "{message}"
        );
    }
}
