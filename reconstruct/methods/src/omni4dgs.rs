//! Omni4DGS: dynamic Gaussians on the sphere, separated from static ones by masks.
//!
//! Source: "OmniLife360", section 4, Eqs. 1 to 12. The paper gives neither weights nor first values
//! nor rules of density; every such setting is named here with the reason for its value.

use crate::dynamic::{
    self, Beginning, CYCLE_FRAMES, TEMPORAL_DENSITY, TEMPORAL_MOTION, TEMPORAL_OPACITY,
};
use omnilife_engine::{
    clock::Clock,
    gaussians::{
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        temporal::{TemporalFeatures, TimeModel, VelocityModel},
    },
    model::dynamic_settings::{DynamicLoss, DynamicSettings, VelocityLoss},
};
use omnilife_training::{
    baseline::{OPACITY_RESET, scene_extent},
    components::{
        Decision, Draft, aids, denser_points, draft::MotionEvidenceUse, mask_seeds, short_schedule,
        sky_shell, static_table, swept_points,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models, options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
};

/// Omni4DGS.
pub const METHOD: Method = Method {
    id: "omni4dgs",
    title: "Omni4DGS",
    source: "OmniLife360, section 4 (Omni4DGS)",
    description: "Gaussians that appear, move and vanish, with velocities of a radial and a \
                  tangential part; masks supervise the dynamic ones rendered alone; velocities \
                  are kept out of the static region and static Gaussians in their place. The paper \
                  has no density control: in time it is PVG's, in space 3DGS's, and below the limit \
                  on their number Gaussians with time come first. Under Adam the two velocities step \
                  as one, and the motion loss, a mean over all, is too small to act. The sky's shell has no time. Aids, \
                  not the paper's: denser points, larger steps in short schedules, mask-seeds, with \
                  which dynamic Gaussians begin on masked pixels, and static-table, with which scene \
                  points that do not change carry no temporal parameters; --without aids is the \
                  published method. Readings of what the paper leaves open are named in the \
                  source.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        VELOCITY_DECOMPOSITION,
        DYNAMIC_MASK,
        MOTION_REGULARIZATION,
        VELOCITY_REGULARIZATION,
        TEMPORAL_DENSITY,
        swept_points::ID,
        denser_points::ID,
        short_schedule::ID,
        mask_seeds::ID,
        static_table::ID,
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

/// Component: velocities have a radial and a tangential part (Eq. 3).
pub(super) const VELOCITY_DECOMPOSITION: &str = "velocity-decomposition";
/// Component: masks supervise the dynamic Gaussians (Eqs. 4 to 7).
pub(super) const DYNAMIC_MASK: &str = "dynamic-mask";
/// Component: static Gaussians stay in their direction (Eqs. 10, 11).
pub(super) const MOTION_REGULARIZATION: &str = "motion-regularization";
/// Component: no velocities outside the masks (Eq. 9).
pub(super) const VELOCITY_REGULARIZATION: &str = "velocity-regularization";

/// Velocities (Eq. 3). `gamma`: weights "increase more smoothly in the equatorial region and decay more rapidly
/// in the polar regions", a flat top, so below 1. Literal: with projections and weights nothing on the equator
/// could approach. World: a velocity must not depend on the camera.
const DECOMPOSITION: Decomposition = Decomposition {
    gamma: 0.5,
    form: VelocityForm::Literal,
    origin: DirectionOrigin::World,
};
/// `theta_dgm`, as PVG separates static from dynamic on Waymo (`separate_scaling_t` 0.2 over the cycle's 0.2),
/// with the staticness `rho = beta / l`. The paper's `beta / tau` is singular at `tau = 0` and changes with the
/// origin of time.
const DYNAMIC_BELOW_STATICNESS: f32 = 1.0;
/// Minimum ratio of the first lifespan of scene points to the one below which Gaussians are dynamic.
const FIRST_OVER_DYNAMIC_LIFESPAN: f32 = 1.5;
/// `lambda_dyn`: the dynamic region is small. A weight above that of the photometric loss pulls the dynamic
/// Gaussians away from the image that static and dynamic ones make together.
pub(super) const DYNAMIC_WEIGHT: f32 = 0.1;
/// `lambda_d`, as `lambda` of 3DGS.
const DYNAMIC_SSIM_WEIGHT: f32 = 0.2;
/// `lambda_v`, as PVG on Waymo.
const VELOCITY_WEIGHT: f32 = 0.01;
/// `lambda_m`: at this weight a direction that changes by 0.1 rad per frame costs as much as an error of 1e-4 in
/// all pixels. Its gradient by one velocity is far below that of the image (docs/results/dynamic.md).
const MOTION_WEIGHT: f32 = 0.01;

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = scene.clock()?;
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, METHOD.motion())?;
    dynamic::add_learning_rates(&mut draft.settings, scene_extent(scene));
    decide(&mut draft);
    let of_pvg = Decision::new(true, "as PVG; the paper has no density control");
    let of_pvg = of_pvg.unless(dynamic::missing_time(&draft));
    let splits = draft.decide(TEMPORAL_DENSITY, of_pvg);
    dynamic::allow_seeds(&mut draft, dynamic::resting_seeds(clock));
    draft.add_components();
    let mut dynamics = dynamics(&draft, clock);
    dynamics.density = splits.then(|| dynamic::temporal_density(&draft.settings));
    let lifespan = first_lifespan(&clock, &dynamics);
    draft.settings.dynamics = Some(dynamics);
    let beginning = Beginning::of(&mut draft, &clock, lifespan);
    dynamic::prepared(draft, &beginning)
}

