//! Camera poses of a sequence: given by the user, or found by structure from motion.
//!
//! [`pose_sequence`] turns `sequence.json` into `scene.json`, with further files for known data. These are
//! `points.ply`, `masks/` of moving content, `ignore/` of pixels outside the scene, `depth/` of distances, `classes/`
//! of masks of classes, and `depth-prior/` of depth priors.

pub(crate) mod agreement;
mod attach;
pub mod colmap;
pub(crate) mod colmap_binary;
pub(crate) mod colmap_frames;
mod colmap_text;
mod entered_masks;
pub mod frame_camera;
mod frame_list;
mod frame_programs;
pub mod given;
mod ground_scale;
mod hovering;
mod ignored;
pub mod lens;
pub mod level;
pub(crate) mod masks;
pub mod matrices;
mod parallax;
mod planar_ground;
mod prior;
mod saturated;
pub mod sfm;
mod straight_frames;
mod truth;
mod tum;
pub(crate) mod turns;
mod unfinished;
pub mod validate;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    layout::{POINTS_FILE, SCENE_FILE, SEQUENCE_FILE},
    ownership::NameState,
    points::PointCloud,
    progress::Progress,
    records::{PoseConvention, PoseSource, PoseValidation, Scale, Scene, SceneFrame, Sequence},
    stage::{StageOutputs, StagePlan},
    staging::Staging,
    store,
};

use crate::{edited_frames::with_edited_frames, error::CurateError};
pub use attach::{AttachRequest, attach};
pub use entered_masks::{MasksEntry, enter_masks};
use frame_camera::FrameCamera;
use frame_list::FrameList;
pub use frame_programs::{FrameCommand, FramePrograms, MaskProgram, PriorProgram};
pub use ground_scale::GroundScale;
pub use ignored::IgnoredRegion;
pub use prior::GivenPrior;
pub use sfm::SfmSettings;
use truth::TruthFiles;
pub use truth::{GivenDepth, GivenTruth};
pub use validate::ValidationLimits;

/// Name of the stage in the sequence's folder.
const STAGE: &str = "poses";

/// Source of the poses of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub enum PoseRequest {
    /// A `poses.json` (`omnilife/poses/2`), a folder with a COLMAP model, a TUM trajectory (`.txt`), or matrices as
    /// `.npy` ([`matrices`]).
    Given(PathBuf),
    /// Structure from motion.
    Sfm(SfmSettings),
}

impl PoseRequest {
    /// Checks the files that it names, as far as possible without a sequence; `convention` is that of matrices. The
    /// installation of structure from motion is not checked: existing poses need none.
    ///
    /// # Errors
    /// When one is missing or malformed.
    pub fn check_files(&self, convention: Option<PoseConvention>) -> Result<(), CurateError> {
        match self {
            Self::Given(path) => given::check(path, convention),
            Self::Sfm(settings) => settings.masks.as_deref().map_or(Ok(()), refuse_missing),
        }
    }
}

/// Reads given poses of the frames of a scene, with lines on their problems; `convention` is that of matrices.
///
/// # Errors
/// When the files are missing or malformed, or fit no frame.
pub(crate) fn poses_of_scene(
    path: &Path,
    convention: Option<PoseConvention>,
    scene: &Scene,
) -> Result<(Vec<Option<Pose>>, Vec<String>), CurateError> {
    refuse_missing(path)?;
    let read = given::read(path, convention, &FrameList::of_scene(scene, None))?;
    Ok((read.poses, read.validation.problems))
}

/// Refuses a missing file or folder.
fn refuse_missing(path: &Path) -> Result<(), CurateError> {
    if path.exists() {
        return Ok(());
    }
    Err(CurateError::input(path, "does not exist"))
}

/// Poses of a sequence's frames, before they are written as a scene.
#[derive(Debug, Clone)]
pub(crate) struct PosedSequence {
    /// The camera of the frames, at their size.
    pub(crate) camera: FrameCamera,
    /// One entry per frame of the sequence.
    pub(crate) poses: Vec<Option<Pose>>,
    /// Mask file per frame, at the user's place.
    pub(crate) masks: Vec<Option<PathBuf>>,
    pub(crate) points: Option<PointCloud>,
    pub(crate) scale: Scale,
    pub(crate) source: PoseSource,
    pub(crate) validation: PoseValidation,
}

/// Poses the sequence in `sequence_folder` and writes its scene; skipped, with a note, while the sequence and the
/// request are unchanged.
///
/// # Errors
/// When the folder holds no sequence, the given poses are malformed or fit no frame, or a file cannot be written. Also
/// when structure from motion is not installed or registers fewer than two frames, or a file that posing has not made
/// would be replaced.
pub fn pose_sequence(
    sequence_folder: &Path,
    request: &PoseRequest,
    progress: &dyn Progress,
) -> Result<Scene, CurateError> {
    pose_sequence_with(sequence_folder, request, &GivenTruth::default(), progress)
}

