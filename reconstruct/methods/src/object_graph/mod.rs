//! Object graph: a static scene, and the Gaussians of each vehicle in coordinates that move with it.
//!
//! Source: "Dynamic urban scenes from UAV video" (S2). It trains 4DGF (Fischer et al., "Dynamic 3D Gaussian
//! Fields for Urban Areas", `NeurIPS` 2024) on tracks that it finds itself.

mod initial;

use std::mem::take;

use omnilife_engine::{
    gaussians::{
        static_gaussians,
        tracked::{self, OBJECT_POSES, OBJECT_POSITIONS, TrackedGaussians},
    },
    model::{Model, Part},
    parameters::{
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
};
use omnilife_schemas::records::Tracks;

use omnilife_training::{
    baseline::{self, OPACITY_RESET, require_memory},
    components::{
        Decision, Draft, aids, denser_points, draft::MotionEvidenceUse, short_schedule, sky_shell,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU, PreparedGaussians, requirement::Requirement},
    models, options,
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
};

/// The object graph.
pub const METHOD: Method = Method {
    id: "object-graph",
    title: "Object graph",
    source: "Dynamic urban scenes from UAV video (S2), after T. Fischer et al., Dynamic 3D Gaussian \
             Fields for Urban Areas, NeurIPS 2024",
    description: "Static Gaussians as odgs has them, and per tracked vehicle Gaussians that rest in \
                  its box and move with its path; trained together, poses of the objects refined. \
                  Takes pinhole and ERP scenes; tracks come from `omnilife curate tracks`. Departures \
                  from the paper and from 4DGF: colours are constants per Gaussian (SH degree 0) and no \
                  network predicts them; no codes for appearance or transients (one video has no use \
                  for them) and no deformation (vehicles are rigid); 1 - SSIM in the loss where the \
                  paper's Eq. 2 adds SSIM; paths come from a B-spline that is held to the detections \
                  (Eq. 1 as printed has the minimum 0 for any path); corrections of poses keep a mean \
                  of zero instead of a weight decay; Gaussians that leave their object's box are put \
                  back to its side instead of being pruned; no anti-aliasing factor; the black \
                  background of odgs, not a random one; what does not move is static, whatever found it; \
                  static Gaussians begin at the points that came with the poses, or at those of `omnilife \
                  curate dense`; distances of vehicles are those of the ground around them, of a monocular \
                  network where somebody gives its estimates. Aids as odgs has them.",
    components: &[
        OBJECT_GRAPH,
        OBJECT_POSES_COMPONENT,
        denser_points::ID,
        short_schedule::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: aids::ON_REQUEST,
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU,
    requires: &[
        Requirement::Parallax,
        Requirement::DensePoints,
        Requirement::Tracks,
    ],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::None,
        model: &models::objects::OBJECT_GRAPH,
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Component: vehicles that move have Gaussians of their own; without it the method is odgs.
const OBJECT_GRAPH: &str = "object-graph";
/// Component: the paths of the objects are refined with their Gaussians.
const OBJECT_POSES_COMPONENT: &str = "object-poses";

/// Step sizes of centres in the objects' coordinates (4DGF, that of 3DGS).
const POSITION_RATE: Decay = Decay {
    begin: 1.6e-4,
    end: 1.6e-6,
};
/// Step sizes of the corrections of poses, relative to the scene's extent (4DGF).
const POSE_RATE: Decay = Decay {
    begin: 1e-5,
    end: 1e-6,
};

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    _: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let tracks = scene
        .tracks
        .as_ref()
        .ok_or_else(|| ReconstructError::Request {
            reason: format!(
                "{}: {} has no tracks beside its split; `omnilife curate tracks` makes them",
                METHOD.id, scene.id
            ),
        })?;
    let mut draft = Draft::new(scene, request, METHOD.supported(), METHOD.motion())?;
    let uses_objects = draft.decide(OBJECT_GRAPH, of_tracks(tracks));
    let refines = draft.decide(
        OBJECT_POSES_COMPONENT,
        of_poses(tracks).unless(draft.missing(OBJECT_GRAPH)),
    );
    let objects = if uses_objects {
        initial::objects(scene, tracks)
    } else {
        initial::FirstObjects::default()
    };
    draft.add_components();
    let degree = draft.settings.rendering.sh_degree;
    let initial = points::join(take(&mut draft.points), take(&mut draft.fixed));
    let mut parts = vec![Part::new(
        static_gaussians::StaticGaussians,
        static_gaussians::table(&initial, degree),
    )];
    require_memory(
        request,
        &draft.settings,
        &static_gaussians::shapes(degree),
        0,
    )?;
    if !objects.objects.is_empty() {
        let extent = baseline::scene_extent(scene);
        let pose_rate = Decay {
            begin: POSE_RATE.begin * extent,
            end: POSE_RATE.end * extent,
        };
        draft.settings.objects = true;
        let rates = &mut draft.settings.learning_rates;
        for (array, decay, growth) in [
            (OBJECT_POSITIONS, POSITION_RATE, Growth::LASTING),
            (OBJECT_POSES, pose_rate, Growth::EVEN),
        ] {
            rates.insert(array.to_owned(), LearningRate::new(decay, growth));
        }
        let table = tracked::table(&objects.gaussians, &objects.numbers);
        parts.push(Part::new(
            TrackedGaussians::new(objects.objects, refines),
            table,
        ));
    }
    let mut prepared = PreparedGaussians::new(draft, Model::new(parts));
    let warnings = &mut prepared.findings.warnings;
    warnings.extend(objects.warnings);
    warnings.extend(scene.held_out_tracks());
    Ok(prepared)
}

/// Decides on Gaussians for moving objects, by the tracks.
fn of_tracks(tracks: &Tracks) -> Decision {
    let moving = tracks.tracks.len();
    let reason = if moving == 0 {
        "no vehicle that was tracked moves".to_owned()
    } else {
        let detections: u32 = tracks.tracks.iter().map(|track| track.detections).sum();
        format!("{moving} vehicles move, by {detections} detections")
    };
    let decision = Decision::new(moving > 0, reason);
    // Without moving objects a plan has nothing to use.
    if moving == 0 {
        decision.settled()
    } else {
        decision
    }
}

/// Decides on refining paths: paths are as good as their inputs.
fn of_poses(tracks: &Tracks) -> Decision {
    let detector = tracks.stages.iter().find(|stage| stage.stage == "detector");
    match detector {
        Some(stage) if stage.method == "exact" => Decision::new(false, "the paths are exact"),
        Some(stage) => Decision::new(
            true,
            format!("the paths come from detections ({})", stage.method),
        ),
        None => Decision::new(true, "nothing is said of how the paths were found"),
    }
}
