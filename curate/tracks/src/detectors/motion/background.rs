//! Frames of other times warped to the view of a frame, and its differences from them.

use omnilife_schemas::{ground_plane::Plane, posed_view::PosedView};
use rayon::prelude::*;

use super::{
    extents::{Extent, RowColours, RowExtents},
    neighbours::OTHERS,
    patch::Patch,
    regions::blurred,
    surface::Surface,
    texels::Texels,
    transfer::{Places, Rays, Transfer},
};
use crate::detectors::pixels_around::around;

/// Least number of frames with a pixel for a decision on it, if there are as many.
const LEAST_KNOWN: usize = 3;
/// Largest distance between possible places of a pixel in another frame, pixels; beyond, its place is unknown.
const AMBIGUOUS: f32 = 2.5;
/// Largest difference from the ground, of [0, 1], at which other surfaces are not compared.
const IS_GROUND: f32 = 0.01;

/// The frame that is compared with others.
pub(super) struct ComparedFrame<'a> {
    pub(super) view: &'a PosedView,
    pub(super) texels: &'a Texels,
    rays: &'a Rays,
    surface: Surface,
    channels: [Vec<f32>; 3],
}

impl<'a> ComparedFrame<'a> {
    pub(super) fn new(
        view: &'a PosedView,
        texels: &'a Texels,
        rays: &'a Rays,
        ground: Plane,
    ) -> Self {
        Self {
            view,
            texels,
            rays,
            surface: Surface::new(view, rays, &texels.distances(), ground),
            channels: texels.channels(),
        }
    }
}

/// A frame to compare with, through the surface in its own view.
///
/// Beside edges the surface of a pixel is unknown, and from another place another colour is behind them. If the ground
/// is one of the possible surfaces, static content looks like the other frame at one of them, and the best match
/// counts. Otherwise nothing is known.
pub(super) struct Background<'a> {
    texels: &'a Texels,
    transfer: Transfer,
}

impl<'a> Background<'a> {
    /// Prepares another frame, for one with the view `here`.
    pub(super) fn new(here: &PosedView, view: &PosedView, texels: &'a Texels) -> Self {
        Self {
            texels,
            transfer: Transfer::new(here, view),
        }
    }

    /// Returns its colour of the static surface of a pixel; NaN if that is unknown.
    pub(super) fn colour(&self, here: &ComparedFrame<'_>, pixel: usize) -> [f32; 3] {
        let surface = if self.is_sure(here, pixel) {
            &here.surface.at
        } else {
            &here.surface.ground
        };
        self.through(here, surface, pixel)
    }

    /// Returns its colour of a pixel through one of the possible surfaces; NaN if it does not show it.
    fn through(&self, here: &ComparedFrame<'_>, surface: &[f32], pixel: usize) -> [f32; 3] {
        let place = self.transfer.place(here.rays.at(pixel), surface[pixel]);
        self.texels.sample(place).unwrap_or([f32::NAN; 3])
    }

    /// Returns true if it shows a pixel in one place for any possible surface.
    fn is_sure(&self, here: &ComparedFrame<'_>, pixel: usize) -> bool {
        let Surface {
            nearest, farthest, ..
        } = &here.surface;
        if nearest[pixel].is_nan() {
            return true;
        }
        let ray = here.rays.at(pixel);
        let near = self.transfer.place(ray, nearest[pixel]);
        let far = self.transfer.place(ray, farthest[pixel]);
        is_one_place([near[0], near[1]], [far[0], far[1]])
    }

