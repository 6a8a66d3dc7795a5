//! Activations of a window of frames.

/// Values by row, column, frame and channel, in this order: a pixel's values over time lie
/// together, so that a step in time is a step of `channels`.
#[derive(Debug, Clone)]
pub(super) struct Clip {
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) frames: usize,
    pub(super) channels: usize,
    pub(super) data: Vec<f32>,
}

impl Clip {
    pub(super) fn zeros(height: usize, width: usize, frames: usize, channels: usize) -> Self {
        Self {
            height,
            width,
            frames,
            channels,
            data: vec![0.0; height * width * frames * channels],
        }
    }

    /// Returns the length of a pixel's values.
    pub(super) fn pixel_len(&self) -> usize {
        self.frames * self.channels
    }

    /// Returns all values of one pixel; `None` outside the image.
    pub(super) fn pixel(&self, y: isize, x: isize) -> Option<&[f32]> {
        let inside =
            (0..self.height as isize).contains(&y) && (0..self.width as isize).contains(&x);
        let at = inside.then(|| (y as usize * self.width + x as usize) * self.pixel_len())?;
        Some(&self.data[at..at + self.pixel_len()])
    }

    /// Means of 2x2 pixels; an odd last row or column is left out.
    pub(super) fn halved(&self) -> Self {
        let mut half = Self::zeros(self.height / 2, self.width / 2, self.frames, self.channels);
        let len = self.pixel_len();
        for y in 0..half.height {
            for x in 0..half.width {
                let at = (y * half.width + x) * len;
                for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let from = ((2 * y + dy) * self.width + 2 * x + dx) * len;
                    let source = &self.data[from..from + len];
                    for (sum, value) in half.data[at..at + len].iter_mut().zip(source) {
                        *sum += 0.25 * value;
                    }
                }
            }
        }
        half
    }

    /// Means over all pixels: one row of channels per frame.
    pub(super) fn spatial_means(&self) -> Vec<f32> {
        let mut means = vec![0.0; self.pixel_len()];
        for pixel in self.data.chunks_exact(self.pixel_len()) {
            for (mean, value) in means.iter_mut().zip(pixel) {
                *mean += value;
            }
        }
        let share = 1.0 / (self.height * self.width) as f32;
        means.iter_mut().for_each(|mean| *mean *= share);
        means
    }
}
