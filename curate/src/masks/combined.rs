//! Masks by two kinds of evidence: regions of a segmentation network that have changed against a still scene.
//!
//! Alone, the network also marks what is parked, and bushes and machines that it takes for animals and vehicles. Alone,
//! motion that the camera's own does not explain also marks leaves, reflections and shadows, and no outlines. A region
//! of the network counts if a share of it has changed. Moving content outside the network's classes
//! is not marked. Only views that show a change are given to the network, which takes most of the time.

use std::path::Path;

use omnilife_schemas::{
    RgbImage, camera::ErpCamera, progress::Progress, records::Sequence, rgb::Mask,
};

use super::{
    FrameMasks, MaskMethod,
    changes::{Changes, ComparableFrame},
    deeplab::{self, Likelihoods, Views, network::Network},
    plane::Plane,
    vote,
};
use crate::{error::CurateError, motion::GreySphere};

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "combined",
    about: "people, animals and vehicles that move: regions of deeplab that motion confirms",
    settings,
    find,
};

/// Probability of all kinds of movable content together from which on a pixel belongs to a region. Lower than where the
/// network stands alone, because motion decides on regions.
const LEAST_PROBABILITY: f32 = 0.3;
/// Least share of a region that has changed. On the labelled animals any value from 0.1 to 0.35 gives the same masks.
const LEAST_CHANGED: f64 = 0.25;
/// Regions of fewer pixels are left out.
const LEAST_PIXELS: usize = 6;
/// Least area of changes in a view that the network looks at, steradians.
const LEAST_STERADIANS: f64 = 2e-3;
/// The same in a perspective frame, as a share of it.
const LEAST_FRAME_SHARE: f64 = 1e-3;

