//! What the methods for dynamic scenes have in common: defaults, first Gaussians, components.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{
    components::Components,
    methods::PreparedGaussians,
    request::{MethodRequest, PlanChoice},
};
use crate::{
    error::ReconstructError,
    evidence::pilot::WarmUp,
    request::BackendChoice,
    scene::TrainingScene,
    seeds::{
        masks::{MaskSeeds, SeedVelocity, mask_seeds},
        points,
    },
};
use omnilife_engine::EngineError;
use omnilife_engine::{
    clock::Clock,
    gaussians::{
        static_gaussians::{self, InitialGaussians, StaticGaussians},
        temporal::{InitialTimes, LifespanFeature, LifespanRange},
    },
    model::{
        Model, Part,
        dynamic_settings::{DynamicSettings, TemporalDensity, TemporalSmoothing, mean_vertical},
        exposure::Exposure,
        pose_corrections::PoseCorrections,
    },
    parameters::decay::Decay,
    step::settings::TrainSettings,
};

/// Component: opacities rise and fall with time; without it no Gaussian has a lifespan, and none
/// counts as dynamic.
pub(super) const TEMPORAL_OPACITY: &str = "temporal-opacity";
/// Component: Gaussians move.
pub(super) const TEMPORAL_MOTION: &str = "temporal-motion";
/// Component: renders of neighbouring moments, moved on, are held against an image.
pub(super) const TEMPORAL_SMOOTHING: &str = "temporal-smoothing";
/// Component: short lives cost (PVG).
pub(super) const LIFESPAN_LOSS: &str = "lifespan-loss";
/// The lifespan as that loss sees it, in PVG's unit; what lives for 2 units is not told apart from
/// what lives longer (PVG `train.py`).
pub(super) const LIFESPAN_FEATURE: LifespanFeature = LifespanFeature {
    unit_frames: FRAMES_PER_UNIT,
    largest_frames: 2.0 * FRAMES_PER_UNIT,
};
/// Weight of that loss (PVG `configs/kitti_reconstruction.yaml`; Waymo has none): here as there a
/// moving camera sees most things for a short time.
pub(super) const LIFESPAN_WEIGHT: f32 = 0.01;
/// First lifespans in PVG's base configuration are the square root of this share of the clip.
pub(super) const FIRST_LIFESPAN_SHARE: f32 = 0.2;
/// Temporal smoothing of PVG (`train.py`).
pub(super) const SMOOTHING: TemporalSmoothing = TemporalSmoothing {
    probability: 0.5,
    reach_frames: 1.5,
};
/// Component: density control in time.
pub(super) const TEMPORAL_DENSITY: &str = "temporal-density";

/// Frames of PVG's time unit: its data sets have 0.02 from frame to frame
/// (`scene/waymo_loader.py`). Published times, velocities and thresholds are in this unit.
pub(super) const FRAMES_PER_UNIT: f32 = 50.0;
/// Cycle length: 0.2 units (PVG `configs/`).
pub(super) const CYCLE_FRAMES: f32 = 0.2 * FRAMES_PER_UNIT;
/// Least lifespan: a Gaussian that lives shorter is seen at one frame at most, and its gradients grow
/// with the inverse square.
const LEAST_LIFESPAN_FRAMES: f32 = 0.25;
/// Largest lifespan: opacities are constant over any clip to a part in a million.
const LARGEST_LIFESPAN_FRAMES: f32 = 1e6;
/// First peak times are drawn from this many times the clip (PVG `scene/waymo_loader.py`).
const PEAK_RANGE: f32 = 1.2;
/// Seeds of dynamic Gaussians take at most this share of all: what they take, the static region goes
/// without.
const LARGEST_SEEDS_SHARE: f64 = 0.125;
/// A seed is seen while it has a quarter of its opacity: for this many of its lifespans,
/// `2 sqrt(2 ln 4)`.
const SEEN_LIFESPANS: f32 = 3.33;

/// Bounds of lifespans, from `least` frames.
pub(super) fn lifespans(least: Option<f32>) -> LifespanRange {
    LifespanRange {
        least_frames: least.unwrap_or(LEAST_LIFESPAN_FRAMES),
        largest_frames: LARGEST_LIFESPAN_FRAMES,
    }
}

/// PVG's density control in time, for a schedule as long as `settings` has it: a threshold of 2e-3
/// per unit, clones up to 0.01 units, shorter lives from half of the densification on (PVG
/// `arguments/__init__.py`, `no_time_split`).
pub(super) fn temporal_density(settings: &TrainSettings) -> TemporalDensity {
    TemporalDensity {
        gradient_threshold: 2e-3 / FRAMES_PER_UNIT,
        clone_lifespan_frames: 0.01 * FRAMES_PER_UNIT,
        shorten_from_iteration: settings.densify.end_iteration / 2,
    }
}

