//! Section of one sequence: contact sheet, camera path, coverage of the sphere, what is missing.

use std::collections::BTreeSet;

use maud::{Markup, html};
use omnilife_schemas::records::{Annotation, PartStatus, SequencePart, SequenceStatus};

use super::{SequenceImages, commands, counted, drawn, duration, percent};
use crate::overview::{
    coverage::{self, Coverage},
    finds::{Find, MOST_FINDS},
    marks::Mark,
    path::CameraPath,
    sheet::{Sheet, SheetFrame},
};

pub(super) fn section(index: usize, status: &SequenceStatus, look: &SequenceImages) -> Markup {
    let lacking: Vec<(&SequenceStatus, &PartStatus)> = (status.lacking())
        .filter(|part| part.command.is_some() && !part.part.is_optional())
        .map(|part| (status, part))
        .collect();
    let names: Vec<&str> = lacking.iter().map(|(_, part)| part.part.name()).collect();
    html! {
        section.sequence aria-labelledby={ "sequence-" (index) } {
            h3 id={ "sequence-" (index) } { (status.id) }
            p.hint { (facts(status)) }
            (contact_sheet(status, &look.sheet))
            div.figures {
                @if let Some(path) = &look.path { (camera_path(status, path)) }
                (sphere(status, &look.coverage))
                @if !look.annotation.is_empty() {
                    dl {
                        @for (property, value) in &look.annotation {
                            dt { (property) }
                            dd { (value) }
                        }
                    }
                }
            }
            @if !lacking.is_empty() {
                p { b { "Missing: " } (names.join(", ")) }
                (commands(&lacking))
            }
        }
    }
}

/// Returns frames, length, and remarks on the parts.
fn facts(status: &SequenceStatus) -> String {
    let mut facts = vec![duration(status.duration_seconds)];
    if let Some(frames) = status.part(SequencePart::Frames) {
        facts.insert(0, counted(frames.count as usize, "frame"));
    }
    let remarks = status.parts.iter().filter(|part| !part.note.is_empty());
    facts.extend(remarks.map(|part| format!("{}: {}", part.part.name(), part.note)));
    facts.join(" · ")
}

fn contact_sheet(status: &SequenceStatus, sheet: &Sheet) -> Markup {
    let classes: BTreeSet<&str> = sheet.overlays.iter().map(|class| class.name()).collect();
    let classes = Vec::from_iter(classes).join(", ");
    html! {
        ul.legend {
            @for mark in sheet.marks() {
                li {
                    span class={ "key " (mark.word()) } aria-hidden="true" {}
                    (mark.word())
                    @if mark == Mark::Overlay { " (" (classes) ", as a rectangle or a disc of its area)" }
                }
            }
        }
        @if let Some(fault) = &sheet.fault { p.hint { "Overlays are not known: " (fault) } }
        ol.sheet { @for frame in &sheet.frames { li { (shown_frame(status, frame)) } } }
        @if !sheet.finds.is_empty() {
            p.hint {
                "Overlays that were found"
                @if sheet.overlays.len() > sheet.finds.len() {
                    ", the largest " (MOST_FINDS) " of " (sheet.overlays.len())
                }
                ":"
            }
            ul.sheet { @for find in &sheet.finds { li { (shown_find(status, find)) } } }
        }
    }
}

fn shown_find(status: &SequenceStatus, find: &Find) -> Markup {
    let times = find.times.map_or_else(String::new, |range| {
        format!(", {:.1} to {:.1} s", range.begin_seconds, range.end_seconds)
    });
    let title = format!("{}{times}", find.class.name());
    html! {
        figure {
            @match &find.crop {
                Some(Ok(crop)) => {
                    img src=(crop.url) width=(crop.width) height=(crop.height) decoding="async"
                        alt={ "Crop around the overlay of " (status.id) ": " (title) };
                },
                Some(Err(reason)) => p.fault { (reason) },
                None => p.hint { "Between the sampled frames" },
            }
            figcaption { (title) }
        }
    }
}

