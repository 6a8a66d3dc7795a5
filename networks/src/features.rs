//! Images of features, as passed between layers of networks.

use rayon::prelude::*;

/// Images of equal size in one array: by image, row, column and channel, channels fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Number of images.
    pub images: usize,
    /// Rows of an image.
    pub height: usize,
    /// Pixels per row.
    pub width: usize,
    /// Values per pixel.
    pub channels: usize,
    /// `images * height * width * channels` values.
    pub data: Vec<f32>,
}

impl Features {
    /// Creates images of zeros.
    pub fn zeros(images: usize, height: usize, width: usize, channels: usize) -> Self {
        Self {
            images,
            height,
            width,
            channels,
            data: vec![0.0; images * height * width * channels],
        }
    }

    /// Values of one row.
    pub fn row_len(&self) -> usize {
        self.width * self.channels
    }

    /// Values of one image.
    pub fn image_len(&self) -> usize {
        self.height * self.row_len()
    }

    /// Returns all values of one image.
    pub fn image(&self, image: usize) -> &[f32] {
        &self.data[image * self.image_len()..][..self.image_len()]
    }

    /// Returns all values of one pixel; `None` outside the image.
    pub fn pixel(&self, image: usize, y: isize, x: isize) -> Option<&[f32]> {
        let inside =
            (0..self.height as isize).contains(&y) && (0..self.width as isize).contains(&x);
        let at = inside.then(|| {
            image * self.image_len() + y as usize * self.row_len() + x as usize * self.channels
        })?;
        Some(&self.data[at..at + self.channels])
    }

    /// Changes the sizes. The values are unspecified; the memory is reused.
    pub fn reshape(&mut self, images: usize, height: usize, width: usize, channels: usize) {
        self.data.resize(images * height * width * channels, 0.0);
        (self.images, self.height, self.width, self.channels) = (images, height, width, channels);
    }

    /// Copies pixels of a row, from column `left` on, as many as `values` holds; those outside the
    /// image are zero.
    pub(crate) fn copy_row(&self, image: usize, y: isize, left: isize, values: &mut [f32]) {
        let channels = self.channels as isize;
        let (begin, row_len) = (left * channels, self.row_len() as isize);
        let end = begin + values.len() as isize;
        if !(0..self.height as isize).contains(&y) || end <= 0 || begin >= row_len {
            values.fill(0.0);
            return;
        }
        let row = &self.image(image)[y as usize * self.row_len()..][..self.row_len()];
        let (from, to) = (begin.max(0), end.min(row_len));
        let (before, inside) = ((from - begin) as usize, (to - from) as usize);
        values[..before].fill(0.0);
        values[before..before + inside].copy_from_slice(&row[from as usize..to as usize]);
        values[before + inside..].fill(0.0);
    }

    /// Returns the rows `rows` of every image.
    ///
    /// # Panics
    /// When there are fewer rows.
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Self {
        let row_len = self.row_len();
        let mut data = Vec::with_capacity(self.images * rows.len() * row_len);
        for image in 0..self.images {
            let values = self.image(image);
            data.extend_from_slice(&values[rows.start * row_len..rows.end * row_len]);
        }
        Self {
            height: rows.len(),
            data,
            ..*self
        }
    }

    /// Returns the largest value of every channel in windows of `side` x `side` pixels, `stride` apart; windows that
    /// would leave the image are left out.
    ///
    /// # Panics
    /// When an image is smaller than one window.
    pub fn max_pool(&self, side: usize, stride: usize) -> Self {
        assert!(
            self.height >= side && self.width >= side,
            "a {side}x{side} window in an image of {}x{}",
            self.width,
            self.height
        );
        let [height, width] = [self.height, self.width].map(|length| (length - side) / stride + 1);
        let mut pooled = Self::zeros(self.images, height, width, self.channels);
        self.max_pool_rows(0..self.height, [side, stride], &mut pooled, 0);
        pooled
    }

