//! Poses given by the user: a `poses.json`, a folder with a COLMAP model, a TUM trajectory, or matrices as `.npy`.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    camera::Camera,
    plain_text,
    points::PointCloud,
    pose,
    records::{FrameEntry, PoseConvention, PoseSource, PoseValidation, PosedFrame, Poses, Scale},
    store,
};

use super::{
    PosedSequence,
    colmap::{self, ColmapModel},
    frame_list::FrameList,
    matrices, refuse_missing, tum,
    validate::{ValidationLimits, validate},
};
use crate::error::CurateError;

/// Lists every file of given poses, for the stage's inputs.
pub(super) fn files(path: &Path) -> Result<Vec<PathBuf>, CurateError> {
    if path.is_dir() {
        return Ok(colmap::files(path)?.paths.to_vec());
    }
    if is_array(path) {
        return Ok(vec![path.to_owned()]);
    }
    let poses = record(path)?;
    Ok(std::iter::once(path.to_owned())
        .chain(named_files(path, &poses))
        .collect())
}

/// Lists the files that poses name: points, and masks of frames.
fn named_files<'a>(path: &'a Path, poses: &'a Poses) -> impl Iterator<Item = PathBuf> + 'a {
    let masks = poses.frames.iter().filter_map(|frame| frame.mask.as_ref());
    let files = poses.points.iter().chain(masks);
    files.map(move |file| beside(path, file))
}

/// Checks given poses as far as possible without a sequence: they are readable and valid, and the files they name
/// exist.
///
/// # Errors
/// When a file is missing or malformed, or matrices come without a convention.
pub fn check(path: &Path, convention: Option<PoseConvention>) -> Result<(), CurateError> {
    refuse_missing(path)?;
    if let Some(convention) = matrix_convention(path, convention)? {
        matrices::read(path, convention)?;
        return Ok(());
    }
    if path.is_dir() {
        ColmapModel::read(path)?;
        return Ok(());
    }
    let poses = sorted_record(path)?;
    for file in named_files(path, &poses) {
        fs::File::open(&file).map_err(|error| store::StoreError::read(&file, error))?;
    }
    Ok(())
}

/// Reads given poses and matches them to frames. `convention` is the direction of matrices, and belongs to them alone.
///
/// # Errors
/// When the files are missing or malformed, no frame gets a pose, or a convention is missing for matrices or given for
/// other poses.
pub(super) fn read(
    path: &Path,
    convention: Option<PoseConvention>,
    frames: &FrameList,
) -> Result<PosedSequence, CurateError> {
    let posed = match matrix_convention(path, convention)? {
        Some(convention) => from_matrices(path, convention, frames)?,
        None if path.is_dir() => from_colmap(path, frames)?,
        None => from_record(path, frames)?,
    };
    if posed.poses.iter().all(Option::is_none) {
        return Err(CurateError::input(
            path,
            format!(
                "fits no frame of {}: {}",
                frames.id,
                posed.validation.problems.join("; ")
            ),
        ));
    }
    Ok(posed)
}

/// Returns true for the name of an array's file.
fn is_array(path: &Path) -> bool {
    let extension = path.extension();
    !path.is_dir() && extension.is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

/// Returns the direction of matrices; `None` for other poses.
///
/// # Errors
/// When a convention is missing for matrices, or given for other poses.
pub(super) fn matrix_convention(
    path: &Path,
    convention: Option<PoseConvention>,
) -> Result<Option<PoseConvention>, CurateError> {
    match (is_array(path), convention) {
        (true, None) => {
            let reason = "holds matrices, and nothing says what they map: --poses-convention camera-to-world or \
                          world-to-camera";
            Err(CurateError::input(path, reason))
        }
        (false, Some(_)) => {
            let reason = "must be a .npy with matrices: other files take no convention";
            Err(CurateError::input(path, reason))
        }
        (_, convention) => Ok(convention),
    }
}

fn beside(path: &Path, file: &str) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(file)
}

/// Reads a record of poses, or a TUM trajectory as one.
fn record(path: &Path) -> Result<Poses, store::StoreError> {
    match tum::is_trajectory(path) {
        true => tum::read(path),
        false => store::read_record(path),
    }
}

/// Reads a record of poses, its frames in order of time.
///
/// # Errors
/// When it cannot be read, a pose is not finite or has no unit quaternion, or two share one instant.
fn sorted_record(path: &Path) -> Result<Poses, CurateError> {
    let mut record = record(path)?;
    if let Some(bad) = record
        .frames
        .iter()
        .find(|frame| !frame.pose.is_valid() || !frame.time_seconds.is_finite())
    {
        return Err(store::StoreError::malformed(
            path,
            format!(
                "the pose at {} s is not finite or has no rotation",
                bad.time_seconds
            ),
        )
        .into());
    }
    if let Some(bad) = record.frames.iter().find(|frame| !frame.pose.is_unit()) {
        let reason = format!(
            "rotation_wxyz at {} s must be a unit quaternion, got {:?}",
            bad.time_seconds, bad.pose.rotation_wxyz
        );
        return Err(store::StoreError::malformed(path, reason).into());
    }
    record
        .frames
        .sort_by(|a, b| a.time_seconds.total_cmp(&b.time_seconds));
    if let Some([first, _]) = record
        .frames
        .array_windows()
        .find(|[a, b]| a.time_seconds == b.time_seconds && a.pose != b.pose)
    {
        return Err(store::StoreError::malformed(
            path,
            format!("has two poses at {} s", first.time_seconds),
        )
        .into());
    }
    Ok(record)
}

