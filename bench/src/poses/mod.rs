//! Scores of camera poses beside true ones: the trajectory as a whole, motions between frames, and drift.
//!
//! ```text
//! ATE    root of the mean squared distance of the centres, after a least-squares alignment (Sturm et al. 2012)
//! RPE    errors of the motions from one frame to the next, rotation and translation
//! AUC    area under the curve of pairwise errors: the larger one of the angles of the relative rotation and of the
//!        direction of the relative translation (Wang et al., PoseDiffusion, 2023)
//! drift  errors of the motions along parts of the path, as a share of their length
//! ```
//!
//! AUC does not depend on any alignment, and frames without a pose count in it. The other errors are of the registered
//! frames alone, so the share of these belongs beside them.

pub(crate) mod align;
mod conventions;
mod relative;

use omnilife_schemas::{
    Pose,
    records::{PoseAlignment, PoseScores, Scale, Scene},
};

use self::{
    align::{Degeneracy, align},
    relative::FramePoses,
};
use crate::error::BenchError;

/// Frames that both sides must have at least.
const LEAST_FRAMES: usize = 3;
/// Note on a trajectory in which every other frame has a pose.
const NO_NEIGHBOURS: &str =
    "no two neighbouring frames have a pose in the trajectory, so RPE is left out";
/// Note on a trajectory that no positive scale brings nearer to the reference.
const AGAINST: &str = "the trajectory runs against the reference: no scale above 0 fits";

/// Poses to be scored; entries are those of the scene's frames.
#[derive(Debug, Clone, Copy)]
pub struct PoseEstimate<'a> {
    /// Name of their file or folder.
    pub name: &'a str,
    /// A pose for each frame of the scene, where there is one.
    pub poses: &'a [Option<Pose>],
    /// True poses with the name of their file or folder; those of the scene if `None`.
    pub truth: Option<(&'a str, &'a [Option<Pose>])>,
    /// Motions that bring them to the reference.
    pub alignment: PoseAlignment,
}

/// Scores poses of a scene's frames.
///
/// # Errors
/// [`BenchError::Scene`] where less than three frames have a pose on both sides.
pub fn score_poses(scene: &Scene, estimate: &PoseEstimate<'_>) -> Result<PoseScores, BenchError> {
    let usable = |pose: &Option<Pose>| pose.filter(Pose::is_valid);
    let own: Vec<Option<Pose>> = scene.frames.iter().map(|frame| frame.pose).collect();
    let reference = estimate.truth.map_or(&own[..], |(_, poses)| poses);
    let mut frames: Vec<FramePoses> = (scene.frames.iter().zip(reference).zip(estimate.poses))
        .filter_map(|((frame, reference), estimated)| {
            Some(FramePoses {
                seconds: frame.time_seconds,
                reference: usable(reference)?,
                estimated: usable(estimated),
            })
        })
        .collect();
    let pairs: Vec<(Pose, Pose)> = frames
        .iter()
        .filter_map(|frame| Some((frame.estimated?, frame.reference)))
        .collect();
    let few = || BenchError::Scene {
        scene: scene.id.clone(),
        reason: format!(
            "{} of {} frames with a reference pose have one in {}; scores need {LEAST_FRAMES}",
            pairs.len(),
            frames.len(),
            estimate.name
        ),
    };
    if pairs.len() < LEAST_FRAMES {
        return Err(few());
    }
    let (alignment, degeneracy) = align(&pairs, estimate.alignment).ok_or_else(few)?;
    let path_length: f64 = pairs
        .windows(2)
        .map(|pair| pair[0].1.centre().distance(pair[1].1.centre()))
        .sum();
    let registered_frames = pairs.len() as u32;
    // Before the alignment: a scale of 0 would take the directions away.
    let auc = relative::areas(&frames, path_length);
    let convention = conventions::note(&frames, path_length);
    for frame in &mut frames {
        frame.estimated = frame.estimated.and_then(|pose| alignment.apply(&pose));
    }
    let stands = degeneracy == Some(Degeneracy::ReferenceStands);
    // As even as whole frames allow: 3, 4 and 3 of ten.
    let bound = |number: usize| (2 * number * frames.len() + 3) / 6;
    let thirds =
        |number: usize| ate_rmse(&frames[bound(number)..bound(number + 1)]).filter(|_| !stands);
    let unit = match estimate.truth {
        None => scene.scale,
        Some(_) => Scale::Arbitrary,
    };
    let relative = relative::neighbours(&frames);
    let no_neighbours = relative.is_none().then(|| NO_NEIGHBOURS.to_owned());
    Ok(PoseScores {
        scene: scene.id.clone(),
        trajectory: estimate.name.to_owned(),
        truth: estimate.truth.map(|(name, _)| name.to_owned()),
        unit,
        alignment: estimate.alignment,
        frames: frames.len() as u32,
        registered_frames,
        path_length,
        scale: alignment.scale,
        ate_rmse: ate_rmse(&frames).filter(|_| !stands),
        ate_rmse_of_thirds: [0, 1, 2].map(thirds),
        relative,
        auc,
        drift: match stands {
            true => Vec::new(),
            false => relative::drift(&frames, path_length),
        },
        notes: degeneracy
            .map(note)
            .into_iter()
            .chain((alignment.scale <= 0.0).then(|| AGAINST.to_owned()))
            .chain(convention)
            .chain(no_neighbours)
            .collect(),
    })
}

