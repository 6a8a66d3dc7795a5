//! `cube-psnr` and `cube-ssim`: scores of the six faces of the cube.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, Sample, Undefined, decibels, ssim_map::SsimMap};

/// PSNR on cube faces.
pub(super) const PSNR: Metric = Metric {
    id: "cube-psnr",
    title: "PSNR (cube faces)",
    unit: "dB",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 100.0],
    source: "mean over the six 90-degree faces of -10 log10(MSE), faces half as wide as the ERP \
             image is high, by bilinear interpolation of both 8-bit images without rounding \
             (Splatter-360 and PanoSplatt3R score faces of 256 pixels that they render directly, \
             src/model/model_wrapper_erp.py). The MSE of each face is floored at 1e-10",
    needs: &[Need::Sphere],
    function: psnr,
};

/// SSIM on cube faces.
pub(super) const SSIM: Metric = Metric {
    id: "cube-ssim",
    title: "SSIM (cube faces)",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "mean over the six 90-degree faces of cube-psnr of scikit-image's SSIM as in \
             ssim-skimage (Splatter-360 src/evaluation/metrics.py); undefined for faces of less \
             than 11 pixels",
    needs: &[Need::Sphere],
    function: ssim,
};

fn psnr(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let scores: Vec<f64> = (sample.cube_faces().iter())
        .filter(|face| face.counted_pixels() > 0)
        .map(|face| {
            let errors = face.prediction.iter().zip(&face.truth).enumerate();
            let counted = errors.filter(|&(value, _)| face.counts(value));
            let sum: f64 = counted.map(|(_, (p, t))| (p - t) * (p - t)).sum();
            decibels(sum / (3 * face.counted_pixels()) as f64)
        })
        .collect();
    // Some face has a pixel that counts, because the image has one.
    mean(&scores)
}

fn ssim(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let faces = sample.cube_faces().iter();
    let scores: Vec<f64> = faces
        .filter_map(|face| {
            let images = [&face.prediction[..], &face.truth];
            SsimMap::new([face.side; 2], images, face.counted.as_deref()).valid_mean
        })
        .collect();
    mean(&scores)
}

fn mean(scores: &[f64]) -> Result<f64, Undefined> {
    if scores.is_empty() {
        return Err(Undefined(
            "no face has a pixel that counts 5 pixels or more from its border",
        ));
    }
    Ok(scores.iter().sum::<f64>() / scores.len() as f64)
}
