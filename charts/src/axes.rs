//! Axes of curves that a page draws itself: a logarithmic axis of positive numbers and a linear one.

use plotters::prelude::*;

use crate::{ChartError, SIZE, Titles, svg};

/// Curve, or a level across the plot, in numbers of the axes.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    /// Points from the left; `x` is positive.
    pub points: Vec<(f64, f64)>,
    /// Height of the level.
    pub level: Option<f64>,
}

/// Curve in units of the plot, from its upper left corner.
#[derive(Debug, Clone)]
pub struct PlacedCurve {
    /// Position of each point, in units of the plot.
    pub points: Vec<(i32, i32)>,
    /// Height of the level.
    pub level: Option<i32>,
}

/// Axes with the positions of the curves.
#[derive(Debug, Clone)]
pub struct Axes {
    /// SVG elements, without the `svg` element of [`SIZE`] around them.
    pub elements: String,
    /// Curves in their order.
    pub curves: Vec<PlacedCurve>,
}

/// Draws axes around curves, at least one of which has points; `margin` units stay free on the right.
///
/// # Errors
/// When the plotting library fails.
pub fn axes(titles: &Titles<'_>, margin: i32, curves: &[Curve]) -> Result<Axes, ChartError> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let levels = curves.iter().filter_map(|curve| curve.level);
    let (x_low, x_high) = bounds(points().map(|point| point.0));
    let (y_low, y_high) = bounds(points().map(|point| point.1).chain(levels));
    // At least a decade of x and a unit of y.
    let (x_low, x_high) = if x_high / x_low < 10.0 {
        let middle = (x_low * x_high).sqrt();
        (middle / 4.0, middle * 4.0)
    } else {
        (x_low / 1.3, x_high * 1.3)
    };
    let y_margin = (0.08 * (y_high - y_low)).max(0.5);
    let mut placed = Vec::new();
    let text = svg(SIZE, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_right(margin)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(
                (x_low..x_high)
                    .log_scale()
                    .with_key_points(round_numbers(x_low, x_high)),
                y_low - y_margin..y_high + y_margin,
            )?;
        let label = |value: &f64| round_label(*value);
        mesh!(chart, titles, 6, label, label);
        placed = curves
            .iter()
            .map(|curve| PlacedCurve {
                points: (curve.points.iter())
                    .map(|point| chart.backend_coord(point))
                    .collect(),
                level: (curve.level).map(|level| chart.backend_coord(&(x_low, level)).1),
            })
            .collect();
        Ok(())
    })?;
    let elements = text
        .split_once("<svg")
        .and_then(|(_, rest)| rest.split_once('>'))
        .and_then(|(_, rest)| rest.rsplit_once("</svg>"))
        .map(|(elements, _)| elements.trim().to_owned())
        .ok_or_else(|| ChartError("plotters drew no svg element".to_owned()))?;
    Ok(Axes {
        elements,
        curves: placed,
    })
}

/// Returns 1, 2 and 5 times powers of ten in a range, for the labels of a logarithmic axis.
pub(super) fn round_numbers(low: f64, high: f64) -> Vec<f64> {
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

/// Returns the label of a number at an axis, without needless digits.
fn round_label(value: f64) -> String {
    if value >= 1000.0 {
        format!("{value:.0}")
    } else {
        let text = format!("{value:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}