/// Matches matrices to frames by their order.
fn from_matrices(
    path: &Path,
    convention: PoseConvention,
    frames: &FrameList,
) -> Result<PosedSequence, CurateError> {
    let poses = matrices::read(path, convention)?;
    let count = frames.entries.len();
    if poses.len() != count {
        let reason = format!("has {} matrices for {count} frames", poses.len());
        return Err(CurateError::input(path, reason));
    }
    let poses: Vec<Option<Pose>> = poses.into_iter().map(Some).collect();
    Ok(PosedSequence {
        camera: camera_of_frames(path, None, frames)?.into(),
        validation: unchecked(&poses),
        masks: vec![None; count],
        poses,
        points: None,
        scale: Scale::Arbitrary,
        source: PoseSource::Matrices {
            file: own_name(path),
            convention,
        },
    })
}

/// Matches frames by time, within their tolerance.
fn from_record(path: &Path, frames: &FrameList) -> Result<PosedSequence, CurateError> {
    let record = sorted_record(path)?;
    let camera = camera_of_frames(path, record.camera, frames)?;
    let tolerance = frames.tolerance_seconds;
    let matched: Vec<Option<&PosedFrame>> = frames
        .entries
        .iter()
        .map(|entry| nearest(&record.frames, entry.time_seconds, tolerance))
        .collect();
    let poses: Vec<Option<Pose>> = matched.iter().map(|m| m.map(|frame| frame.pose)).collect();
    let points = record
        .points
        .as_ref()
        .map(|file| PointCloud::read_ply(&beside(path, file)))
        .transpose()?;
    let masks: Vec<Option<PathBuf>> = matched
        .iter()
        .map(|m| {
            m.and_then(|frame| frame.mask.as_ref())
                .map(|file| beside(path, file))
        })
        .collect();
    let mut validation = unchecked(&poses);
    validation
        .problems
        .extend(other_times(&record.frames, &poses, frames));
    validation
        .problems
        .extend(before_the_video(&record.frames, frames));
    validation
        .problems
        .extend(beside_their_times(&matched, frames));
    let masked = masks.iter().flatten().count();
    if masked > 0 && masked < masks.len() {
        validation.problems.push(format!(
            "{} of {} frames have no mask; nothing moves in them as far as is known",
            masks.len() - masked,
            masks.len()
        ));
    }
    Ok(PosedSequence {
        camera: camera.into(),
        validation,
        masks,
        poses,
        points,
        scale: record.scale,
        source: given_by(path),
    })
}

/// Share of the largest distance in time from which on poses are said to be of other moments than their frames.
const NOTABLE_SHARE: f64 = 0.2;
/// Rounding of times to milliseconds, and as much again, seconds.
const NOTABLE_SECONDS: f64 = 0.002;

/// Returns a line on poses of other moments than their frames.
fn beside_their_times(matched: &[Option<&PosedFrame>], frames: &FrameList) -> Option<String> {
    let pairs = frames.entries.iter().zip(matched);
    let apart = pairs.filter_map(|(entry, found)| {
        Some((found.as_ref()?.time_seconds - entry.time_seconds).abs())
    });
    let limit = NOTABLE_SECONDS.max(NOTABLE_SHARE * frames.tolerance_seconds);
    let apart: Vec<f64> = apart.filter(|&apart| apart > limit).collect();
    let largest = apart.iter().copied().fold(0.0, f64::max);
    (!apart.is_empty()).then(|| {
        format!(
            "{} of {} frames have poses of other moments, up to {largest:.3} s away; the nearest within {:.3} s is taken, \
             and nothing is interpolated",
            apart.len(),
            frames.entries.len(),
            frames.tolerance_seconds
        )
    })
}

/// Returns a line on the times of poses that fit less than half of the frames: their unit or start may be another.
fn other_times(given: &[PosedFrame], poses: &[Option<Pose>], frames: &FrameList) -> Option<String> {
    let posed = poses.iter().flatten().count();
    let [first, last] = [given.first()?, given.last()?].map(|frame| frame.time_seconds);
    let [begin, end] =
        [frames.entries.first()?, frames.entries.last()?].map(|entry| entry.time_seconds);
    (2 * posed < poses.len()).then(|| {
        format!(
            "poses are from {first:.3} s to {last:.3} s, the frames from {begin:.3} s to {end:.3} s: their times may \
             have another unit or start"
        )
    })
}

