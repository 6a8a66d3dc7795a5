//! Masks by class: people, animals and vehicles, found by DeepLabV3 in perspective views of the panorama.
//!
//! A parked car is marked like a driving one. Moving content outside the classes, such as shadows and reflections, is
//! not.

mod crops;
pub mod network;

use std::path::Path;

use glam::dvec2;
use omnilife_networks::{Matrix, Weights, WeightsError};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    progress::Progress,
    records::Sequence,
    rgb::Mask,
};
use rayon::prelude::*;

use self::network::{CLASSES, Network, SCORE_SIDE, SIDE};
use super::{FrameMasks, MaskMethod};
use crate::error::CurateError;

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "deeplab",
    about: "people, animals and vehicles, by a segmentation network (scripts/setup --models)",
    settings,
    takes_perspective: false,
    find,
};

/// Name of the weights; `scripts/setup --models` knows it too.
const WEIGHTS: &str = "deeplab";
/// SHA-256 of the converted weights.
const WEIGHTS_SHA256: &str = "78bd5c9301dec8055023a3a9f89ad45572d67e274f83421018c15b1dd29dc3fe";
/// Classes of Pascal VOC that can move: aeroplane, bicycle, bird, boat, bus, car, cat, cow, dog,
/// horse, motorbike, person, sheep, train.
const MOVABLE: [usize; 14] = [1, 2, 3, 4, 6, 7, 8, 10, 12, 13, 14, 15, 17, 19];
/// Probability of movable classes from which on a pixel is marked.
const PROBABILITY: f32 = 0.5;

fn settings() -> String {
    format!("probability {PROBABILITY} in 8 views of 103 degrees, weights {WEIGHTS_SHA256}")
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    let network = Network::load(&published_weights()?)?;
    let entries = &sequence.frames.entries;
    progress.begin("segmenting", Some(entries.len() as u64));
    let masks = entries
        .iter()
        .map(|entry| {
            let frame = RgbImage::read(&folder.join(&entry.file))?;
            let mask = movable(&network, &frame);
            progress.advance(1);
            Ok(FrameMasks::from(mask))
        })
        .collect();
    progress.end();
    masks
}

/// Returns the published weights, as `scripts/setup --models` leaves them.
///
/// # Errors
/// When they are missing or differ from the published ones.
pub fn published_weights() -> Result<Weights, WeightsError> {
    Weights::load_published(WEIGHTS, WEIGHTS_SHA256)
}

/// Marks movable content in a panorama.
pub fn movable(network: &Network, panorama: &RgbImage) -> Mask {
    let views = crops::views();
    let probabilities: Vec<Vec<f32>> = views
        .par_iter()
        .map(|view| movable_probability(&network.scores(&crops::crop(panorama, view, SIDE))))
        .collect();
    let camera = ErpCamera {
        width: panorama.width as u32,
        height: panorama.height as u32,
    };
    let is_movable = |pixel: usize| {
        let (column, row) = (pixel % panorama.width, pixel / panorama.width);
        let direction = camera.unproject(dvec2(column as f64 + 0.5, row as f64 + 0.5));
        let (mut sum, mut total) = (0.0, 0.0);
        for (view, probabilities) in views.iter().zip(&probabilities) {
            if let Some(place) = crops::place(*view * direction) {
                let weight = crops::weight(place) as f32 + 1e-6;
                sum += weight * interpolated(probabilities, place);
                total += weight;
            }
        }
        sum >= PROBABILITY * total && total > 0.0
    };
    Mask {
        width: panorama.width,
        height: panorama.height,
        data: (0..panorama.width * panorama.height)
            .into_par_iter()
            .map(|pixel| if is_movable(pixel) { 255 } else { 0 })
            .collect(),
    }
}

/// Returns the probability of all movable classes together, per place of the scores.
fn movable_probability(scores: &Matrix) -> Vec<f32> {
    scores
        .data
        .chunks_exact(CLASSES)
        .map(|scores| {
            let largest = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let powers: Vec<f32> = scores.iter().map(|score| (score - largest).exp()).collect();
            let movable: f32 = MOVABLE.iter().map(|&class| powers[class]).sum();
            movable / powers.iter().sum::<f32>()
        })
        .collect()
}

/// Interpolates bilinearly on the scores' grid, whose corners are the corners of the view.
fn interpolated(values: &[f32], place: [f64; 2]) -> f32 {
    let [x, y] = place.map(|at| at * (SCORE_SIDE - 1) as f64);
    let [column, row] = [x, y].map(|at| (at as usize).min(SCORE_SIDE - 2));
    let share = [x - column as f64, y - row as f64].map(|share| share as f32);
    let at = |dx: usize, dy: usize| values[(row + dy) * SCORE_SIDE + column + dx];
    let upper = at(0, 0) + (at(1, 0) - at(0, 0)) * share[0];
    let lower = at(0, 1) + (at(1, 1) - at(0, 1)) * share[0];
    upper + (lower - upper) * share[1]
}
