//! Scores of tracks beside true ones: who is found, who is confused with whom, how far off on the ground.
//!
//! Per frame true and found objects are matched by their boxes in the image (CLEAR MOT, Bernardin and
//! Stiefelhagen 2008): pairs that were matched before stay matched while their boxes overlap enough, and
//! of the others as many as possible are, those that overlap most first. Identities over the clip (IDF1,
//! Ristani et al. 2016) are matched one to one so that as many boxes as possible agree.
//!
//! ```text
//! MOTA = 1 - (misses + false positives + switches) / true boxes
//! IDF1 = 2 IDTP / (true boxes + found boxes)
//! ```

use std::collections::BTreeMap;

use glam::DVec3;
use omnilife_schemas::{
    assignment::assign,
    records::{Detection, Scene, Tracks},
    statistics::median,
    trajectory::{GroundAxes, nearest_turn},
};
use serde::Serialize;

/// A box in a frame, with what is known of its object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackBox {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// The object.
    pub id: u32,
    /// Left, top, width and height, pixels.
    pub box_pixels: [f64; 4],
}

/// Least intersection over union of boxes that are of one object.
pub const LEAST_OVERLAP: f64 = 0.3;

/// What was counted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TrackScores {
    /// Boxes that should have been found.
    pub true_boxes: u32,
    /// Boxes that were.
    pub found_boxes: u32,
    /// True boxes without a match.
    pub misses: u32,
    /// Found boxes without a match.
    pub false_positives: u32,
    /// Matches with another object than the one before.
    pub switches: u32,
    /// Times that a matched object was lost and found again.
    pub fragmentations: u32,
    /// Multiple object tracking accuracy.
    pub mota: f64,
    /// Identification F1.
    pub idf1: f64,
    /// Mean intersection over union of the matches; 0 without any.
    pub overlap: f64,
}

/// Intersection over union of two boxes.
pub fn overlap(a: [f64; 4], b: [f64; 4]) -> f64 {
    let side = |axis: usize| {
        let from = a[axis].max(b[axis]);
        let to = (a[axis] + a[axis + 2]).min(b[axis] + b[axis + 2]);
        (to - from).max(0.0)
    };
    let common = side(0) * side(1);
    let union = a[2] * a[3] + b[2] * b[3] - common;
    if union > 0.0 { common / union } else { 0.0 }
}

/// Scores found boxes against true ones.
pub fn score_boxes(truth: &[TrackBox], found: &[TrackBox]) -> TrackScores {
    let by_frame = |boxes: &[TrackBox]| {
        let mut frames: BTreeMap<u32, Vec<TrackBox>> = BTreeMap::new();
        for one in boxes {
            frames.entry(one.frame).or_default().push(*one);
        }
        frames
    };
    let (truth_frames, found_frames) = (by_frame(truth), by_frame(found));
    let mut scores = TrackScores {
        true_boxes: truth.len() as u32,
        found_boxes: found.len() as u32,
        ..TrackScores::default()
    };
    let mut last: BTreeMap<u32, u32> = BTreeMap::new();
    let mut was_matched: BTreeMap<u32, bool> = BTreeMap::new();
    let mut overlaps = Vec::new();
    let none = Vec::new();
    let mut frames: Vec<&u32> = truth_frames.keys().chain(found_frames.keys()).collect();
    frames.sort_unstable();
    frames.dedup();
    for frame in frames {
        let (here, there) = (
            truth_frames.get(frame).unwrap_or(&none),
            found_frames.get(frame).unwrap_or(&none),
        );
        let matches = matched(here, there, &last);
        scores.misses += (here.len() - matches.len()) as u32;
        scores.false_positives += (there.len() - matches.len()) as u32;
        for (index, one) in here.iter().enumerate() {
            let partner = matches.iter().find(|(true_index, _)| *true_index == index);
            let before = was_matched.insert(one.id, partner.is_some());
            if let Some(&(_, other)) = partner {
                overlaps.push(overlap(one.box_pixels, there[other].box_pixels));
                let id = there[other].id;
                if last.insert(one.id, id).is_some_and(|before| before != id) {
                    scores.switches += 1;
                }
                if before == Some(false) && overlaps.len() > 1 {
                    scores.fragmentations += 1;
                }
            } else if before.is_none() {
                // Not yet found: finding it later is no fragmentation.
                was_matched.remove(&one.id);
            }
        }
    }
    let errors = f64::from(scores.misses + scores.false_positives + scores.switches);
    scores.mota = 1.0 - errors / f64::from(scores.true_boxes.max(1));
    scores.idf1 = identity_f1(truth, found, &truth_frames, &found_frames);
    scores.overlap = overlaps.iter().sum::<f64>() / overlaps.len().max(1) as f64;
    scores
}

