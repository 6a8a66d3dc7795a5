//! Motion of a texture inside of its mask: scale, rotation and position of an object in each frame, over those in its
//! reference frame.
//!
//! The template is the inside of the reference frame's mask. Frames are aligned outwards from there, each from the
//! motion found beside it. Where the template no longer agrees, the last frame that does becomes the template: only
//! then do errors add up. A frame counts if enough of the template is in view, agrees, and determines the scale.
//!
//! * [`patch`]: insides of masks on tangent planes. [`alignment`]: one template against one patch.

pub mod alignment;
pub mod patch;

use glam::DVec2;
use rayon::prelude::*;

use self::{
    alignment::{Aligned, PlanarSimilarity, Template, aligned},
    patch::{Patch, extent, pixel_size, tangent},
};
use super::silhouettes::{Silhouette, plane_axes};
use crate::clip::Clip;

/// Samples along the longer side of the reference mask, at most.
const SAMPLES: f64 = 128.0;
/// Samples along the shorter side of the coarsest level, at least, and number of levels, at most.
const COARSEST: usize = 12;
const LEVELS: usize = 4;
/// Minimum share of the template in view.
const LEAST_SEEN: f64 = 0.2;
/// Minimum agreement of what is in view.
const LEAST_AGREEMENT: f64 = 0.4;
/// Maximum uncertainty of scale and rotation, radians.
const MOST_UNCERTAIN: f64 = 0.03;
/// Rotations of first guesses against the frame beside, radians.
const GUESSED_ANGLES: [f64; 3] = [0.0, 0.25, -0.25];

/// Motions of a texture, one for each silhouette of its object.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracked {
    /// From the tangent plane of the reference mask, around the mask's middle, to that of each mask; `None` where
    /// the texture does not tell.
    pub motions: Vec<Option<PlanarSimilarity>>,
    /// Mean agreement of the tracked frames, [0, 1], without the template's own; 0 where none is tracked.
    pub agreement: f64,
}

impl Tracked {
    /// Returns the share of silhouettes with a motion.
    pub fn share(&self) -> f64 {
        let known = self.motions.iter().flatten().count();
        known as f64 / self.motions.len().max(1) as f64
    }
}

/// A frame whose inside is the template.
struct Key {
    number: usize,
    template: Vec<Template>,
    /// From the reference mask's plane to positions around the template's centre.
    to_template: PlanarSimilarity,
}

/// A run of alignments outwards from the reference frame.
struct Chain<'a> {
    clip: &'a Clip,
    seen: &'a [Silhouette],
    patches: &'a [Option<Vec<Patch>>],
}

/// Returns the middle of a silhouette on its tangent plane.
pub fn middle_of(clip: &Clip, seen: &Silhouette) -> Option<DVec2> {
    tangent(&plane_axes(&clip.camera, seen.direction), seen.direction)
}

/// Tracks the texture of an object from the silhouette number `reference` to all others.
pub fn tracked(clip: &Clip, object: usize, seen: &[Silhouette], reference: usize) -> Tracked {
    let mut motions = vec![None; seen.len()];
    let none = |motions| Tracked {
        motions,
        agreement: 0.0,
    };
    let Some(step) = seen.get(reference).and_then(|seen| step_of(clip, seen)) else {
        return none(motions);
    };
    let patch = |seen: &Silhouette| {
        let patch = Patch::of(clip, object, seen, step)?;
        Some(patch.pyramid(COARSEST, LEVELS))
    };
    let patches: Vec<Option<Vec<Patch>>> = seen.par_iter().map(patch).collect();
    let chain = Chain {
        clip,
        seen,
        patches: &patches,
    };
    let Some(centre) = middle_of(clip, &seen[reference]) else {
        return none(motions);
    };
    let first = PlanarSimilarity::new(1.0, 0.0, centre);
    if chain.key(reference, first).is_none() {
        return none(motions);
    }
    motions[reference] = Some(first);
    let (mut sum, mut count) = (0.0, 0.0);
    let before: Vec<usize> = (0..reference).rev().collect();
    let after: Vec<usize> = (reference + 1..seen.len()).collect();
    for numbers in [before, after] {
        for (number, found) in chain.outwards(reference, first, &numbers) {
            motions[number] = Some(found.motion);
            sum += found.agreement;
            count += 1.0;
        }
    }
    Tracked {
        motions,
        agreement: sum / f64::max(count, 1.0),
    }
}

