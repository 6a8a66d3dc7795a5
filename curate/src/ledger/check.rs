//! Validation of boundaries and labels that enter a ledger.

use omnilife_schemas::records::{Boundary, SegmentLabel, TimeRange};

/// Timestamps are compared with this slack, seconds: files round them.
const ROUNDING_SECONDS: f64 = 1e-3;

/// Refuses a boundary that is not a segment of the video.
pub(super) fn boundary(boundary: &Boundary, range: TimeRange) -> Result<(), String> {
    let (begin, end) = (boundary.begin_seconds, boundary.end_seconds);
    if !(begin.is_finite() && end.is_finite()) {
        return Err(format!(
            "a boundary must have finite times, got {begin} to {end} s"
        ));
    }
    if begin >= end {
        return Err(format!("a boundary from {begin} to {end} s does not last"));
    }
    let inside = range.begin_seconds - ROUNDING_SECONDS..=range.end_seconds + ROUNDING_SECONDS;
    if !inside.contains(&begin) || !inside.contains(&end) {
        return Err(format!(
            "a boundary from {begin} to {end} s lies outside the video, which lasts from {} to {} s",
            range.begin_seconds, range.end_seconds
        ));
    }
    if !(boundary.score.is_finite()) {
        return Err(format!(
            "the boundary at {begin} s has the score {}",
            boundary.score
        ));
    }
    Ok(())
}

/// Refuses a label of an invalid segment, or without content.
pub(super) fn label(label: &SegmentLabel, range: TimeRange) -> Result<(), String> {
    let (begin, end) = (label.range.begin_seconds, label.range.end_seconds);
    if !(begin.is_finite() && end.is_finite() && begin < end) {
        return Err(format!(
            "a label from {begin} to {end} s is about no segment"
        ));
    }
    if begin < range.begin_seconds - ROUNDING_SECONDS || end > range.end_seconds + ROUNDING_SECONDS
    {
        return Err(format!(
            "a label from {begin} to {end} s lies outside the video, which lasts from {} to {} s",
            range.begin_seconds, range.end_seconds
        ));
    }
    let said = [&label.scene, &label.action];
    if let Some(name) = said
        .into_iter()
        .flatten()
        .find(|name| name.trim().is_empty())
    {
        return Err(format!("the label at {begin} s has the name {name:?}"));
    }
    let answers = [label.traversal, label.leave_out];
    if said.iter().all(|name| name.is_none()) && answers.iter().all(Option::is_none) {
        return Err(format!("the label at {begin} s says nothing"));
    }
    Ok(())
}

/// Sorts the boundaries of one author and refuses those that overlap.
pub(super) fn boundaries(
    mut list: Vec<Boundary>,
    range: TimeRange,
) -> Result<Vec<Boundary>, String> {
    list.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    for entry in &list {
        boundary(entry, range)?;
    }
    for pair in list.windows(2) {
        if pair[1].begin_seconds < pair[0].end_seconds - ROUNDING_SECONDS {
            return Err(format!(
                "the boundaries from {} to {} s and from {} to {} s overlap",
                pair[0].begin_seconds,
                pair[0].end_seconds,
                pair[1].begin_seconds,
                pair[1].end_seconds
            ));
        }
    }
    Ok(list)
}
