//! The place of a part of a sphere on the whole one.

use omnilife_schemas::rgb::Mask;

/// A part of an equirectangular image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Placement {
    /// Width and height of the whole image, pixels.
    full: [u32; 2],
    /// Those of the part.
    size: [u32; 2],
    /// Left and top of the part. It may reach over the seam.
    corner: [u32; 2],
}

impl Placement {
    /// Returns the place of a part; `None` for the whole image.
    ///
    /// # Errors
    /// For a whole image that is not twice as wide as high, and a part outside of it; one line.
    pub(crate) fn new(
        full: [u32; 2],
        size: [u32; 2],
        corner: [u32; 2],
    ) -> Result<Option<Self>, String> {
        let ([full_width, full_height], [width, height], [left, top]) = (full, size, corner);
        if u64::from(full_width) != 2 * u64::from(full_height) {
            return Err(format!(
                "its metadata are of a sphere of {full_width}x{full_height}, which has to be twice as wide as high"
            ));
        }
        let is_within = width <= full_width
            && left < full_width
            && u64::from(top) + u64::from(height) <= u64::from(full_height);
        if !is_within {
            return Err(format!(
                "its part of {width}x{height} at {left}, {top} reaches out of its sphere of {full_width}x{full_height}"
            ));
        }
        let place = Self { full, size, corner };
        Ok((full != size || left != 0).then_some(place))
    }

    /// Returns the size of the whole image.
    pub(crate) fn full(&self) -> [u32; 2] {
        self.full
    }

    /// Returns the whole image, black outside the part, and a mask that marks the outside.
    pub(crate) fn whole(&self, part: &[u8], ignored: Option<&Mask>) -> (Vec<u8>, Mask) {
        let [full_width, full_height] = self.full.map(|side| side as usize);
        let [width, height] = self.size.map(|side| side as usize);
        let [left, top] = self.corner.map(|side| side as usize);
        let mut rgb = vec![0; 3 * full_width * full_height];
        let mut mask = Mask::new(full_width, full_height, vec![255; full_width * full_height]);
        for row in 0..height {
            for column in 0..width {
                let from = row * width + column;
                let to = (top + row) * full_width + (left + column) % full_width;
                rgb[3 * to..3 * to + 3].copy_from_slice(&part[3 * from..3 * from + 3]);
                mask.data[to] = ignored.map_or(0, |ignored| ignored.data[from]);
            }
        }
        (rgb, mask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_over_the_seam_is_put_on_both_sides() {
        let place = Placement::new([8, 4], [3, 2], [6, 1])
            .expect("sound")
            .expect("a part");
        let part: Vec<u8> = (1..=6).flat_map(|pixel| [pixel; 3]).collect();
        let (rgb, mask) = place.whole(&part, None);
        let row = |row: usize| -> Vec<u8> { (0..8).map(|at| rgb[3 * (8 * row + at)]).collect() };
        assert_eq!(row(0), [0; 8]);
        assert_eq!(row(1), [3, 0, 0, 0, 0, 0, 1, 2]);
        assert_eq!(row(2), [6, 0, 0, 0, 0, 0, 4, 5]);
        assert_eq!(mask.data[8..16], [0, 255, 255, 255, 255, 255, 0, 0]);
    }

    #[test]
    fn a_whole_sphere_has_no_place() {
        assert_eq!(Placement::new([8, 4], [8, 4], [0, 0]), Ok(None));
        assert!(Placement::new([8, 4], [8, 4], [0, 1]).is_err());
        assert!(Placement::new([8, 5], [8, 4], [0, 0]).is_err());
        // A whole sphere whose left edge is elsewhere is rotated.
        assert!(Placement::new([8, 4], [8, 4], [2, 0]).is_ok_and(|place| place.is_some()));
    }
}
