//! One method: its card, how it stands, what it scores on every scene, its curves and records.

use maud::{Markup, html};
use omnilife_schemas::records::ResultRecord;

use super::{
    SiteRequest,
    html_table::{self, Addition, RowAddition},
    layout,
    layout::Place,
    method_cards, run_time, scene_file, scene_page, unique_slug,
};
use crate::{
    class::{self, MethodClass},
    error::LeaderboardError,
    format,
    group::{Group, MethodRow, SceneRow},
    layouts::ranked_by,
};

/// A method's page relative to the site.
pub(super) fn file(method: &str) -> String {
    format!("methods/{}.html", unique_slug(method))
}

pub(super) fn render(request: &SiteRequest<'_>, method: &str) -> Result<Markup, LeaderboardError> {
    let cards: Vec<_> = (request.cards.iter())
        .filter(|card| card.method == method)
        .collect();
    let mut sections = Vec::new();
    for (number, group) in request.groups.iter().enumerate() {
        let mut methods = group.methods.iter();
        if let Some(found) = methods.find(|found| found.method == method) {
            sections.push(section(request, group, found, number)?);
        }
    }
    let content = html! {
        p { a href="../index.html" { "All methods" } }
        @for card in cards { (method_cards::block(card, request.verifications.get(method), true)) }
        @for section in &sections { (section) }
    };
    Ok(layout::page(request, Place::Method, method, content))
}

fn section(
    request: &SiteRequest<'_>,
    group: &Group<'_>,
    method: &MethodRow<'_>,
    number: usize,
) -> Result<Markup, LeaderboardError> {
    let runs: Vec<(&str, &SceneRow<'_>, &ResultRecord)> = (group.rows_of(method.method))
        .flat_map(|row| {
            row.results
                .iter()
                .map(move |result| (row.scene, row, *result))
        })
        .collect();
    let table = scene_page::table(group, "Scores on every scene", "Scene", &runs, false);
    let of_row = |at: usize| {
        let (scene, _, result) = runs[at];
        RowAddition {
            page: Some(format!("../{}", scene_file(scene))),
            links: request.links(result),
            ..RowAddition::default()
        }
    };
    let curves: Vec<(&str, MethodClass, &ResultRecord)> = (runs.iter())
        .map(|&(scene, row, result)| (scene, row.class, result))
        .collect();
    let title = format!("Error against run time of {} by scene", method.method);
    Ok(html! {
        h2 { "Protocol " (group.protocol) " " small { code { (group.short_hash()) } } }
        p { (standing(group, method)) }
        (html_table::render(&table, &Addition {
            id: &format!("m{number}"),
            first_columns: Some(scene_page::first_columns(group)),
            of_row: &of_row,
            is_ranking: false,
        }))
        @if method.class != MethodClass::WithoutTraining {
            h3 { "Error against run time" }
            (run_time::of_results(request, &title, &curves)?)
        }
    })
}

/// Class, budget and rank in a sentence.
fn standing(group: &Group<'_>, method: &MethodRow<'_>) -> Markup {
    let rank = ranked_by(group).and_then(|index| method.confidence[index].rank);
    let class = method.class.title(group);
    let rivals = ranked_by(group).map_or(0, |index| {
        let of_class = |other: &&MethodRow<'_>| other.class == method.class;
        let ranked = group.methods.iter().filter(of_class);
        ranked
            .filter(|other| other.confidence[index].rank.is_some())
            .count()
    });
    html! {
        "Class: " (class)
        @if let Some(iterations) = class::iterations(method).filter(|&count| count > 0) {
            ", " (format::counted(iterations as usize, "iteration"))
        }
        ". "
        @match rank {
            Some(rank) => {
                "Rank " b { (rank) } " of " (rivals) " in its class by novel PSNR, over "
                (format::counted(method.scenes, "scene")) "."
            }
            None if method.is_variant => "A variant of another method, which is not ranked.",
            None => {
                "Not ranked: it has results of " (method.scenes) " of "
                (format::counted(group.scenes.len(), "scene")) " and "
                (format::counted(method.numbers.failures, "failure")) "."
            }
        }
    }
}
