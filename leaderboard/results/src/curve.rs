//! Curves of error against run time in the files that scoring writes beside results.

use std::{io, path::Path};

use omnilife_schemas::{layout::CURVE_FILE, plain_text, records::ResultRecord, store::StoreError};
use serde::Deserialize;

use crate::error::ResultsError;

/// A row that has a score of novel views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Wall-clock time of the training steps so far.
    pub seconds: f64,
    /// CPU time of the training steps so far, seconds, if measured.
    pub cpu_seconds: Option<f64>,
    /// Iterations done.
    pub iteration: u64,
    /// Primitives of the model, if counted.
    pub primitives: Option<u64>,
    /// Number of novel views, if it is known.
    pub novel_views: Option<u32>,
    /// Mean over novel views, dB.
    pub psnr_db: f64,
    /// Mean over novel views.
    pub ssim: Option<f64>,
    /// Mean LPIPS (`AlexNet`) over novel views, if computed.
    pub lpips_alex: Option<f64>,
    /// Mean over static regions of novel views, dB.
    pub psnr_static_db: Option<f64>,
    /// Mean over dynamic regions of novel views, dB.
    pub psnr_dynamic_db: Option<f64>,
}

impl CurvePoint {
    /// Returns its existing scores: metric, region, value.
    pub(crate) fn scores(&self) -> impl Iterator<Item = (&'static str, &'static str, f64)> {
        let all = [
            ("psnr", "whole", Some(self.psnr_db)),
            ("ssim", "whole", self.ssim),
            ("lpips-alex", "whole", self.lpips_alex),
            ("psnr", "static", self.psnr_static_db),
            ("psnr", "dynamic", self.psnr_dynamic_db),
        ];
        all.into_iter()
            .filter_map(|(metric, region, value)| Some((metric, region, value?)))
    }
}

/// Columns of the file that are read.
#[derive(Deserialize)]
struct Row {
    wall_seconds: f64,
    #[serde(default)]
    cpu_seconds: Option<f64>,
    iteration: u64,
    #[serde(default)]
    primitives: Option<u64>,
    #[serde(default)]
    novel_views: Option<u32>,
    novel_psnr_db: Option<f64>,
    #[serde(default)]
    novel_ssim: Option<f64>,
    #[serde(default)]
    novel_lpips_alex: Option<f64>,
    #[serde(default)]
    novel_psnr_static_db: Option<f64>,
    #[serde(default)]
    novel_psnr_dynamic_db: Option<f64>,
}

impl Row {
    /// Returns true if every number of it is finite and its time is not before the start.
    fn is_possible(&self) -> bool {
        let others = [
            self.cpu_seconds,
            self.novel_psnr_db,
            self.novel_ssim,
            self.novel_lpips_alex,
            self.novel_psnr_static_db,
            self.novel_psnr_dynamic_db,
        ];
        let finite = others.into_iter().flatten().all(f64::is_finite);
        finite && self.wall_seconds.is_finite() && self.wall_seconds >= 0.0
    }
}

/// Reads the scored rows of the curve beside a result; none without such a file, or if they are of other views than the
/// result's scores.
///
/// # Errors
/// [`ResultsError::Store`] when it cannot be read, [`ResultsError::Impossible`] for impossible numbers.
pub fn read(folder: &Path, result: &ResultRecord) -> Result<Vec<CurvePoint>, ResultsError> {
    let points = of_any_views(folder)?;
    let is_partial = points
        .iter()
        .any(|point| is_of_others(point.novel_views, result));
    Ok(if is_partial { Vec::new() } else { points })
}

/// Returns a line on curves that are left out because they are of other views than the scores of their results; `None`
/// without any.
///
/// # Errors
/// Those of [`read`].
pub fn left_out<'a>(
    results: impl IntoIterator<Item = (&'a Path, &'a ResultRecord)>,
) -> Result<Option<String>, ResultsError> {
    let mut names = Vec::new();
    for (file, result) in results {
        let traced = file.parent().map_or(Ok(None), traced_views)?;
        let views = traced.filter(|&views| is_of_others(Some(views), result));
        names.extend(
            views.map(|views| format!("{} on {} ({views} views)", result.method, result.scene)),
        );
    }
    Ok((!names.is_empty()).then(|| {
        format!(
            "curves are left out that are of other views than their scores, by --trace-views of training: {}",
            plain_text::first_of(&names)
        )
    }))
}