/// Adds PVG's step sizes of temporal parameters (`arguments/__init__.py`): peak times 8e-4 falling
/// like those of positions, lifespans 2e-3, velocities 1e-3 for a scene of the size of a unit cube.
pub(super) fn add_learning_rates(settings: &mut TrainSettings, extent: f32) {
    let velocity = Decay::constant(1e-3 / FRAMES_PER_UNIT * extent);
    let peaks = Decay {
        begin: 8e-4 * FRAMES_PER_UNIT,
        end: 8e-6 * FRAMES_PER_UNIT,
    };
    settings.learning_rates.extend(
        [
            ("peak_times", peaks),
            ("log_lifespans", Decay::constant(2e-3)),
            ("velocities", velocity),
            ("radial_velocities", velocity),
            ("tangential_velocities", velocity),
        ]
        .map(|(array, decay)| (array.to_owned(), decay)),
    );
}

/// Larger steps of lifespans in schedules shorter than the published one, with the square root, as a
/// random walk would go: 600 published steps change no lifespan by more than a factor of 3.
pub(super) fn quicken_lifespans(settings: &mut TrainSettings) {
    let shorter = crate::baseline::PUBLISHED_ITERATIONS / settings.iterations.max(1) as f64;
    if let Some(rate) = settings.learning_rates.get_mut("log_lifespans") {
        *rate = Decay::constant(rate.begin * shorter.max(1.0).sqrt() as f32);
    }
}

/// What a velocity is measured in where it is rendered: PVG's, whose scenes have an extent of 1.
pub(super) fn velocity_unit(extent: f32) -> f32 {
    extent / FRAMES_PER_UNIT
}

/// `sqrt(share * duration)` in PVG's unit, in frames: first lifespans (PVG
/// `scene/gaussian_model.py`).
pub(super) fn first_lifespan(clock: &Clock, share: f32) -> f32 {
    (share * clock.duration_frames.max(1.0) * FRAMES_PER_UNIT).sqrt()
}

/// Peak times drawn evenly from the clip and a tenth of it on both sides.
pub(super) fn scattered_times(clock: &Clock, len: usize, lifespan: f32, seed: u64) -> InitialTimes {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let half = 0.5 * PEAK_RANGE * clock.duration_frames;
    let mut times = InitialTimes::constant(len, 0.0, lifespan);
    times
        .peaks
        .fill_with(|| half * random.random_range(-1.0..=1.0_f32));
    times
}

/// The share of all Gaussians with which the masked region is as dense as the others at any moment:
/// its share of the sphere, times the number of sets that follow each other in the clip.
fn seeds_share(coverage: f64, clock: &Clock, lifespan: f32) -> f64 {
    let sets = (clock.duration_frames / (SEEN_LIFESPANS * lifespan)).max(1.0);
    (coverage * f64::from(sets)).min(LARGEST_SEEDS_SHARE)
}

/// Seeds of dynamic Gaussians within the limit on all of them.
pub(super) fn seeds(
    scene: &TrainingScene,
    settings: &TrainSettings,
    clock: &Clock,
    lifespan: f32,
    velocity: SeedVelocity,
) -> MaskSeeds {
    let share = seeds_share(scene.mask_coverage().unwrap_or(0.0), clock, lifespan);
    let room = settings.densify.maximum_gaussians as f64 * share;
    mask_seeds(scene, clock, lifespan, velocity, room.ceil() as usize)
}

/// What a run begins with: Gaussians that never move and those that may.
#[derive(Debug, Default)]
pub(super) struct Beginning {
    pub(super) fixed: InitialGaussians,
    pub(super) moving: InitialGaussians,
    pub(super) times: InitialTimes,
}

impl Beginning {
    /// Adds Gaussians that may move.
    pub(super) fn add_moving(&mut self, gaussians: InitialGaussians, times: InitialTimes) {
        self.moving = points::join(std::mem::take(&mut self.moving), gaussians);
        self.times.extend(times);
    }

    /// A model of both.
    pub(super) fn model(&self, dynamics: &DynamicSettings, sh_degree: usize) -> Model {
        let fixed = static_gaussians::table(&self.fixed, sh_degree);
        let moving = dynamics.time.table(&self.moving, &self.times, sh_degree);
        Model::new(vec![
            Part::new(StaticGaussians, fixed),
            Part::new(dynamics.parameterization(), moving),
        ])
    }
}

/// Refuses what the processor's dynamic steps cannot do, before anything is made.
pub(super) fn check(
    method: &str,
    scene: &TrainingScene,
    backend: BackendChoice,
) -> Result<Clock, ReconstructError> {
    if backend != BackendChoice::Cpu {
        return Err(EngineError::Backend {
            reason: format!("{method}: this method runs on the cpu backend"),
        }
        .into());
    }
    scene.clock()
}

/// Coverage above which masks look as if they marked what does not move.
const INVERTED_COVERAGE: f64 = 0.5;

