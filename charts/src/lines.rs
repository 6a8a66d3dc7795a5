//! Lines over logarithmic axes, with a legend below them.

use std::ops::Range;

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use crate::{Area, ChartError, DrawingError, Titles, axes::round_numbers, svg};

/// Colours of series in turn; they can be told apart without seeing red and green.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(60, 60, 60),
];

// Lengths in units of the chart.
const MARGIN: u32 = 10;
const RIGHT_MARGIN: u32 = 24;
const Y_LABELS_WIDTH: u32 = 62;
const LEGEND_LINE: u32 = 18;
/// Width of a dash of a series' colour with the space before the name.
const KEY_WIDTH: u32 = 26;
const DASH_WIDTH: i32 = 18;
/// Space between a name and the next dash.
const NAME_GAP: u32 = 16;
/// Width of a letter of a name in a wide font.
const LETTER_WIDTH: u32 = 6;

/// Ratio of the ends of a logarithmic axis below which it has labels at 1, 2 and 5 times powers of ten: two decades, with
/// a margin for rounding.
const MOST_FINE_RATIO: f64 = 101.0;

/// Draws series.
macro_rules! lines {
    ($chart:ident, $series:ident) => {
        for (index, series) in $series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            $chart.draw_series(LineSeries::new(
                series.points.iter().copied(),
                colour.stroke_width(2),
            ))?;
            let circle = |&point: &(f64, f64)| Circle::new(point, 3, colour.filled());
            $chart.draw_series(series.points.iter().map(circle))?;
        }
    };
}

/// Line with its name.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Finite points; x is positive, and y too where the axis is logarithmic.
    pub points: Vec<(f64, f64)>,
}

/// Draws lines over a logarithmic x axis, with `y` on a linear one, on a chart of this width and height and a legend
/// below it.
///
/// # Errors
/// When no series has a point, or the plotting library fails.
pub fn over_log_x(
    size: (u32, u32),
    caption: &str,
    titles: &Titles<'_>,
    series: &[Series],
) -> Result<String, ChartError> {
    let (x, y) = ranges(series);
    let margin = (0.08 * (y.end - y.start)).max(0.25);
    draw(size, caption, series, |builder| {
        let (x, y) = (decades(&x), y.start - margin..y.end + margin);
        let mut chart = builder.build_cartesian_2d(x.log_scale(), y)?;
        mesh!(
            chart,
            titles,
            8,
            |value: &f64| short(*value),
            |value: &f64| format!("{value:.1}")
        );
        lines!(chart, series);
        Ok(())
    })
}

/// Draws lines over a logarithmic x axis, with `y` on another one, on a chart of this width and height and a legend
/// below it.
///
/// # Errors
/// When no series has a point, or the plotting library fails.
pub fn log_log(
    size: (u32, u32),
    caption: &str,
    titles: &Titles<'_>,
    series: &[Series],
) -> Result<String, ChartError> {
    let (x, y) = ranges(series);
    draw(size, caption, series, |builder| {
        let (x, y) = (decades(&x), decades(&y));
        let x_label = |value: &f64| short(*value);
        // Powers of ten alone would be a label or two.
        if y.end / y.start < MOST_FINE_RATIO {
            let labels = round_numbers(y.start, y.end);
            let y = y.log_scale().with_key_points(labels);
            let mut chart = builder.build_cartesian_2d(x.log_scale(), y)?;
            mesh!(chart, titles, 8, x_label, x_label);
            lines!(chart, series);
        } else {
            let mut chart = builder.build_cartesian_2d(x.log_scale(), y.log_scale())?;
            mesh!(chart, titles, 8, x_label, |value: &f64| format!(
                "{value:.0e}"
            ));
            lines!(chart, series);
        }
        Ok(())
    })
}

