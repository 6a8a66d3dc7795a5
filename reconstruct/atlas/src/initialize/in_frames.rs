//! Distance, turn and position of an object in each of its frames, over those in its reference frame.
//!
//! In this order: from the [texture](super::tracking) inside of the mask; where that does not tell, from the whole
//! outline of the mask. An outline that a thing without a mask cuts has a smaller area, but most of its edge stays.

use glam::DVec2;
use omnilife_engine::trajectories::rigid_spline::RigidPose;
use omnilife_schemas::trajectory::nearest_turn;

use super::{
    silhouettes::{Fit, Shape, Silhouette, SilhouettePose, reference},
    tracking::{Tracked, tracked},
};
use crate::clip::Clip;

/// Minimum share of masks in which the texture is tracked.
const LEAST_TRACKED: f64 = 0.5;
/// Overlap with the masks beyond which the texture's motion needs no comparison.
const GOOD_OVERLAP: f64 = 0.9;
/// Difference of overlaps by which outlines are better than textures.
const CLEARLY: f64 = 0.05;
/// Minimum share of the masks under a shape that moves as its texture: what is missing of the overlap then is hidden.
const LEAST_REACHED: f64 = 0.9;

/// An object in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectInFrame {
    /// Depth of its plane, over that in the reference frame.
    pub relative_depth: f64,
    /// Rotation about its plane's normal, radians.
    pub turn: f64,
    /// Position of its middle on the tangent plane of the mask; `None` where the mask's outline gives it.
    pub shift: Option<DVec2>,
}

/// An object in all of its frames.
#[derive(Debug, Clone, PartialEq)]
pub struct InFrames {
    /// One for each silhouette.
    pub frames: Vec<ObjectInFrame>,
    /// Source, with its evidence.
    pub reason: String,
}

impl ObjectInFrame {
    /// Returns the pose of its plane, `depth` away; `None` where too little is visible.
    pub(super) fn pose(
        &self,
        clip: &Clip,
        object: usize,
        shape: &Shape,
        seen: &Silhouette,
        depth: f64,
    ) -> Option<RigidPose> {
        let turn = self.turn;
        match self.shift {
            Some(shift) => Some(SilhouettePose { turn, shift }.pose(clip, seen, depth)),
            None => shape.placed(clip, object, seen, depth, turn),
        }
    }
}

impl InFrames {
    /// Returns the largest depth over that in the reference frame, 1 at least.
    pub fn farthest(&self) -> f64 {
        let depths = self.frames.iter().map(|frame| frame.relative_depth);
        depths.fold(1.0, f64::max)
    }
}

/// Known depth and turn of some silhouettes.
type KnownPlaces = Vec<Option<ObjectInFrame>>;

/// Decides on the motion of an object with these silhouettes.
pub fn of(clip: &Clip, object: usize, seen: &[Silhouette]) -> InFrames {
    let number = reference(seen)
        .and_then(|reference| seen.iter().position(|one| one.frame == reference.frame));
    let Some(number) = number else {
        return InFrames {
            frames: Vec::new(),
            reason: "its masks are empty".to_owned(),
        };
    };
    let shape = Shape::of(clip, &seen[number], 1.0);
    let track = tracked(clip, object, seen, number);
    let count = track.motions.iter().flatten().count();
    let all = seen.len();
    let judge = |known: KnownPlaces| {
        let frames = filled(seen, known);
        let fit = mean_fit(clip, object, seen, &shape, &frames);
        (frames, fit)
    };
    let by_outline = || judge(outlines(clip, object, seen, &shape, number));
    if track.share() < LEAST_TRACKED {
        let (frames, fit) = by_outline();
        let reason = format!(
            "its motion is that of the mask's outline ({}): the texture is tracked in {count} of {all} masks",
            words(&fit)
        );
        return InFrames { frames, reason };
    }
    let (frames, fit) = judge(textures(&track));
    let tracked = format!(
        "its texture is tracked in {count} of {all} masks (agreement {:.2}, {})",
        track.agreement,
        words(&fit)
    );
    if fit.overlap < GOOD_OVERLAP {
        let (of_outlines, other) = by_outline();
        if other.overlap > fit.overlap + CLEARLY && fit.reached < LEAST_REACHED {
            let reason = format!(
                "its motion is that of the mask's outline ({}); {tracked} and leaves it",
                words(&other)
            );
            return InFrames {
                frames: of_outlines,
                reason,
            };
        }
    }
    InFrames {
        frames,
        reason: tracked,
    }
}

fn words(fit: &Fit) -> String {
    format!(
        "overlap {:.3}, {:.0} % of the masks reached",
        fit.overlap,
        100.0 * fit.reached
    )
}

fn textures(track: &Tracked) -> KnownPlaces {
    let motions = track.motions.iter();
    motions
        .map(|motion| {
            motion.map(|motion| ObjectInFrame {
                relative_depth: 1.0 / motion.scale(),
                turn: motion.angle(),
                shift: Some(motion.shift),
            })
        })
        .collect()
}

