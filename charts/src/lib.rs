//! Charts as SVG, drawn by plotters.
//!
//! ```text
//! lines  curves over logarithmic axes, with a legend below: a whole plot
//! axes   axes alone, and positions of curves that a page draws on them itself
//! bars   shares of a total, with labels: a whole plot
//! ```
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

#[macro_use]
mod mesh;
mod axes;
mod bars;
mod lines;

use std::error::Error;

use plotters::{coord::Shift, prelude::*};

pub use axes::{Axes, Curve, PlacedCurve, axes};
pub use bars::{Bar, bars};
pub use lines::{Series, decades_of, log_log, over_log_x};

/// Width and height of a chart of lines in its own units, without its legend.
pub const SIZE: (u32, u32) = (760, 420);
/// Width and height of a chart of lines for a phone, whose texts are as large as those of [`SIZE`]; without its legend.
pub const NARROW_SIZE: (u32, u32) = (380, 420);

/// Error of a chart that could not be drawn: one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ChartError(String);

/// Titles of the axes.
#[derive(Debug, Clone, Copy)]
pub struct Titles<'a> {
    /// Title below the horizontal axis.
    pub x: &'a str,
    /// Title beside the vertical axis.
    pub y: &'a str,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawingError = Box<dyn Error>;

/// Draws on an area of this size and returns the SVG.
fn svg(
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<(), DrawingError>,
) -> Result<String, ChartError> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present().map_err(Into::into))
            .map_err(|error| ChartError(error.to_string()))?;
    }
    Ok(text)
}