fn shown_frame(status: &SequenceStatus, frame: &SheetFrame) -> Markup {
    let place = format!("Frame {}, {:.2} s", frame.number, frame.time_seconds);
    html! {
        figure {
            @match &frame.shown {
                Ok(shown) => {
                    @let masks = shown.masks.iter().filter(|(_, mask)| mask.marks_anything());
                    @let marked = masks.map(|(mark, _)| mark.word());
                    @let overlay = frame.has_overlay.then_some(Mark::Overlay.word());
                    @let regions = marked.chain(overlay).map(|word| format!(", {word} region marked"));
                    img src=(shown.url) width=(shown.width) height=(shown.height) decoding="async"
                        alt={ (place) " of " (status.id) (regions.collect::<String>()) };
                },
                Err(reason) => p.fault { (reason) },
            }
            figcaption { (place) }
        }
    }
}

fn camera_path(status: &SequenceStatus, path: &CameraPath) -> Markup {
    let length = format!("{:.1} {}", path.length, path.unit);
    let label = format!(
        "Path of the camera of {} from above: {} with poses, {length} long",
        status.id,
        counted(path.posed, "frame")
    );
    html! {
        figure {
            (path.svg(&label))
            figcaption {
                "Camera path from above, " (path.directions) ": " (counted(path.posed, "pose")) ", "
                (length) ". Strokes are viewing directions."
                @if path.far > 0 { " " (counted(path.far, "camera")) " far off all others left out." }
            }
        }
    }
}

fn sphere(status: &SequenceStatus, coverage: &Result<Coverage, String>) -> Markup {
    let coverage = match coverage {
        Ok(coverage) => coverage,
        Err(reason) => {
            return html! { p.fault { "Coverage of the sphere is not known: " (reason) } };
        }
    };
    if coverage.directions.is_none() && !coverage.has_masks {
        return html! {};
    }
    let longest = coverage.bands.iter().map(|band| band.directions);
    let longest = longest.fold(0.0, f64::max);
    html! {
        div.scroll role="region" tabindex="0" aria-label={ "Coverage of the sphere by " (status.id) } {
            table {
                caption { span {
                    "Coverage of the sphere by latitude"
                    @if let Some(directions) = coverage.directions { ": " (directions) }
                } }
                thead { tr {
                    th scope="col" { "latitude" }
                    @if coverage.directions.is_some() {
                        th.words scope="col" colspan="2" { "share" }
                    }
                    th.wide scope="col" { "sphere" }
                    @if coverage.has_masks {
                        th scope="col" { "moving" }
                        th scope="col" { "ignored" }
                    }
                } }
                tbody {
                    @for (index, band) in coverage.bands.iter().enumerate() {
                        @let [upper, lower] = coverage::latitudes(index);
                        tr {
                            th scope="row" { (upper) "° to " (lower) "°" }
                            @if coverage.directions.is_some() {
                                td.drawn { (drawn(band.directions / longest)) }
                                td { (percent(band.directions)) }
                            }
                            td.wide { (percent(coverage::share_of_sphere(index))) }
                            @if coverage.has_masks {
                                td { (percent(band.moving)) }
                                td { (percent(band.ignored)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Returns the stated and measured properties of a sequence.
pub(super) fn properties(annotation: &Annotation) -> Vec<(&'static str, String)> {
    let by = |name: &str, author: &str| format!("{name} ({author})");
    let mut all = Vec::new();
    if let Some(scene) = &annotation.scene {
        let group = annotation.group.iter().map(|group| format!(", {group}"));
        let place = scene.name.clone() + &group.collect::<String>();
        all.push(("scene", by(&place, &scene.author)));
    }
    if annotation.traversal {
        all.push(("traversal", "between indoors and outdoors".to_owned()));
    }
    if let Some(action) = &annotation.action {
        all.push(("action", by(&action.name, &action.author)));
    }
    if let Some(class) = annotation.ego_motion.class() {
        let from = match (
            &annotation.ego_motion.of_action,
            &annotation.ego_motion.measured,
        ) {
            (None, Some(measured)) => format!("measured: {}", measured.from),
            _ => "of the action".to_owned(),
        };
        all.push(("ego-motion", by(class, &from)));
    }
    if let Some(dynamics) = &annotation.dynamics {
        let from = format!("measured: {}", dynamics.from);
        all.push(("dynamics", by(&dynamics.class, &from)));
    }
    let captions = annotation.captions.iter();
    all.extend(captions.map(|caption| ("caption", by(&caption.text, &caption.author))));
    all
}
