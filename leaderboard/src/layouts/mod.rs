//! The layouts of the papers' tables. A new one is one file and one line in [`LAYOUTS`]; [`assets`] are of
//! no protocol and have tables of their own.

mod ablation;
pub(crate) mod assets;
mod by_place;
mod by_scene;
mod feed_forward;
mod views;

use std::collections::BTreeSet;

use crate::{
    class::{MethodClass, has_unusual_budget, usual_iterations},
    format::{self, PUBLISHED_LPIPS},
    group::{Group, MethodRow, Quantity, ViewKind},
    published::Paper,
    render::BUDGET_MARK,
    table::{Column, Holds, Row, Table, mark_standings},
};

pub(crate) use by_scene::{REGION_METRICS, remarks, table as all_results};

/// A layout.
pub(crate) struct Layout {
    /// Name of its files, and of its section on the site.
    pub(crate) id: &'static str,
    /// Makes its tables; none where the results give no reason for them.
    pub(crate) tables: fn(&Group<'_>, &[Paper]) -> Vec<Table>,
}

/// All layouts, in the order of the site.
pub(crate) const LAYOUTS: &[Layout] = &[
    Layout {
        id: "views",
        tables: views::tables,
    },
    Layout {
        id: "feed-forward",
        tables: feed_forward::tables,
    },
    Layout {
        id: "dynamic-scenes",
        tables: by_place::all_metrics,
    },
    Layout {
        id: "4dgs",
        tables: by_place::psnr_alone,
    },
    Layout {
        id: "ablation",
        tables: ablation::tables,
    },
];

/// The methods that are no variants.
pub(crate) fn main_methods<'g, 'a>(group: &'g Group<'a>) -> Vec<&'g MethodRow<'a>> {
    let methods = group.methods.iter();
    methods.filter(|method| !method.is_variant).collect()
}

/// The methods that are no variants, by class, rank and name; those without a rank come last.
pub(crate) fn standings<'g, 'a>(group: &'g Group<'a>) -> Vec<&'g MethodRow<'a>> {
    let ranked = ranked_by(group);
    let rank = |method: &MethodRow<'_>| {
        let rank = ranked.and_then(|index| method.confidence[index].rank);
        rank.unwrap_or(usize::MAX)
    };
    let mut methods = main_methods(group);
    methods.sort_by_key(|method| (method.class, rank(method), method.method));
    methods
}

/// What methods are ranked by: PSNR of novel views, the only score that all papers print.
pub(crate) fn ranked_by(group: &Group<'_>) -> Option<usize> {
    group.quantity(ViewKind::Novel, "psnr")
}

/// Marks the best of every class: methods of different classes were given different things.
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

/// The column that published LPIPS scores go to, beside the measured variants.
pub(crate) fn published_lpips(kind: ViewKind, with_kind: bool) -> Column {
    Column {
        group: with_kind.then(|| format::kind_title(kind)),
        name: format::metric_title(PUBLISHED_LPIPS),
        direction: Some(omnilife_schemas::records::Direction::LowerIsBetter),
        holds: Holds::Score(Quantity {
            kind,
            metric: PUBLISHED_LPIPS.to_owned(),
        }),
        missing: Some(
            "papers do not say which LPIPS they printed: measured scores stand under the variant"
                .to_owned(),
        ),
    }
}

/// What stands under every table of means.
pub(crate) fn common_notes(group: &Group<'_>) -> Vec<String> {
    let places: BTreeSet<&str> = group
        .scenes
        .iter()
        .map(|scene| crate::group::place(scene))
        .collect();
    let mut notes = vec![format!(
        "Protocol {} ({}), {} from {}, every scene with the same weight; seeds of one \
         scene are averaged first. Bold: best of at least two complete methods of a class; second \
         best of at least three: italic or underlined; after rounding. {FAILURE_NOTE}",
        group.protocol,
        group.short_hash(),
        format::counted(group.scenes.len(), "scene"),
        format::counted(places.len(), "video"),
    )];
    notes.extend(class_note(group));
    notes.push(if places.len() < 2 {
        "No intervals: they need scenes of at least two videos.".to_owned()
    } else {
        let few = if places.len() < FEW_VIDEOS {
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

/// How rows of other classes and budgets are told apart, where there are several.
fn class_note(group: &Group<'_>) -> Option<String> {
    let methods = main_methods(group);
    let classes: BTreeSet<MethodClass> = methods.iter().map(|method| method.class).collect();
    let usual = usual_iterations(&methods);
    let unusual = |method: &&MethodRow<'_>| has_unusual_budget(method, &usual);
    let mut sentences = Vec::new();
    if classes.len() > 1 {
        sentences.push(
            "Methods that learn from all given views of a scene and methods that learn nothing of it \
             are classes of their own: ranks, best and second best are within a class."
                .to_owned(),
        );
    }
    if methods.iter().any(unusual) {
        let budgets: Vec<String> = (usual.iter())
            .map(|(class, &iterations)| {
                let iterations = format::grouped(iterations as f64);
                format!("{iterations} ({})", class.title(group))
            })
            .collect();
        sentences.push(format!(
            "{BUDGET_MARK} Trained for other iterations than the usual {}: ranks do not correct for \
             that.",
            budgets.join(", ")
        ));
    }
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

/// Below this many clusters percentile intervals are known to be too short.
const FEW_VIDEOS: usize = 10;

const FAILURE_NOTE: &str = "† Some views could not be scored: not ranked, as are methods that lack \
                            a scene.";

/// How many variants and metrics a table leaves out, and where they are.
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

/// How many variants a table leaves out, and where they are.
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
