//! Omni4DGS without its overfitting in time: this project's own method.
//!
//! The published method gains far more on input views than on novel ones. Its Gaussians can have lifespans of
//! less than a frame: each input view gets some of its own, which are missing at the moments between. Here
//! dynamic Gaussians have lifespans above the gap of a novel view, and start with the velocity of their mask's
//! connected component. They move nearly straight, and are compared with images of neighbouring moments. Density
//! control never splits them in time.

use omnilife_engine::model::dynamic_settings::TemporalSmoothing;

use crate::{
    dynamic::{self, FirstGaussians, TEMPORAL_MOTION, TEMPORAL_OPACITY, TEMPORAL_SMOOTHING},
    omni4dgs::{
        self, DYNAMIC_MASK, MOTION_REGULARIZATION, VELOCITY_DECOMPOSITION, VELOCITY_REGULARIZATION,
        constants,
    },
    tracked_objects,
};
use omnilife_training::{
    baseline::{OPACITY_RESET, scene_extent},
    components::{
        Decision, Draft, camera_response, denser_points,
        draft::{MotionEvidenceUse, Seeding},
        dropout, exposure_compensation, mask_seeds, pose_refinement, short_schedule, sky_shell,
        static_table, swept_points, view_dependent_colour,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models,
    options::{self, MethodOption},
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::masks::SeedVelocity,
};

/// Omni4DGS without overfitting in time.
pub const METHOD: Method = Method {
    id: "omni4dgs-plus",
    title: "Omni4DGS, ours",
    source: "this project; after OmniLife360, section 4",
    description: "omni4dgs with lifespans of half the gap between input views, at least two frames and 66 ms. First \
                  velocities come from the masks' connected components. A cycle of twenty lifespans makes \
                  Gaussians move nearly straight while they live. Temporal smoothing is that of PVG, over as many \
                  frames. The dynamic Gaussians alone have less weight where input views are dense. There is no \
                  density control in time: dynamic Gaussians are there at the moments between input views too. \
                  All aids, which other methods can have, act where the scene gives reason. They take out the \
                  gains of a camera's automatic exposure, let colours depend on the direction, and refine poses \
                  that are off. They take larger steps where the schedule is short, and steps without some of the \
                  Gaussians where few views see most points. They add points of a spherical sweep on bare \
                  surfaces, seeds on masked pixels, and scene points without time where nothing changes. Vehicles whose \
                  paths are known exactly (labels of a data set) have Gaussians of their own that move along \
                  them, on request those with tracks of a detector too. Below the \
                  limit on their number Gaussians with time grow first. Components are left out \
                  where a scene gives no reason for them. On request, in forms that act: \
                  velocity-decomposition and motion-regularization.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        DYNAMIC_MASK,
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
        denser_points::ID,
        sky_shell::ID,
        OPACITY_RESET,
        tracked_objects::ID,
    ],
    optional_components: &[
        VELOCITY_DECOMPOSITION,
        MOTION_REGULARIZATION,
        camera_response::ID,
    ],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
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
        DYNAMIC_LOSS,
        constants::VELOCITY_LOSS,
        constants::MOTION_LOSS,
        constants::MOTION_FORM,
    ],
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::Decides,
        model: &models::objects::OBJECT_GRAPH,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// The weight of the masks as an option, with the default of [`GapSettings`].
const DYNAMIC_LOSS: MethodOption = MethodOption {
    default: "0.01 for each frame of the gap between input views, 0.1 at most",
    ..constants::DYNAMIC_LOSS
};

/// Shortest moment, seconds, a little less than a frame of 30 per second. Lifespans are so many moments: frames up to
/// 30 of them a second, the fewest that neighbouring views can tell apart; where there are more, the same time as with
/// 30. Motion lasts as long, however often it is sampled.
const LEAST_MOMENT_SECONDS: f64 = 0.033;

