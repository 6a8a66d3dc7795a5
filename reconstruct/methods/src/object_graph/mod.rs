//! Object graph: a static scene, and the Gaussians of each vehicle in coordinates that move with it.
//!
//! Source: Huang et al., "Dynamic Urban Scene Modeling with 3D Gaussian Splatting from UAV Full Motion Videos". It
//! trains 4DGF (Fischer et al., "Dynamic 3D Gaussian
//! Fields for Urban Areas", `NeurIPS` 2024) on tracks that it finds itself.

pub(crate) mod initial;
mod patches;
mod path_alignment;
mod refit;

use std::{fmt, mem::take};

use omnilife_engine::{
    gaussians::{
        static_gaussians,
        tracked::{self, OBJECT_POSES, OBJECT_POSITIONS, TrackedGaussians, TrackedObject},
    },
    model::{Model, Part},
    parameters::{
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
};
use omnilife_schemas::{records::Tracks, statistics::median};

use omnilife_training::{
    baseline::{OPACITY_RESET, require_memory},
    components::{
        Decision, Draft, camera_response, denser_points, draft::MotionEvidenceUse, dropout,
        exposure_compensation, pose_refinement, short_schedule, sky_shell, view_dependent_colour,
    },
    error::ReconstructError,
    method::{Method, MethodKind, ON_CPU_AND_GPU, PreparedGaussians, requirement::Requirement},
    models,
    options::{self, Constant, MethodOption},
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    seeds::points,
};

use self::path_alignment::PathSurvey;

/// The object graph.
pub const METHOD: Method = Method {
    id: "object-graph",
    title: "Object graph",
    source: "D. Huang et al., Dynamic Urban Scene Modeling with 3D Gaussian Splatting from UAV Full Motion \
             Videos, after T. Fischer et al., Dynamic 3D Gaussian Fields for Urban Areas, NeurIPS 2024",
    description: "Static Gaussians as odgs has them, and per tracked vehicle Gaussians that rest in \
                  its box and move with its path; trained together. On request path-alignment \
                  refits paths to where the images show their vehicles' patches, before training, and \
                  object-poses refines the paths further, by steps that reach some times the paths' error \
                  (pose-reach-errors); path-alignment measures the error, otherwise it is taken as a \
                  tenth of a vehicle's length; steps of 4DGF are for 30,000 iterations and more, and move \
                  paths by centimetres in a short run. \
                  Takes pinhole and ERP scenes; tracks come from `omnilife curate tracks`. Over a hovering \
                  camera's scene the ground is an assumed plane, and novel views from elsewhere show what \
                  stands on it flat. Departures \
                  from the paper and from 4DGF: colours are constants per Gaussian (SH degree 0) and no \
                  network predicts them; no codes for appearance or transients (one video has no use \
                  for them) and no deformation (vehicles are rigid); 1 - SSIM in the loss where the \
                  paper's Eq. 2 adds SSIM; paths come from a B-spline that is held to the detections \
                  (Eq. 1 as printed has the minimum 0 for any path); corrections of poses keep a mean \
                  of zero instead of a weight decay; Gaussians that leave their object's box are put \
                  back to its side instead of being pruned; no anti-aliasing factor; the black \
                  background of odgs, not a random one; what does not move is static, whatever found it; \
                  static Gaussians begin at the points that came with the poses, or at those of `omnilife \
                  curate dense`, and those of objects where pixels' rays enter their boxes; sizes of vehicles are the best \
                  of a grid of usual ones by their outlines, not extents of lifted pixels; motion finds nothing \
                  below 2 square metres, so people are left out; distances of vehicles are those of the ground around them, of a monocular \
                  network where somebody gives its estimates. Aids as odgs has them.",
    components: &[
        OBJECT_GRAPH,
        denser_points::ID,
        short_schedule::ID,
        sky_shell::ID,
        OPACITY_RESET,
    ],
    optional_components: &[
        path_alignment::ID,
        OBJECT_POSES_COMPONENT,
        exposure_compensation::ID,
        camera_response::ID,
        view_dependent_colour::ID,
        pose_refinement::ID,
        dropout::ID,
    ],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    requires: &[
        Requirement::Parallax,
        Requirement::DensePoints,
        Requirement::Tracks,
    ],
    options: &[
        options::MAX_GAUSSIANS,
        options::SH_DEGREE,
        options::FOOTPRINT,
        options::DENSIFY_THRESHOLD,
        POSE_REACH_OPTION,
    ],
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
pub(crate) const POSITION_RATE: Decay = Decay {
    begin: 1.6e-4,
    end: 1.6e-6,
};
/// Sum of the step sizes of a correction over a run, in errors of the paths: Adam's steps do not all go one way. It is
/// the same in a short run, where 4DGF's 1e-5 of the scene's extent is made for 30,000 iterations and more.
const POSE_REACH: f32 = 2.0;
/// [`POSE_REACH`] as an option.
const POSE_REACH_OPTION: MethodOption = MethodOption::number(
    (
        "pose-reach-errors",
        "greatest way of a path's corrections over the run, in errors of the paths; larger follows the images farther",
    ),
    [0.0, 100.0],
    "2",
    Constant {
        unit: "errors of the paths",
        source: "this project",
        component: Some(OBJECT_POSES_COMPONENT),
        is_weight: true,
    },
);
/// Maximum error of paths that corrections are made for, metres.
const LARGEST_ERROR_METRES: f64 = 0.5;
/// Error of paths that no patch tells, in lengths of the median vehicle: that of paths from detections.
const UNMEASURED_ERROR: f64 = 0.1;
/// Share of the first step size at the end (4DGF).
const POSE_END_SHARE: f32 = 0.1;
/// Least step size: a rate of 0 has no logarithm.
pub(crate) const LEAST_POSE_RATE: f32 = 1e-12;
/// Minimum number of detections of a path with more than one correction. The mean of all corrections is 0, so that
/// a single one stays 0.
const LEAST_DETECTIONS: u32 = 4;

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
    let survey =
        (uses_objects && request.names(path_alignment::ID)).then(|| PathSurvey::new(scene, tracks));
    let aligns = draft.decide(
        path_alignment::ID,
        of_alignment(tracks, survey.as_ref()).unless(draft.missing(OBJECT_GRAPH)),
    );
    let refit = survey.as_ref().filter(|_| aligns);
    let refit = refit.map(|survey| survey.refit(tracks));
    let tracks = refit.as_ref().unwrap_or(tracks);
    let error = PathError::new(
        tracks,
        survey.as_ref().and_then(|one| one.median_error(aligns)),
    );
    let refines = draft.decide(
        OBJECT_POSES_COMPONENT,
        of_poses(tracks, error)
            .unless(uncorrectable(tracks))
            .unless(draft.missing(OBJECT_GRAPH)),
    );
    let objects = if uses_objects {
        let limit = draft.settings.densify.maximum_gaussians;
        initial::objects(scene, tracks, limit, f64::INFINITY)
    } else {
        initial::FirstObjects::default()
    };
    draft.reserved = objects.gaussians.len() as u64;
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
        draft.settings.objects = true;
        let error = error.metres() / tracks.metres_per_unit * scene.normalization.scale;
        let pose_rate = pose_rate(scene, request, &objects.objects, error as f32);
        let rates = &mut draft.settings.learning_rates;
        let positions = LearningRate::new(POSITION_RATE, Growth::LASTING);
        rates.insert(OBJECT_POSITIONS.to_owned(), positions);
        // Its sum over a run is the same in every schedule.
        rates.insert(OBJECT_POSES.to_owned(), LearningRate::unchanged(pose_rate));
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

/// Decides on the refit of paths, by their alignment with the images.
fn of_alignment(tracks: &Tracks, survey: Option<&PathSurvey>) -> Decision {
    let Some(survey) = survey else {
        return Decision::on_request("its gain was measured on no flight");
    };
    let origin = if tracks.are_exact() {
        "the paths are exact; "
    } else {
        ""
    };
    if survey.refits() {
        Decision::on_request(&format!("{origin}{survey}"))
    } else {
        Decision::new(false, format!("no path is refit: {origin}{survey}")).settled()
    }
}

/// Error of the paths in use.
#[derive(Debug, Clone, Copy, PartialEq)]
enum PathError {
    /// Median distance of the vehicles in the images, metres.
    Measured(f64),
    /// Share of the median vehicle's length, metres.
    Assumed(f64),
}

impl PathError {
    /// Takes the measured error in metres, or that of paths from detections.
    fn new(tracks: &Tracks, measured_metres: Option<f64>) -> Self {
        let lengths = tracks.tracks.iter().map(|track| track.dimensions[0]);
        let length = median(&lengths.collect::<Vec<f64>>()).unwrap_or(0.0);
        measured_metres.map_or(
            Self::Assumed(UNMEASURED_ERROR * length * tracks.metres_per_unit),
            Self::Measured,
        )
    }

    /// Returns the error that corrections are made for, metres.
    fn metres(self) -> f64 {
        let (Self::Measured(metres) | Self::Assumed(metres)) = self;
        metres.min(LARGEST_ERROR_METRES)
    }
}

impl fmt::Display for PathError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Measured(error) | Self::Assumed(error)) = *self;
        write!(f, "made for {:.2} m", self.metres())?;
        if error > LARGEST_ERROR_METRES {
            write!(f, " of {error:.2} m")?;
        }
        match self {
            Self::Measured(_) => f.write_str(", by the vehicles' patches"),
            Self::Assumed(_) => write!(
                f,
                ", {UNMEASURED_ERROR} of a vehicle's length; path-alignment measures it"
            ),
        }
    }
}

