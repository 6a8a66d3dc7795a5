//! Omni4DGS without its overfitting in time: ours.
//!
//! The published method gains far more on input views than on novel ones. Its Gaussians can live for
//! less than a frame: each input view gets some of its own, which are not there at the moments
//! between. Here dynamic Gaussians live longer than the gap that a novel view leaves, begin with the
//! velocity of their mask's piece, and are held against images of neighbouring moments; nothing splits
//! them in time.

use crate::{
    baseline::{OPACITY_RESET, SKY_SHELL},
    components::pose_refinement::POSE_REFINEMENT,
    methods::{
        Method, MethodKind, PreparedGaussians,
        dynamic::{self, TEMPORAL_MOTION, TEMPORAL_OPACITY, TEMPORAL_SMOOTHING},
        omni4dgs::{
            self, DYNAMIC_MASK, EXPOSURE_COMPENSATION, MOTION_REGULARIZATION, STATIC_TABLE,
            VELOCITY_DECOMPOSITION, VELOCITY_REGULARIZATION, VIEW_DEPENDENT_COLOUR, Variant,
        },
    },
    options,
    request::MethodRequest,
};
use crate::{
    error::ReconstructError, request::BackendChoice, scene::TrainingScene,
    seeds::masks::SeedVelocity,
};

/// Ours.
pub const METHOD: Method = Method {
    id: "omni4dgs-plus",
    title: "Omni4DGS, ours",
    source: "this project; after OmniLife360, section 4",
    description: "omni4dgs with lifespans of two frames at least, first velocities from the masks' \
                  pieces, temporal smoothing as in PVG, lifespans that find their length in short \
                  schedules too, gains of a camera's automatic exposure taken out, colours that \
                  depend on the direction where the scene's do, poses refined where they are off, \
                  and no density control in time: dynamic Gaussians are there at the moments \
                  between input views too.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        VELOCITY_DECOMPOSITION,
        DYNAMIC_MASK,
        MOTION_REGULARIZATION,
        VELOCITY_REGULARIZATION,
        STATIC_TABLE,
        TEMPORAL_SMOOTHING,
        EXPOSURE_COMPENSATION,
        VIEW_DEPENDENT_COLOUR,
        POSE_REFINEMENT,
        SKY_SHELL,
        OPACITY_RESET,
    ],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

const OURS: Variant = Variant {
    id: METHOD.id,
    // A novel view lies one frame from its neighbours: there a Gaussian of theirs still has 88 % of
    // its opacity.
    least_lifespan_frames: Some(2.0),
    smoothing: Some(dynamic::SMOOTHING),
    // What changes outside the masks, such as shadows, does so within a few frames; lifespans find
    // their length from there.
    first_lifespan_share: omni4dgs::FIRST_LIFESPAN_SHARE,
    seed_velocity: SeedVelocity::Tracked,
    splits_in_time: false,
    quickens_lifespans: true,
    compensates_exposure: true,
    colours_by_direction: true,
    refines_poses: true,
    // Points that change are away from their peak at most moments: with the 0.1 of static methods the
    // first images are half empty. The others gain by it too, in short schedules.
    first_opacity: Some(0.25),
};

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    omni4dgs::prepare_variant(&OURS, scene, request, backend)
}
