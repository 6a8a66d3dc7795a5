//! Charts as SVG: plotters draws axes, bars and labels, the style sheet colours them.
//!
//! Points that a reader can reach are added on top, where plotters says they belong: they carry a
//! text alternative and what the script shows on hover.

use maud::{Markup, PreEscaped, html};
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use crate::error::LeaderboardError;

/// Width and height of a scatter plot in its own units; it scales with the page.
const SCATTER_SIZE: (u32, u32) = (760, 420);

/// Height of one bar with the space around it.
const BAR_PITCH: u32 = 34;

/// Width of a bar chart.
const BARS_WIDTH: u32 = 760;

/// Width that labels left of the bars get.
const LABEL_WIDTH: i32 = 290;

/// Below this many points each has its label beside it.
const LABELLED_POINTS: usize = 13;

/// A point of a scatter plot.
pub(super) struct Point<'a> {
    pub(super) label: &'a str,
    pub(super) x: f64,
    pub(super) y: f64,
    /// What is shown on hover and read aloud.
    pub(super) description: String,
    /// Whether no other point is better in both.
    pub(super) on_front: bool,
}

/// Points over a logarithmic axis of positive `x`; nothing without points.
pub(super) fn scatter(
    title: &str,
    x_title: &str,
    y_title: &str,
    points: &[Point<'_>],
) -> Result<Markup, LeaderboardError> {
    if points.is_empty() {
        return Ok(html! {});
    }
    let mut places = Vec::new();
    let axes = drawn(title, SCATTER_SIZE, |area| {
        let (x_low, x_high) = bounds(points.iter().map(|point| point.x));
        let (y_low, y_high) = bounds(points.iter().map(|point| point.y));
        // At least a decade of x and a unit of y, and room for labels at the border.
        let (x_low, x_high) = if x_high / x_low < 10.0 {
            let middle = (x_low * x_high).sqrt();
            (middle / 4.0, middle * 4.0)
        } else {
            (x_low / 1.5, x_high * 2.0)
        };
        let margin = (0.12 * (y_high - y_low)).max(0.5);
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_right(24)
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
        places = points
            .iter()
            .map(|point| chart.backend_coord(&(point.x, point.y)))
            .collect();
        Ok(())
    })?;
    let mut front: Vec<(i32, i32)> = points
        .iter()
        .zip(&places)
        .filter_map(|(point, &place)| point.on_front.then_some(place))
        .collect();
    front.sort_unstable();
    let line: Vec<String> = front.iter().map(|(x, y)| format!("{x},{y}")).collect();
    let (width, height) = SCATTER_SIZE;
    Ok(html! {
        svg.chart.scatter viewBox={ "0 0 " (width) " " (height) } role="group" aria-label=(title) {
            g.axes aria-hidden="true" { (axes) }
            polyline.front points=(line.join(" ")) aria-hidden="true" {}
            @for (point, (x, y)) in points.iter().zip(&places) {
                (mark(point, *x, *y, points.len() < LABELLED_POINTS))
            }
        }
    })
}

fn mark(point: &Point<'_>, x: i32, y: i32, labelled: bool) -> Markup {
    let class = if point.on_front {
        "point on-front"
    } else {
        "point"
    };
    // Labels turn inward near the right border.
    let inward = x > SCATTER_SIZE.0 as i32 - 180;
    let (anchor, offset) = if inward { ("end", -10) } else { ("start", 10) };
    html! {
        circle class=(class) cx=(x) cy=(y) r="6" tabindex="0" role="img"
            aria-label=(point.description) data-tip=(point.description) {}
        @if labelled {
            text.label x=(x + offset) y=(y - 9) text-anchor=(anchor) aria-hidden="true" {
                (point.label)
            }
        }
    }
}

/// A bar with its label and number.
pub(super) struct Bar {
    pub(super) label: String,
    pub(super) value: u64,
}

/// Horizontal bars from 0, all in one unit.
pub(super) fn bars(title: &str, bars: &[Bar]) -> Result<Markup, LeaderboardError> {
    let height = BAR_PITCH * bars.len() as u32 + 8;
    let size = (BARS_WIDTH, height);
    let most = bars.iter().map(|bar| bar.value).max().unwrap_or(0).max(1);
    let drawing = drawn(title, size, |area| {
        let left = LABEL_WIDTH + 10;
        // Room for the number right of the longest bar.
        let longest = BARS_WIDTH as i32 - left - 70;
        let label_style = |horizontal: HPos| {
            ("sans-serif", 14)
                .into_text_style(area)
                .pos(Pos::new(horizontal, VPos::Center))
        };
        for (row, bar) in bars.iter().enumerate() {
            let top = 4 + row as i32 * BAR_PITCH as i32;
            let middle = top + BAR_PITCH as i32 / 2;
            let length = (f64::from(longest) * bar.value as f64 / most as f64).round() as i32;
            area.draw(&Rectangle::new(
                [
                    (left, top + 6),
                    (left + length.max(1), top + BAR_PITCH as i32 - 6),
                ],
                BLUE.filled(),
            ))?;
            area.draw(&Text::new(
                shortened(&bar.label),
                (LABEL_WIDTH, middle),
                label_style(HPos::Right),
            ))?;
            area.draw(&Text::new(
                bar.value.to_string(),
                (left + length + 8, middle),
                label_style(HPos::Left),
            ))?;
        }
        Ok(())
    })?;
    let description: Vec<String> = bars
        .iter()
        .map(|bar| format!("{}: {}", bar.label, bar.value))
        .collect();
    let (width, height) = size;
    Ok(html! {
        svg.chart.bars viewBox={ "0 0 " (width) " " (height) } role="img"
            aria-label={ (title) ". " (description.join("; ")) } { (drawing) }
    })
}

/// A label that fits beside its bar; the text alternative has all of it.
fn shortened(label: &str) -> String {
    const CHARACTERS: usize = 40;
    if label.chars().count() <= CHARACTERS {
        return label.to_owned();
    }
    let kept: String = label.chars().take(CHARACTERS - 1).collect();
    format!("{}…", kept.trim_end())
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawingError = Box<dyn std::error::Error>;

/// The elements that plotters draws, without the `svg` element around them.
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

/// 1, 2 and 5 times powers of ten in a range, for the labels of a logarithmic axis.
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

/// A number at an axis, without needless digits.
fn round_label(value: f64) -> String {
    if value >= 1000.0 {
        format!("{value:.0}")
    } else {
        let text = format!("{value:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}
