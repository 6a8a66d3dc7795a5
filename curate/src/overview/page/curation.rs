//! Sections about the whole dataset: losses of curation, and statistics.

use maud::{Markup, html};

use super::{Bar, bars, drawn, duration};
use crate::{
    attrition::{Attrition, FunnelStep, Reject},
    publish::{Statistics, Tally, is_annotated},
};

/// Largest number of rejects that are listed.
const MOST_REJECTS: usize = 200;

/// Returns the time that every step of curation leaves, and every reject.
pub(super) fn losses(attrition: &Attrition) -> Markup {
    let steps = &attrition.funnel;
    let raw = steps.first().map_or(0.0, |step| step.left_seconds);
    let last = steps.len().saturating_sub(1);
    let is_loss = |step: &FunnelStep| step.removed_videos > 0 || step.removed_seconds > 0.0;
    let (shown, passed): (Vec<_>, Vec<_>) = (steps.iter().enumerate())
        .partition(|(index, step)| *index == 0 || *index == last || is_loss(step));
    let passed: Vec<&str> = passed.iter().map(|(_, step)| step.step.as_str()).collect();
    html! {
        h2 #losses { "Losses at each check" }
        div.scroll role="region" tabindex="0" aria-label="Losses at each check" {
            table.funnel {
                thead { tr {
                    th scope="col" { "step" }
                    th.words scope="col" colspan="2" { "time left" }
                    th scope="col" { "time lost" }
                    th scope="col" { "videos left" }
                    th scope="col" { "videos lost" }
                } }
                tbody {
                    @for (_, step) in shown {
                        tr {
                            th scope="row" { (step.step) }
                            td.drawn { (drawn(step.left_seconds / raw)) }
                            td { (duration(step.left_seconds)) }
                            td { @if step.removed_seconds > 0.0 { (duration(step.removed_seconds)) } }
                            td { (step.left_videos) }
                            td { @if step.removed_videos > 0 { (step.removed_videos) } }
                        }
                    }
                }
            }
        }
        @if !passed.is_empty() {
            p.hint { "Nothing was lost at: " (passed.join(", ")) "." }
        }
        (rejects(&attrition.rejects))
    }
}

fn rejects(rejects: &[Reject]) -> Markup {
    let seconds = |time: Option<f64>| time.map_or_else(String::new, |time| format!("{time:.1}"));
    html! {
        @if !rejects.is_empty() {
            details {
                summary { "Rejects and remarks, with their values: " (rejects.len()) }
                @if rejects.len() > MOST_REJECTS {
                    p.hint { "The first " (MOST_REJECTS) "; attrition.csv has all." }
                }
                div.scroll role="region" tabindex="0" aria-label="Rejects and remarks" {
                    table {
                        thead { tr {
                            th scope="col" { "video" }
                            th.words scope="col" { "check" }
                            th.words scope="col" { "value" }
                            th.words scope="col" { "required" }
                            th scope="col" { "from, s" }
                            th scope="col" { "to, s" }
                        } }
                        tbody {
                            @for reject in rejects.iter().take(MOST_REJECTS) {
                                tr {
                                    th scope="row" { (reject.video) }
                                    td.words { (reject.check) }
                                    td.words { (reject.value) }
                                    td.words { (reject.threshold) }
                                    td { (seconds(reject.begin_seconds)) }
                                    td { (seconds(reject.end_seconds)) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Returns the number of sequences of every class of every property.
pub(super) fn statistics(statistics: &Statistics) -> Markup {
    let all = statistics.rows.len();
    let (shown, missing): (Vec<_>, Vec<_>) = statistics
        .distributions()
        .partition(|(_, tallies)| is_annotated(tallies));
    let missing: Vec<&str> = missing.iter().map(|(property, _)| *property).collect();
    html! {
        h2 #statistics { "Statistics" }
        @if all == 0 { p { "No sequences." } }
        @else {
            div.figures {
                @for (property, tallies) in shown {
                    (bars(property, &tallies.into_iter().map(bar).collect::<Vec<_>>()))
                }
            }
            @if !missing.is_empty() {
                p.hint { "Not annotated in any sequence: " (missing.join(", ")) "." }
            }
        }
    }
}

fn bar((label, tally): (String, Tally)) -> Bar {
    Bar {
        label,
        value: tally.sequences as f64,
        text: format!("{} ({})", tally.sequences, duration(tally.seconds)),
    }
}
