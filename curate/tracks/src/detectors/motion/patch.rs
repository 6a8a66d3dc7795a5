//! Some pixels of an image with those beside them.

use crate::detectors::pixels_around::around;

/// Pixels, then those beside them, and the number in that list of each pixel of the image.
pub(super) struct Patch {
    /// Columns and rows of the image.
    size: [usize; 2],
    pixels: Vec<usize>,
    inner: usize,
    /// Index of each pixel; [`NOT_IN_IT`] for others.
    numbers: Vec<u32>,
}

const NOT_IN_IT: u32 = u32::MAX;

impl Patch {
    /// Creates a patch of some pixels of an image of so many columns and rows.
    pub(super) fn new(inner: &[usize], size: [usize; 2]) -> Self {
        let mut patch = Self {
            size,
            pixels: Vec::new(),
            inner: inner.len(),
            numbers: vec![NOT_IN_IT; size[0] * size[1]],
        };
        for &pixel in inner {
            patch.add(pixel);
        }
        for &pixel in inner {
            around(pixel, size, |beside| patch.add(beside));
        }
        patch
    }

    fn add(&mut self, pixel: usize) {
        let number = &mut self.numbers[pixel];
        if *number == NOT_IN_IT {
            *number = self.pixels.len() as u32;
            self.pixels.push(pixel);
        }
    }

    pub(super) fn pixels(&self) -> &[usize] {
        &self.pixels
    }

    /// Returns those pixels whose neighbours belong to the patch.
    pub(super) fn inner(&self) -> &[usize] {
        &self.pixels[..self.inner]
    }

    /// Calls with the indices of a pixel and of those beside it that belong to the patch.
    #[inline]
    pub(super) fn numbers_around(&self, pixel: usize, mut call: impl FnMut(usize)) {
        around(pixel, self.size, |beside| {
            let number = self.numbers[beside];
            if number != NOT_IN_IT {
                call(number as usize);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_come_with_those_beside_them() {
        let patch = Patch::new(&[7, 0], [6, 4]);
        assert_eq!(patch.inner(), [7, 0]);
        let mut pixels = patch.pixels().to_vec();
        pixels.sort_unstable();
        assert_eq!(pixels, [0, 1, 2, 6, 7, 8, 12, 13, 14]);
        let around = |pixel: usize| -> Vec<usize> {
            let mut found = Vec::new();
            patch.numbers_around(pixel, |number| found.push(patch.pixels()[number]));
            found
        };
        assert_eq!(around(7), [0, 1, 2, 6, 7, 8, 12, 13, 14]);
        assert_eq!(around(0), [0, 1, 6, 7]);
        assert!(around(23).is_empty());
    }
}
