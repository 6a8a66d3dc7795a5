//! Curves upon drawn axes, coloured by the style sheet; and bars.
//!
//! Points carry a text alternative and what the script shows on hover.

use maud::{Markup, PreEscaped, html};
use omnilife_charts::{Curve, PlacedCurve, SIZE, Titles, axes};

use crate::error::LeaderboardError;

/// Right of a plot: names of the series.
const NAMES_WIDTH: i32 = 170;

/// Distance between names.
const NAME_PITCH: i32 = 17;

/// Number of series above which the names would not fit; they are then shown only on hover.
const NAMED_SERIES: usize = 18;

/// Colours of the style sheet for series.
const COLOURS: usize = 8;

/// A point of a series.
pub(super) struct Mark {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Hover text, also for screen readers.
    pub(super) description: String,
}

/// A curve, a point, or a level across the plot.
pub(super) struct Series {
    pub(super) label: String,
    /// From the left.
    pub(super) marks: Vec<Mark>,
    /// A height with its description.
    pub(super) level: Option<(f64, String)>,
    /// True if no other series ends better in both.
    pub(super) on_front: bool,
}

/// Height of a series' last mark or level, beside which the name goes.
fn end(placed: &PlacedCurve) -> i32 {
    let last = placed.points.last().map(|&(_, y)| y);
    last.or(placed.level).unwrap_or_default()
}

/// Draws series over a logarithmic axis of positive `x`; one of them has marks.
pub(super) fn run_time(
    title: &str,
    titles: &Titles<'_>,
    series: &[Series],
) -> Result<Markup, LeaderboardError> {
    let curves: Vec<Curve> = (series.iter())
        .map(|series| Curve {
            points: (series.marks.iter()).map(|mark| (mark.x, mark.y)).collect(),
            level: series.level.as_ref().map(|&(level, _)| level),
        })
        .collect();
    let axes = axes(titles, NAMES_WIDTH, &curves).map_err(|error| LeaderboardError::Chart {
        chart: title.to_owned(),
        reason: error.to_string(),
    })?;
    let placed = &axes.curves;
    let names = (series.len() <= NAMED_SERIES).then(|| spread_names(placed));
    let (width, height) = SIZE;
    Ok(html! {
        div.plot {
            p.y-title aria-hidden="true" { (titles.y) }
            svg.chart.scatter viewBox={ "0 0 " (width) " " (height) } role="group" aria-label=(title) {
                // Plotters escapes the texts that it draws.
                g.axes aria-hidden="true" { (PreEscaped(&axes.elements)) }
                @for (number, (series, placed)) in series.iter().zip(placed).enumerate() {
                    g class={ "series c" (number % COLOURS) } {
                        (drawn_series(series, placed))
                        @if let Some(names) = &names { (name(series, end(placed), names[number])) }
                    }
                }
            }
            // Narrow charts have their names here.
            @if names.is_some() {
                ul.keys aria-hidden="true" {
                    @for (number, series) in series.iter().enumerate() {
                        li class={ "series c" (number % COLOURS) } { (series.label) }
                    }
                }
            }
        }
    })
}

fn drawn_series(series: &Series, placed: &PlacedCurve) -> Markup {
    let line: Vec<String> = (placed.points.iter())
        .map(|(x, y)| format!("{x},{y}"))
        .collect();
    let right = SIZE.0 as i32 - NAMES_WIDTH;
    let last = series.marks.len().saturating_sub(1);
    html! {
        @if let (Some(y), Some((_, description))) = (placed.level, &series.level) {
            line.level x1="72" x2=(right) y1=(y) y2=(y) aria-hidden="true" {}
            circle.point cx=(right) cy=(y) r="5" tabindex="0" role="img"
                aria-label=(description) data-tip=(description) {}
        }
        @if line.len() > 1 { polyline.curve points=(line.join(" ")) aria-hidden="true" {} }
        // The last mark of each can be reached with the keyboard; the others speak on hover.
        @for (at, (mark, (x, y))) in series.marks.iter().zip(&placed.points).enumerate() {
            @if at == last {
                circle.point.on-front[series.on_front] cx=(x) cy=(y) r="6" tabindex="0" role="img"
                    aria-label=(mark.description) data-tip=(mark.description) {}
            } @else {
                circle.point.early cx=(x) cy=(y) r="4" role="img" aria-label=(mark.description)
                    data-tip=(mark.description) {}
            }
        }
    }
}

/// Returns a name right of the plot, with a line from the height of its series.
fn name(series: &Series, end: i32, y: i32) -> Markup {
    let left = SIZE.0 as i32 - NAMES_WIDTH;
    let points = format!("{},{end} {},{y} {},{y}", left + 4, left + 12, left + 18);
    html! {
        polyline.lead-line points=(points) aria-hidden="true" {}
        text.label x=(left + 22) y=(y + 4) aria-hidden="true" { (shortened_to(&series.label, 20)) }
    }
}

/// Heights of the names: near their series, one below the other.
fn spread_names(placed: &[PlacedCurve]) -> Vec<i32> {
    let mut order: Vec<usize> = (0..placed.len()).collect();
    order.sort_by_key(|&at| end(&placed[at]));
    let mut heights = vec![0; placed.len()];
    let mut next = 16;
    for &at in &order {
        heights[at] = end(&placed[at]).max(next);
        next = heights[at] + NAME_PITCH;
    }
    // What hangs out below moves up again.
    let mut most = SIZE.1 as i32 - 12;
    for &at in order.iter().rev() {
        heights[at] = heights[at].min(most);
        most = heights[at] - NAME_PITCH;
    }
    heights
}

/// A bar with its label and number.
pub(super) struct Bar {
    pub(super) label: String,
    pub(super) value: u64,
}

/// Returns horizontal bars from 0, all in one unit: elements of the page, so that text stays readable on a phone.
pub(super) fn bars(title: &str, bars: &[Bar]) -> Markup {
    let most = bars.iter().map(|bar| bar.value).max().unwrap_or(0).max(1);
    let description: Vec<String> = bars
        .iter()
        .map(|bar| format!("{}: {}", bar.label, bar.value))
        .collect();
    html! {
        div.bars role="img" aria-label={ (title) ". " (description.join("; ")) } {
            @for bar in bars {
                span { (bar.label) }
                span { span.bar style={ "width: " (100.0 * bar.value as f64 / most as f64) "%" } {} }
                span { (bar.value) }
            }
        }
    }
}

fn shortened_to(label: &str, characters: usize) -> String {
    if label.chars().count() <= characters {
        return label.to_owned();
    }
    let kept: String = label.chars().take(characters - 1).collect();
    format!("{}…", kept.trim_end())
}
