//! `motion`: content that the static geometry does not explain in other frames.
//!
//! Frames of other times are warped into a frame through the distances of its static surface and the poses. Static
//! content looks the same in most of them, unless something else passes or hides it; moving content differs from nearly
//! all. So the differences of a pixel are sorted, and a low quantile counts: a pixel that agrees with more than a
//! quarter of the other frames is static. The other frames are seconds apart, so that a car that waits for some seconds
//! is still found. Colours within a pixel of the warped place do not differ: the surface is known to that accuracy.
//! Thresholds follow the image: the median and 8 x 1.4826 times the median absolute deviation. A cast shadow moves too;
//! it is a darker copy of its background, and is cut off.

mod background;
mod extents;
mod neighbours;
mod patch;
mod regions;
mod surface;
mod texels;
mod transfer;

use glam::DVec3;
use omnilife_schemas::{
    RgbImage, posed_view::PosedView, progress::Progress, records::Detection, rgb::Mask, statistics,
};

use super::{Detector, DetectorInput, DetectorOutput};
use crate::{detectors::depth_of_points::DistanceMap, error::TracksError};
use background::{Background, ComparedFrame, differences, middle_colour};
use neighbours::{background_frames, compared_with};
use regions::{components, opened_and_closed, pieces, separated};
use texels::Texels;
use transfer::Rays;

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "motion",
    about: "what the static points do not explain in frames of other times; sees what moves and \
            nothing else, needs no weights",
    keeps_files: false,
    detect,
};

/// Robust standard deviations above the median from which a difference is motion.
const DEVIATIONS: f32 = 8.0;
/// Least difference that counts, of [0, 1]: noise of the camera and of its compression.
const LEAST_DIFFERENCE: f32 = 0.03;
/// Least area on the ground, square metres.
const LEAST_AREA: f64 = 2.0;
/// The same for a vehicle cut off by the border of the image.
const LEAST_CUT_AREA: f64 = 1.0;
/// Largest area on the ground of a vehicle, square metres.
const LARGEST_AREA: f64 = 60.0;
/// A shadow's brightness, over that of its background.
const SHADOW: std::ops::Range<f32> = 0.25..0.9;
/// Largest relative difference of a shadow's colour from a darker copy.
const SHADOW_COLOUR: f32 = 0.12;
/// Share of a component that must be left without its shadow for the cut to count: a dark car on a bright
/// road looks like its own shadow.
const LEAST_REST: f64 = 0.3;
/// Least area of each part of merged vehicles for a separation, square metres.
const LEAST_APART: f64 = 3.0;
/// Half the largest width of the neck between them, metres.
const DEEPEST_NECK: f64 = 0.9;

