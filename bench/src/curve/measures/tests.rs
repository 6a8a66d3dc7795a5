use proptest::prelude::*;

use super::*;
use crate::curve::{Clock, FinalScores, Region, TraceRow, other_views};

fn run(points: &[(f64, f64)], memory: u64) -> TracedRun {
    let row = |&(seconds, psnr_db): &(f64, f64)| TraceRow {
        seconds,
        evaluation_seconds: 0.0,
        iteration: (10.0 * seconds) as u64,
        primitives: 5,
        psnr_db,
        input_psnr_db: None,
        objects: None,
        ssim: None,
        lpips_alex: None,
        ghost_share: None,
        input_hole_share: None,
        novel_hole_share: None,
    };
    let (seconds, psnr_db) = points.last().copied().unwrap_or((7.0, 25.0));
    TracedRun {
        folder: "score".into(),
        clock: Clock::Wall,
        region: Region::Whole,
        method: "m".to_owned(),
        scene: "s".to_owned(),
        scene_sha256: String::new(),
        novel_views: 1,
        protocol_hash: "h".to_owned(),
        seed: 0,
        preparation_seconds: None,
        training_seconds: Some(seconds),
        evaluation_seconds: 1.0,
        iterations: Some(100),
        primitives: Some(5),
        peak_memory_bytes: Some(memory),
        final_scores: FinalScores {
            psnr_db,
            ssim: None,
            lpips_alex: None,
        },
        rows: points.iter().map(row).collect(),
    }
}

fn sampled(times: &[f64], quality: impl Fn(f64) -> f64) -> TracedRun {
    let points: Vec<(f64, f64)> = times.iter().map(|&time| (time, quality(time))).collect();
    run(&points, 1)
}

fn span(from_seconds: f64, until_seconds: f64) -> Span {
    Span {
        from_seconds,
        until_seconds,
    }
}

#[test]
fn runs_of_one_scene_have_names_of_their_own() {
    let plain = run(&[(1.0, 20.0)], 1);
    let with = |seed: u64, iterations: u64, folder: &str| TracedRun {
        seed,
        iterations: Some(iterations),
        folder: folder.into(),
        ..plain.clone()
    };
    let runs = [
        with(0, 100, "a"),
        with(1, 100, "b"),
        with(1, 300, "c"),
        with(1, 300, "d"),
    ];
    let names = crate::curve::trace::names(&runs.each_ref());
    let expected = [
        "m, seed 0",
        "m, seed 1, 100 iterations",
        "m, seed 1, 300 iterations (c)",
        "m, seed 1, 300 iterations (d)",
    ];
    assert_eq!(names, expected);
}

#[test]
fn a_curve_over_log_time_is_measured_the_same_at_any_spacing() {
    let (begin_db, per_fold) = (17.5, 1.75);
    let quality = |seconds: f64| begin_db + per_fold * seconds.ln();
    let equal_ratios: Vec<f64> = (0..=20)
        .map(|k| 300_f64.powf(f64::from(k) / 20.0))
        .collect();
    let equal_steps: Vec<f64> = (0..=12).map(|k| 8.0 + 24.5 * f64::from(k)).collect();
    let uneven = vec![0.3, 0.31, 5.0, 9.0, 200.0, 201.0, 302.0];
    let ends = vec![4.0, 301.0];
    // The mean of the logarithm between 10 and 250 is that of its ends.
    let mean_db = begin_db + per_fold * 0.5 * (10_f64.ln() + 250_f64.ln());
    let to_26 = ((26.0 - begin_db) / per_fold).exp();
    for times in [equal_ratios, equal_steps, uneven, ends] {
        let curve = curve_of(&sampled(&times, quality), Some(span(10.0, 250.0)));
        assert!(
            (curve.log_area_db.unwrap_or(0.0) - mean_db).abs() < 1e-3,
            "{times:?}"
        );
        let Crossing::At { seconds, iteration } = curve.to_quality[3] else {
            panic!("{:?}", curve.to_quality);
        };
        assert!((seconds - to_26).abs() < 1e-3 * to_26, "{times:?}");
        // Ten iterations a second.
        let iteration = iteration.unwrap_or(0) as f64;
        assert!((iteration - 10.0 * to_26).abs() < 20.0, "{iteration}");
        let at_60 = curve.at_moment[1].unwrap_or(0.0);
        assert!((at_60 - quality(60.0)).abs() < 1e-3, "{times:?}");
    }
}

