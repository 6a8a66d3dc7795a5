//! Representative subset of a dataset: the sequences of every class in proportion to its share, in all properties at
//! once.
//!
//! Sequences are taken one after another: each time the one that brings the counts of all classes nearest to their
//! shares (the sum of squared differences). Then pairs are exchanged as long as that brings them nearer. Ties go to the
//! source video with the fewest sequences so far, then to the first in a shuffled order.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    layout::DATASET_FILE,
    plain_text::{counted, serialize_for_spreadsheet},
    progress::Progress,
    records::{Dataset, ValidationStatus},
    stage::StagePlan,
    store,
};
use rand::{SeedableRng, seq::SliceRandom};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;

use super::statistics::{DISTRIBUTIONS, Distribution, SequenceRow, Statistics, status_name, table};
use crate::error::CurateError;

/// Table of the selected sequences.
const SEQUENCES_FILE: &str = "sequences.csv";
/// Table of the shares of all classes, in the whole and in the subset.
const COMPARISON_FILE: &str = "comparison.csv";

/// Parameters of a selection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SelectRequest {
    /// Number of sequences.
    pub count: usize,
    /// Properties whose classes keep their shares; see [`properties`].
    pub stratify: Vec<String>,
    /// Seed for ties.
    pub seed: u64,
    /// Excludes sequences without valid poses.
    pub posed_only: bool,
}

/// A subset and its comparison to the whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// The selected sequences, in the dataset's order.
    pub rows: Vec<SequenceRow>,
    /// Number of sequences to select from.
    pub candidates: usize,
    /// For every property by which a dataset is counted, the distance of the shares: half of the sum of their
    /// differences, 0 for equal ones and 1 for disjoint ones.
    pub distances: Vec<(&'static str, f64)>,
    comparison: Vec<ComparisonRow>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ComparisonRow {
    property: &'static str,
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    class: String,
    whole_sequences: usize,
    whole_share: f64,
    subset_sequences: usize,
    subset_share: f64,
}

/// Names of the properties that sequences can be stratified by.
pub fn properties() -> impl Iterator<Item = &'static str> {
    DISTRIBUTIONS.iter().map(|distribution| distribution.id)
}

/// Selects sequences of the dataset in `folder`, and writes both tables into `out`.
///
/// # Errors
/// For an unknown property, more sequences than there are, a dataset that cannot be read, and a foreign file in the
/// way.
pub fn select(
    folder: &Path,
    request: &SelectRequest,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Selection, CurateError> {
    let dataset: Dataset = store::read_record(&folder.join(DATASET_FILE))?;
    let statistics = Statistics::collect(folder, &dataset)?;
    let selection =
        choose(&statistics.rows, request).map_err(|reason| CurateError::input(folder, reason))?;
    let stage = StagePlan::new(out, "select");
    stage.run([SEQUENCES_FILE, COMPARISON_FILE], progress, |made| {
        made.write_bytes(SEQUENCES_FILE, table(&selection.rows)?.as_bytes())?;
        made.write_bytes(COMPARISON_FILE, table(&selection.comparison)?.as_bytes())?;
        Ok(selection)
    })
}

/// # Errors
/// The reason why the request cannot be met, in one line.
fn choose(rows: &[SequenceRow], request: &SelectRequest) -> Result<Selection, String> {
    let chosen: Result<Vec<&Distribution>, String> = request
        .stratify
        .iter()
        .map(|name| {
            let found = DISTRIBUTIONS
                .iter()
                .find(|distribution| distribution.id == name);
            found.ok_or_else(|| {
                let known: Vec<&str> = properties().collect();
                format!(
                    "has no property {name}; its sequences have {}",
                    known.join(", ")
                )
            })
        })
        .collect();
    let valid = status_name(ValidationStatus::Valid);
    let candidates: Vec<&SequenceRow> = rows
        .iter()
        .filter(|row| !request.posed_only || row.poses == valid)
        .collect();
    if request.count == 0 || request.count > candidates.len() {
        let posed = if request.posed_only {
            " with valid poses"
        } else {
            ""
        };
        return Err(format!(
            "has {}{posed} to select {} from",
            counted(candidates.len(), "sequence"),
            request.count
        ));
    }
    let mut balance = Balance::new(&candidates, &chosen?, request);
    balance.fill(request.count);
    balance.exchange();
    let subset: Vec<&SequenceRow> = (0..candidates.len())
        .filter(|&index| balance.is_taken[index])
        .map(|index| candidates[index])
        .collect();
    Ok(compared(&candidates, &subset))
}

/// Counts of classes on the way to their targets.
struct Balance<'a> {
    rows: &'a [&'a SequenceRow],
    /// For every sequence the numbers of its classes, over all properties.
    classes: Vec<Vec<usize>>,
    /// Target counts of every class.
    targets: Vec<f64>,
    counts: Vec<f64>,
    /// Order of ties.
    shuffled: Vec<usize>,
    is_taken: Vec<bool>,
    from_source: BTreeMap<&'a str, usize>,
}

