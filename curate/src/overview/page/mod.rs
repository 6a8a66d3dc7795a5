//! The page of a dataset: one HTML file that needs no other and no network.

mod curation;
mod sequence;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use omnilife_schemas::{
    plain_text::counted,
    records::{DatasetStatus, PartState, PartStatus, SequencePart, SequenceStatus},
};

use super::{coverage::Coverage, parts::Records, path::CameraPath, sheet::Sheet};
use crate::{attrition::Attrition, publish::Statistics};

const STYLE: &str = include_str!("style.css");

/// Content of a sequence that is drawn from its images and points.
pub(super) struct SequenceImages {
    sheet: Sheet,
    path: Option<CameraPath>,
    /// Coverage of the sphere, or the reason why it is not known.
    coverage: Result<Coverage, String>,
    /// Properties and their values, in the order of the page.
    annotation: Vec<(&'static str, String)>,
}

impl SequenceImages {
    /// Draws a sequence.
    pub(super) fn at(records: &Records) -> Self {
        let sheet = Sheet::draw(records);
        Self {
            path: records.scene.as_ref().and_then(CameraPath::of),
            coverage: Coverage::of(records, &sheet),
            annotation: (records.annotation.as_ref())
                .map(sequence::properties)
                .unwrap_or_default(),
            sheet,
        }
    }
}

/// Everything that stands on a page.
pub(super) struct Page<'a> {
    pub(super) title: String,
    pub(super) status: &'a DatasetStatus,
    /// Looks of the first sequences.
    pub(super) looks: &'a [SequenceImages],
    /// Losses of curation; `None` for imported scenes.
    pub(super) attrition: Option<&'a Attrition>,
    pub(super) statistics: Option<&'a Statistics>,
}

impl Page<'_> {
    /// Returns the whole file.
    pub(super) fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.title) " · dataset" }
                    // No icon: otherwise browsers request a missing one.
                    link rel="icon" href="data:,";
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    a.skip href="#content" { "Skip to content" }
                    header {
                        h1 { (self.title) }
                        p.lead { (self.lead()) }
                        (self.navigation())
                    }
                    main #content {
                        (self.state())
                        @if let Some(attrition) = self.attrition { (curation::losses(attrition)) }
                        @if let Some(statistics) = self.statistics { (curation::statistics(statistics)) }
                        (self.sequences())
                    }
                    footer {
                        p {
                            "Made by omnilife " (env!("CARGO_PKG_VERSION")) " from the dataset's records and images; \
                             the same ones give the same bytes. " code { "omnilife curate overview DATASET" }
                            " makes it anew, " code { "omnilife curate status DATASET" }
                            " prints the table."
                        }
                    }
                }
            }
        };
        page.into_string() + "\n"
    }

    fn lead(&self) -> String {
        let sequences = &self.status.sequences;
        let seconds = sequences.iter().map(|one| one.duration_seconds);
        let what = counted(sequences.len(), "sequence");
        let length = duration(seconds.sum());
        match self.statistics {
            Some(statistics) => format!(
                "{what}, {length}, from {} of {}.",
                statistics.curated_videos,
                counted(statistics.videos, "video")
            ),
            None => format!("{what}, {length}."),
        }
    }

    fn navigation(&self) -> Markup {
        html! {
            nav aria-label="Sections" {
                a href="#state" { "State" }
                @if self.attrition.is_some() { a href="#losses" { "Losses" } }
                @if self.statistics.is_some() { a href="#statistics" { "Statistics" } }
                a href="#sequences" { "Sequences" }
            }
        }
    }

    fn state(&self) -> Markup {
        let sequences = &self.status.sequences;
        html! {
            h2 #state { "State of every sequence" }
            @if sequences.is_empty() {
                p { "No sequences." }
            } @else {
                div.scroll role="region" tabindex="0" aria-label="State of every sequence" {
                    table.states {
                        thead { tr {
                            th scope="col" { "sequence" }
                            th scope="col" { "length" }
                            @for part in SequencePart::ALL { th scope="col" { (part.name()) } }
                        } }
                        tbody {
                            @for (index, sequence) in sequences.iter().enumerate() {
                                tr {
                                    th scope="row" { (self.link(index, sequence)) }
                                    td { (duration(sequence.duration_seconds)) }
                                    @for part in SequencePart::ALL { (cell(sequence.part(part))) }
                                }
                            }
                        }
                    }
                }
            }
            (self.missing())
        }
    }

    /// Returns the id of a sequence, as a link where the page shows it.
    fn link(&self, index: usize, sequence: &SequenceStatus) -> Markup {
        html! {
            @if index < self.looks.len() {
                a href={ "#sequence-" (index) } { (sequence.id) }
            } @else {
                (sequence.id)
            }
        }
    }

    /// Returns the commands for everything that is missing, by part.
    fn missing(&self) -> Markup {
        let lacking = |part: SequencePart| -> Vec<(&SequenceStatus, &PartStatus)> {
            let states = self.status.sequences.iter();
            let states = states.filter_map(|one| Some((one, one.part(part)?)));
            states
                .filter(|(_, status)| status.command.is_some())
                .collect()
        };
        let (optional, needed): (Vec<_>, Vec<_>) = (SequencePart::ALL.into_iter())
            .map(|part| (part, lacking(part)))
            .filter(|(_, lacking)| !lacking.is_empty())
            .partition(|(part, _)| part.is_optional());
        let total = counted(self.status.sequences.len(), "sequence");
        html! {
            @if !needed.is_empty() || !optional.is_empty() {
                h3 { "Missing, with the commands that make it" }
                p.hint {
                    "Commands run in the folder of this page. Words in capitals stand for files to be given."
                }
            }
            @for (part, lacking) in needed.iter().chain(&optional) {
                details {
                    summary {
                        (part.name()) @if part.is_optional() { " (optional)" } ": "
                        (lacking.len()) " of " (total)
                    }
                    (commands(lacking))
                }
            }
        }
    }

    fn sequences(&self) -> Markup {
        let (sequences, looks) = (&self.status.sequences, self.looks);
        html! {
            h2 #sequences { "Sequences" }
            @if sequences.is_empty() { p { "No sequences." } }
            @if looks.len() < sequences.len() {
                p {
                    "The first " (looks.len()) " of " (sequences.len())
                    " are shown; the table above has all."
                }
            }
            @for (index, (status, look)) in sequences.iter().zip(looks).enumerate() {
                (sequence::section(index, status, look))
            }
        }
    }
}

