//! PVG: every Gaussian appears around a peak time and swings about its centre.
//!
//! Source: Chen et al., "Periodic Vibration Gaussian: Dynamic Urban Scene Reconstruction and
//! Real-time Rendering", 2023, and its repository (fudan-zvg/PVG).

use crate::{
    baseline::{OPACITY_RESET, SKY_SHELL},
    components::Components,
    methods::{
        Method, MethodKind, PreparedGaussians,
        dynamic::{
            self, Beginning, CYCLE_FRAMES, Evidence, LIFESPAN_LOSS, TEMPORAL_DENSITY,
            TEMPORAL_MOTION, TEMPORAL_OPACITY, TEMPORAL_SMOOTHING,
        },
    },
    options,
    request::MethodRequest,
};
use crate::{error::ReconstructError, request::BackendChoice, scene::TrainingScene};
use omnilife_engine::{
    gaussians::temporal::{TemporalFeatures, TimeModel, VelocityModel},
    model::dynamic_settings::{DynamicSettings, VelocityLoss},
};

/// PVG.
pub const METHOD: Method = Method {
    id: "periodic",
    title: "PVG",
    source: "Y. Chen et al., Periodic Vibration Gaussian: Dynamic Urban Scene Reconstruction and \
             Real-time Rendering, arXiv:2311.18561",
    description: "Every Gaussian has a peak time, a lifespan and a velocity and swings about its \
                  centre; temporal smoothing, velocity and lifespan losses, density control in \
                  time. Rendered and scheduled as odgs. Departures: a shell of static Gaussians \
                  stands for the sky instead of a cube map; the same image size throughout; no \
                  lidar, no opacity entropy; density control goes by the magnitude of the \
                  gradients by peak times.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        TEMPORAL_SMOOTHING,
        VELOCITY_LOSS,
        LIFESPAN_LOSS,
        TEMPORAL_DENSITY,
        SKY_SHELL,
        OPACITY_RESET,
    ],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Component: velocities cost.
const VELOCITY_LOSS: &str = "velocity-loss";
/// A Gaussian is not drawn at this share of its opacity or less (PVG `gaussian_renderer`).
const LEAST_MARGINAL: f32 = 0.05;
/// Weight of the velocity loss (PVG `configs/waymo_reconstruction.yaml`).
const VELOCITY_WEIGHT: f32 = 0.01;
fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = dynamic::check(METHOD.id, scene, backend)?;
    let mut settings = crate::baseline::settings(scene, request);
    let extent = crate::baseline::scene_extent(scene);
    dynamic::add_learning_rates(&mut settings, extent);
    let first = crate::baseline::first_gaussians(scene, &settings, request, 0);
    let mut components = Components::new(request, first.plan);
    let evidence = Evidence::of(scene, request)?;
    let published = || (true, "as published".to_owned());
    let fades = components.decide(TEMPORAL_OPACITY, evidence.of_motion());
    let moves = components.decide(TEMPORAL_MOTION, evidence.of_motion());
    let without_motion = (!moves).then_some(TEMPORAL_MOTION);
    let without_lifespans = (!fades).then_some(TEMPORAL_OPACITY);
    let smooths = components.decide_with(TEMPORAL_SMOOTHING, without_motion, published());
    let missing = without_motion.or(without_lifespans);
    let slows = components.decide_with(VELOCITY_LOSS, missing, published());
    let prolongs = components.decide_with(LIFESPAN_LOSS, without_lifespans, published());
    let missing = (!fades && !moves).then_some("time");
    let splits = components.decide_with(TEMPORAL_DENSITY, missing, published());

    let mut beginning = Beginning {
        fixed: first.shell,
        ..Beginning::default()
    };
    let lifespan = dynamic::first_lifespan(&clock, dynamic::FIRST_LIFESPAN_SHARE);
    let times = dynamic::scattered_times(&clock, first.points.len(), lifespan, request.seed);
    beginning.add_moving(first.points, times);
    settings.dynamics = Some(DynamicSettings {
        clock,
        time: TimeModel {
            cycle_frames: CYCLE_FRAMES,
            lifespans: fades.then(|| dynamic::lifespans(None)),
            velocity: if moves {
                VelocityModel::Free
            } else {
                VelocityModel::None
            },
            least_marginal: LEAST_MARGINAL,
        },
        down: dynamic::down(scene),
        // PVG's base configuration; only what is shown as dynamic depends on it.
        dynamic_below_staticness: 0.5,
        dynamic_loss: None,
        velocity_loss: slows.then_some(VelocityLoss {
            weight: VELOCITY_WEIGHT,
            outside_masks: false,
        }),
        lifespan_weight: if prolongs {
            dynamic::LIFESPAN_WEIGHT
        } else {
            0.0
        },
        features: TemporalFeatures {
            velocity_unit: slows.then(|| dynamic::velocity_unit(extent)),
            lifespan: prolongs.then_some(dynamic::LIFESPAN_FEATURE),
        },
        motion_weight: 0.0,
        smoothing: smooths.then_some(dynamic::SMOOTHING),
        density: splits.then(|| dynamic::temporal_density(&settings)),
    });
    dynamic::prepared(scene, request, settings, &beginning, components)
}