/// What a scene says about motion.
#[derive(Debug)]
pub(super) struct Evidence {
    /// Whether something moves, or may.
    pub(super) moves: bool,
    /// Whether masks show what.
    pub(super) has_masks: bool,
    /// The evidence in words.
    pub(super) reason: String,
    /// What was looked at for it, where it was more than the masks.
    pub(super) warm_up: Option<WarmUp>,
}

impl Evidence {
    /// Masks say what moves. Without any, residuals after a static warm-up tell whether something
    /// does, where the plan asks for evidence.
    pub(super) fn of(
        scene: &TrainingScene,
        request: &MethodRequest,
    ) -> Result<Self, ReconstructError> {
        let views = scene.input_views.len();
        let masked = scene
            .input_views
            .iter()
            .filter(|view| view.mask.is_some())
            .count();
        let Some(coverage) = scene.mask_coverage() else {
            let mut evidence = Self {
                moves: true,
                has_masks: false,
                reason: "no input view has a mask".to_owned(),
                warm_up: None,
            };
            if request.plan == PlanChoice::Auto {
                let mut warm_up = WarmUp::of(scene, request.seed)?;
                // A camera's automatic exposure is no motion.
                if warm_up.exposure().is_some_and(Exposure::drifts) {
                    warm_up.normalize();
                }
                // Nor is an edge that lies beside its place because a pose is off.
                warm_up.correct_poses();
                let found = warm_up.motion();
                evidence.moves = found.moves();
                evidence.reason += &format!("; {}", found.text());
                evidence.warm_up = Some(warm_up);
            }
            return Ok(evidence);
        };
        let mut reason = format!(
            "{masked} of {views} input views have masks, which cover {:.2} % of the sphere",
            100.0 * coverage
        );
        if coverage > INVERTED_COVERAGE {
            reason += "; they look inverted: white is what moves";
        }
        Ok(Self {
            moves: coverage > 0.0,
            has_masks: coverage > 0.0,
            reason,
            warm_up: None,
        })
    }

    /// The evidence for a component that only makes sense where something moves.
    pub(super) fn of_motion(&self) -> (bool, String) {
        (self.moves, self.reason.clone())
    }
}

/// A line for the run's warnings where masks look inverted.
pub(super) fn mask_warning(scene: &TrainingScene) -> Option<String> {
    let coverage = scene.mask_coverage()?;
    (coverage > INVERTED_COVERAGE).then(|| {
        format!(
            "the masks cover {:.0} % of the sphere: they look inverted (white is what moves)",
            100.0 * coverage
        )
    })
}

/// A model whose settings and components are decided. Where nothing depends on time it is a static
/// one, and training knows nothing of time.
pub(super) fn prepared(
    scene: &TrainingScene,
    request: &MethodRequest,
    mut settings: TrainSettings,
    beginning: &Beginning,
    components: Components<'_>,
) -> Result<PreparedGaussians, ReconstructError> {
    let sh_degree = settings.rendering.sh_degree;
    let dynamics = settings.dynamics.as_ref();
    let mut model = match dynamics.filter(|dynamics| !dynamics.time.shapes().is_empty()) {
        Some(dynamics) => beginning.model(dynamics, sh_degree),
        None => {
            settings.dynamics = None;
            let all = points::join(beginning.fixed.clone(), beginning.moving.clone());
            static_gaussians::table(&all, sh_degree).into()
        }
    };
    crate::baseline::require_memory(request, &settings, &model.shapes(), 0)?;
    if settings.pose_refinement.is_some() {
        let times = scene.input_views.iter().map(|view| view.view.time_seconds);
        model.poses = Some(PoseCorrections::new(times.collect()));
    }
    Ok(PreparedGaussians {
        model,
        settings,
        plan: components.plan,
        remarks: mask_warning(scene).into_iter().collect(),
    })
}

/// The mean vertical of the input cameras.
pub(super) fn down(scene: &TrainingScene) -> [f32; 3] {
    mean_vertical(scene.input_views.iter().map(|view| &view.view))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_as_dense_as_the_rest() {
        let clock = Clock {
            origin_seconds: 0.0,
            frame_seconds: 0.1,
            duration_frames: 66.6,
        };
        let share = |coverage, lifespan| seeds_share(coverage, &clock, lifespan);
        // Five sets of one in a hundred; one set that lives longer than the clip; a limit.
        for (found, expected) in [
            (share(0.01, 4.0), 0.05),
            (share(0.01, 400.0), 0.01),
            (share(0.6, 4.0), 0.125),
            (share(0.0, 4.0), 0.0),
        ] {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }

    #[test]
    fn lifespans_go_as_far_in_a_short_schedule() {
        let rate = |iterations| {
            let mut settings = crate::baseline::published_settings(iterations);
            add_learning_rates(&mut settings, 1.0);
            quicken_lifespans(&mut settings);
            settings.learning_rates["log_lifespans"].at(0.3)
        };
        for (iterations, expected) in [(30_000, 2e-3), (100_000, 2e-3), (300, 2e-2)] {
            assert!((rate(iterations) - expected).abs() < 1e-8);
        }
    }
}
