//! Values of an image between the centres of its pixels.

use glam::DVec2;

use crate::rgb::RgbImage;

/// Values beyond the left and the right edge of an image. Beyond the upper and the lower edge the outermost row
/// repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edges {
    /// Values of the other edge, as in an equirectangular image.
    Around,
    /// Values of the outermost column.
    Repeated,
}

/// Returns the four pixels around a position in an image of `[width, height]` (neither is zero) with their bilinear
/// weights, which add up to 1. `place` is finite and in pixels from the image's corner: the centre of the first pixel
/// is at (1/2, 1/2).
pub fn bilinear([width, height]: [usize; 2], edges: Edges, place: DVec2) -> [(usize, f64); 4] {
    let from_centre = place - 0.5;
    let first = from_centre.floor();
    let share = from_centre - first;
    let column = |offset: f64| match edges {
        Edges::Around => (first.x + offset).rem_euclid(width as f64) as usize % width,
        Edges::Repeated => (first.x + offset).clamp(0.0, (width - 1) as f64) as usize,
    };
    let row = |offset: f64| (first.y + offset).clamp(0.0, (height - 1) as f64) as usize;
    [
        (0.0, 0.0, (1.0 - share.x) * (1.0 - share.y)),
        (1.0, 0.0, share.x * (1.0 - share.y)),
        (0.0, 1.0, (1.0 - share.x) * share.y),
        (1.0, 1.0, share.x * share.y),
    ]
    .map(|(dx, dy, weight)| (row(dy) * width + column(dx), weight))
}

impl RgbImage {
    /// Returns the bilinear colour at a position; see [`bilinear`].
    pub fn sample(&self, place: DVec2, edges: Edges) -> [f32; 3] {
        let mut colour = [0.0; 3];
        for (pixel, weight) in bilinear([self.width, self.height], edges, place) {
            let values = &self.data[3 * pixel..3 * pixel + 3];
            for (sum, value) in colour.iter_mut().zip(values) {
                *sum += weight as f32 * value;
            }
        }
        colour
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;

    fn ramp() -> RgbImage {
        RgbImage {
            width: 4,
            height: 2,
            data: (0..8).flat_map(|pixel| [pixel as f32; 3]).collect(),
        }
    }

    #[test]
    fn centres_have_their_pixels_colour_and_places_between_have_both() {
        let image = ramp();
        for edges in [Edges::Around, Edges::Repeated] {
            assert_eq!(image.sample(dvec2(2.5, 1.5), edges), [6.0; 3]);
            assert_eq!(image.sample(dvec2(2.0, 0.5), edges), [1.5; 3]);
            assert_eq!(image.sample(dvec2(0.75, 1.0), edges), [2.25; 3]);
        }
    }

    #[test]
    fn a_panorama_goes_on_around_its_seam_and_other_images_end() {
        let image = ramp();
        for place in [dvec2(0.0, 0.5), dvec2(4.0, 0.5), dvec2(-4.0, 0.5)] {
            assert_eq!(image.sample(place, Edges::Around), [1.5; 3], "{place}");
        }
        assert_eq!(image.sample(dvec2(0.0, 0.5), Edges::Repeated), [0.0; 3]);
        assert_eq!(image.sample(dvec2(4.0, 0.5), Edges::Repeated), [3.0; 3]);
    }

    #[test]
    fn rows_beyond_a_pole_repeat_the_last() {
        let image = ramp();
        assert_eq!(image.sample(dvec2(1.5, -3.0), Edges::Around), [1.0; 3]);
        assert_eq!(image.sample(dvec2(1.5, 9.0), Edges::Around), [5.0; 3]);
    }
}
