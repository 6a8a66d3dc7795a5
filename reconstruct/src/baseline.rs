//! What every Gaussian method begins with: the schedule of 3DGS and ODGS, and first Gaussians at the
//! points and in the sky.

use std::collections::BTreeMap;

use omnilife_engine::{
    density::{DensifySettings, LatitudeOf, SizeUnit, Threshold},
    gaussians::static_gaussians::InitialGaussians,
    parameters::{ArrayShape, decay::Decay, memory},
    render::settings::{RenderSettings, RendererChoice},
    step::settings::TrainSettings,
};
use omnilife_schemas::records::ComponentDecision;

use crate::{
    error::ReconstructError,
    process,
    request::MethodRequest,
    scene::TrainingScene,
    seeds::points::{self, SkyShell},
};

/// Component: a shell of Gaussians in directions without points.
pub(crate) const SKY_SHELL: &str = "sky-shell";

/// Component: opacities are set down now and then.
pub(crate) const OPACITY_RESET: &str = "opacity-reset";

/// Length of the published schedule, iterations.
pub(crate) const PUBLISHED_ITERATIONS: f64 = 30_000.0;

/// Directions in which open sky is looked for, where the number of Gaussians allows as many.
const SKY_DIRECTIONS: usize = 8_000;

/// Share of the sphere that must be open for a shell to be added.
const SKY_SHARE: f32 = 0.02;

/// The shell takes at most one of this many Gaussians.
const SKY_PART: u64 = 4;

/// Extent of the cameras in a normalized scene: 1.1 times their radius (3DGS `getNerfppNorm`).
pub(crate) const CAMERA_EXTENT: f32 = 1.1;

/// Iterations that opacities need to recover from a reset: at 0.05 per step, the way from 0.01 back
/// to 1/2 takes about 100 steps, and every view has to be seen some times.
const RESET_RECOVERY_ITERATIONS: u64 = 500;

/// First scales are kept within this factor of their median, so that duplicate and lonely points
/// give neither dust nor blankets.
const SCALE_SPREAD: f32 = 10.0;

/// Rows of a trace where none are asked for.
const TRACE_ROWS: u64 = 10;

/// Threshold of 3DGS. ODGS publishes 1e-4, for twice the Gaussians and more; with a limit on their
/// number the larger gradients come first anyway.
const GRADIENT_THRESHOLD: f32 = 2e-4;

/// Gaussians per pixel of an input view, at most, where the user sets no limit: a Gaussian that
/// covers fewer than two pixels is not held by its views.
const GAUSSIANS_PER_PIXEL: f64 = 0.5;

/// The published settings, scaled to a number of iterations, for a scene as large as the cameras'
/// path. Sources: ODGS `arguments/__init__.py`, 3DGS `arguments/__init__.py`.
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
        exposure: None,
        pose_refinement: None,
        trace_every: (iterations / TRACE_ROWS).max(1),
    }
}

/// Step sizes for a scene of this extent, in normalized units.
fn learning_rates(extent: f32) -> BTreeMap<String, Decay> {
    let positions = Decay {
        begin: 1.6e-4 * extent,
        end: 1.6e-6 * extent,
    };
    [
        ("positions", positions),
        ("log_scales", Decay::constant(5e-3)),
        ("quaternions", Decay::constant(1e-3)),
        ("opacity_logits", Decay::constant(0.05)),
        ("sh_constant", Decay::constant(2.5e-3)),
        ("sh_rest", Decay::constant(2.5e-3 / 20.0)),
    ]
    .map(|(array, decay)| (array.to_owned(), decay))
    .into()
}

/// The published settings with what this implementation does otherwise.
pub fn settings(scene: &TrainingScene, request: &MethodRequest) -> TrainSettings {
    let published = published_settings(request.iterations);
    // Statistics over less than one epoch would miss views.
    let epoch = scene.input_views.len() as u64;
    let extent = scene_extent(scene);
    let without_resets = is_left_out(request, OPACITY_RESET)
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
        trace_every: request.trace_every.unwrap_or(published.trace_every),
        ..published
    }
}

