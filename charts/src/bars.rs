//! Bars of shares of a total, one below the other.

use plotters::{
    prelude::{Rectangle, Text},
    style::{
        Color, FontFamily, FontStyle, IntoTextStyle, RGBColor, ShapeStyle,
        text_anchor::{HPos, Pos, VPos},
    },
};

use crate::{Area, ChartError, DrawingError, svg};

/// Bar with its labels.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Label left of the bar.
    pub label: String,
    /// Length as a share of the longest possible bar, in [0, 1].
    pub share: f64,
    /// Label right of the bar.
    pub value: String,
}

// Lengths in pixels of the figure.
const WIDTH: u32 = 760;
const MARGIN: i32 = 20;
const TITLE_HEIGHT: i32 = 56;
const ROW_HEIGHT: i32 = 30;
const BAR_HEIGHT: i32 = 18;
const LABEL_WIDTH: i32 = 210;
const VALUE_WIDTH: i32 = 150;

const INK: RGBColor = RGBColor(32, 36, 42);
const FAINT_INK: RGBColor = RGBColor(96, 104, 114);
const BAR: RGBColor = RGBColor(45, 106, 158);
const TRACK: RGBColor = RGBColor(233, 237, 241);
const PAPER: RGBColor = RGBColor(255, 255, 255);

/// Draws bars below a title and a line about their total; `empty` is the text without bars.
///
/// # Errors
/// When the plotting library fails.
pub fn bars(title: &str, about: &str, empty: &str, bars: &[Bar]) -> Result<String, ChartError> {
    let rows = bars.len().max(1) as i32;
    let height = TITLE_HEIGHT + rows * ROW_HEIGHT + MARGIN;
    svg((WIDTH, height as u32), |canvas| {
        canvas.fill(&PAPER)?;
        write(canvas, title, (MARGIN, 22), BarStyle::Title)?;
        write(canvas, about, (MARGIN, 42), BarStyle::Faint)?;
        if bars.is_empty() {
            write(canvas, empty, (MARGIN, TITLE_HEIGHT + 15), BarStyle::Faint)?;
        }
        let left = MARGIN + LABEL_WIDTH;
        let longest = WIDTH as i32 - left - VALUE_WIDTH;
        for (row, bar) in (0..).zip(bars) {
            let middle = TITLE_HEIGHT + row * ROW_HEIGHT + ROW_HEIGHT / 2;
            let (top, bottom) = (middle - BAR_HEIGHT / 2, middle + BAR_HEIGHT / 2);
            let length = (bar.share * f64::from(longest)).round() as i32;
            canvas.draw(&Rectangle::new(
                [(left, top), (left + longest, bottom)],
                filled(TRACK),
            ))?;
            canvas.draw(&Rectangle::new(
                [(left, top), (left + length, bottom)],
                filled(BAR),
            ))?;
            write(canvas, &bar.label, (left - 10, middle), BarStyle::Label)?;
            write(
                canvas,
                &bar.value,
                (left + longest + 10, middle),
                BarStyle::Plain,
            )?;
        }
        Ok(())
    })
}

fn filled(colour: RGBColor) -> ShapeStyle {
    colour.filled()
}

#[derive(Clone, Copy)]
enum BarStyle {
    Title,
    Plain,
    Faint,
    /// Text that ends at its position instead of starting there.
    Label,
}

fn write(
    canvas: &Area<'_>,
    text: &str,
    position: (i32, i32),
    look: BarStyle,
) -> Result<(), DrawingError> {
    let (size, style, colour, side) = match look {
        BarStyle::Title => (17, FontStyle::Bold, INK, HPos::Left),
        BarStyle::Plain => (13, FontStyle::Normal, INK, HPos::Left),
        BarStyle::Faint => (13, FontStyle::Normal, FAINT_INK, HPos::Left),
        BarStyle::Label => (13, FontStyle::Normal, INK, HPos::Right),
    };
    let style = (FontFamily::SansSerif, size, style)
        .into_text_style(canvas)
        .color(&colour)
        .pos(Pos::new(side, VPos::Center));
    canvas.draw(&Text::new(text.to_owned(), position, style))?;
    Ok(())
}
