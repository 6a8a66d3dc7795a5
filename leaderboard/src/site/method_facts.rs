//! Facts about one of the program's methods: a sentence, its paper, its code, components and options.

use maud::{Markup, html};

use crate::{description::MethodDescription, group::SceneRow, variants::method_of};

/// Returns the description of the method of these rows, or of the method that they are a variant of; `None` for methods
/// of other programs, which may have the same names.
pub(super) fn of<'a>(
    descriptions: &'a [MethodDescription],
    method: &str,
    rows: &[&SceneRow<'_>],
) -> Option<&'a MethodDescription> {
    let mut results = rows.iter().flat_map(|row| &row.results);
    // Only runs of this program say which backend computed them.
    let is_ours = results.any(|result| result.backend.is_some());
    let named = |description: &&MethodDescription| description.method == method_of(method);
    descriptions.iter().find(named).filter(|_| is_ours)
}

/// Returns its title and its first sentence.
pub(super) fn sentence(description: &MethodDescription, method: &str) -> Markup {
    let (sentence, _) = description.sentence_and_rest();
    html! {
        p.lead {
            b { (description.title) }
            @if method != description.method { ", a variant by its options" }
            ". " (sentence)
        }
    }
}

/// Returns rows of a list of facts: paper, code, backends and components.
pub(super) fn facts(description: &MethodDescription) -> Markup {
    let lists = [
        ("Backends", &description.backends),
        ("Components", &description.components),
        ("On request", &description.on_request),
    ];
    html! {
        dt { "Paper" }
        dd { (description.source) }
        dt { "Code" }
        dd { code { "omnilife reconstruct train --method " (description.method) } }
        @for (name, list) in lists {
            @if !list.is_empty() {
                dt { (name) }
                dd { (list.join(", ")) }
            }
        }
    }
}

/// Returns what is long, folded: the rest of the description, and the options.
pub(super) fn details(description: &MethodDescription) -> Markup {
    let (_, rest) = description.sentence_and_rest();
    html! {
        @if !rest.is_empty() {
            details {
                summary { "Implementation" }
                p { (rest) }
            }
        }
        @if !description.options.is_empty() {
            details {
                summary { "Options (" (description.options.len()) ")" }
                div.scroll role="region" tabindex="0" aria-label="Options" {
                    table {
                        thead { tr {
                            th scope="col" { "Option" }
                            th.words scope="col" { "Effect" }
                            th.words scope="col" { "Values" }
                            th.words scope="col" { "Default" }
                        } }
                        tbody {
                            @for option in &description.options {
                                tr {
                                    th scope="row" { code { (option.name) } }
                                    td.words { (option.text) }
                                    td.words { (option.values) }
                                    td.words { (option.default) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
