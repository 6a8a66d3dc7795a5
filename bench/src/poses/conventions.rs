//! Conventions of camera poses, told by a reading of the same numbers that fits the reference much better.
//!
//! Files of poses do not state the direction of their matrices, the order of their quaternions, the axes of the camera
//! or the number of the first frame. A mistake in one of them leaves a trajectory whose centres may fit, and whose
//! motions do not. Each reading is judged by motions between frames alone, so that the world of the estimate is free.
//! Scores are always of the poses as they are.

use std::fmt;

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{Pose, records::DIAGNOSIS_PREFIX, statistics::median};

use super::relative::{self, FramePoses};

/// Frames at least, so that no reading fits by chance, and at most, which are spread evenly.
const LEAST_FRAMES: usize = 8;
const MOST_FRAMES: usize = 64;
/// Distances of paired frames, as parts of all of them.
const PARTS_BETWEEN: [usize; 2] = [4, 2];
/// Median error of the poses as they are from which a reading is looked for, degrees: of a shift by a frame, and of
/// readings that change a pose itself. A path in a plane is nearly its own mirror image: a camera pitched by a few degrees
/// fits such a reading better.
const LEAST_SHIFT_DEGREES: f64 = 0.05;
const LEAST_READING_DEGREES: f64 = 20.0;
/// Largest median error of a reading that fits: its share of that of the poses as they are, and degrees.
const MOST_LEFT: f64 = 0.5;
const MOST_DEGREES: f64 = 10.0;
/// Readings fit alike if their errors differ by this share, and by this many degrees.
const ALIKE_SHARE: f64 = 1.05;
const ALIKE_DEGREES: f64 = 0.01;
/// Readings that a line names: motions along one axis leave several.
const NAMED: usize = 2;

/// Order or direction in which the numbers of a pose may be meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Numbers {
    AsTheyAre,
    /// World to camera instead of camera to world, or the reverse.
    Inverse,
    /// The four numbers read as x, y, z, w are w, x, y, z.
    RealFirst,
    /// The four numbers read as w, x, y, z are x, y, z, w.
    RealLast,
}

/// Camera axes: for each axis of the scene's camera the axis of the estimated one along it, with its sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Axes([(usize, bool); 3]);

impl Axes {
    const OWN: Self = Self([(0, false), (1, false), (2, false)]);
    /// x right, y up, z back instead of x right, y down, z forward.
    const OPENGL: Self = Self([(0, false), (1, true), (2, true)]);

    /// Returns all choices of axes, left-handed ones too.
    fn all() -> impl Iterator<Item = Self> {
        const ORDERS: [[usize; 3]; 6] = [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ];
        ORDERS.into_iter().flat_map(|order| {
            (0..8_usize).map(move |signs| {
                Self([0, 1, 2].map(|place| (order[place], (signs >> place) & 1 == 1)))
            })
        })
    }

    /// Returns the matrix from the scene's camera to the estimated one, whose columns are the named axes.
    fn matrix(self) -> DMat3 {
        let [x, y, z] = self.0.map(|(axis, is_reversed)| {
            let unit = DVec3::AXES[axis];
            if is_reversed { -unit } else { unit }
        });
        DMat3::from_cols(x, y, z)
    }

    /// Returns the number of conventions that must be broken for it, for the order of readings.
    fn strangeness(self) -> usize {
        match self {
            Self::OWN => 0,
            Self::OPENGL => 1,
            other if other.matrix().determinant() > 0.0 => 2,
            _ => 3,
        }
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.map(|(axis, is_reversed)| {
            let sign = if is_reversed { "-" } else { "" };
            format!("{sign}{}", ["x", "y", "z"][axis])
        });
        write!(f, "{x}, {y}, {z}")
    }
}

/// Meaning of the numbers of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reading {
    /// Number of frames behind a frame at which its pose stands.
    frames_on: isize,
    numbers: Numbers,
    axes: Axes,
}

impl Reading {
    const AS_IT_IS: Self = Self {
        frames_on: 0,
        numbers: Numbers::AsTheyAre,
        axes: Axes::OWN,
    };

    /// Returns shifts by a frame.
    fn shifts() -> impl Iterator<Item = Self> {
        [1, -1].into_iter().map(|frames_on| Self {
            frames_on,
            ..Self::AS_IT_IS
        })
    }

