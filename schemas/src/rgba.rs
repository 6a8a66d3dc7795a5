//! Layers with an opacity, as PNG files of straight alpha: their colours are not multiplied with it.

use std::path::Path;

use crate::{
    image_file::ImageFile,
    rgb::{self, RgbImage},
    store::StoreError,
};

/// Writes a layer as 8-bit RGBA with straight alpha. `over_black` is the layer over black, `opacity` a grey image of
/// the same size.
///
/// # Errors
/// When the file cannot be written.
pub fn write_straight_png(
    path: &Path,
    over_black: &RgbImage,
    opacity: &RgbImage,
) -> Result<(), StoreError> {
    let size = (over_black.width, over_black.height);
    let bytes = straight_rgba8(over_black, opacity);
    rgb::write_png(path, size, &bytes, image::ExtendedColorType::Rgba8)
}

/// Returns 8-bit RGBA of straight alpha and a size (width, height) as a PNG.
///
/// # Errors
/// When the image is empty.
pub fn straight_png(size: (usize, usize), rgba: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut png = Vec::new();
    rgb::encode_png(&mut png, size, rgba, image::ExtendedColorType::Rgba8)?;
    Ok(png)
}

/// Returns the 8-bit RGBA of a layer; black where it is transparent.
fn straight_rgba8(over_black: &RgbImage, opacity: &RgbImage) -> Vec<u8> {
    debug_assert_eq!(over_black.data.len(), opacity.data.len());
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let colours = over_black.data.as_chunks::<3>().0.iter();
    let opacities = opacity.data.as_chunks::<3>().0.iter();
    colours
        .zip(opacities)
        .flat_map(|(colour, &[opacity, ..])| match byte(opacity) {
            0 => [0; 4],
            alpha => {
                let [red, green, blue] = colour.map(|value| byte(value / opacity));
                [red, green, blue, alpha]
            }
        })
        .collect()
}

/// Reads an image of any kind over black: colours are multiplied with their alpha.
///
/// # Errors
/// When the file cannot be read or is damaged.
pub fn read_over_black(path: &Path) -> Result<RgbImage, StoreError> {
    let image = ImageFile::open(path)?.decode()?.into_rgba8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.as_raw().as_chunks::<4>().0.iter();
    let over_black = pixels.flat_map(|&[red, green, blue, alpha]| {
        let share = f32::from(alpha) / 255.0;
        [red, green, blue].map(|value| share * f32::from(value) / 255.0)
    });
    Ok(RgbImage::new(width, height, over_black.collect()))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    fn image(pixels: [[f32; 3]; 4]) -> RgbImage {
        RgbImage::new(4, 1, pixels.as_flattened().to_vec())
    }

    #[test]
    fn colours_are_not_multiplied_with_the_opacity() {
        let over_black = image([[0.2, 0.1, 0.0], [0.4, 0.2, 0.6], [1e-4; 3], [0.3, 0.3, 0.3]]);
        let opacity = image([[0.4; 3], [1.0; 3], [1e-3; 3], [0.25; 3]]);
        let bytes = straight_rgba8(&over_black, &opacity);
        assert_eq!(bytes[..4], [128, 64, 0, 102]);
        assert_eq!(bytes[4..8], [102, 51, 153, 255]);
        assert_eq!(bytes[8..12], [0; 4]);
        // Brighter than its opacity allows: clamped.
        assert_eq!(bytes[12..], [255, 255, 255, 64]);

        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("layer.png");
        write_straight_png(&path, &over_black, &opacity).unwrap();
        assert!(RgbImage::read(&path).is_err(), "it is transparent");
        let back = read_over_black(&path).unwrap();
        assert_eq!((back.width, back.height), (4, 1));
        for (found, expected) in back.data[..6].iter().zip(&over_black.data) {
            assert!((found - expected).abs() < 0.5 / 255.0 + 1e-3, "{found}");
        }
        over_black.write_png(&path).unwrap();
        let opaque = read_over_black(&path).unwrap();
        assert_eq!(opaque.to_rgb8(), over_black.to_rgb8());
    }
}
