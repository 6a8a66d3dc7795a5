//! Moving content: pixels that no static scene explains.
//!
//! While the camera stands, views before and after are compared as they are (`still`). Otherwise the motion of the
//! camera between a frame and others a little before and after it is estimated first (`motion`). It leaves each point of
//! a static scene one unknown, its distance, and so one arc along which it can have gone. The frame's images are
//! compared with those along the arc, at all distances ("plane sweep", Collins, "A space-sweep approach to true
//! multi-image matching", 1996). Content moves if even the best one does not fit, before and after. Occlusion in one of
//! the two does not count as motion, and neither do thin structures or repeated patterns: they fit somewhere.
//! Perspective frames have no arcs: they are compared after a shift of the whole image.
//!
//! Content that moves along its own arc like a static point at another distance is not detected. An example is a person
//! at eye level who walks in the same plane as the camera. Approach and moving limbs give them away, but take time to
//! show: the compared frames are at least a fifth of a second apart. The method needs no weights and knows no classes;
//! masks of a segmentation network are better.

use std::{f32::consts::TAU, path::Path};

use glam::{Quat, Vec3};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    progress::Progress,
    records::Sequence,
    rgb::Mask,
};
use rayon::prelude::*;

use super::{
    FrameMasks, MaskMethod,
    changes::{Changes, ComparableFrame},
    field::Field,
    plane::Plane,
    still::{self, StillViews},
};
use crate::{
    error::CurateError,
    motion::{CameraMotion, GreySphere},
};

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "residual",
    about: "what a still scene at no distance explains; no weights needed",
    settings,
    find,
};

/// Columns of the images that are compared.
pub(super) const IMAGE_WIDTH: usize = 512;
/// Smoothing, pixels: finer detail differs by its sampling.
const SMOOTHING_PIXELS: f32 = 0.7;
/// Frames are compared over at least this long, seconds: slow motion needs time to show.
const LEAST_GAP_SECONDS: f64 = 0.2;
/// Images are compared in squares that reach this far, pixels.
const REACH_PIXELS: usize = 2;
/// Differences of grey values, of [0, 1], are clamped to this.
const LARGEST_DIFFERENCE: f32 = 0.25;
/// Radius over which misfit is combined, radians: limbs and the torso between them.
const EXTENT_RADIANS: f32 = 0.055;
/// Misfit that a static scene may have: this much anywhere, of [0, 1] ...
const NOISE: f32 = 0.01;
/// ... and as the slope of the image times this many pixels.
const MISPLACED_PIXELS: f32 = 0.3;
/// Factor over the median misfit from which on content moves.
const OVER_MEDIAN: f32 = 2.5;

fn settings() -> String {
    format!(
        "{IMAGE_WIDTH} px; {}; another one: {LEAST_GAP_SECONDS} s before and after, squares of {} px, \
         {OVER_MEDIAN} times the median over {EXTENT_RADIANS} radians",
        still::settings(),
        2 * REACH_PIXELS + 1
    )
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    if sequence.frames.entries.len() < 2 {
        return Err(CurateError::input(
            folder,
            "has a single frame, so nothing shows motion",
        ));
    }
    match sequence.is_pinhole() {
        true => find_in::<Plane>(folder, sequence, progress),
        false => find_in::<GreySphere>(folder, sequence, progress),
    }
}

fn find_in<I: ComparableFrame>(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    let frames = &sequence.frames;
    let (width, height) = (frames.width as usize, frames.height as usize);
    progress.begin("motion masks", Some(frames.entries.len() as u64));
    let mut still = StillViews::<I>::new(folder, sequence);
    let mut changes = Changes::<I>::new(folder, sequence);
    let masks = (0..frames.entries.len()).map(|index| {
        let mask = if let Some(mask) = still.of_frame(index)? {
            mask
        } else {
            let (grey, misfit) = changes.misfit(index)?;
            let mask = unexplained(&grey, &misfit, I::IS_SPHERE);
            mask.map_err(|error| CurateError::internal(folder, error))?
        };
        progress.advance(1);
        Ok(FrameMasks::from(mask.resized_to_nearest(width, height)))
    });
    let masks = masks.collect();
    progress.end();
    masks
}

/// Returns the nearest frames that are far enough before and after one; the farthest ones if the sequence is too short.
pub(super) fn compared_with(times: &[f64], index: usize) -> Vec<usize> {
    let mut others = around(times, index, LEAST_GAP_SECONDS);
    if others.is_empty() {
        others.push(if index == 0 { times.len() - 1 } else { 0 });
    }
    others
}

/// Returns the nearest frames at least `gap_seconds` before and after one, if there are any.
pub(super) fn around(times: &[f64], index: usize, gap_seconds: f64) -> Vec<usize> {
    let now = times[index];
    let is_far = |other: &usize| (now - times[*other]).abs() >= gap_seconds - 1e-6;
    let before = (0..index).rev().find(is_far);
    let after = (index + 1..times.len()).find(is_far);
    before.into_iter().chain(after).collect()
}

