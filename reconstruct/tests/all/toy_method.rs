//! A method and a parameterization outside of the engine, with kernels on a GPU: the parts of a new one. All
//! Gaussians of the toy drift with one trained velocity.

use std::sync::Arc;

use device::{assert_gradients_agree, assert_images_agree, device};
use glam::Vec3;
use omnilife_engine::{
    clock::Clock,
    device::{COMMON_WGSL, Gpu, GpuError, Kernel, Program, Shader, Uniform},
    gaussians::{
        ActivatedGaussians,
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceTwin, GAUSSIANS_WGSL,
            NewDevicePart, PartBuffers,
        },
        parameterization::{Parameterization, Viewpoint},
        static_gaussians::{self, StaticGaussians},
        temporal::TemporalFeatures,
    },
    model::{Model, Part},
    parameters::{ParameterTable, SharedParameters, decay::Decay, short_schedule::LearningRate},
    schedule::StepSchedule,
    step::{BackendChoice, Stepper, cpu::CpuStepper, gpu::GpuStepper},
};
use omnilife_reconstruct::{
    ReconstructError, baseline,
    components::MotionEvidenceUse,
    methods::{
        Findings, Method, MethodKind, MethodOutcome, ON_CPU, ON_CPU_AND_GPU, PreparedGaussians,
    },
    models::gaussians::GAUSSIANS,
    options::Options,
    request::{DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
    train::Session,
};
use omnilife_schemas::progress::Silent;

use crate::support::{balls, device};

const DRIFT: &str = "drift";

/// Static Gaussians, all moved by `velocity * frame`.
#[derive(Debug, Clone)]
struct Drifting {
    clock: Clock,
    /// Units per frame.
    velocity: SharedParameters,
    runs_on_gpu: bool,
}

impl Drifting {
    fn new(clock: Clock, velocity: Vec3) -> Self {
        Self {
            clock,
            velocity: SharedParameters::new(DRIFT, velocity.to_array().into()),
            runs_on_gpu: true,
        }
    }
}

fn frame(clock: &Clock, at: &Viewpoint) -> f32 {
    clock.frame(at.seconds) as f32 - at.shift_frames
}

impl Parameterization for Drifting {
    fn id(&self) -> &'static str {
        "drifting"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        StaticGaussians.activate(table, at, features, first, out);
        let moved = Vec3::from_slice(&self.velocity.array.values) * frame(&self.clock, at);
        for position in &mut out.positions[first..first + table.len()] {
            *position = (Vec3::from_array(*position) + moved).to_array();
        }
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        _: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        let by_positions = &gradient.positions[first..first + table.len()];
        let sum: Vec3 = by_positions.iter().map(|&by| Vec3::from_array(by)).sum();
        let by_velocity = sum * frame(&self.clock, at);
        self.velocity.array.gradients = by_velocity.to_array().into();
        static_gaussians::activate_from_vjp(table, first, activated, gradient);
    }

    fn shared(&self) -> Option<&SharedParameters> {
        Some(&self.velocity)
    }

    fn shared_mut(&mut self) -> Option<&mut SharedParameters> {
        Some(&mut self.velocity)
    }

    fn stepped_shared(&mut self) -> Option<&mut SharedParameters> {
        Some(&mut self.velocity)
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        self.runs_on_gpu.then_some(self as &dyn DeviceTwin)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(self.clone())
    }
}

const DRIFT_WGSL: &str = "
struct Drift {
    // Number of Gaussians, and index of the first among all activated ones.
    len: u32,
    first: u32,
    // Time, frames.
    frame: f32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> drift: Drift;
@group(0) @binding(1) var<storage, read> velocity: array<f32>;
@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;

@group(0) @binding(1) var<storage, read> gaussian_gradients: array<Gaussian>;
@group(0) @binding(2) var<storage, read_write> velocity_gradients: array<f32>;

@compute @workgroup_size(256)
fn add_drift(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= drift.len {
        return;
    }
    gaussians[drift.first + index].position
        += vec3(velocity[0], velocity[1], velocity[2]) * drift.frame;
}

var<workgroup> sums: array<vec3<f32>, WORKGROUP>;

// Gradient by the velocity; a single workgroup adds up over all Gaussians.
@compute @workgroup_size(256)
fn sum_gradients(@builtin(local_invocation_index) thread: u32) {
    var sum = vec3<f32>(0.0, 0.0, 0.0);
    for (var index = thread; index < drift.len; index += WORKGROUP) {
        sum += gaussian_gradients[drift.first + index].position;
    }
    sums[thread] = sum;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            sums[thread] += sums[thread + half];
        }
        workgroupBarrier();
    }
    let total = sums[0] * drift.frame;
    if thread < 3u {
        velocity_gradients[thread] = total[thread];
    }
}
";

