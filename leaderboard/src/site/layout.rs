//! Common parts of all pages.

use std::collections::BTreeSet;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::{SiteRequest, scene_page};
use crate::format;

/// A page's place in the site.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Index,
    Dataset,
    Scene,
    Method,
}

impl Place {
    /// Returns the relative path to the first folder of the site.
    fn root(self) -> &'static str {
        match self {
            Self::Scene | Self::Method => "../",
            _ => "",
        }
    }
}

pub(super) fn page(
    request: &SiteRequest<'_>,
    place: Place,
    title: &str,
    content: Markup,
) -> Markup {
    let root = place.root();
    let link = |target: Place, file: &str, text: &str| {
        html! {
            a href={ (root) (file) } aria-current=[(target == place).then_some("page")] { (text) }
        }
    };
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) " · OmniLife360 leaderboard" }
                // No icon: otherwise browsers request a missing one.
                link rel="icon" href="data:,";
                link rel="stylesheet" href={ (root) "style.css" };
                script src={ (root) "script.js" } defer {}
            }
            body {
                a.skip href="#content" { "Skip to content" }
                header {
                    p.name { "OmniLife360 leaderboard" }
                    nav aria-label="Pages" {
                        (link(Place::Index, "index.html", "Leaderboard"))
                        @if request.dataset.is_some() {
                            (link(Place::Dataset, "dataset.html", "Dataset"))
                        }
                        @if let Some(address) = request.project {
                            a href=(address) rel="noopener noreferrer" { "Project" }
                        }
                    }
                }
                main #content {
                    h1 { (title) }
                    (content)
                }
                footer { (PreEscaped(request.footer.get_or_init(|| made_from(request).into_string()))) }
            }
        }
    }
}

/// Returns the program, the sources and the licence of the site.
fn made_from(request: &SiteRequest<'_>) -> Markup {
    let rows = || request.groups.iter().flat_map(|group| &group.scene_rows);
    let results = || rows().flat_map(|row| &row.results);
    let commits: BTreeSet<String> = results()
        .filter_map(|result| scene_page::commit(result))
        .map(format::short_commit)
        .collect();
    html! {
        p {
            "Made by omnilife " (env!("CARGO_PKG_VERSION")) " from "
            (format::counted(results().count(), "result"))
            @if let Some(newest) = &request.surroundings.newest { ", the newest of " (date(newest)) }
            "; the same records give the same bytes. "
            @match commits.len() {
                0 => "The results do not say which commit they were made at.",
                1..=3 => {
                    "Commits of the results:" @for commit in &commits { " " code { (commit) } } "."
                }
                more => { "The results are of " (more) " commits, which scene pages name." }
            }
        }
        p {
            "Program: MIT or Apache-2.0. Scores may be cited with the protocol and its hash; videos, \
             images and methods stay under the licences of their owners."
        }
    }
}

fn date(time: &str) -> &str {
    time.split_once(' ').map_or(time, |(day, _)| day)
}
