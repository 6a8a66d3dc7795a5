//! Lossless WebP images whose pixels are codes.

use std::io::Cursor;

use image_webp::{ColorType, EncoderParams, WebPDecoder, WebPEncoder};

/// Maximum side of a WebP image, pixels.
pub(super) const MOST_SIDE: usize = 16_383;

/// Writes rows of pixels: as differences from neighbours or as they are, which of them is smaller.
pub(super) fn written(pixels: &[[u8; 4]], size: [usize; 2]) -> Result<Vec<u8>, String> {
    let [width, height] = size.map(|side| side as u32);
    let encoded = |are_differences: bool| -> Result<Vec<u8>, String> {
        let mut params = EncoderParams::default();
        params.use_predictor_transform = are_differences;
        let mut bytes = Vec::new();
        let mut encoder = WebPEncoder::new(&mut bytes);
        encoder.set_params(params);
        encoder
            .encode(pixels.as_flattened(), width, height, ColorType::Rgba8)
            .map_err(|error| error.to_string())?;
        Ok(bytes)
    };
    let (differences, values) = (encoded(true)?, encoded(false)?);
    let are_smaller = values.len() < differences.len();
    Ok(if are_smaller { values } else { differences })
}

/// Decodes the pixels of an image after a check of its size.
pub(super) fn pixels(
    bytes: &[u8],
    check: impl FnOnce([usize; 2]) -> Result<(), String>,
) -> Result<Vec<[u8; 4]>, String> {
    let undecoded = |error: &dyn std::fmt::Display| format!("cannot be decoded: {error}");
    let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(|error| undecoded(&error))?;
    if decoder.is_animated() || decoder.is_lossy() {
        return Err("is animated or lossy, and codes are stills without loss".to_owned());
    }
    let (width, height) = decoder.dimensions();
    check([width as usize, height as usize])?;
    let size = decoder
        .output_buffer_size()
        .ok_or("is too large for this machine")?;
    let mut values = vec![0; size];
    decoder
        .read_image(&mut values)
        .map_err(|error| undecoded(&error))?;
    Ok(if decoder.has_alpha() {
        values.as_chunks::<4>().0.to_vec()
    } else {
        let pixels = values.as_chunks::<3>().0.iter();
        pixels.map(|&[r, g, b]| [r, g, b, 255]).collect()
    })
}
