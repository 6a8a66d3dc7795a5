//! Whether views are bad because their camera convention is another one: mirrored, turned by quarter
//! turns, upside down, or half a pixel beside.
//!
//! Some predictions are compared with ground truth once more after each of these changes. Where one
//! of them makes the views much better, that is told; no score is ever taken from a changed view.

use std::fmt;

use crate::{
    error::BenchError,
    scoring::job::{ScoreRequest, ScoringJob, View},
    truth,
};

/// Views that are looked at, spread evenly over those that are scored.
const VIEWS: usize = 3;
/// Gain over the unchanged views from which a change is told, dB: a wrong convention costs many, and
/// a symmetrical scene shown right gains none.
const TELLING_GAIN_DB: f64 = 1.0;
/// The same for half a pixel. The shift blurs, which flatters noisy views: the opposite shift, which
/// blurs as much, has to be worse by [`TELLING_ASYMMETRY_DB`].
const TELLING_SHIFT_DB: f64 = 0.2;
const TELLING_ASYMMETRY_DB: f64 = 0.5;

/// A change of camera convention.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// None.
    Unchanged,
    /// A turn, after mirroring where it is mirrored.
    Turned {
        /// Columns in reverse.
        is_mirrored: bool,
        /// Rows in reverse.
        is_upside_down: bool,
        /// Columns moved to the right by quarters of the width, 0 to 3.
        quarters: usize,
    },
    /// Moved by half a pixel.
    Shifted {
        /// Half pixels to the right.
        right: i32,
        /// Half pixels down.
        down: i32,
    },
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Unchanged => f.write_str("unchanged"),
            Self::Turned {
                is_mirrored,
                is_upside_down,
                quarters,
            } => {
                let mut parts = Vec::new();
                if is_mirrored {
                    parts.push("mirrored".to_owned());
                }
                if is_upside_down {
                    parts.push("turned upside down".to_owned());
                }
                if quarters > 0 {
                    parts.push(format!("turned by {} degrees to the right", 90 * quarters));
                }
                f.write_str(&parts.join(", "))
            }
            Self::Shifted { right, down } => {
                let (count, direction) = match (right, down) {
                    (right, 0) if right > 0 => (right, "right"),
                    (right, 0) => (-right, "left"),
                    (_, down) if down > 0 => (down, "down"),
                    (_, down) => (-down, "up"),
                };
                write!(f, "moved {} pixel {direction}", 0.5 * f64::from(count))
            }
        }
    }
}

/// How much better or worse views are after each change.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// Views that were looked at; those that cannot be read are left out.
    pub views: usize,
    /// Mean PSNR of the views after each change, dB, the best first. Empty without views.
    pub changes: Vec<(Change, f64)>,
}

impl Diagnosis {
    fn psnr(&self, wanted: Change) -> Option<f64> {
        let found = self.changes.iter().find(|(change, _)| *change == wanted);
        found.map(|(_, psnr)| *psnr)
    }

    /// What to tell about it in one line; nothing where no change explains anything.
    pub fn remark(&self) -> Option<String> {
        let (change, best) = *self.changes.first()?;
        let unchanged = self.psnr(Change::Unchanged)?;
        let gain = best - unchanged;
        let tells = match change {
            Change::Unchanged => false,
            Change::Turned { .. } => gain > TELLING_GAIN_DB,
            Change::Shifted { right, down } => {
                let opposite = self.psnr(Change::Shifted {
                    right: -right,
                    down: -down,
                });
                gain > TELLING_SHIFT_DB
                    && opposite.is_some_and(|other| best - other > TELLING_ASYMMETRY_DB)
            }
        };
        tells.then(|| {
            format!(
                "the views would be {gain:.1} dB better {change}: is their camera convention \
                 another one? (scores are of the views as they are)"
            )
        })
    }
}

/// Every change that is tried.
fn changes() -> Vec<Change> {
    let mut changes = vec![Change::Unchanged];
    for is_mirrored in [false, true] {
        for is_upside_down in [false, true] {
            changes.extend((0..4).map(|quarters| Change::Turned {
                is_mirrored,
                is_upside_down,
                quarters,
            }));
        }
    }
    // The turn by nothing is there already.
    changes.remove(1);
    for (right, down) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
        changes.push(Change::Shifted { right, down });
    }
    changes
}

/// Looks at some of the views that a request would score. Nothing is written.
///
/// # Errors
/// Those of scoring, as far as they concern scene, split and ground truth.
pub fn diagnose(request: &ScoreRequest) -> Result<Diagnosis, BenchError> {
    of_job(&ScoringJob::prepare(request)?)
}