/// What position steps are relative to, normalized units. 3DGS scales them by the cameras' radius,
/// which is its scene's size. A video's cameras stand close together in a scene many times as large:
/// there it is the distance of the points.
pub fn scene_extent(scene: &TrainingScene) -> f32 {
    scene.median_point_distance().max(CAMERA_EXTENT)
}

fn is_left_out(request: &MethodRequest, component: &str) -> bool {
    request.without.iter().any(|name| name == component)
}

/// The most Gaussians for a scene; never fewer than its points.
pub(crate) fn default_maximum(scene: &TrainingScene) -> u64 {
    let pixels = f64::from(scene.camera.width) * f64::from(scene.camera.height);
    let points = (scene.points.len() + SKY_DIRECTIONS) as u64;
    ((GAUSSIANS_PER_PIXEL * pixels) as u64).max(points)
}

/// Checks the user's limit on the Gaussians at once: the default is a few per pixel. `other_bytes` are
/// what training needs beside them.
pub(crate) fn require_memory(
    request: &MethodRequest,
    settings: &TrainSettings,
    shapes: &[ArrayShape],
    other_bytes: u64,
) -> Result<(), ReconstructError> {
    let maximum = settings.densify.maximum_gaussians;
    if request.options.maximum_gaussians().is_some() {
        let bytes = memory::training_bytes(maximum, shapes).saturating_add(other_bytes);
        process::require(bytes, &format!("training {maximum} Gaussians"))?;
    }
    Ok(())
}

/// What a scene's training begins with, and why.
pub(crate) struct FirstGaussians {
    /// At the scene's points, thinned where there is no room for all.
    pub(crate) points: InitialGaussians,
    /// In the open sky.
    pub(crate) shell: InitialGaussians,
    pub(crate) plan: Vec<ComponentDecision>,
}

/// Gaussians at the points and in the sky of a scene; of the largest number, `reserved` are for
/// others.
pub(crate) fn first_gaussians(
    scene: &TrainingScene,
    settings: &TrainSettings,
    request: &MethodRequest,
    reserved: usize,
) -> FirstGaussians {
    let maximum = settings
        .densify
        .maximum_gaussians
        .saturating_sub(reserved as u64);
    let directions = SKY_DIRECTIONS.min((maximum / SKY_PART) as usize).max(1);
    let shell = points::sky_shell(scene, directions);
    let with_shell = shell.open_share() >= SKY_SHARE && !is_left_out(request, SKY_SHELL);
    let mut plan = vec![
        sky_decision(&shell, with_shell, request),
        reset_decision(settings, request),
    ];
    let shell = if with_shell {
        shell.gaussians
    } else {
        InitialGaussians::default()
    };
    let room = maximum.saturating_sub(shell.len() as u64);
    let points = points::thinned(&scene.points, room as usize);
    if points.len() < scene.points.len() {
        plan.push(ComponentDecision {
            component: "all-points".to_owned(),
            used: false,
            reason: format!(
                "{} of {} points, evenly spread: no more than {maximum} Gaussians are allowed",
                points.len(),
                scene.points.len()
            ),
        });
    }
    FirstGaussians {
        points: points::from_points(&points, SCALE_SPREAD),
        shell,
        plan,
    }
}

fn sky_decision(shell: &SkyShell, used: bool, request: &MethodRequest) -> ComponentDecision {
    let evidence = format!(
        "{:.1} % of {} directions have no point (limit {:.0} %)",
        100.0 * shell.open_share(),
        shell.directions,
        100.0 * SKY_SHARE
    );
    ComponentDecision {
        component: SKY_SHELL.to_owned(),
        used,
        reason: if is_left_out(request, SKY_SHELL) {
            format!("left out on request; {evidence}")
        } else {
            evidence
        },
    }
}

fn reset_decision(settings: &TrainSettings, request: &MethodRequest) -> ComponentDecision {
    let resets = settings.densify.opacity_reset_iterations;
    ComponentDecision {
        component: OPACITY_RESET.to_owned(),
        used: resets > 0,
        reason: if resets > 0 {
            format!("every {resets} iterations, as published for {PUBLISHED_ITERATIONS}")
        } else if is_left_out(request, OPACITY_RESET) {
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