/// Decides on the paper's components.
pub(super) fn decide(draft: &mut Draft<'_>) {
    dynamic::decide_on_time(draft);
    let masks = draft.evidence.masks;
    let without_masks = !masks.show_something();
    let missing_masks = without_masks.then_some("masks that show something");
    let missing_motion = draft.missing(TEMPORAL_MOTION);
    let missing_time = dynamic::missing_time(draft);
    let published = || Decision::new(true, "as published");
    let by_masks = || Decision::new(true, masks.to_string());
    for (component, decision) in [
        (VELOCITY_DECOMPOSITION, published().unless(missing_motion)),
        (
            DYNAMIC_MASK,
            by_masks().unless(missing_time.or(missing_masks)),
        ),
        (MOTION_REGULARIZATION, published().unless(missing_motion)),
        (
            VELOCITY_REGULARIZATION,
            by_masks().unless(missing_motion.or(missing_masks)),
        ),
    ] {
        draft.decide(component, decision);
    }
}

/// Returns the settings of time by the paper's components that are used; without density control.
pub(super) fn dynamics(draft: &Draft<'_>, clock: Clock) -> DynamicSettings {
    let velocity = if !draft.is_used(TEMPORAL_MOTION) {
        VelocityModel::None
    } else if draft.is_used(VELOCITY_DECOMPOSITION) {
        VelocityModel::Decomposed(DECOMPOSITION)
    } else {
        VelocityModel::Free
    };
    let slows = draft.is_used(VELOCITY_REGULARIZATION);
    let steadies = draft.is_used(MOTION_REGULARIZATION);
    let extent = scene_extent(draft.scene);
    DynamicSettings {
        clock,
        time: TimeModel {
            cycle_frames: CYCLE_FRAMES,
            lifespans: draft
                .is_used(TEMPORAL_OPACITY)
                .then_some(dynamic::LIFESPANS),
            velocity,
            least_marginal: 0.0,
        },
        down: dynamic::down(draft.scene),
        dynamic_below_staticness: DYNAMIC_BELOW_STATICNESS,
        dynamic_loss: draft.is_used(DYNAMIC_MASK).then_some(DynamicLoss {
            weight: DYNAMIC_WEIGHT,
            ssim_weight: DYNAMIC_SSIM_WEIGHT,
            begin_iteration: 0,
        }),
        velocity_loss: slows.then_some(VelocityLoss {
            weight: VELOCITY_WEIGHT,
            outside_masks: true,
        }),
        lifespan_weight: 0.0,
        features: TemporalFeatures {
            velocity_unit: slows.then(|| dynamic::velocity_unit(extent)),
            lifespan: None,
        },
        motion_weight: if steadies { MOTION_WEIGHT } else { 0.0 },
        smoothing: None,
        density: None,
    }
}

/// Returns the first lifespan of Gaussians at scene points, frames.
pub(super) fn first_lifespan(clock: &Clock, dynamics: &DynamicSettings) -> f32 {
    // Points start static in a short clip too: masks show the dynamic region.
    let dynamic_below_frames = dynamics.dynamic_below_staticness * dynamics.time.cycle_frames;
    let least = FIRST_OVER_DYNAMIC_LIFESPAN * dynamic_below_frames;
    dynamic::first_lifespan(clock, dynamic::FIRST_LIFESPAN_SHARE).max(least)
}
