//! The page of a method: its paper, components and options, its card, its standing, its scores on every scene, its
//! curves and records.

use std::collections::BTreeSet;

use maud::{Markup, html};
use omnilife_schemas::records::ResultRecord;

use super::{
    SceneViews, SiteRequest,
    html_table::{self, Addition, RowAddition},
    layout,
    layout::Place,
    method_cards, method_facts, panorama, run_time, scene_file, scene_page, unique_slug,
};
use crate::{
    budget,
    class::MethodClass,
    description::MethodDescription,
    error::LeaderboardError,
    format,
    group::{Group, MethodRow, SceneRow},
    layouts::ranked_by,
    remarks::Remarks,
};

/// Returns a method's page relative to the site.
pub(super) fn file(method: &str) -> String {
    format!("methods/{}.html", unique_slug(method))
}

pub(super) fn render(
    request: &SiteRequest<'_>,
    method: &str,
    views: &SceneViews,
) -> Result<Markup, LeaderboardError> {
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
    let groups = request.groups.iter();
    let rows: Vec<_> = groups.flat_map(|group| group.rows_of(method)).collect();
    let described = method_facts::of(request.descriptions, method, &rows);
    let content = html! {
        p { a href="../index.html" { "All methods" } }
        @if let Some(described) = described { (method_facts::sentence(described, method)) }
        @for card in cards { (method_cards::block(card, request.verifications.get(method), true)) }
        div.opening {
            (picture(method, views))
            div.start { (facts(&rows, described)) }
        }
        @if let Some(described) = described { (method_facts::details(described)) }
        @for section in &sections { (section) }
    };
    Ok(layout::page(request, Place::Method, method, content))
}

/// Returns paper, code and machines of the runs, from descriptions, records or statements of authors.
fn facts(rows: &[&SceneRow<'_>], described: Option<&MethodDescription>) -> Markup {
    let results = || rows.iter().flat_map(|row| row.results.iter().copied());
    let machines: BTreeSet<String> = results().filter_map(scene_page::machine).collect();
    let machines: Vec<String> = machines.into_iter().collect();
    let codes: BTreeSet<&str> = results()
        .filter_map(|result| result.statement.as_ref()?.code.as_deref())
        .collect();
    html! {
        @if !machines.is_empty() || !codes.is_empty() || described.is_some() {
            dl {
                @if let Some(described) = described { (method_facts::facts(described)) }
                @if !machines.is_empty() {
                    dt { "Machines" }
                    dd { (machines.join("; ")) }
                }
                @for &code in &codes {
                    dt { "Code" }
                    dd { (method_cards::code(Some(code))) }
                }
            }
        }
    }
}

/// Returns its first view on the site.
fn picture(method: &str, views: &SceneViews) -> Markup {
    let found = views.iter().find_map(|(scene, found)| {
        let mut images = found.images();
        Some((scene, images.find(|image| image.method == method)?))
    });
    html! {
        @if let Some((scene, image)) = found {
            (panorama::whole(image, "../scenes/", &html! {
                span { (image.view) " of " a href={ "../" (scene_file(scene)) } { (scene) } }
            }))
        }
    }
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
    let rows: Vec<_> = group.rows_of(method.method).collect();
    let remarks = Remarks::of(&rows);
    let table = scene_page::table(
        group,
        "Scores on every scene, by scene",
        "Scene",
        &runs,
        false,
    );
    let of_row = |at: usize| {
        let (scene, _, result) = runs[at];
        RowAddition {
            page: Some(format!("../{}", scene_file(scene))),
            detail: result.why_incomplete(),
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
        (scene_page::warning_box(&remarks))
        div.board {
            div {
                (html_table::render(&table, &Addition {
                    id: &format!("m{number}"),
                    first_columns: Some(scene_page::first_columns(group)),
                    of_row: &of_row,
                    is_ranking: false,
                }))
            }
            @if method.class != MethodClass::WithoutTraining {
                div {
                    h3 { "Error against run time" }
                    (run_time::of_results(request, &title, &curves)?)
                }
            }
        }
        (scene_page::other_warnings(&remarks))
    })
}

/// Returns class, budget and rank in a sentence.
fn standing(group: &Group<'_>, method: &MethodRow<'_>) -> Markup {
    let rank = ranked_by(group)
        .and_then(|index| Some((method.confidence[index].rank?, method.ranked[index])));
    let rows = || group.rows_of(method.method);
    let complete = rows().filter(|row| row.numbers.complete).count();
    let has_result = |scene: &str| rows().any(|row| row.scene == scene);
    let missing = group.scenes.iter().copied();
    let missing: Vec<&str> = missing.filter(|scene| !has_result(scene)).collect();
    html! {
        "Class: " (method.class.title().to_lowercase())
        @if let Some(iterations) = budget::iterations(method).filter(|&count| count > 0) {
            ", " (format::counted(iterations as usize, "iteration"))
        }
        ". "
        @match rank {
            Some((rank, of)) => {
                "Rank " b { (rank) } " of " (of) " in its class by novel PSNR, over "
                (format::counted(method.scenes, "scene")) "."
            }
            None if method.whole.is_some() => "A variant of another method, which is not ranked.",
            None if method.complete => "Not ranked: its novel views have no PSNR.",
            None => {
                @if method.numbers.partial {
                    "Not ranked: metrics of the protocol were left out for a quick look."
                } @else {
                    "Not ranked: it has complete results of " (complete) " of "
                    (format::counted(group.scenes.len(), "scene")) "."
                }
                @if !missing.is_empty() { " Without a result: " (missing.join(", ")) "." }
            }
        }
    }
}
