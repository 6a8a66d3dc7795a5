//! The loss and its gradient as plain f64 loops over the definition: the reference for the fast kernels.

use super::{
    Columns, LossValue,
    cpu::SIGMA,
    rows::{C1, C2, RADIUS},
};

/// Two images of `width` x `height` pixels, HWC, with a weight per pixel.
#[derive(Debug, Clone, Copy)]
pub struct ReferencePair<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Neighbours of the first and the last column.
    pub columns: Columns,
    /// The differentiated image.
    pub render: &'a [f64],
    /// The image to compare with.
    pub target: &'a [f64],
    /// Weights of the pixels.
    pub mask: &'a [f64],
}

impl ReferencePair<'_> {
    /// Returns the loss and its gradient by the render.
    pub fn value_and_gradient(&self, lambda: f64) -> (LossValue, Vec<f64>) {
        let weights = 3.0 * self.mask.iter().sum::<f64>();
        let mut gradient = vec![0.0; self.render.len()];
        let mut sums = LossValue::default();
        for (index, (&x, &y)) in self.render.iter().zip(self.target).enumerate() {
            let weight = self.mask[index / 3] / weights;
            let difference = x - y;
            sums.l1 += weight * difference.abs();
            sums.mse += weight * difference * difference;
            let sign = if difference == 0.0 {
                0.0
            } else {
                difference.signum()
            };
            gradient[index] += (1.0 - lambda) * weight * sign;
            sums.ssim += weight * self.similarity(index, -lambda * weight, &mut gradient);
        }
        sums.total = (1.0 - lambda) * sums.l1 + lambda * (1.0 - sums.ssim);
        (sums, gradient)
    }

    /// Returns SSIM of the window around a value; adds `upstream` times its gradient.
    fn similarity(&self, index: usize, upstream: f64, gradient: &mut [f64]) -> f64 {
        let [mut mx, mut my, mut xx, mut yy, mut xy] = [0.0; 5];
        for (at, weight) in self.window(index) {
            let (x, y) = (self.render[at], self.target[at]);
            mx += weight * x;
            my += weight * y;
            xx += weight * x * x;
            yy += weight * y * y;
            xy += weight * x * y;
        }
        let (c1, c2) = (f64::from(C1), f64::from(C2));
        let (a1, a2) = (2.0 * mx * my + c1, 2.0 * (xy - mx * my) + c2);
        let (b1, b2) = (mx * mx + my * my + c1, xx - mx * mx + yy - my * my + c2);
        let similarity = a1 * a2 / (b1 * b2);
        let by_xx = -similarity / b2;
        let by_xy = 2.0 * a1 / (b1 * b2);
        let by_mx =
            2.0 * my * a2 / (b1 * b2) - 2.0 * mx * similarity / b1 - 2.0 * mx * by_xx - my * by_xy;
        for (at, weight) in self.window(index) {
            let by_value = by_mx + 2.0 * self.render[at] * by_xx + self.target[at] * by_xy;
            gradient[at] += upstream * weight * by_value;
        }
        similarity
    }

    /// Returns the values around one of the same channel, with their weights; zeros outside the image, except
    /// where columns wrap.
    fn window(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let radius = RADIUS as isize;
        let weight = |offset: isize| (-(offset as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
        let total: f64 = (-radius..=radius).map(weight).sum();
        let (width, height) = (self.width as isize, self.height as isize);
        let (pixel, channel) = ((index / 3) as isize, index % 3);
        let (row, column) = (pixel / width, pixel % width);
        let rows = (-radius..=radius).filter(move |down| (0..height).contains(&(row + down)));
        rows.flat_map(move |down| {
            (-radius..=radius).filter_map(move |right| {
                let beside = match self.columns {
                    Columns::Wrap => (column + right).rem_euclid(width),
                    Columns::End => column + right,
                };
                (0..width).contains(&beside).then(|| {
                    let at = 3 * ((row + down) * width + beside) as usize + channel;
                    (at, weight(down) * weight(right) / (total * total))
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn the_gradient_is_that_of_central_differences() {
        for columns in [Columns::Wrap, Columns::End] {
            check_by_differences(columns);
        }
    }

    fn check_by_differences(columns: Columns) {
        let (width, height) = (9, 6);
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let mut image = || -> Vec<f64> {
            (0..3 * width * height)
                .map(|_| random.random_range(0.0..1.0))
                .collect()
        };
        let (render, target) = (image(), image());
        let mask: Vec<f64> = (0..width * height)
            .map(|pixel| [0.0, 0.3, 1.0][pixel % 3])
            .collect();
        let value = |render: &[f64]| {
            let pair = ReferencePair {
                width,
                height,
                columns,
                render,
                target: &target,
                mask: &mask,
            };
            pair.value_and_gradient(0.4)
        };
        let gradient = value(&render).1;
        let h = 1e-6;
        for index in 0..render.len() {
            let shifted = |step: f64| {
                let mut shifted = render.clone();
                shifted[index] += step;
                value(&shifted).0.total
            };
            let expected = (shifted(h) - shifted(-h)) / (2.0 * h);
            let error = (gradient[index] - expected).abs();
            assert!(error < 1e-8, "{index}: {} {expected}", gradient[index]);
        }
    }
}
