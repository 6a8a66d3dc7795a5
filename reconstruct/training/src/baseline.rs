//! Baseline of all Gaussian methods: the schedule of 3DGS and ODGS, and first Gaussians at the points and in the
//! sky.

use std::collections::BTreeMap;

use omnilife_engine::{
    density::{DensifySettings, LatitudeOf, SizeUnit, Threshold},
    gaussians::static_gaussians::{self, InitialGaussians},
    model::Model,
    parameters::{
        ArrayShape,
        decay::Decay,
        memory,
        short_schedule::{Growth, LearningRate, ShortSchedule},
    },
    render::settings::{RenderSettings, RendererChoice},
    step::settings::TrainSettings,
};
use omnilife_schemas::records::ComponentDecision;

use crate::{
    error::ReconstructError,
    process,
    request::MethodRequest,
    scene::TrainingScene,
    seeds::{
        points,
        sky::{OpenSky, SKY_DIRECTIONS},
    },
};

/// Component: opacities are reset from time to time.
pub const OPACITY_RESET: &str = "opacity-reset";

/// Length of the published schedule, iterations.
pub(crate) const PUBLISHED_ITERATIONS: f64 = 30_000.0;

/// Larger steps in shorter schedules.
pub(crate) const SHORT_SCHEDULE: ShortSchedule = ShortSchedule {
    published_iterations: PUBLISHED_ITERATIONS,
};

/// Extent of the cameras in a normalized scene: 1.1 times their radius (3DGS `getNerfppNorm`).
pub const CAMERA_EXTENT: f32 = 1.1;

/// Iterations that opacities need to recover from a reset. At 0.05 per step, the way from 0.01 back to 1/2 takes
/// about 100 steps, and every view has to be seen some times.
const RESET_RECOVERY_ITERATIONS: u64 = 500;

/// Maximum factor between first scales and their median, so that duplicate and lonely points give neither dust
/// nor blankets.
const SCALE_SPREAD: f32 = 10.0;

/// Threshold of 3DGS. ODGS publishes 1e-4, for twice the Gaussians and more; with a limit on their
/// number the larger gradients come first anyway.
const GRADIENT_THRESHOLD: f32 = 2e-4;

/// Default maximum number of Gaussians per pixel of an input view: a Gaussian that covers fewer than two pixels
/// is not constrained by its views.
const GAUSSIANS_PER_PIXEL: f64 = 0.5;

/// Returns the published settings, scaled to a number of iterations, for a scene as large as the cameras' path.
/// Sources: ODGS `arguments/__init__.py`, 3DGS `arguments/__init__.py`.
pub fn published_settings(iterations: u64) -> TrainSettings {
    let scale = iterations as f64 / PUBLISHED_ITERATIONS;
    let scaled = |published: f64| ((published * scale).round() as u64).max(1);
    TrainSettings {
        iterations,
        budget_seconds: None,
        seed: 0,
        ssim_weight: 0.2,
        renderer: RendererChoice::Exact,
        rendering: RenderSettings {
            sh_degree: 0,
            ..RenderSettings::new(0.2)
        },
        sh_interval_iterations: scaled(1_000.0),
        learning_rates: learning_rates(CAMERA_EXTENT),
        short_schedule: None,
        densify: DensifySettings {
            begin_iteration: scaled(500.0),
            end_iteration: scaled(15_000.0),
            interval_iterations: scaled(100.0),
            opacity_reset_iterations: scaled(3_000.0),
            opacity_recovery_iterations: RESET_RECOVERY_ITERATIONS,
            gradient_threshold: Threshold::constant(GRADIENT_THRESHOLD),
            size_unit: SizeUnit::Length(CAMERA_EXTENT),
            clone_size: 0.01,
            prune_size: 0.1,
            prune_size_begin_iteration: scaled(3_000.0),
            prune_opacity: 0.005,
            maximum_gaussians: u64::MAX,
        },
        dynamics: None,
        deformation: None,
        objects: false,
        exposure: None,
        dropout: None,
        response: None,
        pose_refinement: None,
        shards: None,
        trace_every: None,
    }
}

/// Returns the step sizes for a scene of this extent, in normalized units. Sizes, which start far from their final
/// values, grow most in short schedules.
fn learning_rates(extent: f32) -> BTreeMap<String, LearningRate> {
    let positions = Decay {
        begin: 1.6e-4 * extent,
        end: 1.6e-6 * extent,
    };
    [
        ("positions", positions, Growth::LASTING),
        (
            "log_scales",
            Decay::constant(5e-3),
            Growth::exponents(1.5, 1.0),
        ),
        ("quaternions", Decay::constant(1e-3), Growth::SETTLING),
        ("opacity_logits", Decay::constant(0.05), Growth::SETTLING),
        ("sh_constant", Decay::constant(2.5e-3), Growth::SETTLING),
        ("sh_rest", Decay::constant(2.5e-3 / 20.0), Growth::SETTLING),
    ]
    .map(|(array, decay, growth)| (array.to_owned(), LearningRate::new(decay, growth)))
    .into()
}