/// Kernels of the drift, for any number of Gaussians.
#[derive(Debug)]
struct DriftKernels {
    add_drift: Kernel,
    sum_gradients: Kernel,
}

impl DriftKernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = Shader {
            file: "toy_method.rs",
            constants: String::new(),
            parts: &[COMMON_WGSL, GAUSSIANS_WGSL, DRIFT_WGSL],
        };
        let [add_drift, sum_gradients] =
            Kernel::compile(gpu, &shader, ["add_drift", "sum_gradients"])?;
        Ok(Self {
            add_drift,
            sum_gradients,
        })
    }
}

impl DeviceTwin for Drifting {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        StaticGaussians.compile(gpu, kernels)?;
        kernels.get(gpu, DriftKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        Ok(Box::new(DriftingPart {
            still: StaticGaussians.open(part)?,
            kernels: part.kernels.get(part.gpu, DriftKernels::new)?,
            drift: Uniform::of(part.gpu, "drift", &[0; 4])?,
            clock: self.clock,
            entries: part.entries,
        }))
    }
}

#[derive(Debug)]
struct DriftingPart {
    still: Box<dyn DeviceParameterization>,
    kernels: Arc<DriftKernels>,
    /// `Drift` in WGSL.
    drift: Uniform<[u32; 4]>,
    clock: Clock,
    entries: DeviceEntries,
}

impl DeviceParameterization for DriftingPart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.still.activate(gpu, program, part)?;
        if let Some(velocity) = part.shared {
            let gaussians = &part.activated.gaussians;
            let buffers = [&self.drift.raw, &velocity.values.raw, &gaussians.raw];
            program.run(gpu, &self.kernels.add_drift, &part.rows.rows, &buffers);
        }
        Ok(())
    }

    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        if let Some(velocity) = part.shared {
            let gradients = &part.activated.gaussian_gradients;
            let buffers = [&self.drift.raw, &gradients.raw, &velocity.gradients.raw];
            program.run(gpu, &self.kernels.sum_gradients, 1_usize, &buffers);
        }
        self.still.activate_vjp(gpu, program, part)
    }

    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.still.place(gpu, entries, first_alone);
        self.entries = entries;
    }

    fn set_moment(&self, gpu: &Gpu, at: &Viewpoint) {
        self.still.set_moment(gpu, at);
        let DeviceEntries { first, len } = self.entries;
        let frame = frame(&self.clock, at).to_bits();
        self.drift.write(gpu, &[len as u32, first as u32, frame, 0]);
    }
}

const TOY: Method = Method {
    id: "toy",
    title: "Toy",
    source: "nowhere",
    description: "Static Gaussians that drift with one velocity, as the simplest thing that moves.",
    components: &[],
    optional_components: &[],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: &[],
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::None,
        model: &GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request)?.on(scene, backend),
    },
};

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
) -> Result<PreparedGaussians, ReconstructError> {
    let mut settings = baseline::settings(scene, request);
    let rate = LearningRate::unchanged(Decay::constant(2e-3));
    settings.learning_rates.insert(DRIFT.to_owned(), rate);
    let drifting = Drifting::new(scene.clock()?, Vec3::ZERO);
    let table = static_gaussians::table(&points::from_points(&scene.points, 10.0), 0);
    Ok(PreparedGaussians {
        model: Model::new(vec![Part::new(drifting, table)]),
        settings,
        findings: Findings::default(),
    })
}

/// Returns the balls as seen by cameras whose error is a drift: the world seems to move.
fn drifting_scene(velocity: Vec3) -> TrainingScene {
    let mut scene = balls::scene();
    let clock = scene.clock().unwrap();
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        view.view.centre += velocity * clock.frame(view.view.time_seconds) as f32;
    }
    scene
}

/// Units per frame.
const VELOCITY: Vec3 = Vec3::new(0.02, -0.01, 0.015);

fn learnt_velocity(outcome: &mut MethodOutcome<'_>) -> Vec3 {
    let model = outcome.learner.gaussians().unwrap().unwrap();
    let learnt = model.parts[0].parameterization.shared().unwrap();
    Vec3::from_slice(&learnt.array.values)
}

#[test]
fn a_method_from_outside_learns_what_its_parameterization_says() {
    let scene = drifting_scene(VELOCITY);
    let request = MethodRequest::new(200, 3);
    let session = Session::without_files(&Silent);
    let mut outcome = TOY.train(&scene, &request, &session).unwrap();
    let learnt = learnt_velocity(&mut outcome);
    assert!(
        learnt.distance(VELOCITY) < 0.25 * VELOCITY.length(),
        "{learnt} against {VELOCITY}"
    );
    assert!(
        outcome.training.state.trace[0]
            .refused
            .iter()
            .any(|(name, _)| name == DRIFT)
    );
}

