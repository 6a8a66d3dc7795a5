//! The figures of a dataset as SVG: bars of the frequency of each class (the paper's Figure 3).

use plotters::{
    coord::Shift,
    prelude::{DrawingArea, IntoDrawingArea, Rectangle, SVGBackend, Text},
    style::{
        Color, FontFamily, FontStyle, IntoTextStyle, RGBColor, ShapeStyle,
        text_anchor::{HPos, Pos, VPos},
    },
};

use super::statistics::{DISTRIBUTIONS, Statistics, Tally};
use crate::error::CurateError;

/// A figure.
#[derive(Debug, Clone, Copy)]
pub(super) struct Figure {
    /// File in the statistics folder.
    pub(super) file: &'static str,
    /// Its title.
    pub(super) title: &'static str,
    /// Id of the distribution it shows.
    pub(super) distribution: &'static str,
}

/// All figures.
pub(super) const FIGURES: &[Figure] = &[
    Figure {
        file: "groups.svg",
        title: "Sequences per semantic group",
        distribution: "group",
    },
    Figure {
        file: "scenes.svg",
        title: "Sequences per scene category",
        distribution: "scene",
    },
    Figure {
        file: "actions.svg",
        title: "Sequences per action",
        distribution: "action",
    },
    Figure {
        file: "ego-motion.svg",
        title: "Sequences per ego-motion class",
        distribution: "ego-motion",
    },
    Figure {
        file: "dynamics.svg",
        title: "Sequences per level of dynamic content",
        distribution: "dynamics",
    },
    Figure {
        file: "durations.svg",
        title: "Sequences per duration",
        distribution: "duration",
    },
];

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

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws a figure.
///
/// # Errors
/// [`CurateError::Internal`] when the drawing library fails.
pub(super) fn draw(figure: &Figure, statistics: &Statistics) -> Result<String, CurateError> {
    let tallies = DISTRIBUTIONS
        .iter()
        .find(|distribution| distribution.id == figure.distribution)
        .map(|distribution| statistics.tally(distribution))
        .unwrap_or_default();
    let mut text = String::new();
    draw_bars(&mut text, figure.title, &tallies)
        .map_err(|error| CurateError::internal(figure.file.as_ref(), error))?;
    text.push('\n');
    Ok(text)
}

fn draw_bars(
    text: &mut String,
    title: &str,
    tallies: &[(String, Tally)],
) -> Result<(), Box<dyn std::error::Error>> {
    let total: usize = tallies.iter().map(|(_, tally)| tally.sequences).sum();
    let seconds: f64 = tallies.iter().map(|(_, tally)| tally.seconds).sum();
    let rows = tallies.len().max(1) as i32;
    let height = TITLE_HEIGHT + rows * ROW_HEIGHT + MARGIN;
    let canvas = SVGBackend::with_string(text, (WIDTH, height as u32)).into_drawing_area();
    canvas.fill(&PAPER)?;
    write(&canvas, title, (MARGIN, 22), Look::Title)?;
    let subtitle = format!("{total} sequences, {:.2} hours", seconds / 3600.0);
    write(&canvas, &subtitle, (MARGIN, 42), Look::Faint)?;
    if tallies.is_empty() {
        write(
            &canvas,
            "no sequences",
            (MARGIN, TITLE_HEIGHT + 15),
            Look::Faint,
        )?;
    }
    let left = MARGIN + LABEL_WIDTH;
    let longest = WIDTH as i32 - left - VALUE_WIDTH;
    for (row, (class, tally)) in (0..).zip(tallies) {
        let middle = TITLE_HEIGHT + row * ROW_HEIGHT + ROW_HEIGHT / 2;
        let (top, bottom) = (middle - BAR_HEIGHT / 2, middle + BAR_HEIGHT / 2);
        // Bars are shares of all sequences, so that figures can be compared.
        let share = tally.sequences as f64 / total as f64;
        let length = (share * f64::from(longest)).round() as i32;
        canvas.draw(&Rectangle::new(
            [(left, top), (left + longest, bottom)],
            filled(TRACK),
        ))?;
        canvas.draw(&Rectangle::new(
            [(left, top), (left + length, bottom)],
            filled(BAR),
        ))?;
        write(&canvas, class, (left - 10, middle), Look::Label)?;
        let value = format!("{} ({:.1} %)", tally.sequences, 100.0 * share);
        write(&canvas, &value, (left + longest + 10, middle), Look::Plain)?;
    }
    canvas.present()?;
    Ok(())
}

fn filled(colour: RGBColor) -> ShapeStyle {
    colour.filled()
}

#[derive(Clone, Copy)]
enum Look {
    Title,
    Plain,
    Faint,
    /// Ends at its position instead of starting there.
    Label,
}

fn write(
    canvas: &Canvas<'_>,
    text: &str,
    position: (i32, i32),
    look: Look,
) -> Result<(), Box<dyn std::error::Error>> {
    let (size, style, colour, side) = match look {
        Look::Title => (17, FontStyle::Bold, INK, HPos::Left),
        Look::Plain => (13, FontStyle::Normal, INK, HPos::Left),
        Look::Faint => (13, FontStyle::Normal, FAINT_INK, HPos::Left),
        Look::Label => (13, FontStyle::Normal, INK, HPos::Right),
    };
    let style = (FontFamily::SansSerif, size, style)
        .into_text_style(canvas)
        .color(&colour)
        .pos(Pos::new(side, VPos::Center));
    canvas.draw(&Text::new(text.to_owned(), position, style))?;
    Ok(())
}
