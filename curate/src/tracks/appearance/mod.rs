//! Appearance of vehicles: embeddings of their boxes by the network of `DeepSORT`.

pub mod network;

use std::path::Path;

use omnilife_networks::{Weights, WeightsError};
use omnilife_schemas::{RgbImage, records::Detection};
use opencv::{
    core::{Mat, MatTraitConst, MatTraitConstManual, Size},
    imgproc,
};
use rayon::prelude::*;

use self::network::{Network, SIDE};
use super::detectors::DetectorInput;
use crate::error::CurateError;

/// Name of the weights; `scripts/setup --models` knows it too.
const WEIGHTS: &str = "deepsort";
/// SHA-256 of the converted weights.
pub const WEIGHTS_SHA256: &str = "d03b3d5344285fc745f3d842db4cf93128412090ed6799fbc851ec6328182f4d";

/// Returns the published weights, as `scripts/setup --models` leaves them.
///
/// # Errors
/// When they are missing or differ from the published ones.
pub fn published_weights() -> Result<Weights, WeightsError> {
    Weights::load_published(WEIGHTS, WEIGHTS_SHA256)
}

/// Returns the embedding of every detection, in their order.
///
/// # Errors
/// When the weights are missing or an image cannot be read.
pub(super) fn embeddings(
    input: &DetectorInput<'_>,
    detections: &[Detection],
) -> Result<Vec<Vec<f32>>, CurateError> {
    let network = Network::load(&published_weights()?)?;
    let mut embeddings = vec![Vec::new(); detections.len()];
    for view in input.views {
        let own: Vec<usize> = (0..detections.len())
            .filter(|&number| detections[number].frame == view.frame)
            .collect();
        if own.is_empty() {
            continue;
        }
        let file = input
            .folder
            .join(&input.scene.frames[view.frame as usize].image);
        let image = RgbImage::read(&file)?;
        let of_frame: Vec<Vec<f32>> = own
            .par_iter()
            .map(|&number| {
                let crop = crop(&image, detections[number].box_pixels);
                embedding(&network, &crop, &file)
            })
            .collect::<Result<_, _>>()?;
        own.into_iter()
            .zip(of_frame)
            .for_each(|(number, embedding)| embeddings[number] = embedding);
    }
    Ok(embeddings)
}

/// A part of an image: interleaved RGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crop {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub pixels: Vec<u8>,
}

/// Returns the part of an image in a box, whose sides are cut to whole pixels as the package does; at least a pixel.
fn crop(image: &RgbImage, [left, top, width, height]: [f64; 4]) -> Crop {
    let range = |from: f64, length: f64, all: usize| {
        let begin = (from.max(0.0) as usize).min(all - 1);
        let end = (from.trunc() + length.trunc()).max(0.0) as usize;
        begin..end.clamp(begin + 1, all)
    };
    let (columns, rows) = (
        range(left, width, image.width),
        range(top, height, image.height),
    );
    let byte = |value: f32| (255.0 * value).round() as u8;
    let pixels = rows.clone().flat_map(|row| {
        let row = &image.data[3 * row * image.width..][..3 * image.width];
        row[3 * columns.start..3 * columns.end]
            .iter()
            .copied()
            .map(byte)
    });
    Crop {
        width: columns.len(),
        height: rows.len(),
        pixels: pixels.collect(),
    }
}

/// Returns the embedding of a crop, resized to the network's size as the package does.
///
/// # Errors
/// When OpenCV fails, with the file being worked on.
pub fn embedding(network: &Network, crop: &Crop, file: &Path) -> Result<Vec<f32>, CurateError> {
    let resized = resized(crop).map_err(|error| CurateError::Internal {
        path: file.to_owned(),
        reason: error.to_string(),
    })?;
    Ok(network.embedding(&resized))
}

fn resized(crop: &Crop) -> opencv::Result<Vec<u8>> {
    let pixels = Mat::from_slice(&crop.pixels)?;
    let pixels = pixels.reshape(3, crop.height as i32)?;
    let mut resized = Mat::default();
    let side = Size::new(SIDE as i32, SIDE as i32);
    imgproc::resize(&pixels, &mut resized, side, 0.0, 0.0, imgproc::INTER_LINEAR)?;
    Ok(resized.data_bytes()?.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crops_keep_to_whole_pixels_and_to_the_image() {
        let image = RgbImage {
            width: 6,
            height: 4,
            data: (0..72).map(|at| (at / 3) as f32 / 255.0).collect(),
        };
        let inside = crop(&image, [1.9, 1.2, 2.7, 2.0]);
        assert_eq!((inside.width, inside.height), (2, 2));
        let reds: Vec<u8> = inside.pixels.iter().copied().step_by(3).collect();
        assert_eq!(reds, [7, 8, 13, 14]);
        let cut = crop(&image, [-2.0, -1.0, 4.0, 3.0]);
        assert_eq!((cut.width, cut.height), (2, 2));
        // A box smaller than a pixel becomes one.
        let sliver = crop(&image, [5.9, 3.5, 0.5, 0.4]);
        assert_eq!((sliver.width, sliver.height), (1, 1));
        assert_eq!(sliver.pixels, [23; 3]);
    }
}
