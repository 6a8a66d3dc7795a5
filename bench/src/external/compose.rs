//! Views put together from the images that a method leaves: a cell of a grid, the faces of a cube.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    RgbImage, camera::ErpCamera, image_file::ImageFile, interpolation::panorama_of_faces,
};

use super::manifest::Cell;

/// Puts a view together from its image, or from the faces of its cube. `size` is the width and height of the panorama,
/// pixels.
///
/// # Errors
/// When an image cannot be read or has another layout; one line.
pub(super) fn view(
    sources: &[PathBuf],
    cell: Option<Cell>,
    [width, height]: [u32; 2],
) -> Result<RgbImage, String> {
    let images: Result<Vec<RgbImage>, String> =
        sources.iter().map(|source| part(source, cell)).collect();
    let mut images = images?;
    if images.len() > 1 {
        for (image, source) in images.iter().zip(sources) {
            if image.width != image.height {
                return Err(format!(
                    "{}: a face of a cube must be square, got {}x{} pixels",
                    source.display(),
                    image.width,
                    image.height
                ));
            }
        }
        return Ok(panorama_of_faces(&images, ErpCamera { width, height }));
    }
    images.pop().ok_or_else(|| "has no image".to_owned())
}

fn part(source: &Path, cell: Option<Cell>) -> Result<RgbImage, String> {
    let file = ImageFile::open(source).map_err(|error| error.to_string())?;
    // As of predictions that are read as they are.
    if file.is_grey() || file.is_deep() {
        let name = source.display();
        return Err(format!(
            "{name} has grey or 16-bit values, expected 8-bit RGB"
        ));
    }
    let image = RgbImage::read(source).map_err(|error| error.to_string())?;
    match cell {
        Some(cell) => cut(&image, cell).ok_or_else(|| {
            format!(
                "{} has {}x{} pixels, which {} columns and {} rows do not fill",
                source.display(),
                image.width,
                image.height,
                cell.columns,
                cell.rows
            )
        }),
        None => Ok(image),
    }
}

/// Cuts a cell out of a grid; `None` unless the grid fills the image.
fn cut(image: &RgbImage, cell: Cell) -> Option<RgbImage> {
    let gap = cell.gap as usize;
    let (left, width) = span(image.width, [cell.columns, cell.column], gap)?;
    let (top, height) = span(image.height, [cell.rows, cell.row], gap)?;
    let mut data = Vec::with_capacity(width.checked_mul(height)?.checked_mul(3)?);
    let lines = image.data.chunks_exact(image.width.checked_mul(3)?);
    for line in lines.skip(top).take(height) {
        let begin = left.checked_mul(3)?;
        data.extend(line.get(begin..begin.checked_add(width.checked_mul(3)?)?)?);
    }
    Some(RgbImage::new(width, height, data))
}

/// Returns begin and length of one of `[count, number]` equal spans with gaps between and around them; `None` unless
/// they fill `whole`.
fn span(whole: usize, [count, number]: [u32; 2], gap: usize) -> Option<(usize, usize)> {
    let step = whole.checked_sub(gap)?.checked_div(count as usize)?;
    let length = step.checked_sub(gap).filter(|length| *length > 0)?;
    let filled = step.checked_mul(count as usize)?.checked_add(gap)?;
    let begin = step.checked_mul(number as usize)?.checked_add(gap)?;
    (filled == whole).then_some((begin, length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_cut_out_of_its_grid() {
        let image = RgbImage::new(4, 2, (0..8).flat_map(|pixel| [pixel as f32; 3]).collect());
        let cell = |columns, rows, column, row| Cell {
            columns,
            rows,
            column,
            row,
            gap: 0,
        };
        let values = |cell| {
            let cut = cut(&image, cell).map(|cut| cut.data);
            cut.map(|data| data.iter().step_by(3).copied().collect::<Vec<f32>>())
        };
        assert_eq!(values(cell(2, 1, 1, 0)), Some(vec![2.0, 3.0, 6.0, 7.0]));
        assert_eq!(values(cell(4, 2, 0, 1)), Some(vec![4.0]));
        assert_eq!(values(cell(3, 1, 0, 0)), None);
        assert_eq!(values(cell(0, 1, 0, 0)), None);
        assert_eq!(span(12, [2, 1], 2), Some((7, 3)));
        assert_eq!(span(13, [2, 1], 2), None);
    }
}
