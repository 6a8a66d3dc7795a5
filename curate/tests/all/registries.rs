//! The static slices: unique ids, and a word on everything.

use std::collections::BTreeSet;

use omnilife_curate::{
    boundaries::{DEFAULT_DETECTOR, DETECTORS},
    criteria::{CHECKS, PROFILES},
    poses::sfm::FALLBACK_CONFIGURATIONS,
    projection::TESTS,
    shots,
};

fn assert_described<'a>(entries: impl Iterator<Item = (&'a str, &'a str)>) {
    let mut ids = BTreeSet::new();
    for (id, summary) in entries {
        assert!(ids.insert(id), "{id} is there twice");
        assert!(
            !id.is_empty()
                && id
                    .chars()
                    .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-'),
            "{id} is no id"
        );
        assert!(
            summary.ends_with('.') && summary.len() > 12,
            "{id}: {summary}"
        );
    }
    assert!(!ids.is_empty());
}

#[test]
fn every_entry_has_a_unique_id_and_a_summary() {
    assert_described(DETECTORS.iter().map(|entry| (entry.id, entry.summary)));
    assert_described(TESTS.iter().map(|entry| (entry.id, entry.summary)));
    assert_described(CHECKS.iter().map(|entry| (entry.id, entry.summary)));
    assert_described((shots::CHECKS.iter()).map(|entry| (entry.id, entry.summary)));
    assert_described(PROFILES.iter().map(|entry| (entry.id, entry.summary)));
    assert_described(
        FALLBACK_CONFIGURATIONS
            .iter()
            .map(|entry| (entry.id, entry.summary)),
    );
    assert!(DETECTORS.iter().any(|entry| entry.id == DEFAULT_DETECTOR));
    for test in TESTS {
        assert!(test.limit > 0.0 && test.limit.is_finite(), "{}", test.id);
        assert_ne!(test.at_most, test.above, "{}", test.id);
    }
    for detector in DETECTORS {
        assert!(!(detector.settings)().contains('\n'), "{}", detector.id);
    }
}
