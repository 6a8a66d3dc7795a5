//! The neighbourhood of a pixel.

/// Calls with a pixel and with those beside it in an image of so many columns and rows, row by row.
#[inline]
pub(super) fn around(pixel: usize, [width, height]: [usize; 2], mut call: impl FnMut(usize)) {
    let (row, column) = (pixel / width, pixel % width);
    let (left, right) = (column.saturating_sub(1), (column + 2).min(width));
    for row in row.saturating_sub(1)..(row + 2).min(height) {
        for beside in row * width + left..row * width + right {
            call(beside);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_around_are_those_of_the_image() {
        let of = |pixel: usize| {
            let mut found = Vec::new();
            around(pixel, [4, 3], |beside| found.push(beside));
            found
        };
        assert_eq!(of(5), [0, 1, 2, 4, 5, 6, 8, 9, 10]);
        assert_eq!(of(0), [0, 1, 4, 5]);
        assert_eq!(of(11), [6, 7, 10, 11]);
    }
}
