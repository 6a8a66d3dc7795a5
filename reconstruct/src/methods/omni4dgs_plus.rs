//! Omni4DGS without its overfitting in time: ours.
//!
//! The published method gains far more on input views than on novel ones. Its Gaussians can live for
//! less than a frame: each input view gets some of its own, which are not there at the moments
//! between. Here dynamic Gaussians live longer than the gap that a novel view leaves, begin with the
//! velocity of their mask's connected component, move nearly straight while they live, and are held against
//! images of neighbouring moments; nothing splits them in time.

use crate::{
    baseline::OPACITY_RESET,
    components::{
        Decision, Draft, draft::MotionEvidenceUse, dropout, exposure_compensation, mask_seeds,
        pose_refinement, short_schedule, sky_shell, static_table, swept_points,
        view_dependent_colour,
    },
    error::ReconstructError,
    methods::{
        Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians,
        dynamic::{self, Beginning, TEMPORAL_MOTION, TEMPORAL_OPACITY, TEMPORAL_SMOOTHING},
        omni4dgs::{
            self, DYNAMIC_MASK, MOTION_REGULARIZATION, VELOCITY_DECOMPOSITION,
            VELOCITY_REGULARIZATION,
        },
    },
    options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::TrainingScene,
    seeds::masks::SeedVelocity,
};

/// Ours.
pub const METHOD: Method = Method {
    id: "omni4dgs-plus",
    title: "Omni4DGS, ours",
    source: "this project; after OmniLife360, section 4",
    description: "omni4dgs with lifespans of two frames at least, first velocities from the masks' \
                  connected components, a cycle of 40 frames instead of 10, so that Gaussians move nearly \
                  straight while they live, temporal smoothing as in PVG, gains of a camera's automatic exposure taken out, \
                  colours that depend on the direction where the scene's do, poses refined where \
                  they are off, larger steps where the schedule is short, steps that leave Gaussians out \
                  where few views see most points, and no density control in \
                  time: dynamic Gaussians are there at the moments between input views too. Below the \
                  limit on their number Gaussians with time grow first. Components are left out \
                  where a scene gives no reason for them.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        VELOCITY_DECOMPOSITION,
        DYNAMIC_MASK,
        MOTION_REGULARIZATION,
        VELOCITY_REGULARIZATION,
        mask_seeds::ID,
        static_table::ID,
        TEMPORAL_SMOOTHING,
        exposure_compensation::ID,
        view_dependent_colour::ID,
        pose_refinement::ID,
        short_schedule::ID,
        dropout::ID,
        swept_points::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Least lifespan: a novel view lies one frame from its neighbours, where a Gaussian of theirs still has
/// 88 % of its opacity.
const LEAST_LIFESPAN_FRAMES: f32 = 2.0;
/// Cycle of the motion `sin(2 pi t / l) l / (2 pi) v`. With PVG's 10 frames a Gaussian swings by 1.6 times its
/// velocity, in the 5 to 13 frames that it is seen, and turns round; what walks or drives goes on. With 40
/// frames it goes as far as 6.4 frames take it (docs/results/dynamic.md).
const CYCLE_FRAMES: f32 = 4.0 * dynamic::CYCLE_FRAMES;

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = scene.clock()?;
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, MotionEvidenceUse::Decides)?;
    dynamic::add_learning_rates(&mut draft.settings, crate::baseline::scene_extent(scene));
    omni4dgs::decide(&mut draft);
    let of_pvg = Decision::new(true, "as PVG").unless(draft.missing(TEMPORAL_MOTION));
    let smooths = draft.decide(TEMPORAL_SMOOTHING, of_pvg);
    dynamic::allow_seeds(&mut draft, clock, SeedVelocity::Tracked);
    draft.add_components();
    let mut dynamics = omni4dgs::dynamics(&draft, clock);
    if let Some(lifespans) = &mut dynamics.time.lifespans {
        lifespans.least_frames = LEAST_LIFESPAN_FRAMES;
    }
    // Which lifespans are dynamic is the same.
    dynamics.dynamic_below_staticness *= dynamics.time.cycle_frames / CYCLE_FRAMES;
    dynamics.time.cycle_frames = CYCLE_FRAMES;
    dynamics.smoothing = smooths.then_some(dynamic::SMOOTHING);
    draft.settings.dynamics = Some(dynamics);
    let lifespan = omni4dgs::first_lifespan(&clock);
    let beginning = Beginning::of(&mut draft, &clock, lifespan);
    dynamic::prepared(draft, &beginning)
}
