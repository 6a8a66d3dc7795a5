//! Training view: a camera, an image and optionally a mask.

use crate::camera::{Camera, View};

/// A frame with its camera and image.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingView {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Camera in normalized units.
    pub view: View,
    /// 8-bit RGB, HWC.
    pub pixels: Vec<u8>,
    /// Share of each pixel covered by dynamic objects, 255 for all of it; `None` for a frame without a mask.
    pub mask: Option<Vec<u8>>,
    /// Non-zero for pixels to ignore in training, such as the operator; `None` if all count.
    pub ignored: Option<Vec<u8>>,
}

impl TrainingView {
    /// Returns true if a pixel is not ignored.
    pub fn shows_scene(&self, pixel: usize) -> bool {
        (self.ignored.as_ref()).is_none_or(|ignored| ignored[pixel] == 0)
    }

    /// Returns the number of pixels that are not ignored.
    pub fn counted_pixels(&self) -> usize {
        (0..self.pixels.len() / 3)
            .filter(|&pixel| self.shows_scene(pixel))
            .count()
    }

    /// Writes the image as `[0, 1]` f32 (HWC) into `out`.
    pub fn write_image(&self, out: &mut Vec<f32>) {
        out.clear();
        out.extend(self.pixels.iter().map(|&byte| f32::from(byte) / 255.0));
    }

    /// Writes true into `out` for saturated values (HWC), which only bound the brightness of the scene.
    pub fn write_saturated(&self, out: &mut Vec<bool>) {
        out.clear();
        out.extend(self.pixels.iter().map(|&byte| byte == u8::MAX));
    }

    /// Writes the mask as `[0, 1]` f32 into `out`; 0 everywhere for a frame without a mask.
    pub fn write_mask(&self, out: &mut Vec<f32>) {
        out.clear();
        match &self.mask {
            Some(mask) => out.extend(mask.iter().map(|&byte| f32::from(byte) / 255.0)),
            None => out.resize(self.pixels.len() / 3, 0.0),
        }
    }
}

/// Training views of a model.
#[derive(Debug, Clone, Copy)]
pub struct InputViews<'a> {
    /// Common size and camera model.
    pub camera: Camera,
    /// Views; other code refers to them by index.
    pub views: &'a [TrainingView],
}

impl InputViews<'_> {
    /// Returns columns and rows of pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.camera.width() as usize, self.camera.height() as usize]
    }

    /// Returns half the columns and rows of pixels, the factors from normalized device coordinates to pixels.
    pub fn half_size(&self) -> [f32; 2] {
        self.size().map(|pixels| 0.5 * pixels as f32)
    }
}
