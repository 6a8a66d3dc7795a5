//! Stable regions of the sphere, and their classes.

use std::f64::consts::{PI, TAU};

use omnilife_schemas::records::{Overlay, OverlayClass};

use super::{
    stability::{PixelStability, Stability},
    surroundings,
};

/// Mean gradient, in 8-bit levels per pixel, from which a pixel can belong to an overlay.
const LEAST_STRENGTH: f32 = 5.0;
/// A pixel is stable when this share of its detail stays from one examined frame to the next. Scenes that flow by keep
/// the direction of their gradients for long, but not the gradients.
const LEAST_STAYED: f32 = 0.75;
/// Surroundings stay where this share of their detail does.
const MOSTLY: f32 = 0.5;
/// Least constancy of gradients for content that stays over the whole video; captions change.
const LEAST_CONSTANCY: f64 = 0.93;
/// Pixels of one region are at most this many pixels apart; the lines of a grid are farther.
const REACH_PIXELS: usize = 4;
const GRID_REACH_PIXELS: usize = 12;
/// Least share of a grid's lines in each direction.
const LEAST_GRID_SHARE: f64 = 0.2;
/// Smaller regions are left out, steradians: a spot of two degrees.
const LEAST_STERADIANS: f64 = 1e-3;
/// Least share of stable pixels in a region; the rest is surrounded by its parts.
const LEAST_FILL: f64 = 0.05;

/// A line of a grid has this many times the mean difference of the lines beside it.
const GRID_CONTRAST: f32 = 2.5;
/// Gradients on the lines of a mosaic follow the scene.
const MOST_GRID_CONSTANCY: f32 = 0.6;

/// A region whose lowest point is below this latitude reaches the nadir, degrees.
const NADIR_DEGREES: f64 = -78.0;
/// Share of all longitudes at which the border of a patch stays.
const LEAST_BORDER_SHARE: f64 = 0.4;
/// Finds less than this above the border of a patch belong to the border, degrees.
const PATCH_BORDER_DEGREES: f64 = 3.0;
/// A painted patch varies by less than this over time, 8-bit levels.
const PAINTED_VARIATION: f64 = 4.0;
/// Least ratio of width to height of captions.
const CAPTION_ASPECT: f64 = 3.0;
/// A region at least this large below the horizon is a body and no sign, steradians.
const BODY_STERADIANS: f64 = 0.25;

/// Finds all stable regions.
pub(super) fn find(stability: &Stability) -> Vec<Overlay> {
    let grid = Grid {
        width: stability.width,
        height: stability.height,
    };
    let stays =
        |pixel: &PixelStability| pixel.strength >= LEAST_STRENGTH && pixel.stayed >= LEAST_STAYED;
    let constant: Vec<bool> = stability.pixels.iter().map(stays).collect();
    let is_detailed = |at: usize| stability.pixels[at].strength >= LEAST_STRENGTH;
    let mostly_stays = |at: usize| stability.pixels[at].stayed >= MOSTLY;
    let mut found: Vec<Overlay> = grid
        .regions(&constant, REACH_PIXELS)
        .iter()
        .filter_map(|region| {
            let overlay = region.overlay(&grid, stability, &constant, None)?;
            // What carries the camera may fill all of its surroundings.
            let is_rig = overlay.class == OverlayClass::Rig;
            let is_painted =
                || surroundings::are_moving(&grid, &region.pixels, is_detailed, mostly_stays);
            (is_rig || is_painted()).then_some(overlay)
        })
        .collect();
    if let Some((patch, latitude)) = nadir_patch(&grid, stability) {
        // Its border is found again piece by piece, and anything painted on it is part of it.
        found.retain(|overlay| overlay.latitude_degrees > latitude + PATCH_BORDER_DEGREES);
        found.push(patch);
    }
    let (columns, rows) = grid_lines(stability);
    let lines: Vec<bool> = columns.iter().zip(&rows).map(|(c, r)| *c || *r).collect();
    let is_grid = |region: &&Region| {
        let count = |marks: &[bool]| region.pixels.iter().filter(|&&at| marks[at]).count() as f64;
        let (columns, rows) = (count(&columns), count(&rows));
        columns.min(rows) >= LEAST_GRID_SHARE * (columns + rows)
    };
    found.extend(
        grid.regions(&lines, GRID_REACH_PIXELS)
            .iter()
            .filter(is_grid)
            .filter_map(|region| {
                region.overlay(&grid, stability, &lines, Some(OverlayClass::Mosaic))
            }),
    );
    found
}

