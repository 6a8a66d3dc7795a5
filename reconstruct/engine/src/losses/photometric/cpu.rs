//! The loss on the CPU, in parallel bands of rows.

use std::cell::RefCell;

use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

use crate::losses::photometric::{
    Columns, LossValue, PixelMarks,
    rows::{Band, Pair, RADIUS, RowSums, Scratch, WINDOW, Weights, gradient_band, similarity_band},
    strips::RowShape,
};

pub(super) const SIGMA: f64 = 1.5;
/// Rows per task, independent of the number of threads.
const ROWS_PER_BAND: usize = 32;

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Working memory for one image size, reused over iterations.
#[derive(Debug)]
pub struct Loss {
    shape: RowShape,
    window: [f32; WINDOW],
    /// `ds/dmx`, `ds/dE[x^2]`, `ds/dE[xy]`, row after row.
    derivatives: Vec<f32>,
    sums: Vec<RowSums>,
    gradient: Vec<f32>,
    /// The render, with the target in place of marked values, and the weights of the pixels.
    composited: Vec<f32>,
    weights: Vec<f32>,
}

impl Loss {
    /// Creates the memory for images of `width` x `height` with these neighbours of the first and last
    /// column.
    pub fn new(width: usize, height: usize, columns: Columns) -> Self {
        let shape = RowShape {
            width,
            height,
            columns,
        };
        Self {
            shape,
            window: gaussian_window(),
            derivatives: vec![0.0; shape.stride() * 3 * height],
            sums: vec![RowSums::default(); height],
            gradient: vec![0.0; shape.values() * height],
            composited: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// Returns the loss and its gradient by `render`; both images and the gradient are HWC.
    pub fn forward_backward(
        &mut self,
        render: &[f32],
        target: &[f32],
        lambda: f32,
    ) -> (LossValue, &[f32]) {
        self.masked_forward_backward(render, target, &[], lambda)
    }

    /// Does the same as [`Loss::forward_backward`] without marked values: both images take the target there,
    /// for the windows that reach over them. Means are over the pixels that are not ignored; without any the
    /// loss is 0.
    pub fn forward_backward_marked(
        &mut self,
        marks: PixelMarks<'_>,
        render: &[f32],
        target: &[f32],
        lambda: f32,
    ) -> (LossValue, &[f32]) {
        if marks.are_none() {
            return self.forward_backward(render, target, lambda);
        }
        let (mut composited, mut weights) = (
            std::mem::take(&mut self.composited),
            std::mem::take(&mut self.weights),
        );
        marks.composite(render, target, &mut composited);
        marks.weigh(&mut weights);
        let (value, _) = self.masked_forward_backward(&composited, target, &weights, lambda);
        let values = self.gradient.iter_mut().zip(render.iter().zip(target));
        for (at, (gradient, (&render, &target))) in values.enumerate() {
            if marks.settle(at, render, target) {
                *gradient = 0.0;
            }
        }
        (self.composited, self.weights) = (composited, weights);
        (value, &self.gradient)
    }

    /// Does the same as [`Loss::forward_backward`] with a weight in [0, 1] per pixel: L1, SSIM and their
    /// gradients become weighted means. An empty mask weights all pixels equally; if all weights are 0, so is
    /// the loss.
    pub fn masked_forward_backward(
        &mut self,
        render: &[f32],
        target: &[f32],
        mask: &[f32],
        lambda: f32,
    ) -> (LossValue, &[f32]) {
        let pair = Pair {
            render,
            target,
            mask,
        };
        let (value, weight) = self.similarity(pair, lambda);
        let per_value = if weight > 0.0 { 1.0 / weight } else { 0.0 } as f32;
        // Negative, because the loss contains 1 - SSIM.
        let weights = Weights {
            l1: (1.0 - lambda) * per_value,
            similarity: -lambda * per_value,
        };
        let (shape, window, derivatives) = (self.shape, &self.window, &self.derivatives);
        let level = Level::new();
        self.gradient
            .par_chunks_mut(ROWS_PER_BAND * shape.values())
            .enumerate()
            .with_max_len(1)
            .for_each(|(number, gradient)| {
                let band = Band {
                    shape,
                    window,
                    pair,
                    first_row: number * ROWS_PER_BAND,
                };
                SCRATCH.with_borrow_mut(|scratch| {
                    dispatch!(level, simd => {
                        gradient_band(simd, band, weights, derivatives, gradient, scratch);
                    });
                });
            });
        (value, &self.gradient)
    }

    /// Returns the loss without its gradient.
    pub fn value(&mut self, render: &[f32], target: &[f32], lambda: f32) -> LossValue {
        let pair = Pair {
            render,
            target,
            mask: &[],
        };
        self.similarity(pair, lambda).0
    }

    /// Returns the loss and the sum of weights; stores the derivatives of the similarity.
    fn similarity(&mut self, pair: Pair<'_>, lambda: f32) -> (LossValue, f64) {
        let shape = self.shape;
        let (pixels, values) = (shape.width * shape.height, shape.values() * shape.height);
        assert_eq!(pair.render.len(), values, "image size");
        assert_eq!(pair.target.len(), values, "image size");
        assert!(
            pair.mask.is_empty() || pair.mask.len() == pixels,
            "mask size"
        );
        let (window, level) = (&self.window, Level::new());
        self.derivatives
            .par_chunks_mut(ROWS_PER_BAND * 3 * shape.stride())
            .zip(self.sums.par_chunks_mut(ROWS_PER_BAND))
            .enumerate()
            .with_max_len(1)
            .for_each(|(number, (derivatives, sums))| {
                let band = Band {
                    shape,
                    window,
                    pair,
                    first_row: number * ROWS_PER_BAND,
                };
                SCRATCH.with_borrow_mut(|scratch| {
                    dispatch!(level, simd => {
                        similarity_band(simd, band, derivatives, sums, scratch);
                    });
                });
            });
        // In row order, so that the sum does not depend on the number of threads.
        let mut sum = RowSums::default();
        for row in &self.sums {
            sum.add(row);
        }
        if sum.weight == 0.0 {
            let value = LossValue {
                ssim: 1.0,
                ..LossValue::default()
            };
            return (value, 0.0);
        }
        let (l1, ssim) = (sum.l1 / sum.weight, sum.similarity / sum.weight);
        let lambda = f64::from(lambda);
        let value = LossValue {
            total: (1.0 - lambda) * l1 + lambda * (1.0 - ssim),
            l1,
            ssim,
            mse: sum.squares / sum.weight,
        };
        (value, sum.weight)
    }
}

pub(super) fn gaussian_window() -> [f32; WINDOW] {
    let value = |index: usize| {
        let distance = index as f64 - RADIUS as f64;
        (-distance * distance / (2.0 * SIGMA * SIGMA)).exp()
    };
    let total: f64 = (0..WINDOW).map(value).sum();
    std::array::from_fn(|index| (value(index) / total) as f32)
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::{Camera, ErpCamera, PinholeCamera};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::losses::photometric::reference::ReferencePair;

    fn random_image(rng: &mut Pcg64Mcg, len: usize) -> Vec<f32> {
        (0..len).map(|_| rng.random_range(0.0..1.0)).collect()
    }

    fn widen(image: &[f32]) -> Vec<f64> {
        image.iter().copied().map(f64::from).collect()
    }

    const BOTH: [Columns; 2] = [Columns::Wrap, Columns::End];

    #[test]
    fn value_is_that_of_the_reference() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        // The last one is more than one strip wide.
        let sizes = [(16, 8), (17, 9), (4, 2), (20, 70), (259, 6)];
        for ((width, height), columns) in
            sizes.into_iter().flat_map(|size| BOTH.map(|of| (size, of)))
        {
            let (x, y) = (
                random_image(&mut rng, width * height * 3),
                random_image(&mut rng, width * height * 3),
            );
            let value = Loss::new(width, height, columns).value(&x, &y, 0.2);
            let (render, target) = (widen(&x), widen(&y));
            let pair = ReferencePair {
                width,
                height,
                columns,
                render: &render,
                target: &target,
                mask: &vec![1.0; width * height],
            };
            let expected = pair.value_and_gradient(0.2).0;
            for (found, expected) in [
                (value.total, expected.total),
                (value.l1, expected.l1),
                (value.ssim, expected.ssim),
                (value.mse, expected.mse),
            ] {
                assert!((found - expected).abs() < 1e-6, "{value:?} {expected}");
            }
        }
    }

    #[test]
    fn gradient_is_that_of_the_reference() {
        check_gradient((14, 7), Columns::Wrap);
        check_gradient((14, 7), Columns::End);
    }

    #[test]
    fn gradient_is_that_of_the_reference_across_strips_and_seam() {
        check_gradient((259, 2), Columns::Wrap);
        check_gradient((259, 2), Columns::End);
    }

    /// The first column of a panorama is next to its last one; that of a pinhole is at a border.
    #[test]
    fn the_left_border_changes_the_gradient_at_the_right_one_of_panoramas_alone() {
        let (width, height, lambda) = (40, 12, 0.4);
        let mut rng = Pcg64Mcg::seed_from_u64(6);
        let (x, y) = (
            random_image(&mut rng, width * height * 3),
            random_image(&mut rng, width * height * 3),
        );
        let mut others = [x.clone(), y.clone()];
        for image in &mut others {
            for row in image.chunks_exact_mut(3 * width) {
                for value in &mut row[..9] {
                    *value = 1.0 - *value;
                }
            }
        }
        let cameras = [
            Camera::Erp(ErpCamera::new(40, 12)),
            Camera::Pinhole(PinholeCamera::with_horizontal_field_of_view(40, 12, 1.0)),
        ];
        for camera in cameras {
            let mut loss = Loss::new(width, height, Columns::of(&camera));
            let mut right_columns = |x: &[f32], y: &[f32]| -> Vec<f32> {
                let gradient = loss.forward_backward(x, y, lambda).1;
                let rows = gradient.chunks_exact(3 * width);
                rows.flat_map(|row| row[3 * (width - 4)..].iter().copied())
                    .collect()
            };
            let is_the_same = right_columns(&x, &y) == right_columns(&others[0], &others[1]);
            assert_eq!(is_the_same, !camera.wraps(), "{camera:?}");

            // In the outermost columns, where the gradient of the wrong camera model would differ.
            let gradient = loss.forward_backward(&x, &y, lambda).1.to_vec();
            let step = 2e-3;
            for row in [0, height / 2] {
                for column in [0, 2, width - 3, width - 1] {
                    let at = 3 * (row * width + column) + 1;
                    // Away from the kink of L1.
                    if (x[at] - y[at]).abs() < 2.0 * step {
                        continue;
                    }
                    let mut shifted = |by: f32| {
                        let mut shifted = x.clone();
                        shifted[at] += by;
                        loss.value(&shifted, &y, lambda).total
                    };
                    let expected = (shifted(step) - shifted(-step)) / (2.0 * f64::from(step));
                    let error = (f64::from(gradient[at]) - expected).abs();
                    assert!(error < 5e-6, "{camera:?} {at}: {} {expected}", gradient[at]);
                }
            }
        }
    }

    fn check_gradient((width, height): (usize, usize), columns: Columns) {
        let lambda = 0.4;
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let (x, y) = (
            random_image(&mut rng, width * height * 3),
            random_image(&mut rng, width * height * 3),
        );
        let mask: Vec<f32> = (0..width * height)
            .map(|pixel| [0.0, 0.3, 1.0][pixel % 3])
            .collect();
        for mask in [Vec::new(), mask] {
            let mut loss = Loss::new(width, height, columns);
            let (_, gradient) = loss.masked_forward_backward(&x, &y, &mask, lambda);
            let all = vec![1.0; width * height];
            let mask = widen(if mask.is_empty() { &all } else { &mask });
            let (x, y) = (widen(&x), widen(&y));
            let pair = ReferencePair {
                width,
                height,
                columns,
                render: &x,
                target: &y,
                mask: &mask,
            };
            let (_, expected) = pair.value_and_gradient(f64::from(lambda));
            let largest = expected.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
            for (index, (&found, expected)) in gradient.iter().zip(&expected).enumerate() {
                let error = (f64::from(found) - expected).abs();
                assert!(error < 1e-5 * largest, "{index}: {found} {expected}");
            }
        }
    }

    #[test]
    fn ignored_pixels_have_the_targets_colour_and_no_gradient() {
        let (width, height, columns, lambda) = (37, 19, Columns::Wrap, 0.4);
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let (x, y) = (
            random_image(&mut rng, width * height * 3),
            random_image(&mut rng, width * height * 3),
        );
        // A region across the seam, and the lowest rows.
        let is_ignored = |at: usize| at / width > 14 || (at % width + 6) % width < 11;
        let ignored: Vec<u8> = (0..width * height)
            .map(|at| u8::from(is_ignored(at)))
            .collect();
        let marks = PixelMarks {
            ignored: Some(&ignored),
            saturated: &[],
        };
        let mut loss = Loss::new(width, height, columns);
        let (value, gradient) = loss.forward_backward_marked(marks, &x, &y, lambda);
        let composited: Vec<f64> = (x.iter().zip(&y).enumerate())
            .map(|(at, (&x, &y))| f64::from(if is_ignored(at / 3) { y } else { x }))
            .collect();
        let weights: Vec<f64> = ignored.iter().map(|&mark| 1.0 - f64::from(mark)).collect();
        let pair = ReferencePair {
            width,
            height,
            columns,
            render: &composited,
            target: &widen(&y),
            mask: &weights,
        };
        let (expected, expected_gradient) = pair.value_and_gradient(f64::from(lambda));
        assert!(
            (value.total - expected.total).abs() < 1e-6,
            "{value:?} {expected:?}"
        );
        assert!(
            (value.mse - expected.mse).abs() < 1e-6,
            "{value:?} {expected:?}"
        );
        for (at, (&found, expected)) in gradient.iter().zip(expected_gradient).enumerate() {
            let expected = if is_ignored(at / 3) { 0.0 } else { expected };
            assert!(
                (f64::from(found) - expected).abs() < 1e-7,
                "{at}: {found} {expected}"
            );
        }
        // The render does not matter in ignored pixels.
        let (found, gradient) = (value, gradient.to_vec());
        let other: Vec<f32> = (x.iter().enumerate())
            .map(|(at, &x)| if is_ignored(at / 3) { 9.0 } else { x })
            .collect();
        let again = loss.forward_backward_marked(marks, &other, &y, lambda);
        assert_eq!((again.0, again.1), (found, &gradient[..]));
    }

    #[test]
    fn an_empty_mask_has_no_loss() {
        let mut loss = Loss::new(12, 6, Columns::Wrap);
        let (x, y) = (vec![0.1; 216], vec![0.7; 216]);
        let (value, gradient) = loss.masked_forward_backward(&x, &y, &[0.0; 72], 0.2);
        assert_eq!(value.total, 0.0);
        assert!(gradient.iter().all(|&g| g == 0.0));
    }

    #[test]
    fn equal_images_have_no_loss() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let x = random_image(&mut rng, 12 * 6 * 3);
        let value = Loss::new(12, 6, Columns::Wrap).value(&x, &x, 0.2);
        assert!(
            value.total.abs() < 1e-6 && value.psnr() == 100.0,
            "{value:?}"
        );
    }
}
