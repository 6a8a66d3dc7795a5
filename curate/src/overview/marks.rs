//! Marks on small images: masks and overlays, each in a pattern of its own beside its colour.

use omnilife_schemas::{records::Overlay, rgb::Mask};

/// Kind of a marked region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Mark {
    /// Moving content: an outline around a tint.
    Moving,
    /// Ignored region: an outline around stripes.
    Ignored,
    /// Overlay of the video: an outline.
    Overlay,
}

impl Mark {
    pub(super) const ALL: [Self; 3] = [Self::Moving, Self::Ignored, Self::Overlay];

    /// Returns the word for legends and text alternatives, also its class in the style sheet.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Moving => "moving",
            Self::Ignored => "ignored",
            Self::Overlay => "overlay",
        }
    }

    fn colour(self) -> [u8; 3] {
        match self {
            Self::Moving => [255, 122, 0],
            Self::Ignored => [64, 176, 255],
            Self::Overlay => [255, 64, 216],
        }
    }

    /// Returns the opacity of the colour inside of the outline.
    fn fill(self, column: usize, row: usize) -> f64 {
        match self {
            Self::Moving => 0.3,
            Self::Ignored if (column + row) % 6 < 2 => 0.6,
            Self::Ignored | Self::Overlay => 0.0,
        }
    }
}

/// Draws a region on 8-bit interleaved RGB of the mask's size; `wraps` says that the first column follows the last.
pub(super) fn draw(rgb: &mut [u8], mask: &Mask, mark: Mark, wraps: bool) {
    let (width, height) = (mask.width, mask.height);
    let is_marked = |column: usize, row: usize| mask.data[row * width + column] != 0;
    let is_inside = |column: usize, row: usize| {
        let left = match column {
            0 => !wraps || is_marked(width - 1, row),
            column => is_marked(column - 1, row),
        };
        let right = match column + 1 {
            end if end == width => !wraps || is_marked(0, row),
            next => is_marked(next, row),
        };
        let above = row == 0 || is_marked(column, row - 1);
        left && right && above && (row + 1 == height || is_marked(column, row + 1))
    };
    for row in 0..height {
        for column in (0..width).filter(|&column| is_marked(column, row)) {
            let opacity = match is_inside(column, row) {
                true => mark.fill(column, row),
                false => 1.0,
            };
            let at = (row * width + column) * 3;
            for (value, colour) in rgb[at..at + 3].iter_mut().zip(mark.colour()) {
                let mixed = f64::from(*value) * (1.0 - opacity) + f64::from(colour) * opacity;
                *value = mixed.round() as u8;
            }
        }
    }
}

/// Returns the regions of the overlays of a video in a panorama of this size, rectangles or discs.
pub(super) fn overlays(overlays: &[Overlay], width: usize, height: usize) -> Mask {
    let is_covered = |index: usize| {
        let (column, row) = (index % width, index / width);
        let longitude = ((column as f64 + 0.5) / width as f64 - 0.5) * 360.0;
        let latitude = (0.5 - (row as f64 + 0.5) / height as f64) * 180.0;
        (overlays.iter()).any(|overlay| overlay.covers(longitude, latitude))
    };
    let pixels = (0..width * height).map(|index| 255 * u8::from(is_covered(index)));
    Mask::new(width, height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use omnilife_schemas::records::OverlayClass;

    use super::*;

    fn block(columns: std::ops::Range<usize>) -> Mask {
        let pixels = (0..8 * 6).map(|at| (at % 8, at / 8));
        let pixels =
            pixels.map(|(x, y)| 255 * u8::from(columns.contains(&x) && (1..5).contains(&y)));
        Mask::new(8, 6, pixels.collect())
    }

    #[test]
    fn outlines_are_opaque_and_the_rest_stays() {
        let mut rgb = vec![0; 8 * 6 * 3];
        draw(&mut rgb, &block(2..6), Mark::Overlay, true);
        let pixel = |x: usize, y: usize| &rgb[(y * 8 + x) * 3..][..3];
        assert_eq!(pixel(2, 1), [255, 64, 216]);
        assert_eq!(pixel(3, 2), [0, 0, 0]);
        assert_eq!(pixel(1, 2), [0, 0, 0]);
    }

    #[test]
    fn regions_go_on_across_the_seam_of_panoramas_alone() {
        let whole = block(0..8);
        let edge = |wraps| {
            let mut rgb = vec![0; 8 * 6 * 3];
            let half = Mask {
                data: (whole.data.iter().enumerate())
                    .map(|(at, &value)| if (2..6).contains(&(at % 8)) { 0 } else { value })
                    .collect(),
                ..whole.clone()
            };
            draw(&mut rgb, &half, Mark::Overlay, wraps);
            rgb[2 * 8 * 3]
        };
        assert_eq!((edge(true), edge(false)), (0, 0));
        let mut rgb = vec![0; 8 * 6 * 3];
        draw(&mut rgb, &block(0..2), Mark::Overlay, true);
        assert_eq!(rgb[2 * 8 * 3], 255, "nothing is marked beyond the seam");
    }

    #[test]
    fn overlays_are_discs_of_their_area() {
        let overlay = Overlay {
            class: OverlayClass::Rig,
            longitude_degrees: 0.0,
            latitude_degrees: -90.0,
            solid_angle_steradians: TAU,
            extent_degrees: None,
            constancy: 1.0,
            stayed: 1.0,
            strength_levels: 0.0,
            variation_levels: 0.0,
            saturated_share: 0.0,
            sightings: None,
            ranges: Vec::new(),
        };
        let mask = overlays(&[overlay], 16, 8);
        let lower = mask
            .data
            .iter()
            .enumerate()
            .all(|(at, &value)| (value != 0) == (at / 16 >= 4));
        assert!(lower, "half of the sphere is the lower half");
    }
}