/// Returns a painted cap over the nadir, and the latitude of its border in degrees: rows that are the same in every
/// frame, up to a border that is stable all around.
fn nadir_patch(grid: &Grid, stability: &Stability) -> Option<(Overlay, f64)> {
    let row = |y: usize| &stability.pixels[y * grid.width..(y + 1) * grid.width];
    let mean = |y: usize, of: fn(&PixelStability) -> f32| {
        row(y).iter().map(|pixel| f64::from(of(pixel))).sum::<f64>() / grid.width as f64
    };
    let rows = (0..grid.height)
        .rev()
        .take_while(|&y| mean(y, |pixel| pixel.variation) < PAINTED_VARIATION)
        .count();
    let top = grid.height - rows;
    if rows * 36 < grid.height || top < 4 {
        return None;
    }
    // Scaling and compression spread the border over a few rows.
    let border: Vec<&PixelStability> = (0..grid.width)
        .filter_map(|x| {
            (top - 4..(top + 2).min(grid.height))
                .map(|y| &row(y)[x])
                .max_by(|a, b| a.strength.total_cmp(&b.strength))
        })
        .collect();
    let stays = |pixel: &&&PixelStability| {
        pixel.strength >= LEAST_STRENGTH && f64::from(pixel.constancy) >= LEAST_CONSTANCY
    };
    let share = border.iter().filter(stays).count() as f64 / grid.width as f64;
    if share < LEAST_BORDER_SHARE {
        return None;
    }
    let average = |of: fn(&PixelStability) -> f32| {
        border.iter().map(|pixel| f64::from(of(pixel))).sum::<f64>() / grid.width as f64
    };
    let steradians = |y: usize| grid.steradians(y) * grid.width as f64;
    let area: f64 = (top..grid.height).map(steradians).sum();
    let extreme: f64 = (top..grid.height)
        .map(|y| {
            let count = row(y).iter().filter(|pixel| is_extreme(pixel)).count();
            grid.steradians(y) * count as f64
        })
        .sum();
    let overlay = Overlay {
        class: OverlayClass::NadirPatch,
        longitude_degrees: 0.0,
        latitude_degrees: -90.0,
        solid_angle_steradians: area,
        extent_degrees: None,
        constancy: average(|pixel| pixel.constancy),
        stayed: average(|pixel| pixel.stayed),
        strength_levels: average(|pixel| pixel.strength),
        variation_levels: (top..grid.height)
            .map(|y| steradians(y) * mean(y, |pixel| pixel.variation))
            .sum::<f64>()
            / area,
        saturated_share: extreme / area,
        sightings: None,
        ranges: Vec::new(),
    };
    Some((overlay, grid.latitude(top).to_degrees()))
}

/// Returns true for a nearly black or nearly white pixel.
fn is_extreme(pixel: &PixelStability) -> bool {
    !(25.0..=230.0).contains(&pixel.level)
}

/// Pixels on columns, and on rows, of a grid that does not move while its levels do.
fn grid_lines(stability: &Stability) -> (Vec<bool>, Vec<bool>) {
    let (width, height) = (stability.width, stability.height);
    let pixel = |x: usize, y: usize| &stability.pixels[y * width + x % width];
    let stands_out = |here: f32, before: f32, after: f32| {
        here >= LEAST_STRENGTH && here >= GRID_CONTRAST * before.max(after).max(0.5)
    };
    let mut columns = vec![false; width * height];
    let mut rows = vec![false; width * height];
    for y in 1..height.saturating_sub(1) {
        for x in 0..width {
            let here = pixel(x, y);
            if here.constancy > MOST_GRID_CONSTANCY {
                continue;
            }
            columns[y * width + x] = stands_out(
                here.absolute[0],
                pixel(x + width - 1, y).absolute[0],
                pixel(x + 1, y).absolute[0],
            );
            rows[y * width + x] = stands_out(
                here.absolute[1],
                pixel(x, y - 1).absolute[1],
                pixel(x, y + 1).absolute[1],
            );
        }
    }
    // A line is several pixels long.
    let run = |marks: &[bool], x: usize, y: usize, down: bool| {
        (0..3).all(|step| {
            let (x, y) = if down {
                (x, y + step)
            } else {
                ((x + step) % width, y)
            };
            y < height && marks[y * width + x]
        })
    };
    let long = |marks: &[bool], down: bool| {
        (0..width * height)
            .map(|at| run(marks, at % width, at / width, down))
            .collect()
    };
    (long(&columns, true), long(&rows, false))
}

/// The pixels of an equirectangular image.
pub(super) struct Grid {
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Connected pixels.
pub(super) struct Region {
    pub(super) pixels: Vec<usize>,
}

impl Grid {
    pub(super) fn latitude(&self, y: usize) -> f64 {
        (0.5 - (y as f64 + 0.5) / self.height as f64) * PI
    }

    pub(super) fn longitude(&self, x: usize) -> f64 {
        ((x as f64 + 0.5) / self.width as f64 - 0.5) * TAU
    }

    /// Returns the solid angle of a pixel, steradians.
    pub(super) fn steradians(&self, y: usize) -> f64 {
        TAU / self.width as f64 * PI / self.height as f64 * self.latitude(y).cos()
    }

