//! Changes of the image against a still scene, between a frame and others around it.
//!
//! They confirm regions that a network found, and are not masks: an object leaves a change at its old and new place.
//! If the camera moves, a change must show before and after, since near things hide others. Where it stands, frames
//! further away are compared too: an animal may rest for a second.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    path::Path,
};

use omnilife_schemas::{records::Sequence, rgb::Mask};

use super::{field::Field, residual};
use crate::{
    error::CurateError,
    motion::{GreySphere, camera_motion},
};

/// Mean difference of grey values, of [0, 1], by which the surroundings of a pixel change. Any value
/// from 0.02 to 0.06 overlaps the labelled animals as well, to 0.02.
const LEAST_CHANGE: f32 = 0.04;
/// Distance in time of the frames that are compared while the camera stands, seconds.
const FAR_SECONDS: f64 = 1.0;
/// A camera stands while the nearest content is shifted by less than so many pixels.
const STANDS_PIXELS: f32 = 2.0;

/// A frame as it is compared.
pub(super) trait ComparableFrame: Sized {
    /// True for panoramas, false for perspective frames.
    const IS_SPHERE: bool;

    /// Reads a frame of a sequence.
    fn read(folder: &Path, sequence: &Sequence, index: usize) -> Result<Self, CurateError>;

    /// Returns the mean difference of grey values around each pixel that a still scene would leave between this frame
    /// and another one, and true if the camera stood.
    fn compare(&self, that: &Self) -> opencv::Result<(Field, bool)>;

    /// Returns its grey values, of [0, 1].
    fn grey(&self) -> Field;
}

impl ComparableFrame for GreySphere {
    const IS_SPHERE: bool = true;

    fn read(folder: &Path, sequence: &Sequence, index: usize) -> Result<Self, CurateError> {
        residual::compared_image(folder, sequence, index)
    }

    fn compare(&self, that: &Self) -> opencv::Result<(Field, bool)> {
        let motion = camera_motion(self, that);
        let stands = motion.largest_parallax < STANDS_PIXELS * self.pixel_radians(0);
        let directions = residual::directions(self.width(0));
        Ok((
            residual::still_misfit(self, that, &motion, &directions)?,
            stands,
        ))
    }

    fn grey(&self) -> Field {
        residual::luma(self)
    }
}

/// The frames of a sequence that are being compared.
pub(super) struct Changes<'a, I> {
    folder: &'a Path,
    sequence: &'a Sequence,
    times: Vec<f64>,
    held: BTreeMap<usize, I>,
}

impl<'a, I: ComparableFrame> Changes<'a, I> {
    pub(super) fn new(folder: &'a Path, sequence: &'a Sequence) -> Self {
        let entries = sequence.frames.entries.iter();
        Self {
            folder,
            sequence,
            times: entries.map(|entry| entry.time_seconds).collect(),
            held: BTreeMap::new(),
        }
    }

    /// Marks the changes in a frame, at the size at which frames are compared. Frames are asked for in order of time.
    ///
    /// # Errors
    /// When a frame cannot be read or filtered.
    pub(super) fn of_frame(&mut self, index: usize) -> Result<Mask, CurateError> {
        let near = residual::compared_with(&self.times, index);
        let far = residual::around(&self.times, index, FAR_SECONDS);
        for &other in near.iter().chain(&far).chain([&index]) {
            self.load(other)?;
        }
        let changes = self.largest(index, &near, &far);
        let changes = changes.map_err(|error| CurateError::internal(self.folder, error))?;
        self.forget_before(index);
        let mark = |&value: &f32| 255 * u8::from(value > LEAST_CHANGE);
        Ok(Mask::new(
            changes.width,
            changes.height,
            changes.values.iter().map(mark).collect(),
        ))
    }

    /// Returns a frame's grey values and its misfit to a still scene in the nearest frames before and after, whichever
    /// is smaller. Frames are asked for in order of time.
    ///
    /// # Errors
    /// When a frame cannot be read or filtered.
    pub(super) fn misfit(&mut self, index: usize) -> Result<(Field, Field), CurateError> {
        let near = residual::compared_with(&self.times, index);
        for &other in near.iter().chain([&index]) {
            self.load(other)?;
        }
        let this = &self.held[&index];
        let grey = this.grey();
        let misfits = near.iter().map(|other| this.compare(&self.held[other]));
        let smallest = misfits
            .map(|compared| compared.map(|(misfit, _)| misfit))
            .reduce(|a, b| Ok(a?.smaller(&b?)))
            .transpose()
            .map_err(|error| CurateError::internal(self.folder, error))?;
        self.forget_before(index);
        let nothing = || Field {
            values: vec![0.0; grey.values.len()],
            ..grey
        };
        let misfit = smallest.unwrap_or_else(nothing);
        Ok((grey, misfit))
    }

    fn load(&mut self, index: usize) -> Result<(), CurateError> {
        if let Entry::Vacant(place) = self.held.entry(index) {
            place.insert(I::read(self.folder, self.sequence, index)?);
        }
        Ok(())
    }

    /// Returns the change of every pixel: in all of the near frames while the camera moves, in any frame while it stands.
    fn largest(&self, index: usize, near: &[usize], far: &[usize]) -> opencv::Result<Field> {
        let this = &self.held[&index];
        let compared = |others: &[usize]| -> opencv::Result<Vec<(Field, bool)>> {
            let others = others.iter().filter(|&&other| other != index);
            others
                .map(|other| this.compare(&self.held[other]))
                .collect()
        };
        let near = compared(near)?;
        let joined = if near.iter().all(|&(_, stands)| stands) {
            let all = near.into_iter().chain(compared(far)?);
            all.map(|(field, _)| field).reduce(|a, b| a.larger(&b))
        } else {
            near.into_iter()
                .map(|(field, _)| field)
                .reduce(|a, b| a.smaller(&b))
        };
        Ok(joined.unwrap_or(Field {
            width: 0,
            height: 0,
            values: Vec::new(),
        }))
    }

    /// Drops the frames that no later one is compared with.
    fn forget_before(&mut self, index: usize) {
        let next = (index + 1).min(self.times.len() - 1);
        let near = residual::compared_with(&self.times, next);
        let far = residual::around(&self.times, next, FAR_SECONDS);
        let oldest = near.into_iter().chain(far).min().unwrap_or(next);
        let oldest = oldest.min(next);
        self.held.retain(|&held, _| held >= oldest);
    }
}
