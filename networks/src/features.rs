//! Pictures of features, as networks hand them from layer to layer.

use rayon::prelude::*;

/// Pictures of equal size in one array: by picture, row, column and channel, channels fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Number of pictures.
    pub pictures: usize,
    /// Rows of a picture.
    pub height: usize,
    /// Pixels per row.
    pub width: usize,
    /// Values per pixel.
    pub channels: usize,
    /// `pictures * height * width * channels` values.
    pub data: Vec<f32>,
}

impl Features {
    /// All zero.
    pub fn zeros(pictures: usize, height: usize, width: usize, channels: usize) -> Self {
        Self {
            pictures,
            height,
            width,
            channels,
            data: vec![0.0; pictures * height * width * channels],
        }
    }

    /// Values of one row.
    pub fn row_len(&self) -> usize {
        self.width * self.channels
    }

    /// Values of one picture.
    pub fn picture_len(&self) -> usize {
        self.height * self.row_len()
    }

    /// All values of one picture.
    pub fn picture(&self, picture: usize) -> &[f32] {
        &self.data[picture * self.picture_len()..][..self.picture_len()]
    }

    /// All values of one pixel; `None` outside the picture.
    pub fn pixel(&self, picture: usize, y: isize, x: isize) -> Option<&[f32]> {
        let inside =
            (0..self.height as isize).contains(&y) && (0..self.width as isize).contains(&x);
        let at = inside.then(|| {
            picture * self.picture_len() + y as usize * self.row_len() + x as usize * self.channels
        })?;
        Some(&self.data[at..at + self.channels])
    }

    /// The rows `rows` of every picture.
    ///
    /// # Panics
    /// When there are fewer rows.
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Self {
        let mut strip = Self::zeros(self.pictures, rows.len(), self.width, self.channels);
        let (row_len, strip_len) = (self.row_len(), strip.picture_len());
        if strip_len == 0 {
            return strip;
        }
        for (picture, values) in strip.data.chunks_exact_mut(strip_len).enumerate() {
            let from = picture * self.picture_len() + rows.start * row_len;
            values.copy_from_slice(&self.data[from..from + strip_len]);
        }
        strip
    }

    /// The largest value of every channel in windows of `side` x `side` pixels, `stride` apart;
    /// windows that would leave the picture are left out.
    ///
    /// # Panics
    /// When a picture is smaller than one window.
    pub fn max_pool(&self, side: usize, stride: usize) -> Self {
        assert!(
            self.height >= side && self.width >= side,
            "a {side}x{side} window in a picture of {}x{}",
            self.width,
            self.height
        );
        let height = (self.height - side) / stride + 1;
        let width = (self.width - side) / stride + 1;
        let mut pooled = Self::zeros(self.pictures, height, width, self.channels);
        let row_len = pooled.row_len();
        pooled
            .data
            .par_chunks_mut(row_len)
            .enumerate()
            .for_each(|(index, row)| {
                let (picture, y) = (index / height, index % height);
                for (x, pixel) in row.chunks_exact_mut(self.channels).enumerate() {
                    pixel.fill(f32::NEG_INFINITY);
                    for (dy, dx) in (0..side * side).map(|at| (at / side, at % side)) {
                        let source = self.pixel(
                            picture,
                            (y * stride + dy) as isize,
                            (x * stride + dx) as isize,
                        );
                        for (largest, &value) in pixel.iter_mut().zip(source.into_iter().flatten())
                        {
                            *largest = largest.max(value);
                        }
                    }
                }
            });
        pooled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_that_leave_the_picture_are_left_out() {
        let mut features = Features::zeros(2, 4, 6, 1);
        for (index, value) in features.data.iter_mut().enumerate() {
            *value = index as f32 - 30.0;
        }
        let pooled = features.max_pool(3, 2);
        assert_eq!((pooled.height, pooled.width), (1, 2));
        assert_eq!(pooled.data, [-16.0, -14.0, 8.0, 10.0]);
    }

    #[test]
    fn rows_are_those_of_every_picture() {
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
