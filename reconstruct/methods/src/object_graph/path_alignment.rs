//! Component: paths are refit to where the images show their vehicles, before training.
//!
//! A path from detections is half a metre off, and its vehicle's Gaussians learn the mean of displaced images: a ghost.
//! [`super::patches`] measures by how much every view misses the path, [`super::refit`] moves the path's control points
//! and headings. A path stays as it is where few views align, where it is hardly off, or where the patch agrees no
//! better afterwards.

use std::fmt;

use glam::DVec3;
use omnilife_schemas::{
    Similarity,
    records::{Track, Tracks},
    statistics::median,
    trajectory::ObjectPath,
};
use omnilife_training::scene::TrainingScene;
use rayon::prelude::*;

use super::{
    initial,
    patches::{Miss, Patches},
    refit::{self, PoseCorrection},
};

/// Its name.
pub(super) const ID: &str = "path-alignment";

/// Minimum number of aligned views of a path, the reference among them.
const LEAST_VIEWS: usize = 4;
/// Minimum share of them among the views that show the object: elsewhere the refit only continues its neighbours.
const LEAST_SHARE: f64 = 0.75;
/// Minimum error of a path that is refit, in lengths of the object, in the median: a choice. On true paths patches are
/// off by up to this much, as light and surfaces are not those of a painted box.
const LEAST_ERROR: f64 = 0.05;
/// Minimum error of headings that are refit, radians, in the median: headings along a path are better than those by
/// patches, whose sides the light changes.
const LEAST_TURN: f64 = 0.05;
/// Maximum residual of a patch on its refit path, as a share of that on the given one.
const LARGEST_RESIDUAL: f64 = 0.95;
/// Error of a measured place beside its own, in lengths of the object.
const PLACE_ERROR: f64 = 0.02;
/// Error of a measured heading beside its own, radians.
const HEADING_ERROR: f64 = 0.01;
/// Factors by which images are reduced, from coarse to fine.
const REDUCTIONS: [u32; 2] = [4, 2];

/// Alignment of one object.
#[derive(Debug, Clone, PartialEq)]
struct AlignedObject {
    id: u32,
    /// Number of views that show it, and of those whose patch is aligned.
    views: [usize; 2],
    /// Distances of the aligned views' places from the given path, and from the refit one, metres.
    distances: [Vec<f64>; 2],
    /// Standard deviations of the places, metres.
    deviations: Vec<f64>,
    /// Mean absolute difference of the patch on the given path and on the refit one, levels of 255.
    residuals: Option<[f64; 2]>,
    /// The refit path, world units, if its patch agrees better.
    path: Option<ObjectPath>,
}

/// Alignment of all objects of a scene's tracks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PathSurvey {
    objects: Vec<AlignedObject>,
}

impl PathSurvey {
    /// Aligns the patches of all tracks.
    pub(super) fn new(scene: &TrainingScene, tracks: &Tracks) -> Self {
        let width = scene.camera.width();
        let reduced = REDUCTIONS.map(|factor| scene.reduced(width.div_ceil(factor)));
        let mut levels: Vec<&TrainingScene> = reduced.iter().collect();
        levels.push(scene);
        // A size that no factor divides is there more than once.
        levels.dedup_by_key(|level| level.camera.width());
        let objects = tracks.tracks.par_iter();
        let objects = objects.map(|track| aligned(&levels, tracks, track));
        Self {
            objects: objects.collect(),
        }
    }

    /// Returns the tracks with the refit paths.
    pub(super) fn refit(&self, tracks: &Tracks) -> Tracks {
        let mut tracks = tracks.clone();
        for (track, object) in tracks.tracks.iter_mut().zip(&self.objects) {
            if let Some(path) = &object.path {
                track.path = path.clone();
            }
        }
        tracks
    }

    /// Returns the median distance of the places in the images from the paths, metres: after the refit if it is used.
    /// `None` where no patch is aligned.
    pub(super) fn median_error(&self, is_used: bool) -> Option<f64> {
        let distances = self.objects.iter().flat_map(|object| {
            let is_refit = is_used && object.path.is_some();
            &object.distances[usize::from(is_refit)]
        });
        median(&distances.copied().collect::<Vec<f64>>())
    }

    /// Returns true if a path is off and its patch agrees better after a refit.
    pub(super) fn refits(&self) -> bool {
        self.refit_paths() > 0
    }

    fn refit_paths(&self) -> usize {
        let objects = self.objects.iter();
        objects.filter(|object| object.path.is_some()).count()
    }
}

