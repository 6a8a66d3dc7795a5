//! Scores of boxes in images: detections, and identities over the clip.

use std::collections::BTreeMap;

use omnilife_schemas::{assignment::assign, records::Detection};
use serde::Serialize;

/// A box in a frame, with its object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackBox {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// The object.
    pub id: u32,
    /// Left, top, width and height, pixels.
    pub box_pixels: [f64; 4],
}

/// Least intersection over union of matching boxes.
pub const LEAST_OVERLAP: f64 = 0.3;

/// Counts and scores.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TrackScores {
    /// Boxes that should have been found.
    pub true_boxes: u32,
    /// Boxes that were found.
    pub found_boxes: u32,
    /// True boxes without a match.
    pub misses: u32,
    /// Found boxes without a match.
    pub false_positives: u32,
    /// Matches with another object than before.
    pub switches: u32,
    /// Number of times that a matched object was lost and found again.
    pub fragmentations: u32,
    /// Multiple object tracking accuracy.
    pub mota: f64,
    /// Identification F1.
    pub idf1: f64,
    /// Mean intersection over union of the matches; 0 without any.
    pub overlap: f64,
}

/// Returns the intersection over union of two boxes.
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
                // Not yet found, so finding it later is not a fragmentation.
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

/// Returns the F1 of the best one-to-one matching of identities.
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

/// Share of the true boxes that a detector finds, without regard to identities.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DetectionScores {
    /// Boxes that should have been found.
    pub true_boxes: u32,
    /// Boxes that were.
    pub found_boxes: u32,
    /// Share of the true boxes overlapped by a found one by [`LEAST_OVERLAP`]; 1 without any.
    pub recall: f64,
    /// Share of the found boxes that match a true one; 1 without any.
    pub precision: f64,
}

/// Scores detections frame by frame, without regard to identities.
pub fn score_detections(truth: &[Detection], found: &[Detection]) -> DetectionScores {
    let mut frames: BTreeMap<u32, [Vec<TrackBox>; 2]> = BTreeMap::new();
    for (side, boxes) in [truth, found].into_iter().enumerate() {
        for one in boxes {
            let of_frame = &mut frames.entry(one.frame).or_default()[side];
            of_frame.push(TrackBox {
                frame: one.frame,
                id: of_frame.len() as u32,
                box_pixels: one.box_pixels,
            });
        }
    }
    let matches = frames
        .values()
        .map(|[here, there]| matched(here, there, &BTreeMap::new()).len())
        .sum::<usize>() as f64;
    let share = |count: usize| {
        if count == 0 {
            1.0
        } else {
            matches / count as f64
        }
    };
    DetectionScores {
        true_boxes: truth.len() as u32,
        found_boxes: found.len() as u32,
        recall: share(truth.len()),
        precision: share(found.len()),
    }
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
        // Object 1 is found as 7 in three frames, then as 8; 2 is missed in frames 1 and 2; one box is false.
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
        // Matching identities: 3 boxes of 1 as 7, 2 of 2 as 9.
        assert!((scores.idf1 - 10.0 / 15.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_against_nothing_is_right() {
        let scores = score_boxes(&[], &[]);
        assert_eq!((scores.mota, scores.idf1), (1.0, 1.0));
        assert_eq!(score_boxes(&[], &[one(0, 1, 0.0)]).false_positives, 1);
    }
}
