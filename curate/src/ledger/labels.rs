//! What people say that segments show, and which of it is about a sequence.

use omnilife_schemas::records::{Author, LedgerAction, LedgerEntry, SegmentLabel, TimeRange};

/// A label is about a sequence of which it covers more than this share.
const LEAST_SHARE: f64 = 0.5;

/// All labels with who gave them, in the order in which they were given.
pub fn all(entries: &[LedgerEntry]) -> impl Iterator<Item = (&Author, &SegmentLabel)> {
    entries.iter().filter_map(|entry| match &entry.action {
        LedgerAction::Label(label) => Some((&entry.author, label)),
        _ => None,
    })
}

/// Whether people leave a segment of the video out: what the label that counts most says of it.
pub fn leaves_out(entries: &[LedgerEntry], range: TimeRange) -> bool {
    leave_out(entries, range) == Some(true)
}

/// Returns true where people keep a segment of the video, whatever it shows, by the label that counts most.
pub fn keeps(entries: &[LedgerEntry], range: TimeRange) -> bool {
    leave_out(entries, range) == Some(false)
}

fn leave_out(entries: &[LedgerEntry], range: TimeRange) -> Option<bool> {
    let labels = of_segment(entries, range).into_iter().rev();
    labels.filter_map(|(_, label)| label.leave_out).next()
}

/// The labels of a segment of the video, those that count more behind those that count less:
/// later ones, and experts'.
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