    /// Returns readings of the poses themselves, the usual ones first.
    fn of_poses() -> Vec<Self> {
        let numbers = [
            Numbers::AsTheyAre,
            Numbers::Inverse,
            Numbers::RealFirst,
            Numbers::RealLast,
        ];
        let mut all: Vec<Self> = numbers
            .into_iter()
            .flat_map(|numbers| {
                Axes::all().map(move |axes| Self {
                    frames_on: 0,
                    numbers,
                    axes,
                })
            })
            .filter(|reading| *reading != Self::AS_IT_IS)
            .collect();
        all.sort_by_key(|reading| {
            reading.axes.strangeness() + usize::from(reading.numbers != Numbers::AsTheyAre)
        });
        all
    }

    /// Returns the pose that is meant, with the axes of the estimated camera; `None` without a rotation.
    fn pose(self, pose: &Pose) -> Option<Pose> {
        let [a, b, c, d] = pose.rotation_wxyz;
        let with = |rotation_wxyz: [f64; 4]| Pose {
            rotation_wxyz,
            centre: pose.centre,
        };
        Some(match self.numbers {
            Numbers::AsTheyAre => *pose,
            Numbers::Inverse => {
                let back = pose.rotation()?.inverse();
                Pose::new(back, -(back * pose.centre()))
            }
            Numbers::RealFirst => with([b, c, d, a]),
            Numbers::RealLast => with([d, a, b, c]),
        })
    }

    /// Returns a motion of the estimated camera with the axes of the scene's.
    fn motion(self, (turn, step): (DQuat, DVec3)) -> (DQuat, DVec3) {
        let back = self.axes.matrix().transpose();
        // A reflection reverses the axis of a rotation once more.
        let axis = back.determinant() * (back * turn.xyz());
        let turn = DQuat::from_xyzw(axis.x, axis.y, axis.z, turn.w);
        (turn, back * step)
    }

    /// Returns the median error of the motions between the frames in this reading, degrees; `None` where too few frames
    /// have a pose.
    fn median_degrees(self, frames: &[FramePoses], least_baseline: f64) -> Option<f64> {
        let known: Vec<(Pose, Pose)> = (frames.iter().enumerate())
            .filter_map(|(number, frame)| {
                let holder = frames.get(number.checked_add_signed(self.frames_on)?)?;
                Some((frame.reference, self.pose(holder.estimated.as_ref()?)?))
            })
            .collect();
        let count = known.len().min(MOST_FRAMES);
        if count < LEAST_FRAMES {
            return None;
        }
        let spread: Vec<&(Pose, Pose)> = (0..count)
            .map(|index| &known[index * known.len() / count])
            .collect();
        let mut errors = Vec::new();
        for parts in PARTS_BETWEEN {
            let gap = count / parts;
            for (from, to) in spread.iter().zip(&spread[gap..]) {
                let reference = relative::motion(&from.0, &to.0)?;
                let estimated = self.motion(relative::motion(&from.1, &to.1)?);
                errors.push(relative::motion_degrees(
                    reference,
                    estimated,
                    least_baseline,
                ));
            }
        }
        median(&errors)
    }
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = match self.frames_on {
            0 => None,
            on if on > 0 => Some("before"),
            _ => Some("behind"),
        };
        if let Some(side) = side {
            return write!(
                f,
                "as those of the frame {side} their own (do frames count from 0, and are both clocks one?)"
            );
        }
        let numbers = match self.numbers {
            Numbers::AsTheyAre => None,
            Numbers::Inverse => {
                Some("inverted (world-to-camera in place of camera-to-world, or the reverse)")
            }
            Numbers::RealFirst => Some("with quaternions w, x, y, z in place of x, y, z, w"),
            Numbers::RealLast => Some("with quaternions x, y, z, w in place of w, x, y, z"),
        };
        let axes = (self.axes != Axes::OWN)
            .then(|| format!("with the camera axes {} in place of x, y, z", self.axes));
        let parts: Vec<String> = numbers.map(str::to_owned).into_iter().chain(axes).collect();
        f.write_str(&parts.join(" and "))
    }
}

