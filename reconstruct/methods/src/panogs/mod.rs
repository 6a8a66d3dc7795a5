//! PanoGS: Gaussians on surfaces, from a few panoramas with distances.
//!
//! Source: "PanoGS" (see [`METHOD`]); its equations stand beside their code.
//!
//! * `depth_refinement`: distances with fewer pixels on the image's grid.
//! * `samples`: views agree on scales, pixels become Gaussians, and the finest view's stay; `manifest`: their
//!   record.
//! * `surface`: the scaffold (Eq. 9), on request. `anchored`: trained parameters; `shards`: the part that trains at
//!   a time; `neighbour_views`: its views.
//!
//! Sources of distances, lift, normals, scales and redundancy themselves are in [`omnilife_training::seeds::depth`]:
//! any method can start there.

mod anchored;
mod depth_refinement;
mod manifest;
mod neighbour_views;
mod samples;
mod shards;
mod surface;

use std::sync::Arc;

use omnilife_engine::{
    density,
    gaussians::static_gaussians::{
        self, InitialGaussians, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT,
        StaticGaussians,
    },
    model::{Model, Part},
    parameters::{
        ArrayShape,
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
    step::{memory::StepMemory, settings::TrainSettings},
};

use self::{
    anchored::{Anchored, CentreRefinement, ScaffoldLoss, ScaffoldWeight},
    samples::Samples,
    shards::Sharding,
    surface::Surface,
};
use omnilife_training::{
    baseline,
    components::{Decision, DecisionLog, MotionEvidenceUse, short_schedule, sky_shell},
    error::ReconstructError,
    method::{Findings, Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians},
    models,
    options::{self, Constant, MethodOption, Options},
    process,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
};

/// Component: one factor per view on its distances.
pub const DEPTH_SCALE: &str = "depth-scale";
/// Component: distances on a coarser grid than the image's are upsampled along the image's edges.
pub const DEPTH_REFINEMENT: &str = "depth-refinement";
/// Component: pixels near the poles of panoramas, which crowd, are thinned out.
pub const POLE_THINNING: &str = "pole-thinning";
/// Component: where several views see a surface, the finest view's sample stays.
pub const REDUNDANT_SAMPLES: &str = "redundant-samples";
/// Component: opacities and colours are trained.
pub const WARM_START: &str = "warm-start";
/// Component: centres are trained, late, slowly and within half a radius of their first positions.
pub const CENTRE_REFINEMENT: &str = "centre-refinement";
/// Component: a loss keeps centres near the fused surface of all views.
pub const SCAFFOLD: &str = "scaffold";
/// Component: sizes and rotations are trained too; not in the paper.
pub const SHAPE_REFINEMENT: &str = "shape-refinement";
/// Component: one shard of the Gaussians after another trains on a render of all.
pub const SHARDS: &str = "shards";
/// Component: a shard trains on the views near its own cameras alone.
pub const NEIGHBOUR_VIEWS: &str = "neighbour-views";

/// PanoGS.
pub const METHOD: Method = Method {
    id: "panogs",
    title: "PanoGS",
    source: "PanoGS: from RGB-D panoramas to Gaussian scenes for the web (paper without public code)",
    description: "One flat Gaussian per pixel with a known distance, on the surface that it shows; \
                  opacities, colours, sizes and rotations learn, centres late and little. Distances come from \
                  `curate poses --depth-prior`, or from the sphere sweep of neighbouring views. \
                  Departures from the paper: its mirrored frame and W-1 grid are converted on import; \
                  radii are roots of areas, not distances of neighbours, and poles are thinned; views \
                  agree on scales, and of what several see the finest sample stays; the exact ERP \
                  projection replaces its soft footprint; TSDF distances are point-to-plane; FRED, its \
                  depth network, is not public and is replaced by an upsampling along the image's edges; \
                  the scaffold is left to a request, in a form that acts (--with scaffold), because the \
                  printed one, a mean over all Gaussians, is too small to (--set scaffold-form=mean); \
                  sizes and rotations learn, where the paper keeps them (--without shape-refinement); \
                  shards do not learn independently, each against images that others fill, but one after \
                  another from a drawing of all, with the gradients of the whole scene. Aid: larger steps in \
                  short schedules; its samples stand for denser points.",
    components: &[
        DEPTH_SCALE,
        DEPTH_REFINEMENT,
        POLE_THINNING,
        REDUNDANT_SAMPLES,
        sky_shell::ID,
        WARM_START,
        CENTRE_REFINEMENT,
        SHAPE_REFINEMENT,
        SHARDS,
        NEIGHBOUR_VIEWS,
        short_schedule::ID,
    ],
    optional_components: &[SCAFFOLD],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: &[
        options::MAX_GAUSSIANS,
        options::FOOTPRINT,
        options::SHARDS,
        CENTRE_STEP_OPTION,
        SCAFFOLD_WEIGHT_OPTION,
        SCAFFOLD_FORM,
    ],
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::None,
        model: &models::gaussians::GAUSSIANS,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Position steps over those of 3DGS.
const CENTRE_STEP: f32 = 0.1;
/// [`CENTRE_STEP`] as an option.
const CENTRE_STEP_OPTION: MethodOption = MethodOption::number(
    ("centre-step", "size of the steps of the centres"),
    [0.0, 100.0],
    "0.1",
    Constant {
        unit: "of the step size of 3DGS",
        source: "PanoGS, Section 3.4",
        component: Some(CENTRE_REFINEMENT),
        is_weight: false,
    },
);
/// Share of the iterations after which centres start to move.
const CENTRES_BEGIN: f64 = 0.3;
/// Maximum distance of centres from their first positions, in radii of their samples.
const CENTRE_REACH: f32 = 0.5;
/// Weight of the scaffold's loss: a centre that is a radius of its sample off the surface costs as much as an error
/// of 0.1 in one pixel.
const SCAFFOLD_WEIGHT: f32 = 0.1;
/// [`SCAFFOLD_WEIGHT`] as an option.
const SCAFFOLD_WEIGHT_OPTION: MethodOption = MethodOption::number(
    (
        "scaffold-weight",
        "weight of the loss on distances from the fused surface",
    ),
    [0.0, 100.0],
    "0.1",
    Constant {
        unit: "of the photometric loss",
        source: "PanoGS, Eq. 9",
        component: Some(SCAFFOLD),
        is_weight: true,
    },
);
/// Sum over the centres.
const SCAFFOLD_FORM: MethodOption = MethodOption::form(
    (
        "scaffold-form",
        "that loss: each Gaussian in the image, in radii of its sample, counts as one pixel; or a mean over all, \
         in scene units, as printed, which is too small to act",
    ),
    &["seen", "mean"],
    "PanoGS, Eq. 9",
    SCAFFOLD,
);

/// Arrays that are trained, and the losses of centres.
struct TrainedArrays {
    /// Arrays that keep their values.
    frozen: Vec<usize>,
    centres_move: bool,
    surface: Option<Surface>,
}

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let mut plan = DecisionLog::new(request);
    let mut samples = Samples::of(scene, &mut plan)?;
    let count = samples.gaussians.len() as u64;
    let learning = learning(&samples, &mut plan);
    let mut settings = settings(scene, request, &samples.gaussians);
    short_schedule::decide_for(&mut settings, &mut plan);
    let shapes = static_gaussians::shapes(0);
    let learns = |(array, _): &(usize, &ArrayShape)| !learning.frozen.contains(array);
    let learns = shapes.iter().enumerate().filter(learns);
    let learns: Vec<&str> = learns.map(|(_, shape)| shape.name).collect();
    let memory = StepMemory::of(&shapes, &learns);
    let sharding = Sharding::of(
        scene,
        &samples,
        memory,
        (settings.rendering, backend),
        &mut plan,
    );
    let largest = sharding.as_ref().map(Sharding::largest);
    let differentiated = match backend {
        BackendChoice::Cpu => largest.map_or(count, |len| len as u64),
        // Gradients are in the device's memory.
        BackendChoice::Gpu => 0,
    };
    let bytes = memory.bytes(count, differentiated);
    process::require(bytes, &format!("training {count} Gaussians"))?;
    let model = model(
        (scene, &request.options),
        &mut samples,
        &settings,
        learning,
        sharding.as_ref(),
    );
    settings.shards = sharding.map(Sharding::settings);
    Ok(PreparedGaussians {
        model,
        settings,
        findings: Findings {
            plan: plan.into_decisions(),
            evidence: None,
            lift: Some(samples.record),
            warnings: samples.warnings,
        },
    })
}

/// Returns the settings of 3DGS without density control, with steps of centres that are a tenth as long.
fn settings(
    scene: &TrainingScene,
    request: &MethodRequest,
    gaussians: &InitialGaussians,
) -> TrainSettings {
    let mut settings = baseline::settings(scene, request);
    settings.densify.begin_iteration = u64::MAX;
    settings.densify.opacity_reset_iterations = 0;
    settings.densify.maximum_gaussians = gaussians.len() as u64;
    let mut distances: Vec<f32> = gaussians
        .positions
        .iter()
        .map(|&position| glam::Vec3::from_array(position).length())
        .collect();
    distances.sort_by(f32::total_cmp);
    let median = distances.get(distances.len() / 2).copied().unwrap_or(0.0);
    let extent = median.max(baseline::CAMERA_EXTENT);
    let share = request.options.number(&CENTRE_STEP_OPTION);
    let step = Decay::constant(share.unwrap_or(CENTRE_STEP) * 1.6e-4 * extent);
    let step = LearningRate::new(step, Growth::SETTLING);
    settings.learning_rates.insert("positions".to_owned(), step);
    settings
}

/// Decides on the trained parameters.
fn learning(samples: &Samples, plan: &mut DecisionLog<'_>) -> TrainedArrays {
    let warms_up = plan.decide(
        WARM_START,
        Decision::new(
            true,
            "Gaussians of one view each have never been drawn together",
        ),
    );
    let centres_move = plan.decide(CENTRE_REFINEMENT, samples.centre_decision());
    let surface = surface(samples, plan, centres_move);
    let changes_shapes = plan.decide(
        SHAPE_REFINEMENT,
        Decision::new(
            true,
            "samples are as large as their pixels, not as what these show; PanoGS keeps that",
        ),
    );
    let mut frozen = Vec::new();
    if !warms_up {
        frozen.extend([OPACITY_LOGITS, SH_CONSTANT]);
    }
    if !changes_shapes {
        frozen.extend([LOG_SCALES, QUATERNIONS]);
    }
    if !centres_move {
        frozen.push(POSITIONS);
    }
    TrainedArrays {
        frozen,
        centres_move,
        surface,
    }
}

/// Makes the Gaussians with their trained part: one part, or one for each shard.
fn model(
    (scene, options): (&TrainingScene, &Options),
    samples: &mut Samples,
    settings: &TrainSettings,
    learning: TrainedArrays,
    sharding: Option<&Sharding>,
) -> Model {
    let gaussians = std::mem::take(&mut samples.gaussians);
    let all = gaussians.len();
    let static_part = |gaussians: &InitialGaussians| {
        let mut table = static_gaussians::table(gaussians, 0);
        for &array in &learning.frozen {
            table.freeze(array);
        }
        Part::new(StaticGaussians, table)
    };
    let mut model = Model::new(match sharding {
        None => vec![static_part(&gaussians)],
        Some(sharding) => {
            let shards = sharding.members.iter();
            let part = |members: &Vec<usize>| static_part(&gaussians.selected(members));
            shards.map(part).collect()
        }
    });
    drop(gaussians);
    density::order::along_sphere(&mut model, &scene.input_views);
    let scaffold = learning.surface.map(|surface| ScaffoldLoss {
        field: Arc::new(surface.field),
        weight: scaffold_weight(scene, options, all),
    });
    let anchored = |part: Part| {
        let table = part.table;
        let refinement = learning.centres_move.then(|| {
            let positions = table.arrays[POSITIONS].values.as_chunks::<3>().0;
            let scales = table.arrays[LOG_SCALES].values.as_chunks::<3>().0;
            let reach = |log_scales: &[f32; 3]| {
                CENTRE_REACH * log_scales[0].exp() / samples.shape.tangential
            };
            CentreRefinement {
                anchors: Arc::new(positions.to_vec()),
                reach: Arc::new(scales.iter().map(reach).collect()),
                begin_iteration: (CENTRES_BEGIN * settings.iterations as f64) as u64,
                scaffold: scaffold.clone(),
            }
        });
        Part::new(Anchored { refinement }, table)
    };
    Model::new(model.parts.into_iter().map(anchored).collect())
}

/// Returns the weight of the scaffold's loss on one of so many centres.
fn scaffold_weight(scene: &TrainingScene, options: &Options, all: usize) -> ScaffoldWeight {
    let asked = options.number(&SCAFFOLD_WEIGHT_OPTION);
    let weight = asked.unwrap_or(SCAFFOLD_WEIGHT);
    if options.word(&SCAFFOLD_FORM) == Some("mean") {
        return ScaffoldWeight::Mean(weight / all.max(1) as f32);
    }
    let [width, height] = scene.camera.size();
    ScaffoldWeight::Seen(weight * CENTRE_REACH / (width * height) as f32)
}

/// Returns the fused surface, where it is asked for. What it costs in planning is not spent without that.
fn surface(samples: &Samples, plan: &mut DecisionLog<'_>, centres_move: bool) -> Option<Surface> {
    let missing = match (samples.views.len(), centres_move) {
        (0 | 1, _) => Some("a second view"),
        (_, false) => Some("centres that move"),
        _ => None,
    };
    if missing.is_some() || !plan.request.names(SCAFFOLD) {
        let reason = "the published mean over all Gaussians is too small to act; not fused";
        plan.decide(SCAFFOLD, Decision::on_request(reason).unless(missing));
        return None;
    }
    let surface = Surface::of(samples);
    plan.decide(SCAFFOLD, surface.decision()).then_some(surface)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_in_the_list_are_those_of_a_run() {
        for (option, usual) in [
            (CENTRE_STEP_OPTION, CENTRE_STEP),
            (SCAFFOLD_WEIGHT_OPTION, SCAFFOLD_WEIGHT),
        ] {
            assert_eq!(option.default.parse(), Ok(usual), "{}", option.id);
        }
    }
}
