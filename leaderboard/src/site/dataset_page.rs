//! The page of a dataset: the fate of every video.

use std::collections::{BTreeMap, BTreeSet};

use maud::{Markup, html};

use omnilife_schemas::records::{Dataset, Origin, OriginKind, VideoStatus};

use super::{SiteRequest, chart, chart::Bar, layout, layout::Place};
use crate::{error::LeaderboardError, format};

/// Folder prefix of paths of sequences, which ids of scenes lack.
const VIDEOS: &str = "videos/";

pub(super) fn render(
    request: &SiteRequest<'_>,
    dataset: &Dataset,
) -> Result<Markup, LeaderboardError> {
    let scored: BTreeSet<&str> = request
        .groups
        .iter()
        .flat_map(|group| group.scenes.iter().copied())
        .collect();
    let counts = Counts::of(dataset, &scored);
    let videos = chart::bars("Videos left after every step", &counts.videos_left());
    let kept = chart::bars("Sequences left after every step", &counts.sequences_left());
    let sequences: Vec<Bar> = counts.sequences_per_video();
    let content = html! {
        p.lead {
            (format::counted(counts.videos, "video")) " gave "
            (format::counted(counts.sequences, "sequence")) "."
        }
        h2 { "Attrition" }
        figure {
            (videos)
            figcaption {
                "Videos as given; those that could be read and processed; those that gave sequences. \
                 Whether they meet the admission criteria is in the record of each sequence."
            }
        }
        figure {
            (kept)
            figcaption { "Sequences cut from them, and those with scores here." }
        }
        @if !counts.lost.is_empty() {
            h2 { "Why videos were lost" }
            div.scroll role="region" tabindex="0" aria-label="Why videos were lost" {
                table {
                    thead { tr {
                        th scope="col" { "Video" }
                        th.words scope="col" { "Outcome" }
                        th.words scope="col" { "Reason" }
                    } }
                    tbody {
                        @for (file, outcome, reason) in &counts.lost {
                            tr {
                                th scope="row" { (file) }
                                td.words { (outcome) }
                                td.words { (reason) }
                            }
                        }
                    }
                }
            }
        }
        @if !counts.origins.is_empty() {
            h2 { "Where the videos came from" }
            p {
                "As stated by who made the dataset, for " (counts.origins.len()) " of "
                (format::counted(counts.videos, "video")) "."
            }
            div.scroll role="region" tabindex="0" aria-label="Where the videos came from" {
                (origins_table(&counts.origins))
            }
        }
        @if !sequences.is_empty() {
            h2 { "Sequences per video" }
            figure { (chart::bars("Videos by their number of sequences", &sequences)) }
        }
    };
    Ok(layout::page(request, Place::Dataset, "Dataset", content))
}

/// Returns a table of origins. URLs are text: pages of a site have no external links.
fn origins_table(origins: &[(&str, &Origin)]) -> Markup {
    let text = |text: &'_ Option<String>| text.clone().unwrap_or_default();
    html! {
        table {
            thead { tr {
                th scope="col" { "Video" }
                @for name in ["From", "Address", "By", "Licence", "Date", "Keywords"] {
                    th.words scope="col" { (name) }
                }
            } }
            tbody {
                @for (file, origin) in origins {
                    tr {
                        th scope="row" { (file) }
                        td.words { (origin.kind.map_or("", OriginKind::words)) }
                        td.words { (text(&origin.url)) }
                        td.words { (text(&origin.uploader)) }
                        td.words { (text(&origin.licence)) }
                        td.words { (text(&origin.date)) }
                        td.words { (origin.keywords.join(", ")) }
                    }
                }
            }
        }
    }
}

struct Counts<'a> {
    videos: usize,
    pending: usize,
    failed: usize,
    rejected: usize,
    sequences: usize,
    scored: usize,
    per_video: BTreeMap<usize, u64>,
    /// File, outcome and reason.
    lost: Vec<(&'a str, &'static str, &'a str)>,
    /// Files with a stated origin.
    origins: Vec<(&'a str, &'a Origin)>,
}

impl<'a> Counts<'a> {
    fn of(dataset: &'a Dataset, scored_scenes: &BTreeSet<&str>) -> Self {
        let mut counts = Self {
            videos: dataset.videos.len(),
            pending: 0,
            failed: 0,
            rejected: 0,
            sequences: 0,
            scored: 0,
            per_video: BTreeMap::new(),
            lost: Vec::new(),
            origins: Vec::new(),
        };
        for video in &dataset.videos {
            let origin = video.origin.as_ref();
            let origin = origin.map(|origin| (video.file.as_str(), origin));
            counts.origins.extend(origin);
            match &video.status {
                VideoStatus::Pending => counts.pending += 1,
                VideoStatus::Failed { reason } => {
                    counts.failed += 1;
                    counts.lost.push((&video.file, "failed", reason));
                }
                VideoStatus::Rejected { reason, .. } => {
                    counts.rejected += 1;
                    counts.lost.push((&video.file, "rejected", reason));
                }
                VideoStatus::Duplicate { of } => {
                    counts.rejected += 1;
                    counts.lost.push((&video.file, "duplicate of", of));
                }
                VideoStatus::Curated { sequences } => {
                    counts.sequences += sequences.len();
                    *counts.per_video.entry(sequences.len()).or_default() += 1;
                    let ids = sequences
                        .iter()
                        .map(|folder| folder.strip_prefix(VIDEOS).unwrap_or(folder));
                    counts.scored += ids.filter(|id| scored_scenes.contains(id)).count();
                }
            }
        }
        counts
    }

    fn videos_left(&self) -> Vec<Bar> {
        let processed = self.videos - self.pending - self.failed;
        vec![
            bar("Videos given", self.videos),
            bar("Videos read and processed", processed),
            bar("Videos that gave sequences", processed - self.rejected),
        ]
    }

    fn sequences_left(&self) -> Vec<Bar> {
        vec![
            bar("Sequences cut", self.sequences),
            bar("Sequences scored", self.scored),
        ]
    }

    fn sequences_per_video(&self) -> Vec<Bar> {
        self.per_video
            .iter()
            .map(|(sequences, &videos)| Bar {
                label: match sequences {
                    1 => "1 sequence".to_owned(),
                    count => format!("{count} sequences"),
                },
                value: videos,
            })
            .collect()
    }
}

fn bar(label: &str, value: usize) -> Bar {
    Bar {
        label: label.to_owned(),
        value: value as u64,
    }
}