fn draw(
    size: (u32, u32),
    caption: &str,
    series: &[Series],
    body: impl FnOnce(&mut ChartBuilder<'_, '_, SVGBackend<'_>>) -> Result<(), DrawingError>,
) -> Result<String, ChartError> {
    if series.iter().all(|series| series.points.is_empty()) {
        return Err(ChartError(
            "a plot must have something to draw, got no values".to_owned(),
        ));
    }
    let (width, height) = size;
    let places = legend_places(width, series);
    svg((width, height + legend_height(&places)), |area| {
        area.fill(&WHITE)?;
        let (plot, below) = area.split_vertically(height);
        let mut builder = ChartBuilder::on(&plot);
        builder
            .caption(caption, ("sans-serif", 17))
            .margin(MARGIN)
            .margin_right(RIGHT_MARGIN)
            .x_label_area_size(46)
            .y_label_area_size(Y_LABELS_WIDTH);
        body(&mut builder)?;
        draw_legend(&below, series, &places)
    })
}

/// Returns the place of each series in the legend, from the left and below the axes; a line holds as many as fit.
fn legend_places(width: u32, series: &[Series]) -> Vec<(u32, u32)> {
    let left = MARGIN + Y_LABELS_WIDTH;
    let (mut x, mut y) = (left, LEGEND_LINE / 2);
    let mut places = Vec::new();
    for series in series {
        let taken = KEY_WIDTH + LETTER_WIDTH * series.name.chars().count() as u32;
        if x > left && x + taken + RIGHT_MARGIN > width {
            (x, y) = (left, y + LEGEND_LINE);
        }
        places.push((x, y));
        x += taken + NAME_GAP;
    }
    places
}

/// Returns the height of a legend with space below it.
fn legend_height(places: &[(u32, u32)]) -> u32 {
    places.last().map_or(0, |&(_, y)| y + LEGEND_LINE)
}

/// Draws the names of series, each right of a dash of its colour.
fn draw_legend(
    area: &Area<'_>,
    series: &[Series],
    places: &[(u32, u32)],
) -> Result<(), DrawingError> {
    let style = ("sans-serif", 13)
        .into_text_style(area)
        .pos(Pos::new(HPos::Left, VPos::Center));
    for (index, (series, &(x, y))) in series.iter().zip(places).enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let (left, y) = (x as i32, y as i32);
        let dash = vec![(left, y), (left + DASH_WIDTH, y)];
        area.draw(&PathElement::new(dash, colour.stroke_width(2)))?;
        let begin = (left + KEY_WIDTH as i32, y);
        area.draw(&Text::new(series.name.clone(), begin, style.clone()))?;
    }
    Ok(())
}

/// Returns the ranges of both coordinates over all series.
fn ranges(series: &[Series]) -> (Range<f64>, Range<f64>) {
    let range = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        low..high
    };
    let points = || series.iter().flat_map(|series| &series.points);
    (
        range(points().map(|point| point.0).collect()),
        range(points().map(|point| point.1).collect()),
    )
}

/// Returns the whole decades around a range of positive numbers.
fn decades(range: &Range<f64>) -> Range<f64> {
    let low = 10_f64.powf(range.start.log10().floor());
    let high = 10_f64.powf(range.end.log10().ceil());
    if high > low {
        low..high
    } else {
        low..10.0 * low
    }
}

/// Returns whole decades around positive numbers; `None` without numbers.
pub fn decades_of(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let range = values.fold(None, |range: Option<Range<f64>>, value| {
        let range = range.unwrap_or(value..value);
        Some(range.start.min(value)..range.end.max(value))
    });
    let decades = decades(&range?);
    Some([decades.start, decades.end])
}

/// Returns a number in its shortest form.
fn short(value: f64) -> String {
    if (0.01..10_000.0).contains(&value) {
        format!("{value}")
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number_after(text: &str, key: &str) -> u32 {
        let (_, rest) = text.split_once(key).expect("the attribute");
        let (number, _) = rest.split_once('"').expect("its end");
        number.parse().expect("a number")
    }

    #[test]
    fn a_legend_lies_below_the_axes_on_as_many_lines_as_it_needs() {
        let long = "l".repeat(40);
        let names = ["one", "two", long.as_str(), "four"];
        let series = names.map(|name| Series {
            name: name.to_owned(),
            points: vec![(1.0, 2.0), (20.0, 3.0), (99.0, 2.0)],
        });
        let places = legend_places(380, &series);
        let lines: Vec<u32> = places.iter().map(|&(_, y)| y / LEGEND_LINE).collect();
        assert_eq!(lines, [0, 0, 1, 2]);
        assert!(places[1].0 > places[0].0 + KEY_WIDTH + 3 * LETTER_WIDTH);
        assert_eq!((places[2].0, places[3].0), (places[0].0, places[0].0));
        // A name that no line can hold has one of its own, too.
        let wide = legend_places(150, &series);
        let lines: Vec<u32> = wide.iter().map(|&(_, y)| y / LEGEND_LINE).collect();
        assert_eq!(lines, [0, 1, 2, 3]);

        let titles = Titles { x: "x", y: "y" };
        let drawings = [
            over_log_x((380, 420), "lines", &titles, &series),
            log_log((380, 420), "lines", &titles, &series),
        ];
        for drawing in drawings {
            let text = drawing.expect("drawn");
            let height = number_after(&text, " height=\"");
            assert_eq!(height, 420 + legend_height(&places));
            let points: Vec<&str> = text.split("<circle").skip(1).collect();
            assert_eq!(points.len(), 12);
            assert!(points.iter().all(|of| number_after(of, "cy=\"") < 420));
            for name in names {
                let ends = format!("\n{name}\n");
                let of = text.split("<text").find(|of| of.contains(&ends));
                let y = number_after(of.expect("the name"), " y=\"");
                assert!((421..height).contains(&y), "{name}: {y}");
            }
        }
    }
}