    /// Applies [`Self::max_pool`] to the rows `rows` alone, into the rows of `pooled` from `first` on.
    ///
    /// # Panics
    /// When there are fewer rows, or `pooled` does not have the width, the channels and the rows
    /// for it.
    pub fn max_pool_rows(
        &self,
        rows: std::ops::Range<usize>,
        [side, stride]: [usize; 2],
        pooled: &mut Self,
        first: usize,
    ) {
        assert_eq!(
            [pooled.images, pooled.width, pooled.channels],
            [self.images, (self.width - side) / stride + 1, self.channels],
            "sizes of what is pooled"
        );
        // Windows that would leave the rows are left out.
        let height = (rows.len() + stride).saturating_sub(side) / stride;
        let (row_len, pooled_len) = (pooled.row_len(), pooled.image_len());
        if height * row_len == 0 {
            return;
        }
        for (image, values) in pooled.data.chunks_exact_mut(pooled_len).enumerate() {
            let source = self.image(image);
            values[first * row_len..][..height * row_len]
                .par_chunks_exact_mut(row_len)
                .enumerate()
                .for_each(|(y, row)| {
                    for (x, pixel) in row.chunks_exact_mut(self.channels).enumerate() {
                        pixel.fill(f32::NEG_INFINITY);
                        for (dy, dx) in (0..side * side).map(|at| (at / side, at % side)) {
                            let row = rows.start + y * stride + dy;
                            let at = row * self.row_len() + (x * stride + dx) * self.channels;
                            let values = &source[at..at + self.channels];
                            for (largest, &value) in pixel.iter_mut().zip(values) {
                                *largest = largest.max(value);
                            }
                        }
                    }
                });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_that_leave_the_image_are_left_out() {
        let mut features = Features::zeros(2, 4, 6, 1);
        for (index, value) in features.data.iter_mut().enumerate() {
            *value = index as f32 - 30.0;
        }
        let pooled = features.max_pool(3, 2);
        assert_eq!((pooled.height, pooled.width), (1, 2));
        assert_eq!(pooled.data, [-16.0, -14.0, 8.0, 10.0]);
    }

    #[test]
    fn rows_are_pooled_as_if_they_were_all() {
        let mut features = Features::zeros(2, 7, 6, 3);
        for (index, value) in features.data.iter_mut().enumerate() {
            *value = (index * 31 % 97) as f32 - 50.0;
        }
        for (rows, side, stride) in [
            (2..6, 2, 2),
            (1..6, 2, 2),
            (0..7, 3, 2),
            (3..5, 1, 1),
            (6..7, 2, 2),
        ] {
            let alone = features.rows(rows.clone());
            let mut pooled = Features::zeros(2, 9, (6 - side) / stride + 1, 3);
            features.max_pool_rows(rows.clone(), [side, stride], &mut pooled, 1);
            let expected = if alone.height < side {
                0
            } else {
                (alone.height - side) / stride + 1
            };
            let found = pooled.rows(1..1 + expected);
            if expected > 0 {
                assert_eq!(found, alone.max_pool(side, stride), "{rows:?}");
            }
            let untouched = pooled.rows(1 + expected..9);
            assert!(untouched.data.iter().all(|&value| value == 0.0), "{rows:?}");
        }
    }

    #[test]
    fn rows_are_those_of_every_image() {
        let mut features = Features::zeros(2, 3, 2, 2);
        for (index, value) in features.data.iter_mut().enumerate() {
            *value = index as f32;
        }
        let strip = features.rows(1..2);
        assert_eq!(strip.data, [4.0, 5.0, 6.0, 7.0, 16.0, 17.0, 18.0, 19.0]);
        assert_eq!(strip.pixel(1, 0, 1), Some([18.0, 19.0].as_slice()));
        assert_eq!(strip.pixel(1, 1, 0), None);
    }
}
