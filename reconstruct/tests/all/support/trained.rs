//! Methods trained for a few steps, without files.

use omnilife_engine::step::settings::TrainSettings;
use omnilife_reconstruct::{
    methods::{self, MethodOutcome, Prepared},
    request::MethodRequest,
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::progress::Silent;

/// Returns a request with all defaults and one seed.
pub(crate) fn request(iterations: u64) -> MethodRequest {
    MethodRequest::new(iterations, 7)
}

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

/// Returns the trained arrays of a method of Gaussians, each of which must have its growth in short schedules in the
/// record.
pub(crate) fn arrays_with_growth(prepared: &Prepared<'_>) -> Vec<&'static str> {
    let rates = &prepared.configuration["learning_rates"];
    let arrays = prepared.learner.arrays();
    assert!(!arrays.is_empty());
    for array in &arrays {
        let growth = &rates[array.name]["growth"];
        assert!(!growth.is_null(), "{}: {rates}", array.name);
    }
    arrays.iter().map(|array| array.name).collect()
}

/// Returns the settings of a training as its record has them.
pub(crate) fn settings(outcome: &MethodOutcome<'_>) -> TrainSettings {
    serde_json::from_value(outcome.configuration.clone()).unwrap()
}
