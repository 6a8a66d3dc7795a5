//! Overlays that a sequence shows: class, times, and a crop of a frame to look at.

use std::path::Path;

use image::RgbImage;
use omnilife_schemas::{
    image_file::ImageFile,
    records::{Overlay, OverlayClass, TimeRange},
};
use omnilife_video::Rgb8Image;

use super::parts::FrameFiles;
use crate::{error::CurateError, jpeg};

/// Largest number of crops in a section, those of the largest overlays.
pub(super) const MOST_FINDS: usize = 8;
/// Largest side of a crop, pixels.
const MOST_PIXELS: f64 = 240.0;
/// Crops reach so many radii of an overlay's disc from its centre.
const REACH_RADII: f64 = 1.3;
/// JPEG quality, 1 to 100.
const QUALITY: u8 = 80;

/// Overlay in a sequence.
pub(super) struct Find {
    pub(super) class: OverlayClass,
    /// Times at which it stays, from the first to the last; `None` for moving mosaics and in records of older versions.
    pub(super) times: Option<TimeRange>,
    /// Crop of the first frame that shows it, or the reason why that frame cannot be read; `None` if no frame shows it.
    pub(super) crop: Option<Result<Crop, String>>,
}

/// Small part of a frame around an overlay.
pub(super) struct Crop {
    /// JPEG as a data URL.
    pub(super) url: String,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Find {
    /// Cuts an overlay out of the first of a sequence's frames that shows it.
    pub(super) fn of(folder: &Path, frames: &[FrameFiles<'_>], overlay: &Overlay) -> Self {
        let ends = overlay.ranges.first().zip(overlay.ranges.last());
        let frame = (frames.iter()).find(|frame| is_shown(overlay, frame.time_seconds));
        let crop = frame.map(|frame| {
            crop_of(&folder.join(frame.image), overlay).map_err(|error| error.for_records())
        });
        Self {
            class: overlay.class,
            times: ends.map(|(first, last)| TimeRange::new(first.begin_seconds, last.end_seconds)),
            crop,
        }
    }
}

/// Returns true if an overlay stays at an instant; one without times is taken to stay always.
pub(super) fn is_shown(overlay: &Overlay, seconds: f64) -> bool {
    let mut ranges = overlay.ranges.iter();
    let is_in = |range: &TimeRange| (range.begin_seconds..=range.end_seconds).contains(&seconds);
    overlay.ranges.is_empty() || ranges.any(is_in)
}

/// Returns true if an overlay stays at some time between the first frame and the last.
pub(super) fn concerns(overlay: &Overlay, frames: &[FrameFiles<'_>]) -> bool {
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
        return false;
    };
    let mut ranges = overlay.ranges.iter();
    let overlaps = |range: &TimeRange| {
        range.begin_seconds <= last.time_seconds && first.time_seconds <= range.end_seconds
    };
    overlay.ranges.is_empty() || ranges.any(overlaps)
}

fn crop_of(path: &Path, overlay: &Overlay) -> Result<Crop, CurateError> {
    let frame = ImageFile::open(path)?.decode()?.into_rgb8();
    let image = crop(&frame, overlay);
    let url =
        jpeg::data_url(&image, QUALITY).map_err(|error| CurateError::internal(path, error))?;
    Ok(Crop {
        url,
        width: image.width,
        height: image.height,
    })
}

/// Returns the part of an equirectangular image around an overlay, across the seam too.
fn crop(frame: &RgbImage, overlay: &Overlay) -> Rgb8Image {
    let (width, height) = (f64::from(frame.width()), f64::from(frame.height()));
    let [across, along] = overlay.reach_degrees();
    let half = (REACH_RADII * across / 360.0 * width).min(0.5 * width);
    let reach = REACH_RADII * along / 180.0 * height;
    let left = (overlay.longitude_degrees / 360.0 + 0.5) * width - half;
    let middle = (0.5 - overlay.latitude_degrees / 180.0) * height;
    let top = (middle - reach).max(0.0);
    let bottom = (middle + reach).min(height);
    let sides = [2.0 * half, bottom - top];
    let scale = (MOST_PIXELS / sides[0].max(sides[1])).min(1.0);
    let [columns, rows] = sides.map(|side| ((side * scale).round() as usize).max(1));
    let at = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
    let mut data = Vec::with_capacity(columns * rows * 3);
    for row in 0..rows {
        let y = (top + at(row, rows) * sides[1]) as u32;
        for column in 0..columns {
            let x = (left + at(column, columns) * sides[0]).rem_euclid(width) as u32;
            let pixel = frame.get_pixel(x.min(frame.width() - 1), y.min(frame.height() - 1));
            data.extend(pixel.0);
        }
    }
    Rgb8Image::new(columns, rows, data)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use image::Rgb;

    use super::*;

    fn watermark(longitude_degrees: f64, ranges: Vec<TimeRange>) -> Overlay {
        Overlay {
            class: OverlayClass::Watermark,
            longitude_degrees,
            latitude_degrees: 0.0,
            // A disc of a tenth of the sphere's width.
            solid_angle_steradians: TAU * (1.0 - (0.1 * PI).cos()),
            extent_degrees: None,
            constancy: 1.0,
            stayed: 1.0,
            strength_levels: 50.0,
            variation_levels: 0.0,
            saturated_share: 0.0,
            sightings: None,
            ranges,
        }
    }

    /// Columns have their own red, rows their own green.
    #[test]
    fn crops_lie_around_the_centre_and_across_the_seam() {
        let frame = RgbImage::from_fn(200, 100, |x, y| Rgb([x as u8, y as u8, 0]));
        for (longitude, middle) in [(0.0, 100), (180.0, 0), (-180.0, 0), (90.0, 150)] {
            let crop = crop(&frame, &watermark(longitude, Vec::new()));
            // 1.3 times a tenth of 200 columns, and of 100 rows on each side.
            assert_eq!((crop.width, crop.height), (26, 26));
            let [red, green, _] = crop.pixel(13, 13);
            assert_eq!((i32::from(red), green), (middle, 50), "{longitude}");
        }
    }

    #[test]
    fn overlays_are_shown_at_their_times() {
        let second = watermark(
            0.0,
            vec![TimeRange::new(2.0, 3.0), TimeRange::new(6.0, 7.0)],
        );
        let shown = [1.0, 2.0, 3.0, 4.0, 6.5].map(|seconds| is_shown(&second, seconds));
        assert_eq!(shown, [false, true, true, false, true]);
        assert!(is_shown(&watermark(0.0, Vec::new()), 1.0));
        let frame = |time_seconds: f64| FrameFiles {
            image: "frame.png",
            time_seconds,
            moving: None,
            ignored: None,
        };
        assert!(!concerns(&second, &[frame(3.5), frame(5.0)]));
        assert!(concerns(&second, &[frame(2.5), frame(5.0)]));
        assert!(concerns(&second, &[frame(1.0), frame(9.0)]));
        assert!(!concerns(&second, &[]));
    }
}
