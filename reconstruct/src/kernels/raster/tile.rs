//! A tile of the image: where splats touch it, and which of its pixels still take splats.

use std::ops::Range;

use super::lanes::{BLOCKS, LANES, Lanes, Plane, all_zero};
use crate::kernels::{
    TILE,
    bin::{TileItem, TileLists},
    project::Splat,
};

pub(super) fn tile_range(lists: &TileLists, tile: usize) -> Range<usize> {
    lists.tile_starts[tile] as usize..lists.tile_starts[tile + 1] as usize
}

/// A tile's place in the image and its list.
pub(super) struct Tile<'a> {
    /// First column of pixels.
    pub(super) left: usize,
    /// First row of pixels.
    pub(super) top: usize,
    /// Columns inside the image.
    pub(super) columns: usize,
    /// Rows inside the image.
    pub(super) rows: usize,
    pub(super) image_width: f32,
    pub(super) items: &'a [TileItem],
}

/// A splat seen from a tile: where its footprint can be.
pub(super) struct Footprint {
    /// Column offsets from the splat's centre to the pixel centres, the short way around the seam.
    pub(super) offsets: [Lanes; BLOCKS],
    /// Blocks with a pixel inside the footprint's width.
    pub(super) blocks: Range<usize>,
    /// Rows with a pixel inside the footprint's height.
    pub(super) rows: Range<usize>,
}

impl<'a> Tile<'a> {
    pub(super) fn new(
        size: (usize, usize),
        lists: &'a TileLists,
        tile_row: usize,
        tile_column: usize,
    ) -> Self {
        let (left, top) = (tile_column * TILE, tile_row * TILE);
        Self {
            left,
            top,
            columns: TILE.min(size.0 - left),
            rows: TILE.min(size.1 - top),
            image_width: size.0 as f32,
            items: &lists.items[tile_range(lists, tile_row * lists.columns + tile_column)],
        }
    }

    #[inline(always)]
    pub(super) fn footprint(&self, splat: &Splat) -> Footprint {
        let (offsets, blocks) = self.column_offsets(splat);
        // Row centres are at row + 1/2.
        let reach = splat.extent[1] + MARGIN;
        let centre = splat.centre[1] - self.top as f32 - 0.5;
        let first_row = (centre - reach).ceil().max(0.0) as usize;
        let end_row = ((centre + reach).floor() + 1.0).max(0.0) as usize;
        Footprint {
            offsets,
            blocks,
            rows: first_row..end_row.min(self.rows).max(first_row),
        }
    }
}

impl Tile<'_> {
    /// Offsets from the splat's centre to the columns, and the blocks its footprint can touch.
    #[inline(always)]
    pub(super) fn column_offsets(&self, splat: &Splat) -> ([Lanes; BLOCKS], Range<usize>) {
        let half = 0.5 * self.image_width;
        let reach = splat.extent[0] + MARGIN;
        let lane_offsets: [Lanes; BLOCKS] =
            std::array::from_fn(|block| std::array::from_fn(|lane| (block * LANES + lane) as f32));
        let mut first = self.left as f32 + 0.5 - splat.centre[0];
        if reach + TILE as f32 >= half {
            // So wide a footprint can reach one tile from both sides: every column wraps alone.
            let offsets = lane_offsets.map(|lanes| {
                lanes.map(|lane| {
                    let distance = first + lane;
                    distance
                        - self.image_width
                            * (f32::from(distance > half) - f32::from(distance < -half))
                })
            });
            return (offsets, 0..BLOCKS);
        }
        // The whole tile lies on one side of the splat's antipode as far as the splat can reach.
        let middle = first + 0.5 * TILE as f32;
        if middle > half {
            first -= self.image_width;
        } else if middle < -half {
            first += self.image_width;
        }
        let offsets = lane_offsets.map(|lanes| lanes.map(|lane| first + lane));
        let touched = |block: usize| {
            let begin = first + (block * LANES) as f32;
            begin <= reach && begin + (LANES - 1) as f32 >= -reach
        };
        let begin = usize::from(!touched(0));
        let end = BLOCKS - usize::from(!touched(BLOCKS - 1));
        (offsets, begin..end.max(begin))
    }
}

// `column_offsets` looks at the first and the last block only.
const _: () = assert!(BLOCKS == 2);

/// Widening of footprints in pixels, against rounding in the extents.
pub(super) const MARGIN: f32 = 0.01;

/// Which pixels still take splats: 1 or 0.
pub(super) struct Alive {
    pub(super) pixels: Plane,
    pub(super) blocks: [[bool; BLOCKS]; TILE],
    pub(super) count: usize,
}

impl Alive {
    #[inline(always)]
    pub(super) fn new(tile: &Tile<'_>) -> Self {
        Self {
            pixels: [[[1.0; LANES]; BLOCKS]; TILE],
            blocks: [[true; BLOCKS]; TILE],
            count: tile.rows * BLOCKS,
        }
    }

    /// Notes that a block may have lost its last pixel.
    #[inline(always)]
    pub(super) fn update(&mut self, row: usize, block: usize) {
        if all_zero(&self.pixels[row][block]) {
            self.blocks[row][block] = false;
            self.count -= 1;
        }
    }
}