#[test]
fn a_quality_has_a_time_only_where_it_is_crossed() {
    let curve = curve_of(&run(&[(5.0, 23.0), (20.0, 22.5), (80.0, 27.0)], 1), None);
    let of_20_to_30 = &curve.to_quality;
    // Reached from the first row on, though the second one is below.
    assert_eq!(of_20_to_30[0], Crossing::AtMost { seconds: 5.0 });
    assert_eq!(of_20_to_30[1], Crossing::AtMost { seconds: 5.0 });
    // At a third of the interval, in equal ratios.
    let expected = 20.0 * 4_f64.powf(1.5 / 4.5);
    assert!((of_20_to_30[2].seconds().unwrap_or(0.0) - expected).abs() < 1e-9);
    assert_eq!(of_20_to_30[4..], [Crossing::Never; 2]);
    assert_eq!(curve.log_area_db, None);
    assert_eq!(curve.at_moment[2..], [Some(27.0); 3]);
    let late = curve_of(&run(&[(11.0, 20.0), (80.0, 27.0)], 1), None);
    assert_eq!(late.at_moment[0], None);
}

#[test]
fn nearness_to_the_end_is_in_decibels_of_its_own_end() {
    let curve = curve_of(&run(&[(2.0, 20.0), (32.0, 28.0), (64.0, 28.0)], 1), None);
    let [one, half] = [0, 1].map(|below: usize| curve.to_own_end[below].seconds().unwrap_or(0.0));
    // A decibel is an eighth of four octaves.
    assert!((one - 2.0 * 3.5_f64.exp2()).abs() < 1e-9, "{one}");
    assert!((half - 2.0 * 3.75_f64.exp2()).abs() < 1e-9, "{half}");
    let level = curve_of(&run(&[(2.0, 27.8), (32.0, 28.0)], 1), None);
    assert_eq!(level.to_own_end, [Crossing::AtMost { seconds: 2.0 }; 2]);
}

#[test]
fn other_scores_have_means_over_log_time_where_all_rows_have_them() {
    let mut scored = run(&[(1.0, 20.0), (10.0, 24.0), (100.0, 25.0)], 1);
    for (row, lpips) in scored.rows.iter_mut().zip([0.5, 0.3, 0.2]) {
        row.ssim = Some(0.75);
        row.lpips_alex = Some(lpips);
    }
    let curve = curve_of(&scored, Some(span(1.0, 100.0)));
    assert!((curve.log_area_ssim.unwrap_or(0.0) - 0.75).abs() < 1e-9);
    let lpips = 0.5 * (0.4 + 0.25);
    assert!((curve.log_area_lpips_alex.unwrap_or(0.0) - lpips).abs() < 1e-9);
    scored.rows[0].lpips_alex = None;
    let curve = curve_of(&scored, Some(span(1.0, 100.0)));
    assert_eq!(curve.log_area_lpips_alex, None);
    assert!(curve.log_area_ssim.is_some());
}

#[test]
fn a_row_at_time_zero_has_no_logarithm() {
    let from_zero = run(&[(0.0, 15.0), (10.0, 21.0), (40.0, 25.0)], 1);
    let curve = curve_of(&from_zero, Some(span(10.0, 40.0)));
    assert_eq!(curve.to_quality[0], Crossing::AtMost { seconds: 10.0 });
    assert!((curve.log_area_db.unwrap_or(0.0) - 23.0).abs() < 1e-9);
    let other = run(&[(2.0, 15.0), (40.0, 25.0)], 1);
    assert_eq!(common_span(&[from_zero, other]), Ok(span(10.0, 40.0)));
}

#[test]
fn a_run_without_rows_is_its_end() {
    let point = curve_of(&run(&[], 1), Some(span(1.0, 10.0)));
    assert_eq!(point.to_quality[2], Crossing::AtMost { seconds: 7.0 });
    assert_eq!(point.to_quality[3], Crossing::Never);
    assert_eq!(point.at_moment, [Some(25.0); 5]);
    assert_eq!(point.log_area_db, None);
    let without_training = TracedRun {
        training_seconds: Some(0.0),
        iterations: None,
        ..run(&[], 1)
    };
    let at_once = Crossing::At {
        seconds: 0.0,
        iteration: None,
    };
    assert_eq!(curve_of(&without_training, None).to_quality[2], at_once);
    let unknown = TracedRun {
        training_seconds: None,
        ..run(&[], 1)
    };
    let curves = measured(&[unknown, run(&[(8.0, 20.0)], 1)], None);
    assert_eq!(curves[0].to_quality, [Crossing::Never; 6]);
    assert_eq!(curves[0].at_moment, [None; 5]);
    // Better and smaller, but of unknown duration.
    assert!(!curves[0].on_front && curves[1].on_front);
}

