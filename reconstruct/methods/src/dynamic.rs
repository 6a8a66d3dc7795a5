//! Shared parts of the methods for dynamic scenes: defaults, first Gaussians, components.

use std::mem::take;

use rand::RngExt;

use omnilife_engine::{
    clock::Clock,
    gaussians::{
        static_gaussians::{self, InitialGaussians, StaticGaussians},
        temporal::{InitialTimes, LifespanRange},
    },
    model::{
        Model, Part,
        dynamic_settings::{DynamicSettings, TemporalDensity, TemporalSmoothing, mean_vertical},
    },
    parameters::{
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
    step::settings::TrainSettings,
};
use omnilife_training::{
    baseline::require_memory,
    components::{Decision, Draft, draft::Seeding, mask_seeds},
    error::ReconstructError,
    method::PreparedGaussians,
    random::{Purpose, stream},
    scene::TrainingScene,
    seeds::{masks::SeedVelocity, points},
};

/// Component: opacities rise and fall with time. Without it Gaussians have no lifespan, and all count as static.
pub(super) const TEMPORAL_OPACITY: &str = "temporal-opacity";
/// Component: Gaussians move.
pub(super) const TEMPORAL_MOTION: &str = "temporal-motion";
/// Component: renders of neighbouring moments, moved on, are compared with an image.
pub(super) const TEMPORAL_SMOOTHING: &str = "temporal-smoothing";
/// First lifespans of scene points are the square root of this share of the clip (PVG
/// `configs/waymo_nvs.yaml`, `t_init`).
pub(super) const FIRST_LIFESPAN_SHARE: f32 = 0.1;
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
/// Minimum lifespan: a shorter one is visible at one frame at most, and its gradients grow with the inverse
/// square.
const LEAST_LIFESPAN_FRAMES: f32 = 0.25;
/// Largest lifespan: opacities are constant over any clip to a part in a million.
const LARGEST_LIFESPAN_FRAMES: f32 = 1e6;
/// First peak times are drawn from this many times the clip (PVG `scene/waymo_loader.py`).
const PEAK_RANGE: f32 = 1.2;
/// Bounds of lifespans.
pub(super) const LIFESPANS: LifespanRange = LifespanRange {
    least_frames: LEAST_LIFESPAN_FRAMES,
    largest_frames: LARGEST_LIFESPAN_FRAMES,
};

/// Returns PVG's density control in time, for a schedule as long as that of `settings` (PVG
/// `arguments/__init__.py`, `no_time_split`). It has a threshold of 2e-3 per unit, clones up to 0.01 units, and
/// shorter lifespans from half of the densification on.
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
            ("peak_times", peaks, Growth::LASTING),
            ("log_lifespans", Decay::constant(2e-3), Growth::EVEN),
            ("velocities", velocity, Growth::SETTLING),
            ("radial_velocities", velocity, Growth::SETTLING),
            ("tangential_velocities", velocity, Growth::SETTLING),
        ]
        .map(|(array, decay, growth)| (array.to_owned(), LearningRate::new(decay, growth))),
    );
}

/// Returns the unit of velocities where they are rendered: PVG's, whose scenes have an extent of 1.
pub(super) fn velocity_unit(extent: f32) -> f32 {
    extent / FRAMES_PER_UNIT
}

/// Returns first lifespans, `sqrt(share * duration)` in PVG's unit, in frames (PVG `scene/gaussian_model.py`).
pub(super) fn first_lifespan(clock: &Clock, share: f32) -> f32 {
    (share * clock.duration_frames.max(1.0) * FRAMES_PER_UNIT).sqrt()
}

/// Draws peak times evenly from the clip and a tenth of it on both sides.
fn scattered_times(clock: &Clock, len: usize, lifespan: f32, seed: u64) -> InitialTimes {
    let mut random = stream(seed, Purpose::PeakTimes);
    let half = 0.5 * PEAK_RANGE * clock.duration_frames;
    let mut times = InitialTimes::constant(len, 0.0, lifespan);
    times
        .peaks
        .fill_with(|| half * random.random_range(-1.0..=1.0_f32));
    times
}

/// First Gaussians of a run: static ones and those that may move.
#[derive(Debug, Default)]
pub(super) struct FirstGaussians {
    pub(super) fixed: InitialGaussians,
    pub(super) moving: InitialGaussians,
    pub(super) times: InitialTimes,
}

