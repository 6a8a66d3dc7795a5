//! Small images of chosen frames.

use std::collections::{BTreeMap, BTreeSet};

use super::Image;
use crate::ledger::Candidate;

/// Width of an image, pixels.
pub(super) const WIDTH_PIXELS: u32 = 192;
/// JPEG quality, 1 to 100.
pub(super) const QUALITY: u8 = 70;
/// Frames before and after a boundary.
const AROUND: usize = 4;
/// Most frames inside a boundary.
const INSIDE: usize = 8;
/// Most frames of the overview.
const OVERVIEW: usize = 48;

/// Frames of the strips and of the overview.
pub(super) struct Filmstrips {
    strips: Vec<Vec<usize>>,
    overview: Vec<usize>,
}

impl Filmstrips {
    pub(super) fn plan(times: &[f64], candidates: &[Candidate]) -> Self {
        let last = times.len().saturating_sub(1);
        let nearest = |seconds: f64| {
            times
                .partition_point(|&time| time < seconds - 1e-6)
                .min(last)
        };
        let strips = candidates
            .iter()
            .map(|candidate| {
                let begin = nearest(candidate.boundary.begin_seconds);
                let end = nearest(candidate.boundary.end_seconds).max(begin);
                let mut strip: Vec<usize> = (begin.saturating_sub(AROUND)..=begin).collect();
                strip.extend(spread(begin, end, INSIDE + 1));
                strip.extend(end..=(end + AROUND).min(last));
                strip.dedup();
                strip
            })
            .collect();
        Self {
            strips,
            overview: spread(0, last, OVERVIEW).collect(),
        }
    }

    /// Returns all frames that are shown, in order.
    /// Returns the images of the strips and of the overview.
    pub(super) fn frames(&self) -> BTreeSet<usize> {
        let strips = self.strips.iter().flatten();
        strips.chain(&self.overview).copied().collect()
    }

    /// Returns the images of the strips and of the overview.
    ///
    /// # Errors
    /// The index of a shown frame without an image.
    pub(super) fn filled(
        &self,
        images: &BTreeMap<usize, Image>,
    ) -> Result<(Vec<Vec<Image>>, Vec<Image>), usize> {
        let fill = |frames: &[usize]| -> Result<Vec<Image>, usize> {
            let image = |frame: &usize| images.get(frame).cloned().ok_or(*frame);
            frames.iter().map(image).collect()
        };
        let strips = self.strips.iter().map(|strip| fill(strip));
        Ok((strips.collect::<Result<_, _>>()?, fill(&self.overview)?))
    }
}

/// Returns at most `count` evenly spaced numbers from `first` to `last`, both included.
fn spread(first: usize, last: usize, count: usize) -> impl Iterator<Item = usize> {
    let steps = (last - first).min(count.saturating_sub(1));
    (0..=steps).map(move |step| first + (last - first) * step / steps.max(1))
}