/// Returns a line on poses from before the first frame of the video: they may count from that frame, while frames have
/// the time stamps of the video. `given` is sorted by time.
fn before_the_video(given: &[PosedFrame], frames: &FrameList) -> Option<String> {
    let first = frames.video_begins?;
    let earliest = given.first()?.time_seconds;
    let tolerance = frames.tolerance_seconds;
    // Times that count from that frame are not negative.
    (-tolerance..first - tolerance).contains(&earliest).then(|| {
        format!(
            "poses start at {earliest:.3} s, and the video's first frame has the time stamp {first:.3} s: add {first:.3} \
             to times that count from that frame"
        )
    })
}

/// Returns the camera of frames from the one given with their poses.
///
/// # Errors
/// Those of [`FrameList::camera_with`].
pub(super) fn camera_of_frames(
    path: &Path,
    given: Option<Camera>,
    frames: &FrameList,
) -> Result<Camera, CurateError> {
    let camera = frames.camera_with(given);
    camera.map_err(|reason| CurateError::input(path, reason))
}

/// Returns the pose nearest to an instant, if it is within the tolerance. `given` is sorted by time.
fn nearest(given: &[PosedFrame], seconds: f64, tolerance: f64) -> Option<&PosedFrame> {
    let after = given.partition_point(|frame| frame.time_seconds < seconds);
    given[after.saturating_sub(1)..(after + 1).min(given.len())]
        .iter()
        .map(|frame| ((frame.time_seconds - seconds).abs(), frame))
        .filter(|(distance, _)| *distance <= tolerance)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, frame)| frame)
}

/// Matches frames by file name, regardless of their folder.
fn from_colmap(folder: &Path, frames: &FrameList) -> Result<PosedSequence, CurateError> {
    let model = ColmapModel::read(folder)?;
    let camera = camera_of_frames(folder, Some(model.camera.camera()), frames)?;
    let names = frame_names(&frames.entries);
    let mut by_name: BTreeMap<String, Pose> = BTreeMap::new();
    for image in model.images.values() {
        let name = file_name(&image.name);
        if by_name.insert(name.clone(), image.pose()).is_some() {
            return Err(CurateError::input(
                folder,
                format!("has two images named {name}; frames are matched by file name"),
            ));
        }
    }
    let poses: Vec<Option<Pose>> = names
        .iter()
        .map(|name| by_name.get(name).copied())
        .collect();
    let has_observations = model
        .images
        .values()
        .any(|image| !image.observations.is_empty());
    let mut validation = if has_observations {
        let mut flat = model.clone();
        for image in flat.images.values_mut() {
            image.name = file_name(&image.name);
        }
        validate(&flat, &names, &ValidationLimits::default())
    } else {
        unchecked(&poses)
    };
    validation.problems.extend(other_images(&by_name, &names));
    validation.problems.extend(colmap::files(folder)?.note);
    Ok(PosedSequence {
        camera: model.camera.resized(camera.width(), camera.height()),
        masks: vec![None; poses.len()],
        poses,
        points: Some(model.cloud()),
        scale: Scale::Arbitrary,
        source: given_by(folder),
        validation,
    })
}

/// Returns a line on images of a model that are no frames: it may be of images that are numbered otherwise.
fn other_images(of_model: &BTreeMap<String, Pose>, frames: &[String]) -> Option<String> {
    let known: BTreeSet<&String> = frames.iter().collect();
    let others = of_model.keys().filter(|name| !known.contains(name));
    let others: Vec<String> = others.cloned().collect();
    let (first, last) = (frames.first()?, frames.last()?);
    (!others.is_empty()).then(|| {
        format!(
            "{} of {} images of the model are no frames ({}); frames are named {first} to {last}, and a model of images \
             that are numbered otherwise gives them the poses of others",
            others.len(),
            of_model.len(),
            plain_text::first_of(&others)
        )
    })
}

/// Returns the source. Only the name: records must not change if a dataset is moved.
fn given_by(path: &Path) -> PoseSource {
    PoseSource::Given {
        file: own_name(path),
    }
}

fn own_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn file_name(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned()
}

/// Returns the file names of frames.
pub(super) fn frame_names(frames: &[FrameEntry]) -> Vec<String> {
    frames.iter().map(|entry| file_name(&entry.file)).collect()
}

/// Returns the validation of poses that cannot be checked.
pub(crate) fn unchecked(poses: &[Option<Pose>]) -> PoseValidation {
    let registered = poses.iter().flatten().count();
    let mut problems = Vec::new();
    if registered < poses.len() {
        problems.push(format!(
            "{} of {} frames have no pose",
            poses.len() - registered,
            poses.len()
        ));
    }
    problems.extend(pose::far_frames(poses));
    problems.extend(pose::one_place(poses));
    PoseValidation {
        problems,
        ..PoseValidation::unchecked(registered, poses.len())
    }
}
