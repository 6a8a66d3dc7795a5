//! The loss on the processor: separable windows over interleaved rows.

use rayon::prelude::*;

use super::LossValue;

const WINDOW: usize = 11;
const RADIUS: usize = WINDOW / 2;
const SIGMA: f64 = 1.5;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// Working memory for one image size, reused over iterations.
#[derive(Debug)]
pub struct Loss {
    width: usize,
    height: usize,
    window: [f32; WINDOW],
    /// Blurred x, y, x^2, y^2, xy; the first three become ds/dmx, ds/dE[x^2], ds/dE[xy].
    moments: [Vec<f32>; 5],
    product: Vec<f32>,
    scratch: Vec<f32>,
    gradient: Vec<f32>,
}

impl Loss {
    /// For images of `width` x `height`.
    pub fn new(width: usize, height: usize) -> Self {
        let len = width * height * 3;
        Self {
            width,
            height,
            window: gaussian_window(),
            moments: std::array::from_fn(|_| vec![0.0; len]),
            product: vec![0.0; len],
            scratch: vec![0.0; len],
            gradient: vec![0.0; len],
        }
    }

    /// Value of the loss and its gradient by `render`; both images are HWC.
    pub fn forward_backward(
        &mut self,
        render: &[f32],
        target: &[f32],
        lambda: f32,
    ) -> (LossValue, &[f32]) {
        let ssim = self.ssim_derivatives(render, target);
        let len = render.len();
        // Minus: the loss holds 1 - SSIM.
        let weight_ssim = -lambda / len as f32;
        let weight_l1 = (1.0 - lambda) / len as f32;
        // The derivatives are blurred back to the pixels they came from.
        for index in 0..3 {
            let derivative = &mut self.moments[index];
            blur(
                &self.window,
                self.width,
                derivative,
                &mut self.scratch,
                &mut self.product,
            );
            derivative.copy_from_slice(&self.product);
        }
        let [by_mean, by_square, by_product, ..] = &self.moments;
        self.gradient
            .par_iter_mut()
            .zip(render.par_iter().zip(target))
            .zip(by_mean.par_iter().zip(by_square.par_iter().zip(by_product)))
            .with_min_len(1 << 14)
            .for_each(|((gradient, (x, y)), (by_mean, (by_square, by_product)))| {
                let difference = x - y;
                let sign = if difference > 0.0 {
                    1.0
                } else if difference < 0.0 {
                    -1.0
                } else {
                    0.0
                };
                *gradient = weight_l1 * sign
                    + weight_ssim * (by_mean + 2.0 * x * by_square + y * by_product);
            });
        let mut value = pixel_errors(self.width, render, target);
        value.ssim = ssim;
        value.total = (1.0 - f64::from(lambda)) * value.l1 + f64::from(lambda) * (1.0 - value.ssim);
        (value, &self.gradient)
    }

    /// Value of the loss alone.
    pub fn value(&mut self, render: &[f32], target: &[f32], lambda: f32) -> LossValue {
        let mut value = pixel_errors(self.width, render, target);
        value.ssim = self.ssim_derivatives(render, target);
        value.total = (1.0 - f64::from(lambda)) * value.l1 + f64::from(lambda) * (1.0 - value.ssim);
        value
    }

    /// Mean SSIM; leaves the map's derivatives in the first three moments.
    fn ssim_derivatives(&mut self, render: &[f32], target: &[f32]) -> f64 {
        assert_eq!(render.len(), self.width * self.height * 3, "image size");
        assert_eq!(target.len(), render.len(), "image size");
        for (index, moment) in self.moments.iter_mut().enumerate() {
            self.product
                .par_iter_mut()
                .zip(render.par_iter().zip(target))
                .with_min_len(1 << 14)
                .for_each(|(product, (&x, &y))| {
                    *product = match index {
                        0 => x,
                        1 => y,
                        2 => x * x,
                        3 => y * y,
                        _ => x * y,
                    };
                });
            blur(
                &self.window,
                self.width,
                &self.product,
                &mut self.scratch,
                moment,
            );
        }
        let row = self.width * 3;
        let [mx, my, xx, yy, xy] = &mut self.moments;
        // One sum per row, added up in order: the same on any number of threads.
        let sums: Vec<f64> = (
            mx.par_chunks_mut(row),
            my.par_chunks_mut(row),
            xx.par_chunks_mut(row),
            yy.par_chunks_mut(row),
            xy.par_chunks_mut(row),
        )
            .into_par_iter()
            .map(|(mx, my, xx, yy, xy)| {
                let mut sum = 0.0;
                for i in 0..row {
                    let (x, y) = (mx[i], my[i]);
                    let a1 = 2.0 * x * y + C1;
                    let a2 = 2.0 * (xy[i] - x * y) + C2;
                    let b1 = x * x + y * y + C1;
                    let b2 = (xx[i] - x * x) + (yy[i] - y * y) + C2;
                    let s = a1 * a2 / (b1 * b2);
                    sum += f64::from(s);
                    let by_square = -s / b2;
                    let by_product = 2.0 * a1 / (b1 * b2);
                    mx[i] = 2.0 * y * a2 / (b1 * b2)
                        - 2.0 * x * s / b1
                        - 2.0 * x * by_square
                        - y * by_product;
                    my[i] = by_square;
                    xx[i] = by_product;
                }
                sum
            })
            .collect();
        sums.iter().sum::<f64>() / render.len() as f64
    }
}

