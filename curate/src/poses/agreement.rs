//! Agreement of given poses with panoramas, before anything is trained on them.
//!
//! Two neighbouring frames tell how their camera turned and where it went: [`register`] finds both in the images alone.
//! Poses that were written by another convention than they are read by say something else, always in the same way. So
//! each pair is compared with the poses as they are, and with those that every other convention would give: inverted,
//! with other axes of the camera, mirrored.

use std::{fmt, path::Path};

use glam::{DMat3, DQuat, DVec3, Vec3};
use omnilife_schemas::{
    Pose, RgbImage,
    pose::angle_between,
    records::{PoseValidation, ValidationStatus},
};

use super::validate::angle_degrees;
use crate::{
    error::CurateError,
    motion::{GreySphere, grey::even_directions, register},
};

/// Maximum number of compared pairs, spread over the frames.
const MOST_PAIRS: usize = 8;
/// Largest number of frames from the first to the second of a pair.
const FARTHEST: usize = 8;
/// Minimum number of pairs that tell something.
const LEAST_PAIRS: usize = 4;
/// Width of the compared images, pixels; narrower ones show too little.
const WIDTH: usize = 256;
/// Number of directions in which flow is estimated.
const DIRECTIONS: usize = 1_000;
/// Largest turn between two frames that are registered, degrees.
const LARGEST_TURN_DEGREES: f64 = 40.0;
/// Turns below this tell nothing of a convention, degrees.
const LEAST_TURN_DEGREES: f64 = 3.0;
/// Parallax below this tells no direction of the motion, pixels.
const LEAST_PARALLAX_PIXELS: f64 = 1.0;
/// Parallax that pairs of a slow camera are chosen for, pixels.
const SHOWN_PARALLAX_PIXELS: f64 = 1.5;
/// Largest difference of a turn, as a share of it, where poses agree; and least such difference, degrees.
const TURN_SHARE: f64 = 0.5;
const TURN_DEGREES: f64 = 2.0;
/// Largest difference of the direction of the motion where poses agree, degrees.
const HEADING_DEGREES: f64 = 35.0;
/// Poses are in doubt where no more than this share of the pairs agrees with them, or their turns differ by more than
/// the second from those of the images, as a share of these.
const MOST_AGREEING: f64 = 0.5;
const BAD_TURN_ERROR: f64 = 0.8;
/// Another convention is named where at least this share agrees with it, and its turns differ by less.
const LEAST_AGREEING: f64 = 0.75;
const GOOD_TURN_ERROR: f64 = 0.4;
/// Turns whose mean is below this are lost in their error, degrees.
const LEAST_MEAN_TURN_DEGREES: f64 = 0.5;
/// Poses that agree in no convention are told where so few of so many pairs agree with them: where images are hard to
/// register, most pairs can be wrong.
const LOST_SHARE: f64 = 0.1;
const LEAST_PAIRS_WITHOUT_NAME: usize = 6;

/// Motion between two frames by their images, in the axes of the first camera.
#[derive(Debug, Clone, Copy)]
struct PairInImages {
    frames: [usize; 2],
    /// Maps directions of the first camera to the second.
    turn: DQuat,
    /// Unit direction of the motion; `None` if it is not visible.
    heading: Option<DVec3>,
}

/// A way in which poses can be meant.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Convention {
    /// World to camera was written, and camera to world is read.
    is_inverse: bool,
    /// The axes of the read camera as columns, in those of the meant one: a signed permutation.
    axes: DMat3,
    /// Left and right of the images are exchanged.
    is_mirrored: bool,
}

impl Convention {
    const AS_READ: Self = Self {
        is_inverse: false,
        axes: DMat3::IDENTITY,
        is_mirrored: false,
    };

