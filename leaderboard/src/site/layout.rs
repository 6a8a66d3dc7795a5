//! What all pages share.

use maud::{DOCTYPE, Markup, html};

/// A page's place in the site.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Index,
    Published,
    Dataset,
    Scene,
}

impl Place {
    /// The way to the first folder of the site.
    fn root(self) -> &'static str {
        match self {
            Self::Scene => "../",
            _ => "",
        }
    }
}

/// A whole page.
pub(super) fn page(place: Place, title: &str, has_dataset: bool, content: Markup) -> Markup {
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
                // No icon: without this a browser asks for one that is not there.
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
                        (link(Place::Published, "published.html", "Published figures"))
                        @if has_dataset {
                            (link(Place::Dataset, "dataset.html", "Dataset"))
                        }
                    }
                }
                main #content {
                    h1 { (title) }
                    (content)
                }
                footer {
                    p {
                        "Made by omnilife " (env!("CARGO_PKG_VERSION")) " from result records; the same \
                         records give the same bytes."
                    }
                }
            }
        }
    }
}
