//! `motion`: what the static geometry does not explain in the frames before and after.
//!
//! The frame before and the one after are warped into a frame through the distances of its static
//! surface and the poses. Where both differ from it - the smaller of the two differences, blurred -
//! something moves: what stands still is hidden in one of them at most. Thresholds follow the image: the
//! median and 8 x 1.4826 times the median absolute deviation. A cast shadow moves too; it is a darker
//! copy of what is behind it, and is cut off.

use glam::DVec3;
use omnilife_schemas::{RgbImage, camera::CameraModel, progress::Progress, records::Detection};
use rayon::prelude::*;

use super::{Detector, DetectorInput};
use crate::{
    error::CurateError,
    tracks::{detectors::depth_of_points::DistanceMap, views::PosedView},
};

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "motion",
    about: "what the static points do not explain in the frames before and after; sees what moves and \
            nothing else, needs no weights",
    detect,
};

/// Surfaces of a warped view may be this much farther or nearer than they should, relatively.
const OCCLUSION: f32 = 0.03;
/// Robust standard deviations above the median from which a difference is motion.
const DEVIATIONS: f32 = 8.0;
/// Least difference that counts, of [0, 1]: noise of the camera and of its compression.
const LEAST_DIFFERENCE: f32 = 0.04;
/// Radii of the square windows that open and close what was found, pixels.
const OPENING: usize = 1;
const CLOSING: usize = 4;
/// Least area on the ground, square metres.
const LEAST_AREA: f64 = 1.0;
/// Largest area on the ground, square metres: beyond it is no vehicle.
const LARGEST_AREA: f64 = 60.0;
/// A shadow's brightness, over that of what it falls on.
const SHADOW: std::ops::Range<f32> = 0.25..0.9;
/// A shadow's colour differs so much from a darker copy, relatively.
const SHADOW_COLOUR: f32 = 0.12;
/// Share of a component that must be left without its shadow for the cut to count: a dark car on a bright
/// road looks like its own shadow.
const LEAST_REST: f64 = 0.3;

fn detect(
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<Vec<Detection>, CurateError> {
    if input.views.len() < 2 {
        return Err(CurateError::input(
            input.folder,
            "has a single frame to look at, so nothing shows motion",
        ));
    }
    if input.points.is_empty() {
        return Err(CurateError::input(
            input.folder,
            "has no points of what stands still, which the detector motion needs",
        ));
    }
    let mut images: Vec<Option<(RgbImage, DistanceMap)>> = vec![None; input.views.len()];
    let mut found = Vec::new();
    progress.begin("moving vehicles", Some(input.views.len() as u64));
    let outcome = (0..input.views.len()).try_for_each(|index| -> Result<(), CurateError> {
        let others = neighbours(index, input.views.len());
        for needed in others.iter().copied().chain([index]) {
            if images[needed].is_none() {
                let view = &input.views[needed];
                let entry = &input.scene.frames[view.frame as usize];
                let image = RgbImage::read(&input.folder.join(&entry.image))?;
                images[needed] = Some((image, DistanceMap::new(view, input.points)));
            }
        }
        for forgotten in images.iter_mut().take(index.saturating_sub(2)) {
            *forgotten = None;
        }
        let held = |number: usize| {
            let (image, distances) = images[number].as_ref()?;
            Some(Looked {
                view: &input.views[number],
                image,
                distances,
            })
        };
        if let Some(here) = held(index) {
            let others: Vec<Looked<'_>> = others.iter().filter_map(|&other| held(other)).collect();
            found.extend(moving(&here, &others, input.metres_per_unit));
        }
        progress.advance(1);
        Ok(())
    });
    progress.end();
    outcome.map(|()| found)
}

/// The frames before and after one; at an end, the two nearest.
fn neighbours(index: usize, count: usize) -> Vec<usize> {
    let wanted = match index {
        0 => [1, 2],
        last if last + 1 == count => [last - 1, last.saturating_sub(2)],
        middle => [middle - 1, middle + 1],
    };
    let mut others: Vec<usize> = wanted
        .into_iter()
        .filter(|&other| other < count && other != index)
        .collect();
    others.dedup();
    others
}

/// A frame that is compared.
struct Looked<'a> {
    view: &'a PosedView,
    image: &'a RgbImage,
    distances: &'a DistanceMap,
}

/// What moves in a frame.
fn moving(here: &Looked<'_>, others: &[Looked<'_>], metres_per_unit: f64) -> Vec<Detection> {
    let (width, height) = (here.image.width, here.image.height);
    let backgrounds: Vec<Vec<[f32; 3]>> = others.iter().map(|other| warped(here, other)).collect();
    let differences: Vec<Vec<f32>> = backgrounds
        .iter()
        .map(|background| {
            let pixels = here.image.data.as_chunks::<3>().0.iter().zip(background);
            let difference = pixels.map(|(here, there)| {
                let sum: f32 = here.iter().zip(there).map(|(a, b)| (a - b).abs()).sum();
                sum / 3.0
            });
            blurred(&difference.collect::<Vec<f32>>(), width, 2)
        })
        .collect();
    // The smaller of the known ones; NaN is what the other frame does not show.
    let least: Vec<f32> = (0..width * height)
        .map(|pixel| {
            differences
                .iter()
                .map(|one| one[pixel])
                .fold(f32::NAN, f32::min)
        })
        .collect();
    let Some(limit) = threshold(&least) else {
        return Vec::new();
    };
    let mask: Vec<bool> = least.iter().map(|&value| value > limit).collect();
    let mask = opened_and_closed(&mask, width);
    components(&mask, width)
        .into_iter()
        .filter_map(|pixels| vehicle(here, &backgrounds, pixels, metres_per_unit))
        .collect()
}

