//! Whether the camera's exposure changes: gains of whole views, and whether they hold everywhere in them.
//!
//! A gain is one for the whole image, so it is taken from all of it. At scene points alone, which lie where there
//! is texture and mostly near, other things look like one: under water what is near is brighter than what is
//! far, and gains of 13 % that were found there explained nothing of whole images and cost 0.9 dB
//! (docs/results/evidence.md). And the parts of an image are asked one by one: where lamps pass by, or the sun
//! comes into view, they do not agree.

use std::fmt;

use omnilife_engine::model::exposure::Exposure;
use serde::Serialize;

use crate::evidence::rendered_view::{Block, SECTORS};

/// Standard deviation of the gains from which they are worth compensating: below it errors of other
/// kinds are larger.
const LEAST_DRIFT: f64 = 0.02;
/// Agreement of the parts of the images below which no gain holds for all of them. Parts of an image are small
/// and what a short fit leaves unexplained in them is not: where exposure really changes they agree by 0.4 and
/// more, but for dark night clips; elsewhere by 0.3 at most, but for one clip under water, where gains do neither
/// good nor harm (docs/results/evidence.md).
const LEAST_AGREEMENT: f64 = 0.35;

/// A view: when it was taken, seconds, and its blocks.
pub(super) type ViewBlocks = (f64, Vec<Block>);

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExposureEvidence {
    /// The gains.
    pub gains: Exposure,
    /// Covariance of the logarithms of the gains that two parts of the images give, over their variance: 1 where
    /// all parts change alike.
    pub agreement: f64,
}

impl ExposureEvidence {
    /// From the blocks of views. `None` where too little of them can be compared.
    pub(super) fn of(views: &[ViewBlocks]) -> Option<Self> {
        let of_sectors: Vec<Exposure> = (0..SECTORS)
            .filter_map(|sector| gains_of(views, |block| block.sector == sector))
            .collect();
        Some(Self {
            gains: gains_of(views, |_| true)?,
            agreement: agreement(&of_sectors, views.iter().map(|(seconds, _)| *seconds)),
        })
    }

    /// The same decision with gains of more views.
    pub(super) fn with_gains_of(self, views: &[ViewBlocks]) -> Self {
        Self {
            gains: gains_of(views, |_| true).unwrap_or(self.gains),
            ..self
        }
    }

    /// Whether the gains are worth compensating.
    pub fn is_worth_compensating(&self) -> bool {
        self.gains.drift() >= LEAST_DRIFT && self.agreement >= LEAST_AGREEMENT
    }
}

impl fmt::Display for ExposureEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "gains of {} views deviate by {:.2} % (limit {:.0} %), those of the eighths of an image agree by \
             {:.2} (limit {LEAST_AGREEMENT})",
            self.gains.views(),
            100.0 * self.gains.drift(),
            100.0 * LEAST_DRIFT,
            self.agreement
        )
    }
}

/// Gains from some of the blocks of each view.
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

/// Mean product of the logarithms of two parts' gains over the mean square of one's; 0 where there are no two.
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

    /// Views of 400 blocks whose levels are those of the render times `gain(view, block)`.
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
        // Each part at times of its own, as where lamps pass by.
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