    /// Returns all conventions, the likeliest first.
    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for is_mirrored in [false, true] {
            for is_inverse in [false, true] {
                all.extend(rotations_of_axes().into_iter().map(|axes| Self {
                    is_inverse,
                    axes,
                    is_mirrored,
                }));
            }
        }
        all.sort_by_key(Self::changes);
        all
    }

    /// Returns the number of mistakes that it takes.
    fn changes(&self) -> usize {
        let turned = self.axes != DMat3::IDENTITY;
        [self.is_inverse, turned, self.is_mirrored]
            .into_iter()
            .filter(|&is| is)
            .count()
    }

    /// Returns turn and displacement between two poses as an image shows them, in the axes of the first camera.
    fn motion(self, poses: [&Pose; 2]) -> Option<(DQuat, DVec3)> {
        let [first, second] = poses.map(|pose| {
            let (rotation, centre) = (pose.rotation()?, pose.centre());
            let meant = if self.is_inverse {
                let inverse = rotation.inverse();
                (inverse, -(inverse * centre))
            } else {
                (rotation, centre)
            };
            Some(meant)
        });
        let ((first, from), (second, to)) = (first?, second?);
        let turn = DMat3::from_quat(second.inverse() * first);
        let moved = first.inverse() * (to - from);
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let to_meant = if self.is_mirrored {
            mirror * self.axes
        } else {
            self.axes
        };
        // Two mirrors make a rotation.
        let turn = to_meant * turn * to_meant.transpose();
        Some((DQuat::from_mat3(&turn).normalize(), to_meant * moved))
    }

    /// Returns true if a pair's images show what its poses say; `None` where the pair tells nothing.
    fn agrees(self, pair: &PairInImages, poses: &[Option<Pose>]) -> Option<bool> {
        let [first, second] = pair.frames.map(|frame| poses[frame].as_ref());
        let (turn, moved) = self.motion([first?, second?])?;
        let seen = angle_between(pair.turn, DQuat::IDENTITY).to_degrees();
        let off = angle_between(pair.turn, turn).to_degrees();
        let said = angle_between(turn, DQuat::IDENTITY).to_degrees();
        let turn_agrees = off < (TURN_SHARE * seen.max(said)).max(TURN_DEGREES);
        let turns = seen.max(said) >= LEAST_TURN_DEGREES;
        let heading = pair.heading.filter(|_| moved != DVec3::ZERO);
        let heading_agrees = heading.map(|heading| angle_degrees(heading, moved) < HEADING_DEGREES);
        match (turns, heading_agrees) {
            (false, None) => None,
            (_, heading) => Some(turn_agrees && heading.unwrap_or(true)),
        }
    }

    /// Compares the poses, meant this way, with all pairs.
    fn compare(self, pairs: &[PairInImages], poses: &[Option<Pose>]) -> Comparison {
        let told: Vec<bool> = (pairs.iter())
            .filter_map(|pair| self.agrees(pair, poses))
            .collect();
        let (mut turned, mut off, mut compared) = (0.0, 0.0, 0);
        for pair in pairs {
            let [first, second] = pair.frames.map(|frame| poses[frame].as_ref());
            let both = first.zip(second);
            let motion = both.and_then(|(first, second)| self.motion([first, second]));
            if let Some((turn, _)) = motion {
                let [seen, said] = [pair.turn, turn].map(DQuat::to_scaled_axis);
                turned += seen.length();
                off += (seen - said).length();
                compared += 1;
            }
        }
        let enough = f64::from(compared) * LEAST_MEAN_TURN_DEGREES.to_radians();
        Comparison {
            convention: self,
            agree: told.iter().filter(|&&agrees| agrees).count(),
            told: told.len(),
            turn_error: (compared > 0 && turned > enough).then(|| off / turned),
        }
    }
}

/// Agreement of the images with poses that are meant in one way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Comparison {
    convention: Convention,
    /// Number of pairs that agree, of those that tell something.
    agree: usize,
    told: usize,
    /// Sum of the differences of turns, over that of the turns that the images show; `None` where the camera hardly
    /// turns.
    turn_error: Option<f64>,
}

impl Comparison {
    fn share(&self) -> f64 {
        self.agree as f64 / self.told.max(1) as f64
    }