/// Lays the reference shape over all complete masks, outwards from the reference frame.
fn outlines(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    shape: &Shape,
    reference: usize,
) -> KnownPlaces {
    let mut known: KnownPlaces = vec![None; seen.len()];
    let first = ObjectInFrame {
        relative_depth: 1.0,
        turn: 0.0,
        shift: None,
    };
    known[reference] = Some(first);
    let before: Vec<usize> = (0..reference).rev().collect();
    let after: Vec<usize> = (reference + 1..seen.len()).collect();
    for numbers in [before, after] {
        let mut last = first;
        for number in numbers {
            let own = &seen[number];
            if own.is_partial && !seen[reference].is_partial {
                continue;
            }
            let guess = [last.relative_depth, last.turn];
            if let Some((relative_depth, at)) = shape.laid_over(clip, object, own, guess) {
                last = ObjectInFrame {
                    relative_depth,
                    turn: at.turn,
                    shift: Some(at.shift),
                };
                known[number] = Some(last);
            }
        }
    }
    known
}

/// Gives silhouettes between known ones depths and turns between theirs, without positions.
fn filled(seen: &[Silhouette], known: KnownPlaces) -> Vec<ObjectInFrame> {
    let numbers: Vec<usize> = (0..known.len())
        .filter(|&number| known[number].is_some())
        .collect();
    let without_place = |number: usize| {
        let after = numbers.partition_point(|&other| other < number);
        let before = after.checked_sub(1).and_then(|at| numbers.get(at));
        let [before, next] = [before, numbers.get(after)].map(|at| {
            let at = *at?;
            Some((seen[at].frame as f64, known[at]?))
        });
        let (from, to) = match (before, next) {
            (Some(from), Some(to)) => (from, to),
            (Some(one), None) | (None, Some(one)) => (one, one),
            (None, None) => return UNKNOWN,
        };
        let span = to.0 - from.0;
        let share = if span > 0.0 {
            (seen[number].frame as f64 - from.0) / span
        } else {
            0.0
        };
        let turn = nearest_turn(to.1.turn, from.1.turn);
        let [first, last] = [from.1, to.1].map(|one| one.relative_depth.ln());
        ObjectInFrame {
            relative_depth: (first + share * (last - first)).exp(),
            turn: from.1.turn + share * (turn - from.1.turn),
            shift: None,
        }
    };
    (0..known.len())
        .map(|number| known[number].unwrap_or_else(|| without_place(number)))
        .collect()
}

/// An object as in its reference frame.
const UNKNOWN: ObjectInFrame = ObjectInFrame {
    relative_depth: 1.0,
    turn: 0.0,
    shift: None,
};

/// Returns the mean agreement of the shape with the masks, 0 where it has no place.
fn mean_fit(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    shape: &Shape,
    frames: &[ObjectInFrame],
) -> Fit {
    let mut sum = Fit {
        overlap: 0.0,
        reached: 0.0,
    };
    for (seen, frame) in seen.iter().zip(frames) {
        let depth = frame.relative_depth;
        if let Some(pose) = frame.pose(clip, object, shape, seen, depth) {
            let fit = shape.fit(clip, object, seen, depth, &pose);
            sum.overlap += fit.overlap;
            sum.reached += fit.reached;
        }
    }
    let count = seen.len().max(1) as f64;
    Fit {
        overlap: sum.overlap / count,
        reached: sum.reached / count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_between_known_ones_are_between_them() {
        let silhouettes: Vec<Silhouette> = [0, 2, 3, 6].map(Silhouette::at_frame).to_vec();
        let one = |relative_depth: f64, turn: f64| {
            Some(ObjectInFrame {
                relative_depth,
                turn,
                shift: Some(DVec2::X),
            })
        };
        // Half a turn apart by the short way, over the seam of angles.
        let known = vec![one(1.0, 3.0), None, None, one(4.0, -3.0)];
        let found = filled(&silhouettes, known);
        let short = std::f64::consts::TAU - 6.0;
        for (number, share) in [(1, 1.0 / 3.0), (2, 0.5)] {
            let expected = 4.0_f64.powf(share);
            assert!((found[number].relative_depth - expected).abs() < 1e-12);
            assert!((found[number].turn - 3.0 - share * short).abs() < 1e-12);
            assert_eq!(found[number].shift, None);
        }
        assert_eq!(found[0].shift, Some(DVec2::X));
        let ends = filled(&silhouettes, vec![None, one(2.0, 0.5), None, None]);
        assert!(
            ends.iter()
                .all(|one| (one.relative_depth - 2.0).abs() < 1e-12)
        );
        assert_eq!(filled(&silhouettes, vec![None; 4]), [UNKNOWN; 4]);
    }
}
