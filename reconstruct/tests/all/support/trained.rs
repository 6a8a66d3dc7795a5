//! Methods trained for a few steps, without files.

use omnilife_engine::step::settings::TrainSettings;
use omnilife_reconstruct::{
    methods::{self, MethodOutcome},
    request::MethodRequest,
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::progress::Silent;

/// Returns a request with all defaults and one seed.
pub(crate) fn request(iterations: u64) -> MethodRequest {
    MethodRequest::new(iterations, 7)
}

/// Returns the outcome of a training that has to succeed.
pub(crate) fn train<'a>(
    scene: &'a TrainingScene,
    method: &str,
    request: &MethodRequest,
) -> MethodOutcome<'a> {
    methods::find(method)
        .unwrap()
        .train(scene, request, &Session::without_files(&Silent))
        .unwrap()
}

/// Returns the settings of a training as its record has them.
pub(crate) fn settings(outcome: &MethodOutcome<'_>) -> TrainSettings {
    serde_json::from_value(outcome.configuration.clone()).unwrap()
}
