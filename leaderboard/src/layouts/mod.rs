//! The layouts of the papers' tables. [`assets`] belong to no protocol and have tables of their own.
//!
//! To add one: a file with a function that makes its tables, and a row in [`LAYOUTS`]. The row gives it files, a
//! section of the site and, where a paper prints it, the numbers of the paper ([`PublishedLayout`]).

mod ablation;
pub(crate) mod assets;
mod by_place;
mod by_scene;
mod feed_forward;
mod fidelity;
mod input_ablation;
mod objects;
mod order;
mod temporal;
mod views;
mod whole_images;

use std::collections::BTreeSet;

use crate::{
    aids,
    budget::{has_unusual_budget, usual_iterations},
    class::MethodClass,
    format::{self, PUBLISHED_LPIPS},
    group::{Group, MethodRow},
    published::{ANCHORS, Paper, PublishedLayout},
    quantity::{Quantity, ViewKind},
    remarks::Remarks,
    repeats,
    table::{Column, ColumnContent, Mark, Row, STATED_MARK, Table, mark_standings},
};

pub(crate) use by_scene::{REGION_METRICS, table as all_results};
pub(crate) use order::{best_first, order_in_words, ranked_by, standings};

pub(crate) struct Layout {
    /// Name of its files, and of its section on the site.
    pub(crate) id: &'static str,
    /// True if its numbers are in the first table of a protocol on the site: its own tables are shown where that
    /// table is missing.
    pub(crate) is_in_first_table: bool,
    /// Makes its tables; none if the results do not call for them.
    pub(crate) tables: fn(&Group<'_>, &[Paper]) -> Vec<Table>,
}

/// All layouts, in the order of the site.
pub(crate) const LAYOUTS: &[Layout] = &[
    Layout {
        id: "views",
        is_in_first_table: true,
        tables: views::tables,
    },
    Layout {
        id: "feed-forward",
        is_in_first_table: true,
        tables: feed_forward::tables,
    },
    Layout {
        id: "dynamic-scenes",
        is_in_first_table: false,
        tables: by_place::all_metrics,
    },
    Layout {
        id: "4dgs",
        is_in_first_table: false,
        tables: by_place::psnr_alone,
    },
    Layout {
        id: "ablation",
        is_in_first_table: false,
        tables: ablation::tables,
    },
    Layout {
        id: "whole-images",
        is_in_first_table: false,
        tables: whole_images::tables,
    },
    Layout {
        id: "objects",
        is_in_first_table: false,
        tables: objects::tables,
    },
    Layout {
        id: "consistency-over-time",
        is_in_first_table: false,
        tables: temporal::tables,
    },
    Layout {
        id: "ablation-of-input-views",
        is_in_first_table: false,
        tables: input_ablation::tables,
    },
];

/// Returns the published tables that the methods of a protocol are shown with.
pub(crate) fn published_layout(protocol: &str) -> PublishedLayout {
    [feed_forward::PUBLISHED, ANCHORS]
        .into_iter()
        .find(|layout| layout.is_of(protocol))
        .unwrap_or(views::PUBLISHED)
}

/// Returns the methods without variants.
pub(crate) fn main_methods<'g, 'a>(group: &'g Group<'a>) -> Vec<&'g MethodRow<'a>> {
    let methods = group.methods.iter();
    methods.filter(|method| method.whole.is_none()).collect()
}

/// Marks the best of every class: methods of different classes have different inputs.
pub(crate) fn mark_classes(
    rows: &mut [Row],
    contestants: &[(MethodClass, bool)],
    columns: &[Column],
) {
    let directions: Vec<_> = columns.iter().map(|column| column.direction).collect();
    let classes: BTreeSet<MethodClass> = contestants.iter().map(|&(class, _)| class).collect();
    for class in classes {
        let competes = contestants
            .iter()
            .map(|&(other, complete)| complete && other == class);
        mark_standings(rows.iter_mut().zip(competes), &directions);
    }
}

/// Metrics of the published tables that the group scores for a kind of view: indices of its
/// quantities. LPIPS of different networks are different metrics and all shown.
pub(crate) fn published_metrics(group: &Group<'_>, kind: ViewKind) -> Vec<usize> {
    let in_order = |metric: &str| match metric {
        "psnr" => Some(0),
        "ssim" => Some(1),
        other => (other == PUBLISHED_LPIPS || other.starts_with("lpips-")).then_some(2),
    };
    let mut found: Vec<(usize, usize)> = group
        .quantities
        .iter()
        .enumerate()
        .filter(|(_, (quantity, _))| quantity.kind == kind)
        .filter_map(|(index, (quantity, _))| Some((in_order(&quantity.metric)?, index)))
        .collect();
    found.sort_unstable();
    found.into_iter().map(|(_, index)| index).collect()
}

/// Returns the column of published LPIPS scores, beside the measured variants.
pub(crate) fn published_lpips(kind: ViewKind, with_kind: bool) -> Column {
    Column {
        group: with_kind.then(|| format::kind_title(kind)),
        name: format::metric_title(PUBLISHED_LPIPS),
        direction: Some(omnilife_schemas::records::Direction::LowerIsBetter),
        holds: ColumnContent::Score(Quantity {
            kind,
            metric: PUBLISHED_LPIPS.to_owned(),
        }),
        missing: Some(
            "papers do not say which LPIPS they printed: measured scores stand under the variant"
                .to_owned(),
        ),
    }
}

/// Returns notes under every table of means: facts to know before any score, then the origin of the numbers.
pub(crate) fn common_notes(group: &Group<'_>, of_equal_weight: &str) -> Vec<String> {
    let places: BTreeSet<&str> = group
        .scenes
        .iter()
        .map(|scene| crate::group::place(scene))
        .collect();
    let mut notes: Vec<String> = remarks_of(group).serious().cloned().collect();
    notes.push(format!(
        "Protocol {} ({}), {} from {}, every {of_equal_weight} with the same weight; seeds of one \
         scene are averaged first. Bold: best of at least two complete methods of a class; second \
         best of at least three: italic or underlined; after rounding.",
        group.protocol,
        group.short_hash(),
        format::counted(group.scenes.len(), "scene"),
        format::counted(places.len(), "video"),
    ));
    notes.extend(mark_notes(group));
    notes.extend(repeats::warnings(group));
    notes.extend(aids::warning(group));
    notes.extend(aids::note(group));
    notes.extend(class_note(group));
    notes.push(if places.len() < 2 {
        "No intervals: they need scenes of at least two videos.".to_owned()
    } else {
        let few = if places.len() < omnilife_schemas::bootstrap::FEW_VIDEOS {
            " So few videos make them too narrow."
        } else {
            ""
        };
        format!(
            "In brackets: 95 % interval of the mean, and of the rank among complete methods of \
             the class, from {} draws of videos with replacement.{few}",
            omnilife_schemas::bootstrap::RESAMPLES
        )
    });
    notes
}

pub(crate) fn remarks_of(group: &Group<'_>) -> Remarks {
    let rows: Vec<_> = group.scene_rows.iter().collect();
    Remarks::of(&rows)
}

/// Returns the meanings of the marks of rows and numbers, if there are any.
pub(crate) fn mark_notes(group: &Group<'_>) -> Vec<String> {
    let numbers = || group.scene_rows.iter().map(|row| &row.numbers);
    let mut notes = Vec::new();
    if numbers().any(|numbers| numbers.suspect) {
        let (symbol, meaning) = (Mark::Suspect.symbol(), Mark::Suspect.meaning());
        notes.push(format!("{symbol} {meaning}."));
    }
    if numbers().any(|numbers| !numbers.complete) {
        let (symbol, meaning) = (Mark::Incomplete.symbol(), Mark::Incomplete.meaning());
        notes.push(format!(
            "{symbol} {meaning}: not ranked, not compared and in no mean. Methods that lack a scene \
             are not ranked either."
        ));
    }
    if numbers().any(|numbers| numbers.partial) {
        let (symbol, meaning) = (Mark::Partial.symbol(), Mark::Partial.meaning());
        notes.push(format!(
            "{symbol} {meaning}: a method with such a result is not ranked."
        ));
    }
    if numbers().any(|numbers| !numbers.stated.is_empty()) {
        notes.push(format!(
            "{STATED_MARK} As the authors state, not measured here."
        ));
    }
    if numbers().any(|numbers| numbers.clocks().is_some()) {
        notes.push(
            "Training times are wall-clock times, but where CPU or GPU stands behind them: those \
             are times of that clock."
                .to_owned(),
        );
    }
    notes
}

/// Explains the marks of other classes and budgets, if there are several.
fn class_note(group: &Group<'_>) -> Option<String> {
    let methods = main_methods(group);
    let classes: BTreeSet<MethodClass> = methods.iter().map(|method| method.class).collect();
    let usual = usual_iterations(&methods);
    let unusual = |method: &&MethodRow<'_>| has_unusual_budget(method, &usual);
    let mut sentences = Vec::new();
    if classes.len() > 1 {
        sentences.push(
            "Ranks, best and second best are within a class: methods that train a model of each scene \
             and methods that learn nothing of it are not compared."
                .to_owned(),
        );
    }
    if methods.iter().any(unusual) {
        let budgets: Vec<String> = (usual.iter())
            .map(|(class, &iterations)| {
                let iterations = format::grouped(iterations as f64);
                format!("{iterations} ({})", class.title().to_lowercase())
            })
            .collect();
        sentences.push(format!(
            "{} Trained for other iterations than the usual {}: ranks do not correct for \
             that.",
            Mark::OtherBudget.symbol(),
            budgets.join(", ")
        ));
    }
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

/// Returns the numbers of omitted variants and metrics, and their places.
fn left_out(group: &Group<'_>) -> Vec<String> {
    let shown: Vec<usize> = ViewKind::ALL
        .into_iter()
        .flat_map(|kind| published_metrics(group, kind))
        .collect();
    let others: BTreeSet<&str> = group
        .quantities
        .iter()
        .enumerate()
        .filter(|(index, _)| !shown.contains(index))
        .map(|(_, (quantity, _))| quantity.metric.as_str())
        .collect();
    let mut notes = Vec::from_iter(variants_note(group));
    if !others.is_empty() {
        let others: Vec<&str> = others.into_iter().collect();
        notes.push(format!("In table.csv alone: {}.", others.join(", ")));
    }
    notes
}

/// Returns the number of omitted variants, and their place.
pub(crate) fn variants_note(group: &Group<'_>) -> Option<String> {
    let variants = group.methods.len() - main_methods(group).len();
    let stand = if variants == 1 { "stands" } else { "stand" };
    (variants > 0).then(|| {
        format!(
            "{} {stand} in the table of the ablation.",
            format::counted(variants, "variant")
        )
    })
}
