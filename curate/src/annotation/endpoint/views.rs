//! Views of a sequence that are shown to a model.

use std::path::Path;

use omnilife_schemas::{
    RgbImage,
    camera::cube::{CUBE_FACES, side_of_equal_resolution},
    records::Sequence,
};
use omnilife_video::Rgb8Image;

use crate::{error::CurateError, exchange::face_image, jpeg};

/// Moments that are shown at most, spread evenly over the sequence.
const MOMENTS: usize = 4;
/// Faces of the cube around the horizon.
const AROUND: usize = 4;
/// Sides of a view, pixels: few enough for the context of small models.
const LARGEST_SIDE: u32 = 448;
/// Width to which an ordinary perspective frame is reduced, pixels.
const FLAT_WIDTH: usize = 896;
/// JPEG quality, 1 to 100.
const QUALITY: u8 = 85;

/// Returns the views as JPEG data URLs, ordered by moment, each from the front to the right. Frames of an ordinary
/// perspective video are used unchanged.
pub(super) fn of_sequence(folder: &Path, sequence: &Sequence) -> Result<Vec<String>, CurateError> {
    let entries = &sequence.frames.entries;
    let shown = entries.len().min(MOMENTS);
    let mut urls = Vec::new();
    for moment in 0..shown {
        let path = folder.join(&entries[moment * entries.len() / shown].file);
        let frame = RgbImage::read(&path)?;
        let views = if sequence.is_pinhole() {
            vec![smaller(frame)]
        } else {
            around(&frame)
        };
        for view in views {
            let url = jpeg::data_url(&rgb8(&view), QUALITY);
            urls.push(url.map_err(|error| CurateError::internal(&path, error))?);
        }
    }
    Ok(urls)
}

/// Returns four perspective views of 90 degrees around the horizon, at the resolution of the panorama.
fn around(panorama: &RgbImage) -> Vec<RgbImage> {
    let side = side_of_equal_resolution(panorama.width as u32).min(LARGEST_SIDE);
    let faces = CUBE_FACES.iter().take(AROUND);
    faces.map(|face| face_image(panorama, face, side)).collect()
}

fn smaller(frame: RgbImage) -> RgbImage {
    if frame.width <= FLAT_WIDTH {
        return frame;
    }
    let height = (frame.height * FLAT_WIDTH).div_ceil(frame.width);
    frame.resized_by_area(FLAT_WIDTH, height)
}

fn rgb8(image: &RgbImage) -> Rgb8Image {
    Rgb8Image::new(image.width, image.height, image.to_rgb8())
}