/// Another frame as it would look from here; NaN where it does not show the surface that is here.
fn warped(here: &Looked<'_>, other: &Looked<'_>) -> Vec<[f32; 3]> {
    let width = here.image.width;
    let mut colours = vec![[f32::NAN; 3]; width * here.image.height];
    colours
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, colours)| {
            for (column, colour) in colours.iter_mut().enumerate() {
                let distance = here.distances.values[row * width + column];
                if !distance.is_finite() {
                    continue;
                }
                let pixel = glam::dvec2(column as f64 + 0.5, row as f64 + 0.5);
                let point = here.view.centre + here.view.ray(pixel) * f64::from(distance);
                *colour = seen(other, point).unwrap_or([f32::NAN; 3]);
            }
        });
    colours
}

/// The colour of a point of the surface in a frame, bilinear; `None` where it is hidden or outside.
fn seen(other: &Looked<'_>, point: DVec3) -> Option<[f32; 3]> {
    let (width, height) = (other.image.width, other.image.height);
    let pixel = other.view.camera.project(other.view.in_camera(point))? - 0.5;
    let (column, row) = (pixel.x.floor(), pixel.y.floor());
    if column < 0.0 || row < 0.0 || column + 1.0 >= width as f64 || row + 1.0 >= height as f64 {
        return None;
    }
    let (x, y) = ((pixel.x - column) as f32, (pixel.y - row) as f32);
    let at = row as usize * width + column as usize;
    let expected = point.distance(other.view.centre) as f32;
    if other.distances.values[at] < expected * (1.0 - OCCLUSION) {
        return None;
    }
    let value = |at: usize, channel: usize| other.image.data[3 * at + channel];
    Some([0, 1, 2].map(|channel| {
        let top = (1.0 - x) * value(at, channel) + x * value(at + 1, channel);
        let bottom = (1.0 - x) * value(at + width, channel) + x * value(at + width + 1, channel);
        (1.0 - y) * top + y * bottom
    }))
}

/// Means over squares that reach `radius` pixels; NaN is left out, and stays where all are.
fn blurred(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut out = vec![f32::NAN; values.len()];
    out.par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, out)| {
            for (column, out) in out.iter_mut().enumerate() {
                let (mut sum, mut count) = (0.0, 0);
                for row in row.saturating_sub(radius)..=(row + radius).min(height - 1) {
                    for column in column.saturating_sub(radius)..=(column + radius).min(width - 1) {
                        let value = values[row * width + column];
                        if !value.is_nan() {
                            sum += value;
                            count += 1;
                        }
                    }
                }
                if count > 0 {
                    *out = sum / count as f32;
                }
            }
        });
    out
}

/// Above which a difference is motion; `None` where nothing is known.
fn threshold(values: &[f32]) -> Option<f32> {
    let mut known: Vec<f32> = values
        .iter()
        .copied()
        .filter(|value| !value.is_nan())
        .collect();
    let middle = |values: &mut Vec<f32>| {
        let at = values.len() / 2;
        (!values.is_empty()).then(|| *values.select_nth_unstable_by(at, f32::total_cmp).1)
    };
    let median = middle(&mut known)?;
    let mut deviations: Vec<f32> = known.iter().map(|value| (value - median).abs()).collect();
    let deviation = middle(&mut deviations)?;
    Some((median + DEVIATIONS * 1.4826 * deviation).max(LEAST_DIFFERENCE))
}

/// Whether any (or, `all`, every) pixel of the square around each is set.
fn spread(mask: &[bool], width: usize, radius: usize, all: bool) -> Vec<bool> {
    let height = mask.len() / width;
    let pass = |mask: &[bool], along_rows: bool| -> Vec<bool> {
        (0..mask.len())
            .map(|pixel| {
                let (row, column) = (pixel / width, pixel % width);
                let (at, end, stride) = if along_rows {
                    (column, width, 1)
                } else {
                    (row, height, width)
                };
                let mut near = (at.saturating_sub(radius)..=(at + radius).min(end - 1))
                    .map(|other| mask[pixel + other * stride - at * stride]);
                if all {
                    near.all(|set| set)
                } else {
                    near.any(|set| set)
                }
            })
            .collect()
    };
    pass(&pass(mask, true), false)
}

/// Without specks, and without gaps.
fn opened_and_closed(mask: &[bool], width: usize) -> Vec<bool> {
    let opened = spread(&spread(mask, width, OPENING, true), width, OPENING, false);
    spread(
        &spread(&opened, width, CLOSING, false),
        width,
        CLOSING,
        true,
    )
}

