//! Whether views are bad because their camera convention is another one: mirrored, turned by quarter
//! turns, upside down, or half a pixel beside.
//!
//! Some predictions are compared with ground truth once more after each of these changes. Where one
//! of them makes the views much better, that is told; no score is ever taken from a changed view.

use std::fmt;

use omnilife_schemas::rgb::Mask;

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
/// blurs as much, has to be worse by [`TELLING_ASYMMETRY_DB`]. What another camera has seen, such as
/// the nearest input view, is shifted too, but not by half a pixel everywhere: the gain has to be there
/// in every view and in every quarter of the longitudes, and a whole pixel must not be better still.
const TELLING_SHIFT_DB: f64 = 0.2;
const TELLING_ASYMMETRY_DB: f64 = 0.5;

/// Parts of the width that are looked at by themselves.
const QUARTERS: usize = 4;

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
    /// Moved by half a pixel or by a whole one, which is tried for comparison alone.
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
    /// Changes that leave no quarter of any view worse than it was.
    helps_everywhere: Vec<Change>,
}

impl Diagnosis {
    fn psnr(&self, wanted: Change) -> Option<f64> {
        let found = self.changes.iter().find(|(change, _)| *change == wanted);
        found.map(|(_, psnr)| *psnr)
    }

    /// What to tell about it in one line; nothing where no change explains anything.
    pub fn warning(&self) -> Option<String> {
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
                    && right.abs() + down.abs() == 1
                    && self.helps_everywhere.contains(&change)
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
    for half_pixels in [1, 2] {
        for (right, down) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
            let (right, down) = (half_pixels * right, half_pixels * down);
            changes.push(Change::Shifted { right, down });
        }
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
    let mut by_view = Vec::new();
    for &view in all.iter().skip(step / 2).step_by(step) {
        if let Some(pair) = read(job, view)? {
            let size = (width as usize, height as usize);
            let of = |change| errors(&pair, size, change);
            by_view.push(changes().into_iter().map(of).collect());
        }
    }
    Ok(diagnosis(by_view))
}

/// What follows from the errors of every view after every change, in the order of [`changes`].
fn diagnosis(by_view: Vec<Vec<[f64; QUARTERS]>>) -> Diagnosis {
    let mut helps_everywhere = Vec::new();
    let mut ranked = Vec::new();
    for (index, change) in changes().into_iter().enumerate() {
        let no_worse = |view: &Vec<[f64; QUARTERS]>| {
            // The first change is none.
            let mut quarters = view[index].iter().zip(&view[0]);
            quarters.all(|(changed, as_it_is)| changed <= as_it_is)
        };
        if by_view.iter().all(no_worse) {
            helps_everywhere.push(change);
        }
        if !by_view.is_empty() {
            let sum: f64 = by_view.iter().map(|view| psnr(&view[index])).sum();
            ranked.push((change, sum / by_view.len() as f64));
        }
    }
    // Stable: of equals, the unchanged view comes first.
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    Diagnosis {
        views: by_view.len(),
        changes: ranked,
        helps_everywhere,
    }
}

/// A prediction that is looked at again after each change.
struct Pair {
    /// 8-bit RGB.
    predicted: Vec<u8>,
    /// 8-bit RGB.
    truth: Vec<u8>,
    /// Marks what no score counts.
    ignored: Option<Mask>,
}

/// `None` where the prediction cannot be read.
fn read(job: &ScoringJob, view: View) -> Result<Option<Pair>, BenchError> {
    let [width, height] = job.size;
    let Some(folder) = job.folder(view.kind) else {
        return Ok(None);
    };
    match folder.read(view.frame, width, height) {
        Ok(predicted) => Ok(Some(Pair {
            predicted,
            truth: truth::read(job, view.frame)?,
            ignored: truth::read_ignore_mask(job, view.frame)?,
        })),
        Err(_) => Ok(None),
    }
}

/// Mean squared errors, of values in [0, 1], of a prediction after a change, by quarter of the width.
fn errors(pair: &Pair, (width, height): (usize, usize), change: Change) -> [f64; QUARTERS] {
    let mut sums = [0.0; QUARTERS];
    let mut counts = [0_usize; QUARTERS];
    for row in 0..height {
        for column in 0..width {
            let (pixel, quarter) = (row * width + column, column * QUARTERS / width);
            let ignored = pair.ignored.as_ref();
            if ignored.is_some_and(|mask| mask.data[pixel] != 0) {
                continue;
            }
            let truth = &pair.truth[3 * pixel..][..3];
            for (channel, &true_value) in truth.iter().enumerate() {
                let value = changed(
                    &pair.predicted,
                    (width, height),
                    change,
                    (column, row),
                    channel,
                );
                sums[quarter] += (value - f64::from(true_value)).powi(2);
                counts[quarter] += 1;
            }
        }
    }
    std::array::from_fn(|quarter| sums[quarter] / (counts[quarter].max(1) as f64 * 255.0 * 255.0))
}

/// PSNR in dB of the errors of quarters.
fn psnr(errors: &[f64; QUARTERS]) -> f64 {
    let mse = errors.iter().sum::<f64>() / QUARTERS as f64;
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
            let weight = if right.abs() + down.abs() > 1 {
                1.0
            } else {
                0.5
            };
            let [right, down] = [right.signum(), down.signum()];
            let other_column = (column as i64 - i64::from(right)).rem_euclid(width as i64) as usize;
            let other_row = (row as i64 - i64::from(down)).clamp(0, height as i64 - 1) as usize;
            (1.0 - weight) * at(column, row) + weight * at(other_column, other_row)
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
        for made in changes() {
            if matches!(made, Change::Shifted { .. }) {
                continue;
            }
            let pair = Pair {
                predicted: after(made),
                truth: image(),
                ignored: None,
            };
            let perfect: Vec<Change> = changes()
                .into_iter()
                .filter(|&tried| psnr(&errors(&pair, SIZE, tried)) > 60.0)
                .collect();
            assert_eq!(perfect.len(), 1, "{made}: {perfect:?}");
        }
    }

