//! Predicted views as methods leave them, read without any repair.

use std::{fs, io, io::Cursor, path::Path};

use image::{ColorType, ImageDecoder, codecs::png::PngDecoder};

/// Bytes of a prediction: an 8-bit RGB PNG of exactly `width` x `height` pixels. An alpha channel
/// is accepted where every pixel is opaque.
///
/// # Errors
/// The reason, in one line, why the prediction cannot be scored. It names the file without its
/// folder, so that results do not depend on where predictions lie.
pub(crate) fn read(file: &Path, width: u32, height: u32) -> Result<Vec<u8>, String> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let bytes = fs::read(file).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => format!("{name} is missing"),
        kind => format!("{name} cannot be read: {kind}"),
    })?;
    decode(&bytes, width, height).map_err(|reason| format!("{name} {reason}"))
}

fn decode(bytes: &[u8], width: u32, height: u32) -> Result<Vec<u8>, String> {
    let undecodable = |error: image::ImageError| {
        let text = error.to_string();
        format!("is not a usable PNG: {}", text.lines().next().unwrap_or(""))
    };
    let decoder = PngDecoder::new(Cursor::new(bytes)).map_err(undecodable)?;
    // Checked before decoding: a wrong header must not make us allocate its size.
    let (found_width, found_height) = decoder.dimensions();
    if (found_width, found_height) != (width, height) {
        return Err(format!(
            "is {found_width}x{found_height} pixels, expected {width}x{height}"
        ));
    }
    let colour = decoder.color_type();
    if !matches!(colour, ColorType::Rgb8 | ColorType::Rgba8) {
        return Err(format!("is {colour:?}, expected 8-bit RGB"));
    }
    let mut pixels = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut pixels).map_err(undecodable)?;
    if colour == ColorType::Rgb8 {
        return Ok(pixels);
    }
    if pixels.chunks_exact(4).any(|pixel| pixel[3] != 255) {
        return Err("is transparent in places, expected 8-bit RGB".to_owned());
    }
    Ok(pixels
        .chunks_exact(4)
        .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .collect())
}
