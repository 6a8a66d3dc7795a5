//! Frames with the distance of the static surface behind each pixel, for sampling from other views.

use omnilife_schemas::RgbImage;

use crate::detectors::depth_of_points::DistanceMap;

/// Largest relative excess of a surface's distance over the visible one in its place; beyond, it is hidden.
const OCCLUSION: f32 = 0.03;

/// Red, green and blue, NaN for an unknown pixel, and the distance of the static surface, infinite if unknown.
pub(super) struct Texels {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Row by row.
    values: Vec<[f32; 4]>,
}

impl Texels {
    /// Combines an image and the distances of the same pixels.
    pub(super) fn new(image: &RgbImage, distances: &DistanceMap) -> Self {
        let colours = image.data.as_chunks::<3>().0.iter();
        let pixels = colours.zip(&distances.values);
        Self {
            width: image.width,
            height: image.height,
            values: pixels
                .map(|(&[red, green, blue], &distance)| [red, green, blue, distance])
                .collect(),
        }
    }

    pub(super) fn distances(&self) -> DistanceMap {
        DistanceMap {
            width: self.width,
            height: self.height,
            values: self.values.iter().map(|texel| texel[3]).collect(),
        }
    }

    /// Colours alone, channel by channel.
    pub(super) fn channels(&self) -> [Vec<f32>; 3] {
        [0, 1, 2].map(|channel| self.values.iter().map(|texel| texel[channel]).collect())
    }

    /// Returns the distance of the static surface behind a pixel.
    pub(super) fn distance(&self, pixel: usize) -> f32 {
        self.values[pixel][3]
    }

    pub(super) fn colour(&self, pixel: usize) -> [f32; 3] {
        let [red, green, blue, _] = self.values[pixel];
        [red, green, blue]
    }

    /// Returns the bilinear colour of a point at this distance, at a column and a row counted from the centre of the
    /// first pixel. `None` if it is hidden or outside, or a coordinate is NaN.
    #[inline(always)]
    pub(super) fn sample(&self, [column, row, away]: [f32; 3]) -> Option<[f32; 3]> {
        let [last_column, last_row] = [self.width, self.height].map(|side| side as f32 - 1.0);
        let is_inside = column >= 0.0 && row >= 0.0 && column < last_column && row < last_row;
        if !is_inside {
            return None;
        }
        let (left, above) = (column as usize, row as usize);
        let (x, y) = (column - left as f32, row - above as f32);
        let at = above * self.width + left;
        let (top, bottom) = (
            &self.values[at..at + 2],
            &self.values[at + self.width..][..2],
        );
        if top[0][3] < away * (1.0 - OCCLUSION) {
            return None;
        }
        // All four channels at once: they fill one register.
        let mut colour = [0.0; 4];
        for (channel, value) in colour.iter_mut().enumerate() {
            let top = (1.0 - x) * top[0][channel] + x * top[1][channel];
            let bottom = (1.0 - x) * bottom[0][channel] + x * bottom[1][channel];
            *value = (1.0 - y) * top + y * bottom;
        }
        let [red, green, blue, _] = colour;
        Some([red, green, blue])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns texels with red along columns and green along rows; everything is 10 m away.
    fn texels() -> Texels {
        let (width, height) = (6, 4);
        let pixels = (0..width * height).map(|at| ((at % width) as f32, (at / width) as f32));
        let image = RgbImage {
            width,
            height,
            data: pixels
                .flat_map(|(column, row)| [0.1 * column, 0.2 * row, 0.5])
                .collect(),
        };
        let distances = DistanceMap {
            width,
            height,
            values: vec![10.0; width * height],
        };
        Texels::new(&image, &distances)
    }

    #[test]
    fn colours_between_pixels_are_bilinear() {
        let [red, green, blue] = texels().sample([2.25, 1.5, 10.0]).expect("inside");
        assert!((red - 0.225).abs() < 1e-6 && (green - 0.3).abs() < 1e-6 && blue == 0.5);
    }

    #[test]
    fn what_is_hidden_or_outside_has_no_colour() {
        let texels = texels();
        for place in [
            [-0.1, 1.0, 10.0],
            [5.0, 1.0, 10.0],
            [1.0, 3.0, 10.0],
            [f32::NAN, 1.0, 10.0],
            [1.0, f32::NAN, 10.0],
            [1.0, 1.0, 10.4],
        ] {
            assert_eq!(texels.sample(place), None, "{place:?}");
        }
        assert!(texels.sample([1.0, 1.0, 10.2]).is_some());
        assert!(texels.sample([1.0, 1.0, 2.0]).is_some());
    }
}