/// Returns the published settings with the changes of this implementation.
pub fn settings(scene: &TrainingScene, request: &MethodRequest) -> TrainSettings {
    let published = published_settings(request.iterations);
    // Statistics over less than one epoch would miss views.
    let epoch = scene.input_views.len() as u64;
    let extent = scene_extent(scene);
    let without_resets = request.leaves_out(OPACITY_RESET)
        || published.densify.opacity_reset_iterations < RESET_RECOVERY_ITERATIONS;
    TrainSettings {
        budget_seconds: request.budget_seconds,
        seed: request.seed,
        rendering: RenderSettings {
            // The published 0.2 is in scene units; this is relative to the cameras' spacing.
            near: (0.01 * scene.median_camera_step()).clamp(1e-6, 0.2),
            footprint: request.options.footprint(),
            sh_degree: request
                .options
                .sh_degree()
                .unwrap_or(published.rendering.sh_degree),
            ..published.rendering
        },
        learning_rates: learning_rates(extent),
        densify: DensifySettings {
            interval_iterations: published.densify.interval_iterations.max(epoch.min(100)),
            opacity_reset_iterations: if without_resets {
                0
            } else {
                published.densify.opacity_reset_iterations
            },
            gradient_threshold: request.options.densify_threshold().map_or(
                published.densify.gradient_threshold,
                |[equator, pole]| Threshold {
                    equator,
                    pole,
                    latitude: LatitudeOf::AllViews,
                },
            ),
            size_unit: SizeUnit::Distance,
            prune_size: 0.5,
            prune_size_begin_iteration: 0,
            maximum_gaussians: request
                .options
                .maximum_gaussians()
                .unwrap_or_else(|| default_maximum(scene)),
            ..published.densify
        },
        trace_every: request.trace_every,
        ..published
    }
}

/// Returns the extent that position steps are relative to, normalized units. 3DGS scales them by the cameras'
/// radius, which is its scene's size. A video's cameras stand close together in a scene many times as large:
/// there it is the distance of the points.
pub fn scene_extent(scene: &TrainingScene) -> f32 {
    scene.median_point_distance().max(CAMERA_EXTENT)
}

/// Returns the most Gaussians for a scene; never fewer than its points. Points that were added do not count, so that
/// methods are compared under one limit.
pub fn default_maximum(scene: &TrainingScene) -> u64 {
    let pixels = f64::from(scene.camera.width()) * f64::from(scene.camera.height());
    let points = (scene.points.len() - scene.added_points + SKY_DIRECTIONS) as u64;
    ((GAUSSIANS_PER_PIXEL * pixels) as u64).max(points)
}

/// Checks a user's limit on the Gaussians, or on the memory, in advance. The default limit is a few Gaussians per
/// pixel, and many scenes stay below it. `other_bytes` is the memory that training needs beside them.
///
/// # Errors
/// When that many Gaussians do not fit into the memory that is left.
pub fn require_memory(
    request: &MethodRequest,
    settings: &TrainSettings,
    shapes: &[ArrayShape],
    other_bytes: u64,
) -> Result<(), ReconstructError> {
    let maximum = settings.densify.maximum_gaussians;
    if request.options.maximum_gaussians().is_some() || process::memory_limit().is_some() {
        let bytes = memory::training_bytes(maximum, shapes).saturating_add(other_bytes);
        process::require(bytes, &format!("training {maximum} Gaussians"))?;
    }
    Ok(())
}

/// Returns the scene's points that fit under the limit, evenly spread, and Gaussians at them.
pub(crate) fn gaussians_at_points(
    scene: &TrainingScene,
    room: usize,
) -> (Vec<usize>, InitialGaussians) {
    let indices = points::thinned_indices(&scene.points, room);
    let taken = points::selected(&scene.points, &indices);
    (indices, points::from_points(&taken, SCALE_SPREAD))
}

/// Returns a static model for any scene: Gaussians at its points and in its open sky.
pub(crate) fn static_model(scene: &TrainingScene, settings: &TrainSettings) -> Model {
    let maximum = settings.densify.maximum_gaussians;
    let sky = OpenSky::of(scene, maximum);
    let shell = if sky.is_worth_a_shell() {
        sky.shell(scene, None)
    } else {
        InitialGaussians::default()
    };
    let room = maximum.saturating_sub(shell.len() as u64);
    let (_, gaussians) = gaussians_at_points(scene, room as usize);
    let initial = points::join(gaussians, shell);
    static_gaussians::table(&initial, settings.rendering.sh_degree).into()
}

/// Decides on resets of opacities, with a reason.
pub(crate) fn reset_decision(
    settings: &TrainSettings,
    request: &MethodRequest,
) -> ComponentDecision {
    let resets = settings.densify.opacity_reset_iterations;
    ComponentDecision {
        component: OPACITY_RESET.to_owned(),
        used: resets > 0,
        reason: if resets > 0 {
            format!("every {resets} iterations, as published for {PUBLISHED_ITERATIONS}")
        } else if request.leaves_out(OPACITY_RESET) {
            "left out on request".to_owned()
        } else {
            format!(
                "a schedule of {} iterations leaves fewer than {RESET_RECOVERY_ITERATIONS} between \
                 resets",
                request.iterations
            )
        },
    }
}
