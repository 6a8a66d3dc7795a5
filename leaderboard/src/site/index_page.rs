//! The first page: the best view, every protocol with its methods class by class and by rank, their
//! cost, the scenes.

use std::collections::BTreeSet;

use maud::{Markup, html};

use super::{
    SceneViews, SiteRequest, downloads, html_table, layout, layout::Place, method_cards, panorama,
    protocol, run_time, scene_cards, scene_page, standings,
};
use crate::{
    error::LeaderboardError,
    format,
    group::Group,
    layouts::{LAYOUTS, main_methods, order_in_words, ranked_by, remarks_of, standings},
};

pub(super) fn render(
    request: &SiteRequest<'_>,
    views: &SceneViews,
) -> Result<Markup, LeaderboardError> {
    let mut sections = Vec::new();
    for (number, group) in request.groups.iter().enumerate() {
        sections.push(section(request, group, &format!("p{number}"))?);
    }
    let scenes: BTreeSet<&str> = request
        .groups
        .iter()
        .flat_map(|group| group.scenes.iter().copied())
        .collect();
    let methods: BTreeSet<&str> = (request.groups.iter())
        .flat_map(|group| main_methods(group).into_iter().map(|method| method.method))
        .collect();
    let content = html! {
        p.lead {
            (format::counted(methods.len(), "method")) " on "
            (format::counted(scenes.len(), "scene"))
            ", scored on withheld views. Methods that train on each scene and methods that do not are ranked \
             apart; so are protocols."
        }
        div.opening {
            (best_view(request, views))
            div.start { (downloads::section(request)) }
        }
        @if request.groups.len() > 1 {
            nav.protocols aria-label="Protocols" {
                @for (number, group) in request.groups.iter().enumerate() {
                    a href={ "#p" (number) } { (group.protocol) }
                }
                a href="#scenes" { "Scenes" }
            }
        }
        @for section in &sections { (section) }
        @if !request.assets.is_empty() {
            section #assets {
                h2 { "Assets for web viewers" }
                @for (part, table) in request.assets.iter().enumerate() {
                    (html_table::plain(table, &format!("assets-{part}")))
                }
            }
        }
        (scene_cards::render(request, views, &scenes))
        (method_cards::render(request.cards, request.verifications))
    };
    Ok(layout::page(
        request,
        Place::Index,
        "Scores of 360° reconstruction",
        content,
    ))
}

/// Returns a whole view by the first method of the first protocol that has one, never enlarged.
fn best_view(request: &SiteRequest<'_>, views: &SceneViews) -> Markup {
    let found = request.groups.iter().find_map(|group| {
        let index = ranked_by(group)?;
        let methods = standings(group).into_iter();
        let mut ranked =
            methods.filter_map(|method| Some((method, method.confidence[index].rank?)));
        ranked.find_map(|(method, rank)| {
            group.scenes.iter().find_map(|scene| {
                let mut images = views.get(*scene)?.images();
                let image = images.find(|image| {
                    image.method == method.method && image.protocol_hash == group.protocol_hash
                })?;
                let (of, class) = (method.ranked[index], method.class.title().to_lowercase());
                Some((*scene, format!("rank {rank} of {of}, {class}"), image))
            })
        })
    });
    html! {
        @if let Some((scene, standing, image)) = found {
            (panorama::hero(image, scene, &standing))
        }
    }
}

fn title(group: &Group<'_>) -> Markup {
    html! { "Protocol " (group.protocol) " " small { code { (group.short_hash()) } } }
}

fn section(
    request: &SiteRequest<'_>,
    group: &Group<'_>,
    id: &str,
) -> Result<Markup, LeaderboardError> {
    let first = standings::render(request, group, &format!("{id}-methods"));
    let shown = first.is_some();
    let layouts = LAYOUTS
        .iter()
        .filter(|layout| !(shown && layout.is_in_first_table));
    let tables: Vec<Markup> = layouts
        .flat_map(|layout| {
            let tables = (layout.tables)(group, request.papers);
            tables.into_iter().enumerate().map(move |(part, table)| {
                html_table::plain(&table, &format!("{id}-{}-{part}", layout.id))
            })
        })
        .collect();
    Ok(html! {
        section #(id) {
            h2 { (title(group)) }
            (scene_page::warning_box(&remarks_of(group)))
            div.board {
                @if let Some(table) = first {
                    div {
                        p { "Methods of a class " (order_in_words(group)) "." }
                        (table)
                    }
                }
                div {
                    (run_time::of_group(request, group)?)
                    (protocol::explained(request.protocols.get(group.protocol_hash)))
                }
            }
            @if !tables.is_empty() {
                details.tables open[!shown] {
                    summary { "Further tables (" (tables.len()) ")" }
                    @for table in &tables { (table) }
                }
            }
        }
    })
}
