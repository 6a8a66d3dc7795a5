//! Charts as SVG: plotters draws axes and labels, the style sheet colours them; and bars.
//!
//! Curves and points are added on top, at the places that plotters gives: points carry a text alternative and the hover
//! text of the script.

use maud::{Markup, PreEscaped, html};
use plotters::{coord::Shift, prelude::*};

use crate::error::LeaderboardError;

/// Width and height of a plot in its own units; it scales with the page.
const PLOT_SIZE: (u32, u32) = (760, 420);

/// Width right of a plot for the names of the series.
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

/// A series at its places in the drawing.
struct Placed {
    marks: Vec<(i32, i32)>,
    level: Option<i32>,
}

impl Placed {
    /// Returns the height of its last mark, beside which the name goes.
    fn end(&self) -> i32 {
        let last = self.marks.last().map(|&(_, y)| y);
        last.or(self.level).unwrap_or_default()
    }
}

/// Draws series over a logarithmic axis of positive `x`; one of them has marks.
pub(super) fn run_time(
    title: &str,
    x_title: &str,
    y_title: &str,
    series: &[Series],
) -> Result<Markup, LeaderboardError> {
    let mut placed = Vec::new();
    let axes = drawn(title, PLOT_SIZE, |area| {
        let marks = || series.iter().flat_map(|series| &series.marks);
        let levels = series
            .iter()
            .filter_map(|series| Some(series.level.as_ref()?.0));
        let (x_low, x_high) = bounds(marks().map(|mark| mark.x));
        let (y_low, y_high) = bounds(marks().map(|mark| mark.y).chain(levels));
        // At least a decade of x and a unit of y.
        let (x_low, x_high) = if x_high / x_low < 10.0 {
            let middle = (x_low * x_high).sqrt();
            (middle / 4.0, middle * 4.0)
        } else {
            (x_low / 1.3, x_high * 1.3)
        };
        let margin = (0.08 * (y_high - y_low)).max(0.5);
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_right(NAMES_WIDTH)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(
                (x_low..x_high)
                    .log_scale()
                    .with_key_points(round_numbers(x_low, x_high)),
                y_low - margin..y_high + margin,
            )?;
        chart
            .configure_mesh()
            .x_desc(x_title)
            .y_desc(y_title)
            .y_labels(6)
            .x_label_formatter(&|value| round_label(*value))
            .y_label_formatter(&|value| round_label(*value))
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .light_line_style(TRANSPARENT)
            .draw()?;
        placed = (series.iter())
            .map(|series| Placed {
                marks: (series.marks.iter())
                    .map(|mark| chart.backend_coord(&(mark.x, mark.y)))
                    .collect(),
                level: (series.level.as_ref())
                    .map(|(level, _)| chart.backend_coord(&(x_low, *level)).1),
            })
            .collect();
        Ok(())
    })?;
    let names = (series.len() <= NAMED_SERIES).then(|| spread_names(&placed));
    let (width, height) = PLOT_SIZE;
    Ok(html! {
        svg.chart.scatter viewBox={ "0 0 " (width) " " (height) } role="group" aria-label=(title) {
            g.axes aria-hidden="true" { (axes) }
            @for (number, (series, placed)) in series.iter().zip(&placed).enumerate() {
                g class={ "series c" (number % COLOURS) } {
                    (drawn_series(series, placed))
                    @if let Some(names) = &names { (name(series, placed.end(), names[number])) }
                }
            }
        }
    })
}

fn drawn_series(series: &Series, placed: &Placed) -> Markup {
    let line: Vec<String> = (placed.marks.iter())
        .map(|(x, y)| format!("{x},{y}"))
        .collect();
    let right = PLOT_SIZE.0 as i32 - NAMES_WIDTH;
    let last = series.marks.len().saturating_sub(1);
    html! {
        @if let (Some(y), Some((_, description))) = (placed.level, &series.level) {
            line.level x1="72" x2=(right) y1=(y) y2=(y) aria-hidden="true" {}
            circle.point cx=(right) cy=(y) r="5" tabindex="0" role="img"
                aria-label=(description) data-tip=(description) {}
        }
        @if line.len() > 1 { polyline.curve points=(line.join(" ")) aria-hidden="true" {} }
        // The last mark of each can be reached with the keyboard; the others show text on hover.
        @for (at, (mark, (x, y))) in series.marks.iter().zip(&placed.marks).enumerate() {
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
    let left = PLOT_SIZE.0 as i32 - NAMES_WIDTH;
    let points = format!("{},{end} {},{y} {},{y}", left + 4, left + 12, left + 18);
    html! {
        polyline.lead-line points=(points) aria-hidden="true" {}
        text.label x=(left + 22) y=(y + 4) aria-hidden="true" { (shortened_to(&series.label, 20)) }
    }
}

/// Heights of the names: near their series, one below the other.
fn spread_names(placed: &[Placed]) -> Vec<i32> {
    let mut order: Vec<usize> = (0..placed.len()).collect();
    order.sort_by_key(|&at| placed[at].end());
    let mut heights = vec![0; placed.len()];
    let mut next = 16;
    for &at in &order {
        heights[at] = placed[at].end().max(next);
        next = heights[at] + NAME_PITCH;
    }
    // Names below the plot move up again.
    let mut most = PLOT_SIZE.1 as i32 - 12;
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

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawingError = Box<dyn std::error::Error>;

/// Returns the elements that plotters draws, without the `svg` element around them.
fn drawn(
    title: &str,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<(), DrawingError>,
) -> Result<Markup, LeaderboardError> {
    let failed = |reason: String| LeaderboardError::Chart {
        chart: title.to_owned(),
        reason,
    };
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present().map_err(Into::into))
            .map_err(|error| failed(error.to_string()))?;
    }
    let inner = text
        .split_once("<svg")
        .and_then(|(_, rest)| rest.split_once('>'))
        .and_then(|(_, rest)| rest.rsplit_once("</svg>"))
        .map(|(inner, _)| inner.trim().to_owned())
        .ok_or_else(|| failed("plotters drew no svg element".to_owned()))?;
    // Plotters escapes the texts that it draws.
    Ok(PreEscaped(inner))
}

/// Returns 1, 2 and 5 times powers of ten in a range, for the labels of a logarithmic axis.
fn round_numbers(low: f64, high: f64) -> Vec<f64> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    decades
        .flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(decade)))
        .filter(|value| (low..=high).contains(value))
        .collect()
}

fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

/// Formats a number at an axis, without needless digits.
fn round_label(value: f64) -> String {
    if value >= 1000.0 {
        format!("{value:.0}")
    } else {
        let text = format!("{value:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}