/// Reads a frame as it is compared: grey, at most [`IMAGE_WIDTH`] pixels wide, smoothed.
pub(super) fn compared_image(
    folder: &Path,
    sequence: &Sequence,
    index: usize,
) -> Result<GreySphere, CurateError> {
    let path = folder.join(&sequence.frames.entries[index].file);
    let image = RgbImage::read(&path)?;
    let width = IMAGE_WIDTH.min(image.width);
    let smoothed = smoothed(&GreySphere::new(&image, width));
    smoothed.map_err(|error| CurateError::internal(&path, error))
}

/// Smooths a panorama for comparisons.
pub(super) fn smoothed(sphere: &GreySphere) -> opencv::Result<GreySphere> {
    let smooth = luma(sphere).blurred(SMOOTHING_PIXELS, true)?;
    Ok(GreySphere::of_luma(sphere.width(0), smooth.values))
}

/// Returns the grey values of a panorama, of [0, 1].
pub(super) fn luma(sphere: &GreySphere) -> Field {
    Field {
        width: sphere.width(0),
        height: sphere.width(0) / 2,
        values: sphere.luma().to_vec(),
    }
}

/// Marks misfit that stands out against the slopes of the image and the median of all. A perspective frame is taken as
/// wide as a whole turn.
fn unexplained(grey: &Field, misfit: &Field, is_sphere: bool) -> opencv::Result<Mask> {
    let extent = EXTENT_RADIANS * grey.width as f32 / TAU;
    let slopes = grey.slopes(is_sphere).blurred(extent, is_sphere)?;
    let mut ratio = misfit.blurred(extent, is_sphere)?;
    for (value, slope) in ratio.values.iter_mut().zip(&slopes.values) {
        *value /= NOISE + MISPLACED_PIXELS * slope;
    }
    let median = if is_sphere {
        ratio.median_on_sphere()
    } else {
        ratio.median(|_| 1.0)
    };
    let mark = |&value: &f32| 255 * u8::from(value > OVER_MEDIAN * median);
    Ok(Mask::new(
        ratio.width,
        ratio.height,
        ratio.values.iter().map(mark).collect(),
    ))
}

/// Returns the directions of the pixels of a panorama, row by row.
pub(super) fn directions(width: usize) -> Vec<Vec3> {
    let camera = ErpCamera::new(width as u32, width as u32 / 2);
    (0..camera.height)
        .flat_map(|row| (0..camera.width).map(move |column| (column, row)))
        .map(|(column, row)| {
            let pixel = glam::dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            camera.unproject(pixel).as_vec3()
        })
        .collect()
}

/// Returns the mean difference of grey values around each pixel at the distance with the best fit.
///
/// A static point in direction `d` at distance `z` is seen in direction `d - t b / z` after the camera went by `b`
/// towards `t`. The sweep is over `b / z`, in steps of a pixel.
pub(super) fn still_misfit(
    this: &GreySphere,
    that: &GreySphere,
    motion: &CameraMotion,
    directions: &[Vec3],
) -> opencv::Result<Field> {
    let width = this.width(0);
    let step = this.pixel_radians(0);
    let (heading, steps) = match motion.heading {
        Some(heading) => (
            heading,
            (motion.largest_parallax / step).ceil() as usize + 1,
        ),
        None => (Vec3::ZERO, 0),
    };
    (0..=steps)
        .map(|index| {
            let shift = index as f32 * step * heading;
            difference(this, that, motion.rotation, shift, directions).box_mean(REACH_PIXELS, true)
        })
        .reduce(|a, b| Ok(a?.smaller(&b?)))
        .unwrap_or_else(|| {
            Ok(Field {
                width,
                height: width / 2,
                values: vec![0.0; directions.len()],
            })
        })
}

/// Returns differences of grey values if every point were at the distance of this `shift`.
fn difference(
    this: &GreySphere,
    that: &GreySphere,
    rotation: Quat,
    shift: Vec3,
    directions: &[Vec3],
) -> Field {
    let width = this.width(0);
    let luma = this.luma();
    let mut values = vec![0.0; directions.len()];
    values
        .par_chunks_mut(width)
        .zip(directions.par_chunks(width))
        .zip(luma.par_chunks(width))
        .for_each(|((values, directions), luma)| {
            for ((value, &direction), &here) in values.iter_mut().zip(directions).zip(luma) {
                let there = that.sample(0, rotation * (direction - shift));
                *value = (there - here).abs().min(LARGEST_DIFFERENCE);
            }
        });
    Field {
        width,
        height: width / 2,
        values,
    }
}
