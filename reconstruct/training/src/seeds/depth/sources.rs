//! Sources of the distances of the input views: files, or the sphere sweep.

use std::f32::consts::TAU;

use omnilife_engine::{camera::View, training_view::TrainingView};
use omnilife_schemas::{
    RgbImage,
    distances::{DistanceImage, EDGE_RATIO},
};

use super::{DistanceView, SourceView, checks};
use crate::{
    error::ReconstructError,
    scene::{TrainingScene, depth::resized_view},
    seeds::swept::{best_gap, evenly},
    stereo::{self, Placement, SweepSettings, SweptDepth},
};

/// Views of a scene, and the origin of their distances.
#[derive(Debug)]
pub struct Sources {
    /// The views with their distances.
    pub views: Vec<SourceView>,
    /// Number of each among the input views.
    pub numbers: Vec<usize>,
    /// Kind of origin.
    pub origin_kind: Origin,
    /// Origin in words.
    pub origin: String,
    /// Size of the distance images as read.
    pub size: [usize; 2],
}

/// Origin of distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Files that a scene has for some of its input views, or all.
    Files,
    /// The sphere sweep between input views.
    Sweep,
}

/// Demands on swept distances; pixels that do not meet them have none.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Demands {
    /// Minimum inverse distance, per distance between the two cameras.
    inverse: f32,
    /// Confidence above which a match counts.
    confidence: f32,
}

/// Number of other views in the sweep of a panorama.
const NEIGHBOURS: usize = 2;
/// Distances above this many distances between the two cameras are too far to be known. Any confirmed match counts.
const OF_ALL_VIEWS: Demands = Demands {
    inverse: 1.0 / 200.0,
    confidence: 0.0,
};
/// Minimum parallax of a distance of some views: half a pixel of the search.
const LEAST_PARALLAX: f32 = 0.5;
/// Confidence above which a match of theirs counts.
const LEAST_CONFIDENCE: f32 = 0.1;

/// Returns the origin of the distances that [`of_some`] takes, before any is read; `None` where a scene has no file of
/// them, and no two panoramas stand apart.
pub fn origin(scene: &TrainingScene) -> Option<Origin> {
    if !with_file(scene).is_empty() {
        return Some(Origin::Files);
    }
    let mut pairs = scene.input_views.windows(2);
    let has_parallax = pairs.any(|pair| pair[0].view.centre != pair[1].view.centre);
    (scene.camera.wraps() && has_parallax).then_some(Origin::Sweep)
}

/// Returns the distances of all input views: from their files, or without files by the sphere sweep.
///
/// # Errors
/// When only some views have a file, a file is not usable, or all cameras stand in one place.
pub fn of_scene(scene: &TrainingScene) -> Result<Sources, ReconstructError> {
    let count = scene.input_views.len();
    let given = with_file(scene);
    if given.is_empty() {
        return swept(scene);
    }
    let missing = (0..count).find(|view| !given.contains(view));
    if let Some(missing) = missing {
        return Err(ReconstructError::Request {
            reason: format!(
                "{}: input view {} has no distances, {} of {count} have; give all of them \
                 or none (curate poses --depth-prior)",
                scene.id,
                scene.input_views[missing].frame,
                given.len()
            ),
        });
    }
    read(scene, given)
}

/// Returns the distances of at most so many input views, evenly from all: from files where the scene has any, or by
/// sphere sweeps against the view before and the one after at the gap with most parallax that still matches.
///
/// # Errors
/// When a file is not usable or means other distances than its record says, the views are not panoramas, or all cameras
/// stand in one place.
pub fn of_some(scene: &TrainingScene, most: usize) -> Result<Sources, ReconstructError> {
    let given = with_file(scene);
    if !given.is_empty() {
        let chosen = evenly(given.len(), most).map(|at| given[at]).collect();
        let sources = read(scene, chosen)?;
        let views: Vec<DistanceView<'_>> = sources.views.iter().map(SourceView::as_given).collect();
        checks::require_meaning(scene, &views)?;
        return Ok(sources);
    }
    let without_parallax = || ReconstructError::Request {
        reason: format!(
            "{}: no two panoramas stand far enough apart to tell distances",
            scene.id
        ),
    };
    let gap = best_gap(scene).ok_or_else(without_parallax)?;
    let count = scene.input_views.len();
    let chosen: Vec<usize> = evenly(count, most).collect();
    let beside = |view: usize| {
        let before = view.checked_sub(gap).map(|other| [other, view]);
        let after = (view + gap < count).then_some([view, view + gap]);
        before.into_iter().chain(after)
    };
    let mut pairs: Vec<[usize; 2]> = chosen.iter().flat_map(|&view| beside(view)).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let estimates = estimates(scene, &pairs);
    let (mut views, mut numbers) = (Vec::new(), Vec::new());
    for &number in &chosen {
        let of_view = &estimates[number];
        let width = of_view.first().map_or(1, |(depth, _)| depth.width);
        let demands = Demands {
            inverse: LEAST_PARALLAX * TAU / width as f32,
            confidence: LEAST_CONFIDENCE,
        };
        if let Some(view) = merged(&scene.input_views[number], of_view, demands) {
            views.push(view);
            numbers.push(number);
        }
    }
    if views.is_empty() {
        return Err(without_parallax());
    }
    let what = format!("{} pairs of views, {gap} input views apart", pairs.len());
    Ok(of_sweeps(views, numbers, &what))
}

/// Returns the numbers of the input views whose distances are in a file.
fn with_file(scene: &TrainingScene) -> Vec<usize> {
    let files = scene.depth_priors.iter().enumerate();
    let has_file = files.filter(|(_, file)| file.is_some());
    has_file.map(|(view, _)| view).collect()
}

