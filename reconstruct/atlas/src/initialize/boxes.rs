//! Planes of objects whose boxes are known (Neural Atlas Graphs, supplement A.4: planes from 3D boxes).
//!
//! A box belongs to the object whose masks its image overlaps most. Its plane goes through its centre, along the two
//! axes of the box that the camera sees best in the reference frame; it turns with the box.

use glam::{DMat3, DVec3};
use omnilife_engine::trajectories::rigid_spline::RigidPose;
use omnilife_schemas::{
    Similarity,
    oriented_box::OrientedBox,
    records::{Track, Tracks},
    rgb::Mask,
    trajectory::GroundAxes,
};

use super::silhouettes::Silhouette;
use crate::clip::Clip;

/// Number of masks that are compared with boxes, at most.
const COMPARED: usize = 8;
/// Minimum intersection over union of a box and the masks of its object.
const LEAST_OVERLAP: f64 = 0.3;
/// Minimum cosine between the plane's normal and the direction in which it is seen.
const LEAST_COSINE: f64 = 0.25;

/// Tracks with the way to the coordinates of a clip.
#[derive(Debug, Clone, Copy)]
pub struct TrackedBoxes<'a> {
    /// Tracks, world.
    pub tracks: &'a Tracks,
    /// World to normalized coordinates.
    pub to_normalized: Similarity,
}

/// Boxes of an object in the frames of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxPath {
    /// Number of its track.
    pub track: u32,
    /// Boxes by the number of the frame in the clip, normalized; `None` where the track does not reach.
    pub boxes: Vec<Option<OrientedBox>>,
    /// Source, with its evidence.
    pub reason: String,
}

impl BoxPath {
    /// Returns the poses of the plane in the frames of some silhouettes.
    pub(super) fn poses<'a>(
        &self,
        clip: &Clip,
        seen: &'a [Silhouette],
        reference: &Silhouette,
    ) -> Vec<(&'a Silhouette, RigidPose)> {
        let Some(at_reference) = self.boxes[reference.frame] else {
            return Vec::new();
        };
        let own = axes_of_plane(clip, reference.frame, &at_reference);
        let placed = seen.iter().filter_map(|seen| {
            let at = self.boxes[seen.frame]?;
            let rotation = at.axes * own;
            let view = (at.centre - clip.frames[seen.frame].pose.centre).normalize_or_zero();
            let is_seen = rotation.col(2).dot(view).abs() >= LEAST_COSINE;
            (is_seen || seen.frame == reference.frame).then_some((
                seen,
                RigidPose {
                    centre: at.centre,
                    rotation,
                },
            ))
        });
        placed.collect()
    }
}

/// Returns the axes of a plane in the coordinates of a box: the normal is the axis along which the box is seen, away
/// from the camera, and the first is as much to the right as an axis of the box is.
fn axes_of_plane(clip: &Clip, frame: usize, at: &OrientedBox) -> DMat3 {
    let camera = &clip.frames[frame].pose;
    let to_box = at.axes.transpose();
    let view = to_box * (at.centre - camera.centre).normalize_or(DVec3::Z);
    let right = to_box * camera.rotation.col(0);
    let normal = signed_axis(view, DVec3::ONE);
    let first = signed_axis(right, DVec3::ONE - normal.abs());
    DMat3::from_cols(first, normal.cross(first), normal)
}

/// Returns the axis with the sign of a direction's largest component, of those that are allowed (1, not 0).
fn signed_axis(direction: DVec3, allowed: DVec3) -> DVec3 {
    let sizes = (direction.abs() + 1e-12) * allowed;
    let axis = (0..3).fold(0, |best, axis| {
        if sizes[axis] > sizes[best] {
            axis
        } else {
            best
        }
    });
    let sign = if direction[axis] < 0.0 { -1.0 } else { 1.0 };
    sign * DVec3::AXES[axis]
}

/// Finds the track of each object, each for one object at most.
pub fn matched(
    clip: &Clip,
    seen: &[Vec<Silhouette>],
    given: &TrackedBoxes<'_>,
) -> Vec<Option<BoxPath>> {
    let paths: Vec<Vec<Option<OrientedBox>>> = given
        .tracks
        .tracks
        .iter()
        .map(|track| boxes_of(clip, track, given))
        .collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (object, seen) in seen.iter().enumerate() {
        for (track, boxes) in paths.iter().enumerate() {
            let overlap = overlap(clip, object, seen, boxes);
            if overlap >= LEAST_OVERLAP {
                pairs.push((overlap, object, track));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut found: Vec<Option<BoxPath>> = vec![None; seen.len()];
    let mut is_taken = vec![false; paths.len()];
    for (overlap, object, track) in pairs {
        if found[object].is_none() && !is_taken[track] {
            is_taken[track] = true;
            let id = given.tracks.tracks[track].id;
            found[object] = Some(BoxPath {
                track: id,
                boxes: paths[track].clone(),
                reason: format!(
                    "its plane is that of the box of track {id}, whose image and its masks overlap by {overlap:.2}"
                ),
            });
        }
    }
    found
}

/// Returns the boxes of a track in the frames of a clip, normalized.
fn boxes_of(clip: &Clip, track: &Track, given: &TrackedBoxes<'_>) -> Vec<Option<OrientedBox>> {
    let axes = GroundAxes::new(DVec3::from_array(given.tracks.up));
    let half = 0.5 * given.to_normalized.scale * DVec3::from_array(track.dimensions);
    let in_frame = |time: f64| {
        let seconds = clip.clock.begin_seconds + time * clip.clock.length_seconds;
        let (centre, heading) = track.path.at(seconds)?;
        Some(OrientedBox {
            centre: given.to_normalized.normalize(centre),
            axes: axes.rotation(heading),
            half,
        })
    };
    clip.frames
        .iter()
        .map(|frame| in_frame(frame.time))
        .collect()
}

/// Returns the intersection over union of a track's boxes and an object's masks, over some frames.
fn overlap(clip: &Clip, object: usize, seen: &[Silhouette], boxes: &[Option<OrientedBox>]) -> f64 {
    let [width, height] = clip.size();
    let stride = seen.len().div_ceil(COMPARED).max(1);
    let (mut both, mut either) = (0_usize, 0_usize);
    for seen in seen.iter().step_by(stride) {
        let frame = &clip.frames[seen.frame];
        let mut image = Mask {
            width,
            height,
            data: vec![0; width * height],
        };
        if let Some(at) = boxes[seen.frame] {
            at.in_camera(frame.pose.rotation, frame.pose.centre)
                .mark(&clip.camera, &mut image);
        }
        for (pixel, &marked) in image.data.iter().enumerate() {
            let is_masked = frame.covered(object, pixel) >= 0.5;
            both += usize::from(is_masked && marked > 0);
            either += usize::from(is_masked || marked > 0);
        }
    }
    both as f64 / either.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_those_of_the_side_that_is_seen() {
        for (direction, expected) in [
            (DVec3::new(0.1, -0.9, 0.3), -DVec3::Y),
            (DVec3::new(0.8, 0.1, -0.3), DVec3::X),
        ] {
            assert_eq!(signed_axis(direction, DVec3::ONE), expected);
        }
        let allowed = DVec3::new(1.0, 0.0, 1.0);
        assert_eq!(signed_axis(DVec3::new(0.1, -0.9, -0.3), allowed), -DVec3::Z);
        // A direction without a part along any allowed axis.
        assert_eq!(signed_axis(DVec3::Y, allowed), DVec3::X);
    }
}