/// Looks at some of the views of a job.
pub(crate) fn of_job(job: &ScoringJob) -> Result<Diagnosis, BenchError> {
    let all = job.views();
    let step = all.len().div_ceil(VIEWS).max(1);
    let [width, height] = job.size;
    let changes = changes();
    let mut sums = vec![0.0; changes.len()];
    let mut views = 0;
    for &view in all.iter().skip(step / 2).step_by(step) {
        let Some((predicted, truth)) = read(job, view)? else {
            continue;
        };
        views += 1;
        for (sum, change) in sums.iter_mut().zip(&changes) {
            *sum += psnr(&predicted, &truth, width as usize, height as usize, *change);
        }
    }
    let mut ranked: Vec<(Change, f64)> = changes
        .into_iter()
        .zip(sums)
        .map(|(change, sum)| (change, sum / f64::from(views as u32)))
        .collect();
    if views == 0 {
        ranked.clear();
    }
    // Stable: of equals, the unchanged view comes first.
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    Ok(Diagnosis {
        views,
        changes: ranked,
    })
}

/// Bytes of a prediction and of its ground truth.
type Pair = (Vec<u8>, Vec<u8>);

/// `None` where the prediction cannot be read.
fn read(job: &ScoringJob, view: View) -> Result<Option<Pair>, BenchError> {
    let [width, height] = job.size;
    let Some(folder) = job.folder(view.kind) else {
        return Ok(None);
    };
    match folder.read(view.frame, width, height) {
        Ok(predicted) => Ok(Some((predicted, truth::read(job, view.frame)?))),
        Err(_) => Ok(None),
    }
}

/// PSNR in dB of a prediction after a change.
fn psnr(predicted: &[u8], truth: &[u8], width: usize, height: usize, change: Change) -> f64 {
    let mut sum = 0.0;
    for row in 0..height {
        for column in 0..width {
            let truth = &truth[(row * width + column) * 3..][..3];
            for (channel, &true_value) in truth.iter().enumerate() {
                let value = changed(predicted, (width, height), change, (column, row), channel);
                sum += (value - f64::from(true_value)).powi(2);
            }
        }
    }
    let mse = sum / (width * height * 3) as f64 / (255.0 * 255.0);
    -10.0 * mse.max(1e-10).log10()
}

/// The byte that a change brings to a pixel.
fn changed(
    image: &[u8],
    (width, height): (usize, usize),
    change: Change,
    (column, row): (usize, usize),
    channel: usize,
) -> f64 {
    let at = |column: usize, row: usize| f64::from(image[(row * width + column) * 3 + channel]);
    match change {
        Change::Unchanged => at(column, row),
        Change::Turned {
            is_mirrored,
            is_upside_down,
            quarters,
        } => {
            let column = (column + width - quarters * width / 4) % width;
            let column = if is_mirrored {
                width - 1 - column
            } else {
                column
            };
            let row = if is_upside_down {
                height - 1 - row
            } else {
                row
            };
            at(column, row)
        }
        Change::Shifted { right, down } => {
            // Half a pixel is the mean of two; columns wrap, rows end.
            let other_column = (column as i64 - i64::from(right)).rem_euclid(width as i64) as usize;
            let other_row = (row as i64 - i64::from(down)).clamp(0, height as i64 - 1) as usize;
            0.5 * (at(column, row) + at(other_column, other_row))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (16, 8);

    /// An image without any symmetry.
    fn image() -> Vec<u8> {
        (0..SIZE.0 * SIZE.1 * 3)
            .map(|index| ((index * index * 31 + index * 7) % 251) as u8)
            .collect()
    }

    fn after(change: Change) -> Vec<u8> {
        let image = image();
        let mut out = Vec::new();
        for row in 0..SIZE.1 {
            for column in 0..SIZE.0 {
                for channel in 0..3 {
                    let value = changed(&image, SIZE, change, (column, row), channel);
                    out.push(value.round() as u8);
                }
            }
        }
        out
    }

    #[test]
    fn every_change_is_told_from_every_other() {
        let truth = image();
        for made in changes() {
            if matches!(made, Change::Shifted { .. }) {
                continue;
            }
            let predicted = after(made);
            let perfect: Vec<Change> = changes()
                .into_iter()
                .filter(|&tried| psnr(&predicted, &truth, SIZE.0, SIZE.1, tried) > 60.0)
                .collect();
            assert_eq!(perfect.len(), 1, "{made}: {perfect:?}");
        }
    }

    #[test]
    fn changes_are_told_in_words() {
        let words: Vec<String> = changes().iter().map(Change::to_string).collect();
        assert_eq!(words.len(), 20);
        assert_eq!(words[0], "unchanged");
        assert!(words.contains(&"mirrored, turned by 90 degrees to the right".to_owned()));
        assert!(words.contains(&"turned upside down".to_owned()));
        assert!(words.contains(&"moved 0.5 pixel left".to_owned()));
    }
}
