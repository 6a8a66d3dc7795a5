//! The benchmark crate from outside.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod curve;
#[cfg(unix)]
mod external;
mod faulty_predictions;
mod ignored_pixels;
mod metrics;
mod scenes;
mod score;
mod score_consistency;
mod scoring;
mod split;
mod track_scores;
mod validate_and_compare;
