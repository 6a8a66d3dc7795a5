//! Pixelation in a single frame: regions made of flat square blocks in place of the image.
//!
//! A window of a mosaic has steps on the lines of a grid of one period, the same in both directions, and next to
//! nothing between them. Facades, tiles and bricks can have that too, but their tiles repeat, or have two colours;
//! those of a mosaic are the means of the hidden content. The blocks of a codec lie on the image's own grid, and all
//! over the image.

use omnilife_video::LumaImage;

use super::{
    blocks::{Area, Grid, Patch},
    line_profiles::{LineProfiles, STRIP_PIXELS},
};

/// Sides of the search windows, in halves of the smallest one. Each shows blocks of an eighth to a quarter of its side.
const WINDOW_HALVES: [usize; 5] = [2, 3, 4, 6, 8];
/// Windows of the smallest size around the image (6 degrees each), and its least side in pixels.
const WINDOWS_PER_TURN: usize = 64;
const LEAST_WINDOW_PIXELS: usize = 32;

/// Finds pixelated regions in single frames; keeps its buffers from one to the next.
#[derive(Debug, Default)]
pub(super) struct PixelationFinder {
    profiles: LineProfiles,
    across: Vec<u32>,
    down: Vec<u32>,
}

/// Sides of the windows for images of this width, the largest last.
fn window_pixels(image_width: usize) -> [usize; WINDOW_HALVES.len()] {
    let strips = (image_width / WINDOWS_PER_TURN).max(LEAST_WINDOW_PIXELS) / STRIP_PIXELS;
    WINDOW_HALVES.map(|halves| halves * strips / 2 * STRIP_PIXELS)
}

/// Columns that have to be repeated at the right of an image of this width.
pub(super) fn margin_pixels(image_width: usize) -> usize {
    window_pixels(image_width)[WINDOW_HALVES.len() - 1].min(image_width)
}

impl PixelationFinder {
    /// Returns rectangles that do not overlap, unordered.
    pub(super) fn find(&mut self, image: &LumaImage) -> Vec<Patch> {
        self.profiles.measure(image);
        let mut patches: Vec<Patch> = Vec::new();
        let mut refused: Vec<Area> = Vec::new();
        for size in window_pixels(image.width) {
            let step = (size / 3).max(STRIP_PIXELS) / STRIP_PIXELS * STRIP_PIXELS;
            for window in self.profiles.windows(size, step) {
                // The margin repeats the left of the image.
                if window.left >= image.width {
                    continue;
                }
                let Some(grid) = Grid::of(&self.profiles, window, &mut self.across, &mut self.down)
                else {
                    continue;
                };
                let mut known = patches.iter().map(|patch| &patch.area).chain(&refused);
                let (x, y) = window.middle();
                if known.any(|area| area.contains(x, y, image.width)) {
                    continue;
                }
                // The window decides whether it is a mosaic, growth gives its size.
                if !grid.looks_pixelated(image, &self.profiles) {
                    continue;
                }
                let grown = grid.grown(image);
                let Some(patch) = grown.patch(image) else {
                    refused.extend(grown.area(image));
                    continue;
                };
                patches.retain(|other| {
                    let (x, y) = other.area.middle();
                    !patch.area.contains(x, y, image.width)
                });
                patches.push(patch);
            }
        }
        patches
    }
}