/// Poses a sequence as [`pose_sequence`], with further given data of the frames.
///
/// # Errors
/// Those of [`pose_sequence`], or a missing or unusable file of the given data.
pub fn pose_sequence_with(
    sequence_folder: &Path,
    request: &PoseRequest,
    truth: &GivenTruth,
    progress: &dyn Progress,
) -> Result<Scene, CurateError> {
    let sequence_path = sequence_folder.join(SEQUENCE_FILE);
    let sequence: Sequence = store::read_record(&sequence_path)?;
    let (scale, convention, pitch) = (truth.scale, truth.pose_convention, truth.camera_pitch);
    if let PoseRequest::Given(path) = request {
        given::matrix_convention(path, convention)?;
    }
    let frame_list = FrameList::of_sequence(&sequence).with_video_of(sequence_folder);
    let truth = truth.find(&frame_list)?;
    let mut plan = truth.add_inputs(plan(sequence_folder, &sequence, request, progress)?)?;
    if let Some(scale) = scale {
        plan = plan.with_settings("scale", &scale);
    }
    if let Some(convention) = convention {
        plan = plan.with_settings("poses convention", &convention);
    }
    if let Some(pitch) = pitch {
        plan = plan.with_settings("camera pitch", &pitch);
    }
    let scene_path = sequence_folder.join(SCENE_FILE);
    let skipped = format!("{}: poses unchanged, skipped", sequence.id);
    plan.make((SCENE_FILE, &skipped), [SCENE_FILE], progress, |out| {
        // If posing fails now, the scene of earlier poses must not be taken for these.
        store::remove(&scene_path)?;
        let mut posed = match request {
            PoseRequest::Given(path) => given::read(path, convention, &frame_list)?,
            PoseRequest::Sfm(settings) => {
                let found = sfm::run(
                    sequence_folder,
                    &sequence,
                    (settings, &truth.ignored),
                    progress,
                );
                let tilt = hovering::Tilt::of(pitch, scale.is_some());
                let over_ground =
                    hovering::of_hovering((sequence_folder, &sequence), &found, tilt, progress)?;
                over_ground.map_or(found, Ok)?
            }
        };
        if let Some(scale) = scale {
            scale
                .apply(&mut posed)
                .map_err(|reason| CurateError::input(&sequence_path, reason))?;
        }
        if pitch.is_some() && !matches!(posed.source, PoseSource::Registered { .. }) {
            let unused = "--camera-pitch tilts nothing: the camera does not hover, and its poses have their own ground";
            posed.validation.problems.push(unused.to_owned());
        }
        if matches!(request, PoseRequest::Given(_)) {
            check_given(sequence_folder, &frame_list, &mut posed)?;
        }
        truth.complete_masks(&mut posed.masks);
        let oddities = truth.notes(&posed.masks, &posed.camera.camera())?;
        posed.validation.problems.extend(oddities);
        for problem in &posed.validation.problems {
            progress.note(&format!("{}: poses: {problem}", sequence.id));
        }
        let mut staging = Staging::new(sequence_folder, "poses")?;
        let scene = stage_scene(
            &mut staging,
            sequence_folder,
            &sequence,
            posed,
            &truth,
            progress,
        )?;
        put_in_place(&plan, out, &staging, &scene)?;
        Ok(scene)
    })
}

/// Compares given poses of panoramas with the images.
///
/// # Errors
/// When a frame cannot be read.
fn check_given(
    folder: &Path,
    frames: &FrameList,
    posed: &mut PosedSequence,
) -> Result<(), CurateError> {
    if frames.is_pinhole {
        return Ok(());
    }
    let images: Vec<&str> = frames.entries.iter().map(|entry| &*entry.file).collect();
    agreement::check(folder, &images, &posed.poses, &mut posed.validation)
}

/// Moves what was staged to its places, and removes what earlier poses left of their own that the
/// scene does not refer to.
fn put_in_place(
    plan: &StagePlan,
    out: &mut StageOutputs<'_>,
    staging: &Staging,
    scene: &Scene,
) -> Result<(), CurateError> {
    let referred = files_named_by(scene);
    out.place(&staging.folder, &staging.files)?;
    let own = plan.own_files();
    own.remove(|file| !referred.contains(&file.to_owned()))?;
    // A mask of earlier poses that is given for these, at its place, is still ours.
    for file in referred {
        if !out.has(file) && own.standing(file)? == NameState::Ours {
            out.add(file);
        }
    }
    Ok(())
}

