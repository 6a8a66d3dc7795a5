//! Moving content: pixels that no static scene explains.
//!
//! The motion of the camera between a frame and others a little before and after it is estimated first (`motion`). It
//! leaves each point of a static scene one unknown, its distance, and so one arc along which it can have gone. The
//! frame's images are compared with those along the arc, at all distances ("plane sweep", Collins, "A space-sweep
//! approach to true multi-image matching", 1996). Content moves if even the best one does not fit, before and after.
//! Occlusion in one of the two does not count as motion, and neither do thin structures or repeated patterns: they fit
//! somewhere.
//!
//! Content that moves along its own arc like a static point at another distance is not detected. An example is a person
//! at eye level who walks in the same plane as the camera. Approach and moving limbs give them away, but take time to
//! show: the compared frames are at least a fifth of a second apart. The method needs no weights and knows no classes;
//! masks of a segmentation network are better.

use std::path::Path;

use glam::{Quat, Vec3};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    progress::Progress,
    records::Sequence,
    rgb::Mask,
};
use rayon::prelude::*;

use super::{FrameMasks, MaskMethod, field::Field};
use crate::{
    error::CurateError,
    motion::{CameraMotion, GreySphere, camera_motion},
};

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "residual",
    about: "what a still scene at no distance explains; no weights needed",
    settings,
    takes_perspective: false,
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
/// Factor over the sphere's median misfit from which on content moves.
const OVER_MEDIAN: f32 = 2.5;

fn settings() -> String {
    format!(
        "{IMAGE_WIDTH} px, {LEAST_GAP_SECONDS} s before and after, squares of {} px, {OVER_MEDIAN} \
         times the median over {EXTENT_RADIANS} radians",
        2 * REACH_PIXELS + 1
    )
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    let entries = &sequence.frames.entries;
    if entries.len() < 2 {
        return Err(CurateError::input(
            folder,
            "has a single frame, so nothing shows motion",
        ));
    }
    let times: Vec<f64> = entries.iter().map(|entry| entry.time_seconds).collect();
    let size = (
        sequence.frames.width as usize,
        sequence.frames.height as usize,
    );
    progress.begin("motion masks", Some(entries.len() as u64));
    let mut held = Images::new(folder, sequence);
    let masks = (0..entries.len())
        .map(|index| {
            let others = compared_with(&times, index);
            held.load(index)?;
            for &other in &others {
                held.load(other)?;
            }
            let others: Vec<&GreySphere> = others.iter().filter_map(|&i| held.get(i)).collect();
            let mask = held.get(index).map(|this| moving(this, &others));
            let mask = mask.ok_or_else(|| CurateError::internal(folder, "a frame is gone"))?;
            let mask = mask.map_err(|error| CurateError::internal(folder, error))?;
            held.forget_before(&times, index);
            progress.advance(1);
            let mask = mask.resized_to_nearest(size.0, size.1);
            Ok(FrameMasks::from(mask))
        })
        .collect();
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

/// Images of the frames that are being compared.
struct Images<'a> {
    folder: &'a Path,
    sequence: &'a Sequence,
    held: Vec<Option<GreySphere>>,
}

impl<'a> Images<'a> {
    fn new(folder: &'a Path, sequence: &'a Sequence) -> Self {
        Self {
            folder,
            sequence,
            held: vec![None; sequence.frames.entries.len()],
        }
    }

    fn load(&mut self, index: usize) -> Result<(), CurateError> {
        if self.held[index].is_none() {
            self.held[index] = Some(compared_image(self.folder, self.sequence, index)?);
        }
        Ok(())
    }

    fn get(&self, index: usize) -> Option<&GreySphere> {
        self.held[index].as_ref()
    }

    /// Drops images that no later frame is compared with.
    fn forget_before(&mut self, times: &[f64], index: usize) {
        let next = (index + 1).min(times.len() - 1);
        let oldest = compared_with(times, next).into_iter().min().unwrap_or(next);
        for held in &mut self.held[..oldest.min(index)] {
            *held = None;
        }
    }
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

fn smoothed(sphere: &GreySphere) -> opencv::Result<GreySphere> {
    let smooth = luma(sphere).blurred(SMOOTHING_PIXELS)?;
    Ok(GreySphere::of_luma(sphere.width(0), smooth.values))
}

fn luma(sphere: &GreySphere) -> Field {
    Field {
        width: sphere.width(0),
        height: sphere.width(0) / 2,
        values: sphere.luma().to_vec(),
    }
}

/// Marks moving content in an image, compared with others of the same scene.
fn moving(this: &GreySphere, others: &[&GreySphere]) -> opencv::Result<Mask> {
    let directions = directions(this.width(0));
    let misfit = others
        .iter()
        .map(|other| still_misfit(this, other, &camera_motion(this, other), &directions))
        .reduce(|a, b| Ok(a?.smaller(&b?)));
    let (width, height) = (this.width(0), this.width(0) / 2);
    let Some(misfit) = misfit.transpose()? else {
        return Ok(Mask::new(width, height, vec![0; width * height]));
    };
    let extent = EXTENT_RADIANS / this.pixel_radians(0);
    let slopes = luma(this).slopes().blurred(extent)?;
    let mut ratio = misfit.blurred(extent)?;
    for (value, slope) in ratio.values.iter_mut().zip(&slopes.values) {
        *value /= NOISE + MISPLACED_PIXELS * slope;
    }
    let limit = OVER_MEDIAN * ratio.median_on_sphere();
    let mark = |&value: &f32| if value > limit { 255 } else { 0 };
    Ok(Mask::new(
        width,
        height,
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
            difference(this, that, motion.rotation, shift, directions).box_mean(REACH_PIXELS)
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
