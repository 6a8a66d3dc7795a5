//! Held-out tracks: features that verified matches connect, and that the mapper of their own road did not see. Other
//! roads may have found the same points. Poses of all roads are judged by the same tracks: every feature is predicted
//! from the others of its track.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    records::HeldOutScore,
    statistics::median,
    store::{self, StoreError},
};

use crate::poses::{
    colmap::{ColmapImage, ColmapModel},
    parallax::rotation_between,
    validate::angle_degrees,
};

/// An error of this many degrees and more gives no credit: about a pixel and a half of a panorama of 1,024.
const NO_CREDIT_DEGREES: f64 = 0.5;
/// Rounds in which a triangulated point's distances weight its rays.
const ROUNDS: usize = 3;
/// Rays whose normal matrix has a determinant below this, of 1, are parallel.
const PARALLEL: f64 = 1e-12;
/// Centres closer than this share of their distance from the origin, or of 1, are in one place.
const SAME_PLACE: f64 = 1e-9;
/// Tracks that two frames must share before their parallax is measured.
const LEAST_SHARED: usize = 30;

/// A feature: the name of its frame, and its unit ray in the axes of the frame's camera.
type Feature = (String, DVec3);

/// Held-out tracks of one attempt, or of several.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct HeldOutTracks {
    tracks: Vec<Vec<Feature>>,
}

impl HeldOutTracks {
    /// Reads the script's file: a line per track, of `<frame> <x> <y> <z>` per feature. No file holds no tracks: the
    /// attempt ended before its matches were verified.
    pub(super) fn read(path: &Path) -> Result<Self, StoreError> {
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = store::read_text(path)?;
        let tracks = text.lines().enumerate().map(|(index, line)| {
            parse(line).ok_or_else(|| {
                let reason = format!("line {}: expected a name and a ray per feature", index + 1);
                StoreError::malformed(path, reason)
            })
        });
        Ok(Self {
            tracks: tracks.collect::<Result<_, _>>()?,
        })
    }

    /// Adds the tracks of another attempt.
    pub(super) fn extend(&mut self, other: &Self) {
        self.tracks.extend(other.tracks.iter().cloned());
    }

    /// Scores the poses of a model; `None` without tracks of three features.
    pub(super) fn score(&self, model: &ColmapModel) -> Option<HeldOutScore> {
        let images: HashMap<&str, &ColmapImage> = model
            .images
            .values()
            .map(|image| (image.name.as_str(), image))
            .collect();
        let images = &images;
        let tracks = self.tracks.iter().filter(|track| track.len() >= 3);
        let errors: Vec<Option<f64>> = tracks
            .flat_map(|track| {
                (0..track.len()).map(move |index| error_degrees(track, index, images))
            })
            .collect();
        if errors.is_empty() {
            return None;
        }
        let credit = errors
            .iter()
            .flatten()
            .map(|error| (1.0 - error / NO_CREDIT_DEGREES).max(0.0));
        let score = credit.sum::<f64>() / errors.len() as f64;
        let measured: Vec<f64> = errors.iter().flatten().copied().collect();
        Some(HeldOutScore {
            observations: errors.len() as u32,
            median_degrees: median(&measured),
            score,
        })
    }

    /// Returns the parallax of the pair of frames that has most of it, degrees: the median angle that the best
    /// rotation leaves between their rays. `None` if no two frames share enough tracks.
    pub(super) fn parallax_degrees(&self) -> Option<f64> {
        let mut pairs: BTreeMap<[&str; 2], Vec<[DVec3; 2]>> = BTreeMap::new();
        for track in &self.tracks {
            for (index, (one, first)) in track.iter().enumerate() {
                for (other, second) in track.iter().skip(index + 1) {
                    let (names, rays) = if one <= other {
                        ([one.as_str(), other.as_str()], [*first, *second])
                    } else {
                        ([other.as_str(), one.as_str()], [*second, *first])
                    };
                    pairs.entry(names).or_default().push(rays);
                }
            }
        }
        let pairs = pairs.values().filter(|rays| rays.len() >= LEAST_SHARED);
        pairs
            .filter_map(|rays| {
                let rotation = rotation_between(rays)?;
                let left = rays
                    .iter()
                    .map(|[one, other]| angle_degrees(rotation * *one, *other));
                median(&left.collect::<Vec<f64>>())
            })
            .max_by(f64::total_cmp)
    }
}

/// Parses a line of features; `None` if a word is missing or no finite number.
fn parse(line: &str) -> Option<Vec<Feature>> {
    let mut words = line.split_whitespace();
    let mut track = Vec::new();
    while let Some(name) = words.next() {
        let mut number = || {
            words
                .next()?
                .parse::<f64>()
                .ok()
                .filter(|value| value.is_finite())
        };
        let ray = DVec3::new(number()?, number()?, number()?);
        track.push((name.to_owned(), ray.try_normalize()?));
    }
    Some(track)
}

/// Returns the angle between a feature's ray and the direction that the other features of its track predict, degrees.
/// `None` if its frame or all but one of the others have no pose, or if all frames of the track are in one place, where
/// rotations alone predict it.
fn error_degrees(
    track: &[Feature],
    index: usize,
    images: &HashMap<&str, &ColmapImage>,
) -> Option<f64> {
    let (name, ray) = track.get(index)?;
    let image = images.get(name.as_str())?;
    let others: Vec<(DVec3, DVec3)> = track
        .iter()
        .enumerate()
        .filter(|(other, _)| *other != index)
        .filter_map(|(_, (name, ray))| {
            let image = images.get(name.as_str())?;
            Some((image.centre, image.rotation * *ray))
        })
        .collect();
    let least = SAME_PLACE * image.centre.length().max(1.0);
    let is_apart = |(origin, _): &(DVec3, DVec3)| origin.distance(image.centre) > least;
    if others.len() < 2 || !others.iter().any(is_apart) {
        return None;
    }
    let expected = direction_from(image.centre, &others);
    Some(angle_degrees(image.rotation * *ray, expected))
}

/// Returns the direction from a centre to the point that is nearest to rays (origin, unit direction), by least squares
/// of angles; the mean direction of parallel rays, whose point is infinitely far.
fn direction_from(centre: DVec3, rays: &[(DVec3, DVec3)]) -> DVec3 {
    let mean: DVec3 = rays.iter().map(|(_, direction)| *direction).sum();
    let mut weights = vec![1.0 / rays.len() as f64; rays.len()];
    let mut expected = mean;
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for ((origin, direction), weight) in rays.iter().zip(&weights) {
            let across = DMat3::IDENTITY
                - DMat3::from_cols(
                    *direction * direction.x,
                    *direction * direction.y,
                    *direction * direction.z,
                );
            matrix += across * *weight;
            // Relative to the centre: far from the origin nothing cancels.
            right += across * (*origin - centre) * *weight;
        }
        if matrix.determinant().abs() < PARALLEL {
            return expected;
        }
        let point = matrix.inverse() * right;
        let closeness: Vec<f64> = rays
            .iter()
            .map(|(origin, _)| {
                1.0 / (point + centre)
                    .distance_squared(*origin)
                    .max(f64::MIN_POSITIVE)
            })
            .collect();
        let sum: f64 = closeness.iter().sum();
        weights = closeness.iter().map(|weight| weight / sum).collect();
        expected = point;
    }
    expected
}

#[cfg(test)]
mod tests;