fn pixel_errors(width: usize, render: &[f32], target: &[f32]) -> LossValue {
    let rows: Vec<(f64, f64)> = render
        .par_chunks(width * 3)
        .zip(target.par_chunks(width * 3))
        .map(|(render, target)| {
            render
                .iter()
                .zip(target)
                .fold((0.0, 0.0), |(l1, l2), (x, y)| {
                    let difference = f64::from(x - y);
                    (l1 + difference.abs(), l2 + difference * difference)
                })
        })
        .collect();
    let len = render.len() as f64;
    LossValue {
        l1: rows.iter().map(|row| row.0).sum::<f64>() / len,
        mse: rows.iter().map(|row| row.1).sum::<f64>() / len,
        ..LossValue::default()
    }
}

fn gaussian_window() -> [f32; WINDOW] {
    let value = |index: usize| {
        let distance = index as f64 - RADIUS as f64;
        (-distance * distance / (2.0 * SIGMA * SIGMA)).exp()
    };
    let total: f64 = (0..WINDOW).map(value).sum();
    std::array::from_fn(|index| (value(index) / total) as f32)
}

/// Blurs an HWC image: columns wrap, rows are padded with zeros.
fn blur(window: &[f32; WINDOW], width: usize, image: &[f32], scratch: &mut [f32], out: &mut [f32]) {
    let row = width * 3;
    scratch
        .par_chunks_mut(row)
        .zip(image.par_chunks(row))
        .with_min_len(8)
        .for_each_init(
            || vec![0.0; row + 2 * RADIUS * 3],
            |padded, (out, image)| {
                wrap_row(width, image, padded);
                accumulate(window, |tap| &padded[tap * 3..tap * 3 + row], out);
            },
        );
    let height = image.len() / row;
    let zeros = vec![0.0; row];
    let scratch = &*scratch;
    out.par_chunks_mut(row)
        .enumerate()
        .with_min_len(8)
        .for_each(|(y, out)| {
            accumulate(
                window,
                |tap| {
                    // Row y + tap - RADIUS, where it exists.
                    match (y + tap).checked_sub(RADIUS) {
                        Some(source) if source < height => {
                            &scratch[source * row..(source + 1) * row]
                        }
                        _ => &zeros,
                    }
                },
                out,
            );
        });
}

/// Copies a row with [`RADIUS`] wrapped pixels on either side.
fn wrap_row(width: usize, row: &[f32], padded: &mut [f32]) {
    for position in 0..RADIUS {
        let left = (width * RADIUS + position - RADIUS) % width;
        let right = position % width;
        for channel in 0..3 {
            padded[position * 3 + channel] = row[left * 3 + channel];
            padded[(RADIUS + width + position) * 3 + channel] = row[right * 3 + channel];
        }
    }
    padded[RADIUS * 3..RADIUS * 3 + row.len()].copy_from_slice(row);
}