    /// Returns each pixel's difference from it, through the ground if the surface is unknown; NaN if nothing is known.
    fn differences(&self, here: &ComparedFrame<'_>) -> Vec<f32> {
        let (width, height) = (here.texels.width, here.texels.height);
        let mut differences = vec![f32::NAN; width * height];
        let mut warp = Warp::new(width);
        let mut extents = RowExtents::new(width);
        // Buffers of the rows above, in the same place and below, used in rotation.
        let mut rows = [0; 3].map(|_| WarpedRow::unknown(width));
        warp.row(self, here, 0, &mut rows[0]);
        for (row, out) in differences.chunks_exact_mut(width).enumerate() {
            let below = &mut rows[(row + 1) % 3];
            if row + 1 < height {
                warp.row(self, here, row + 1, below);
            } else {
                below.clear();
            }
            let pixels = row * width..(row + 1) * width;
            let shown = [0, 1, 2].map(|channel| &here.channels[channel][pixels.clone()]);
            let beside = [row + 2, row, row + 1].map(|row| &rows[row % 3]);
            if beside[1].sure.is_known {
                extents.differences(shown, beside.map(|row| &row.sure), out);
            }
            if beside[1].edges.is_known {
                extents.differences(shown, beside.map(|row| &row.edges), out);
            }
        }
        differences
    }

    /// Compares content beside edges that may move through the other possible surfaces.
    fn look_beside_edges(&self, here: &ComparedFrame<'_>, patch: &Patch, differences: &mut [f32]) {
        let Surface {
            at,
            nearest,
            farthest,
            ground,
        } = &here.surface;
        let is_edge = |&pixel: &usize| !ground[pixel].is_nan() && !self.is_sure(here, pixel);
        let edges: Vec<bool> = patch.pixels().iter().map(is_edge).collect();
        let mut colours = vec![[f32::NAN; 3]; edges.len()];
        for surface in [nearest, farthest, at] {
            let of_patch = colours.iter_mut().zip(patch.pixels()).zip(&edges);
            for ((colour, &pixel), _) in of_patch.filter(|(_, is_edge)| **is_edge) {
                *colour = self.through(here, surface, pixel);
            }
            let inner = patch.inner().iter().zip(&colours);
            for (&pixel, _) in inner.filter(|(_, colour)| !colour[0].is_nan()) {
                let mut extent = Extent::NOTHING;
                patch.numbers_around(pixel, |number| extent = extent.with(colours[number]));
                // Without the ground nothing is known: no value is less than NaN.
                let value = extent.distance(here.texels.colour(pixel));
                if value < differences[pixel] {
                    differences[pixel] = value;
                }
            }
        }
    }
}

/// Returns true if two places, which are NaN for a hidden point, are practically equal.
#[inline(always)]
fn is_one_place(near: [f32; 2], far: [f32; 2]) -> bool {
    let [x, y] = [near[0] - far[0], near[1] - far[1]];
    x * x + y * y <= AMBIGUOUS * AMBIGUOUS
}

/// A row of another frame, warped to this view.
struct WarpedRow {
    /// Colours of known surfaces.
    sure: RowColours,
    /// Colours through the ground beside edges.
    edges: RowColours,
}

impl WarpedRow {
    fn unknown(width: usize) -> Self {
        Self {
            sure: RowColours::unknown(width),
            edges: RowColours::unknown(width),
        }
    }

    fn clear(&mut self) {
        self.sure.clear();
        self.edges.clear();
    }
}

/// Buffers for the warping of rows.
struct Warp {
    near: Places,
    far: Places,
    chosen: Places,
    is_sure: Vec<bool>,
    distances: Vec<f32>,
}

impl Warp {
    fn new(width: usize) -> Self {
        Self {
            near: Places::new(width),
            far: Places::new(width),
            chosen: Places::new(width),
            is_sure: vec![false; width],
            distances: vec![f32::NAN; width],
        }
    }

    fn row(
        &mut self,
        other: &Background<'_>,
        here: &ComparedFrame<'_>,
        row: usize,
        out: &mut WarpedRow,
    ) {
        let width = here.texels.width;
        let pixels = row * width..(row + 1) * width;
        let surface = &here.surface;
        let (nearest, farthest) = (
            &surface.nearest[pixels.clone()],
            &surface.farthest[pixels.clone()],
        );
        let places = |distances: &[f32], places: &mut Places| {
            other.transfer.row(here.rays, row, distances, places);
        };
        places(nearest, &mut self.near);
        places(farthest, &mut self.far);
        choose(
            nearest,
            [&self.near, &self.far],
            [&surface.at[pixels.clone()], &surface.ground[pixels]],
            &mut self.is_sure,
            &mut self.distances,
        );
        places(&self.distances, &mut self.chosen);
        out.clear();
        let Places {
            columns,
            rows,
            away,
        } = &self.chosen;
        let places = columns.iter().zip(rows).zip(away).zip(&self.is_sure);
        for (column, (((x, y), away), is_sure)) in places.enumerate() {
            if let Some(colour) = other.texels.sample([*x, *y, *away]) {
                let row = if *is_sure {
                    &mut out.sure
                } else {
                    &mut out.edges
                };
                row.put(column, colour);
            }
        }
    }
}