/// Returns the distance of samples for an object with this reference silhouette.
fn step_of(clip: &Clip, reference: &Silhouette) -> Option<f64> {
    let [low, high] = extent(clip, reference)?;
    Some(pixel_size(&clip.camera).max((high - low).max_element() / SAMPLES))
}

impl Chain<'_> {
    /// Makes a template of a silhouette. `motion` is that of the reference mask to it.
    fn key(&self, number: usize, motion: PlanarSimilarity) -> Option<Key> {
        let centre = motion.shift;
        let template = Template::pyramid(self.patches[number].as_ref()?, centre);
        (!template.is_empty()).then_some(Key {
            number,
            template,
            to_template: PlanarSimilarity {
                turn: motion.turn,
                shift: DVec2::ZERO,
            },
        })
    }

    /// Aligns silhouettes one by one; returns those that agree, with their motions from the reference mask.
    fn outwards(
        &self,
        reference: usize,
        first: PlanarSimilarity,
        numbers: &[usize],
    ) -> Vec<(usize, Aligned)> {
        let mut found = Vec::new();
        let Some(mut key) = self.key(reference, first) else {
            return found;
        };
        let (mut last, mut motion) = (reference, first);
        for &number in numbers {
            let starts = self.starts(last, &motion, number);
            let mut agreed = self.aligned_with(&key, number, &starts);
            if agreed.is_none()
                && key.number != last
                && let Some(next) = self.key(last, motion)
            {
                key = next;
                agreed = self.aligned_with(&key, number, &starts);
            }
            if let Some(agreed) = agreed {
                (last, motion) = (number, agreed.motion);
                found.push((number, agreed));
            }
        }
        found
    }

    /// Returns first guesses for a silhouette, from the reference mask's plane: the texture moves as the mask's
    /// middle, or stays in the world.
    fn starts(
        &self,
        last: usize,
        motion: &PlanarSimilarity,
        number: usize,
    ) -> Vec<PlanarSimilarity> {
        let [from, to] = [last, number].map(|number| &self.seen[number]);
        let axes = [from, to].map(|seen| plane_axes(&self.clip.camera, seen.direction));
        let rotations = [from, to].map(|seen| self.clip.frames[seen.frame].pose.rotation);
        let in_world = rotations[0] * axes[0] * motion.shift.extend(1.0);
        let stays = tangent(&axes[1], rotations[1].transpose() * in_world);
        let middles = [from, to].map(|seen| middle_of(self.clip, seen));
        let moves = match middles {
            [Some(from), Some(to)] => Some(to + motion.shift - from),
            _ => None,
        };
        let with_angle = |shift: DVec2| {
            GUESSED_ANGLES.map(|angle| PlanarSimilarity {
                turn: DVec2::from_angle(angle).rotate(motion.turn),
                shift,
            })
        };
        let shifts = [moves, stays].into_iter().flatten();
        shifts.flat_map(with_angle).collect()
    }

    /// Aligns a silhouette with a template; `None` where they do not agree. Motions are those of the reference mask.
    fn aligned_with(
        &self,
        key: &Key,
        number: usize,
        starts: &[PlanarSimilarity],
    ) -> Option<Aligned> {
        let back = key.to_template.inverse();
        let starts: Vec<PlanarSimilarity> = starts.iter().map(|start| start.after(&back)).collect();
        let found = aligned(&key.template, self.patches[number].as_ref()?, &starts)?;
        let agrees = found.seen >= LEAST_SEEN
            && found.agreement >= LEAST_AGREEMENT
            && found.uncertainty <= MOST_UNCERTAIN;
        agrees.then(|| Aligned {
            motion: found.motion.after(&key.to_template),
            ..found
        })
    }
}

#[cfg(test)]
mod tests;
