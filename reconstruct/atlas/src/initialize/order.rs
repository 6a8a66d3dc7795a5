//! Distances of objects without evidence: half as far as the background, and behind the objects that hide them.

use rayon::prelude::*;

use super::silhouettes::{Shape, Silhouette, reference, relative_depths};
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
    known: &[Option<f64>],
    background: f64,
) -> Vec<f64> {
    let guess = GUESSED_DEPTH * background;
    let mut depths: Vec<f64> = known.iter().map(|depth| depth.unwrap_or(guess)).collect();
    let occlusions = occlusions(clip, seen);
    // One object pushes the next: at most as often as there are objects, in circles too.
    for _ in 0..depths.len() {
        for occlusion in occlusions.iter().filter(|one| known[one.behind].is_none()) {
            let [own, of_front] = occlusion.relative;
            let least = BEHIND * depths[occlusion.front] * of_front / own;
            let depth = &mut depths[occlusion.behind];
            *depth = depth.max(least).min(FARTHEST * background);
        }
    }
    depths
}

fn occlusions(clip: &Clip, seen: &[Vec<Silhouette>]) -> Vec<Occlusion> {
    let relative: Vec<Vec<f64>> = seen
        .iter()
        .map(|seen| relative_to_reference(seen))
        .collect();
    let covered: Vec<Vec<(usize, Vec<f64>)>> = (0..seen.len())
        .map(|object| covered_shares(clip, object, &seen[object], &relative[object]))
        .collect();
    let relative_in = |object: usize, frame: usize| {
        let at = seen[object].iter().position(|seen| seen.frame == frame);
        at.map(|at| relative[object][at])
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

fn relative_to_reference(seen: &[Silhouette]) -> Vec<f64> {
    reference(seen).map_or_else(Vec::new, |reference| relative_depths(seen, reference))
}

/// Returns the shares of an object under the masks of others, for frames that show a part of it.
fn covered_shares(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    relative: &[f64],
) -> Vec<(usize, Vec<f64>)> {
    let Some(reference) = reference(seen) else {
        return Vec::new();
    };
    let shape = Shape::of(clip, reference, 1.0);
    seen.par_iter()
        .zip(relative)
        .filter(|(seen, _)| seen.is_partial)
        .filter_map(|(seen, &depth)| {
            let pose = shape.placed(clip, object, seen, depth)?;
            Some((seen.frame, shape.covered_shares(clip, seen.frame, &pose)))
        })
        .collect()
}
