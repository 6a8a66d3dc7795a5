//! `omnilife bench poses`.

use std::path::Path;

use omnilife_bench::poses::{PoseEstimate, pose_table, score_poses};
use omnilife_curate::exchange::{Trajectory, read_trajectory};
use omnilife_schemas::{
    Pose,
    records::{PoseAlignment, PoseConvention, Scene},
    store,
};

use crate::exit::{self, BadRequest};

/// Files of a comparison of poses.
pub(super) struct PosePlaces<'a> {
    pub(super) trajectory: &'a Path,
    pub(super) scene: &'a Path,
    pub(super) truth: Option<&'a Path>,
    /// The record to write.
    pub(super) out: Option<&'a Path>,
}

/// Scores poses, prints the scores and writes them where they are asked for.
pub(super) fn execute(
    places: &PosePlaces<'_>,
    convention: Option<PoseConvention>,
    alignment: PoseAlignment,
) -> anyhow::Result<()> {
    let scene: Scene = store::read_record(places.scene)?;
    let given = [Some(places.trajectory), places.truth];
    refuse_idle_convention(convention, given.into_iter().flatten())?;
    let read = |path: &Path| -> anyhow::Result<Trajectory> {
        let convention = convention.filter(|_| is_array(path));
        Ok(read_trajectory(path, convention, &scene)?)
    };
    let estimated = read(places.trajectory)?;
    let truth = places.truth.map(read).transpose()?;
    let name = own_name(places.trajectory);
    let truth_name = places.truth.map(own_name).unwrap_or_default();
    let mut notes = named(&name, estimated.notes);
    let truth = truth.map(|truth| {
        notes.extend(named(&truth_name, truth.notes));
        truth.poses
    });
    let scores = score_poses(
        &scene,
        &PoseEstimate {
            name: &name,
            poses: &estimated.poses,
            truth: truth.as_deref().map(|poses| (&*truth_name, poses)),
            alignment,
        },
    );
    let mut scores = match scores {
        // Frames that fit no pose are mostly the reason.
        Err(error) if !notes.is_empty() => {
            return Err(BadRequest(format!("{error}; {}", notes.join("; "))).into());
        }
        scores => scores?,
    };
    scores.notes.extend(notes);
    if let Some(out) = places.out {
        store::write_record(out, &scores)?;
    }
    exit::print(&pose_table(&scores))
}

/// Reads poses of a scene's frames, with the name of their file or folder.
///
/// # Errors
/// When they cannot be read, or a convention belongs to another file than a `.npy`.
pub(super) fn read_poses(
    path: &Path,
    convention: Option<PoseConvention>,
    scene: &Scene,
) -> anyhow::Result<(String, Vec<Option<Pose>>)> {
    refuse_idle_convention(convention, [path])?;
    let read = read_trajectory(path, convention, scene)?;
    Ok((own_name(path), read.poses))
}

/// Returns lines that start with the name of the file or folder they are about.
fn named(name: &str, lines: Vec<String>) -> Vec<String> {
    lines
        .into_iter()
        .map(|line| format!("{name}: {line}"))
        .collect()
}

/// Refuses a convention of matrices where no file has any.
fn refuse_idle_convention<'a>(
    convention: Option<PoseConvention>,
    given: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    if convention.is_some() && !given.into_iter().any(is_array) {
        let reason =
            "--poses-convention says what the matrices of a .npy map, and no .npy is given";
        return Err(BadRequest(reason.to_owned()).into());
    }
    Ok(())
}

fn is_array(path: &Path) -> bool {
    let extension = path.extension();
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

/// Returns the name of a file or folder: records must not change if it is moved.
fn own_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().into_owned()
}