#[test]
fn areas_are_over_the_time_that_all_curves_have() {
    let early = run(&[(1.0, 10.0), (16.0, 14.0)], 1);
    let late = run(&[(4.0, 10.0), (64.0, 18.0)], 1);
    let point = run(&[], 1);
    let runs = [early.clone(), point.clone(), late.clone()];
    let found = common_span(&runs);
    assert_eq!(found, Ok(span(4.0, 16.0)));
    let areas: Vec<Option<f64>> = measured(&runs, found.ok())
        .iter()
        .map(|curve| curve.log_area_db)
        .collect();
    assert!((areas[0].unwrap_or(0.0) - 13.0).abs() < 1e-9);
    assert_eq!(areas[1], None);
    assert!((areas[2].unwrap_or(0.0) - 12.0).abs() < 1e-9);
    assert!(common_span(&[early.clone(), point]).is_err());
    let after = run(&[(16.0, 10.0), (64.0, 18.0)], 1);
    assert!(common_span(&[early, after]).is_err());
}

#[test]
fn the_front_weighs_time_quality_and_memory() {
    let runs = [
        run(&[(10.0, 20.0)], 5),
        run(&[(20.0, 25.0)], 5),
        run(&[(20.0, 24.0)], 5),
        run(&[(20.0, 24.0)], 4),
    ];
    let front: Vec<bool> = measured(&runs, None)
        .iter()
        .map(|curve| curve.on_front)
        .collect();
    assert_eq!(front, [true, true, false, true]);
}

/// Times from 1 to 512 with one between 2^k and 2^(k + 1/2) for every k, placed by `shares`.
fn times(shares: &[f64]) -> Vec<f64> {
    let within = shares.iter().zip(1_u32..);
    let within = within.map(|(share, octave)| (f64::from(octave) + 0.5 * share).exp2());
    std::iter::once(1.0).chain(within).chain([512.0]).collect()
}

proptest! {
    #[test]
    fn the_order_of_curves_does_not_depend_on_their_rows(
        one in prop::collection::vec(0.0..1.0_f64, 8),
        other in prop::collection::vec(0.0..1.0_f64, 8),
    ) {
        let [one, other] = [one, other].map(|shares| times(&shares));
        let areas = |first: TracedRun, second: TracedRun| {
            let runs = [first, second];
            let span = common_span(&runs).ok();
            [0, 1].map(|run| measured(&runs, span)[run].log_area_db.unwrap_or(0.0))
        };
        // These cross after 28 s; from 1 s to 512 s the second is better by 0.1 dB.
        let [steep, flat] = areas(
            sampled(&one, |seconds| 18.0 + 2.2 * seconds.ln()),
            sampled(&other, |seconds| 20.0 + 1.6 * seconds.ln()),
        );
        prop_assert!(flat - steep > 0.1, "{} {}", steep, flat);
        // These level off, and cross after 5 s; the first is better by 0.5 dB.
        let [quick, slow] = areas(
            sampled(&one, |seconds| 30.0 - 14.0 / (1.0 + seconds / 6.0)),
            sampled(&other, |seconds| 29.5 - 9.0 / (1.0 + seconds / 20.0)),
        );
        prop_assert!(quick > slow, "{} {}", quick, slow);
    }

    #[test]
    fn a_mean_over_log_time_is_that_of_the_curve_at_the_rows_of_a_trace(
        curve in any_curve(),
        begin in 0.5..2.0_f64,
        step in 0.001..0.1_f64,
    ) {
        let run = sampled(&trace_times(begin, step), |seconds| curve.at(seconds));
        let found = curve_of(&run, Some(span(begin, LONGEST))).log_area_db.unwrap_or(0.0);
        let exact = curve.mean_over_log_time(begin, LONGEST);
        prop_assert!((found - exact).abs() < 0.02, "{} {}", found, exact);
    }

    #[test]
    fn the_better_curve_has_the_larger_area(
        curves in (any_curve(), any_curve()),
        begins in (0.5..2.0_f64, 0.5..2.0_f64),
        steps in (0.001..0.1_f64, 0.001..0.1_f64),
    ) {
        let runs = [
            sampled(&trace_times(begins.0, steps.0), |seconds| curves.0.at(seconds)),
            sampled(&trace_times(begins.1, steps.1), |seconds| curves.1.at(seconds)),
        ];
        let Ok(common) = common_span(&runs) else {
            return Err(TestCaseError::fail("no common time"));
        };
        let exact = |curve: &SaturatingCurve| {
            curve.mean_over_log_time(common.from_seconds, common.until_seconds)
        };
        let true_lead = exact(&curves.0) - exact(&curves.1);
        let measured = measured(&runs, Some(common));
        let [first, second] = [0, 1].map(|run: usize| measured[run].log_area_db.unwrap_or(0.0));
        prop_assume!(true_lead.abs() > 0.05);
        prop_assert!((first - second) * true_lead > 0.0, "{} {} {}", first, second, true_lead);
    }
}