/// Lists the files that a scene refers to.
fn files_named_by(scene: &Scene) -> BTreeSet<&String> {
    let of_frames = scene.frames.iter().flat_map(|frame| {
        let depth = frame.depth.iter().map(|depth| &depth.file);
        let prior = frame.depth_prior.iter().map(|prior| &prior.file);
        let masks = (frame.mask.iter())
            .chain(&frame.ignore_mask)
            .chain(frame.classes.values())
            .chain(frame.objects.values());
        masks
            .chain(depth)
            .chain(prior)
            .chain(std::iter::once(&frame.image))
    });
    of_frames.chain(&scene.points).collect()
}

/// Lists everything that the poses depend on. No path is part of it: a dataset may be moved.
fn plan(
    sequence_folder: &Path,
    sequence: &Sequence,
    request: &PoseRequest,
    progress: &dyn Progress,
) -> Result<StagePlan, CurateError> {
    // Other entries of the sequence, such as its admission, do not affect poses.
    let plan = StagePlan::new(sequence_folder, STAGE)
        .with_text("sequence", &sequence.id)
        .with_hash("video", sequence.source.sha256.clone())
        .with_settings("time range", &sequence.range)
        .with_settings("frames", &sequence.frames);
    match request {
        PoseRequest::Given(path) => given::files(path)?
            .iter()
            .try_fold(plan, |plan, file| Ok(plan.with_file(file)?)),
        PoseRequest::Sfm(settings) => {
            let version = pycolmap_version(sequence_folder, sequence, progress)?;
            let plan = with_edited_frames(plan, (sequence_folder, sequence), progress)?;
            sfm::add_inputs(plan, settings, &version)
        }
    }
}

/// Returns the version of pycolmap for new or existing poses. Existing poses stay valid on a machine without it.
fn pycolmap_version(
    sequence_folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<String, CurateError> {
    let missing = match sfm::installation() {
        Ok(installation) => return Ok(installation.version),
        Err(error) => error,
    };
    let scene = store::read_record::<Scene>(&sequence_folder.join(SCENE_FILE)).ok();
    match scene.map(|scene| scene.pose_source) {
        Some(PoseSource::Sfm { tool, .. }) => {
            progress.note(&format!("{}: {missing}; its poses stand", sequence.id));
            Ok(tool
                .strip_prefix(sfm::TOOL)
                .unwrap_or(&tool)
                .trim()
                .to_owned())
        }
        _ => Err(missing.into()),
    }
}

/// Stages points, masks and other data of the frames; returns the scene.
fn stage_scene(
    staging: &mut Staging,
    folder: &Path,
    sequence: &Sequence,
    posed: PosedSequence,
    truth: &TruthFiles,
    progress: &dyn Progress,
) -> Result<Scene, CurateError> {
    let camera = posed.camera.camera();
    let size = camera.size();
    let straightening = posed.camera.straightening();
    if straightening.is_some() && truth.has_images() {
        return Err(CurateError::input(
            &folder.join(SEQUENCE_FILE),
            "the lens is taken out of its frames, which distances and masks of classes would not fit; give \
             frames without distortion",
        ));
    }
    let images = match &straightening {
        Some(straightening) => {
            straight_frames::stage(staging, folder, sequence, straightening, progress)?
        }
        None => {
            let entries = sequence.frames.entries.iter();
            entries.map(|entry| entry.file.clone()).collect()
        }
    };
    let masks = masks::stage(
        staging,
        folder,
        &posed.masks,
        size.into(),
        straightening.as_ref(),
    )?;
    let points = match posed.points.filter(|cloud| !cloud.is_empty()) {
        Some(cloud) => {
            cloud.write_ply(&staging.begin(POINTS_FILE)?)?;
            Some(POINTS_FILE.to_owned())
        }
        None => None,
    };
    let mut frames: Vec<SceneFrame> = sequence
        .frames
        .entries
        .iter()
        .zip(posed.poses)
        .zip(masks)
        .zip(images)
        .map(|(((entry, pose), mask), image)| SceneFrame {
            mask,
            capture: entry.capture.clone(),
            ..SceneFrame::new(image, entry.time_seconds, pose)
        })
        .collect();
    truth.stage(staging, folder, &mut frames, size, progress)?;
    let straightening = straightening.as_ref();
    (truth.ignored).stage(staging, folder, &mut frames, straightening)?;
    Ok(Scene {
        id: sequence.id.clone(),
        camera,
        scale: posed.scale,
        frames,
        points,
        pose_source: posed.source,
        validation: posed.validation,
        published_split: None,
        objects: [].into(),
    })
}
