//! A device that is lost, too small or out of memory ends a training with one line, and the last checkpoint is kept.

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
    train::{self, LoopSettings, Session, TrainingOutcome},
};
use omnilife_schemas::{Classified, ErrorKind, points::PointCloud, progress::Progress};

use crate::support::{balls, device, trained::files};

const ITERATIONS: u64 = 30;
const CHECKPOINT_EVERY: u64 = 10;
/// Step of the device's failure, before the second densification.
const FAILS_AFTER: u64 = 15;

/// Receives every step, and changes the device after one of them.
struct FailingDevice<'a> {
    gpu: &'a Gpu,
    steps: AtomicU64,
    how: fn(&Gpu),
}

impl<'a> FailingDevice<'a> {
    fn after(gpu: &'a Gpu, how: fn(&Gpu)) -> Self {
        Self {
            gpu,
            steps: AtomicU64::new(0),
            how,
        }
    }

    /// Counts steps from [`FAILS_AFTER`] on.
    fn never(gpu: &'a Gpu) -> Self {
        Self {
            steps: AtomicU64::new(FAILS_AFTER),
            ..Self::after(gpu, |_| {})
        }
    }
}

impl Progress for FailingDevice<'_> {
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

fn run(
    scene: &TrainingScene,
    learner: &mut GaussianLearner<'_>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<TrainingOutcome, ReconstructError> {
    let session = Session {
        files: Some(files(folder, CHECKPOINT_EVERY)),
        ..Session::without_files(progress)
    };
    train::train(scene, learner, LoopSettings::from(&settings()), &session)
}

/// Starts a training on a device, which resumes from the folder's checkpoint.
fn start(
    gpu: &Arc<Gpu>,
    scene: &TrainingScene,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<TrainingOutcome, ReconstructError> {
    let stepper = GpuStepper::new(Arc::clone(gpu), scene.inputs(), model(scene), &settings())?;
    let mut learner = GaussianLearner::with_stepper(scene, Box::new(stepper), settings())?;
    run(scene, &mut learner, folder, progress)
}

/// Checks that a failure is one line with exit code 1; returns the device's part of it.
fn of_device(error: ReconstructError) -> GpuError {
    assert_eq!(error.error_kind(), ErrorKind::Internal, "{error}");
    assert_eq!(error.to_string().lines().count(), 1, "{error}");
    match error {
        ReconstructError::Engine(EngineError::Gpu(error)) => error,
        other => panic!("{other}"),
    }
}

/// Checks that a folder has one whole checkpoint, from which training resumes on the CPU; returns the steps left.
fn steps_after_checkpoint(gpu: &Gpu, scene: &TrainingScene, folder: &Path) -> u64 {
    let kept = fs::read_dir(folder).unwrap();
    let kept = kept.map(|file| file.unwrap().file_name().into_string().unwrap());
    let kept: Vec<String> = kept.filter(|name| name.starts_with("checkpoint")).collect();
    assert_eq!(kept, ["checkpoint.bin"]);
    let mut learner =
        GaussianLearner::new(scene, model(scene), settings(), BackendChoice::Cpu).unwrap();
    let counts = FailingDevice::never(gpu);
    let outcome = run(scene, &mut learner, folder, &counts).unwrap();
    assert_eq!(outcome.state.iteration, ITERATIONS);
    assert!(outcome.state.resumed > 0);
    counts.steps.load(Ordering::Relaxed) - FAILS_AFTER
}

/// Trains until the device fails; returns its failure.
fn failed(how: fn(&Gpu)) -> Option<GpuError> {
    let gpu = device()?;
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let fails = FailingDevice::after(&gpu, how);
    let error = start(&gpu, &scene, folder.path(), &fails).unwrap_err();
    let error = of_device(error);
    let steps = steps_after_checkpoint(&gpu, &scene, folder.path());
    assert_eq!(steps, ITERATIONS - CHECKPOINT_EVERY);
    Some(error)
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

#[test]
fn an_adapter_with_too_small_buffers_ends_a_training_and_keeps_its_checkpoint() {
    if let Some(error) = failed(|gpu| gpu.pretend_largest_buffer(1 << 12)) {
        assert!(matches!(error, GpuError::TooSmall { .. }), "{error}");
        assert!(error.to_string().contains("it offers 4096"), "{error}");
    }
}

/// Checks allocations of a training that resumes from a checkpoint, from the first one on: those of kernels, images and
/// tables, of densifications, and of reading back.
#[test]
fn memory_that_ends_at_any_allocation_ends_a_training_and_keeps_its_checkpoint() {
    /// Tried allocations, evenly over all.
    const TRIED: u64 = 12;
    let Some(gpu) = device() else { return };
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint.bin");
    let fails = FailingDevice::after(&gpu, |gpu| gpu.exhaust_above(1 << 12));
    start(&gpu, &scene, folder.path(), &fails).unwrap_err();
    gpu.exhaust_above(u64::MAX);
    let earlier = fs::read(&checkpoint).unwrap();

    // The first of two keeps the buffer for reading back.
    let [_, all] = [(); 2].map(|()| {
        fs::write(&checkpoint, &earlier).unwrap();
        let before = gpu.allocations();
        start(&gpu, &scene, folder.path(), &FailingDevice::never(&gpu)).unwrap();
        gpu.allocations() - before
    });
    assert!(all > 2 * TRIED, "{all}");
    for number in 0..TRIED {
        fs::write(&checkpoint, &earlier).unwrap();
        // The last twelfth is left out: rows of the trace, and their images, follow the time.
        let allowed = number * all / TRIED;
        println!("{allowed} of {all} allocations");
        gpu.exhaust_after(allowed);
        let error = start(&gpu, &scene, folder.path(), &FailingDevice::never(&gpu)).unwrap_err();
        let error = of_device(error);
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        let steps = steps_after_checkpoint(&gpu, &scene, folder.path());
        // The earlier checkpoint, or a later one of this run.
        assert!([10, 20].contains(&steps), "{steps}");
    }
}