/// Returns the step sizes of the corrections of paths, whose sum over the views of a path is [`POSE_REACH`] times
/// their error, normalized units.
fn pose_rate(
    scene: &TrainingScene,
    request: &MethodRequest,
    objects: &[TrackedObject],
    error: f32,
) -> Decay {
    let asked = request.options.number(&POSE_REACH_OPTION);
    let reach = asked.unwrap_or(POSE_REACH) * error;
    let is_on = |object: &TrackedObject, seconds: f64| {
        let [begin, end] = object.path.range_seconds();
        (begin..=end).contains(&seconds)
    };
    let pairs = objects.len() * scene.input_views.len();
    let on_paths = objects.iter().flat_map(|object| {
        let views = scene.input_views.iter();
        views.filter(|view| is_on(object, view.view.time_seconds))
    });
    let share = on_paths.count() as f32 / pairs.max(1) as f32;
    let steps = (request.iterations as f32 * share).max(1.0);
    // Mean of a rate that falls log-linearly, over the first.
    let mean = (1.0 - POSE_END_SHARE) / -POSE_END_SHARE.ln();
    let begin = (reach / (steps * mean)).max(LEAST_POSE_RATE);
    Decay {
        begin,
        end: POSE_END_SHARE * begin,
    }
}

/// Returns the requirement that no track meets, if no path can have a correction.
fn uncorrectable(tracks: &Tracks) -> Option<&'static str> {
    let mut tracks = tracks.tracks.iter();
    let is_correctable = tracks.any(|track| track.detections >= LEAST_DETECTIONS);
    (!is_correctable).then_some("a track of four detections")
}

/// Returns the decision on refining paths, with their origin.
fn of_poses(tracks: &Tracks, error: PathError) -> Decision {
    let origin = match tracks.detector() {
        _ if tracks.are_exact() => "the paths are exact".to_owned(),
        Some(method) => format!("the paths come from detections ({method})"),
        None => "nothing is said of how the paths were found".to_owned(),
    };
    Decision::on_request(&format!(
        "it moved as many paths from the truth as towards it; {origin}; corrections are {error}"
    ))
}