/// `out = sum over taps of window[tap] * source(tap)`.
fn accumulate<'a>(window: &[f32; WINDOW], source: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
    let taps: [&[f32]; WINDOW] = std::array::from_fn(source);
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        unsafe { accumulate_avx2(window, &taps, out) };
        return;
    }
    accumulate_generic(window, &taps, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn accumulate_avx2(window: &[f32; WINDOW], taps: &[&[f32]; WINDOW], out: &mut [f32]) {
    accumulate_generic(window, taps, out);
}

#[inline(always)]
fn accumulate_generic(window: &[f32; WINDOW], taps: &[&[f32]; WINDOW], out: &mut [f32]) {
    const BLOCK: usize = 32;
    let len = out.len();
    for begin in (0..len).step_by(BLOCK) {
        let end = (begin + BLOCK).min(len);
        let mut sums = [0.0_f32; BLOCK];
        for (weight, tap) in window.iter().zip(taps) {
            for (sum, value) in sums.iter_mut().zip(&tap[begin..end]) {
                *sum += weight * value;
            }
        }
        out[begin..end].copy_from_slice(&sums[..end - begin]);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// The loss as plain f64 loops over the definition.
    fn reference(width: usize, height: usize, x: &[f64], y: &[f64], lambda: f64) -> f64 {
        let weight = |offset: isize| (-(offset as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
        let total: f64 = (-5..=5).map(weight).sum();
        let mut ssim = 0.0;
        for row in 0..height as isize {
            for column in 0..width as isize {
                for channel in 0..3 {
                    let mut m = [0.0; 5];
                    for dy in -5..=5_isize {
                        for dx in -5..=5_isize {
                            if row + dy < 0 || row + dy >= height as isize {
                                continue;
                            }
                            let wrapped = (column + dx).rem_euclid(width as isize);
                            let index =
                                ((row + dy) as usize * width + wrapped as usize) * 3 + channel;
                            let w = weight(dx) * weight(dy) / (total * total);
                            let (a, b) = (x[index], y[index]);
                            for (moment, value) in m.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                                *moment += w * value;
                            }
                        }
                    }
                    let [mx, my, xx, yy, xy] = m;
                    let (c1, c2) = (f64::from(C1), f64::from(C2));
                    ssim += (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
                        / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
                }
            }
        }
        let l1: f64 = x.iter().zip(y).map(|(a, b)| (a - b).abs()).sum();
        let len = x.len() as f64;
        (1.0 - lambda) * l1 / len + lambda * (1.0 - ssim / len)
    }

    fn random_image(rng: &mut Pcg64Mcg, len: usize) -> Vec<f32> {
        (0..len).map(|_| rng.random_range(0.0..1.0)).collect()
    }

    fn widen(image: &[f32]) -> Vec<f64> {
        image.iter().copied().map(f64::from).collect()
    }

    #[test]
    fn value_is_that_of_the_reference() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for (width, height) in [(16, 8), (17, 9), (4, 2)] {
            let (x, y) = (
                random_image(&mut rng, width * height * 3),
                random_image(&mut rng, width * height * 3),
            );
            let value = Loss::new(width, height).value(&x, &y, 0.2);
            let expected = reference(width, height, &widen(&x), &widen(&y), 0.2);
            assert!(
                (value.total - expected).abs() < 1e-6,
                "{value:?} {expected}"
            );
        }
    }

    #[test]
    fn gradient_is_that_of_the_reference() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let (width, height, lambda) = (14, 7, 0.4);
        let (x, y) = (
            random_image(&mut rng, width * height * 3),
            random_image(&mut rng, width * height * 3),
        );
        let mut loss = Loss::new(width, height);
        let (_, gradient) = loss.forward_backward(&x, &y, lambda);
        let (x, y) = (widen(&x), widen(&y));
        let largest = gradient.iter().fold(0.0_f32, |m, g| m.max(g.abs()));
        for index in (0..x.len()).step_by(5) {
            let h = 1e-6;
            let shifted = |step: f64| {
                let mut shifted = x.clone();
                shifted[index] += step;
                reference(width, height, &shifted, &y, f64::from(lambda))
            };
            let expected = (shifted(h) - shifted(-h)) / (2.0 * h);
            let error = (f64::from(gradient[index]) - expected).abs();
            assert!(
                error < 1e-3 * f64::from(largest),
                "{index}: {} {expected}",
                gradient[index]
            );
        }
    }

    #[test]
    fn equal_images_have_no_loss() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let x = random_image(&mut rng, 12 * 6 * 3);
        let value = Loss::new(12, 6).value(&x, &x, 0.2);
        assert!(
            value.total.abs() < 1e-6 && value.psnr() == 100.0,
            "{value:?}"
        );
    }
}