/// End of the curves of properties, seconds.
const LONGEST: f64 = 400.0;

/// A quality that levels off: `end - rise / (1 + seconds / half)`, dB.
#[derive(Debug, Clone, Copy)]
struct SaturatingCurve {
    end: f64,
    rise: f64,
    half: f64,
}

impl SaturatingCurve {
    fn at(&self, seconds: f64) -> f64 {
        self.end - self.rise / (1.0 + seconds / self.half)
    }

    /// Returns the mean over the logarithm of time in closed form.
    fn mean_over_log_time(&self, begin: f64, end: f64) -> f64 {
        // The integral of 1 / (t (1 + t / h)) is ln(t / (t + h)).
        let integral = |seconds: f64| (seconds / (seconds + self.half)).ln();
        let loss = self.rise * (integral(end) - integral(begin)) / (end / begin).ln();
        self.end - loss
    }
}

fn any_curve() -> impl Strategy<Value = SaturatingCurve> {
    (24.0..34.0_f64, 4.0..16.0_f64, 0.5..60.0_f64).prop_map(|(end, rise, half)| SaturatingCurve {
        end,
        rise,
        half,
    })
}

/// Returns the times of a trace from the end of planning on: the ends of the first steps past two moments per octave.
fn trace_times(begin: f64, step: f64) -> Vec<f64> {
    let mut times = vec![begin];
    let moments = (-2_i32..).map(|half_octaves| (0.5 * f64::from(half_octaves)).exp2());
    for moment in moments.take_while(|&moment| moment < LONGEST) {
        let time = begin + step * ((moment - begin) / step).ceil();
        if moment > begin && time < LONGEST && times.last() < Some(&time) {
            times.push(time);
        }
    }
    times.push(LONGEST);
    times
}

/// Two methods with rows at every so many of their iterations. By the area over seconds with no quality before the
/// first row, the winner depends on the number of iterations between rows.
#[test]
fn the_winner_does_not_depend_on_the_iterations_between_rows() {
    let better = SaturatingCurve {
        end: 32.0,
        rise: 12.0,
        half: 5.0,
    };
    let worse = SaturatingCurve {
        end: 31.5,
        ..better
    };
    // Steps of the better method take twice as long.
    let runs = |every: f64| {
        [(better, 0.05), (worse, 0.025)].map(|(curve, step): (SaturatingCurve, f64)| {
            let rows = (60.0 / (step * every)) as u32;
            let times: Vec<f64> = (1..=rows)
                .map(|row| f64::from(row) * step * every)
                .collect();
            sampled(&times, |seconds| curve.at(seconds))
        })
    };
    let with_zeros = |run: &TracedRun| {
        let pairs = run.rows.iter().zip(run.rows.iter().skip(1));
        let areas = pairs
            .map(|(one, next)| 0.5 * (one.psnr_db + next.psnr_db) * (next.seconds - one.seconds));
        areas.sum::<f64>() / 60.0
    };
    let leads = [400.0, 10.0].map(|every: f64| {
        let runs = runs(every);
        let measured = measured(&runs, common_span(&runs).ok());
        let of_log_time = [0, 1].map(|run: usize| measured[run].log_area_db.unwrap_or(0.0));
        let of_zeros = runs.each_ref().map(with_zeros);
        (of_zeros[0] > of_zeros[1], of_log_time[0] > of_log_time[1])
    });
    assert_eq!(leads, [(false, true), (true, true)]);
}

#[test]
fn curves_of_other_views_are_not_compared() {
    let first = TracedRun {
        scene_sha256: "a".to_owned(),
        novel_views: 12,
        ..run(&[(1.0, 20.0)], 1)
    };
    assert_eq!(other_views(&first, &first), None);
    // Results of older versions have no hash.
    let older = TracedRun {
        scene_sha256: String::new(),
        ..first.clone()
    };
    assert_eq!(other_views(&first, &older), None);
    for other in [
        TracedRun {
            scene_sha256: "b".to_owned(),
            ..first.clone()
        },
        TracedRun {
            novel_views: 1,
            ..first.clone()
        },
    ] {
        assert!(other_views(&first, &other).is_some());
    }
}
