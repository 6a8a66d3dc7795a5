//! Curves of error against run time, as scoring leaves them beside results.

use std::{collections::BTreeMap, io, path::Path};

use omnilife_schemas::store::StoreError;
use serde::Deserialize;

use crate::error::LeaderboardError;

/// File beside a result.
pub(super) const FILE: &str = "curve.csv";

/// A row that has a score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CurvePoint {
    /// Wall-clock time of the training steps so far.
    pub(super) seconds: f64,
    pub(super) iteration: u64,
    /// Mean over novel views, dB.
    pub(super) psnr_db: f64,
}

/// What is read of a row.
#[derive(Deserialize)]
struct Row {
    wall_seconds: f64,
    iteration: u64,
    novel_psnr_db: Option<f64>,
}

/// The scored rows of the curve beside a result; none where there is no such file.
pub(super) fn read(folder: &Path) -> Result<Vec<CurvePoint>, LeaderboardError> {
    let path = folder.join(FILE);
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(StoreError::read(&path, source).into()),
    };
    let impossible = |reason: String| LeaderboardError::Impossible {
        path: path.clone(),
        reason,
    };
    let mut points = Vec::new();
    for row in csv::Reader::from_reader(text.as_slice()).deserialize::<Row>() {
        let row = row.map_err(|error| impossible(error.to_string()))?;
        let Some(psnr_db) = row.novel_psnr_db else {
            continue;
        };
        if !(row.wall_seconds.is_finite() && row.wall_seconds > 0.0 && psnr_db.is_finite()) {
            let iteration = row.iteration;
            return Err(impossible(format!(
                "iteration {iteration} has a time or score that cannot be"
            )));
        }
        points.push(CurvePoint {
            seconds: row.wall_seconds,
            iteration: row.iteration,
            psnr_db,
        });
    }
    Ok(points)
}

/// The mean of several curves at the iterations that all of them have; nothing unless all have points.
pub(super) fn mean(curves: &[&[CurvePoint]]) -> Vec<CurvePoint> {
    let mut sums: BTreeMap<u64, (usize, f64, f64)> = BTreeMap::new();
    for point in curves.iter().copied().flatten() {
        let (count, seconds, psnr_db) = sums.entry(point.iteration).or_default();
        *count += 1;
        *seconds += point.seconds;
        *psnr_db += point.psnr_db;
    }
    let number = curves.len();
    (sums.into_iter())
        .filter(|(_, (count, ..))| *count == number)
        .map(|(iteration, (_, seconds, psnr_db))| CurvePoint {
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
    fn curves_are_read_and_averaged_where_all_have_a_score()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        assert_eq!(read(folder.path())?, []);
        let text = "wall_seconds,iteration,novel_psnr_db,more\n1,10,20,x\n2,20,,x\n4,30,23,x\n";
        std::fs::write(folder.path().join(FILE), text)?;
        let first = read(folder.path())?;
        let point = |seconds, iteration, psnr_db| CurvePoint {
            seconds,
            iteration,
            psnr_db,
        };
        assert_eq!(first, [point(1.0, 10, 20.0), point(4.0, 30, 23.0)]);
        let second = [point(3.0, 10, 22.0), point(5.0, 20, 22.5)];
        assert_eq!(mean(&[&first, &second]), [point(2.0, 10, 21.0)]);
        std::fs::write(
            folder.path().join(FILE),
            "wall_seconds,iteration,novel_psnr_db\n-1,1,2\n",
        )?;
        let error = read(folder.path()).map_err(|error| error.to_string());
        assert!(error.is_err_and(|error| error.contains("curve.csv: iteration 1 has")));
        Ok(())
    }
}