/// Returns levels of an image with detail everywhere, except for flat blocks of random levels where `block` names one.
#[cfg(test)]
pub(super) fn textured(
    (width, height): (usize, usize),
    seed: u32,
    block: impl Fn(usize, usize) -> Option<(usize, usize)>,
) -> Vec<u8> {
    let random = |x: usize, y: usize, kind: u32| {
        let mut bits = (x as u32).wrapping_mul(0x9e37_79b1)
            ^ (y as u32).wrapping_mul(0x85eb_ca77)
            ^ (seed * 4 + kind).wrapping_mul(0xc2b2_ae3d);
        for _ in 0..2 {
            bits = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
        }
        (bits >> 16) & 0xff
    };
    (0..width * height)
        .map(|at| {
            let (x, y) = (at % width, at / width);
            let noise = random(x, y, 0) % 3;
            let level = match block(x, y) {
                Some((column, row)) => 60 + random(column, row, 1) / 2 + noise,
                None => 70 + random(x / 5, y / 3, 2) / 4 + random(x, y, 3) / 8,
            };
            level as u8
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 512;
    const HEIGHT: usize = 256;

    fn found(levels: &[u8]) -> Vec<Patch> {
        let mut image = LumaImage::default();
        image.fill((WIDTH, HEIGHT), margin_pixels, levels.chunks(WIDTH));
        PixelationFinder::default().find(&image)
    }

    /// At any offset of the grid, and also on the grid of codecs.
    #[test]
    fn boxes_of_blocks_are_found_with_their_size() {
        for (side, left, top) in [
            (5, 101, 57),
            (8, 96, 64),
            (11, 203, 31),
            (16, 35, 80),
            (23, 131, 17),
        ] {
            let (columns, rows) = (12, 10);
            let levels = textured((WIDTH, HEIGHT), side as u32, |x, y| {
                let inside = (left..left + columns * side).contains(&x)
                    && (top..top + rows * side).contains(&y);
                inside.then(|| ((x - left) / side, (y - top) / side))
            });
            let patches = found(&levels);
            assert_eq!(patches.len(), 1, "{side}: {patches:#?}");
            let Patch {
                area, block_pixels, ..
            } = patches[0];
            assert!((block_pixels - side as f32).abs() < 0.1, "{patches:#?}");
            let off = [
                area.left.abs_diff(left),
                area.top.abs_diff(top),
                (area.left + area.width).abs_diff(left + columns * side),
                (area.top + area.height).abs_diff(top + rows * side),
            ];
            assert!(
                off.iter().all(|&pixels| pixels <= side),
                "{side}: {patches:#?}"
            );
        }
    }

    /// Everything that has a grid and is not a mosaic, in the middle of an image with detail.
    #[test]
    fn patterns_are_no_mosaics() {
        type Pattern = fn(usize, usize) -> usize;
        fn random(x: usize, y: usize) -> usize {
            (x * 7919 + y * 104_729 + x * y * 31) % 97
        }
        let patterns: [(&str, Pattern); 6] = [
            ("checkerboard", |x, y| 60 + 120 * ((x / 12 + y / 12) % 2)),
            ("three colours", |x, y| 60 + 60 * ((x / 12 + y / 12) % 3)),
            ("two colours", |x, y| {
                60 + 100 * usize::from(random(x / 12, y / 12) > 48)
            }),
            ("bricks", |x, y| {
                let shifted = x + y / 12 % 2 * 12;
                if y % 12 == 0 || shifted % 24 == 0 {
                    220
                } else {
                    80 + random(shifted / 24, y / 12) / 2
                }
            }),
            ("tiles with joints", |x, y| {
                if x % 16 == 0 || y % 16 == 0 {
                    220
                } else {
                    60 + random(x / 16, y / 16)
                }
            }),
            ("windows", |x, y| {
                if x % 16 < 5 || y % 16 < 5 {
                    190
                } else {
                    30 + random(x / 16, y / 16)
                }
            }),
        ];
        for (name, pattern) in patterns {
            let mut levels = textured((WIDTH, HEIGHT), 1, |_, _| None);
            for y in 40..220 {
                for x in 100..400 {
                    levels[y * WIDTH + x] = pattern(x, y) as u8;
                }
            }
            assert_eq!(found(&levels), [], "{name}");
        }
        assert_eq!(found(&textured((WIDTH, HEIGHT), 2, |_, _| None)), []);
    }

    /// Blocks all over the image, flat in parts of it, are a codec's.
    #[test]
    fn blocks_of_a_codec_are_no_mosaic() {
        let blocks = textured((WIDTH, HEIGHT), 3, |x, y| Some((x / 8, y / 8)));
        let detail = textured((WIDTH, HEIGHT), 4, |_, _| None);
        let coded = |keeps_detail: bool| -> Vec<u8> {
            (0..WIDTH * HEIGHT)
                .map(|at| {
                    let (x, y) = (at % WIDTH, at / WIDTH);
                    let inside = (200..280).contains(&x) && (96..160).contains(&y);
                    let steps = if inside || !keeps_detail {
                        blocks[at] / 4
                    } else {
                        20
                    };
                    100 + steps + if inside { 0 } else { detail[at] / 8 }
                })
                .collect()
        };
        assert_eq!(found(&coded(false)), []);
        // The same flat blocks in an image without steps elsewhere.
        assert_eq!(found(&coded(true)).len(), 1);
    }
}
