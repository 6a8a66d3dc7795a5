//! TransNetV2 against its reference implementation, on real videos.
//!
//! `golden/transnetv2.json` is made by `scripts/golden/transnetv2.py`. Skipped with a printed reason
//! where the weights or a video are missing.

use std::{collections::BTreeMap, fs, path::Path};

use omnilife_curate::{
    CurateError,
    analysis::analyse,
    boundaries::{self, Signals},
};
use omnilife_schemas::{
    progress::Silent,
    records::{Boundary, BoundaryKind},
};
use serde::Deserialize;

use crate::support;

/// Tolerance of the reference's scores.
const TOLERANCE: f32 = 1e-3;

#[derive(Deserialize)]
struct Golden {
    videos: BTreeMap<String, Scores>,
}

#[derive(Deserialize)]
struct Scores {
    middle: Vec<f32>,
    any: Vec<f32>,
}

fn signals(video: &Path) -> Option<Signals> {
    let detector = boundaries::detector("transnetv2", video).unwrap();
    match analyse(video, detector, None, &Silent) {
        Ok(analysis) => Some(analysis.signals),
        Err(error @ CurateError::Weights(_)) => {
            omnilife_schemas::testing::skip(error);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn assert_close(video: &str, column: &str, found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len(), "{video}: frames");
    let (frame, worst) = found
        .iter()
        .zip(expected)
        .map(|(a, b)| (a - b).abs())
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap();
    println!("{video}: {column}: largest difference {worst:.6} at frame {frame}");
    assert!(worst <= TOLERANCE, "{video}: {column}: {worst} at {frame}");
}

#[test]
fn scores_are_those_of_the_reference() {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let golden = fs::read(crate_folder.join("tests/golden/transnetv2.json")).unwrap();
    let golden: Golden = serde_json::from_slice(&golden).unwrap();
    assert!(golden.videos.len() >= 3);
    for (video, expected) in &golden.videos {
        let path = if video == "street.mp4" {
            Some(crate_folder.join("../tests/data/street/street.mp4"))
        } else {
            support::shared_data(video)
        };
        let Some(path) = path else { continue };
        let Some(signals) = signals(&path) else {
            return;
        };
        let middle = signals.column("transnetv2_middle").unwrap();
        assert_close(video, "middle", middle, &expected.middle);
        let any = signals.column("transnetv2_any").unwrap();
        assert_close(video, "any", any, &expected.any);
    }
}

fn decided(middle: &[f32], any: &[f32]) -> Vec<Boundary> {
    let signals = Signals {
        times: (0..middle.len()).map(|frame| frame as f64 / 25.0).collect(),
        columns: vec![
            ("transnetv2_middle".to_owned(), middle.to_vec()),
            ("transnetv2_any".to_owned(), any.to_vec()),
        ],
    };
    let detector = boundaries::detector("transnetv2", Path::new("clip.mp4")).unwrap();
    (detector.decide)(&signals).unwrap()
}

#[test]
fn scores_become_boundaries() {
    // A cut after frame 2, and a transition of the frames 6 to 8.
    let middle = [0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.1, 0.8, 0.2, 0.0];
    let any = [0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.7, 0.9, 0.6, 0.0];
    let found = decided(&middle, &any);
    let spans: Vec<_> = found
        .iter()
        .map(|found| {
            (
                found.begin_seconds * 25.0,
                found.end_seconds * 25.0,
                found.kind,
            )
        })
        .collect();
    assert_eq!(
        spans,
        [
            (2.0, 3.0, BoundaryKind::Cut),
            (6.0, 9.0, BoundaryKind::Gradual)
        ]
    );
    // All of it, and nothing of it.
    assert_eq!(decided(&[0.9; 5], &[0.9; 5]), []);
    assert_eq!(decided(&[0.1; 5], &[0.9; 5]), []);
}