#[test]
fn steps_with_kernels_from_outside_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let scene = drifting_scene(VELOCITY);
    let settings = prepare(&scene, &MethodRequest::new(100, 3))
        .unwrap()
        .settings;
    let model = || {
        let drifting = Drifting::new(scene.clock().unwrap(), Vec3::new(0.01, 0.02, -0.03));
        Model::new(vec![Part::new(drifting, balls::table(&scene, 0))])
    };
    let mut on_gpu = GpuStepper::new(gpu, scene.inputs(), model(), &settings).unwrap();
    let mut on_cpu = CpuStepper::new(scene.inputs(), model(), &settings);
    for iteration in 1..=3 {
        let schedule = StepSchedule {
            iteration,
            scheduled: iteration,
            learning_rates: vec![2e-3, 5e-3, 1e-3, 0.05, 2.5e-3, 2e-3],
            ..StepSchedule::default()
        };
        on_gpu.step(iteration as usize, &schedule).unwrap();
        on_cpu.step(iteration as usize, &schedule).unwrap();
        let of_gpu = on_gpu.model_with_gradients().unwrap();
        let parts = [of_gpu, on_cpu.model().unwrap()].map(|model| &model.parts[0]);
        let shared = parts.map(|part| part.parameterization.shared().unwrap());
        assert_eq!(shared.map(|shared| shared.steps), [iteration; 2]);
        if iteration == 1 {
            let tables = parts.map(|part| &part.table.arrays);
            let pairs = tables[0].iter().zip(tables[1]);
            for (gpu, cpu) in pairs.chain([(&shared[0].array, &shared[1].array)]) {
                assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
                assert_gradients_agree(gpu.name, &gpu.first_moments, &cpu.first_moments);
            }
        }
    }
    assert_eq!(on_gpu.take_statistics().unwrap().refused, [0; 6]);
    let view = &scene.novel_views[0].view;
    let of_gpu = on_gpu.image(view, 0).unwrap();
    assert_images_agree(&of_gpu, &on_cpu.image(view, 0).unwrap());
}

#[test]
fn a_training_with_kernels_from_outside_is_that_of_the_cpu() {
    let Some(gpu) = device() else { return };
    // As in `gpu_methods.rs`.
    let steps = if gpu.adapter().kind.is_software() {
        16
    } else {
        50
    };
    let scene = drifting_scene(VELOCITY);
    let [cpu, gpu] = [BackendChoice::Cpu, BackendChoice::Gpu].map(|backend| {
        let session = Session {
            backend,
            ..Session::without_files(&Silent)
        };
        let request = MethodRequest {
            // The limit is the first number, so that a Gaussian at a threshold makes no others.
            options: Options::at_most(scene.points.positions.len() as u64),
            trace_every: Some(1),
            ..MethodRequest::new(steps, 3)
        };
        let mut outcome = TOY.train(&scene, &request, &session).unwrap();
        let trace = outcome.training.state.trace.iter();
        let loss: f64 = trace.filter_map(|point| point.train_loss).sum();
        (loss, learnt_velocity(&mut outcome))
    });
    // The same tolerance as for other methods.
    assert!((gpu.0 - cpu.0).abs() < 1e-5 * cpu.0, "{gpu:?} {cpu:?}");
    let apart = gpu.1.distance(cpu.1);
    assert!(apart < 0.05 * VELOCITY.length(), "{gpu:?} {cpu:?}");
}

/// The method with a parameterization that has no kernels.
const WITHOUT_KERNELS: Method = Method {
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        model: &GAUSSIANS,
        motion: MotionEvidenceUse::None,
        prepare: |scene, request, backend| {
            let mut prepared = prepare(scene, request)?;
            let table = prepared.model.parts.remove(0).table;
            let drifting = Drifting {
                runs_on_gpu: false,
                ..Drifting::new(scene.clock()?, Vec3::ZERO)
            };
            prepared.model = Model::new(vec![Part::new(drifting, table)]);
            prepared.on(scene, backend)
        },
    },
    ..TOY
};

#[test]
fn a_backend_without_its_kernels_refuses_it_by_name() {
    let scene = drifting_scene(Vec3::ZERO);
    let session = Session {
        backend: BackendChoice::Gpu,
        ..Session::without_files(&Silent)
    };
    let refusal = |method: Method| {
        let refused = method.train(&scene, &MethodRequest::new(2, 3), &session);
        refused.map(drop).unwrap_err().to_string()
    };
    let message = refusal(Method {
        backends: ON_CPU,
        ..TOY
    });
    assert!(message.contains("toy has no GPU kernels"), "{message}");
    // A method with more than its parameterization can keep. A machine without any adapter reports that instead.
    let message = refusal(WITHOUT_KERNELS);
    assert!(
        message.contains("drifting Gaussians have no GPU kernels") || message.contains("adapter"),
        "{message}"
    );
}