/// Matches of a frame: numbers of true and found boxes.
fn matched(
    here: &[TrackBox],
    there: &[TrackBox],
    last: &BTreeMap<u32, u32>,
) -> Vec<(usize, usize)> {
    let mut matches = Vec::new();
    let (mut is_used_here, mut is_used_there) = (vec![false; here.len()], vec![false; there.len()]);
    for (index, one) in here.iter().enumerate() {
        let partner = last
            .get(&one.id)
            .and_then(|id| there.iter().position(|other| other.id == *id));
        if let Some(other) = partner
            && !is_used_there[other]
            && overlap(one.box_pixels, there[other].box_pixels) >= LEAST_OVERLAP
        {
            matches.push((index, other));
            is_used_here[index] = true;
            is_used_there[other] = true;
        }
    }
    let rows: Vec<usize> = (0..here.len()).filter(|&row| !is_used_here[row]).collect();
    let columns: Vec<usize> = (0..there.len())
        .filter(|&column| !is_used_there[column])
        .collect();
    // A pair that does not overlap enough costs more than any number of others.
    let costs: Vec<Vec<f64>> = rows
        .iter()
        .map(|&row| {
            let cost = |&column: &usize| {
                let common = overlap(here[row].box_pixels, there[column].box_pixels);
                if common >= LEAST_OVERLAP {
                    1.0 - common
                } else {
                    1e6
                }
            };
            columns.iter().map(cost).collect()
        })
        .collect();
    for (row, column) in assign(&costs, columns.len()).into_iter().enumerate() {
        if let Some(column) = column.filter(|&column| costs[row][column] < 1e6) {
            matches.push((rows[row], columns[column]));
        }
    }
    matches
}

/// F1 of the best one-to-one matching of identities.
fn identity_f1(
    truth: &[TrackBox],
    found: &[TrackBox],
    truth_frames: &BTreeMap<u32, Vec<TrackBox>>,
    found_frames: &BTreeMap<u32, Vec<TrackBox>>,
) -> f64 {
    let ids = |boxes: &[TrackBox]| {
        let mut ids: Vec<u32> = boxes.iter().map(|one| one.id).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    };
    let (rows, columns) = (ids(truth), ids(found));
    let mut common = vec![vec![0.0; columns.len()]; rows.len()];
    for (frame, here) in truth_frames {
        for one in here {
            for other in found_frames.get(frame).into_iter().flatten() {
                if overlap(one.box_pixels, other.box_pixels) >= LEAST_OVERLAP
                    && let (Ok(row), Ok(column)) = (
                        rows.binary_search(&one.id),
                        columns.binary_search(&other.id),
                    )
                {
                    common[row][column] -= 1.0;
                }
            }
        }
    }
    let assigned = assign(&common, columns.len());
    let agreed: f64 = assigned
        .iter()
        .enumerate()
        .filter_map(|(row, column)| Some(-common[row][(*column)?]))
        .sum();
    let all = (truth.len() + found.len()) as f64;
    if all > 0.0 { 2.0 * agreed / all } else { 1.0 }
}

/// Errors of paths in space; `None` where no true object is near any.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PathScores {
    /// Sightings that were compared.
    pub samples: u32,
    /// Sightings of true moving objects without a path within [`REACH_METRES`].
    pub missing: u32,
    /// Median distance on the ground, metres.
    pub ground_metres: f64,
    /// Median error of the heading while it moves, degrees.
    pub heading_degrees: f64,
    /// Median error of the length, metres.
    pub length_metres: f64,
}

/// A path is of the true object that is the nearest within this, metres.
pub const REACH_METRES: f64 = 3.0;
/// Below this speed an object stands, metres per second.
const LEAST_SPEED: f64 = 0.5;

/// Scores of tracks against true ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrackReport {
    /// In the images.
    pub boxes: TrackScores,
    /// In space; none where no path is near a true one.
    pub paths: Option<PathScores>,
}