impl<'a> Balance<'a> {
    fn new(
        rows: &'a [&'a SequenceRow],
        properties: &[&Distribution],
        request: &SelectRequest,
    ) -> Self {
        let mut numbers = BTreeMap::new();
        let classes: Vec<Vec<usize>> = rows
            .iter()
            .map(|row| {
                let of_row = properties.iter().enumerate();
                of_row
                    .map(|(property, distribution)| {
                        let next = numbers.len();
                        *numbers
                            .entry((property, (distribution.class)(row)))
                            .or_insert(next)
                    })
                    .collect()
            })
            .collect();
        let share = request.count as f64 / rows.len() as f64;
        let mut targets = vec![0.0; numbers.len()];
        for &class in classes.iter().flatten() {
            targets[class] += share;
        }
        let mut shuffled: Vec<usize> = (0..rows.len()).collect();
        shuffled.shuffle(&mut Pcg64Mcg::seed_from_u64(request.seed));
        Self {
            rows,
            counts: vec![0.0; targets.len()],
            classes,
            targets,
            shuffled,
            is_taken: vec![false; rows.len()],
            from_source: BTreeMap::new(),
        }
    }

    /// Returns the change of the sum of squared differences if a class has `change` more.
    fn gain(&self, index: usize, change: f64) -> f64 {
        let of_class =
            |&class: &usize| change * (2.0 * (self.counts[class] - self.targets[class]) + change);
        self.classes[index].iter().map(of_class).sum()
    }

    fn count_of_source(&self, index: usize) -> usize {
        let source = self.rows[index].source.as_str();
        self.from_source.get(source).copied().unwrap_or(0)
    }

    fn change(&mut self, index: usize, is_taken: bool) {
        let change = if is_taken { 1.0 } else { -1.0 };
        for &class in &self.classes[index] {
            self.counts[class] += change;
        }
        let source = self
            .from_source
            .entry(&self.rows[index].source)
            .or_insert(0);
        *source = if is_taken {
            *source + 1
        } else {
            source.saturating_sub(1)
        };
        self.is_taken[index] = is_taken;
    }

    fn fill(&mut self, count: usize) {
        for _ in 0..count {
            let free = self
                .shuffled
                .iter()
                .copied()
                .filter(|&index| !self.is_taken[index]);
            let best = free.min_by(|&a, &b| {
                let by_balance = self.gain(a, 1.0).total_cmp(&self.gain(b, 1.0));
                by_balance.then_with(|| self.count_of_source(a).cmp(&self.count_of_source(b)))
            });
            if let Some(index) = best {
                self.change(index, true);
            }
        }
    }

    /// Exchanges pairs while that brings the counts nearer to their targets.
    fn exchange(&mut self) {
        for out in self.shuffled.clone() {
            if !self.is_taken[out] {
                continue;
            }
            let lost = self.gain(out, -1.0);
            self.change(out, false);
            let free = self
                .shuffled
                .iter()
                .copied()
                .filter(|&index| !self.is_taken[index]);
            let best = free.min_by(|&a, &b| self.gain(a, 1.0).total_cmp(&self.gain(b, 1.0)));
            let better = best.filter(|&index| lost + self.gain(index, 1.0) < -1e-9);
            self.change(better.unwrap_or(out), true);
        }
    }
}

