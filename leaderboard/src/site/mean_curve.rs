//! Means of the curves of several results.

use omnilife_results::CurvePoint;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeanPoint {
    /// Mean wall-clock time of the training steps so far.
    pub(super) seconds: f64,
    pub(super) iteration: u64,
    pub(super) psnr_db: f64,
}

/// Returns the mean at the iterations of the first curve, from the latest first row of all curves to the latest end;
/// nothing unless all have points. Rows at time 0 have no place on a logarithmic axis.
///
/// Rows of a trace are at times, not at iterations: between two rows of a curve, steps take equally long, and quality
/// is linear in the logarithm of time. After its end a curve keeps its last value.
///
/// Curves count by their weights.
pub(super) fn mean(curves: &[(f64, &[CurvePoint])]) -> Vec<MeanPoint> {
    let timed: Vec<Vec<MeanPoint>> = curves.iter().map(|(_, curve)| timed(curve)).collect();
    let begins: Option<Vec<u64>> = (timed.iter())
        .map(|curve| Some(curve.first()?.iteration))
        .collect();
    let begin = begins.and_then(|begins| begins.into_iter().max());
    let ends = timed.iter().filter_map(|curve| curve.last());
    let end = ends.map(|point| point.iteration).max();
    let (Some(first), Some(begin), Some(end)) = (timed.first(), begin, end) else {
        return Vec::new();
    };
    let rows = first.iter().map(|point| point.iteration);
    let iterations = rows.filter(|&iteration| begin <= iteration && iteration < end);
    let all: f64 = curves.iter().map(|(weight, _)| weight).sum();
    iterations
        .chain([end])
        .filter_map(|iteration| {
            let points = timed.iter().map(|curve| at(curve, iteration));
            let points: Vec<MeanPoint> = points.collect::<Option<_>>()?;
            let mean = |value: fn(&MeanPoint) -> f64| {
                let weighted = points.iter().zip(curves);
                weighted
                    .map(|(point, (weight, _))| weight * value(point))
                    .sum::<f64>()
                    / all
            };
            Some(MeanPoint {
                seconds: mean(|point| point.seconds),
                iteration,
                psnr_db: mean(|point| point.psnr_db),
            })
        })
        .collect()
}

/// Returns the rows after time 0, one per iteration and in order, which a file need not have.
fn timed(curve: &[CurvePoint]) -> Vec<MeanPoint> {
    let rows = curve.iter().filter(|point| point.seconds > 0.0);
    let mut rows: Vec<MeanPoint> = rows
        .map(|point| MeanPoint {
            seconds: point.seconds,
            iteration: point.iteration,
            psnr_db: point.psnr_db,
        })
        .collect();
    rows.sort_by_key(|point| point.iteration);
    rows.dedup_by_key(|point| point.iteration);
    rows
}

/// Returns a curve at an iteration from its first row on.
fn at(curve: &[MeanPoint], iteration: u64) -> Option<MeanPoint> {
    let after = curve.partition_point(|point| point.iteration <= iteration);
    let before = curve.get(after.checked_sub(1)?)?;
    let Some(next) = curve.get(after) else {
        return Some(*before);
    };
    let share = (iteration - before.iteration) as f64 / (next.iteration - before.iteration) as f64;
    let seconds = before.seconds + share * (next.seconds - before.seconds);
    let of_time = if next.seconds > before.seconds {
        (seconds / before.seconds).ln() / (next.seconds / before.seconds).ln()
    } else {
        share
    };
    Some(MeanPoint {
        seconds,
        iteration,
        psnr_db: before.psnr_db + of_time * (next.psnr_db - before.psnr_db),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(seconds: f64, iteration: u64, psnr_db: f64) -> CurvePoint {
        CurvePoint {
            seconds,
            iteration,
            psnr_db,
            cpu_seconds: None,
            primitives: None,
            novel_views: None,
            ssim: None,
            lpips_alex: None,
            psnr_static_db: None,
            psnr_dynamic_db: None,
        }
    }

    fn mean(curves: &[&[CurvePoint]]) -> Vec<MeanPoint> {
        let equal: Vec<(f64, &[CurvePoint])> = curves.iter().map(|&curve| (0.5, curve)).collect();
        super::mean(&equal)
    }

    /// Two seeds of one scene and one of another.
    #[test]
    fn curves_count_by_their_weights() {
        let curves = [20.0, 22.0, 27.0].map(|psnr_db| [point(1.0, 10, psnr_db)]);
        let weighted = [(0.5, &curves[0][..]), (0.5, &curves[1]), (1.0, &curves[2])];
        let found = super::mean(&weighted);
        assert_eq!(found[0].psnr_db, 24.0);
    }

    #[test]
    fn curves_are_averaged_at_equal_iterations() {
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
        let mean_point = |seconds, iteration, psnr_db| MeanPoint {
            seconds,
            iteration,
            psnr_db,
        };
        // The second ends earlier, and keeps its last value.
        let expected = [mean_point(2.0, 10, 21.0), mean_point(4.5, 30, 22.75)];
        assert_eq!(mean(&[&first, &second]), expected);
        assert_eq!(mean(&[&first, &[]]), []);
        assert_eq!(mean(&[]), []);
        let alone = [mean_point(1.0, 10, 20.0), mean_point(4.0, 30, 23.0)];
        assert_eq!(mean(&[&first]), alone);
        let [start, middle, last] = first;
        assert_eq!(mean(&[&[last, middle, start, last]]), alone);
    }

    #[test]
    fn rows_at_other_iterations_are_met_between_rows() {
        let first = [
            point(1.0, 5, 20.0),
            point(2.0, 20, 21.0),
            point(8.0, 80, 24.0),
        ];
        let second = [point(1.0, 10, 20.0), point(16.0, 85, 28.0)];
        let found = mean(&[&first, &second]);
        let iterations: Vec<u64> = found.iter().map(|point| point.iteration).collect();
        assert_eq!(iterations, [20, 80, 85]);
        // After 10 of 75 steps, 2 of 15 s.
        let of_second = 20.0 + 8.0 * 3_f64.ln() / 16_f64.ln();
        assert!((found[0].seconds - 2.5).abs() < 1e-9);
        assert!((found[0].psnr_db - 0.5 * (21.0 + of_second)).abs() < 1e-9);
        assert!((found[2].psnr_db - 26.0).abs() < 1e-9);
    }
}