fn detect(
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<DetectorOutput, TracksError> {
    if input.views.len() < 2 {
        return Err(TracksError::input(
            input.folder,
            "has a single frame to look at, so nothing shows motion",
        ));
    }
    if input.points.is_empty() {
        return Err(TracksError::input(
            input.folder,
            "has no points of what stands still, which the detector motion needs",
        ));
    }
    let seconds: Vec<f64> = input.views.iter().map(|view| view.seconds).collect();
    let background = background_frames(&seconds);
    let rays = Rays::of(&input.scene.camera);
    let mut images: Vec<Option<Texels>> = input.views.iter().map(|_| None).collect();
    let mut found = Vec::new();
    progress.begin("moving vehicles", Some(input.views.len() as u64));
    let outcome = (0..input.views.len()).try_for_each(|index| -> Result<(), TracksError> {
        let others = compared_with(index, &seconds, &background);
        let first = others.iter().copied().chain([index]).min().unwrap_or(index);
        for (number, image) in images.iter_mut().enumerate().take(index) {
            if number < first || !background.contains(&number) {
                *image = None;
            }
        }
        for number in others.iter().copied().chain([index]) {
            if images[number].is_none() {
                images[number] = Some(read(input, &input.views[number])?);
            }
        }
        let view = &input.views[index];
        if let Some(texels) = &images[index] {
            let here = ComparedFrame::new(view, texels, &rays, input.ground);
            let others = others.iter().filter_map(|&other| {
                let texels = images[other].as_ref()?;
                Some(Background::new(view, &input.views[other], texels))
            });
            found.extend(moving(&here, &others.collect::<Vec<_>>(), input));
        }
        progress.advance(1);
        Ok(())
    });
    progress.end();
    outcome.map(|()| found.into())
}

/// Reads a frame with the distances of static content in it.
fn read(input: &DetectorInput<'_>, view: &PosedView) -> Result<Texels, TracksError> {
    let entry = &input.scene.frames[view.frame as usize];
    let mut image = RgbImage::read(&input.folder.join(&entry.image))?;
    if let Some(mask) = &entry.ignore_mask {
        forget(&mut image, &Mask::read(&input.folder.join(mask))?);
    }
    Ok(Texels::new(&image, &DistanceMap::new(view, input.points)))
}

/// Marks pixels outside the scene as unknown.
fn forget(image: &mut RgbImage, ignored: &Mask) {
    let ignored = ignored.resized_to_any(image.width, image.height);
    let pixels = image.data.as_chunks_mut::<3>().0.iter_mut();
    for (pixel, _) in pixels.zip(&ignored.data).filter(|(_, mark)| **mark != 0) {
        *pixel = [f32::NAN; 3];
    }
}

/// Returns the moving content of a frame.
fn moving(
    here: &ComparedFrame<'_>,
    others: &[Background<'_>],
    input: &DetectorInput<'_>,
) -> Vec<Detection> {
    let width = here.texels.width;
    let least = differences(here, others, LEAST_DIFFERENCE);
    let Some(limit) = threshold(&least) else {
        return Vec::new();
    };
    let mask: Vec<bool> = least.iter().map(|&value| value > limit).collect();
    let mask = opened_and_closed(&mask, width);
    let found = components(&mask, width).into_iter();
    found
        .flat_map(|pixels| vehicles(here, others, pixels, input.metres_per_unit))
        .collect()
}

/// Returns the least difference that is motion; `None` if nothing is known.
fn threshold(values: &[f32]) -> Option<f32> {
    let known: Vec<f32> = values
        .iter()
        .copied()
        .filter(|value| !value.is_nan())
        .collect();
    let median = statistics::median(&known)?;
    let deviations: Vec<f32> = known.iter().map(|value| (value - median).abs()).collect();
    let deviation = statistics::median(&deviations)?;
    Some((median + DEVIATIONS * 1.4826 * deviation).max(LEAST_DIFFERENCE))
}

/// Returns the vehicles of a component, without their shadows.
fn vehicles(
    here: &ComparedFrame<'_>,
    others: &[Background<'_>],
    pixels: Vec<usize>,
    metres_per_unit: f64,
) -> Vec<Detection> {
    let (width, height) = (here.texels.width, here.texels.height);
    let is_shadow = |pixel: usize| {
        let background = middle_colour(here, others, pixel);
        darker_copy(here.texels.colour(pixel), background)
    };
    let lit: Vec<usize> = pixels
        .iter()
        .copied()
        .filter(|&pixel| !is_shadow(pixel))
        .collect();
    let mut parts = pieces(&lit, width, height);
    let rest: usize = parts.iter().map(Vec::len).sum();
    let least_rest = LEAST_REST * pixels.len() as f64;
    if parts.is_empty() || (rest as f64) < least_rest {
        parts = vec![pixels];
    }
    let mut found = Vec::new();
    for (number, part) in parts.into_iter().enumerate() {
        let pixel_area = pixel_area(here, &part, metres_per_unit);
        // Beside the largest piece, those as large as a vehicle.
        let least_pixels = LEAST_APART / pixel_area;
        if number > 0 && (part.len() as f64) < least_pixels {
            continue;
        }
        let deepest = (DEEPEST_NECK / pixel_area.sqrt()) as usize;
        let apart = separated(part, width, least_pixels, deepest);
        found.extend(
            apart
                .iter()
                .filter_map(|pixels| detection(here, pixels, metres_per_unit)),
        );
    }
    found
}

/// Returns the area on the ground of the middle pixel of some, across its ray, square metres.
fn pixel_area(here: &ComparedFrame<'_>, pixels: &[usize], metres_per_unit: f64) -> f64 {
    let width = here.texels.width;
    let middle = pixels[pixels.len() / 2];
    let distance = f64::from(here.texels.distance(middle)) * metres_per_unit;
    let centre = glam::dvec2((middle % width) as f64 + 0.5, (middle / width) as f64 + 0.5);
    let [across, down] = here.view.ray_steps(centre).map(DVec3::length);
    across * down * distance * distance
}

/// Returns some pixels as a detection; `None` if their size is not that of a vehicle.
fn detection(
    here: &ComparedFrame<'_>,
    pixels: &[usize],
    metres_per_unit: f64,
) -> Option<Detection> {
    let width = here.texels.width;
    let area = pixels.len() as f64 * pixel_area(here, pixels, metres_per_unit);
    let box_pixels = box_of(pixels, width)?;
    let [left, top, columns, rows] = box_pixels;
    let is_cut = left <= 1.0
        || top <= 1.0
        || left + columns >= width as f64 - 1.0
        || top + rows >= here.texels.height as f64 - 1.0;
    let least = if is_cut { LEAST_CUT_AREA } else { LEAST_AREA };
    let is_vehicle = (least..=LARGEST_AREA).contains(&area);
    is_vehicle.then(|| Detection {
        frame: here.view.frame,
        box_pixels,
        confidence: 1.0,
        class: "vehicle".to_owned(),
        distance: None,
        position: None,
        track: None,
    })
}

/// Returns left, top, width and height of some pixels.
fn box_of(pixels: &[usize], width: usize) -> Option<[f64; 4]> {
    let columns = pixels.iter().map(|pixel| pixel % width);
    let rows = pixels.iter().map(|pixel| pixel / width);
    let (left, right) = (columns.clone().min()?, columns.max()?);
    let (top, bottom) = (rows.clone().min()?, rows.max()?);
    Some([
        left as f64,
        top as f64,
        (right - left + 1) as f64,
        (bottom - top + 1) as f64,
    ])
}

/// Returns true if a colour is that of a shadow on another.
fn darker_copy(shown: [f32; 3], background: [f32; 3]) -> bool {
    let ratios = [0, 1, 2].map(|channel| shown[channel] / background[channel].max(0.02));
    let mean = ratios.iter().sum::<f32>() / 3.0;
    // NaN is not a shadow.
    SHADOW.contains(&mean)
        && ratios
            .iter()
            .all(|ratio| (ratio / mean - 1.0).abs() < SHADOW_COLOUR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadows_are_darker_copies_and_paint_is_not() {
        assert!(darker_copy([0.3, 0.2, 0.25], [0.6, 0.4, 0.5]));
        assert!(!darker_copy([0.3, 0.1, 0.1], [0.6, 0.4, 0.5]));
        assert!(!darker_copy([0.6, 0.4, 0.5], [0.6, 0.4, 0.5]));
        assert!(!darker_copy([0.3, 0.2, 0.25], [f32::NAN; 3]));
    }
}
