//! Images as JPEG data URLs, for pages and requests.

use std::io::Cursor;

use base64::{Engine, engine::general_purpose::STANDARD};
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

use crate::video::Rgb8Image;

/// Returns an image as `data:image/jpeg;base64,...`; `quality` is 1 to 100.
///
/// # Errors
/// When a side is 0 or longer than JPEG allows.
pub(crate) fn data_url(image: &Rgb8Image, quality: u8) -> Result<String, image::ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, quality).write_image(
        &image.data,
        image.width as u32,
        image.height as u32,
        ExtendedColorType::Rgb8,
    )?;
    Ok(format!(
        "data:image/jpeg;base64,{}",
        STANDARD.encode(bytes.get_ref())
    ))
}
