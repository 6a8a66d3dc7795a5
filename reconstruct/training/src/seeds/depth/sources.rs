//! Sources of the distances of the input views: files, or the sphere sweep.

use omnilife_engine::{camera::View, training_view::TrainingView};
use omnilife_schemas::distances::{DistanceImage, EDGE_RATIO};

use super::SourceView;
use crate::{
    error::ReconstructError,
    scene::{TrainingScene, depth::resized_view},
    stereo::{self, Placement, SweepSettings, SweptDepth},
};

/// Views of a scene, and the origin of their distances.
#[derive(Debug)]
pub struct Sources {
    /// The views with their distances.
    pub views: Vec<SourceView>,
    /// Origin in words.
    pub origin: String,
    /// Size of the distance images as read.
    pub size: [usize; 2],
}

/// Number of other views in the sweep of a panorama.
const NEIGHBOURS: usize = 2;
/// Distances above this many distances between the two cameras are too far to be known.
const FARTHEST_BASELINES: f32 = 200.0;

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
    read(scene, &given)
}

/// Returns the numbers of the input views whose distances are in a file.
fn with_file(scene: &TrainingScene) -> Vec<usize> {
    let files = scene.depth_priors.iter().enumerate();
    let has_file = files.filter(|(_, file)| file.is_some());
    has_file.map(|(view, _)| view).collect()
}

/// Reads the files of views with these numbers.
fn read(scene: &TrainingScene, numbers: &[usize]) -> Result<Sources, ReconstructError> {
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
        .map(|(view, estimates)| merged(view, estimates))
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
    let size = found
        .first()
        .map_or([0; 2], |view| [view.distances.width, view.distances.height]);
    Ok(Sources {
        views: found,
        origin: format!(
            "the sphere sweep of neighbouring views, {}x{}",
            size[0], size[1]
        ),
        size,
    })
}

/// Sweeps pairs of views against each other; returns the depths of each input view, with the distance of the pair's
/// cameras.
fn estimates(scene: &TrainingScene, pairs: &[[usize; 2]]) -> Vec<Vec<(SweptDepth, f64)>> {
    let views = &scene.input_views;
    let mut estimates: Vec<Vec<(SweptDepth, f64)>> = vec![Vec::new(); views.len()];
    let image = |view: &TrainingView| stereo::searched_image(view, scene.camera.size());
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
fn merged(view: &TrainingView, estimates: &[(SweptDepth, f64)]) -> Option<SourceView> {
    let (first, _) = estimates.first()?;
    let (width, height) = (first.width, first.height);
    let mut values = Vec::with_capacity(width * height);
    let mut confidences = Vec::with_capacity(width * height);
    for pixel in 0..width * height {
        let (mut inverse, mut weight) = (0.0_f32, 0.0_f32);
        for (depth, baseline) in estimates {
            let (found, confidence) = (depth.inverse_distances[pixel], depth.confidences[pixel]);
            if confidence <= 0.0 || found < 1.0 / FARTHEST_BASELINES {
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