impl fmt::Display for PathSurvey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let views = |index: usize| {
            self.objects
                .iter()
                .map(|one| one.views[index])
                .sum::<usize>()
        };
        write!(
            f,
            "{} of {} paths are refit, by patches aligned in {} of {} views",
            self.refit_paths(),
            self.objects.len(),
            views(1),
            views(0)
        )?;
        let (refit, kept): (Vec<&AlignedObject>, Vec<&AlignedObject>) =
            self.objects.iter().partition(|one| one.path.is_some());
        if !kept.is_empty() {
            let ids: Vec<String> = kept.iter().map(|one| one.id.to_string()).collect();
            write!(f, " (objects {} keep theirs", ids.join(", "))?;
            let distances = kept.iter().flat_map(|one| one.distances[0].clone());
            if let Some(distance) = median(&distances.collect::<Vec<f64>>()) {
                write!(f, ", {distance:.2} m off in the median")?;
            }
            f.write_str(")")?;
        }
        if refit.is_empty() {
            return Ok(());
        }
        let middle = |values: Vec<f64>| median(&values).unwrap_or(0.0);
        let of = |index: usize| {
            refit
                .iter()
                .flat_map(move |one| one.distances[index].clone())
        };
        let deviations = refit.iter().flat_map(|one| one.deviations.clone());
        let residual = |index: usize| {
            let residuals = refit
                .iter()
                .filter_map(move |one| Some(one.residuals?[index]));
            middle(residuals.collect())
        };
        write!(
            f,
            "; these show vehicles {:.2} m from the given paths in the median ({:.2} m uncertain), {:.2} m from the \
             refit ones; patches differ by {:.1} of 255 levels before and {:.1} after",
            middle(of(0).collect()),
            middle(deviations.collect()),
            middle(of(1).collect()),
            residual(0),
            residual(1)
        )
    }
}

/// Returns the alignment of a track; `levels` are the scene's images from coarse to fine.
fn aligned(levels: &[&TrainingScene], tracks: &Tracks, track: &Track) -> AlignedObject {
    let mut object = AlignedObject {
        id: track.id,
        views: [0; 2],
        distances: [Vec::new(), Vec::new()],
        deviations: Vec::new(),
        residuals: None,
        path: None,
    };
    let Some(scene) = levels.last() else {
        return object;
    };
    let up = DVec3::from_array(tracks.up);
    let given = initial::tracked_object(scene, track, up);
    let Some(patches) = Patches::new(levels, &given) else {
        return object;
    };
    object.views = [patches.views(), patches.aligned()];
    let least = (LEAST_SHARE * patches.views() as f64).ceil() as usize;
    if patches.aligned() < least.max(LEAST_VIEWS) {
        return object;
    }
    let normalization = &scene.normalization;
    let misses = patches.misses();
    let mut corrections: Vec<PoseCorrection> = misses
        .iter()
        .map(|miss| correction(miss, normalization))
        .collect();
    let turns: Vec<f64> = corrections.iter().map(|one| one.turn.abs()).collect();
    if median(&turns).is_some_and(|turn| turn < LEAST_TURN) {
        corrections.iter_mut().for_each(|one| one.turn = 0.0);
    }
    let metres = |world: f64| world * tracks.metres_per_unit;
    let from_given = corrections.iter().map(|one| metres(one.offset.length()));
    object.distances[0] = from_given.collect();
    let deviations = corrections
        .iter()
        .map(|one| metres(one.offset_variance.sqrt()));
    object.deviations = deviations.collect();
    let errors = [PLACE_ERROR * track.dimensions[0], HEADING_ERROR];
    let Some(refit) = refit::refit(&track.path, &corrections, errors) else {
        return object;
    };
    let from_refit = corrections.iter().map(|one| {
        let place = track.path.centre.position(one.seconds) + one.offset;
        metres(refit.centre.position(one.seconds).distance(place))
    });
    object.distances[1] = from_refit.collect();
    object.residuals = patches.residuals(
        |seconds| track.path.heading(seconds),
        |seconds| {
            let (centre, heading) = refit.at(seconds)?;
            Some((normalization.normalize(centre), heading))
        },
    );
    let least = metres(LEAST_ERROR * track.dimensions[0]);
    let is_off = median(&object.distances[0]).is_some_and(|error| error >= least);
    let is_better = object
        .residuals
        .is_some_and(|[before, after]| after <= LARGEST_RESIDUAL * before);
    object.path = (is_off && is_better).then_some(refit);
    object
}

/// Returns a miss as a correction of a path in world units.
fn correction(miss: &Miss, normalization: &Similarity) -> PoseCorrection {
    PoseCorrection {
        seconds: miss.seconds,
        offset: miss.rotation * miss.motion.shift.extend(0.0) / normalization.scale,
        turn: miss.motion.turn,
        offset_variance: miss.shift_variance / normalization.scale.powi(2),
        turn_variance: miss.turn_variance,
    }
}
