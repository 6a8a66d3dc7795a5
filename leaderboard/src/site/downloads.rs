//! Files that the first page offers: all results as tables, tables for papers, a citation.

use maud::{Markup, html};

use super::{FOLDER, SiteRequest};
use crate::{
    format::slug,
    group::Group,
    layouts::{LAYOUTS, Layout},
    outputs::Outputs,
    published::{OMNILIFE360, Paper},
    tables::{CSV_FILE, layout_folder},
};

/// Folder of the files.
const DOWNLOADS: &str = "downloads";
/// Every result as a row of a Parquet table.
pub(crate) const PARQUET_FILE: &str = "results.parquet";
/// The citation.
const CITATION_FILE: &str = "citation.bib";

/// Adds copies of the tables to the site, so that its folder is whole, and the citation.
pub(crate) fn add(outputs: &mut Outputs, groups: &[Group<'_>], papers: &[Paper]) {
    outputs.repeat(PARQUET_FILE, target(PARQUET_FILE));
    for group in groups {
        for layout in in_first_table(group, papers) {
            let source = format!("{}/{}.tex", layout_folder(group), layout.id);
            outputs.repeat(&source, target(&latex_file(group, layout)));
        }
    }
    outputs.add(target(CITATION_FILE), citation(groups, papers));
}

/// Returns a list of the files, and how to hand results in.
pub(super) fn section(request: &SiteRequest<'_>) -> Markup {
    let latex: Vec<(String, &Group<'_>)> = (request.groups.iter())
        .flat_map(|group| {
            let layouts = in_first_table(group, request.papers);
            layouts.map(move |layout| (latex_file(group, layout), group))
        })
        .collect();
    let file = |name: &str| format!("{DOWNLOADS}/{name}");
    html! {
        h2 #downloads { "Downloads" }
        ul.downloads {
            li { a href=(CSV_FILE) download { "CSV" } span { ": every score of every result" } }
            @if request.has_values {
                li { a href=(file(PARQUET_FILE)) download { "Parquet" } span { ": the same for programs" } }
            }
            @for (name, group) in &latex {
                li {
                    a href=(file(name)) download { "LaTeX" }
                    span { ": the table of " (group.protocol) }
                }
            }
            li {
                a href=(file(CITATION_FILE)) download { "BibTeX" }
                span { ": the benchmark and its protocols" }
            }
        }
        details #submit {
            summary { "Submit a method" }
            ol {
                li { "Write the split of a scene: " code { "omnilife bench split" } }
                li { "Predict its novel views and score them: " code { "omnilife bench score" } }
                li { "Pack scores, views and a card: " code { "omnilife leaderboard submit" } }
            }
            p {
                code { "omnilife leaderboard add" }
                " takes it in and scores a sample again. The guide is docs/guides/submit.md of the \
                 project omnilife."
            }
        }
    }
}

fn target(name: &str) -> String {
    format!("{FOLDER}/{DOWNLOADS}/{name}")
}

/// Returns the layouts with the numbers of a group's first table.
fn in_first_table(group: &Group<'_>, papers: &[Paper]) -> impl Iterator<Item = &'static Layout> {
    let layouts = LAYOUTS.iter().filter(|layout| layout.is_in_first_table);
    layouts.filter(move |layout| !(layout.tables)(group, papers).is_empty())
}

/// Returns the name of a group's table in LaTeX.
fn latex_file(group: &Group<'_>, layout: &Layout) -> String {
    let (protocol, hash) = (slug(group.protocol), slug(&group.short_hash()));
    format!("{protocol}-{hash}-{}.tex", layout.id)
}

/// Returns the benchmark's paper as BibTeX, with the protocols of the scores in a note.
fn citation(groups: &[Group<'_>], papers: &[Paper]) -> String {
    let title = (papers.iter().find(|paper| paper.id == OMNILIFE360))
        .map_or("OmniLife360", |paper| paper.title.as_str());
    let protocols: Vec<String> = (groups.iter())
        .map(|group| format!("{}-{}", slug(group.protocol), slug(&group.short_hash())))
        .collect();
    format!(
        "@misc{{omnilife360,\n  title = {{{{{title}}}}},\n  note = {{Scores under the protocols {}}}\n}}\n",
        protocols.join(", ")
    )
}
