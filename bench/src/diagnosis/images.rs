//! Views at a reduced size, and the similarity of two images.

use crate::metrics::ViewPair;

/// Returns the PSNR in dB of a mean squared error of bytes; equal images have 100 dB, as in the scores.
pub(super) fn psnr_db(mean_squared_error: f64) -> f64 {
    -10.0 * (mean_squared_error / (255.0 * 255.0)).max(1e-10).log10()
}

/// Returns means of square blocks of an 8-bit RGB image of `size` (width, height): as large as leave at least `columns`
/// columns if the image has that many. Row-major, three interleaved channels, 0 to 255, with width and height; rows and
/// columns that fill no block are left out.
pub(super) fn reduced(bytes: &[u8], size: [usize; 2], columns: usize) -> ([usize; 2], Vec<f32>) {
    let (block, [width, height]) = blocks(size, columns);
    let mut means = vec![0.0; width * height * 3];
    let share = 1.0 / (block * block) as f32;
    for y in 0..height * block {
        let row = &bytes[3 * y * size[0]..][..3 * width * block];
        let means = &mut means[3 * (y / block) * width..][..3 * width];
        for (mean, pixels) in means
            .as_chunks_mut::<3>()
            .0
            .iter_mut()
            .zip(row.chunks_exact(3 * block))
        {
            for pixel in pixels.as_chunks::<3>().0 {
                for (sum, &value) in mean.iter_mut().zip(pixel) {
                    *sum += share * f32::from(value);
                }
            }
        }
    }
    ([width, height], means)
}

/// Returns the side of the blocks in pixels, and their columns and rows.
fn blocks([width, height]: [usize; 2], columns: usize) -> (usize, [usize; 2]) {
    let block = (width / columns).clamp(1, height);
    (block, [width / block, height / block])
}

/// A prediction and its ground truth at a reduced size.
#[derive(Debug, Clone)]
pub(super) struct Small {
    /// Width and height.
    pub(super) size: [usize; 2],
    /// Small image, as [`reduced`] returns it.
    pub(super) predicted: Vec<f32>,
    /// The same of the ground truth.
    pub(super) truth: Vec<f32>,
    /// The pixels that count: at least half of their block does.
    pub(super) counted: Vec<bool>,
}

impl Small {
    pub(super) fn of(pair: &ViewPair, columns: usize) -> Self {
        let (block, _) = blocks(pair.size(), columns);
        let (size, predicted) = reduced(pair.prediction(), pair.size(), columns);
        let (_, truth) = reduced(pair.truth(), pair.size(), columns);
        let is_counted = |index: usize| {
            let (left, top) = (index % size[0] * block, index / size[0] * block);
            let pixels = (top..top + block).flat_map(|y| {
                let row = y * pair.width();
                row + left..row + left + block
            });
            2 * pixels.filter(|&pixel| pair.counts(pixel)).count() >= block * block
        };
        Self {
            size,
            predicted,
            truth,
            counted: (0..size[0] * size[1]).map(is_counted).collect(),
        }
    }

    /// Returns the mean squared error of two images of its size, over the pixels that count.
    pub(super) fn error_between(&self, image: &[f32], other: &[f32]) -> f64 {
        let (mut sum, mut count) = (0.0, 0_usize);
        let pixels = image
            .as_chunks::<3>()
            .0
            .iter()
            .zip(other.as_chunks::<3>().0);
        for ((pixel, other), _) in pixels.zip(&self.counted).filter(|(_, counts)| **counts) {
            let squares = pixel.iter().zip(other).map(|(a, b)| (a - b) * (a - b));
            sum += f64::from(squares.sum::<f32>());
            count += 3;
        }
        sum / count.max(1) as f64
    }

    /// Returns the PSNR of an image of its size against the ground truth, dB.
    pub(super) fn psnr_of(&self, image: &[f32]) -> f64 {
        psnr_db(self.error_between(image, &self.truth))
    }

    /// Returns the values of an image of its size that count, as pixels.
    pub(super) fn counted_pixels<'a>(
        &'a self,
        image: &'a [f32],
    ) -> impl Iterator<Item = [f64; 3]> + Clone + 'a {
        let pixels = image.as_chunks::<3>().0.iter().zip(&self.counted);
        pixels
            .filter(|(_, counts)| **counts)
            .map(|(pixel, _)| pixel.map(f64::from))
    }
}

/// Returns Pearson's correlation of two sequences of the same length; 0 where either is constant.
pub(super) fn correlation(
    a: impl Iterator<Item = f64> + Clone,
    b: impl Iterator<Item = f64> + Clone,
) -> f64 {
    let means = [mean(a.clone()), mean(b.clone())];
    let [mut product, mut square_a, mut square_b] = [0.0; 3];
    for (a, b) in a.zip(b) {
        let (a, b) = (a - means[0], b - means[1]);
        product += a * b;
        square_a += a * a;
        square_b += b * b;
    }
    let norm = (square_a * square_b).sqrt();
    if norm > 1e-6 { product / norm } else { 0.0 }
}

/// Returns the arithmetic mean; 0 without values.
pub(super) fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for value in values {
        sum += value;
        count += 1;
    }
    sum / count.max(1) as f64
}

/// Returns the least value; infinite without values.
pub(super) fn least(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::INFINITY, f64::min)
}