/// Returns for a row of pixels whether another frame shows each in one place, and the distance to use.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn choose(
    nearest: &[f32],
    [near, far]: [&Places; 2],
    [at, ground]: [&[f32]; 2],
    is_sure: &mut [bool],
    distances: &mut [f32],
) {
    let near = near.columns.iter().zip(&near.rows);
    let far = far.columns.iter().zip(&far.rows);
    let surface = nearest.iter().zip(at).zip(ground);
    let out = is_sure.iter_mut().zip(distances);
    let pixels = near.zip(far).zip(surface).zip(out);
    for ((((x, y), (far_x, far_y)), ((nearest, at), ground)), (is_sure, distance)) in pixels {
        *is_sure = nearest.is_nan() | is_one_place([*x, *y], [*far_x, *far_y]);
        *distance = if *is_sure { *at } else { *ground };
    }
}

/// Returns each pixel's difference from static content, averaged with those beside it: the lower quartile over the
/// frames that show it. NaN if unknown. Means above `least` are exact; others may be smaller yet.
pub(super) fn differences(
    here: &ComparedFrame<'_>,
    others: &[Background<'_>],
    least: f32,
) -> Vec<f32> {
    let (width, height) = (here.texels.width, here.texels.height);
    let mut of_each: Vec<Vec<f32>> = others
        .par_iter()
        .map(|other| other.differences(here))
        .collect();
    let mut ranks = ranked(&of_each);
    // Other surfaces only reduce differences, so they are tested only for large differences through the ground.
    let mut is_large = vec![false; ranks.len()];
    for (pixel, _) in blurred(&ranks, width)
        .into_iter()
        .enumerate()
        .filter(|(_, mean)| *mean > least)
    {
        around(pixel, [width, height], |beside| is_large[beside] = true);
    }
    let large: Vec<usize> = (0..ranks.len())
        .filter(|&pixel| is_large[pixel] && ranks[pixel] > IS_GROUND)
        .collect();
    let patch = Patch::new(&large, [width, height]);
    others
        .par_iter()
        .zip(&mut of_each)
        .for_each(|(other, differences)| other.look_beside_edges(here, &patch, differences));
    for pixel in large {
        let values = of_each.iter().map(|differences| differences[pixel]);
        ranks[pixel] = Ranks::<1>::of(values.map(|value| [value])).chosen(others.len())[0];
    }
    blurred(&ranks, width)
}

/// The smallest values of some pixels, in order, and the number of known ones of each.
struct Ranks<const PIXELS: usize> {
    smallest: [[f32; PIXELS]; OTHERS / 4 + 1],
    known: [u32; PIXELS],
}

impl<const PIXELS: usize> Ranks<PIXELS> {
    /// Ranks the values of several frames, NaN for unknown ones.
    #[inline(always)]
    fn of(values: impl Iterator<Item = [f32; PIXELS]>) -> Self {
        let mut ranks = Self {
            smallest: [[f32::INFINITY; PIXELS]; OTHERS / 4 + 1],
            known: [0; PIXELS],
        };
        for mut values in values {
            for (known, value) in ranks.known.iter_mut().zip(&values) {
                *known += u32::from(!value.is_nan());
            }
            for rank in &mut ranks.smallest {
                for (held, value) in rank.iter_mut().zip(&mut values) {
                    // NaN is less than no value, and shifts none.
                    let is_less = *value < *held;
                    let (less, more) = if is_less {
                        (*value, *held)
                    } else {
                        (*held, *value)
                    };
                    (*held, *value) = (less, more);
                }
            }
        }
        ranks
    }

    /// Returns the lower quartile of the known values; NaN if too few of the frames know a pixel.
    #[inline(always)]
    fn chosen(&self, frames: usize) -> [f32; PIXELS] {
        let least = LEAST_KNOWN.min(frames).max(1) as u32;
        let mut chosen = [f32::NAN; PIXELS];
        for (number, rank) in self.smallest.iter().enumerate() {
            let from = (4 * number as u32).max(least);
            for ((chosen, value), known) in chosen.iter_mut().zip(rank).zip(&self.known) {
                *chosen = if *known >= from { *value } else { *chosen };
            }
        }
        chosen
    }
}

/// Number of pixels that are sorted together.
const LANES: usize = 16;

/// Returns for each pixel the lower quartile of the known differences; NaN if none is known.
fn ranked(differences: &[Vec<f32>]) -> Vec<f32> {
    let mut ranks = vec![f32::NAN; differences.first().map_or(0, Vec::len)];
    rank(differences, &mut ranks);
    ranks
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn rank(differences: &[Vec<f32>], ranks: &mut [f32]) {
    let (whole, rest) = ranks.as_chunks_mut::<LANES>();
    for (number, out) in whole.iter_mut().enumerate() {
        let of_frame = |frame: &Vec<f32>| frame.as_chunks::<LANES>().0[number];
        *out = Ranks::of(differences.iter().map(of_frame)).chosen(differences.len());
    }
    let begin = whole.len() * LANES;
    for (at, out) in rest.iter_mut().enumerate() {
        let values = differences.iter().map(|frame| [frame[begin + at]]);
        [*out] = Ranks::of(values).chosen(differences.len());
    }
}

/// Returns per channel the median colour of a pixel in the backgrounds; NaN if none shows it.
pub(super) fn middle_colour(
    here: &ComparedFrame<'_>,
    others: &[Background<'_>],
    pixel: usize,
) -> [f32; 3] {
    let shown: Vec<[f32; 3]> = others
        .iter()
        .map(|other| other.colour(here, pixel))
        .collect();
    [0, 1, 2].map(|channel| {
        let mut known: Vec<f32> = shown
            .iter()
            .map(|colour| colour[channel])
            .filter(|value| !value.is_nan())
            .collect();
        known.sort_unstable_by(f32::total_cmp);
        known.get(known.len() / 2).copied().unwrap_or(f32::NAN)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_passed_in_some_frames_leaves_no_trace_where_it_was() {
        let static_pixel = [0.0, 0.0, 0.4, 0.0, 0.5, 0.0, 0.0, 0.3];
        let moving_pixel = [0.4, 0.3, 0.4, 0.01, 0.5, 0.4, 0.3, 0.3];
        let unknown = [f32::NAN; 8];
        let differences: Vec<Vec<f32>> = (0..8)
            .map(|n| vec![static_pixel[n], moving_pixel[n], unknown[n]])
            .collect();
        let ranked = ranked(&differences);
        assert_eq!(ranked[0], 0.0);
        assert!(ranked[1] > 0.2 && ranked[2].is_nan());
    }

    #[test]
    fn a_quarter_of_what_is_known_is_below() {
        let value = |frame: usize, pixel: usize| {
            let value = (frame * 29 + pixel * 13) % 31;
            if value.is_multiple_of(3) {
                f32::NAN
            } else {
                value as f32
            }
        };
        for frames in [1, 2, 5, 8] {
            let differences: Vec<Vec<f32>> = (0..frames)
                .map(|frame| (0..45).map(|pixel| value(frame, pixel)).collect())
                .collect();
            for (pixel, found) in ranked(&differences).into_iter().enumerate() {
                let mut known: Vec<f32> = (0..frames)
                    .map(|frame| value(frame, pixel))
                    .filter(|value| !value.is_nan())
                    .collect();
                known.sort_by(f32::total_cmp);
                let expected = known
                    .get(known.len() / 4)
                    .filter(|_| known.len() >= LEAST_KNOWN.min(frames));
                assert!(
                    expected.map_or(found.is_nan(), |expected| found == *expected),
                    "{found} {known:?}"
                );
            }
        }
    }
}
