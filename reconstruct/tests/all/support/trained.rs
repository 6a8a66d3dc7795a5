//! Methods trained for a few steps.

use std::{fs, path::Path};

use omnilife_engine::step::settings::TrainSettings;
use omnilife_reconstruct::{
    methods::{self, Method, MethodOutcome, Prepared},
    options::Options,
    request::MethodRequest,
    scene::TrainingScene,
    train::{Session, TrainingFiles, watch::WatchFiles},
};
use omnilife_schemas::progress::Silent;

/// Returns a request with all defaults and one seed.
pub(crate) fn request(iterations: u64) -> MethodRequest {
    MethodRequest::new(iterations, 7)
}

/// Returns options that make steps small, of those that a method has, and others of it.
pub(crate) fn small_options(method: &Method, max_gaussians: usize, others: &[String]) -> Options {
    let limit = max_gaussians.to_string();
    let small = [
        ("max-gaussians", limit.as_str()),
        ("rays", "512"),
        ("base-fields", "tiny"),
        ("motion-fields", "tiny"),
    ];
    let has = |id: &str| method.options.iter().any(|option| option.id == id);
    let small = small.into_iter().filter(|(id, _)| has(id));
    let lines = small.map(|(id, value)| format!("{id}={value}"));
    let lines: Vec<String> = lines.chain(others.iter().cloned()).collect();
    Options::parse(method.id, method.options, &lines).unwrap()
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

/// Returns the files of a run in a folder, with a checkpoint every so many iterations.
pub(crate) fn files(folder: &Path, checkpoint_every: u64) -> TrainingFiles {
    TrainingFiles {
        trace: folder.join("trace.csv"),
        trace_views: None,
        watch: WatchFiles::default(),
        checkpoint: folder.join("checkpoint.bin"),
        checkpoint_every,
        inputs_sha256: "these inputs".to_owned(),
    }
}

/// Returns what is `kept` of a whole run of 40 iterations, and of one that resumes from its checkpoint at 25.
pub(crate) fn whole_and_resumed<T>(
    scene: &TrainingScene,
    method: &str,
    request: &MethodRequest,
    kept: impl Fn(&mut MethodOutcome<'_>) -> T,
) -> [T; 2] {
    let folder = tempfile::tempdir().unwrap();
    // The first run's only checkpoint is the start of the second.
    [("whole", 25), ("resumed", 0)].map(|(name, every)| {
        let files = files(&folder.path().join(name), every);
        fs::create_dir(folder.path().join(name)).unwrap();
        if name == "resumed" {
            let of_whole = folder.path().join("whole/checkpoint.bin");
            fs::copy(of_whole, &files.checkpoint).unwrap();
        }
        let session = Session {
            files: Some(files),
            ..Session::without_files(&Silent)
        };
        let method = methods::find(method).unwrap();
        let mut outcome = method.train(scene, request, &session).unwrap();
        assert_eq!(outcome.training.state.resumed, u64::from(name == "resumed"));
        kept(&mut outcome)
    })
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
