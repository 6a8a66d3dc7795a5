//! Misplaced copies: one image for all views, doubled pixels, frames of the data that are given and held out.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::{statistics::median, store};

use super::{
    images::reduced,
    kind::DiagnosisKind,
    look::{SMALL, ViewFacts},
};
use crate::metrics::ViewPair;

/// Least median difference of bytes between two ground truths with different content: a static camera sees most pixels
/// behind moving content again.
const OTHER_CONTENT: f32 = 4.0;
/// Largest difference of two frames of one image, of bytes in means of blocks: that of compression.
const SAME_CONTENT: f32 = 2.0;
/// Least share of novel frames that are nearly given ones for a finding.
const TELLING_SHARE: f64 = 0.25;
/// Least share of equal pairs in an image of doubled pixels, and the largest share of such pairs in the ground truth,
/// and of the pairs in between.
const DOUBLED: f64 = 0.99;
const LARGEST_SHARE_OF_EQUALS: f64 = 0.9;

/// Ground truth of a frame.
pub(super) struct Truth {
    /// At the larger of the reduced sizes.
    pub(super) medium: Vec<f32>,
    pub(super) look: Look,
}

/// Look of a frame, by which it is recognized.
pub(crate) struct Look {
    /// At the smaller of the reduced sizes.
    small: Vec<f32>,
    /// SHA-256 of its bytes.
    sha256: String,
}

impl Look {
    /// Reduces an 8-bit RGB image of `size` (width, height).
    pub(crate) fn of(bytes: &[u8], size: [usize; 2]) -> Self {
        Self {
            small: reduced(bytes, size, SMALL).1,
            sha256: store::sha256_bytes(bytes),
        }
    }
}

/// Ground truth of frames by their number.
pub(super) type Truths = BTreeMap<u32, Truth>;

/// Returns true if all views are one image although their ground truths differ in content.
pub(super) fn is_one_image(views: &[ViewFacts]) -> bool {
    let Some((first, others)) = views.split_first() else {
        return false;
    };
    let is_other_truth = |view: &ViewFacts| {
        let values = view.small.truth.iter().zip(&first.small.truth);
        let differences: Vec<f32> = values.map(|(a, b)| (a - b).abs()).collect();
        median(&differences).is_some_and(|difference| difference > OTHER_CONTENT)
    };
    let repeats = |view: &ViewFacts| view.sha256 == first.sha256 && is_other_truth(view);
    !others.is_empty() && others.iter().all(repeats)
}

/// Returns the given frames beside a frame: the last one before it and the first one behind it.
pub(super) fn given_beside(frame: u32, given: &[u32]) -> impl Iterator<Item = u32> {
    let before = given.iter().copied().filter(|&other| other < frame).max();
    let behind = given.iter().copied().filter(|&other| other > frame).min();
    before.into_iter().chain(behind)
}

/// Returns novel frames that are the same image as a given frame beside them; `None` if none can be compared.
pub(crate) fn repeated_frames<'a>(
    novel: &[u32],
    given: &[u32],
    look: impl Fn(u32) -> Option<&'a Look>,
) -> Option<DiagnosisKind> {
    let (mut identical, mut similar, mut frames) = (0, 0, 0);
    for &frame in novel {
        let Some(own) = look(frame) else {
            continue;
        };
        let beside: Vec<&Look> = given_beside(frame, given).filter_map(&look).collect();
        if beside.is_empty() {
            continue;
        }
        frames += 1;
        if beside.iter().any(|other| other.sha256 == own.sha256) {
            identical += 1;
        } else if beside.iter().any(|other| is_same(own, other)) {
            similar += 1;
        }
    }
    let tells = identical > 0 || similar as f64 >= TELLING_SHARE * frames.max(1) as f64;
    tells.then_some(DiagnosisKind::RepeatedFrames {
        identical,
        similar,
        frames,
    })
}

fn is_same(own: &Look, other: &Look) -> bool {
    let mut values = own.small.iter().zip(&other.small);
    values.all(|(a, b)| (a - b).abs() <= SAME_CONTENT)
}

/// Returns true if every pixel of the prediction is doubled in both directions, and those of the ground truth are not.
pub(super) fn is_doubled(pair: &ViewPair) -> bool {
    let size = pair.size();
    let of_prediction = |axis, first| equal_pairs(pair.prediction(), size, axis, first);
    let of_truth = |axis| equal_pairs(pair.truth(), size, axis, 0);
    [0, 1].into_iter().all(|axis| {
        of_prediction(axis, 0) >= DOUBLED
            && of_prediction(axis, 1) <= LARGEST_SHARE_OF_EQUALS
            && of_truth(axis) <= LARGEST_SHARE_OF_EQUALS
    })
}

/// Returns the share of equal pairs of pixels along an axis (0: in rows, 1: in columns), where every second pixel from
/// `first` starts a pair. 1 without pairs.
fn equal_pairs(bytes: &[u8], [width, height]: [usize; 2], axis: usize, first: usize) -> f64 {
    let pixels = bytes.as_chunks::<3>().0;
    let (step, [lines, length], stride) = match axis {
        0 => (1, [height, width], width),
        _ => (width, [width, height], 1),
    };
    let (mut equal, mut pairs) = (0_usize, 0_usize);
    for line in 0..lines {
        for place in (first..length.saturating_sub(1)).step_by(2) {
            let pixel = line * stride + place * step;
            equal += usize::from(pixels[pixel] == pixels[pixel + step]);
            pairs += 1;
        }
    }
    if pairs == 0 {
        1.0
    } else {
        equal as f64 / pairs as f64
    }
}

/// Returns the first number, 0 or 1, if stray files are numbered by the index of a view in `frames`. `strays` are names
/// of files that belong to no view.
pub(super) fn named_by_place(strays: &[String], frames: &[u32]) -> Option<u32> {
    let number = |name: &String| name.rsplit_once('.')?.0.parse::<u32>().ok();
    let mut numbers: BTreeSet<u32> = strays.iter().filter_map(number).collect();
    numbers.retain(|number| !frames.contains(number));
    let count = u32::try_from(frames.len()).ok()?;
    [0, 1].into_iter().find(|&first| {
        let mut places: BTreeSet<u32> = (first..first + count).collect();
        places.retain(|place| !frames.contains(place));
        !numbers.is_empty() && places == numbers
    })
}