/// Returns true for a curve that is not of as many novel views as the result's scores. Curves of older versions do not say
/// how many.
fn is_of_others(traced: Option<u32>, result: &ResultRecord) -> bool {
    let scored = result.novel_views.get("psnr");
    let scored = scored.map(|psnr| psnr.views.saturating_add(psnr.undefined_views));
    let pair = traced.filter(|&views| views > 0).zip(scored);
    pair.is_some_and(|(traced, scored)| traced != scored)
}

/// Returns the number of novel views of the curve beside a result, which all of its rows have; reads the first alone.
fn traced_views(folder: &Path) -> Result<Option<u32>, ResultsError> {
    let path = folder.join(CURVE_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let impossible = |error: csv::Error| ResultsError::Impossible {
        path: path.clone(),
        reason: error.to_string(),
    };
    let mut table = csv::Reader::from_path(&path).map_err(impossible)?;
    let first = table.deserialize::<Row>().next().transpose();
    Ok(first.map_err(impossible)?.and_then(|row| row.novel_views))
}

fn of_any_views(folder: &Path) -> Result<Vec<CurvePoint>, ResultsError> {
    let path = folder.join(CURVE_FILE);
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(StoreError::read(&path, source).into()),
    };
    let impossible = |reason: String| ResultsError::Impossible {
        path: path.clone(),
        reason,
    };
    let mut points = Vec::new();
    for row in csv::Reader::from_reader(text.as_slice()).deserialize::<Row>() {
        let row = row.map_err(|error| impossible(error.to_string()))?;
        let Some(psnr_db) = row.novel_psnr_db else {
            continue;
        };
        if !row.is_possible() {
            let iteration = row.iteration;
            return Err(impossible(format!(
                "iteration {iteration} has a time or score that cannot be"
            )));
        }
        points.push(CurvePoint {
            seconds: row.wall_seconds,
            cpu_seconds: row.cpu_seconds,
            iteration: row.iteration,
            primitives: row.primitives,
            novel_views: row.novel_views,
            psnr_db,
            ssim: row.novel_ssim,
            lpips_alex: row.novel_lpips_alex,
            psnr_static_db: row.novel_psnr_static_db,
            psnr_dynamic_db: row.novel_psnr_dynamic_db,
        });
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_have_the_rows_with_a_score() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        assert_eq!(of_any_views(folder.path())?, []);
        let text = "wall_seconds,iteration,novel_psnr_db,novel_ssim,more\n\
                    1,10,20,0.5,x\n2,20,,,x\n4,30,23,,x\n";
        std::fs::write(folder.path().join(CURVE_FILE), text)?;
        let points = of_any_views(folder.path())?;
        let found: Vec<_> = (points.iter())
            .map(|point| (point.seconds, point.iteration, point.psnr_db, point.ssim))
            .collect();
        assert_eq!(found, [(1.0, 10, 20.0, Some(0.5)), (4.0, 30, 23.0, None)]);
        assert_eq!(points[0].scores().count(), 2);
        // Before the first step, for a run without planning.
        std::fs::write(
            folder.path().join(CURVE_FILE),
            "wall_seconds,iteration,novel_psnr_db,novel_lpips_alex\n0,0,12,0.75\n",
        )?;
        let points = of_any_views(folder.path())?;
        assert_eq!((points[0].seconds, points[0].iteration), (0.0, 0));
        let scores: Vec<_> = points[0].scores().collect();
        assert_eq!(
            scores,
            [("psnr", "whole", 12.0), ("lpips-alex", "whole", 0.75)]
        );
        std::fs::write(
            folder.path().join(CURVE_FILE),
            "wall_seconds,iteration,novel_psnr_db\n-1,1,2\n",
        )?;
        let error = of_any_views(folder.path()).map_err(|error| error.to_string());
        assert!(error.is_err_and(|error| error.contains("curve.csv: iteration 1 has")));
        Ok(())
    }
}
