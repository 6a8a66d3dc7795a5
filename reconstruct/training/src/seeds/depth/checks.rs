//! Checks of the meaning of distances, by the agreement of views on places and colours.

use omnilife_schemas::{
    camera::Camera, distances::DistanceImage, records::DistanceConvention, statistics::median,
};

use super::{
    lift::DistanceView,
    pairs::{self, LEAST_PLACES, ONE_SURFACE, ScaledViews, Sighting, shown, with_distances},
    units::{Reading, other_unit},
};
use crate::{error::ReconstructError, scene::TrainingScene};

/// Differences between views that the rounding to pixels explains.
pub const LEAST_DISAGREEMENT: f64 = 0.005;
/// Minimum gain in agreement of mirrored views for a mirrored world, dB.
const MIRRORED_DECIBELS: f64 = 3.0;
/// Maximum share of places in two views with different distances; occlusions count.
const MOST_APART: f64 = 0.1;
/// Minimum ratio of that share to the share with mirrored distances for a mirrored world.
const APART_FACTOR: f64 = 1.5;
/// Minimum gain in agreement under another convention for taking it as the meant one, a factor.
const CONVENTION_FACTOR: f64 = 3.0;

/// Returns true if the distances of views of one surface differ by more than the rounding to pixels.
pub fn differ(disagreement: f64) -> bool {
    disagreement > LEAST_DISAGREEMENT
}

