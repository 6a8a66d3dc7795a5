//! The layouts of the paper's tables. A new one is one file and one line in [`LAYOUTS`].

mod ablation;
mod by_place;
mod by_scene;
mod feed_forward;
mod views;

use crate::{
    format::PUBLISHED_LPIPS,
    group::{Group, MethodRow, Quantity, ViewKind},
    published::Paper,
    table::{Column, Holds, Table},
};

pub(crate) use by_scene::{remarks, table as all_results};

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

/// Metrics of the published tables that the group scores for a kind of view: indices of its
/// quantities. LPIPS of different networks are different metrics and all shown.
fn published_metrics(group: &Group<'_>, kind: ViewKind) -> Vec<usize> {
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
fn published_lpips(kind: ViewKind, with_kind: bool) -> Column {
    Column {
        group: with_kind.then(|| crate::format::kind_title(kind)),
        name: crate::format::metric_title(PUBLISHED_LPIPS),
        direction: Some(omnilife_schemas::records::Direction::LowerIsBetter),
        holds: Holds::Score(Quantity {
            kind,
            metric: PUBLISHED_LPIPS.to_owned(),
        }),
    }
}

/// What stands under every table of means.
fn common_notes(group: &Group<'_>) -> Vec<String> {
    let places: std::collections::BTreeSet<&str> = group
        .scenes
        .iter()
        .map(|scene| crate::group::place(scene))
        .collect();
    let mut notes = vec![format!(
        "Protocol {} ({}), {} scenes from {} videos, every scene with the same weight; seeds of one \
         scene are averaged first. Bold: best of at least two complete methods; second best of at \
         least three: italic or underlined; after rounding. {FAILURE_NOTE}",
        group.protocol,
        group.short_hash(),
        group.scenes.len(),
        places.len(),
    )];
    notes.push(if places.len() < 2 {
        "No intervals: they need scenes of at least two videos.".to_owned()
    } else {
        let few = if places.len() < FEW_VIDEOS {
            " So few videos make them too narrow."
        } else {
            ""
        };
        format!(
            "In brackets: 95 % interval of the mean, and of the rank among complete methods, from \
             {} draws of videos with replacement.{few}",
            omnilife_schemas::bootstrap::RESAMPLES
        )
    });
    notes
}

/// Below this many clusters percentile intervals are known to be too short.
const FEW_VIDEOS: usize = 10;

const FAILURE_NOTE: &str = "† Some views could not be scored: not ranked, as are methods that lack \
                            a scene.";

/// How many variants and metrics a table leaves out, and where they are.
fn left_out(group: &Group<'_>) -> Vec<String> {
    let variants = group.methods.len() - main_methods(group).len();
    let shown: Vec<usize> = ViewKind::ALL
        .into_iter()
        .flat_map(|kind| published_metrics(group, kind))
        .collect();
    let others: std::collections::BTreeSet<&str> = group
        .quantities
        .iter()
        .enumerate()
        .filter(|(index, _)| !shown.contains(index))
        .map(|(_, (quantity, _))| quantity.metric.as_str())
        .collect();
    let mut notes = Vec::new();
    if variants > 0 {
        notes.push(format!(
            "{variants} variants stand in the table of the ablation."
        ));
    }
    if !others.is_empty() {
        let others: Vec<&str> = others.into_iter().collect();
        notes.push(format!("In table.csv alone: {}.", others.join(", ")));
    }
    notes
}
