//! ODGS as its authors published it, defects included: for comparison only.
//!
//! Source: <https://github.com/esw0116/ODGS>, `train.py`, `arguments/__init__.py`,
//! `scene/gaussian_model.py` and its rasterizer (see [`omnilife_engine::render::published`]).

use omnilife_schemas::records::ComponentDecision;

use crate::odgs;
use omnilife_engine::{
    camera::Camera,
    density::{DensifySettings, LatitudeOf, SizeUnit, Threshold},
    gaussians::static_gaussians,
    render::settings::{RenderSettings, RendererChoice},
    step::settings::TrainSettings,
};
use omnilife_training::{
    baseline::{CAMERA_EXTENT, default_maximum, published_settings},
    components::MotionEvidenceUse,
    error::ReconstructError,
    method::{Findings, Method, MethodKind, ON_CPU, PreparedGaussians},
    models, options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
};

/// ODGS as published.
pub const METHOD: Method = Method {
    id: "odgs-published",
    title: "ODGS (as published)",
    source: odgs::METHOD.source,
    description: "For comparison only. Reproduces what the published code does: gradients by \
                  centres, scales and rotations that are not those of the image, pixels at their \
                  corners, footprints cut at the seam, 100 world units added to the scene's \
                  extent, near limit of 0.2 world units, threshold 1e-4 with the latitude of the \
                  last view, SH degree 0. Not reproduced: the end of footprints at tiles within 3 \
                  standard deviations, an SSIM window that ends at the seam, and growth without a \
                  limit (that of odgs holds). Its rates are the published ones in any schedule, and it \
                  can have no aid: the row beside it is odgs-without-aids.",
    components: &[],
    optional_components: &[],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU,
    requires: &[],
    options: &[options::MAX_GAUSSIANS, options::DENSIFY_THRESHOLD],
    kind: MethodKind::Trained {
        extent: CameraExtent::Farthest,
        motion: MotionEvidenceUse::None,
        model: &models::gaussians::GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Threshold of ODGS `arguments/__init__.py`, the same at equator and poles.
const GRADIENT_THRESHOLD: f32 = 1e-4;
/// Added to the cameras' extent before sizes are compared with it, world units (ODGS `train.py`).
const ADDED_EXTENT: f64 = 100.0;
/// Minimum distance of visible Gaussians, world units (ODGS `forward.cu`).
const NEAR: f64 = 0.2;
/// Least mean squared distance to the nearest neighbours, square world units (3DGS
/// `scene/gaussian_model.py`).
const LEAST_SQUARED_DISTANCE: f64 = 1e-7;

fn settings(scene: &TrainingScene, request: &MethodRequest) -> TrainSettings {
    let published = published_settings(request.iterations);
    let unit = scene.normalization.scale;
    let [equator, pole] = request
        .options
        .densify_threshold()
        .unwrap_or([GRADIENT_THRESHOLD; 2]);
    TrainSettings {
        budget_seconds: request.budget_seconds,
        seed: request.seed,
        renderer: RendererChoice::OdgsPublished,
        rendering: RenderSettings {
            near: (NEAR * unit) as f32,
            ..published.rendering
        },
        densify: DensifySettings {
            gradient_threshold: Threshold {
                equator,
                pole,
                latitude: LatitudeOf::LastView,
            },
            opacity_recovery_iterations: 0,
            size_unit: SizeUnit::Length(CAMERA_EXTENT + (ADDED_EXTENT * unit) as f32),
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

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let refuse = |reason: &str| {
        Err(ReconstructError::Request {
            reason: format!("{}: {reason}", METHOD.id),
        })
    };
    match scene.camera {
        Camera::Erp(_) => {}
        Camera::Pinhole(_) => {
            return refuse("draws ERP images, and the scene's camera is a pinhole");
        }
    }
    if scene.points.is_empty() {
        return refuse("starts from points, and the scene has none");
    }
    let settings = settings(scene, request);
    let maximum = settings.densify.maximum_gaussians;
    let points = points::thinned(&scene.points, maximum as usize);
    let mut initial = points::from_points(&points, f32::INFINITY);
    let least = (LEAST_SQUARED_DISTANCE.sqrt() * scene.normalization.scale) as f32;
    for scale in &mut initial.scales {
        *scale = scale.map(|scale| scale.max(least));
    }
    let plan = vec![ComponentDecision {
        component: "all-points".to_owned(),
        used: points.len() == scene.points.len(),
        reason: format!("{} of {} points", points.len(), scene.points.len()),
    }];
    Ok(PreparedGaussians {
        model: static_gaussians::table(&initial, 0).into(),
        settings,
        findings: Findings {
            plan,
            ..Findings::default()
        },
    })
}