    /// Neighbourhoods of marked pixels that touch, across the seam too.
    pub(super) fn regions(&self, marks: &[bool], reach_pixels: usize) -> Vec<Region> {
        let near = self.grown(marks, reach_pixels / 2);
        let mut seen = vec![false; near.len()];
        let mut regions = Vec::new();
        for start in 0..near.len() {
            if seen[start] || !near[start] {
                continue;
            }
            let mut pixels = Vec::new();
            let mut open = vec![start];
            seen[start] = true;
            while let Some(at) = open.pop() {
                pixels.push(at);
                let (x, y) = (at % self.width, at / self.width);
                let mut visit = |x: usize, y: usize| {
                    let next = y * self.width + x;
                    if near[next] && !seen[next] {
                        seen[next] = true;
                        open.push(next);
                    }
                };
                visit((x + 1) % self.width, y);
                visit((x + self.width - 1) % self.width, y);
                if y > 0 {
                    visit(x, y - 1);
                }
                if y + 1 < self.height {
                    visit(x, y + 1);
                }
            }
            regions.push(Region { pixels });
        }
        regions
    }

    /// Returns everything within so many rows and columns of a mark.
    pub(super) fn grown(&self, marks: &[bool], reach: usize) -> Vec<bool> {
        let mut wide = vec![false; marks.len()];
        for at in (0..marks.len()).filter(|&at| marks[at]) {
            let (x, y) = (at % self.width, at / self.width);
            for row in y.saturating_sub(reach)..=(y + reach).min(self.height - 1) {
                for shift in 0..=2 * reach {
                    wide[row * self.width + (x + self.width + shift - reach) % self.width] = true;
                }
            }
        }
        wide
    }
}

impl Region {
    fn overlay(
        &self,
        grid: &Grid,
        stability: &Stability,
        marks: &[bool],
        class: Option<OverlayClass>,
    ) -> Option<Overlay> {
        let mut area = 0.0;
        let mut direction = [0.0; 3];
        let mut marked = 0.0;
        let (mut strength, mut stayed, mut constancy, mut variation) = (0.0, 0.0, 0.0, 0.0);
        let mut extreme = 0.0;
        let mut columns = vec![false; grid.width];
        let (mut top, mut bottom) = (grid.height, 0);
        for &at in &self.pixels {
            let (x, y) = (at % grid.width, at / grid.width);
            let steradians = grid.steradians(y);
            let (longitude, latitude) = (grid.longitude(x), grid.latitude(y));
            area += steradians;
            direction[0] += steradians * latitude.cos() * longitude.sin();
            direction[1] += steradians * latitude.sin();
            direction[2] += steradians * latitude.cos() * longitude.cos();
            columns[x] = true;
            (top, bottom) = (top.min(y), bottom.max(y));
            let pixel = &stability.pixels[at];
            variation += steradians * f64::from(pixel.variation);
            if is_extreme(pixel) {
                extreme += steradians;
            }
            if marks[at] {
                marked += steradians;
                strength += steradians * f64::from(pixel.strength);
                constancy += steradians * f64::from(pixel.constancy);
                stayed += steradians * f64::from(pixel.stayed);
            }
        }
        if area < LEAST_STERADIANS || marked < LEAST_FILL * area {
            return None;
        }
        let length = direction
            .iter()
            .map(|c| c * c)
            .sum::<f64>()
            .sqrt()
            .max(1e-12);
        let latitude = (direction[1] / length).clamp(-1.0, 1.0).asin();
        let lowest = grid.latitude(bottom);
        let width = columns.iter().filter(|&&covered| covered).count() as f64 / grid.width as f64;
        let shape = Shape {
            steradians: area,
            reaches_nadir: lowest.to_degrees() < NADIR_DEGREES,
            is_below_horizon: latitude < -0.2,
            aspect: width * TAU * latitude.cos()
                / ((bottom + 1 - top) as f64 / grid.height as f64 * PI),
            constancy: constancy / marked,
        };
        Some(Overlay {
            class: class.unwrap_or_else(|| shape.class()),
            longitude_degrees: direction[0].atan2(direction[2]).to_degrees(),
            latitude_degrees: latitude.to_degrees(),
            solid_angle_steradians: area,
            extent_degrees: None,
            constancy: shape.constancy,
            stayed: stayed / marked,
            strength_levels: strength / marked,
            variation_levels: variation / area,
            saturated_share: extreme / area,
            sightings: None,
            ranges: Vec::new(),
        })
    }
}

/// Features that decide the class of a region.
struct Shape {
    steradians: f64,
    reaches_nadir: bool,
    is_below_horizon: bool,
    /// Width over height as seen from the centre.
    aspect: f64,
    constancy: f64,
}

impl Shape {
    fn class(&self) -> OverlayClass {
        if self.reaches_nadir {
            return OverlayClass::Rig;
        }
        // The light on a body changes; painted content is the same in every frame.
        let is_body = self.is_below_horizon && self.constancy < LEAST_CONSTANCY;
        if is_body && self.steradians > BODY_STERADIANS {
            return OverlayClass::Rig;
        }
        if self.aspect >= CAPTION_ASPECT && self.constancy < LEAST_CONSTANCY {
            return OverlayClass::Caption;
        }
        OverlayClass::Watermark
    }
}
