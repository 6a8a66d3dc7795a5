//! A method and a parameterization from outside: what a new one takes, and that neither needs a line of
//! the engine. All Gaussians of the toy drift with one velocity, which it learns.

use glam::Vec3;
use omnilife_engine::{
    clock::Clock,
    gaussians::{
        ActivatedGaussians,
        parameterization::{Parameterization, Viewpoint},
        static_gaussians::{self, StaticGaussians},
        temporal::TemporalFeatures,
    },
    model::{Model, Part},
    parameters::{ParameterTable, SharedParameters, decay::Decay},
    step::BackendChoice,
};
use omnilife_reconstruct::{
    ReconstructError, baseline,
    components::MotionEvidenceUse,
    methods::{Findings, Method, MethodKind, ON_CPU, ON_CPU_AND_GPU, PreparedGaussians},
    models::gaussians::GAUSSIANS,
    request::{DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
    train::Session,
};
use omnilife_schemas::progress::Silent;

use crate::support::balls;

const DRIFT: &str = "drift";

/// Static Gaussians, all moved by `velocity * frame`.
#[derive(Debug, Clone)]
struct Drifting {
    clock: Clock,
    /// Units per frame.
    velocity: SharedParameters,
}

impl Drifting {
    fn frame(&self, at: &Viewpoint) -> f32 {
        self.clock.frame(at.seconds) as f32 - at.shift_frames
    }
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
        let moved = Vec3::from_slice(&self.velocity.array.values) * self.frame(at);
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
        let by_velocity = sum * self.frame(at);
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

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(self.clone())
    }
}

const TOY: Method = Method {
    id: "toy",
    title: "Toy",
    source: "nowhere",
    description: "Static Gaussians that drift with one velocity, as the simplest thing that moves.",
    components: &[],
    optional_components: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU,
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
    let rate = Decay::constant(2e-3);
    settings.learning_rates.insert(DRIFT.to_owned(), rate);
    let drifting = Drifting {
        clock: scene.clock()?,
        velocity: SharedParameters::new(DRIFT, vec![0.0; 3]),
    };
    let table = static_gaussians::table(&points::from_points(&scene.points, 10.0), 0);
    Ok(PreparedGaussians {
        model: Model::new(vec![Part::new(drifting, table)]),
        settings,
        findings: Findings::default(),
    })
}

/// The balls as they are seen by cameras that are off by a drift: the world seems to move.
fn drifting_scene(velocity: Vec3) -> TrainingScene {
    let mut scene = balls::scene();
    let clock = scene.clock().unwrap();
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        view.view.centre += velocity * clock.frame(view.view.time_seconds) as f32;
    }
    scene
}

#[test]
fn a_method_from_outside_learns_what_its_parameterization_says() {
    let velocity = Vec3::new(0.02, -0.01, 0.015);
    let scene = drifting_scene(velocity);
    let request = MethodRequest::new(200, 3);
    let session = Session::without_files(&Silent);
    let mut outcome = TOY.train(&scene, &request, &session).unwrap();
    let model = outcome.learner.gaussians().unwrap().unwrap();
    let learnt = model.parts[0].parameterization.shared().unwrap();
    let learnt = Vec3::from_slice(&learnt.array.values);
    assert!(
        learnt.distance(velocity) < 0.25 * velocity.length(),
        "{learnt} against {velocity}"
    );
    assert!(
        outcome.training.state.trace[0]
            .refused
            .iter()
            .any(|(name, _)| name == DRIFT)
    );
}

#[test]
fn a_backend_without_its_kernels_refuses_it_by_name() {
    let scene = drifting_scene(Vec3::ZERO);
    let session = Session {
        backend: BackendChoice::Gpu,
        ..Session::without_files(&Silent)
    };
    let refusal = |backends| {
        let toy = Method { backends, ..TOY };
        let refused = toy.train(&scene, &MethodRequest::new(2, 3), &session);
        refused.map(drop).unwrap_err().to_string()
    };
    let message = refusal(ON_CPU);
    assert!(message.contains("toy has no GPU kernels"), "{message}");
    // A method that says more than its parameterization can keep. A machine without any adapter says that
    // instead.
    let message = refusal(ON_CPU_AND_GPU);
    assert!(
        message.contains("drifting Gaussians have no GPU kernels") || message.contains("adapter"),
        "{message}"
    );
}
