//! The figures of a dataset: bars of how often each class occurs (the paper's Figure 3).

use omnilife_charts::Bar;
use omnilife_schemas::plain_text::counted;

use super::statistics::{DISTRIBUTIONS, Statistics, Tally, duration_in_words, is_annotated};
use crate::error::CurateError;

/// A figure.
#[derive(Debug, Clone, Copy)]
pub(super) struct Figure {
    /// File in the statistics folder.
    pub(super) file: &'static str,
    /// Its title.
    pub(super) title: &'static str,
    /// Id of the distribution it shows.
    pub(super) distribution: &'static str,
}

/// All figures.
const FIGURES: &[Figure] = &[
    Figure {
        file: "groups.svg",
        title: "Sequences per semantic group",
        distribution: "group",
    },
    Figure {
        file: "scenes.svg",
        title: "Sequences per scene category",
        distribution: "scene",
    },
    Figure {
        file: "actions.svg",
        title: "Sequences per action",
        distribution: "action",
    },
    Figure {
        file: "ego-motion.svg",
        title: "Sequences per ego-motion class",
        distribution: "ego-motion",
    },
    Figure {
        file: "dynamics.svg",
        title: "Sequences per level of dynamic content",
        distribution: "dynamics",
    },
    Figure {
        file: "durations.svg",
        title: "Sequences per duration",
        distribution: "duration",
    },
];

impl Figure {
    /// Returns the classes that it shows, the most frequent first.
    pub(super) fn tallies(&self, statistics: &Statistics) -> Vec<(String, Tally)> {
        DISTRIBUTIONS
            .iter()
            .find(|distribution| distribution.id == self.distribution)
            .map(|distribution| statistics.tally(distribution))
            .unwrap_or_default()
    }
}

/// Returns the figures that show classes, and those of properties that no sequence is annotated with.
pub(super) fn with_classes(
    statistics: &Statistics,
) -> (Vec<&'static Figure>, Vec<&'static Figure>) {
    FIGURES
        .iter()
        .partition(|figure| is_annotated(&figure.tallies(statistics)))
}

/// Draws a figure. Bars are shares of all sequences, so that figures can be compared.
///
/// # Errors
/// [`CurateError::Internal`] when the plotting library fails.
pub(super) fn draw(figure: &Figure, statistics: &Statistics) -> Result<String, CurateError> {
    let tallies = figure.tallies(statistics);
    let total: usize = tallies.iter().map(|(_, tally)| tally.sequences).sum();
    let seconds: f64 = tallies.iter().map(|(_, tally)| tally.seconds).sum();
    let about = format!(
        "{}, {}",
        counted(total, "sequence"),
        duration_in_words(seconds)
    );
    let bars: Vec<Bar> = tallies
        .into_iter()
        .map(|(label, tally)| {
            let share = tally.sequences as f64 / total as f64;
            Bar {
                label,
                share,
                value: format!("{} ({:.1} %)", tally.sequences, 100.0 * share),
            }
        })
        .collect();
    let text = omnilife_charts::bars(figure.title, &about, "no sequences", &bars)
        .map_err(|error| CurateError::internal(figure.file.as_ref(), error))?;
    Ok(text + "\n")
}
