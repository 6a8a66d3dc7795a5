//! The stored aspect ratio.

use omnilife_schemas::records::Probe;

use super::ProjectionTest;

/// Relative deviation of the stored size from 2:1.
pub(super) const TEST: ProjectionTest = ProjectionTest {
    id: "aspect-ratio",
    summary: "Relative deviation of the upright image's width over height from 2, as stored, \
              whatever the pixel aspect ratio claims.",
    limit: 0.02,
    at_most: "stored at 2:1",
    above: "not stored at 2:1",
    measure: |probe, _| Some(deviation(probe)),
};

fn deviation(probe: &Probe) -> f64 {
    let (width, height) = probe.upright_size();
    (f64::from(width) / (2.0 * f64::from(height)) - 1.0).abs()
}

/// Returns true if the stored size is 2:1 to the test's limit.
pub(crate) fn is_two_to_one(probe: &Probe) -> bool {
    deviation(probe) <= TEST.limit
}
