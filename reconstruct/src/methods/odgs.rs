//! ODGS: static Gaussians on the sphere, with the correct gradient.
//!
//! Source: Lee et al., "ODGS: 3D Scene Reconstruction from Omnidirectional Images with 3D Gaussian
//! Splattings", 2024, and its repository <https://github.com/esw0116/ODGS>.

use omnilife_engine::gaussians::static_gaussians;

use crate::{
    baseline::{OPACITY_RESET, SKY_SHELL, first_gaussians, require_memory, settings},
    error::ReconstructError,
    methods::{Method, MethodKind, PreparedGaussians},
    options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
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
                  scale with the iterations (no opacity resets below 5,000); sizes are relative \
                  to distance, position steps to the median distance of the points; the \
                  densification threshold is that of 3DGS (2e-4); the number of Gaussians is \
                  limited; open sky gets a shell of Gaussians.",
    components: &[SKY_SHELL, OPACITY_RESET],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Static Gaussians at the points and in the sky.
pub(crate) fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let settings = settings(scene, request);
    let shapes = static_gaussians::shapes(settings.rendering.sh_degree);
    require_memory(request, &settings, &shapes, 0)?;
    let first = first_gaussians(scene, &settings, request, 0);
    let initial = points::join(first.points, first.shell);
    let table = static_gaussians::table(&initial, settings.rendering.sh_degree);
    Ok(PreparedGaussians {
        model: table.into(),
        settings,
        plan: first.plan,
        remarks: Vec::new(),
    })
}