    /// Returns true if most pairs agree, and the turns too.
    fn holds(&self) -> bool {
        self.told >= LEAST_PAIRS
            && self.share() >= LEAST_AGREEING
            && self.turn_error.is_none_or(|error| error < GOOD_TURN_ERROR)
    }

    /// Returns true if few pairs agree, or the turns do not.
    fn is_in_doubt(&self) -> bool {
        self.share() <= MOST_AGREEING || self.turn_error.is_some_and(|error| error > BAD_TURN_ERROR)
    }

    /// Returns a number that is smaller for better agreement.
    fn disagreement(&self) -> f64 {
        1.0 - self.share() + self.turn_error.unwrap_or(0.0)
    }
}

impl fmt::Display for Convention {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut words = Vec::new();
        if self.is_inverse {
            words
                .push("inverted (world to camera was written, camera to world is read)".to_owned());
        }
        if self.axes != DMat3::IDENTITY {
            // Row i of the matrix is the meant axis i in the read ones.
            let rows = self.axes.transpose();
            let names = [rows.x_axis, rows.y_axis, rows.z_axis].map(signed_axis);
            words.push(format!("with the camera's axes {}", names.join(" ")));
        }
        if self.is_mirrored {
            words.push("with the images mirrored left to right".to_owned());
        }
        f.write_str(&words.join(" and "))
    }
}

/// Returns the name of a unit vector along an axis.
fn signed_axis(axis: DVec3) -> String {
    let names = [(axis.x, 'x'), (axis.y, 'y'), (axis.z, 'z')];
    let along = names.into_iter().filter(|(value, _)| *value != 0.0);
    along
        .map(|(value, name)| format!("{}{name}", if value < 0.0 { "-" } else { "+" }))
        .collect()
}

/// Returns the 24 rotations that exchange axes, that of no exchange first.
fn rotations_of_axes() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let signed = axes.into_iter().flat_map(|axis| [axis, -axis]);
    let signed: Vec<DVec3> = signed.collect();
    let mut all = Vec::new();
    for &x in &signed {
        for &y in signed.iter().filter(|y| x.dot(**y) == 0.0) {
            all.push(DMat3::from_cols(x, y, x.cross(y)));
        }
    }
    // Half a turn about up, a seam elsewhere, and y and z reversed (OpenGL) are the usual ones.
    let usual = [
        DMat3::IDENTITY,
        DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)),
        DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
    ];
    all.sort_by_key(|axes| {
        usual
            .iter()
            .position(|one| one == axes)
            .unwrap_or(usual.len())
    });
    all
}

/// Adds what panoramas in a folder say of their given poses to the validation of these; nothing where too few pairs of
/// neighbouring frames can be registered.
///
/// # Errors
/// When a frame cannot be read.
pub(crate) fn check(
    folder: &Path,
    images: &[&str],
    poses: &[Option<Pose>],
    validation: &mut PoseValidation,
) -> Result<(), CurateError> {
    let pairs = pairs_in_images(folder, images, poses)?;
    let as_read = Convention::AS_READ.compare(&pairs, poses);
    if as_read.told < LEAST_PAIRS {
        return Ok(());
    }
    let measures = &mut validation.measures;
    measures.insert("agreeing_pairs_share".to_owned(), as_read.share());
    if let Some(error) = as_read.turn_error {
        measures.insert("turn_error_share".to_owned(), error);
    }
    if let Some((best, problem)) = disagreement(&as_read, &pairs, poses) {
        if best.is_some() {
            validation.status = ValidationStatus::Unstable;
        }
        validation.problems.push(problem);
    }
    Ok(())
}

