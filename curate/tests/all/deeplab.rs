//! The segmentation network against its published graph, and its masks against true ones.
//!
//! `golden/deeplab.json` is made by `scripts/golden/deeplab.py`. Skipped with a printed reason where
//! the weights or a scene are missing.

use std::{fs, path::Path};

use omnilife_curate::masks::{
    deeplab::{
        self,
        network::{CLASSES, Network, SCORE_SIDE, SIDE},
    },
    dynamic_share,
};
use omnilife_schemas::{RgbImage, rgb::Mask};
use serde::Deserialize;
use support::shared_data;

use crate::support;

/// Tolerance of scores, which reach 20: sums are in another order.
const TOLERANCE: f32 = 1e-3;

#[derive(Deserialize)]
struct Golden {
    classes: Vec<usize>,
    places: Vec<Place>,
}

#[derive(Deserialize)]
struct Place {
    row: usize,
    column: usize,
    scores: Vec<f32>,
}

fn network() -> Option<Network> {
    match deeplab::published_weights() {
        Ok(weights) => Some(Network::load(&weights).unwrap()),
        Err(error) => {
            omnilife_schemas::testing::skip(error);
            None
        }
    }
}

/// Rings and ramps with hard edges, as the script of the golden makes them.
fn test_image() -> Vec<u8> {
    let mut bytes = Vec::with_capacity(SIDE * SIDE * 3);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let rings = x.abs_diff(200).pow(2) + y.abs_diff(300).pow(2);
            let is_light = (x / 64 + y / 48).is_multiple_of(2);
            bytes.push(((x * 7 + y * 3) % 256) as u8);
            bytes.push((rings / 97 % 256) as u8);
            bytes.push(if is_light { 220 } else { 35 });
        }
    }
    bytes
}

#[test]
fn scores_are_those_of_the_published_graph() {
    let Some(network) = network() else {
        return;
    };
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/deeplab.json");
    let golden: Golden = serde_json::from_slice(&fs::read(golden).unwrap()).unwrap();
    let scores = network.scores(&test_image());
    let mut classes = vec![0; CLASSES];
    for row in scores.data.chunks_exact(CLASSES) {
        let best = (0..CLASSES)
            .max_by(|&a, &b| row[a].total_cmp(&row[b]))
            .unwrap();
        classes[best] += 1;
    }
    assert_eq!(classes, golden.classes);
    for place in &golden.places {
        let row = scores.row(place.row * SCORE_SIDE + place.column);
        for (class, (found, expected)) in row.iter().zip(&place.scores).enumerate() {
            assert!(
                (found - expected).abs() < TOLERANCE,
                "class {class} at {}, {}: {found} and {expected}",
                place.column,
                place.row
            );
        }
    }
}

/// The rendered car and walker that move are found, also where the seam cuts through the car. Parked
/// cars are marked too: by what they are, they can move.
#[test]
fn masks_hold_what_moves_and_do_not_mind_the_seam() {
    let (Some(network), Some(street)) = (network(), shared_data("street")) else {
        return;
    };
    let frame = RgbImage::read(&street.join("rgb/0024.jpg")).unwrap();
    let truth = Mask::read(&street.join("mask/0024.png")).unwrap();
    for columns in [0, SEAM_IN_THE_CAR] {
        let mask = deeplab::movable(&network, &turned(&frame, columns));
        let truth = turned_mask(&truth, columns);
        let both = Mask {
            data: mask
                .data
                .iter()
                .zip(&truth.data)
                .map(|(a, b)| a & b)
                .collect(),
            ..mask.clone()
        };
        let recall = dynamic_share(&both) / dynamic_share(&truth);
        let share = dynamic_share(&mask);
        println!("turned by {columns} columns: recall {recall:.3}, marked {share:.4}");
        if let Some(keep) = std::env::var_os("OMNILIFE_KEEP_MASKS") {
            let file = format!("deeplab-{columns}.png");
            mask.write_png(&Path::new(&keep).join(file)).unwrap();
        }
        assert!(recall > 0.6, "{recall}");
        // Cars and walkers fill a few hundredths of the sphere.
        assert!(share < 0.06, "{share}");
    }
}

/// Column in the middle of the car that moves.
const SEAM_IN_THE_CAR: usize = 140;

/// The image moved to the left, around the sphere.
fn turned(image: &RgbImage, columns: usize) -> RgbImage {
    let mut turned = image.clone();
    for row in turned.data.chunks_mut(image.width * 3) {
        row.rotate_left(columns * 3);
    }
    turned
}

fn turned_mask(mask: &Mask, columns: usize) -> Mask {
    let mut turned = mask.clone();
    for row in turned.data.chunks_mut(mask.width) {
        row.rotate_left(columns);
    }
    turned
}
