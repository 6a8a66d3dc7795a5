//! Filters of OpenCV on our pixels, which it reads where they are.

use opencv::{
    boxed_ref::BoxedRef,
    core::{
        BORDER_WRAP, DataType, Mat, MatTraitConst, MatTraitConstManual, Size, copy_make_border_def,
    },
    imgproc,
};

/// An image over pixels in rows of `width`, which are not copied.
pub(crate) fn image<T: DataType>(pixels: &[T], width: usize) -> opencv::Result<BoxedRef<'_, Mat>> {
    Mat::new_rows_cols_with_data((pixels.len() / width) as i32, width as i32, pixels)
}

/// A square that reaches so many pixels from its middle, as the structuring element of a morphological filter.
pub(crate) fn square(reach: usize) -> opencv::Result<Mat> {
    let side = 2 * reach as i32 + 1;
    imgproc::get_structuring_element_def(imgproc::MORPH_RECT, Size::new(side, side))
}

/// A disc that reaches so many pixels from its middle, as the structuring element of a morphological filter.
pub(crate) fn disc(reach: usize) -> opencv::Result<Mat> {
    let side = 2 * reach as i32 + 1;
    imgproc::get_structuring_element_def(imgproc::MORPH_ELLIPSE, Size::new(side, side))
}

/// Filters a panorama in rows of `width` pixels by a filter that reaches `reach` columns to each side; beyond the
/// seam the other edge goes on.
pub(crate) fn across_seam<T: DataType>(
    pixels: &[T],
    width: usize,
    reach: usize,
    filter: impl FnOnce(&Mat, &mut Mat) -> opencv::Result<()>,
) -> opencv::Result<Vec<T>> {
    let (mut padded, mut filtered) = (Mat::default(), Mat::default());
    let from = image(pixels, width)?;
    let (width, reach) = (width as i32, reach as i32);
    copy_make_border_def(&from, &mut padded, 0, 0, reach, reach, BORDER_WRAP)?;
    filter(&padded, &mut filtered)?;
    let own = filtered.col_bounds(reach, reach + width)?.try_clone()?;
    Ok(own.data_typed()?.to_vec())
}

/// Marks every pixel of a panorama within `reach` rows and columns of one that is not 0, across the seam too.
pub(crate) fn grown(marks: &[u8], width: usize, reach: usize) -> opencv::Result<Vec<u8>> {
    across_seam(marks, width, reach, |from, to| {
        imgproc::dilate_def(from, to, &square(reach)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_grow_across_the_seam_and_stop_at_the_poles() {
        let mut mask = vec![0_u8; 32 * 16];
        mask[0] = 255;
        let grown = grown(&mask, 32, 4).expect("filtered");
        let marked = grown.iter().filter(|&&value| value != 0).count();
        assert_eq!(marked, 9 * 5);
        assert_eq!([grown[28], grown[27]], [255, 0]);
    }

    #[test]
    fn a_filter_may_reach_farther_than_the_panorama_is_wide() {
        let row = [0_f32, 1.0, 2.0, 3.0];
        let same = across_seam(&row, 4, 9, Mat::copy_to);
        assert_eq!(same.expect("filtered"), row);
    }
}
