//! Images in the middle of frames of a fixed size, for methods that require one.
//!
//! An image is resized by area averaging, in proportion, to the largest size that fits into the frame, and put in its
//! middle. It is never enlarged. The side that does not fill the frame is rounded to a whole pixel; with an odd
//! margin the left or upper part is a pixel narrower. The footprints of the averages divide the image, so that none
//! crosses the seam of a panorama.
//!
//! OmniLife360 (section 5.2) resizes and pads images "to unified dimensions to maintain consistent aspect ratios". It
//! does not state the dimensions, the position and content of the padding, and whether it is scored. Here it is black
//! and on both sides, masked as ignored region, and cut off before scoring.

use crate::camera::PinholeCamera;

/// Image in a frame of its size or larger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PaddedFrame {
    size: [u32; 2],
    image: [u32; 2],
}

impl PaddedFrame {
    /// Longest side of a frame, pixels.
    pub const LARGEST_SIDE: u32 = 1 << 14;

    /// Makes the frame of the size (width, height) `size` around an image of the size `image`, pixels.
    ///
    /// # Errors
    /// When a side is 0, or one of the frame is longer than [`Self::LARGEST_SIDE`]; names the side.
    pub fn fit(image: [u32; 2], size: [u32; 2]) -> Result<Self, String> {
        let [width, height] = size;
        if image.contains(&0) {
            return Err(format!("its images are {}x{} pixels", image[0], image[1]));
        }
        if !size
            .iter()
            .all(|side| (1..=Self::LARGEST_SIDE).contains(side))
        {
            return Err(format!(
                "a padded frame has sides of 1 to {} pixels, not {width}x{height}",
                Self::LARGEST_SIDE
            ));
        }
        let [own_width, own_height] = image.map(u64::from);
        let [most_width, most_height] = size.map(u64::from);
        let in_proportion = |side: u64, new: u64, old: u64| {
            let rounded = (2 * side * new + old) / (2 * old);
            // At most the frame's side, which is an u32.
            rounded.max(1) as u32
        };
        let fits = own_width <= most_width && own_height <= most_height;
        let image = if fits {
            image
        } else if own_height * most_width <= own_width * most_height {
            [width, in_proportion(own_height, most_width, own_width)]
        } else {
            [in_proportion(own_width, most_height, own_height), height]
        };
        Ok(Self { size, image })
    }

    /// Returns width and height of the frame, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns width and height of the image in it, pixels.
    pub fn image(&self) -> [u32; 2] {
        self.image
    }

    /// Returns column and row of the frame at which the image starts, pixels.
    pub fn offset(&self) -> [u32; 2] {
        [0, 1].map(|axis| (self.size[axis] - self.image[axis]) / 2)
    }

    /// Returns true where the image does not fill the frame.
    pub fn is_padded(&self) -> bool {
        self.size != self.image
    }

    /// Returns the camera of the frame for a camera whose images are put into it. The pixel (u, v) of `camera` is at
    /// (u sx + left, v sy + top), where sx and sy are the ratios of the image's sides. The centre of a pixel is half
    /// a pixel from its corner in both.
    #[must_use]
    pub fn pinhole(&self, camera: &PinholeCamera) -> PinholeCamera {
        let [image_width, image_height] = self.image;
        let [left, top] = self.offset().map(f64::from);
        let [width, height] = self.size;
        let (x, y) = (
            f64::from(image_width) / f64::from(camera.width),
            f64::from(image_height) / f64::from(camera.height),
        );
        PinholeCamera {
            width,
            height,
            fx: camera.fx * x,
            fy: camera.fy * y,
            cx: camera.cx * x + left,
            cy: camera.cy * y + top,
        }
    }

    /// Puts an image of `channels` values for each pixel into the frame, with `around` in the padding.
    ///
    /// # Panics
    /// When `image` does not have [`Self::image`] pixels.
    pub fn pad<T: Copy>(&self, image: &[T], channels: usize, around: T) -> Vec<T> {
        let [width, height] = self.size.map(|side| side as usize);
        let mut frame = vec![around; width * height * channels];
        for (row, range) in self.rows(channels).enumerate() {
            let length = range.len();
            frame[range].copy_from_slice(&image[row * length..(row + 1) * length]);
        }
        frame
    }

    /// Cuts the image of `channels` values for each pixel out of the frame.
    ///
    /// # Panics
    /// When `frame` has fewer than [`Self::size`] pixels.
    pub fn crop<T: Copy>(&self, frame: &[T], channels: usize) -> Vec<T> {
        self.rows(channels)
            .flat_map(|range| frame[range].iter().copied())
            .collect()
    }

    /// Returns the ranges of the image's rows among the values of the frame.
    fn rows(&self, channels: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let [left, top] = self.offset().map(|side| side as usize);
        let [image_width, image_height] = self.image.map(|side| side as usize);
        let width = self.size[0] as usize;
        (top..top + image_height).map(move |row| {
            let first = (row * width + left) * channels;
            first..first + image_width * channels
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;
    use crate::camera::CameraModel;

    fn fitted(image: [u32; 2], size: [u32; 2]) -> ([u32; 2], [u32; 2]) {
        let frame = PaddedFrame::fit(image, size).expect("sizes are sizes");
        (frame.image(), frame.offset())
    }

    #[test]
    fn images_fill_the_frame_as_far_as_their_proportions_let_them() {
        assert_eq!(fitted([4096, 2048], [1024, 576]), ([1024, 512], [0, 32]));
        assert_eq!(fitted([3840, 2160], [1024, 512]), ([910, 512], [57, 0]));
        // Images are never enlarged; of 5 columns 2 are on the left.
        assert_eq!(fitted([59, 31], [64, 32]), ([59, 31], [2, 0]));
        assert_eq!(fitted([30_000, 1], [100, 100]), ([100, 1], [0, 49]));
        for size in [[0, 9], [9, 0], [1 << 15, 9]] {
            assert!(PaddedFrame::fit([9, 9], size).is_err());
        }
        assert!(PaddedFrame::fit([0, 9], [9, 9]).is_err());
    }

    #[test]
    fn what_was_padded_is_cut_out_again() {
        let frame = PaddedFrame::fit([5, 3], [8, 6]).expect("sizes are sizes");
        for channels in [0, 1, 3] {
            let image: Vec<usize> = (1..=15 * channels).collect();
            let padded = frame.pad(&image, channels, 0);
            assert_eq!(padded.len(), 48 * channels);
            assert_eq!(
                padded.iter().filter(|&&value| value == 0).count(),
                33 * channels
            );
            assert_eq!(frame.crop(&padded, channels), image);
        }
    }

    #[test]
    fn points_are_seen_at_their_places_in_the_frame() {
        let camera = PinholeCamera::new([1917, 1081], [1403.25, 1398.5], [951.125, 533.875]);
        for size in [[640, 640], [512, 256], [1917, 1200]] {
            let frame = PaddedFrame::fit([1917, 1081], size).expect("sizes are sizes");
            let of_frame = frame.pinhole(&camera);
            assert_eq!([of_frame.width, of_frame.height], size);
            for point in [dvec3(0.3, -0.2, 1.7), dvec3(-4.0, 2.5, 9.0)] {
                let whole = camera.project(point).expect("in front");
                let found = of_frame.project(point).expect("in front");
                let image = frame.image().map(f64::from);
                let [left, top] = frame.offset().map(f64::from);
                assert!((found.x - (whole.x * image[0] / 1917.0 + left)).abs() < 1e-9);
                assert!((found.y - (whole.y * image[1] / 1081.0 + top)).abs() < 1e-9);
            }
        }
    }
}