    /// A smooth panorama, moved to the right by a number of half pixels that depends on the column.
    fn moved(half_pixels: impl Fn(usize) -> f64) -> Vec<u8> {
        let (width, height) = WIDE;
        let mut bytes = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let x = column as f64 - 0.5 * half_pixels(column);
                let wave = (std::f64::consts::TAU * x / 8.0).sin() * (1.0 + 0.1 * row as f64);
                bytes.extend([0, 1, 2].map(|channel| (110.0 + 60.0 * wave) as u8 + channel));
            }
        }
        bytes
    }

    const WIDE: (usize, usize) = (64, 8);

    fn warning(predicted: &[u8]) -> Option<String> {
        let pair = Pair {
            predicted: predicted.to_vec(),
            truth: moved(|_| 0.0),
            ignored: None,
        };
        let of = |change| errors(&pair, WIDE, change);
        let errors: Vec<_> = changes().into_iter().map(of).collect();
        diagnosis(vec![errors]).warning()
    }

    #[test]
    fn half_a_pixel_is_told_and_a_moving_camera_is_not() {
        let told = warning(&moved(|_| 1.0));
        assert!(told.is_some_and(|line| line.contains("moved 0.5 pixel left")));
        // Turned by more than that, and seen from a step further on: what lies on the left moves to
        // the left, what lies on the right to the right.
        assert_eq!(warning(&moved(|_| 3.0)), None);
        assert_eq!(
            warning(&moved(|column| if column < 16 { -0.5 } else { 1.0 })),
            None
        );
        assert_eq!(warning(&moved(|_| 0.0)), None);
    }

    #[test]
    fn changes_are_told_in_words() {
        let words: Vec<String> = changes().iter().map(Change::to_string).collect();
        assert_eq!(words.len(), 24);
        assert_eq!(words[0], "unchanged");
        assert!(words.contains(&"mirrored, turned by 90 degrees to the right".to_owned()));
        assert!(words.contains(&"turned upside down".to_owned()));
        assert!(words.contains(&"moved 0.5 pixel left".to_owned()));
    }
}
