//! The scenes, each with a view, what it is and what is best on it.

use std::collections::BTreeSet;

use maud::{Markup, html};

use super::{
    SceneViews, SiteRequest, comparisons::ComparisonImage, scene_facts::SceneFacts, scene_file,
};
use crate::{format, group::ViewKind, layouts::ranked_by};

/// Above this many scenes the cards have no views: the page would load as many images.
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

/// The ground truth of a view, as wide as the card.
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

/// Views, and the best score of the first protocol that has the scene.
fn best(request: &SiteRequest<'_>, scene: &str) -> Markup {
    let found = request.groups.iter().find_map(|group| {
        let index = ranked_by(group)?;
        let direction = group.quantities[index].1;
        let scored = group
            .rows_in(scene)
            .iter()
            .filter(|row| row.numbers.failures == 0);
        let scored = scored.filter_map(|row| Some((row, row.numbers.scores[index]?)));
        scored.reduce(|best, next| {
            if direction.prefers(next.1, best.1) {
                next
            } else {
                best
            }
        })
    });
    html! {
        @if let Some((row, score)) = found {
            @let scores = ViewKind::Novel.scores(row.results[0]);
            @let views = scores.values().map(|summary| summary.views).max().unwrap_or(0);
            (format::counted(views as usize, "novel view")) "; best " (row.method) ", "
            (format!("{score:.2}")) " dB"
        }
    }
}