/// Returns a line on poses that the images contradict, with the convention in which they agree, if there is one.
fn disagreement(
    as_read: &Comparison,
    pairs: &[PairInImages],
    poses: &[Option<Pose>],
) -> Option<(Option<Convention>, String)> {
    if !as_read.is_in_doubt() {
        return None;
    }
    let others = Convention::all().into_iter();
    let others = others.map(|convention| convention.compare(pairs, poses));
    // The first of equals takes the fewest mistakes.
    let best = others
        .filter(Comparison::holds)
        .min_by(|a, b| a.disagreement().total_cmp(&b.disagreement()));
    let turns = match as_read.turn_error {
        Some(error) => format!(", and their turns are off by {:.0} %", 100.0 * error),
        None => String::new(),
    };
    let finding = format!(
        "the images contradict the poses: {} of {} pairs of frames turn and move as these say{turns}",
        as_read.agree, as_read.told
    );
    match best {
        Some(best) => {
            let (agree, told, convention) = (best.agree, best.told, best.convention);
            let line = format!("{finding}; {agree} of {told} do with the poses {convention}");
            Some((Some(convention), line))
        }
        None if as_read.told >= LEAST_PAIRS_WITHOUT_NAME && as_read.share() <= LOST_SHARE => {
            let line = format!(
                "{finding}; with no other axes or directions they do: are the poses in the order of the frames, and of \
                 this video?"
            );
            Some((None, line))
        }
        None => None,
    }
}

/// Measures pairs of frames with poses, spread over them.
fn pairs_in_images(
    folder: &Path,
    images: &[&str],
    poses: &[Option<Pose>],
) -> Result<Vec<PairInImages>, CurateError> {
    let posed: Vec<usize> = (0..images.len().min(poses.len()))
        .filter(|&frame| poses[frame].is_some())
        .collect();
    let count = posed.len().saturating_sub(1).min(MOST_PAIRS);
    let begins: Vec<usize> = (0..count)
        .map(|number| number * (posed.len() - 1) / count)
        .collect();
    let directions: Vec<Vec3> = even_directions(DIRECTIONS).collect();
    let read = |frame: usize| -> Result<Option<GreySphere>, CurateError> {
        let image = RgbImage::read(&folder.join(images[frame]))?;
        Ok((image.width >= WIDTH).then(|| GreySphere::new(&image, WIDTH)))
    };
    // A slow camera shows its way over some frames; a fast one is lost after one.
    // One pair after the other: frames of a large video are large, and registration takes all cores.
    let measured = begins.into_iter().map(|begin| {
        let Some(from) = read(posed[begin])? else {
            return Ok(None);
        };
        let pair = |step: usize| -> Result<Option<(PairInImages, f64)>, CurateError> {
            let Some(&end) = posed.get(begin + step) else {
                return Ok(None);
            };
            let to = read(end)?;
            Ok(to.and_then(|to| pair_in_images((posed[begin], &from), (end, &to), &directions)))
        };
        let Some((near, parallax)) = pair(1)? else {
            return Ok(None);
        };
        let step = (SHOWN_PARALLAX_PIXELS / parallax)
            .ceil()
            .min(FARTHEST as f64) as usize;
        let far = match step {
            0 | 1 => None,
            _ => pair(step)?,
        };
        Ok(Some(far.map_or(near, |(far, _)| far)))
    });
    let measured: Vec<Option<PairInImages>> = measured.collect::<Result<_, CurateError>>()?;
    Ok(measured.into_iter().flatten().collect())
}

/// Registers two frames, and returns their parallax in pixels too; `None` where that fails.
fn pair_in_images(
    (first, from): (usize, &GreySphere),
    (second, to): (usize, &GreySphere),
    directions: &[Vec3],
) -> Option<(PairInImages, f64)> {
    let found = register(from, to, directions)?;
    let turn = found.rotation.as_dquat();
    let parallax = found.motion.parallax_radians / f64::from(from.pixel_radians(0));
    let heading = found
        .motion
        .heading
        .filter(|_| parallax > LEAST_PARALLAX_PIXELS);
    let turned = angle_between(turn, DQuat::IDENTITY).to_degrees();
    let pair = PairInImages {
        frames: [first, second],
        turn,
        heading: heading.map(Vec3::as_dvec3),
    };
    (turned < LARGEST_TURN_DEGREES).then_some((pair, parallax))
}

#[cfg(test)]
mod tests;
