//! Means of the curves of several results.

use std::collections::BTreeMap;

use omnilife_results::CurvePoint;

/// A point of a mean curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeanPoint {
    /// Mean wall-clock time of the training steps so far.
    pub(super) seconds: f64,
    pub(super) iteration: u64,
    pub(super) psnr_db: f64,
}

/// Returns the mean at the common iterations of all curves after time 0, which a logarithmic axis cannot show; nothing
/// unless all have points.
pub(super) fn mean(curves: &[&[CurvePoint]]) -> Vec<MeanPoint> {
    let mut sums: BTreeMap<u64, (usize, f64, f64)> = BTreeMap::new();
    let timed = |point: &&CurvePoint| point.seconds > 0.0;
    for point in curves.iter().copied().flatten().filter(timed) {
        let (count, seconds, psnr_db) = sums.entry(point.iteration).or_default();
        *count += 1;
        *seconds += point.seconds;
        *psnr_db += point.psnr_db;
    }
    let number = curves.len();
    (sums.into_iter())
        .filter(|(_, (count, ..))| *count == number)
        .map(|(iteration, (_, seconds, psnr_db))| MeanPoint {
            seconds: seconds / number as f64,
            iteration,
            psnr_db: psnr_db / number as f64,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_averaged_where_all_have_a_score() {
        let point = |seconds, iteration, psnr_db| CurvePoint {
            seconds,
            iteration,
            psnr_db,
            cpu_seconds: None,
            primitives: None,
            ssim: None,
            lpips_alex: None,
            psnr_static_db: None,
            psnr_dynamic_db: None,
        };
        let first = [
            point(0.0, 0, 11.0),
            point(1.0, 10, 20.0),
            point(4.0, 30, 23.0),
        ];
        let second = [
            point(0.0, 0, 12.0),
            point(3.0, 10, 22.0),
            point(5.0, 20, 22.5),
        ];
        let expected = MeanPoint {
            seconds: 2.0,
            iteration: 10,
            psnr_db: 21.0,
        };
        assert_eq!(mean(&[&first, &second]), [expected]);
        assert_eq!(mean(&[&first, &[]]), []);
    }
}
