//! Depth priors of a scene's input views, read on demand.

use std::path::PathBuf;

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::{
    RgbImage, Similarity, camera::Camera, distances::DistanceImage, records::DepthPrior, rgb::Mask,
};

use super::TrainingScene;
use crate::error::ReconstructError;

/// File of a view's distances.
#[derive(Debug, Clone, PartialEq)]
pub struct PriorFile {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub prior: DepthPrior,
}

impl TrainingScene {
    /// Reads the distances along the rays of input view number `view`, in normalized units and at the file's
    /// size; `None` where the scene does not have them.
    ///
    /// # Errors
    /// When the file is missing, damaged, or of another size than the scene says.
    pub fn distances(&self, view: usize) -> Result<Option<DistanceImage>, ReconstructError> {
        let Some(Some(file)) = self.depth_priors.get(view) else {
            return Ok(None);
        };
        let camera = self.input_views[view].view.camera;
        file.read(&camera, &self.normalization).map(Some)
    }
}

impl PriorFile {
    /// Reads distances along the rays of a camera, in normalized units and at the file's size.
    ///
    /// # Errors
    /// When the file is missing, damaged, or of another size than the scene says.
    pub(crate) fn read(
        &self,
        camera: &Camera,
        normalization: &Similarity,
    ) -> Result<DistanceImage, ReconstructError> {
        let prior = &self.prior;
        let unit = prior.unit * normalization.scale;
        let image = DistanceImage::read(&self.path, unit, camera.wraps())?;
        let size = [prior.width as usize, prior.height as usize];
        if [image.width, image.height] != size {
            let reason = format!(
                "is {}x{}, the scene says {}x{}",
                image.width, image.height, prior.width, prior.height
            );
            return Err(ReconstructError::scene(&self.path, reason));
        }
        let camera = camera.resized(prior.width, prior.height);
        Ok(image.along_rays(prior.convention, &camera))
    }
}

/// Resizes a view to at most its number of pixels: colours and masks are averaged over the area of a pixel.
pub fn resized_view(view: &TrainingView, size: [usize; 2]) -> TrainingView {
    let camera = &view.view.camera;
    let own = camera.size();
    if own == size {
        return view.clone();
    }
    let [width, height] = size;
    let resized_bytes = |bytes: &[u8]| {
        let image = RgbImage::from_rgb8(own[0], own[1], bytes);
        image.resized_by_area(width, height).to_rgb8()
    };
    let mask = view.mask.as_ref().map(|mask| {
        let grey: Vec<u8> = mask.iter().flat_map(|&byte| [byte; 3]).collect();
        resized_bytes(&grey).into_iter().step_by(3).collect()
    });
    let ignored = view.ignored.as_ref().map(|marks| {
        let mask = Mask::new(own[0], own[1], marks.clone());
        mask.resized_to_any(width, height).data
    });
    let mut smaller = TrainingView {
        pixels: resized_bytes(&view.pixels),
        mask,
        ignored,
        ..view.clone()
    };
    smaller.view.camera = camera.resized(width as u32, height as u32);
    smaller
}