/// Returns commands, each once: one of the whole dataset stands for all of its sequences.
fn commands(lacking: &[(&SequenceStatus, &PartStatus)]) -> Markup {
    let mut lines: Vec<&str> = Vec::new();
    for line in lacking
        .iter()
        .filter_map(|(_, status)| status.command.as_deref())
    {
        if lines.last() != Some(&line) {
            lines.push(line);
        }
    }
    html! {
        pre tabindex="0" { code { @for line in lines { (line) "\n" } } }
    }
}

fn cell(status: Option<&PartStatus>) -> Markup {
    let Some(status) = status else {
        return html! { td { span.hidden { "not applicable" } } };
    };
    let PartStatus { count, of, .. } = status;
    html! {
        @match status.state {
            PartState::Present => td.present { span aria-hidden="true" { "✓ " } (count) },
            PartState::Incomplete => {
                td.lacking { span aria-hidden="true" { "◐ " } (count) " of " (of) }
            },
            PartState::Missing if status.part.is_optional() => {
                td { span aria-hidden="true" { "–" } span.hidden { "none" } }
            },
            PartState::Missing => {
                td.lacking { span aria-hidden="true" { "✗" } span.hidden { "missing" } }
            },
        }
    }
}

/// Bar with its label and the text of its value.
struct Bar {
    label: String,
    value: f64,
    text: String,
}

/// Returns horizontal bars from 0, in shares of the longest.
fn bars(title: &str, bars: &[Bar]) -> Markup {
    let longest = bars.iter().map(|bar| bar.value).fold(0.0, f64::max);
    html! {
        table.bars {
            caption { (title) }
            tbody {
                @for bar in bars {
                    tr {
                        th scope="row" { (bar.label) }
                        td.drawn { (drawn(bar.value / longest)) }
                        td { (bar.text) }
                    }
                }
            }
        }
    }
}

/// Returns a bar alone; `share` is its length, 0 to 1.
fn drawn(share: f64) -> Markup {
    let percent = if share.is_finite() {
        100.0 * share
    } else {
        0.0
    };
    html! { span.bar style={ "width: " (format!("{percent:.1}%")) } {} }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Returns a length of time in words.
fn duration(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 120.0 => format!("{:.1} s", seconds + 0.0),
        seconds if seconds < 7200.0 => format!("{:.1} min", seconds / 60.0),
        seconds => format!("{:.2} h", seconds / 3600.0),
    }
}
