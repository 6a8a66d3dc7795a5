//! Colours of an equirectangular image between its pixels.

use glam::DVec2;
use omnilife_schemas::RgbImage;

/// Bilinear between pixel centres, around the seam; rows beyond a pole repeat the last. `place` is in pixels
/// from the image's corner, the centre of the first pixel at (1/2, 1/2).
pub(crate) fn bilinear(image: &RgbImage, place: DVec2) -> [f32; 3] {
    let (width, height) = (image.width as i64, image.height as i64);
    let place = place - 0.5;
    let first = place.floor();
    let share = (place - first).as_vec2();
    let pixel = |dx: i64, dy: i64| {
        let column = (first.x as i64 + dx).rem_euclid(width);
        let row = (first.y as i64 + dy).clamp(0, height - 1);
        let at = (row * width + column) as usize * 3;
        [image.data[at], image.data[at + 1], image.data[at + 2]]
    };
    let [[a, b], [c, d]] = [[pixel(0, 0), pixel(1, 0)], [pixel(0, 1), pixel(1, 1)]];
    [0, 1, 2].map(|channel| {
        let upper = a[channel] + (b[channel] - a[channel]) * share.x;
        let lower = c[channel] + (d[channel] - c[channel]) * share.x;
        upper + (lower - upper) * share.y
    })
}