/// Scores tracks against true ones in the frames that were looked at; boxes without a track count for
/// neither.
pub fn compare_tracks(truth: &Tracks, found: &Tracks, scene: &Scene) -> TrackReport {
    let boxes = |tracks: &Tracks| -> Vec<TrackBox> {
        let of_track = |one: &Detection| {
            Some(TrackBox {
                frame: one.frame,
                id: one.track?,
                box_pixels: one.box_pixels,
            })
        };
        let here = tracks
            .detections
            .iter()
            .filter(|one| found.frames.contains(&one.frame));
        here.filter_map(of_track).collect()
    };
    TrackReport {
        boxes: score_boxes(&boxes(truth), &boxes(found)),
        paths: score_paths(truth, found, scene),
    }
}

/// Scores paths at the times at which true objects are seen.
fn score_paths(truth: &Tracks, found: &Tracks, scene: &Scene) -> Option<PathScores> {
    let up = DVec3::from_array(found.up);
    let axes = [
        GroundAxes::new(DVec3::from_array(truth.up)),
        GroundAxes::new(up),
    ];
    let metres = found.metres_per_unit;
    let (mut ground, mut headings, mut lengths, mut missing) =
        (Vec::new(), Vec::new(), Vec::new(), 0);
    for sighting in truth
        .detections
        .iter()
        .filter(|one| found.frames.contains(&one.frame))
    {
        let seconds = scene.frames.get(sighting.frame as usize)?.time_seconds;
        let object = truth
            .tracks
            .iter()
            .find(|track| Some(track.id) == sighting.track);
        let Some((object, (centre, true_heading))) =
            object.and_then(|object| Some((object, object.path.at(seconds)?)))
        else {
            continue;
        };
        let near = found.tracks.iter().filter_map(|track| {
            let (place, heading) = track.path.at(seconds)?;
            let offset = place - centre;
            let on_ground = (offset - up * offset.dot(up)).length() * metres;
            (on_ground <= REACH_METRES).then_some((on_ground, heading, track))
        });
        let Some((distance, heading, track)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            missing += 1;
            continue;
        };
        ground.push(distance);
        lengths.push((track.dimensions[0] - object.dimensions[0]).abs() * metres);
        if object.path.centre.velocity(seconds).length() * metres > LEAST_SPEED {
            let forward = axes[0].rotation(true_heading).x_axis;
            let error = nearest_turn(heading - axes[1].heading(forward), 0.0);
            headings.push(error.abs().to_degrees());
        }
    }
    Some(PathScores {
        samples: ground.len() as u32,
        missing,
        ground_metres: median(&ground)?,
        heading_degrees: median(&headings).unwrap_or(0.0),
        length_metres: median(&lengths)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(frame: u32, id: u32, left: f64) -> TrackBox {
        TrackBox {
            frame,
            id,
            box_pixels: [left, 0.0, 10.0, 10.0],
        }
    }

    #[test]
    fn overlaps_are_those_of_areas() {
        assert_eq!(
            overlap([0.0, 0.0, 2.0, 2.0], [1.0, 0.0, 2.0, 2.0]),
            1.0 / 3.0
        );
        assert_eq!(overlap([0.0, 0.0, 2.0, 2.0], [3.0, 0.0, 2.0, 2.0]), 0.0);
    }

    /// Counted by hand.
    #[test]
    fn misses_false_boxes_and_switches_are_counted() {
        let truth: Vec<TrackBox> = (0..4)
            .flat_map(|f| [one(f, 1, 0.0), one(f, 2, 50.0)])
            .collect();
        assert_eq!(score_boxes(&truth, &truth).mota, 1.0);
        assert_eq!(score_boxes(&truth, &truth).idf1, 1.0);
        // 1 is found as 7 in three frames, then as 8; 2 is missed in frames 1 and 2; one box is of nothing.
        let found = vec![
            one(0, 7, 1.0),
            one(1, 7, 1.0),
            one(2, 7, 1.0),
            one(3, 8, 1.0),
            one(0, 9, 50.0),
            one(3, 9, 50.0),
            one(2, 10, 200.0),
        ];
        let scores = score_boxes(&truth, &found);
        assert_eq!(
            (scores.misses, scores.false_positives, scores.switches),
            (2, 1, 1)
        );
        assert_eq!(scores.fragmentations, 1);
        assert!((scores.mota - 0.5).abs() < 1e-12);
        // Identities that agree: 3 boxes of 1 as 7, 2 of 2 as 9.
        assert!((scores.idf1 - 10.0 / 15.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_against_nothing_is_right() {
        let scores = score_boxes(&[], &[]);
        assert_eq!((scores.mota, scores.idf1), (1.0, 1.0));
        assert_eq!(score_boxes(&[], &[one(0, 1, 0.0)]).false_positives, 1);
    }
}
