//! The scenes, each with a view, its description and the best method of every class on it.

use std::collections::BTreeSet;

use maud::{Markup, html};
use omnilife_results::SceneFacts;

use super::{SceneViews, SiteRequest, comparisons::ComparisonImage, scene_file};
use crate::{
    format,
    group::SceneRow,
    layouts::{best_first, ranked_by},
    quantity::ViewKind,
};

/// Number of scenes above which the cards have no views: the page would load as many images.
const MOST_VIEWS: usize = 200;

pub(super) fn render(
    request: &SiteRequest<'_>,
    views: &SceneViews,
    scenes: &BTreeSet<&str>,
) -> Markup {
    html! {
        h2 #scenes { "Scenes" }
        ul.cards {
            @for scene in scenes {
                @let images = views.get(*scene).filter(|_| scenes.len() <= MOST_VIEWS);
                li {
                    a href=(scene_file(scene)) {
                        @match images.and_then(|images| images.images().next()) {
                            Some(image) => (thumbnail(image, scene)),
                            None => span.thumbnail.none aria-hidden="true" {},
                        }
                        b { (scene) }
                    }
                    p { (facts(request.surroundings.facts.get(*scene))) }
                    p { (best(request, scene)) }
                }
            }
        }
    }
}

/// Returns the ground truth of a view, as wide as the card.
fn thumbnail(image: &ComparisonImage, scene: &str) -> Markup {
    let [width, height] = image.half;
    let style = format!(
        "--half-width: {width}; --half-height: {height}; --width-ratio: {:.6}; --truth-offset: {:.6}",
        image.width_ratio(),
        image.truth_offset()
    );
    html! {
        span.thumbnail style=(style) {
            img src={ "scenes/" (image.file) } alt={ "Part of " (scene) } loading="lazy";
        }
    }
}

fn facts(facts: Option<&SceneFacts>) -> Markup {
    let Some(facts) = facts else {
        return html! {};
    };
    let mut parts = Vec::new();
    parts.extend(facts.category.clone());
    parts.extend(
        facts
            .duration_seconds
            .map(|seconds| format!("{seconds:.1} s")),
    );
    parts.extend(
        facts
            .ego_motion
            .as_ref()
            .map(|class| format!("camera motion {class}")),
    );
    html! { (parts.join(", ")) }
}

/// Returns the number of views, and the best of every class under the first protocol with complete scores of the scene.
fn best(request: &SiteRequest<'_>, scene: &str) -> Markup {
    let found = request.groups.iter().find_map(|group| {
        let index = ranked_by(group)?;
        let rows = group.rows_in(scene).iter();
        let scored =
            rows.filter(|row| row.numbers.are_whole() && row.numbers.scores[index].is_some());
        let mut scored: Vec<&SceneRow<'_>> = scored.collect();
        let best_first = best_first(group);
        scored.sort_by(|a, b| {
            let by_class = a.class.cmp(&b.class);
            by_class.then_with(|| best_first(&a.numbers, &b.numbers))
        });
        scored.dedup_by_key(|row| row.class);
        (!scored.is_empty()).then_some((index, scored))
    });
    html! {
        @if let Some((index, best)) = found {
            @let scores = best.iter().flat_map(|row| ViewKind::Novel.scores(row.results[0]).values());
            @let views = scores.map(|summary| summary.views).max().unwrap_or(0);
            (format::counted(views as usize, "novel view"))
            @for row in best {
                "; " (row.class.title().to_lowercase()) ": " (row.method) ", "
                (format!("{:.2}", row.numbers.scores[index].unwrap_or_default())) " dB"
            }
        }
    }
}
