//! Images of a layer, with its opacity where it does not cover the view.

use std::path::Path;

use omnilife_engine::camera::View;
use omnilife_schemas::{RgbImage, Similarity, rgba, store::StoreError};
use omnilife_training::{error::ReconstructError, models::OpenedModel};

pub(super) struct LayerImage {
    /// Its colours over black.
    over_black: RgbImage,
    /// Grey; `None` for a layer that covers the view.
    opacity: Option<RgbImage>,
}

impl LayerImage {
    /// Writes an 8-bit PNG: RGB, or RGBA with straight alpha.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn write_png(&self, path: &Path) -> Result<(), StoreError> {
        match &self.opacity {
            Some(opacity) => rgba::write_straight_png(path, &self.over_black, opacity),
            None => self.over_black.write_png(path),
        }
    }
}

/// Draws the images of a layer, and those of its opacity in the same way; `None` where `images` has none.
///
/// # Errors
/// Those of `images`.
pub(super) fn draw(
    opened: &mut dyn OpenedModel,
    images: impl Fn(&mut dyn OpenedModel) -> Result<Option<Vec<RgbImage>>, ReconstructError>,
) -> Result<Option<Vec<LayerImage>>, ReconstructError> {
    let Some(colours) = images(&mut *opened)? else {
        return Ok(None);
    };
    let opacities = if opened.has_opacity() {
        images(&mut Opacity(opened))?
    } else {
        None
    };
    let mut opacities = opacities.into_iter().flatten();
    let drawn = colours.into_iter().map(|over_black| LayerImage {
        over_black,
        opacity: opacities.next(),
    });
    Ok(Some(drawn.collect()))
}

/// Opacity of a model's layer, as an image.
struct Opacity<'a>(&'a mut dyn OpenedModel);

impl OpenedModel for Opacity<'_> {
    fn normalization(&self) -> Similarity {
        self.0.normalization()
    }

    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        self.0.opacity(view)
    }
}
