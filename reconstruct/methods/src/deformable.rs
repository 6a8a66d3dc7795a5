//! Deformable-GS: canonical Gaussians, and a network that moves them to their positions at a time.
//!
//! Source: Z. Yang et al., "Deformable 3D Gaussians for High-Fidelity Monocular Dynamic Scene
//! Reconstruction", CVPR 2024, and its repository (ingra14m/Deformable-3D-Gaussians).

use std::mem::take;

use omnilife_engine::{
    clock::Clock,
    gaussians::{
        deformable::{
            DEFORMATION_WEIGHTS, Deformable, DeformationModel,
            settings::{DeformationSettings, TimeNoise},
        },
        static_gaussians::{self, StaticGaussians},
    },
    model::{Model, Part},
    parameters::{decay::Decay, short_schedule::LearningRate},
};
use omnilife_training::{
    baseline::{OPACITY_RESET, require_memory, scene_extent},
    components::{
        Decision, Draft, aids, denser_points, draft::MotionEvidenceUse, short_schedule, sky_shell,
        swept_points,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models, options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
};

/// Deformable-GS.
pub const METHOD: Method = Method {
    id: "deformable",
    title: "Deformable-GS",
    source: "Z. Yang et al., Deformable 3D Gaussians for High-Fidelity Monocular Dynamic Scene \
             Reconstruction, CVPR 2024",
    description: "Canonical Gaussians and a network of 8 layers of 256 that moves, turns and scales \
                  them at a time, with warm-up and annealed noise on the time. Rendered, scheduled \
                  and densified as odgs. Departures: the network's schedule of 40,000 iterations \
                  is scaled to the run's; lengths are relative to the median distance of the \
                  points; its output layer begins at 0; quaternions are normalized and scales \
                  positive after the deformation; the noise's unit is one training interval \
                  throughout, not one that grows within an epoch. Aids as odgs has them; the network's \
                  rate is the published one. Its Gaussians have no lifespans, so it cannot have mask seeds.",
    components: &[
        DEFORMATION,
        TIME_NOISE,
        swept_points::ID,
        denser_points::ID,
        short_schedule::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: aids::ON_REQUEST,
    default_plan: DefaultPlan::Full,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::Decides,
        model: &models::gaussians::GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Component: Gaussians are deformed; without it there is no network, and the method is odgs.
const DEFORMATION: &str = "deformation";
/// Component: noise on the time of training views, so that the network does not fit every view's errors at its
/// exact time (annealed smooth training).
const TIME_NOISE: &str = "time-noise";

/// Length of the published schedule, iterations (`arguments/__init__.py` `deform_lr_max_steps`).
const PUBLISHED_ITERATIONS: f64 = 40_000.0;
/// Iterations in which the canonical Gaussians are trained alone (`warm_up`): a network that starts without a
/// scene explains the scene by motion.
const WARM_UP_ITERATIONS: f64 = 3_000.0;
/// The network's step size (`scene/deform_model.py`), in shorter schedules too: with larger ones the weights of all
/// layers, which Adam moves at once, do not settle.
const LEARNING_RATE: LearningRate = LearningRate::unchanged(Decay {
    begin: 8e-4,
    end: 1.6e-6,
});
/// First noise on the time, training intervals, and the iteration at which it has vanished (`train.py`). The
/// scale is `PyTorch`'s standard deviation.
const NOISE_INTERVALS: f32 = 0.1;
const NOISE_ITERATIONS: f64 = 20_000.0;

fn deformation_settings(
    scene: &TrainingScene,
    request: &MethodRequest,
    clock: Clock,
    with_noise: bool,
) -> DeformationSettings {
    let scale = request.iterations as f64 / PUBLISHED_ITERATIONS;
    let scaled = |published: f64| (published * scale).round() as u64;
    let views = scene.input_views.len().max(1) as f32;
    DeformationSettings {
        clock,
        model: DeformationModel::published(scene_extent(scene)),
        warm_up_iterations: scaled(WARM_UP_ITERATIONS),
        time_noise: with_noise.then(|| TimeNoise {
            begin_frames: NOISE_INTERVALS * clock.duration_frames / views,
            end_iteration: scaled(NOISE_ITERATIONS),
        }),
    }
}

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = scene.clock()?;
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, METHOD.motion())?;
    let of_motion = Decision::of_motion(&draft.evidence);
    let deforms = draft.decide(DEFORMATION, of_motion);
    let noise = Decision::new(true, "as published for real scenes");
    let with_noise = draft.decide(TIME_NOISE, noise.unless(draft.missing(DEFORMATION)));
    draft.add_components();
    let initial = points::join(take(&mut draft.points), take(&mut draft.fixed));
    let settings = &mut draft.settings;
    let table = static_gaussians::table(&initial, settings.rendering.sh_degree);
    let shapes = table.shapes();
    let mut network_bytes = 0;
    let part = if deforms {
        let deformation = deformation_settings(scene, request, clock, with_noise);
        let weights = deformation.model.network().initial_weights(request.seed);
        network_bytes = deformation
            .model
            .training_bytes(settings.densify.maximum_gaussians);
        settings.deformation = Some(deformation);
        settings
            .learning_rates
            .insert(DEFORMATION_WEIGHTS.to_owned(), LEARNING_RATE);
        Part::new(Deformable::new(deformation, weights), table)
    } else {
        Part::new(StaticGaussians, table)
    };
    require_memory(request, settings, &shapes, network_bytes)?;
    Ok(PreparedGaussians::new(draft, Model::new(vec![part])))
}
