//! PSNR and SSIM of single objects: in the box of an object's mask, unchanged or with everything outside of the mask
//! black.

use omnilife_schemas::{records::Direction, rgb::Mask};

use super::{Metric, Need, Sample, Undefined, decibels, ssim_uniform};

const NEEDS: &[Need] = &[Need::ObjectMasks];

pub(super) const PSNR: Metric = Metric {
    id: "psnr-object",
    title: "PSNR (objects)",
    unit: "dB",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 100.0],
    source: "-10 log10(MSE) over the tight box of an object's mask, 8-bit images in [0, 1], MSE floored at \
             1e-10; mean over the objects of a view (Neural Atlas Graphs scripts/eval_metrics.py); \
             undefined where no object is seen",
    needs: NEEDS,
    function: |sample| mean(sample, |crop| Some(crop.psnr()), false),
};
pub(super) const PSNR_MASKED: Metric = Metric {
    id: "psnr-object-masked",
    title: "PSNR (objects, masked)",
    source: "as psnr-object, with everything outside of the mask black in both images: the black rest \
             counts as right (Neural Atlas Graphs scripts/eval_metrics.py, _only_mask)",
    function: |sample| mean(sample, |crop| Some(crop.psnr()), true),
    ..PSNR
};
pub(super) const SSIM: Metric = Metric {
    id: "ssim-object",
    title: "SSIM (objects)",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "ssim-skimage-uniform of the tight box of an object's mask; mean over the objects of a view \
             whose box is at least 7x7 pixels (Neural Atlas Graphs scripts/eval_metrics.py); undefined \
             where there is none",
    needs: NEEDS,
    function: |sample| mean(sample, Crop::ssim, false),
};
pub(super) const SSIM_MASKED: Metric = Metric {
    id: "ssim-object-masked",
    title: "SSIM (objects, masked)",
    source: "as ssim-object, with everything outside of the mask black in both images (Neural Atlas Graphs \
             scripts/eval_metrics.py, _only_mask)",
    function: |sample| mean(sample, Crop::ssim, true),
    ..SSIM
};

/// Returns the first column and the number of columns of the shortest span with all marked ones; that of a panorama may
/// go around the seam. `None` without any.
fn span_of(columns: &[bool], is_panorama: bool) -> Option<(usize, usize)> {
    let width = columns.len();
    let marked: Vec<usize> = (0..width).filter(|&column| columns[column]).collect();
    let (&first, &last) = (marked.first()?, marked.last()?);
    let mut span = (first, last + 1 - first);
    if is_panorama {
        // The rest of a turn after the widest gap between neighbours.
        for pair in marked.windows(2) {
            let across = width + pair[0] + 1 - pair[1];
            if across < span.1 {
                span = (pair[1], across);
            }
        }
    }
    Some(span)
}

/// Both images in the box of a mask, in [0, 1].
struct Crop {
    size: [usize; 2],
    prediction: Vec<f64>,
    truth: Vec<f64>,
    /// Pixels that count.
    counted: Vec<bool>,
}

impl Crop {
    /// Returns `None` for a mask without any pixel that counts.
    fn of(sample: &Sample<'_>, mask: &Mask, is_masked: bool) -> Option<Self> {
        let [width, _] = sample.pair.size();
        let inside = |at: &usize| mask.data[*at] != 0 && sample.pair.counts(*at);
        let pixels: Vec<usize> = (0..mask.data.len()).filter(inside).collect();
        let mut columns = vec![false; width];
        for pixel in &pixels {
            columns[pixel % width] = true;
        }
        let (left, across) = span_of(&columns, sample.is_panorama)?;
        let (top, bottom) = (pixels.first()? / width, pixels.last()? / width);
        let places = (top..=bottom)
            .flat_map(|row| (left..left + across).map(move |column| row * width + column % width));
        let read = |image: &[u8]| -> Vec<f64> {
            places
                .clone()
                .flat_map(|at| {
                    let is_shown = !is_masked || inside(&at);
                    let factor = if is_shown { 1.0 / 255.0 } else { 0.0 };
                    [0, 1, 2].map(|channel| factor * f64::from(image[3 * at + channel]))
                })
                .collect()
        };
        let counted = places.clone().map(|at| sample.pair.counts(at));
        Some(Self {
            counted: counted.collect(),
            size: [across, bottom + 1 - top],
            prediction: read(sample.pair.prediction()),
            truth: read(sample.pair.truth()),
        })
    }

    fn psnr(&self) -> f64 {
        let errors = self.prediction.iter().zip(&self.truth).enumerate();
        let counted = errors.filter(|&(value, _)| self.counted[value / 3]);
        let sum: f64 = counted.map(|(_, (a, b))| (a - b) * (a - b)).sum();
        let pixels = self
            .counted
            .iter()
            .filter(|&&is_counted| is_counted)
            .count();
        decibels(sum / (3 * pixels) as f64)
    }

    fn ssim(&self) -> Option<f64> {
        ssim_uniform::of_images(
            [&self.prediction, &self.truth],
            self.size,
            Some(&self.counted),
        )
    }
}

/// Returns the mean over the objects of a view with a defined score.
fn mean(
    sample: &Sample<'_>,
    score: impl Fn(&Crop) -> Option<f64>,
    is_masked: bool,
) -> Result<f64, Undefined> {
    let crops = sample
        .objects
        .values()
        .filter_map(|mask| Crop::of(sample, mask, is_masked));
    let scores: Vec<f64> = crops.filter_map(|crop| score(&crop)).collect();
    if scores.is_empty() {
        return Err(Undefined("no object that is large enough is seen"));
    }
    Ok(scores.iter().sum::<f64>() / scores.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_of_panoramas_are_the_shortest_around_the_seam() {
        let columns = |marked: &[usize]| -> Vec<bool> {
            (0..10).map(|column| marked.contains(&column)).collect()
        };
        for (marked, flat, around) in [
            (&[][..], None, None),
            (&[4], Some((4, 1)), Some((4, 1))),
            (&[2, 3, 5], Some((2, 4)), Some((2, 4))),
            (&[0, 1, 8, 9], Some((0, 10)), Some((8, 4))),
            (&[0, 9], Some((0, 10)), Some((9, 2))),
        ] {
            assert_eq!(span_of(&columns(marked), false), flat, "{marked:?}");
            assert_eq!(span_of(&columns(marked), true), around, "{marked:?}");
        }
        let all = vec![true; 10];
        assert_eq!(span_of(&all, true), Some((0, 10)));
    }
}
