//! Masks of pixels: their sizes, unions and shares of the sphere.

use crate::camera::{Camera, ErpCamera};

/// Returns the index of the nearest pixel of an image of the size `old` for every pixel, row by row, of one of the
/// size `new` (width, height).
pub fn nearest_pixels(old: [usize; 2], new: [usize; 2]) -> impl Iterator<Item = usize> {
    let nearest = move |index: usize, axis: usize| (2 * index + 1) * old[axis] / (2 * new[axis]);
    (0..new[1]).flat_map(move |y| {
        let row = nearest(y, 1) * old[0];
        (0..new[0]).map(move |x| row + nearest(x, 0))
    })
}

/// Mask of one byte per pixel, row-major; non-zero is marked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` values, 0 or 255.
    pub data: Vec<u8>,
}

impl Mask {
    /// Makes a mask of `height * width` values, row by row.
    pub fn new(width: usize, height: usize, data: Vec<u8>) -> Self {
        Self {
            width,
            height,
            data,
        }
    }

    /// Returns the mask at another size; every pixel takes the value of the nearest old one.
    ///
    /// # Panics
    /// When `width` or `height` is zero.
    pub fn resized_to_nearest(&self, width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0, "a mask has at least one pixel");
        let nearest = nearest_pixels([self.width, self.height], [width, height]);
        Self {
            width,
            height,
            data: nearest.map(|index| self.data[index]).collect(),
        }
    }

    /// Returns the mask at another size: a pixel is marked where any old one that it partly covers is marked.
    ///
    /// # Panics
    /// When `width` or `height` is zero.
    pub fn resized_to_any(&self, width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0, "a mask has at least one pixel");
        let covered = |new: usize, old_len: usize, new_len: usize| {
            new * old_len / new_len..((new + 1) * old_len).div_ceil(new_len)
        };
        let is_marked = |(row, column): (usize, usize)| {
            covered(row, self.height, height).any(|y| {
                let columns = covered(column, self.width, width);
                let row = &self.data[y * self.width..(y + 1) * self.width];
                row[columns].iter().any(|&value| value != 0)
            })
        };
        let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column)));
        Self {
            width,
            height,
            data: pixels
                .map(|pixel| 255 * u8::from(is_marked(pixel)))
                .collect(),
        }
    }

    /// Adds the marks of another mask, which is resized to the size of this one.
    ///
    /// # Panics
    /// When this one has no pixels.
    pub fn united(mut self, other: &Self) -> Self {
        let other = other.resized_to_nearest(self.width, self.height);
        for (value, other) in self.data.iter_mut().zip(other.data) {
            *value |= other;
        }
        self
    }

    /// Removes the marks of another mask of the same size.
    pub fn without(mut self, other: &Self) -> Self {
        for (value, other) in self.data.iter_mut().zip(&other.data) {
            *value &= !other;
        }
        self
    }

    /// Returns the marked share of the sphere, 0 to 1: pixels of ERP images count by their solid angle, those of a
    /// pinhole alike.
    pub fn marked_share(&self, camera: &Camera) -> f64 {
        let erp = ErpCamera::new(self.width as u32, self.height as u32);
        let (mut marked, mut all) = (0.0, 0.0);
        for (row, pixels) in self.data.chunks(self.width.max(1)).enumerate() {
            let weight = match camera {
                Camera::Erp(_) => erp.pixel_solid_angle(row as u32),
                Camera::Pinhole(_) => 1.0,
            };
            let count = pixels.iter().filter(|&&value| value != 0).count();
            marked += weight * count as f64;
            all += weight * pixels.len() as f64;
        }
        if all > 0.0 { marked / all } else { 0.0 }
    }

    /// Returns true where any pixel is marked.
    pub fn marks_anything(&self) -> bool {
        self.data.iter().any(|&value| value != 0)
    }

    /// Returns true where the unmarked pixels are those of an upright rectangle.
    pub fn leaves_rectangle(&self) -> bool {
        let (mut columns, mut rows) = ((usize::MAX, 0), (usize::MAX, 0));
        let mut left = 0_usize;
        for (row, pixels) in self.data.chunks(self.width.max(1)).enumerate() {
            for (column, _) in pixels.iter().enumerate().filter(|&(_, &value)| value == 0) {
                columns = (columns.0.min(column), columns.1.max(column + 1));
                rows = (rows.0.min(row), rows.1.max(row + 1));
                left += 1;
            }
        }
        let [width, height] = [columns, rows].map(|(first, end)| end.saturating_sub(first));
        left > 0 && left == width.saturating_mul(height)
    }

    /// Returns whether every pixel is marked.
    pub fn is_full(&self) -> bool {
        self.data.iter().all(|&value| value != 0)
    }

    /// Swaps marked and unmarked pixels.
    pub fn inverted(mut self) -> Self {
        for value in &mut self.data {
            *value = 255 - *value;
        }
        self
    }
}