/// Returns a line on the readings in which the poses fit much better; `None` without any. Poses are not aligned.
pub(super) fn note(frames: &[FramePoses], path_length: f64) -> Option<String> {
    let least_baseline = relative::least_baseline(path_length);
    let own = Reading::AS_IT_IS.median_degrees(frames, least_baseline)?;
    let mut readings: Vec<Reading> = Vec::new();
    if own >= LEAST_SHIFT_DEGREES {
        readings.extend(Reading::shifts());
    }
    if own >= LEAST_READING_DEGREES {
        readings.extend(Reading::of_poses());
    }
    let judged: Vec<(Reading, f64)> = readings
        .into_iter()
        .filter_map(|reading| {
            let degrees = reading.median_degrees(frames, least_baseline)?;
            (degrees <= MOST_LEFT * own && degrees <= MOST_DEGREES).then_some((reading, degrees))
        })
        .collect();
    let least = judged.iter().map(|one| one.1).reduce(f64::min)?;
    let named: Vec<String> = judged
        .iter()
        .filter(|(_, degrees)| *degrees <= ALIKE_SHARE * least + ALIKE_DEGREES)
        .take(NAMED)
        .map(|(reading, _)| reading.to_string())
        .collect();
    Some(format!(
        "{DIAGNOSIS_PREFIX}the poses fit much better {} (median error of a motion {least:.2} degrees instead of \
         {own:.2}; scores are of the poses as they are)",
        named.join(", or ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::tests::walk;

    /// Returns the line on poses that `change` makes of those of a walk, of its frame and the number of it.
    fn line(change: impl Fn(usize, &Pose) -> Option<Pose>) -> Option<String> {
        let walk: Vec<Pose> = walk().into_iter().flatten().collect();
        let frames: Vec<FramePoses> = (walk.iter().enumerate())
            .map(|(number, pose)| FramePoses {
                seconds: number as f64,
                reference: *pose,
                estimated: change(number, pose),
            })
            .collect();
        note(&frames, 12.0)
    }

    /// Returns a pose with other camera axes: the columns of `axes` are those of the scene's camera in them.
    fn with_axes(pose: &Pose, axes: DMat3) -> Option<Pose> {
        let rotation = DMat3::from_quat(pose.rotation()?);
        Pose::from_matrix(rotation * axes.transpose(), pose.centre())
    }

    #[test]
    fn every_mistake_is_named() {
        let permuted = |order: [usize; 4]| {
            line(|_, pose| {
                Some(Pose {
                    rotation_wxyz: order.map(|place| pose.rotation_wxyz[place]),
                    ..*pose
                })
            })
        };
        let inverse = |pose: &Pose| {
            let back = pose.rotation()?.inverse();
            Some(Pose::new(back, back * -pose.centre()))
        };
        let opengl = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let level = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
        let walk = walk();
        let at = |number: Option<usize>| *walk.get(number?)?;
        // A mirrored world with mirrored cameras, as of a left-handed engine: x points left in both.
        let mirrored = |pose: &Pose| {
            let [w, x, y, z] = pose.rotation_wxyz;
            let [a, b, c] = pose.centre;
            Some(Pose {
                rotation_wxyz: [w, x, -y, -z],
                centre: [-a, b, c],
            })
        };
        for (found, expected) in [
            (permuted([3, 0, 1, 2]), "quaternions w, x, y, z in place"),
            (permuted([1, 2, 3, 0]), "quaternions x, y, z, w in place"),
            (line(|_, pose| inverse(pose)), "inverted (world-to-camera"),
            (
                line(|_, pose| with_axes(pose, opengl)),
                "axes x, -y, -z in place",
            ),
            (
                line(|_, pose| with_axes(pose, level)),
                "axes -y, -z, x in place",
            ),
            (
                line(|_, pose| inverse(&with_axes(pose, opengl)?)),
                "or the reverse) and with the camera axes x, -y, -z",
            ),
            (line(|_, pose| mirrored(pose)), "axes -x, y, z in place"),
            (
                line(|number, _| at(number.checked_sub(1))),
                "the frame before their own",
            ),
            (
                line(|number, _| at(number.checked_add(1))),
                "the frame behind their own",
            ),
        ] {
            let found = found.unwrap_or_default();
            assert!(found.starts_with(DIAGNOSIS_PREFIX), "{expected}: {found}");
            assert!(found.contains(expected), "{expected}: {found}");
        }
    }

    /// Small and large errors have no finding, nor have poses in another world.
    #[test]
    fn poses_of_the_right_convention_have_no_line() {
        let world = DQuat::from_euler(glam::EulerRot::YXZ, 2.0, 0.4, -1.0);
        for degrees in [0.0_f64, 0.1, 1.0, 5.0, 40.0] {
            let found = line(|number, pose| {
                let at = number as f64;
                let axis = DVec3::new(at.sin(), (1.7 * at).cos(), (2.3 * at).sin()).normalize();
                let turn = DQuat::from_scaled_axis(degrees.to_radians() * axis);
                let offset = degrees * 0.01 * DVec3::new((3.1 * at).cos(), (4.7 * at).sin(), 0.5);
                let centre = 7.0 * (world * (pose.centre() + offset)) + DVec3::ONE;
                Some(Pose::new(world * pose.rotation()? * turn, centre))
            });
            assert_eq!(found, None, "{degrees} degrees");
        }
        // Too few frames to tell.
        let few = line(|number, pose| {
            (number < 7)
                .then(|| Pose::new(pose.rotation().unwrap_or_default().inverse(), pose.centre()))
        });
        assert_eq!(few, None);
    }
}
