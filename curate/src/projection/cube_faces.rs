//! Detection of cube faces: equi-angular (EAC) or plain, in any order and orientation.
//!
//! Two things reveal cube faces. If the layout puts faces beside each other that are not neighbours on the cube, the
//! image breaks along a straight line. And every edge at the image's border is continued by some edge of another face.

use omnilife_schemas::statistics;
use omnilife_video::Rgb8Image;

use super::{ProjectionTest, median_over};

/// Columns and rows of the tested layouts. 3x2 is that of EAC and of most cube maps.
const LAYOUTS: [(usize, usize); 4] = [(3, 2), (6, 1), (1, 6), (2, 3)];
/// Number of compared points along an edge.
const EDGE_POINTS: usize = 48;
/// Mean deviation along an edge, in 8-bit levels, below which it resembles every other plain edge.
const LEAST_EDGE_CONTRAST_LEVELS: f64 = 6.0;
/// Least number of outer edges with contrast for judging a layout.
const LEAST_EDGES: usize = 5;
/// Difference, in 8-bit levels, between far and near lines below which an image is too plain.
const LEAST_CONTRAST_LEVELS: f64 = 1.5;

/// The edges at the image's border.
pub(super) const OUTER_EDGES: ProjectionTest = ProjectionTest {
    id: "cube-outer-edges",
    summary: "How far the edges at the border are from the most similar edge of another face, on \
              the scale on which neighbouring lines are 0 and unrelated edges 1, in the cube \
              layout that fits best among those that break. Every edge of a cube is shared by two faces.",
    limit: 0.23,
    at_most: "the edges at the border are continued by other edges, as those of cube faces",
    above: "the edges at the border are continued nowhere in the image",
    measure: |_, samples| median_over(samples, |image| best_layout(image).map(|best| best.0)),
};

/// The lines on which faces meet.
pub(super) const FACE_BREAKS: ProjectionTest = ProjectionTest {
    id: "cube-face-breaks",
    summary: "Break of the image along the lines on which the faces of that layout meet, on the \
              scale on which neighbouring lines are 0 and distant ones 1.",
    limit: 0.35,
    at_most: "the image goes on where cube faces would meet",
    above: "the image breaks where cube faces would meet",
    measure: |_, samples| median_over(samples, |image| best_layout(image).map(|best| best.1)),
};

/// Returns outer edge distance and break of the layout whose outer edges fit best; layouts that break where their faces
/// meet take precedence.
fn best_layout(image: &Rgb8Image) -> Option<(f64, f64)> {
    LAYOUTS
        .iter()
        .filter_map(|&(columns, rows)| {
            let edges = outer_edge_distance(image, columns, rows)?;
            Some((edges, line_break(image, columns, rows)?))
        })
        .min_by(|a, b| {
            let goes_on = |layout: &(f64, f64)| layout.1 <= FACE_BREAKS.limit;
            (goes_on(a).cmp(&goes_on(b))).then(a.0.total_cmp(&b.0))
        })
}

type Strip = [[f64; 3]; EDGE_POINTS];

struct Edge {
    face: usize,
    is_outer: bool,
    strip: Strip,
    /// Distance from the line next to it, inside the face.
    to_neighbour: f64,
}

fn outer_edge_distance(image: &Rgb8Image, columns: usize, rows: usize) -> Option<f64> {
    if image.width < 16 * columns || image.height < 16 * rows {
        return None;
    }
    let edges = edges(image, columns, rows);
    let mut nearest = vec![f64::INFINITY; edges.len()];
    let mut unrelated = Vec::new();
    for (a, one) in edges.iter().enumerate() {
        for (b, other) in edges.iter().enumerate().skip(a + 1) {
            if one.face == other.face {
                continue;
            }
            let between = distance(&one.strip, &other.strip, false).min(distance(
                &one.strip,
                &other.strip,
                true,
            ));
            nearest[a] = nearest[a].min(between);
            nearest[b] = nearest[b].min(between);
            unrelated.push(between);
        }
    }
    let near = statistics::median(
        &edges
            .iter()
            .map(|edge| edge.to_neighbour)
            .collect::<Vec<_>>(),
    )?;
    let far = statistics::median(&unrelated)?;
    let found: Vec<f64> = edges
        .iter()
        .zip(&nearest)
        .filter(|(edge, _)| edge.is_outer && contrast(&edge.strip) > LEAST_EDGE_CONTRAST_LEVELS)
        .map(|(_, nearest)| (nearest - near) / (far - near))
        .collect();
    if found.len() < LEAST_EDGES || far - near < LEAST_CONTRAST_LEVELS {
        return None;
    }
    Some(statistics::median(&found)?.max(0.0))
}

