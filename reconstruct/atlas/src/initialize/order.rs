//! Distances of objects without evidence: half as far as the background, and behind the objects that hide them.

use rayon::prelude::*;

use super::{
    in_frames::InFrames,
    silhouettes::{Shape, Silhouette, reference},
};
use crate::clip::Clip;

/// Distance without evidence, over that of the background.
const GUESSED_DEPTH: f64 = 0.5;
/// Ratio of the distances of a hidden object and the one that hides it, where they meet.
const BEHIND: f64 = 1.1;
/// Maximum distance of an object, over the distance of the background.
const FARTHEST: f64 = 0.95;
/// Minimum covered share of an object: a smaller one may be an inaccurate mask.
const LEAST_COVERED: f64 = 0.02;
/// Minimum ratio of covered shares: if two objects cover each other, the one that covers so much more hides the
/// other.
const CLEARLY: f64 = 1.5;

/// A frame in which one object hides a part of another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Occlusion {
    behind: usize,
    front: usize,
    /// Their distances there, each over that in its reference frame.
    relative: [f64; 2],
}

/// Returns the distance of each object in its reference frame. `known` are the distances from scene points.
pub fn depths(
    clip: &Clip,
    seen: &[Vec<Silhouette>],
    in_frames: &[InFrames],
    known: &[Option<f64>],
    background: f64,
) -> Vec<f64> {
    // An object that gets much smaller is before the background then, too.
    let farthest: Vec<f64> = in_frames
        .iter()
        .map(|of_object| FARTHEST * background / of_object.farthest())
        .collect();
    let guesses = farthest
        .iter()
        .map(|far| far.min(GUESSED_DEPTH * background));
    let depths = known.iter().zip(guesses);
    let mut depths: Vec<f64> = depths
        .map(|(depth, guess)| depth.unwrap_or(guess))
        .collect();
    let occlusions = occlusions(clip, seen, in_frames);
    // One object pushes the next: at most as often as there are objects, in circles too.
    for _ in 0..depths.len() {
        for occlusion in occlusions.iter().filter(|one| known[one.behind].is_none()) {
            let [own, of_front] = occlusion.relative;
            let least = BEHIND * depths[occlusion.front] * of_front / own;
            let depth = &mut depths[occlusion.behind];
            *depth = depth.max(least.min(farthest[occlusion.behind]));
        }
    }
    depths
}

fn occlusions(clip: &Clip, seen: &[Vec<Silhouette>], in_frames: &[InFrames]) -> Vec<Occlusion> {
    let covered: Vec<Vec<(usize, Vec<f64>)>> = (0..seen.len())
        .map(|object| covered_shares(clip, object, &seen[object], &in_frames[object]))
        .collect();
    let relative_in = |object: usize, frame: usize| {
        let at = seen[object].iter().position(|seen| seen.frame == frame);
        at.map(|at| in_frames[object].frames[at].relative_depth)
    };
    let total = |object: usize, by: usize| -> f64 {
        covered[object].iter().map(|(_, shares)| shares[by]).sum()
    };
    let mut found = Vec::new();
    for (behind, frames) in covered.iter().enumerate() {
        let fronts = (0..seen.len()).filter(|&front| {
            front != behind && total(behind, front) > CLEARLY * total(front, behind)
        });
        for front in fronts {
            let met = frames
                .iter()
                .filter(|(_, shares)| shares[front] >= LEAST_COVERED);
            for &(frame, _) in met {
                let relative = [behind, front].map(|object| relative_in(object, frame));
                if let [Some(own), Some(of_front)] = relative {
                    found.push(Occlusion {
                        behind,
                        front,
                        relative: [own, of_front],
                    });
                }
            }
        }
    }
    found
}

/// Returns the shares of an object under the masks of others, for frames that show a part of it.
fn covered_shares(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    in_frames: &InFrames,
) -> Vec<(usize, Vec<f64>)> {
    let Some(reference) = reference(seen) else {
        return Vec::new();
    };
    let shape = Shape::of(clip, reference, 1.0);
    seen.par_iter()
        .zip(&in_frames.frames)
        .filter(|(seen, _)| seen.is_partial)
        .filter_map(|(seen, in_frame)| {
            let pose = in_frame.pose(clip, object, &shape, seen, in_frame.relative_depth)?;
            Some((seen.frame, shape.covered_shares(clip, seen.frame, &pose)))
        })
        .collect()
}
