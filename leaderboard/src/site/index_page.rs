//! The first page: every protocol with its tables, its cost and its scenes.

use maud::{Markup, html};

use omnilife_schemas::records::Direction;

use super::{
    SiteRequest, chart, chart::Point, html_table, layout, layout::Place, method_cards, methods,
    protocol, scene_file,
};
use crate::{
    error::LeaderboardError,
    group::{Group, ViewKind},
    layouts::{LAYOUTS, main_methods},
};

/// The metric of the chart of error against run time.
const ERROR_METRIC: &str = "psnr";

pub(super) fn render(request: &SiteRequest<'_>) -> Result<Markup, LeaderboardError> {
    let mut sections = Vec::new();
    for (number, group) in request.groups.iter().enumerate() {
        sections.push(section(request, group, &format!("p{number}"))?);
    }
    let scenes: std::collections::BTreeSet<&str> = request
        .groups
        .iter()
        .flat_map(|group| group.scenes.iter().copied())
        .collect();
    let content = html! {
        p.lead {
            (methods(request.groups).len()) " methods on " (scenes.len())
            " scenes. Scores of different protocols are never in one table; published figures \
             stand below measured ones and take no part in any ranking."
        }
        @if request.groups.len() > 1 {
            nav aria-label="Protocols" { ul {
                @for (number, group) in request.groups.iter().enumerate() {
                    li { a href={ "#p" (number) } { (title(group)) } }
                }
            } }
        }
        @for section in &sections { (section) }
        (method_cards::render(request.cards))
    };
    Ok(layout::page(
        Place::Index,
        "Leaderboard",
        request.dataset.is_some(),
        content,
    ))
}

fn title(group: &Group<'_>) -> String {
    format!("Protocol {} ({})", group.protocol, group.short_hash())
}

fn section(
    request: &SiteRequest<'_>,
    group: &Group<'_>,
    id: &str,
) -> Result<Markup, LeaderboardError> {
    let tables: Vec<Markup> = LAYOUTS
        .iter()
        .flat_map(|layout| {
            let tables = (layout.tables)(group, request.papers);
            tables.into_iter().enumerate().map(move |(part, table)| {
                let id = format!("{id}-{}-{part}", layout.id);
                html_table::render(&table, &id, |_| None)
            })
        })
        .collect();
    Ok(html! {
        section #(id) {
            h2 { (title(group)) }
            (protocol::explained(request.protocols.get(group.protocol_hash)))
            @for table in tables.iter().take(1) { (table) }
            (error_against_run_time(group)?)
            @if tables.len() > 1 { h3 { "Further tables" } }
            @for table in tables.iter().skip(1) { (table) }
            h3 { "Scenes" }
            ul.scenes {
                @for scene in &group.scenes {
                    li { a href=(scene_file(scene)) { (scene) } }
                }
            }
        }
    })
}

/// Mean PSNR of novel views against mean training time, with the Pareto front.
fn error_against_run_time(group: &Group<'_>) -> Result<Markup, LeaderboardError> {
    let Some(index) = group.quantity(ViewKind::Novel, ERROR_METRIC) else {
        return Ok(html! {});
    };
    let mut points = Vec::new();
    let mut without = Vec::new();
    for method in main_methods(group) {
        let seconds = method
            .numbers
            .training_seconds
            .filter(|&seconds| seconds > 0.0);
        match (method.numbers.scores[index], seconds) {
            (Some(y), Some(x)) if method.complete => points.push(Point {
                label: method.method,
                x,
                y,
                description: format!("{}: {y:.3} dB after {x:.1} s of training", method.method),
                on_front: false,
            }),
            _ => without.push(method.method),
        }
    }
    mark_front(&mut points, group.quantities[index].1);
    let title = format!("Error against run time, protocol {}", group.protocol);
    let drawing = chart::scatter(
        &title,
        "Training time per scene (s), logarithmic",
        "PSNR of novel views (dB)",
        &points,
    )?;
    Ok(html! {
        h3 { "Error against run time" }
        @if points.is_empty() {
            p { "No method has both scores of all scenes and their training times." }
        } @else {
            figure {
                (drawing)
                figcaption {
                    "PSNR is the error on a logarithmic scale: higher is less error. The line joins \
                     the methods that no other beats in both. Means over scenes, on whatever machine \
                     each was trained on."
                    @if !without.is_empty() {
                        " Not shown, for want of a complete score or a training time: "
                        (shortened_list(&without)) "."
                    }
                }
            }
        }
    })
}

/// The first names of a list and how many more there are.
fn shortened_list(names: &[&str]) -> String {
    const SHOWN: usize = 12;
    let mut text = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    text
}

/// A point is on the front when none is at least as fast and at least as good, and better in one.
fn mark_front(points: &mut [Point<'_>], direction: Direction) {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let by_score = match direction {
            Direction::HigherIsBetter => points[b].y.total_cmp(&points[a].y),
            Direction::LowerIsBetter => points[a].y.total_cmp(&points[b].y),
        };
        points[a].x.total_cmp(&points[b].x).then(by_score)
    });
    let mut best: Option<(f64, f64)> = None;
    for index in order {
        let point = &mut points[index];
        point.on_front = best
            .is_none_or(|(x, y)| direction.prefers(point.y, y) || (point.y == y && point.x == x));
        if point.on_front {
            best = Some((point.x, point.y));
        }
    }
}