/// Returns the four edges of every face.
fn edges(image: &Rgb8Image, columns: usize, rows: usize) -> Vec<Edge> {
    let mut edges = Vec::new();
    for face in 0..columns * rows {
        let (column, row) = (face % columns, face / columns);
        // Pixels that lie in this face alone.
        let span = |part: usize, parts: usize, length: usize| {
            ((part * length).div_ceil(parts), (part + 1) * length / parts)
        };
        let (left, right) = span(column, columns, image.width);
        let (top, bottom) = span(row, rows, image.height);
        let along_row = |y: usize| strip(left..right, |x| image.pixel(x, y));
        let along_column = |x: usize| strip(top..bottom, |y| image.pixel(x, y));
        let mut add = |is_outer, strip: Strip, inside: Strip| {
            edges.push(Edge {
                face,
                is_outer,
                to_neighbour: distance(&strip, &inside, false),
                strip,
            });
        };
        add(row == 0, along_row(top), along_row(top + 2));
        add(
            row + 1 == rows,
            along_row(bottom - 1),
            along_row(bottom - 3),
        );
        add(column == 0, along_column(left), along_column(left + 2));
        add(
            column + 1 == columns,
            along_column(right - 1),
            along_column(right - 3),
        );
    }
    edges
}

/// Means over equal parts of a line: single pixels of two edges need not lie side by side.
fn strip(line: std::ops::Range<usize>, pixel: impl Fn(usize) -> [u8; 3]) -> Strip {
    let at = |part: usize| line.start + part * line.len() / EDGE_POINTS;
    std::array::from_fn(|part| {
        let (begin, end) = (at(part), at(part + 1).max(at(part) + 1));
        let mut mean = [0.0; 3];
        for position in begin..end {
            for (sum, level) in mean.iter_mut().zip(pixel(position)) {
                *sum += f64::from(level) / (end - begin) as f64;
            }
        }
        mean
    })
}

/// Returns the mean absolute difference of two strips in 8-bit levels, optionally with one of them reversed.
fn distance(a: &Strip, b: &Strip, backwards: bool) -> f64 {
    let mut sum = 0.0;
    for (index, one) in a.iter().enumerate() {
        let other = b[if backwards {
            EDGE_POINTS - 1 - index
        } else {
            index
        }];
        sum += one
            .iter()
            .zip(other)
            .map(|(p, q)| (p - q).abs())
            .sum::<f64>();
    }
    sum / (3 * EDGE_POINTS) as f64
}

/// Returns the mean absolute deviation from the strip's mean colour.
fn contrast(strip: &Strip) -> f64 {
    let mut mean = [0.0; 3];
    for point in strip {
        for (sum, level) in mean.iter_mut().zip(point) {
            *sum += level / EDGE_POINTS as f64;
        }
    }
    distance(strip, &[mean; EDGE_POINTS], false)
}

/// Returns the break along the rows or along the columns on which faces of a layout meet, the larger one.
fn line_break(image: &Rgb8Image, columns: usize, rows: usize) -> Option<f64> {
    let row_difference = |a: usize, b: usize| {
        mean_difference(image.width, |x| (image.pixel(x, a), image.pixel(x, b)))
    };
    let column_difference = |a: usize, b: usize| {
        mean_difference(image.height, |y| (image.pixel(a, y), image.pixel(b, y)))
    };
    let along_rows = breaks(image.height, rows, row_difference);
    let along_columns = breaks(image.width, columns, column_difference);
    match (along_rows, along_columns) {
        (Some(a), Some(b)) => Some(a.max(b)),
        (one, other) => one.or(other),
    }
}

/// Returns the median break at the lines that divide `length` lines into `parts`.
fn breaks(length: usize, parts: usize, difference: impl Fn(usize, usize) -> f64) -> Option<f64> {
    if parts < 2 || length < 16 {
        return None;
    }
    // Scaling mixes the two lines that touch.
    let across = |line: usize| difference(line - 2, line + 1);
    let near: Vec<f64> = (2..length - 1).step_by(2).map(across).collect();
    let far: Vec<f64> = (0..length)
        .step_by(3)
        .map(|line| difference(line, (line + length / 3) % length))
        .collect();
    let (near, far) = (statistics::median(&near)?, statistics::median(&far)?);
    if far - near < LEAST_CONTRAST_LEVELS {
        return None;
    }
    let found: Vec<f64> = (1..parts)
        .map(|part| ((across((length * part + parts / 2) / parts) - near) / (far - near)).max(0.0))
        .collect();
    statistics::median(&found)
}

fn mean_difference(count: usize, pair: impl Fn(usize) -> ([u8; 3], [u8; 3])) -> f64 {
    let mut sum = 0_u64;
    for index in 0..count {
        let (a, b) = pair(index);
        sum += a
            .iter()
            .zip(b)
            .map(|(&p, q)| u64::from(p.abs_diff(q)))
            .sum::<u64>();
    }
    sum as f64 / (3 * count) as f64
}
