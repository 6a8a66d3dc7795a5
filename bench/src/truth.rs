//! Ground truth: the scene's images at the scored size, in 8 bits.

use omnilife_schemas::RgbImage;

use crate::{error::BenchError, scoring_job::ScoringJob};

/// Bytes of a frame's ground truth at the scored size, resized by area averaging where the
/// protocol asks for it and rounded to 8 bits, as predictions are.
///
/// # Errors
/// When the image is unusable or not of the size that the scene states.
pub(crate) fn read(job: &ScoringJob, frame: u32) -> Result<Vec<u8>, BenchError> {
    let file = job.truth_file(frame);
    let image = RgbImage::read(&file)?;
    let camera = job.scene.camera;
    if (image.width, image.height) != (camera.width as usize, camera.height as usize) {
        return Err(BenchError::mismatch(
            &file,
            format!(
                "is {}x{} pixels, scene {} says {}x{}",
                image.width, image.height, job.scene.id, camera.width, camera.height
            ),
        ));
    }
    let [width, height] = job.size;
    Ok(image
        .resized_by_area(width as usize, height as usize)
        .to_rgb8())
}
