//! Checks of the meaning of distances, by the agreement of views on places and colours.

use omnilife_schemas::{
    camera::Camera, distances::DistanceImage, records::DistanceConvention, statistics::median,
};

use super::{
    lift::DistanceView,
    pairs::{ScaledViews, Sighting},
};

/// Maximum difference of two views' values at one surface.
const ONE_SURFACE: f64 = 0.1;
/// Minimum number of places for comparing colours.
const LEAST_PLACES: usize = 500;

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

fn with_distances(
    views: &[DistanceView<'_>],
    other: impl Fn(&DistanceView<'_>) -> DistanceImage,
) -> Vec<DistanceImage> {
    views.iter().map(other).collect()
}

/// Returns views with other distances.
fn shown<'a>(views: &[DistanceView<'a>], distances: &'a [DistanceImage]) -> Vec<DistanceView<'a>> {
    let views = views.iter().zip(distances);
    views
        .map(|(view, distances)| DistanceView { distances, ..*view })
        .collect()
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
    let all = log_ratios(views);
    let apart = all.iter().filter(|&&ratio| ratio > ONE_SURFACE).count();
    (all.len() >= LEAST_PLACES).then(|| apart as f64 / all.len() as f64)
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