/// Settings by the gap between input views: lifespans, the distance in time of compared renders, and the weight
/// of the masks.
///
/// A novel view lies in a gap. Gaussians that vanish before its middle leave a hole or a ghost there, however the
/// views on both sides look.
#[derive(Debug, Clone, Copy, PartialEq)]
struct GapSettings {
    least_frames: f32,
    seed_frames: f32,
    dynamic_below_frames: f32,
    cycle_frames: f32,
    smoothing_reach_frames: f32,
    /// `lambda_dyn`.
    dynamic_weight: f32,
}

impl GapSettings {
    /// Returns the settings of a scene whose input views are this many frames apart, with the length of a frame.
    fn across(gap_frames: f32, frame_seconds: f64) -> Self {
        // Frames of a moment, at least 1.
        let frames = (LEAST_MOMENT_SECONDS / frame_seconds).max(1.0) as f32;
        let gap = gap_frames / frames;
        let half = 0.5 * gap;
        // A Gaussian still has 88 % of its opacity one moment from its peak, where a novel view lies that follows
        // an input view. In the middle of a longer gap it has 61 %.
        let least = half.max(2.0);
        Self {
            least_frames: frames * least,
            seed_frames: frames * least.max(mask_seeds::LIFESPAN_FRAMES),
            // The published value is the minimum: otherwise every Gaussian would be static in the longest gaps.
            dynamic_below_frames: frames * (2.5 * least).max(dynamic::CYCLE_FRAMES),
            // Period of the motion `sin(2 pi t / l) l / (2 pi) v`. With PVG's 10 frames a Gaussian swings by 1.6
            // times its velocity in the 5 to 13 frames of its visibility, and returns; pedestrians and cars go
            // on. With 40 frames it goes as far as 6.4 frames take it (docs/results/dynamic.md).
            cycle_frames: frames * 20.0 * least,
            smoothing_reach_frames: frames * half.max(dynamic::SMOOTHING.reach_frames),
            // The loss pulls dynamic Gaussians out of unmasked pixels, where shadows, reflections and unsegmented
            // objects change too. In dense views that costs more than it gives. In sparse views it keeps the
            // static region out of the Gaussians that may change (docs/results/dynamic.md).
            dynamic_weight: (0.01 * gap).min(constants::DYNAMIC_WEIGHT),
        }
    }
}

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = scene.clock()?;
    let gap = GapSettings::across(scene.input_gap_frames(&clock), clock.frame_seconds);
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, METHOD.motion())?;
    dynamic::add_learning_rates(&mut draft.settings, scene_extent(scene));
    omni4dgs::decide(&mut draft);
    let of_pvg = Decision::new(true, "as PVG").unless(draft.missing(TEMPORAL_MOTION));
    let smooths = draft.decide(TEMPORAL_SMOOTHING, of_pvg);
    let seeding = Seeding {
        clock,
        velocity: SeedVelocity::Tracked,
        lifespan_frames: gap.seed_frames,
    };
    dynamic::allow_seeds(&mut draft, seeding);
    let objects = tracked_objects::drafted(&mut draft, scene);
    draft.add_components();
    let mut dynamics = omni4dgs::dynamics(&draft, clock);
    if let Some(lifespans) = &mut dynamics.time.lifespans {
        lifespans.least_frames = gap.least_frames;
    }
    if let Some(loss) = &mut dynamics.dynamic_loss {
        let asked = request.options.number(&DYNAMIC_LOSS);
        loss.weight = asked.unwrap_or(gap.dynamic_weight);
    }
    dynamics.time.cycle_frames = gap.cycle_frames;
    dynamics.dynamic_below_staticness = gap.dynamic_below_frames / gap.cycle_frames;
    dynamics.smoothing = smooths.then_some(TemporalSmoothing {
        reach_frames: gap.smoothing_reach_frames,
        ..dynamic::SMOOTHING
    });
    let lifespan = omni4dgs::first_lifespan(&clock, &dynamics);
    draft.settings.dynamics = Some(dynamics);
    let beginning = FirstGaussians::of(&mut draft, &clock, lifespan);
    let mut prepared = dynamic::prepared(draft, &beginning)?;
    tracked_objects::add(&mut prepared, objects, scene);
    Ok(prepared)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns lifespans and cycle, seconds, and the weight of masks, of input views `gap_seconds` apart.
    fn seconds(gap_seconds: f64, frame_seconds: f64) -> [f64; 6] {
        let gap_frames = (gap_seconds / frame_seconds) as f32;
        let settings = GapSettings::across(gap_frames, frame_seconds);
        let times = [
            settings.least_frames,
            settings.seed_frames,
            settings.dynamic_below_frames,
            settings.cycle_frames,
            settings.smoothing_reach_frames,
        ]
        .map(|frames| f64::from(frames) * frame_seconds);
        let [least, seed, below, cycle, reach] = times;
        let weight = f64::from(settings.dynamic_weight);
        [least, seed, below, cycle, reach, weight]
    }

    fn assert_near(found: [f64; 6], expected: [f64; 6]) {
        for (value, wanted) in found.iter().zip(expected) {
            let error = (value / wanted - 1.0).abs();
            assert!(error < 0.011, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn more_frames_of_the_same_times_have_the_same_lives_in_seconds() {
        for gap_seconds in [1.0 / 30.0, 0.1, 0.5, 3.0] {
            let expected = seconds(gap_seconds, 1.0 / 30.0);
            for factor in [2.0, 4.0, 8.0] {
                assert_near(seconds(gap_seconds, 1.0 / (30.0 * factor)), expected);
            }
        }
        // Every frame is an input view.
        let dense = |rate: f64| seconds(1.0 / rate, 1.0 / rate)[..5].to_vec();
        for (fast, usual) in dense(120.0).into_iter().zip(dense(30.0)) {
            assert!((fast / usual - 1.0).abs() < 0.011, "{fast} {usual}");
        }
    }

    #[test]
    fn slower_clips_have_lives_that_are_as_much_longer() {
        let expected = seconds(0.5, 0.05);
        for factor in [1.5, 5.0, 20.0] {
            let mut scaled = expected.map(|value| value * factor);
            scaled[5] = expected[5];
            assert_near(seconds(0.5 * factor, 0.05 * factor), scaled);
        }
    }

    /// Checks that 30 frames per second, as cameras state it, are frames.
    #[test]
    fn up_to_30_frames_a_second_a_moment_is_a_frame() {
        for rate in [4.0, 6.25, 12.0, 25.0, 29.97, 30.0] {
            let found = GapSettings::across(3.0, 1.0 / rate);
            assert_eq!(found, GapSettings::across(3.0, 1.0));
        }
        assert_eq!(GapSettings::across(3.0, 0.033_333).cycle_frames, 40.0);
        assert!((seconds(0.01, 0.01)[3] - 40.0 * LEAST_MOMENT_SECONDS).abs() < 1e-6);
    }

    #[test]
    fn lives_reach_over_the_gaps_between_input_views() {
        for dense in [1.0, 2.0, 3.0, 4.0] {
            let settings = GapSettings::across(dense, 0.1);
            assert_eq!(
                [
                    settings.least_frames,
                    settings.seed_frames,
                    settings.dynamic_below_frames
                ],
                [2.0, 4.0, 10.0]
            );
            assert_eq!(settings.cycle_frames, 40.0);
            assert_eq!(settings.dynamic_weight, 0.01 * dense);
        }
        for gap in [9.0, 30.0, 300.0] {
            let settings = GapSettings::across(gap, 0.1);
            assert_eq!(settings.least_frames, 0.5 * gap);
            assert!(
                settings.seed_frames < settings.dynamic_below_frames,
                "seeds are dynamic"
            );
            assert!(settings.least_frames <= settings.seed_frames);
            assert!(settings.dynamic_weight <= constants::DYNAMIC_WEIGHT);
            // Motion over half of the gap is straight within a twentieth: sin(x) / x at x = pi / 20 * 2.
            let phase = std::f32::consts::TAU * 0.5 * gap / settings.cycle_frames;
            assert!(phase.sin() / phase > 0.95, "{phase}");
        }
    }
}