fn compared(whole: &[&SequenceRow], subset: &[&SequenceRow]) -> Selection {
    let mut comparison = Vec::new();
    let mut distances = Vec::new();
    for distribution in DISTRIBUTIONS {
        let mut classes: BTreeMap<String, [usize; 2]> = BTreeMap::new();
        for (rows, at) in [(whole, 0), (subset, 1)] {
            for row in rows {
                classes.entry((distribution.class)(row)).or_default()[at] += 1;
            }
        }
        let mut apart = 0.0;
        for (class, [in_whole, in_subset]) in classes {
            let whole_share = in_whole as f64 / whole.len() as f64;
            let subset_share = in_subset as f64 / subset.len() as f64;
            apart += 0.5 * (whole_share - subset_share).abs();
            comparison.push(ComparisonRow {
                property: distribution.id,
                class,
                whole_sequences: in_whole,
                whole_share,
                subset_sequences: in_subset,
                subset_share,
            });
        }
        distances.push((distribution.id, apart));
    }
    Selection {
        rows: subset.iter().map(|&row| row.clone()).collect(),
        candidates: whole.len(),
        distances,
        comparison,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(index: usize, scene: &str, motion: &str) -> SequenceRow {
        SequenceRow {
            sequence: format!("{index}"),
            folder: format!("videos/{index}"),
            source: format!("{}.mp4", index / 10),
            begin_seconds: 0.0,
            end_seconds: 20.0,
            duration_seconds: 20.0,
            source_width: 2,
            source_height: 1,
            frames: 1,
            group: "outdoor".to_owned(),
            scene: scene.to_owned(),
            action: "walking".to_owned(),
            ego_motion: motion.to_owned(),
            dynamics: "none".to_owned(),
            posed_frames: 1,
            poses: if index.is_multiple_of(2) {
                "valid"
            } else {
                "unstable"
            }
            .to_owned(),
        }
    }

    fn request(count: usize, seed: u64) -> SelectRequest {
        SelectRequest {
            count,
            stratify: vec!["scene".to_owned(), "ego-motion".to_owned()],
            seed,
            posed_only: false,
        }
    }

    /// Returns 200 sequences: scenes 60, 30 and 10 %, motions half each, rare scenes with one motion alone.
    fn rows() -> Vec<SequenceRow> {
        (0..200)
            .map(|index| {
                let scene = ["street", "street", "park", "street", "park"][index % 5];
                let is_rare = index % 10 == 9;
                let motion = if is_rare || index % 4 < 2 {
                    "fast"
                } else {
                    "slow"
                };
                row(index, if is_rare { "reef" } else { scene }, motion)
            })
            .collect()
    }

    #[test]
    fn a_subset_has_the_shares_of_the_whole_to_within_one_sequence() {
        for (count, seed) in [(10, 0), (37, 1), (111, 2)] {
            let rows = rows();
            let found = choose(&rows, &request(count, seed)).expect("enough");
            assert_eq!(found.rows.len(), count);
            for class in &found.comparison {
                if ["scene", "ego-motion"].contains(&class.property) {
                    let target = class.whole_share * count as f64;
                    let error = (class.subset_sequences as f64 - target).abs();
                    assert!(error < 1.0, "{count}: {class:?}");
                }
            }
            let same = choose(&rows, &request(count, seed)).expect("enough");
            assert_eq!(found, same);
            let other = choose(&rows, &request(count, seed + 10)).expect("enough");
            assert_ne!(found.rows, other.rows);
        }
    }

    #[test]
    fn what_cannot_be_selected_is_said() {
        let rows = rows();
        let refused = |request: &SelectRequest| choose(&rows, request).map(drop).expect_err("odd");
        assert!(refused(&request(201, 0)).contains("200 sequences to select 201"));
        assert!(refused(&request(0, 0)).contains("to select 0"));
        let weather = SelectRequest {
            stratify: vec!["weather".to_owned()],
            ..request(5, 0)
        };
        assert!(refused(&weather).contains("no property weather"));
        let posed = SelectRequest {
            posed_only: true,
            ..request(101, 0)
        };
        assert!(refused(&posed).contains("100 sequences"));
    }
}
