//! Lines over logarithmic axes, with a legend where it hides the fewest points.

use std::ops::Range;

use plotters::prelude::*;

use crate::{ChartError, DrawingError, Titles, svg};

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

/// Draws series and the legend.
macro_rules! lines {
    ($chart:ident, $series:ident, $legend:expr) => {
        for (index, series) in $series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            $chart
                .draw_series(LineSeries::new(
                    series.points.iter().copied(),
                    colour.stroke_width(2),
                ))?
                .label(series.name.as_str())
                .legend(move |(x, y)| {
                    PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2))
                });
            let circle = |&point: &(f64, f64)| Circle::new(point, 3, colour.filled());
            $chart.draw_series(series.points.iter().map(circle))?;
        }
        $chart
            .configure_series_labels()
            .position($legend)
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK.mix(0.3))
            .label_font(("sans-serif", 13))
            .draw()?;
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

/// Draws lines over a logarithmic x axis, with `y` on a linear one, on a chart of this width and height.
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
        let legend = emptiest_corner(series, |point| {
            [share_of_decades(point.0, &x), share(point.1, &y)]
        });
        let mut chart = builder.build_cartesian_2d(x.log_scale(), y)?;
        mesh!(
            chart,
            titles,
            8,
            |value: &f64| short(*value),
            |value: &f64| format!("{value:.1}")
        );
        lines!(chart, series, legend);
        Ok(())
    })
}

/// Draws lines over a logarithmic x axis, with `y` on another one, on a chart of this width and height.
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
        let legend = emptiest_corner(series, |point| {
            [share_of_decades(point.0, &x), share_of_decades(point.1, &y)]
        });
        let mut chart = builder.build_cartesian_2d(x.log_scale(), y.log_scale())?;
        mesh!(
            chart,
            titles,
            8,
            |value: &f64| short(*value),
            |value: &f64| format!("{value:.0e}")
        );
        lines!(chart, series, legend);
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
    svg(size, |area| {
        area.fill(&WHITE)?;
        let mut builder = ChartBuilder::on(area);
        builder
            .caption(caption, ("sans-serif", 17))
            .margin(10)
            .margin_right(24)
            .x_label_area_size(46)
            .y_label_area_size(62);
        body(&mut builder)
    })
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

/// Share of a chart's width and of its height that a legend may take.
const LEGEND_SHARE: [f64; 2] = [0.45, 0.35];

/// Returns the corner in which a legend hides the fewest points; `place` gives a point's shares of the chart's width,
/// from the left, and of its height, from below.
fn emptiest_corner(
    series: &[Series],
    place: impl Fn((f64, f64)) -> [f64; 2],
) -> SeriesLabelPosition {
    use SeriesLabelPosition::{LowerLeft, LowerRight, UpperLeft, UpperRight};
    let places: Vec<[f64; 2]> = series
        .iter()
        .flat_map(|series| series.points.iter().map(|&point| place(point)))
        .collect();
    let hidden = |is_right: bool, is_upper: bool| {
        let from = |share: f64, is_far: bool| if is_far { 1.0 - share } else { share };
        let is_hidden = |&&[x, y]: &&[f64; 2]| {
            from(x, is_right) < LEGEND_SHARE[0] && from(y, is_upper) < LEGEND_SHARE[1]
        };
        places.iter().filter(is_hidden).count()
    };
    // Takes the first of equally empty ones.
    let mut corners = [
        (hidden(true, false), LowerRight),
        (hidden(false, true), UpperLeft),
        (hidden(true, true), UpperRight),
        (hidden(false, false), LowerLeft),
    ];
    corners.sort_by_key(|&(hidden, _)| hidden);
    let [(_, corner), ..] = corners;
    corner
}

/// Returns the position of a value in a range, 0 at its start and 1 at its end.
fn share(value: f64, range: &Range<f64>) -> f64 {
    (value - range.start) / (range.end - range.start)
}

/// Returns the position of a value in a range on a logarithmic axis.
fn share_of_decades(value: f64, range: &Range<f64>) -> f64 {
    share(value.log10(), &(range.start.log10()..range.end.log10()))
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

    #[test]
    fn the_legend_lies_where_no_point_is() {
        let corner = |points: &[(f64, f64)]| {
            let series = [Series {
                name: "a".to_owned(),
                points: points.to_vec(),
            }];
            emptiest_corner(&series, |(x, y)| [x, y])
        };
        assert_eq!(corner(&[(0.5, 0.5)]), SeriesLabelPosition::LowerRight);
        assert_eq!(
            corner(&[(0.9, 0.1), (0.9, 0.9)]),
            SeriesLabelPosition::UpperLeft
        );
        assert_eq!(
            corner(&[(0.9, 0.1), (0.1, 0.9)]),
            SeriesLabelPosition::UpperRight
        );
        assert_eq!(
            corner(&[(0.9, 0.1), (0.1, 0.9), (0.9, 0.8)]),
            SeriesLabelPosition::LowerLeft
        );
        let decades = 10.0..1000.0;
        assert!((share_of_decades(100.0, &decades) - 0.5).abs() < 1e-12);
        assert_eq!(share(30.0, &(20.0..40.0)), 0.5);
    }
}