/// Returns the absolute trajectory error of the registered frames; `None` without any.
fn ate_rmse(frames: &[FramePoses]) -> Option<f64> {
    let squared: Vec<f64> = frames
        .iter()
        .filter_map(|frame| {
            let centre = frame.estimated?.centre();
            Some(centre.distance_squared(frame.reference.centre()))
        })
        .collect();
    let sum: f64 = squared.iter().sum();
    (!squared.is_empty()).then(|| (sum / squared.len() as f64).sqrt())
}

fn note(degeneracy: Degeneracy) -> String {
    match degeneracy {
        Degeneracy::Line => {
            "the cameras are on a line, which leaves a turn about it open: the alignment is by their rotations"
        }
        Degeneracy::ReferenceStands => {
            "the reference stays in one place: there is no scale, no trajectory error and no drift, translations \
             between neighbours are in units of the trajectory, and pairs are compared by their rotations"
        }
        Degeneracy::EstimateStands => {
            "the estimated cameras are all in one place: they have no scale"
        }
    }
    .to_owned()
}

/// Returns the scores as lines for people.
pub fn pose_table(scores: &PoseScores) -> String {
    let unit = match scores.unit {
        Scale::Metres => "m",
        Scale::Arbitrary => "units",
    };
    let alignment = match scores.alignment {
        PoseAlignment::Similarity => "similarity",
        PoseAlignment::Rigid => "rigid motion",
    };
    let length = |value: Option<f64>| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4} {unit}"))
    };
    let mut text = format!(
        "{} on {}, against {}\n",
        scores.trajectory,
        scores.scene,
        scores.truth.as_deref().unwrap_or("the scene's poses")
    );
    text += &format!(
        "registered      {} of {} frames ({:.1} %)\n",
        scores.registered_frames,
        scores.frames,
        100.0 * f64::from(scores.registered_frames) / f64::from(scores.frames.max(1))
    );
    text += &format!(
        "ATE             {} RMSE over a path of {:.4} {unit}, aligned by a {alignment} of scale {:.6}\n",
        length(scores.ate_rmse),
        scores.path_length,
        scores.scale
    );
    text += &format!(
        "ATE by thirds   {}\n",
        scores.ate_rmse_of_thirds.map(length).join(", ")
    );
    if let Some(relative) = &scores.relative {
        text += &format!(
            "RPE             {:.4} degrees, {:.4} {unit} RMSE over {} pairs of neighbours\n",
            relative.rotation_rmse_degrees, relative.translation_rmse, relative.pairs
        );
    }
    for area in &scores.auc {
        text += &format!("{:<16}{:.4}\n", format!("AUC@{}", area.degrees), area.auc);
    }
    for row in &scores.drift {
        text += &format!(
            "drift over {:>3.0} % {:.2} % of the length, {:.3} degrees ({} parts of {:.1} s)\n",
            100.0 * row.path_share,
            100.0 * row.translation_share,
            row.rotation_degrees,
            row.parts,
            row.seconds
        );
    }
    for note in &scores.notes {
        text += &format!("note: {note}\n");
    }
    text
}

#[cfg(test)]
pub(crate) mod tests;
