//! A device that is lost or out of memory ends a training with one line, and the last checkpoint is kept.

use std::{
    fs,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use device::device;
use omnilife_engine::{
    EngineError,
    density::{DensifySettings, Threshold},
    device::{Gpu, GpuError},
    gaussians::static_gaussians,
    model::Model,
    step::{BackendChoice, gpu::GpuStepper, settings::TrainSettings},
};
use omnilife_reconstruct::{
    baseline,
    error::ReconstructError,
    learner::gaussians::GaussianLearner,
    scene::TrainingScene,
    seeds::points,
    train::{self, LoopSettings, Session, TrainingFiles, TrainingOutcome, watch::WatchFiles},
};
use omnilife_schemas::{Classified, ErrorKind, points::PointCloud, progress::Progress};

use crate::support::{balls, device};

const ITERATIONS: u64 = 30;
const CHECKPOINT_EVERY: u64 = 10;
/// Step of the device's failure, before the second densification.
const FAILS_AFTER: u64 = 15;

/// Receives every step, and changes the device after one of them.
struct Fails<'a> {
    gpu: &'a Gpu,
    steps: AtomicU64,
    how: fn(&Gpu),
}

impl Progress for Fails<'_> {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, steps: u64) {
        let before = self.steps.fetch_add(steps, Ordering::Relaxed);
        if (before + 1..=before + steps).contains(&FAILS_AFTER) {
            (self.how)(self.gpu);
        }
    }
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, _: &str) {}
}

fn model(scene: &TrainingScene) -> Model {
    let PointCloud { positions, colours } = &scene.points;
    let points = PointCloud {
        positions: positions.iter().step_by(8).copied().collect(),
        colours: colours.iter().step_by(8).copied().collect(),
    };
    let initial = points::from_points(&points, 3.0);
    Model::of_static(static_gaussians::table(&initial, 0))
}

/// Densifies at every tenth step, lets all visible Gaussians grow, and removes none for its size.
fn settings() -> TrainSettings {
    let published = baseline::published_settings(ITERATIONS);
    TrainSettings {
        densify: DensifySettings {
            begin_iteration: 1,
            end_iteration: ITERATIONS,
            interval_iterations: CHECKPOINT_EVERY,
            gradient_threshold: Threshold::constant(1e-9),
            maximum_gaussians: 20_000,
            // The scene is small, and its Gaussians are large in it.
            prune_size: f32::MAX,
            ..published.densify.clone()
        },
        ..published
    }
}

fn files(folder: &Path) -> TrainingFiles {
    TrainingFiles {
        trace: folder.join("trace.csv"),
        trace_views: None,
        watch: WatchFiles::default(),
        checkpoint: folder.join("checkpoint.bin"),
        checkpoint_every: CHECKPOINT_EVERY,
        inputs_sha256: "these inputs".to_owned(),
    }
}

fn run(
    scene: &TrainingScene,
    learner: &mut GaussianLearner<'_>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<TrainingOutcome, ReconstructError> {
    let session = Session {
        files: Some(files(folder)),
        ..Session::without_files(progress)
    };
    train::train(scene, learner, LoopSettings::from(&settings()), &session)
}

/// Trains until the device fails; returns its failure.
fn failed(how: fn(&Gpu)) -> Option<GpuError> {
    let gpu = device()?;
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let stepper = GpuStepper::new(Arc::clone(&gpu), scene.inputs(), model(&scene), &settings());
    let stepper = Box::new(stepper.unwrap());
    let mut learner = GaussianLearner::with_stepper(&scene, stepper, settings()).unwrap();
    let fails = Fails {
        gpu: &gpu,
        steps: AtomicU64::new(0),
        how,
    };
    let error = run(&scene, &mut learner, folder.path(), &fails).unwrap_err();
    // An error of this program: exit code 1, with one line.
    assert_eq!(error.error_kind(), ErrorKind::Internal, "{error}");
    assert_eq!(error.to_string().lines().count(), 1, "{error}");
    let kept = fs::read_dir(folder.path()).unwrap();
    let kept = kept.map(|file| file.unwrap().file_name().into_string().unwrap());
    let kept: Vec<String> = kept.filter(|name| name.starts_with("checkpoint")).collect();
    assert_eq!(kept, ["checkpoint.bin"]);
    // Training resumes from the last checkpoint, on the CPU as well.
    let mut learner =
        GaussianLearner::new(&scene, model(&scene), settings(), BackendChoice::Cpu).unwrap();
    let counts = Fails {
        gpu: &gpu,
        steps: AtomicU64::new(FAILS_AFTER),
        how: |_| {},
    };
    let outcome = run(&scene, &mut learner, folder.path(), &counts).unwrap();
    assert_eq!(outcome.state.iteration, ITERATIONS);
    let steps = counts.steps.load(Ordering::Relaxed) - FAILS_AFTER;
    assert_eq!(steps, ITERATIONS - CHECKPOINT_EVERY);
    match error {
        ReconstructError::Engine(EngineError::Gpu(error)) => Some(error),
        other => panic!("{other}"),
    }
}

#[test]
fn a_lost_device_ends_a_training_and_keeps_its_checkpoint() {
    if let Some(error) = failed(Gpu::destroy) {
        assert!(matches!(error, GpuError::Lost { .. }), "{error}");
    }
}

#[test]
fn a_device_without_memory_for_more_gaussians_ends_a_training_and_keeps_its_checkpoint() {
    if let Some(error) = failed(|gpu| gpu.exhaust_above(1 << 12)) {
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        assert!(error.to_string().contains("used up"), "{error}");
    }
}
