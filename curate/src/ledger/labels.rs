//! Labels of people on segments, and their assignment to sequences.

use omnilife_schemas::records::{Author, LedgerAction, LedgerEntry, SegmentLabel, TimeRange};

/// A label belongs to a sequence if it covers more than this share of it.
const LEAST_SHARE: f64 = 0.5;

/// Returns all labels with their authors, in the order in which they were given.
pub fn all(entries: &[LedgerEntry]) -> impl Iterator<Item = (&Author, &SegmentLabel)> {
    entries.iter().filter_map(|entry| match &entry.action {
        LedgerAction::Label(label) => Some((&entry.author, label)),
        _ => None,
    })
}

/// Returns true if people exclude a segment of the video, by the label of highest precedence.
pub fn leaves_out(entries: &[LedgerEntry], range: TimeRange) -> bool {
    leave_out(entries, range) == Some(true)
}

/// Returns true if people keep a segment of the video, by the label of highest precedence.
pub fn keeps(entries: &[LedgerEntry], range: TimeRange) -> bool {
    leave_out(entries, range) == Some(false)
}

fn leave_out(entries: &[LedgerEntry], range: TimeRange) -> Option<bool> {
    let labels = of_segment(entries, range).into_iter().rev();
    labels.filter_map(|(_, label)| label.leave_out).next()
}

/// Returns the labels of a segment of the video in increasing precedence: later ones, and experts', come last.
pub fn of_segment(entries: &[LedgerEntry], range: TimeRange) -> Vec<(&Author, &SegmentLabel)> {
    let covers = |label: &SegmentLabel| {
        let begin = label.range.begin_seconds.max(range.begin_seconds);
        let end = label.range.end_seconds.min(range.end_seconds);
        end - begin > LEAST_SHARE * range.duration_seconds()
    };
    let mut labels: Vec<_> = all(entries).filter(|(_, label)| covers(label)).collect();
    // Stable: within a role, the order in which they were given stays.
    labels.sort_by_key(|(author, _)| matches!(author, Author::Expert(_)));
    labels
}