impl FirstGaussians {
    /// Returns the drafted Gaussians. Those at scene points have this first lifespan and peaks all over the clip;
    /// seeds have their own.
    pub(super) fn of(draft: &mut Draft<'_>, clock: &Clock, lifespan: f32) -> Self {
        let mut beginning = Self {
            fixed: take(&mut draft.fixed),
            ..Self::default()
        };
        let points = take(&mut draft.points);
        let times = scattered_times(clock, points.len(), lifespan, draft.request.seed);
        beginning.add_moving(points, times);
        let seeds = take(&mut draft.seeds);
        beginning.add_moving(seeds.gaussians, seeds.times);
        beginning
    }

    /// Adds Gaussians that may move.
    fn add_moving(&mut self, gaussians: InitialGaussians, times: InitialTimes) {
        self.moving = points::join(take(&mut self.moving), gaussians);
        self.times.extend(times);
    }

    /// Makes a model of both.
    pub(super) fn model(&self, dynamics: &DynamicSettings, sh_degree: usize) -> Model {
        let fixed = static_gaussians::table(&self.fixed, sh_degree);
        let moving = dynamics.time.table(&self.moving, &self.times, sh_degree);
        Model::new(vec![
            Part::new(StaticGaussians, fixed),
            Part::new(dynamics.parameterization(), moving),
        ])
    }
}

/// Decides on time by the evidence of motion.
pub(super) fn decide_on_time(draft: &mut Draft<'_>) {
    for component in [TEMPORAL_OPACITY, TEMPORAL_MOTION] {
        let of_motion = Decision::of_motion(&draft.evidence);
        draft.decide(component, of_motion);
    }
}

/// Returns the missing component that others require, if no Gaussian depends on time.
pub(super) fn missing_time(draft: &Draft<'_>) -> Option<&'static str> {
    let depends = draft.is_used(TEMPORAL_OPACITY) || draft.is_used(TEMPORAL_MOTION);
    (!depends).then_some("time")
}

/// Allows mask seeds where Gaussians have lifespans: seeds without an end would stay for the whole clip.
pub(super) fn allow_seeds(draft: &mut Draft<'_>, seeding: Seeding) {
    let fades = draft.is_used(TEMPORAL_OPACITY);
    draft.seeding = fades.then_some(seeding);
}

/// Returns seeds at rest, as the published methods have them.
pub(super) fn resting_seeds(clock: Clock) -> Seeding {
    Seeding {
        clock,
        velocity: SeedVelocity::None,
        lifespan_frames: mask_seeds::LIFESPAN_FRAMES,
    }
}

/// Makes a model with its settings and components. If nothing depends on time it is a static one, and training
/// ignores time.
pub(super) fn prepared(
    mut draft: Draft<'_>,
    beginning: &FirstGaussians,
) -> Result<PreparedGaussians, ReconstructError> {
    let settings = &mut draft.settings;
    let sh_degree = settings.rendering.sh_degree;
    let dynamics = settings.dynamics.as_ref();
    let model = match dynamics.filter(|dynamics| !dynamics.time.shapes().is_empty()) {
        Some(dynamics) => beginning.model(dynamics, sh_degree),
        None => {
            settings.dynamics = None;
            let all = points::join(beginning.fixed.clone(), beginning.moving.clone());
            static_gaussians::table(&all, sh_degree).into()
        }
    };
    require_memory(draft.request, settings, &model.shapes(), 0)?;
    Ok(PreparedGaussians::new(draft, model))
}

/// Returns the mean vertical of the input cameras.
pub(super) fn down(scene: &TrainingScene) -> [f32; 3] {
    mean_vertical(scene.input_views.iter().map(|view| &view.view))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_peaks_are_drawn_apart_from_the_order_of_views() {
        let clock = Clock::new(0.0, 0.1, 40.0);
        let peaks = |seed: u64| scattered_times(&clock, 50, 2.0, seed).peaks;
        let half = 0.5 * PEAK_RANGE * clock.duration_frames;
        let mut of_views = stream(3, Purpose::ViewOrder);
        let shared: Vec<f32> = (0..50)
            .map(|_| half * of_views.random_range(-1.0..=1.0_f32))
            .collect();
        assert!(peaks(3) != shared && peaks(3) != peaks(4));
        assert_eq!(peaks(3), peaks(3));
        assert!(peaks(3).iter().all(|peak| peak.abs() <= half));
    }
}
