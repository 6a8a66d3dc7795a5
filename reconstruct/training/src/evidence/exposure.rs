//! Changes of the camera's exposure: gains of whole views, and their agreement within a view.
//!
//! A gain holds for the whole image, so it is measured on all of it. Scene points alone lie on textures and
//! mostly near the camera, where other effects look like a gain. Under water near surfaces are brighter than far
//! ones: gains of 13 % from points explained nothing of whole images and cost 0.9 dB (docs/results/evidence.md).
//! Parts of an image are measured separately: they disagree where lamps pass by, or the sun comes into view.

use std::fmt;

use omnilife_engine::model::exposure::Exposure;
use serde::Serialize;

use crate::evidence::rendered_view::{Block, SECTORS};

/// Minimum standard deviation of the gains of light for compensation: below it errors of other kinds are larger. It is
/// 2 % of the levels in the middle of the scale.
const LEAST_DRIFT: f64 = 0.043;
/// Minimum agreement of the parts of the images for a gain that holds for all of them. Parts of an image are
/// small, but the residuals of a short fit in them are large. Under real changes of exposure they agree by 0.4
/// and more, except in dark night clips. Elsewhere they agree by 0.3 at most, except in one clip under water,
/// where gains have no effect (docs/results/evidence.md).
const LEAST_AGREEMENT: f64 = 0.35;

/// A view: its time, seconds, and its blocks.
pub(super) type ViewBlocks = (f64, Vec<Block>);

/// Evidence of exposure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExposureEvidence {
    /// The gains.
    pub gains: Exposure,
    /// Covariance of the logarithms of the gains from two parts of the images, over their variance: 1 where all
    /// parts change alike.
    pub agreement: f64,
}

impl ExposureEvidence {
    /// Measures the evidence on the blocks of views. `None` where too few of them can be compared.
    pub(super) fn of(views: &[ViewBlocks]) -> Option<Self> {
        let of_sectors: Vec<Exposure> = (0..SECTORS)
            .filter_map(|sector| gains_of(views, |block| block.sector == sector))
            .collect();
        Some(Self {
            gains: gains_of(views, |_| true)?,
            agreement: agreement(&of_sectors, views.iter().map(|(seconds, _)| *seconds)),
        })
    }

    /// Returns the same decision with gains of more views.
    pub(super) fn with_gains_of(self, views: &[ViewBlocks]) -> Self {
        Self {
            gains: gains_of(views, |_| true).unwrap_or(self.gains),
            ..self
        }
    }

    /// Returns true if the gains are worth compensating.
    pub fn is_worth_compensating(&self) -> bool {
        self.gains.drift() >= LEAST_DRIFT && self.agreement >= LEAST_AGREEMENT
    }
}

impl fmt::Display for ExposureEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "gains of {} views deviate by {:.2} % in linear light (limit {:.1} %), those of the eighths of an image agree by \
             {:.2} (limit {LEAST_AGREEMENT})",
            self.gains.views(),
            100.0 * self.gains.drift(),
            100.0 * LEAST_DRIFT,
            self.agreement
        )
    }
}

/// Returns gains from some of the blocks of each view.
fn gains_of(views: &[ViewBlocks], is_used: impl Fn(&Block) -> bool) -> Option<Exposure> {
    let pairs = |blocks: &[Block]| {
        let used = blocks.iter().filter(|block| is_used(block));
        used.map(|block| [block.shown, block.rendered]).collect()
    };
    let views: Vec<_> = views
        .iter()
        .map(|(seconds, blocks)| (*seconds, pairs(blocks)))
        .collect();
    Exposure::estimate(&views)
}

/// Returns the mean product of the logarithms of two parts' gains over the mean square of one's; 0 for fewer than
/// two views.
fn agreement(parts: &[Exposure], times: impl Iterator<Item = f64>) -> f64 {
    let (mut products, mut squares) = (0.0, 0.0);
    for seconds in times {
        let of_parts = parts.iter().map(|part| part.gain(seconds));
        let logarithms: Vec<[f64; 3]> = of_parts
            .map(|gain| gain.map(|gain| f64::from(gain).ln()))
            .collect();
        for channel in 0..3 {
            let of_channel = logarithms.iter().map(|part| part[channel]);
            let sum: f64 = of_channel.clone().sum();
            let square: f64 = of_channel.map(|log| log * log).sum();
            products += sum * sum - square;
            squares += square;
        }
    }
    let others = parts.len().saturating_sub(1) as f64;
    if others > 0.0 && squares > 0.0 {
        products / (others * squares)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns views of 400 blocks whose light is that of the render times `gain(view, block)`.
    fn views(gain: impl Fn(usize, usize) -> f32) -> Vec<ViewBlocks> {
        let block = |view: usize, block: usize| {
            let level = 0.2 + 0.001 * block as f32;
            let error = 0.02 * ((block * 37 + view * 11) % 101) as f32 / 100.0 - 0.01;
            Block {
                sector: block % SECTORS,
                shown: [(level + error) * gain(view, block); 3],
                rendered: [level; 3],
            }
        };
        (0..12)
            .map(|view| (view as f64, (0..400).map(|at| block(view, at)).collect()))
            .collect()
    }

    #[test]
    fn a_gain_of_whole_views_is_worth_compensating() -> Result<(), &'static str> {
        let drifting = views(|view, _| 1.0 + 0.1 * (view as f32).sin());
        let found = ExposureEvidence::of(&drifting).ok_or("nothing found")?;
        assert!(found.is_worth_compensating(), "{found}");
        assert!(found.agreement > 0.9, "{found}");
        let fixed = ExposureEvidence::of(&views(|_, _| 1.0)).ok_or("nothing found")?;
        assert!(!fixed.is_worth_compensating(), "{fixed}");
        Ok(())
    }

    #[test]
    fn what_changes_in_a_part_of_each_view_is_no_exposure() -> Result<(), &'static str> {
        // Each part at times of its own, as under passing lamps.
        let lamps = views(|view, block| {
            let phase = 2.4 * (block % SECTORS) as f32;
            1.0 + 0.2 * (view as f32 + phase).sin()
        });
        let found = ExposureEvidence::of(&lamps).ok_or("nothing found")?;
        assert!(!found.is_worth_compensating(), "{found}");
        Ok(())
    }

    #[test]
    fn views_without_blocks_say_nothing() {
        assert_eq!(ExposureEvidence::of(&[(0.0, Vec::new())]), None);
        assert_eq!(ExposureEvidence::of(&[]), None);
    }
}
