//! A prediction beside its ground truth.

use std::sync::OnceLock;

use omnilife_schemas::rgb::Mask;

use crate::lpips::{Backbone, ImageFeatures, InputRange, Lpips};

/// A prediction and its ground truth: two 8-bit RGB images of the same size.
///
/// Pixels that no score counts have the ground truth as their prediction, so that windows and networks that reach over
/// them see no error there; means are over the other pixels.
#[derive(Debug, Clone)]
pub struct ViewPair {
    width: usize,
    height: usize,
    prediction: Vec<u8>,
    truth: Vec<u8>,
    /// Pixels that count, row-major, and the unchanged prediction; `None` if all do.
    counted: Option<(Vec<bool>, Vec<u8>)>,
    alex_features: OnceLock<Option<PairFeatures>>,
}

/// Features of both images of a pair by a network.
#[derive(Debug, Clone)]
pub(crate) struct PairFeatures {
    pub(super) prediction: ImageFeatures,
    pub(super) truth: ImageFeatures,
}

impl ViewPair {
    /// Pairs two images of `width` x `height` pixels, row-major, three interleaved channels.
    ///
    /// Returns `None` when an image does not hold `width * height * 3` bytes or is empty.
    pub fn new(width: usize, height: usize, prediction: Vec<u8>, truth: Vec<u8>) -> Option<Self> {
        let bytes = width.checked_mul(height)?.checked_mul(3)?;
        (bytes > 0 && prediction.len() == bytes && truth.len() == bytes).then_some(Self {
            width,
            height,
            prediction,
            truth,
            counted: None,
            alex_features: OnceLock::new(),
        })
    }

    /// Excludes the pixels that a mask marks (not zero): no score counts them.
    ///
    /// Returns `None` when the mask is of another size or marks every pixel.
    pub fn ignoring(mut self, mask: &Mask) -> Option<Self> {
        let counted: Vec<bool> = mask.data.iter().map(|&value| value == 0).collect();
        if [mask.width, mask.height] != self.size() || !counted.contains(&true) {
            return None;
        }
        let as_it_is = self.prediction.clone();
        let predicted = self.prediction.as_chunks_mut::<3>().0;
        let pixels = predicted.iter_mut().zip(self.truth.as_chunks::<3>().0);
        for ((predicted, truth), is_counted) in pixels.zip(&counted) {
            if !is_counted {
                *predicted = *truth;
            }
        }
        self.counted = Some((counted, as_it_is));
        self.alex_features = OnceLock::new();
        Some(self)
    }

    /// Returns the pixels that count, row-major; `None` if all do.
    pub(super) fn counted(&self) -> Option<&[bool]> {
        self.counted.as_ref().map(|(counted, _)| counted.as_slice())
    }

    pub(crate) fn counts(&self, pixel: usize) -> bool {
        self.counted().is_none_or(|counted| counted[pixel])
    }

    /// Returns the number of pixels of a row that count (0 at the top).
    pub(super) fn counted_in_row(&self, row: usize) -> usize {
        match self.counted() {
            None => self.width,
            Some(counted) => {
                let row = &counted[row * self.width..(row + 1) * self.width];
                row.iter().filter(|&&is_counted| is_counted).count()
            }
        }
    }

    /// Returns the number of pixels that count, at least 1.
    pub(super) fn counted_pixels(&self) -> usize {
        (0..self.height).map(|row| self.counted_in_row(row)).sum()
    }

    /// Returns the share of the pixels that count, above 0.
    pub(super) fn counted_share(&self) -> f64 {
        self.counted_pixels() as f64 / (self.width * self.height) as f64
    }

    /// Returns the features of both images in [-1, 1] by `AlexNet`, computed once: `lpips-alex` compares them with each
    /// other, temporal LPIPS with those of the view before and of the view after. `None` if the weights are missing or
    /// the images are too small.
    ///
    /// Views that share a pair must not request it first on several threads: a computing thread works on other tasks
    /// while it waits for its own.
    pub(crate) fn alex_features(&self) -> Option<&PairFeatures> {
        let compute = || {
            let network = Lpips::published(Backbone::Alex).ok()?;
            let of = |bytes: &[u8]| network.features(self.size(), bytes, InputRange::Signed);
            Some(PairFeatures {
                prediction: of(&self.prediction)?,
                truth: of(&self.truth)?,
            })
        };
        self.alex_features.get_or_init(compute).as_ref()
    }

    /// Pixels per row, at least 1.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows, at least 1.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels per row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns `height * width * 3` bytes of the prediction, also for pixels that do not count.
    pub fn as_predicted(&self) -> &[u8] {
        (self.counted.as_ref()).map_or(&self.prediction, |(_, as_it_is)| as_it_is)
    }

    /// Returns `height * width * 3` bytes of the scored prediction: the ground truth's for pixels that do not count.
    pub fn prediction(&self) -> &[u8] {
        &self.prediction
    }

    /// Returns `height * width * 3` bytes of the ground truth.
    pub fn truth(&self) -> &[u8] {
        &self.truth
    }

    /// Returns prediction and ground truth in `[0, 1]`.
    pub(super) fn unit_values(&self) -> [Vec<f64>; 2] {
        [&self.prediction, &self.truth].map(|bytes| {
            let values = bytes.iter().map(|&byte| f64::from(byte) / 255.0);
            values.collect()
        })
    }

    /// Returns the sum over one row (0 at the top) of the squared byte differences of channels 0, 1 and 2. They are
    /// exact integers, so that no order of summation can change a score.
    pub(super) fn row_squared_errors(&self, row: usize) -> [u64; 3] {
        let range = row * self.width * 3..(row + 1) * self.width * 3;
        let mut sums = [0_u64; 3];
        for (predicted, true_value) in self.prediction[range.clone()]
            .chunks_exact(3)
            .zip(self.truth[range].chunks_exact(3))
        {
            for (sum, error) in sums.iter_mut().zip(squared_errors(predicted, true_value)) {
                *sum += error;
            }
        }
        sums
    }

    /// Returns the sum over the whole image of the squared byte differences of channels 0, 1 and 2.
    pub(super) fn squared_errors(&self) -> [u64; 3] {
        (0..self.height)
            .map(|row| self.row_squared_errors(row))
            .fold([0; 3], |sums, row| [0, 1, 2].map(|c| sums[c] + row[c]))
    }

    /// Returns the sum of the squared byte differences of all channels over the counted pixels that `mask` marks, and
    /// their number.
    pub(super) fn squared_errors_inside(&self, mask: impl Iterator<Item = bool>) -> (u64, u64) {
        let pixels = self
            .prediction
            .chunks_exact(3)
            .zip(self.truth.chunks_exact(3))
            .zip(mask)
            .enumerate()
            .filter(|&(pixel, (_, is_inside))| is_inside && self.counts(pixel));
        pixels.fold((0, 0), |(sum, count), (_, ((predicted, true_value), _))| {
            let errors = squared_errors(predicted, true_value);
            (sum + errors.iter().sum::<u64>(), count + 1)
        })
    }
}

/// Returns the squared byte differences of a pixel.
fn squared_errors(predicted: &[u8], true_value: &[u8]) -> [u64; 3] {
    [0, 1, 2].map(|channel| {
        let difference = u64::from(predicted[channel].abs_diff(true_value[channel]));
        difference * difference
    })
}
