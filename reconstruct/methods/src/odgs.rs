//! ODGS: static Gaussians on the sphere, with the correct gradient.
//!
//! Source: Lee et al., "ODGS: 3D Scene Reconstruction from Omnidirectional Images with 3D Gaussian
//! Splattings", 2024, and its repository <https://github.com/esw0116/ODGS>.

use std::mem::take;

use omnilife_engine::gaussians::static_gaussians;

use omnilife_training::{
    baseline::{OPACITY_RESET, require_memory},
    components::{
        Draft, aids, denser_points, draft::MotionEvidenceUse, short_schedule, sky_shell,
        swept_points,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models, options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
};

/// ODGS.
pub const METHOD: Method = Method {
    id: "odgs",
    title: "ODGS (corrected)",
    source: "S. Lee et al., ODGS: 3D Scene Reconstruction from Omnidirectional Images with 3D \
             Gaussian Splattings, NeurIPS 2024",
    description: "Static Gaussians under the ERP Jacobian with exact gradients, footprints that \
                  wrap around the seam, half-pixel centres and SH degree 0. Departures: schedules \
                  scale with the iterations (no opacity resets below 5,000, densification once an \
                  epoch at most); sizes are relative to the distance from the nearest camera, and \
                  those above half of it are pruned from the beginning; before each step the axes of \
                  Gaussians that its view would leave out for their size are cut to that half; \
                  first sizes stay within a \
                  factor of 10 of their median; position steps are relative to the median distance \
                  of the points, the near limit to the cameras' steps; SSIM wraps around the seam; \
                  the densification threshold is that of 3DGS (2e-4); the number of Gaussians is \
                  limited; open sky gets a shell of Gaussians; a scene without points \
                  begins with those of a spherical sweep. Aids: denser points, and larger steps in \
                  short schedules; --without short-schedule has the published rates.",
    components: &[
        swept_points::ID,
        denser_points::ID,
        short_schedule::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: aids::ON_REQUEST,
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::None,
        model: &models::gaussians::GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Prepares static Gaussians at the points and in the sky.
fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let supported = METHOD.supported();
    let mut draft = Draft::new(scene, request, supported, METHOD.motion())?;
    draft.add_components();
    let degree = draft.settings.rendering.sh_degree;
    let shapes = static_gaussians::shapes(degree);
    require_memory(request, &draft.settings, &shapes, 0)?;
    let initial = points::join(take(&mut draft.points), take(&mut draft.fixed));
    let model = static_gaussians::table(&initial, degree).into();
    Ok(PreparedGaussians::new(draft, model))
}