fn settings() -> String {
    format!(
        "regions of deeplab from probability {LEAST_PROBABILITY} of which {LEAST_CHANGED} changed; {}",
        (deeplab::METHOD.settings)()
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
    let network = Network::load(&deeplab::published_weights()?)?;
    match sequence.is_pinhole() {
        true => find_in(
            folder,
            sequence,
            &network,
            Changes::<Plane>::new(folder, sequence),
            progress,
        ),
        false => find_in(
            folder,
            sequence,
            &network,
            Changes::<GreySphere>::new(folder, sequence),
            progress,
        ),
    }
}

fn find_in<I: ComparableFrame>(
    folder: &Path,
    sequence: &Sequence,
    network: &Network,
    mut changes: Changes<'_, I>,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    let frames = &sequence.frames;
    let size = [frames.width as usize, frames.height as usize];
    let views = Views::of(sequence);
    progress.begin("segmenting what moves", Some(frames.entries.len() as u64));
    let masks = frames.entries.iter().enumerate().map(|(index, entry)| {
        let changed = changes.of_frame(index)?;
        let frame = views.read(&folder.join(&entry.file))?;
        let masks = confirmed((network, &views), &frame, &changed, sequence.is_pinhole());
        progress.advance(1);
        Ok(resized(masks, size))
    });
    let masks = masks.collect();
    progress.end();
    masks
}

/// Returns the regions of the network in a frame that changes confirm, at the size of the changes.
fn confirmed(
    (network, views): (&Network, &Views),
    frame: &RgbImage,
    changed: &Mask,
    is_perspective: bool,
) -> FrameMasks {
    let size = [changed.width, changed.height];
    let area = area(size, is_perspective);
    let least = if is_perspective {
        LEAST_FRAME_SHARE
    } else {
        LEAST_STERADIANS
    };
    let chosen = views.showing(changed, least, &area);
    let likelihoods = views.likelihoods(&chosen, network, frame, size);
    vote_on(&likelihoods, changed, is_perspective, &area)
}

/// Returns the area of a pixel by its row: steradians, or the share of a perspective frame.
pub(super) fn area([width, height]: [usize; 2], is_perspective: bool) -> impl Fn(usize) -> f64 {
    let camera = ErpCamera::new(width as u32, height as u32);
    move |row| match is_perspective {
        true => 1.0 / (width * height) as f64,
        false => camera.pixel_solid_angle(row as u32),
    }
}

/// Keeps the likely regions of which a share has changed; a region belongs to the kind that is likeliest over all of it.
fn vote_on(
    likelihoods: &Likelihoods,
    changed: &Mask,
    is_perspective: bool,
    area: &impl Fn(usize) -> f64,
) -> FrameMasks {
    let of_kinds = &likelihoods.of_kinds;
    let likely = of_kinds
        .iter()
        .map(|values| values.iter().sum::<f32>() >= LEAST_PROBABILITY);
    let likely: Vec<bool> = likely.collect();
    let mut kinds = vec![None; of_kinds.len()];
    for region in vote::regions(&likely, likelihoods.width, !is_perspective) {
        let share = vote::confirmed_share(&region, &changed.data, likelihoods.width, area);
        if region.len() < LEAST_PIXELS || share < LEAST_CHANGED {
            continue;
        }
        let mut sums = [0.0; deeplab::KINDS];
        for &pixel in &region {
            for (sum, value) in sums.iter_mut().zip(of_kinds[pixel]) {
                *sum += value;
            }
        }
        let kind = deeplab::likeliest(&sums);
        for pixel in region {
            kinds[pixel] = Some(kind);
        }
    }
    likelihoods.masks_of(&kinds)
}

fn resized(masks: FrameMasks, [width, height]: [usize; 2]) -> FrameMasks {
    let resized = |mask: &Mask| mask.resized_to_nearest(width, height);
    let classes = masks.classes.iter();
    FrameMasks {
        moving: resized(&masks.moving),
        classes: classes
            .map(|(&class, mask)| (class, resized(mask)))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 32;

    /// Marks rows 12 to 19 between two columns, across the seam if the first is the larger.
    fn is_in(pixel: usize, [left, right]: [usize; 2]) -> bool {
        let (x, y) = (pixel % WIDTH, pixel / WIDTH);
        let in_columns = match left <= right {
            true => (left..right).contains(&x),
            false => x >= left || x < right,
        };
        in_columns && (12..20).contains(&y)
    }

    #[test]
    fn regions_that_have_not_moved_are_left_out() {
        // A person across the seam, of which a half has changed, and a parked car.
        let values = |pixel| {
            if is_in(pixel, [60, 4]) {
                [0.4, 0.1, 0.0]
            } else if is_in(pixel, [30, 40]) {
                [0.0, 0.9, 0.0]
            } else {
                [0.05, 0.0, 0.0]
            }
        };
        let likelihoods = Likelihoods {
            width: WIDTH,
            height: HEIGHT,
            of_kinds: (0..WIDTH * HEIGHT).map(values).collect(),
        };
        let changed = |pixel| is_in(pixel, [0, 8]) || is_in(pixel, [39, 42]);
        let changed = Mask {
            width: WIDTH,
            height: HEIGHT,
            data: (0..WIDTH * HEIGHT)
                .map(|pixel| 255 * u8::from(changed(pixel)))
                .collect(),
        };
        let area = area([WIDTH, HEIGHT], false);
        let masks = vote_on(&likelihoods, &changed, false, &area);
        for pixel in 0..WIDTH * HEIGHT {
            let expected = 255 * u8::from(is_in(pixel, [60, 4]));
            assert_eq!(masks.moving.data[pixel], expected, "{pixel}");
            assert_eq!(masks.classes["person"].data[pixel], expected);
        }
        assert!(!masks.classes["vehicle"].marks_anything());
        // The edge of a perspective frame ends a region: the half that has not changed is left out.
        let flat = vote_on(&likelihoods, &changed, true, &|_| 1.0);
        assert_eq!(flat.moving.data[15 * WIDTH + 2], 255);
        assert_eq!(flat.moving.data[15 * WIDTH + 62], 0);
    }
}
