//! Clips with little to learn from: a few steps of training on each, by every method with time.

use glam::{DQuat, DVec3, Mat3, Vec3};
use omnilife_schemas::{
    Pose, Similarity, camera::CameraModel, camera::ErpCamera, points::PointCloud, progress::Silent,
};

use crate::{
    devices::{Device, DeviceKind},
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};
use omnilife_engine::{camera::View, model::Part, training_view::TrainingView};
use omnilife_methods::{odgs, omni4dgs, omni4dgs_plus, periodic};
use omnilife_reconstruct::registry::METHODS;
use omnilife_training::{
    components::MotionEvidenceUse,
    evidence::once::PilotOnce,
    method::{Method, MethodOutcome},
    options::Options,
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::Session,
};

const ITERATIONS: u64 = 12;
const LONG_ITERATIONS: u64 = 3_000;
pub(super) const FRAMES: u32 = 6;

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "masks-empty",
        title: "training with masks in which nothing is marked",
        runs: Runs::OnBoth,
        judge: |device| train_all(device, |scene| fill_masks(scene, 0)),
    },
    SpecialCase {
        id: "masks-full",
        title: "training with masks in which everything is marked",
        runs: Runs::OnBoth,
        judge: |device| train_all(device, |scene| fill_masks(scene, 255)),
    },
    SpecialCase {
        id: "one-frame",
        title: "training on one frame",
        runs: Runs::OnBoth,
        judge: |device| train_all(device, |scene| scene.input_views.truncate(1)),
    },
    SpecialCase {
        id: "two-frames",
        title: "training on two frames",
        runs: Runs::OnBoth,
        judge: |device| train_all(device, |scene| scene.input_views.truncate(2)),
    },
    SpecialCase {
        id: "frames-10000",
        title: "training on a clip of 10,000 frames, eleven days into the recording",
        runs: Runs::OnBoth,
        judge: |device| train_all(device, lengthen),
    },
    SpecialCase {
        id: "dynamic-set-empty",
        title: "training where no Gaussian is dynamic: lifespans longer than the cycle, no masks marked",
        runs: Runs::OnBoth,
        judge: |device| {
            train_all(device, |scene| {
                lengthen(scene);
                fill_masks(scene, 0);
            })
        },
    },
    SpecialCase {
        id: "two-cameras-in-one-place",
        title: "training on pairs of cameras in one place that look two ways",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |device| {
            learn(
                &OWN,
                device.kind(),
                scene_of(FRAMES).map(in_pairs),
                300,
                0.5,
            )
        },
    },
    SpecialCase {
        id: "dark-clip",
        title: "training on a clip of a twentieth of full brightness",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |device| {
            learn(
                &OWN,
                device.kind(),
                scene_of(FRAMES).map(darkened),
                300,
                1.0,
            )
        },
    },
    SpecialCase {
        id: "one-colour",
        title: "training on a clip of one colour, half of the time without density control",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |device| {
            let scene = scene_of(FRAMES).map(|scene| of_one_level(scene, GREY));
            learn(
                &ONE_COLOUR,
                device.kind(),
                scene,
                800,
                1.0 / f64::from(GREY),
            )
        },
    },
    SpecialCase {
        id: "white-clip",
        title: "training on a clip that is white all over",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |device| {
            let scene = scene_of(FRAMES).map(|scene| of_one_level(scene, u8::MAX));
            learn(&ALL, device.kind(), scene, 800, 1.0 / 255.0)
        },
    },
    SpecialCase {
        id: "frames-500",
        title: "training on 500 frames with 400 Gaussians",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |device| learn(&ALL, device.kind(), scene_of(500), 300, 0.3),
    },
    SpecialCase {
        id: "long-training",
        title: "training for thousands of steps on a handful of frames",
        runs: Runs::OnCpu(HostOnly::Duration),
        judge: |_| train_long(),
    },
];

fn fill_masks(scene: &mut TrainingScene, value: u8) {
    for view in &mut scene.input_views {
        view.mask = Some(vec![value; view.pixels.len() / 3]);
    }
}

/// Moves half of the frames ten thousand frames after the others.
fn lengthen(scene: &mut TrainingScene) {
    for view in &mut scene.input_views {
        let gap = if view.frame < FRAMES / 2 { 0.0 } else { 1e4 };
        view.view.time_seconds = 1e6 + (f64::from(view.frame) + gap) / 30.0;
    }
}

