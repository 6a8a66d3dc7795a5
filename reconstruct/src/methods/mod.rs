//! Reconstruction methods: one file each, one line in [`METHODS`].

pub mod odgs;

use omnilife_schemas::{progress::Progress, records::ComponentDecision};

use crate::{
    error::ReconstructError,
    scene::TrainingScene,
    train::{TrainSettings, Trained},
};

/// What a user asks of a method.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodRequest {
    /// Steps of the optimizer; schedules are scaled to it.
    pub iterations: u64,
    /// Wall-clock limit in seconds.
    pub budget_seconds: Option<f64>,
    /// Random seed.
    pub seed: u64,
    /// No Gaussian is added above this number; the method decides where none is given.
    pub maximum_gaussians: Option<u64>,
}

/// What a method gives back.
#[derive(Debug, Clone)]
pub struct MethodOutcome {
    /// The trained model.
    pub trained: Trained,
    /// Every setting as resolved.
    pub settings: TrainSettings,
    /// Components used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
}

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
    /// Trains it.
    pub train: fn(
        &TrainingScene,
        &MethodRequest,
        &dyn Progress,
    ) -> Result<MethodOutcome, ReconstructError>,
}

/// All methods.
pub const METHODS: &[Method] = &[odgs::METHOD];

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
