//! A view as training sees it: a camera, an image and perhaps a mask.

use crate::camera::{Camera, View};

/// A frame with its camera and image.
#[derive(Debug, Clone)]
pub struct TrainingView {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// The camera in normalized units.
    pub view: View,
    /// 8-bit RGB, HWC.
    pub pixels: Vec<u8>,
    /// Share of each pixel that dynamic objects cover, 255 for all of it; `None` where the frame has
    /// no mask.
    pub mask: Option<Vec<u8>>,
    /// Marks (not zero) the pixels that show nothing of the scene, such as who holds the camera: nothing is
    /// learned from them. `None` where there are none.
    pub ignored: Option<Vec<u8>>,
}

impl TrainingView {
    /// Whether a pixel shows something of the scene.
    pub fn shows_scene(&self, pixel: usize) -> bool {
        (self.ignored.as_ref()).is_none_or(|ignored| ignored[pixel] == 0)
    }

    /// How many pixels show something of the scene.
    pub fn counted_pixels(&self) -> usize {
        (0..self.pixels.len() / 3)
            .filter(|&pixel| self.shows_scene(pixel))
            .count()
    }

    /// The image as `[0, 1]` f32, written into `out`.
    pub fn write_image(&self, out: &mut Vec<f32>) {
        out.clear();
        out.extend(self.pixels.iter().map(|&byte| f32::from(byte) / 255.0));
    }

    /// Writes into `out` which values of the image are saturated: how bright the scene is there is lost.
    pub fn write_saturated(&self, out: &mut Vec<bool>) {
        out.clear();
        out.extend(self.pixels.iter().map(|&byte| byte == u8::MAX));
    }

    /// The mask as `[0, 1]` f32, written into `out`; 0 everywhere where the frame has none.
    pub fn write_mask(&self, out: &mut Vec<f32>) {
        out.clear();
        match &self.mask {
            Some(mask) => out.extend(mask.iter().map(|&byte| f32::from(byte) / 255.0)),
            None => out.resize(self.pixels.len() / 3, 0.0),
        }
    }
}

/// The views that a model is trained on.
#[derive(Debug, Clone, Copy)]
pub struct InputViews<'a> {
    /// Size and model of all of them.
    pub camera: Camera,
    /// The views; their place here is their number.
    pub views: &'a [TrainingView],
}

impl InputViews<'_> {
    /// Columns and rows of pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.camera.width() as usize, self.camera.height() as usize]
    }

    /// Half of the columns and rows of pixels: from pixels to normalized device coordinates.
    pub fn half_size(&self) -> [f32; 2] {
        self.size().map(|pixels| 0.5 * pixels as f32)
    }
}
