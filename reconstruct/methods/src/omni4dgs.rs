//! Omni4DGS: dynamic Gaussians on the sphere, separated from static ones by masks.
//!
//! Source: "OmniLife360", section 4, Eqs. 1 to 12. The paper gives neither weights nor first values
//! nor rules of density; every such setting is named in `constants` with the reason for its value.

pub(super) mod constants;

use crate::dynamic::{self, FirstGaussians, TEMPORAL_DENSITY, TEMPORAL_MOTION, TEMPORAL_OPACITY};
use omnilife_engine::{
    clock::Clock,
    gaussians::temporal::{TemporalFeatures, TimeModel, VelocityModel},
    model::dynamic_settings::{DynamicSettings, VelocityLoss},
};
use omnilife_training::{
    baseline::{OPACITY_RESET, scene_extent},
    components::{
        self, Decision, Draft, camera_response, denser_points, draft::MotionEvidenceUse, dropout,
        exposure_compensation, mask_seeds, pose_refinement, short_schedule, sky_shell,
        static_table, swept_points, view_dependent_colour,
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
    description: "Gaussians that appear, move and vanish; masks supervise the dynamic ones rendered \
                  alone; velocities are kept out of the static region. The paper \
                  has no density control: in time it is PVG's, in space 3DGS's, and below the limit \
                  on their number Gaussians with time come first. The sky's shell has no time. Two \
                  components of the paper are left to a request, in forms that act: \
                  velocity-decomposition, whose two velocities as printed step as one under Adam \
                  (velocity-form=literal), and motion-regularization, which as a mean over all \
                  Gaussians is too small to act (motion-form=mean). Aids, not the paper's: denser \
                  points, larger steps in short schedules, mask-seeds, with which dynamic Gaussians \
                  begin on masked pixels, and static-table, with which scene points that do not \
                  change carry no temporal parameters; --without aids is the published method. \
                  Readings of what the paper leaves open are named in the source.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        DYNAMIC_MASK,
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
    optional_components: &[
        VELOCITY_DECOMPOSITION,
        MOTION_REGULARIZATION,
        exposure_compensation::ID,
        camera_response::ID,
        view_dependent_colour::ID,
        pose_refinement::ID,
        dropout::ID,
    ],
    // Table 6.
    ablation: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        VELOCITY_DECOMPOSITION,
        DYNAMIC_MASK,
        MOTION_REGULARIZATION,
    ],
    default_plan: DefaultPlan::Full,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: &[
        options::MAX_GAUSSIANS,
        options::SH_DEGREE,
        options::FOOTPRINT,
        options::DENSIFY_THRESHOLD,
        constants::GAMMA,
        constants::VELOCITY_FORM,
        constants::VELOCITY_ORIGIN,
        constants::DYNAMIC_BELOW,
        constants::CYCLE,
        constants::DYNAMIC_LOSS,
        constants::DYNAMIC_SSIM,
        constants::VELOCITY_LOSS,
        constants::MOTION_LOSS,
        constants::MOTION_FORM,
    ],
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
pub const DYNAMIC_MASK: &str = components::DYNAMIC_MASK;
/// Component: static Gaussians stay in their direction (Eqs. 10, 11).
pub(super) const MOTION_REGULARIZATION: &str = "motion-regularization";
/// Component: no velocities outside the masks (Eq. 9).
pub(super) const VELOCITY_REGULARIZATION: &str = components::VELOCITY_REGULARIZATION;

/// Minimum ratio of the first lifespan of scene points to the one below which Gaussians are dynamic.
const FIRST_OVER_DYNAMIC_LIFESPAN: f32 = 1.5;

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
    let beginning = FirstGaussians::of(&mut draft, &clock, lifespan);
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
    let by_masks = || Decision::new(true, masks.to_string());
    for (component, decision) in [
        (
            VELOCITY_DECOMPOSITION,
            Decision::on_request("Adam does not feel the weights of two velocities")
                .unless(missing_motion),
        ),
        (
            DYNAMIC_MASK,
            by_masks().unless(missing_time.or(missing_masks)),
        ),
        (
            MOTION_REGULARIZATION,
            Decision::on_request("the published mean over all Gaussians is too small to act")
                .unless(missing_motion),
        ),
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
    let options = &draft.request.options;
    let velocity = if !draft.is_used(TEMPORAL_MOTION) {
        VelocityModel::None
    } else if draft.is_used(VELOCITY_DECOMPOSITION) {
        VelocityModel::Decomposed(constants::decomposition(options))
    } else {
        VelocityModel::Free
    };
    let slows = draft.is_used(VELOCITY_REGULARIZATION);
    let steadies = draft.is_used(MOTION_REGULARIZATION);
    let extent = scene_extent(draft.scene);
    DynamicSettings {
        clock,
        time: TimeModel {
            cycle_frames: constants::cycle_frames(options),
            lifespans: draft
                .is_used(TEMPORAL_OPACITY)
                .then_some(dynamic::LIFESPANS),
            velocity,
            least_marginal: 0.0,
        },
        down: dynamic::down(draft.scene),
        dynamic_below_staticness: constants::dynamic_below_staticness(options),
        dynamic_loss: draft
            .is_used(DYNAMIC_MASK)
            .then(|| constants::dynamic_loss(options)),
        velocity_loss: slows.then(|| VelocityLoss {
            weight: constants::velocity_weight(options),
            outside_masks: true,
        }),
        lifespan_weight: 0.0,
        features: TemporalFeatures {
            velocity_unit: slows.then(|| dynamic::velocity_unit(extent)),
            lifespan: None,
        },
        motion_loss: steadies.then(|| constants::motion_loss(options)),
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