/// Refuses distances of a mirrored world, in another unit than the poses, or of another convention than their record's: `views` are those of the
/// scene that have some.
///
/// # Errors
/// When the views agree clearly better under another meaning of the distances or poses.
pub fn require_meaning(
    scene: &TrainingScene,
    views: &[DistanceView<'_>],
) -> Result<(), ReconstructError> {
    let refuse = |reason: String| {
        Err(ReconstructError::Request {
            reason: format!("{}: {reason}", scene.id),
        })
    };
    if let Some(found) = other_unit(views) {
        let remedy = match found.reading {
            Reading::Times(factor) => format!("multiply --depth-prior-unit by about {factor:.3}"),
            Reading::Over(_) => "give distances, not their inverse".to_owned(),
        };
        return refuse(format!(
            "its distances do not fit its poses: views disagree at {:.0} % of the places that they share, and at {:.0} \
             % with the distances {} ({remedy})",
            100.0 * found.as_given,
            100.0 * found.otherwise,
            found.reading
        ));
    }
    let prior = scene.depth_priors.iter().flatten().next();
    if let Some(prior) = prior {
        let (said, other) = match prior.prior.convention {
            DistanceConvention::Ray => ("ray", DistanceConvention::Z),
            DistanceConvention::Z => ("z", DistanceConvention::Ray),
        };
        if let Some([as_given, otherwise]) = convention_disagreements(views, other)
            && as_given > CONVENTION_FACTOR * otherwise
            && differ(as_given)
        {
            return refuse(format!(
                "its distances are not along {said}: views differ by {:.1} %, and by {:.1} % where the \
                 other convention is meant (curate poses --depth-prior-convention)",
                100.0 * as_given,
                100.0 * otherwise
            ));
        }
    }
    match handedness_scores(views) {
        Some([straight, mirrored]) if mirrored > straight + MIRRORED_DECIBELS => {
            return refuse(format!(
                "its poses are of a mirrored world: colours of places that two views see agree to \
                 {straight:.1} dB, and to {mirrored:.1} dB with the images mirrored"
            ));
        }
        _ => {}
    }
    match mirrored_disagreements(views) {
        Some([as_given, mirrored])
            if as_given > MOST_APART && as_given > APART_FACTOR * mirrored =>
        {
            refuse(format!(
                "its distances are mirrored: views disagree on {:.1} % of what they show of each other, \
                 and on {:.1} % with every distance image mirrored",
                100.0 * as_given,
                100.0 * mirrored
            ))
        }
        _ => Ok(()),
    }
}

/// Returns the median relative difference between the distances of two views, all pairs together: of the
/// distances as they are, and of the same numbers read by another convention. Occlusions count in both. `None`
/// where no view sees the surfaces of another.
pub fn convention_disagreements(
    views: &[DistanceView<'_>],
    other: DistanceConvention,
) -> Option<[f64; 2]> {
    let as_given = disagreement(views)?;
    let otherwise = with_distances(views, |view| {
        read_as(view.distances.clone(), other, &view.view.camera)
    });
    Some([as_given, disagreement(&shown(views, &otherwise))?])
}

/// Returns the share of one view's places at which another one sees another distance: of the distances as they
/// are, and mirrored left to right. The second is smaller where distances were made from mirrored images. The
/// median is unsuitable: floors and ceilings are as far mirrored as not. `None` where no view sees the surfaces
/// of another.
pub fn mirrored_disagreements(views: &[DistanceView<'_>]) -> Option<[f64; 2]> {
    let as_given = share_apart(views)?;
    let mirrored = with_distances(views, |view| DistanceImage {
        values: mirror(&view.distances.values, view.distances.width),
        ..view.distances.clone()
    });
    Some([as_given, share_apart(&shown(views, &mirrored))?])
}

/// Returns distances along rays, of numbers that were read by the one convention and meant by the other.
fn read_as(
    mut distances: DistanceImage,
    meant: DistanceConvention,
    camera: &Camera,
) -> DistanceImage {
    if meant == DistanceConvention::Z {
        return distances.along_rays(DistanceConvention::Z, camera);
    }
    // z was divided by the share of the ray along the axis: what is 1 comes out as the inverse of it.
    let ones = DistanceImage {
        values: vec![1.0; distances.values.len()],
        ..distances.clone()
    };
    let factors = ones.along_rays(DistanceConvention::Z, camera);
    for (value, factor) in distances.values.iter_mut().zip(&factors.values) {
        *value /= factor;
    }
    distances
}

fn disagreement(views: &[DistanceView<'_>]) -> Option<f64> {
    median(&log_ratios(views))
}

fn share_apart(views: &[DistanceView<'_>]) -> Option<f64> {
    pairs::share_apart(&log_ratios(views))
}

/// Returns the differences of two views' distances at common places, as logarithms.
fn log_ratios(views: &[DistanceView<'_>]) -> Vec<f64> {
    let log_scales = vec![0.0; views.len()];
    let scaled = ScaledViews {
        views,
        log_scales: &log_scales,
    };
    let of_pair = |_, _, sightings: Vec<Sighting>| -> Vec<f64> {
        sightings.iter().map(|s| s.log_ratio.abs()).collect()
    };
    scaled.of_pairs(of_pair).concat()
}

/// Returns the PSNR in dB between the colours of places in two views, with images and distances as they are, and
/// with both mirrored left to right. The second is higher where the poses are of a mirrored world. `None` where
/// two views share too few places.
pub fn handedness_scores(views: &[DistanceView<'_>]) -> Option<[f64; 2]> {
    let straight = colour_score(views)?;
    let mirrored: Vec<MirroredView> = views
        .iter()
        .map(|view| {
            let width = view.distances.width;
            let distances = DistanceImage {
                values: mirror(&view.distances.values, width),
                ..view.distances.clone()
            };
            let masks = [view.mask, view.ignored].map(|mask| mask.map(|mask| mirror(mask, width)));
            let colours = view.pixels.as_chunks::<3>().0;
            (mirror(colours, width).into_flattened(), masks, distances)
        })
        .collect();
    let mirrored: Vec<DistanceView<'_>> = views
        .iter()
        .zip(&mirrored)
        .map(
            |(view, (pixels, [mask, ignored], distances))| DistanceView {
                view: view.view,
                pixels,
                mask: mask.as_deref(),
                ignored: ignored.as_deref(),
                distances,
                confidences: None,
            },
        )
        .collect();
    Some([straight, colour_score(&mirrored).unwrap_or(0.0)])
}

/// Colours, dynamic and ignored masks, and distances of a mirrored view.
type MirroredView = (Vec<u8>, [Option<Vec<u8>>; 2], DistanceImage);

fn mirror<T: Copy>(values: &[T], width: usize) -> Vec<T> {
    let rows = values.chunks_exact(width);
    rows.flat_map(|row| row.iter().rev().copied()).collect()
}

fn colour_score(views: &[DistanceView<'_>]) -> Option<f64> {
    let log_scales = vec![0.0; views.len()];
    let scaled = ScaledViews {
        views,
        log_scales: &log_scales,
    };
    let of_pair = |first: usize, second: usize, sightings: Vec<Sighting>| {
        let near = sightings.iter().filter(|s| s.log_ratio.abs() < ONE_SURFACE);
        near.fold((0_usize, 0.0), |(count, sum), sighting| {
            let [a, b] = [(first, sighting.pixels[0]), (second, sighting.pixels[1])]
                .map(|(view, pixel)| &views[view].pixels[3 * pixel..3 * pixel + 3]);
            let squares = a.iter().zip(b).map(|(&a, &b)| {
                let difference = (f64::from(a) - f64::from(b)) / 255.0;
                difference * difference
            });
            (count + 1, sum + squares.sum::<f64>() / 3.0)
        })
    };
    let (count, sum) = scaled
        .of_pairs(of_pair)
        .into_iter()
        .fold((0, 0.0), |(count, sum), (more, by)| {
            (count + more, sum + by)
        });
    (count >= LEAST_PLACES).then(|| -10.0 * (sum / count as f64).max(1e-10).log10())
}