/// Reads the files of some views.
fn read(scene: &TrainingScene, numbers: Vec<usize>) -> Result<Sources, ReconstructError> {
    let read = |&view: &usize| scene.distances(view);
    let read: Vec<Option<DistanceImage>> = numbers.iter().map(read).collect::<Result<_, _>>()?;
    let sizes = read.iter().flatten();
    let size = sizes.map(|image| [image.width, image.height]).max();
    let size = size.unwrap_or_default();
    let views = numbers.iter().map(|&number| &scene.input_views[number]);
    let views = views.zip(read.into_iter().flatten());
    let views = views.map(|(view, distances)| SourceView::on_one_grid(view, distances));
    let name = scene.depth_priors.iter().flatten().next();
    let name = name.map_or("given", |file| file.prior.source.as_str());
    Ok(Sources {
        views: views.collect(),
        numbers,
        origin_kind: Origin::Files,
        origin: format!("files ({name}), {}x{}", size[0], size[1]),
        size,
    })
}

/// Sweeps every panorama against its nearest neighbours; the other view confirms each direction.
fn swept(scene: &TrainingScene) -> Result<Sources, ReconstructError> {
    if !scene.camera.wraps() {
        return Err(ReconstructError::Request {
            reason: format!(
                "{}: needs distances: the scene has none (curate poses --depth-prior), and the sphere \
                 sweep, which finds them, takes panoramas",
                scene.id
            ),
        });
    }
    let views = &scene.input_views;
    let estimates = estimates(scene, &pairs(views));
    let found: Option<Vec<SourceView>> = views
        .iter()
        .zip(&estimates)
        .map(|(view, estimates)| merged(view, estimates, OF_ALL_VIEWS))
        .collect();
    let Some(found) = found else {
        return Err(ReconstructError::Request {
            reason: format!(
                "{}: needs distances: the scene has none (curate poses --depth-prior), and cameras that \
                 stand in one place give none by themselves",
                scene.id
            ),
        });
    };
    let numbers = (0..found.len()).collect();
    Ok(of_sweeps(found, numbers, "neighbouring views"))
}

fn of_sweeps(views: Vec<SourceView>, numbers: Vec<usize>, what: &str) -> Sources {
    let size = views
        .first()
        .map_or([0; 2], |view| [view.distances.width, view.distances.height]);
    Sources {
        views,
        numbers,
        origin_kind: Origin::Sweep,
        origin: format!("the sphere sweep of {what}, {}x{}", size[0], size[1]),
        size,
    }
}

/// Sweeps pairs of views against each other; returns the depths of each input view, with the distance of the pair's
/// cameras.
fn estimates(scene: &TrainingScene, pairs: &[[usize; 2]]) -> Vec<Vec<(SweptDepth, f64)>> {
    let views = &scene.input_views;
    let mut estimates: Vec<Vec<(SweptDepth, f64)>> = vec![Vec::new(); views.len()];
    let [width, height] = scene.camera.size();
    let image = |view: &TrainingView| RgbImage::from_rgb8(width, height, &view.pixels);
    for &[first, second] in pairs {
        let of_pair = [&views[first], &views[second]];
        let [a, b] = of_pair.map(image);
        let cameras = of_pair.map(|view| placement(&view.view));
        if let Some((rig, [a, b])) = stereo::depths([&a, &b], cameras, &SweepSettings::DEFAULT) {
            estimates[first].push((a, rig.baseline));
            estimates[second].push((b, rig.baseline));
        }
    }
    estimates
}

/// Returns each view with its nearest neighbours, every pair once.
fn pairs(views: &[TrainingView]) -> Vec<[usize; 2]> {
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let away = |other: usize| view.view.centre.distance(views[other].view.centre);
        let mut others: Vec<usize> = (0..views.len())
            .filter(|&other| other != number && away(other) > 0.0)
            .collect();
        others.sort_by(|&a, &b| away(a).total_cmp(&away(b)));
        for &other in others.iter().take(NEIGHBOURS) {
            pairs.push([number.min(other), number.max(other)]);
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

fn placement(view: &View) -> Placement {
    Placement {
        to_world: view.rotation.as_dmat3().transpose(),
        centre: view.centre.as_dvec3(),
    }
}

/// Merges the estimates of one view. Confirmed ones are weighted by confidence where two agree; otherwise the
/// more confident one wins. `None` without any estimate.
fn merged(
    view: &TrainingView,
    estimates: &[(SweptDepth, f64)],
    demands: Demands,
) -> Option<SourceView> {
    let (first, _) = estimates.first()?;
    let (width, height) = (first.width, first.height);
    let mut values = Vec::with_capacity(width * height);
    let mut confidences = Vec::with_capacity(width * height);
    for pixel in 0..width * height {
        let (mut inverse, mut weight) = (0.0_f32, 0.0_f32);
        for (depth, baseline) in estimates {
            let (found, confidence) = (depth.inverse_distances[pixel], depth.confidences[pixel]);
            if confidence <= demands.confidence || found < demands.inverse {
                continue;
            }
            let found = found / *baseline as f32;
            let agrees = inverse.max(found) < EDGE_RATIO * inverse.min(found);
            if agrees {
                let sum = weight + confidence;
                inverse = (weight * inverse + confidence * found) / sum;
                weight = sum;
            } else if confidence > weight {
                (inverse, weight) = (found, confidence);
            }
        }
        values.push(if inverse > 0.0 { 1.0 / inverse } else { 0.0 });
        confidences.push(weight.min(1.0));
    }
    Some(SourceView {
        view: resized_view(view, [width, height]),
        distances: DistanceImage {
            width,
            height,
            wraps: true,
            values,
        },
        confidences: Some(confidences),
    })
}