/// Puts each second camera where the one before it is, and turns it around.
fn in_pairs(mut scene: TrainingScene) -> TrainingScene {
    let width = scene.camera.width() as usize;
    let height = scene.camera.height() as usize;
    let views = scene.input_views.as_chunks_mut::<2>().0;
    for [first, second] in views {
        second.view = View {
            time_seconds: second.view.time_seconds,
            ..first.view
        };
        // Half a rotation about the vertical: the halves of the image change places.
        let turn = Mat3::from_diagonal(Vec3::new(-1.0, 1.0, -1.0));
        second.view.rotation = turn * first.view.rotation;
        for row in 0..height {
            let pixels = 3 * row * width..3 * (row + 1) * width;
            second.pixels[pixels.clone()].copy_from_slice(&first.pixels[pixels.clone()]);
            second.pixels[pixels].rotate_left(3 * width / 2);
        }
        second.mask = None;
    }
    scene
}

fn darkened(mut scene: TrainingScene) -> TrainingScene {
    let pixels = scene.input_views.iter_mut();
    let pixels = pixels.flat_map(|view| view.pixels.iter_mut());
    pixels.for_each(|value| *value /= 20);
    scene
}

/// Level of a clip of one colour; its points have the level 128.
const GREY: u8 = 60;
/// A method by its id, without some of its components.
type Variant = (&'static str, &'static [&'static str]);
/// Methods that learn a clip: this project's own, and those that train as many Gaussians as fast.
const OWN: [Variant; 1] = [(omni4dgs_plus::METHOD.id, &[])];
/// `omni4dgs` ends 14 % off a clip of one colour by the paper's loss on dynamic Gaussians alone (`dynamic-mask`), 7 % off
/// without density control in time, and within the limit without that loss.
const ONE_COLOUR: [Variant; 4] = [
    (odgs::METHOD.id, &[]),
    (periodic::METHOD.id, &[]),
    (omni4dgs::METHOD.id, &[omni4dgs::DYNAMIC_MASK]),
    (omni4dgs_plus::METHOD.id, &[]),
];
const ALL: [Variant; 4] = [
    (odgs::METHOD.id, &[]),
    (periodic::METHOD.id, &[]),
    (omni4dgs::METHOD.id, &[]),
    (omni4dgs_plus::METHOD.id, &[]),
];

fn of_one_level(mut scene: TrainingScene, level: u8) -> TrainingScene {
    for view in &mut scene.input_views {
        view.pixels.fill(level);
    }
    scene
}

/// Trains a clip by each variant, with its other components; the error is the largest of theirs ([`error_of`]).
fn learn(
    variants: &[Variant],
    kind: DeviceKind,
    scene: Option<TrainingScene>,
    iterations: u64,
    limit: f64,
) -> CaseResult {
    let Some(scene) = scene else {
        return CaseResult::failed("the scene has a camera without a place");
    };
    let _once = PilotOnce::begin();
    let (mut worst, mut worst_id) = (0.0_f64, "");
    for method in METHODS {
        let Some((_, without)) = variants.iter().find(|(id, _)| *id == method.id) else {
            continue;
        };
        match error_of(method, without, kind, &scene, iterations) {
            Ok(error) if error <= worst || worst.is_nan() => {}
            Ok(error) => (worst, worst_id) = (error, method.id),
            Err(reason) => return CaseResult::failed(format!("{}: {reason}", method.id)),
        }
    }
    let name = |(id, without): &Variant| match without {
        [] => (*id).to_owned(),
        without => format!("{id} without {}", without.join(" and ")),
    };
    let names: Vec<String> = variants.iter().map(name).collect();
    let action = format!(
        "{}: the images of all views, relative to their mean level; the largest is of {worst_id}",
        names.join(", ")
    );
    CaseResult::of_errors(&action, Some([worst, limit]), None)
}

/// Returns the mean difference of the images of all views after training, over their mean level.
fn error_of(
    method: &Method,
    without: &[&str],
    kind: DeviceKind,
    scene: &TrainingScene,
    iterations: u64,
) -> Result<f64, String> {
    let request = MethodRequest {
        plan: PlanChoice::Full,
        options: Options::at_most(400),
        without: without.iter().map(|&name| name.to_owned()).collect(),
        ..MethodRequest::new(iterations, 7)
    };
    let session = session(kind);
    let trained = method.train(scene, &request, &session);
    let mut outcome = trained.map_err(|error| error.to_string())?;
    let (mut off, mut level) = (0.0, 0.0);
    for view in &scene.input_views {
        let image = outcome.learner.image(&view.view);
        let image = image.map_err(|error| error.to_string())?;
        for (&found, &byte) in image.data.iter().zip(&view.pixels) {
            let expected = f64::from(byte) / 255.0;
            off += (f64::from(found) - expected).abs();
            level += expected;
        }
    }
    fault_in(outcome).map_or(Ok(off / level), Err)
}

/// Maximum loss at the end of a run, over that at its start.
const LEARNT: f64 = 0.5;

/// Trains with all components for thousands of steps: errors that grow slowly show only then.
fn train_long() -> CaseResult {
    let Some(scene) = scene() else {
        return CaseResult::failed("the scene has a camera without a place");
    };
    let request = MethodRequest {
        plan: PlanChoice::Full,
        options: Options::at_most(400),
        trace_every: Some(100),
        ..MethodRequest::new(LONG_ITERATIONS, 7)
    };
    let session = Session::without_files(&Silent);
    let trained = omni4dgs_plus::METHOD.train(&scene, &request, &session);
    let outcome = match trained {
        Ok(outcome) => outcome,
        Err(error) => return CaseResult::failed(error),
    };
    let trace = outcome.training.state.trace.iter();
    let losses: Vec<f64> = trace.filter_map(|row| row.train_loss).collect();
    let learnt = losses
        .last()
        .zip(losses.first())
        .map_or(f64::NAN, |(last, first)| last / first);
    let action = format!(
        "{} trained for {LONG_ITERATIONS} steps: nothing refused, all finite; the last loss over the first",
        omni4dgs_plus::METHOD.id
    );
    fault_in(outcome).map_or_else(
        || CaseResult::of_errors(&action, Some([learnt, LEARNT]), None),
        CaseResult::failed,
    )
}

/// Trains every method, with all components, and on the CPU with those of its plan too.
fn train_all(device: &Device, change: impl Fn(&mut TrainingScene)) -> CaseResult {
    let kind = device.kind();
    let Some(mut scene) = scene() else {
        return CaseResult::failed("the scene has a camera without a place");
    };
    change(&mut scene);
    let _once = PilotOnce::begin();
    // Kernels are compiled for each training: on a GPU the whole plan has to do.
    let (plans, of_plans) = match kind {
        DeviceKind::Cpu => (vec![PlanChoice::Full, PlanChoice::Auto], ""),
        DeviceKind::Gpu => (vec![PlanChoice::Full], " with the whole plan"),
    };
    let (methods, left_out) = methods_of_time(device);
    let faults: Vec<String> = methods
        .iter()
        .flat_map(|method| plans.iter().map(move |plan| (method, plan)))
        .filter_map(|(method, plan)| {
            let fault = fault_of(kind, &scene, method, plan.clone())?;
            Some(format!("{}: {fault}", method.id))
        })
        .collect();
    let ids = |methods: &[&Method]| {
        let ids: Vec<&str> = methods.iter().map(|method| method.id).collect();
        ids.join(", ")
    };
    let without = match &left_out[..] {
        [] => String::new(),
        left_out => format!(
            "; without {}, for which a software device takes minutes: their kernels have rows of their own",
            ids(left_out)
        ),
    };
    CaseResult {
        action: format!(
            "{} trained for {ITERATIONS} steps each{of_plans}: losses and parameters finite, no gradient \
             refused, lifespans within bounds{without}",
            ids(&methods)
        ),
        fault: (!faults.is_empty()).then(|| faults.join("; ")),
        measured: None,
    }
}

fn session(kind: DeviceKind) -> Session<'static> {
    Session {
        backend: kind.backend(),
        ..Session::without_files(&Silent)
    }
}

/// Returns the methods whose Gaussians change with time and that a device trains, and those that a software device
/// leaves out. It compiles kernels for each training and takes seconds for a step, so it trains this project's own
/// method alone, which has all losses.
fn methods_of_time(device: &Device) -> (Vec<&'static Method>, Vec<&'static Method>) {
    let backend = device.kind().backend();
    let is_software = device
        .gpu()
        .is_some_and(|gpu| gpu.adapter().kind.is_software());
    let knows_time = |method: &&Method| method.motion() == MotionEvidenceUse::Decides;
    let runs_there = |method: &&Method| method.backends.contains(&backend);
    let methods = METHODS.iter().filter(knows_time).filter(runs_there);
    methods.partition(|method| !is_software || OWN.iter().any(|(id, _)| *id == method.id))
}

fn fault_of(
    kind: DeviceKind,
    scene: &TrainingScene,
    method: &Method,
    plan: PlanChoice,
) -> Option<String> {
    let request = MethodRequest {
        plan,
        options: Options::at_most(400),
        ..MethodRequest::new(ITERATIONS, 7)
    };
    method
        .train(scene, &request, &session(kind))
        .map_or_else(|error| Some(error.to_string()), fault_in)
}

fn fault_in(mut outcome: MethodOutcome<'_>) -> Option<String> {
    let state = &outcome.training.state;
    let refused: u64 = state.refused.iter().sum();
    if refused > 0 {
        return Some(format!("{refused} gradient values were refused"));
    }
    let mut losses = state.trace.iter().filter_map(|row| row.train_loss);
    if losses.any(|loss| !loss.is_finite()) {
        return Some("a loss is not finite".to_owned());
    }
    let model = match outcome.learner.gaussians() {
        Ok(model) => model?,
        Err(error) => return Some(error.to_string()),
    };
    if let Some(fault) = model.not_finite() {
        return Some(fault);
    }
    let with_times = |part: &&Part| part.parameterization.temporal().is_some();
    let Part {
        parameterization,
        table,
        ..
    } = model.parts.iter().find(with_times)?;
    let bounds = parameterization.temporal()?.time.lifespans?;
    let lifespans = &table.arrays[table.position("log_lifespans")?].values;
    let range = bounds.least_frames.ln()..=bounds.largest_frames.ln();
    lifespans
        .iter()
        .any(|value| !range.contains(value))
        .then(|| "lifespans left their bounds".to_owned())
}

fn scene() -> Option<TrainingScene> {
    scene_of(FRAMES)
}

/// Returns the direction in which a frame shows the disc, world.
pub(super) fn towards_disc(frame: u32, frames: u32) -> DVec3 {
    let along = f64::from(frame) / f64::from(frames - 1) - 0.5;
    DVec3::new(2.0 * along, 0.2, 3.0).normalize()
}

/// Returns a scene of so many frames: a camera moves through a ball of coloured stripes while a red disc passes in
/// front of it. `None` cannot occur: every camera has a position.
pub(super) fn scene_of(frames: u32) -> Option<TrainingScene> {
    let camera = ErpCamera {
        width: 48,
        height: 24,
    };
    let normalization = Similarity {
        offset: [0.0; 3],
        scale: 1.0,
    };
    let mut input_views = Vec::new();
    for frame in 0..frames {
        let along = f64::from(frame) / f64::from(frames - 1) - 0.5;
        let turn = DQuat::from_rotation_y(0.3 * along);
        let pose = Pose::new(turn, DVec3::new(0.2 * along, 0.0, along));
        let view = View::new(camera, &pose, &normalization, f64::from(frame) / 10.0)?;
        let ball = towards_disc(frame, frames);
        let (mut pixels, mut mask) = (Vec::new(), Vec::new());
        for (column, row) in (0..camera.width * camera.height).map(|i| (i % 48, i / 48)) {
            let pixel = glam::dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let ray = turn * camera.unproject(pixel);
            let is_ball = ray.dot(ball) > 0.97;
            mask.push(if is_ball { 255 } else { 0 });
            pixels.extend(if is_ball {
                [230, 20, 20]
            } else {
                (ray * 6.0)
                    .to_array()
                    .map(|phase| (128.0 + 100.0 * phase.sin()) as u8)
            });
        }
        input_views.push(TrainingView {
            frame,
            view,
            pixels,
            mask: Some(mask),
            ignored: None,
        });
    }
    let mut points = PointCloud::default();
    for index in 0..150 {
        let y = 1.0 - (f64::from(index) + 0.5) / 75.0;
        let (sin, cos) = (2.399_963 * f64::from(index)).sin_cos();
        let rho = (1.0 - y * y).sqrt();
        let position = DVec3::new(rho * cos, y, rho * sin) * 5.0;
        points.positions.push(position.as_vec3().to_array());
        points.colours.push([128; 3]);
    }
    Some(TrainingScene {
        points,
        ..TrainingScene::new("stripes", camera.into(), input_views, normalization)
    })
}
