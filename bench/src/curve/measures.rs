//! What a curve comes to. Nothing is interpolated: a quality counts as reached at the first row of
//! the trace that shows it, and holds until the next row. How fine the rows are (`--trace`) is how
//! fine these numbers are.

use super::trace::TracedRun;

/// Qualities to which the time is told, dB.
pub const QUALITIES_DB: [u32; 6] = [20, 22, 24, 26, 28, 30];
/// Moments at which the quality is told, seconds.
pub const MOMENTS_SECONDS: [u32; 5] = [10, 60, 180, 600, 1800];
/// Share of the final quality (in dB) that counts as nearly there.
const NEARLY: f64 = 0.95;

/// A run and what its curve comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCurve {
    /// The run.
    pub run: TracedRun,
    /// PSNR of the last row, dB.
    pub final_db: f64,
    /// When each of [`QUALITIES_DB`] was reached.
    pub to_quality: Vec<Option<Reached>>,
    /// When 95 % of the final quality (dB) were reached.
    pub to_95_percent: Option<Reached>,
    /// Quality at each of [`MOMENTS_SECONDS`], dB; none before the first row. After the end of a run
    /// it is the final one.
    pub at_moment: Vec<Option<f64>>,
    /// Until when the area is taken: the end of the shortest run that it is compared with, seconds.
    pub area_seconds: f64,
    /// Mean quality over that time, dB, counting 0 before the first row; none where that time is 0.
    pub area_db: Option<f64>,
    /// Whether no other run of the comparison is as good in training time, final quality and peak
    /// memory, and better in one of them.
    pub on_front: bool,
}

/// When something was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// Training time, seconds.
    pub seconds: f64,
    /// Iterations done.
    pub iteration: u64,
}

/// Measures runs of one scene and protocol against each other.
pub(super) fn measured(runs: &[TracedRun]) -> Vec<RunCurve> {
    let end = |run: &TracedRun| run.rows.last().map_or(0.0, |row| row.seconds);
    let shortest = runs.iter().map(end).fold(f64::INFINITY, f64::min);
    runs.iter()
        .map(|run| RunCurve {
            on_front: !runs.iter().any(|other| dominates(other, run)),
            ..curve_of(run, shortest)
        })
        .collect()
}

/// The measures of one run by itself, with the area until `area_seconds`.
pub fn curve_of(run: &TracedRun, area_seconds: f64) -> RunCurve {
    let final_db = final_db(run);
    RunCurve {
        final_db,
        to_quality: QUALITIES_DB
            .map(|quality| reached(run, f64::from(quality)))
            .into(),
        to_95_percent: reached(run, NEARLY * final_db),
        at_moment: MOMENTS_SECONDS
            .map(|seconds| quality_at(run, f64::from(seconds)))
            .into(),
        area_seconds,
        area_db: area(run, area_seconds),
        on_front: true,
        run: run.clone(),
    }
}

fn final_db(run: &TracedRun) -> f64 {
    run.rows.last().map_or(0.0, |row| row.psnr_db)
}

fn reached(run: &TracedRun, quality_db: f64) -> Option<Reached> {
    run.rows
        .iter()
        .find(|row| row.psnr_db >= quality_db)
        .map(|row| Reached {
            seconds: row.seconds,
            iteration: row.iteration,
        })
}

fn quality_at(run: &TracedRun, seconds: f64) -> Option<f64> {
    let rows = run.rows.iter().rev();
    let mut before = rows.skip_while(|row| row.seconds > seconds);
    before.next().map(|row| row.psnr_db)
}

fn area(run: &TracedRun, seconds: f64) -> Option<f64> {
    if !(seconds > 0.0 && seconds.is_finite()) {
        return None;
    }
    let ends = run.rows.iter().skip(1).map(|row| row.seconds);
    let ends = ends.chain(std::iter::once(f64::INFINITY));
    let sum: f64 = run
        .rows
        .iter()
        .zip(ends)
        .map(|(row, end)| row.psnr_db * (end.min(seconds) - row.seconds).max(0.0))
        .sum();
    Some(sum / seconds)
}

/// Whether `left` is nowhere worse than `right` and somewhere better. A run of unknown memory is
/// compared by time and quality.
fn dominates(left: &TracedRun, right: &TracedRun) -> bool {
    let memories = left.peak_memory_bytes.zip(right.peak_memory_bytes);
    let (memory_left, memory_right) = memories.unwrap_or((0, 0));
    let is_nowhere_worse = left.training_seconds <= right.training_seconds
        && final_db(left) >= final_db(right)
        && memory_left <= memory_right;
    let is_better = left.training_seconds < right.training_seconds
        || final_db(left) > final_db(right)
        || memory_left < memory_right;
    is_nowhere_worse && is_better
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Clock, Region, TraceRow};

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
            ghost_share: None,
            input_hole_share: None,
            novel_hole_share: None,
        };
        TracedRun {
            folder: "score".into(),
            clock: Clock::Wall,
            region: Region::Whole,
            method: "m".to_owned(),
            scene: "s".to_owned(),
            protocol_hash: "h".to_owned(),
            seed: 0,
            preparation_seconds: None,
            training_seconds: points.last().map_or(0.0, |point| point.0),
            evaluation_seconds: 1.0,
            iterations: 100,
            primitives: 5,
            peak_memory_bytes: Some(memory),
            rows: points.iter().map(row).collect(),
        }
    }

    #[test]
    fn runs_of_one_scene_have_names_of_their_own() {
        let plain = run(&[(1.0, 20.0)], 1);
        let with = |seed: u64, iterations: u64, folder: &str| TracedRun {
            seed,
            iterations,
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
    fn times_qualities_and_areas_are_read_off_the_rows() {
        let run = run(&[(5.0, 18.0), (20.0, 23.0), (80.0, 25.0)], 1);
        let curve = curve_of(&run, 40.0);
        let seconds: Vec<Option<f64>> = curve
            .to_quality
            .iter()
            .map(|reached| reached.map(|reached| reached.seconds))
            .collect();
        assert_eq!(
            seconds,
            [Some(20.0), Some(20.0), Some(80.0), None, None, None]
        );
        // 95 % of 25 dB are 23.75 dB.
        assert_eq!(
            curve.to_95_percent.map(|reached| reached.iteration),
            Some(800)
        );
        assert_eq!(
            curve.at_moment,
            [Some(18.0), Some(23.0), Some(25.0), Some(25.0), Some(25.0)]
        );
        // 15 s of 18 dB and 20 s of 23 dB in 40 s.
        assert_eq!(curve.area_db, Some((15.0 * 18.0 + 20.0 * 23.0) / 40.0));
        assert_eq!(curve_of(&run, 0.0).area_db, None);
    }

    #[test]
    fn the_front_weighs_time_quality_and_memory() {
        let runs = [
            run(&[(10.0, 20.0)], 5),
            run(&[(20.0, 25.0)], 5),
            run(&[(20.0, 24.0)], 5),
            run(&[(20.0, 24.0)], 4),
        ];
        let front: Vec<bool> = measured(&runs).iter().map(|curve| curve.on_front).collect();
        assert_eq!(front, [true, true, false, true]);
        assert!(
            measured(&runs)
                .iter()
                .all(|curve| curve.area_seconds == 10.0)
        );
    }
}