/// Pixels of the connected components (8 neighbours).
fn components(mask: &[bool], width: usize) -> Vec<Vec<usize>> {
    let height = mask.len() / width;
    let mut is_open = mask.to_vec();
    let mut all = Vec::new();
    for first in 0..mask.len() {
        if !is_open[first] {
            continue;
        }
        is_open[first] = false;
        let mut pixels = vec![first];
        let mut next = 0;
        while let Some(&pixel) = pixels.get(next) {
            next += 1;
            let (row, column) = (pixel / width, pixel % width);
            for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let neighbour = row * width + column;
                    if is_open[neighbour] {
                        is_open[neighbour] = false;
                        pixels.push(neighbour);
                    }
                }
            }
        }
        all.push(pixels);
    }
    all
}

/// A component as a detection, less its shadow; `None` where it is no vehicle by its size.
fn vehicle(
    here: &Looked<'_>,
    backgrounds: &[Vec<[f32; 3]>],
    pixels: Vec<usize>,
    metres_per_unit: f64,
) -> Option<Detection> {
    let width = here.image.width;
    let is_shadow = |pixel: usize| {
        let shown = &here.image.data[3 * pixel..3 * pixel + 3];
        backgrounds
            .iter()
            .any(|background| darker_copy(shown, background[pixel]))
    };
    let without: Vec<bool> = {
        let mut mask = vec![false; here.image.data.len() / 3];
        pixels
            .iter()
            .for_each(|&pixel| mask[pixel] = !is_shadow(pixel));
        opened_and_closed(&mask, width)
    };
    let rest = components(&without, width).into_iter().max_by_key(Vec::len);
    let pixels = match rest {
        Some(rest) if rest.len() as f64 >= LEAST_REST * pixels.len() as f64 => rest,
        _ => pixels,
    };
    let columns = pixels.iter().map(|pixel| pixel % width);
    let rows = pixels.iter().map(|pixel| pixel / width);
    let (left, right) = (columns.clone().min()?, columns.max()?);
    let (top, bottom) = (rows.clone().min()?, rows.max()?);
    let middle = pixels[pixels.len() / 2];
    let distance = f64::from(here.distances.values[middle]) * metres_per_unit;
    let centre = glam::dvec2((middle % width) as f64 + 0.5, (middle / width) as f64 + 0.5);
    let [across, down] = here.view.ray_steps(centre).map(DVec3::length);
    let area = pixels.len() as f64 * across * down * distance * distance;
    let is_vehicle = (LEAST_AREA..=LARGEST_AREA).contains(&area);
    is_vehicle.then(|| Detection {
        frame: here.view.frame,
        box_pixels: [
            left as f64,
            top as f64,
            (right - left + 1) as f64,
            (bottom - top + 1) as f64,
        ],
        confidence: 1.0,
        class: "vehicle".to_owned(),
        distance: None,
        position: None,
        track: None,
    })
}

/// Whether a colour is that of a shadow on another.
fn darker_copy(shown: &[f32], background: [f32; 3]) -> bool {
    let ratios = [0, 1, 2].map(|channel| shown[channel] / background[channel].max(0.02));
    let mean = ratios.iter().sum::<f32>() / 3.0;
    // NaN is no shadow.
    SHADOW.contains(&mean)
        && ratios
            .iter()
            .all(|ratio| (ratio / mean - 1.0).abs() < SHADOW_COLOUR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_connected_and_specks_go() {
        let width = 20;
        let mut mask = vec![false; 20 * 12];
        for (row, column) in
            [(2..6, 3..9), (3..6, 12..18)]
                .into_iter()
                .flat_map(|(rows, columns)| {
                    rows.flat_map(move |row| columns.clone().map(move |column| (row, column)))
                })
        {
            mask[row * width + column] = true;
        }
        mask[width * 11] = true;
        let opened = spread(&spread(&mask, width, 1, true), width, 1, false);
        let mut sizes: Vec<usize> = components(&opened, width).iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [18, 24]);
        // The two are near enough to be closed into one.
        assert_eq!(components(&opened_and_closed(&mask, width), width).len(), 1);
    }

    #[test]
    fn shadows_are_darker_copies_and_paint_is_not() {
        assert!(darker_copy(&[0.3, 0.2, 0.25], [0.6, 0.4, 0.5]));
        assert!(!darker_copy(&[0.3, 0.1, 0.1], [0.6, 0.4, 0.5]));
        assert!(!darker_copy(&[0.6, 0.4, 0.5], [0.6, 0.4, 0.5]));
        assert!(!darker_copy(&[0.3, 0.2, 0.25], [f32::NAN; 3]));
    }

    #[test]
    fn every_frame_has_neighbours() {
        assert_eq!(neighbours(0, 5), [1, 2]);
        assert_eq!(neighbours(2, 5), [1, 3]);
        assert_eq!(neighbours(4, 5), [3, 2]);
        assert_eq!(neighbours(0, 2), [1]);
        assert_eq!(neighbours(1, 2), [0]);
    }
}
