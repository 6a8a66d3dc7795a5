//! PVG: every Gaussian appears around a peak time and vibrates about its centre.
//!
//! Source: Chen et al., "Periodic Vibration Gaussian: Dynamic Urban Scene Reconstruction and
//! Real-time Rendering", 2023, and its repository (fudan-zvg/PVG).

use crate::dynamic::{
    self, CYCLE_FRAMES, FRAMES_PER_UNIT, FirstGaussians, TEMPORAL_DENSITY, TEMPORAL_MOTION,
    TEMPORAL_OPACITY, TEMPORAL_SMOOTHING,
};
use omnilife_engine::{
    clock::Clock,
    density::settings::Threshold,
    gaussians::temporal::{LifespanFeature, TemporalFeatures, TimeModel, VelocityModel},
    model::dynamic_settings::{DynamicSettings, VelocityLoss},
    parameters::{
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
};
use omnilife_training::{
    baseline::{OPACITY_RESET, scene_extent},
    components::{
        Decision, Draft, camera_response, denser_points, draft::MotionEvidenceUse, dropout,
        exposure_compensation, mask_seeds, pose_refinement, short_schedule, sky_shell,
        static_table, swept_points, view_dependent_colour,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models,
    options::{self, Constant, MethodOption},
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
};

/// PVG.
pub const METHOD: Method = Method {
    id: "periodic",
    title: "PVG",
    source: "Y. Chen et al., Periodic Vibration Gaussian: Dynamic Urban Scene Reconstruction and \
             Real-time Rendering, arXiv:2311.18561",
    description: "Every Gaussian has a peak time, a lifespan and a velocity and vibrates about its \
                  centre; temporal smoothing, velocity loss, density control in time; the settings \
                  of configs/waymo_nvs.yaml, that for novel views. Rendered and scheduled as odgs. \
                  Departures: a shell of static Gaussians stands for the sky instead of a cube map, \
                  so there is no loss on its opacity, and there are no 400,000 random far points; \
                  the same image size throughout; SH degree 0; first opacities 0.1 instead of \
                  0.01, as all methods here have; no lidar, no opacity entropy, no smoothness of \
                  inverse depth; the opacity under rendered velocities counts as a constant; density \
                  control goes by the magnitude of the gradients by peak times, keeps peaks within \
                  the clip and a tenth of it, prunes what no view saw, and below the limit on their \
                  number Gaussians with time come before those of the sky. Aids as omni4dgs has them; \
                  --without aids is the published method. On request lifespan-loss, which \
                  configs/kitti_nvs.yaml has.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        TEMPORAL_SMOOTHING,
        VELOCITY_LOSS,
        TEMPORAL_DENSITY,
        swept_points::ID,
        denser_points::ID,
        short_schedule::ID,
        mask_seeds::ID,
        static_table::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: &[
        exposure_compensation::ID,
        camera_response::ID,
        view_dependent_colour::ID,
        pose_refinement::ID,
        dropout::ID,
        LIFESPAN_LOSS,
    ],
    ablation: &[],
    default_plan: DefaultPlan::Full,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: &[
        options::MAX_GAUSSIANS,
        options::SH_DEGREE,
        options::FOOTPRINT,
        options::DENSIFY_THRESHOLD,
        CYCLE,
        VELOCITY_WEIGHT_OPTION,
        LIFESPAN_WEIGHT_OPTION,
    ],
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::Decides,
        model: &models::gaussians::GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Component: velocities cost.
const VELOCITY_LOSS: &str = "velocity-loss";
/// Component: short lifespans cost.
const LIFESPAN_LOSS: &str = "lifespan-loss";
/// Lifespan in that loss, in PVG's unit; all lifespans of 2 units and above count alike (PVG `train.py`).
const LIFESPAN_FEATURE: LifespanFeature = LifespanFeature {
    unit_frames: FRAMES_PER_UNIT,
    largest_frames: 2.0 * FRAMES_PER_UNIT,
};
/// Weight of that loss (PVG `configs/kitti_nvs.yaml`, `lambda_t_reg`; the other configurations do without it).
const LIFESPAN_WEIGHT: f32 = 0.01;
/// Step size of opacities (PVG `configs/waymo_nvs.yaml`): a tenth of that of 3DGS.
const OPACITY_RATE: f32 = 5e-3;
/// Image gradient from which Gaussians are cloned or split (PVG `configs/waymo_nvs.yaml`).
const GRADIENT_THRESHOLD: f32 = 1.7e-4;
/// Staticness below which a Gaussian is shown as dynamic: `separate_scaling_t` over `cycle` (PVG
/// `configs/waymo_nvs.yaml`); it does not affect training.
const DYNAMIC_BELOW_STATICNESS: f32 = 1.0;
/// A Gaussian is not drawn at this share of its opacity or less (PVG `gaussian_renderer`).
const LEAST_MARGINAL: f32 = 0.05;
/// Weight of the velocity loss (PVG `configs/waymo_nvs.yaml`, `lambda_v_reg`).
const VELOCITY_WEIGHT: f32 = 0.01;
/// Cycle of the motion.
const CYCLE: MethodOption = MethodOption::number(
    ("cycle", "length of the cycle in which Gaussians vibrate"),
    [1.0, 1e6],
    "10",
    Constant {
        unit: "frames",
        source: "PVG, Eq. 3; configs/waymo_nvs.yaml",
        component: Some(TEMPORAL_MOTION),
        is_weight: false,
    },
);
/// [`VELOCITY_WEIGHT`] as an option.
const VELOCITY_WEIGHT_OPTION: MethodOption = MethodOption::number(
    ("velocity-weight", "weight of the loss on velocities"),
    [0.0, 100.0],
    "0.01",
    Constant {
        unit: "of the photometric loss",
        source: "PVG configs/waymo_nvs.yaml, lambda_v_reg",
        component: Some(VELOCITY_LOSS),
        is_weight: true,
    },
);
/// [`LIFESPAN_WEIGHT`] as an option.
const LIFESPAN_WEIGHT_OPTION: MethodOption = MethodOption::number(
    ("lifespan-weight", "weight of the loss on short lifespans"),
    [0.0, 100.0],
    "0.01",
    Constant {
        unit: "of the photometric loss",
        source: "PVG configs/kitti_nvs.yaml, lambda_t_reg",
        component: Some(LIFESPAN_LOSS),
        is_weight: true,
    },
);

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = scene.clock()?;
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, METHOD.motion())?;
    let extent = scene_extent(scene);
    dynamic::add_learning_rates(&mut draft.settings, extent);
    let opacities = LearningRate::new(Decay::constant(OPACITY_RATE), Growth::SETTLING);
    let rates = &mut draft.settings.learning_rates;
    rates.insert("opacity_logits".to_owned(), opacities);
    if request.options.densify_threshold().is_none() {
        draft.settings.densify.gradient_threshold = Threshold::constant(GRADIENT_THRESHOLD);
    }
    decide(&mut draft);
    dynamic::allow_seeds(&mut draft, dynamic::resting_seeds(clock));
    draft.add_components();
    let lifespan = dynamic::first_lifespan(&clock, dynamic::FIRST_LIFESPAN_SHARE);
    let beginning = FirstGaussians::of(&mut draft, &clock, lifespan);
    draft.settings.dynamics = Some(dynamics(&draft, clock));
    dynamic::prepared(draft, &beginning)
}

/// Decides on the method's own components.
fn decide(draft: &mut Draft<'_>) {
    dynamic::decide_on_time(draft);
    let missing_motion = draft.missing(TEMPORAL_MOTION);
    let missing_lifespans = draft.missing(TEMPORAL_OPACITY);
    for (component, missing) in [
        (TEMPORAL_SMOOTHING, missing_motion),
        (VELOCITY_LOSS, missing_motion.or(missing_lifespans)),
        (TEMPORAL_DENSITY, dynamic::missing_time(draft)),
    ] {
        let published = Decision::new(true, "as published");
        draft.decide(component, published.unless(missing));
    }
    let of_kitti = Decision::new(false, "of configs/kitti_nvs.yaml alone").whatever_the_plan();
    draft.decide(LIFESPAN_LOSS, of_kitti.unless(missing_lifespans));
}

fn dynamics(draft: &Draft<'_>, clock: Clock) -> DynamicSettings {
    let options = &draft.request.options;
    let slows = draft.is_used(VELOCITY_LOSS);
    let prolongs = draft.is_used(LIFESPAN_LOSS);
    let extent = scene_extent(draft.scene);
    DynamicSettings {
        clock,
        time: TimeModel {
            cycle_frames: options.number(&CYCLE).unwrap_or(CYCLE_FRAMES),
            lifespans: draft
                .is_used(TEMPORAL_OPACITY)
                .then_some(dynamic::LIFESPANS),
            velocity: if draft.is_used(TEMPORAL_MOTION) {
                VelocityModel::Free
            } else {
                VelocityModel::None
            },
            least_marginal: LEAST_MARGINAL,
        },
        down: dynamic::down(draft.scene),
        dynamic_below_staticness: DYNAMIC_BELOW_STATICNESS,
        dynamic_loss: None,
        velocity_loss: slows.then(|| VelocityLoss {
            weight: options
                .number(&VELOCITY_WEIGHT_OPTION)
                .unwrap_or(VELOCITY_WEIGHT),
            outside_masks: false,
        }),
        lifespan_weight: if prolongs {
            let asked = options.number(&LIFESPAN_WEIGHT_OPTION);
            asked.unwrap_or(LIFESPAN_WEIGHT)
        } else {
            0.0
        },
        features: TemporalFeatures {
            velocity_unit: slows.then(|| dynamic::velocity_unit(extent)),
            lifespan: prolongs.then_some(LIFESPAN_FEATURE),
        },
        motion_loss: None,
        smoothing: draft
            .is_used(TEMPORAL_SMOOTHING)
            .then_some(dynamic::SMOOTHING),
        density: draft
            .is_used(TEMPORAL_DENSITY)
            .then(|| dynamic::temporal_density(&draft.settings)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_in_the_list_are_those_of_a_run() {
        for (option, usual) in [
            (CYCLE, CYCLE_FRAMES),
            (VELOCITY_WEIGHT_OPTION, VELOCITY_WEIGHT),
            (LIFESPAN_WEIGHT_OPTION, LIFESPAN_WEIGHT),
        ] {
            assert_eq!(option.default.parse(), Ok(usual), "{}", option.id);
        }
    }
}
