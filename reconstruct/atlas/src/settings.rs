//! Settings of Neural Atlas Graphs, as written to a run's record.

use omnilife_engine::{
    fields::{
        grid_field::GridFieldShape,
        hash_grid::{HashGrid, HashGridShape},
    },
    parameters::decay::Decay,
    schedule::Position,
};
use serde::{Deserialize, Serialize};

use super::{
    node::FieldKind,
    published::{EPOCHS, MASK_WEIGHT, Plateau, PublishedParts},
    shade::Detail,
    step::StepRates,
};

/// Every setting as resolved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Rays of a step.
    pub rays: usize,
    /// Maximum sizes of colour and opacity fields; the extent of a node may lower them.
    pub base_fields: FieldSize,
    /// Maximum sizes of flow and view fields.
    pub motion_fields: FieldSize,
    /// Step sizes of hash tables.
    pub table_rate: Decay,
    /// Step sizes of networks.
    pub network_rate: Decay,
    /// Step sizes of trajectories: radians, and shares of a node's distance.
    pub pose_rate: Decay,
    /// Weight of the mask loss; 0 leaves it out.
    pub mask_weight: f64,
    /// Parts that follow the published code. Its schedule replaces the three rates above.
    pub published: PublishedParts,
    /// True if flow and view fields start coarse.
    pub coarse_to_fine: bool,
    /// Shares of the run at which colour and opacity start beside the poses, and at which flow and view start.
    pub phases: [f64; 2],
    /// Seed.
    pub seed: u64,
}

/// Sizes of a field (Neural Atlas Graphs `config/encoding_config.py`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FieldSize {
    /// The published size.
    Large,
    /// 12 levels of 2^15.
    Medium,
    /// 8 levels of 2^13.
    Small,
    /// 6 levels of 2^12.
    Tiny,
}

impl FieldSize {
    /// Returns the size of this name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "large" => Some(Self::Large),
            "medium" => Some(Self::Medium),
            "small" => Some(Self::Small),
            "tiny" => Some(Self::Tiny),
            _ => None,
        }
    }

    /// Returns levels, binary logarithm of their entries, number of hidden layers of the network, their width.
    fn sizes(self) -> (usize, u32, usize, usize) {
        match self {
            Self::Large => (16, 17, 5, 64),
            Self::Medium => (12, 15, 4, 64),
            Self::Small => (8, 13, 3, 64),
            Self::Tiny => (6, 12, 3, 32),
        }
    }

    /// Returns a field over a surface with so many texels along its longer side and in all. No level is finer
    /// than the texels, and no table is larger than their number requires.
    pub fn shape(self, dimensions: usize, outputs: usize, longer: f64, all: f64) -> GridFieldShape {
        let (levels, log2_entries, hidden_layers, width) = self.sizes();
        let needed = all.max(1.0).log2().ceil().max(8.0) as u32;
        GridFieldShape {
            grid: HashGridShape::new(
                dimensions,
                HashGrid::levels_for(longer, levels),
                log2_entries.min(needed),
            ),
            hidden_layers,
            width,
            outputs,
        }
    }
}

impl Settings {
    /// Returns the defaults on a CPU: medium fields for colour and opacity, small ones for flow and view. The
    /// phases have their published shares (5, 15 and 60 of 80 epochs).
    pub fn new(seed: u64) -> Self {
        Self {
            rays: 1 << 14,
            base_fields: FieldSize::Medium,
            motion_fields: FieldSize::Small,
            table_rate: Decay {
                begin: 1e-2,
                end: 1e-3,
            },
            network_rate: Decay {
                begin: 2e-3,
                end: 2e-4,
            },
            pose_rate: Decay {
                begin: 1e-3,
                end: 1e-4,
            },
            mask_weight: 10.0 * MASK_WEIGHT,
            published: PublishedParts::default(),
            coarse_to_fine: true,
            phases: [5.0 / EPOCHS, 20.0 / EPOCHS],
            seed,
        }
    }

    /// Returns the trained fields at a position of the run.
    pub fn detail(&self, at: &Position) -> Detail {
        let [colour, motion] = self.phases.map(|begin| at.share >= begin);
        let mut kinds = [false; 4];
        kinds[FieldKind::Colour.number()] = colour;
        kinds[FieldKind::Opacity.number()] = colour;
        kinds[FieldKind::Flow.number()] = motion;
        kinds[FieldKind::View.number()] = motion;
        Detail {
            kinds,
            active_share: if self.coarse_to_fine {
                active_share(EPOCHS * at.share)
            } else {
                1.0
            },
        }
    }

    /// Returns the step sizes at a position of the run.
    pub fn rates(&self, at: &Position, plateau: &Plateau) -> StepRates {
        let share = at.share as f32;
        let [poses, tables, networks] = if self.published.schedule {
            [plateau.step_size(); 3]
        } else {
            [self.pose_rate, self.table_rate, self.network_rate].map(|rate| rate.at(share))
        };
        StepRates {
            poses,
            tables,
            networks,
            mask_weight: self.mask_weight,
            rescales_gradients: self.published.gradients,
        }
    }
}

/// Returns the share of the features of flow and view that is used at an epoch (supplement eq. 5, 6, with the
/// bound and the 0.4 of `callbacks/nag_callback.py`).
fn active_share(epoch: f64) -> f64 {
    let turn = (epoch / 64.0).min(1.0) * std::f64::consts::FRAC_PI_2;
    0.4 + 0.6 * (0.05 + turn.sin()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_join_as_published() {
        let active = |epoch: f64| (64.0 * active_share(epoch) - 1e-9).ceil();
        for (epoch, expected) in [
            (0.0, 28.0),
            (5.0, 33.0),
            (10.0, 37.0),
            (20.0, 46.0),
            (30.0, 54.0),
            (40.0, 60.0),
            (48.0, 63.0),
            (50.0, 64.0),
            (79.0, 64.0),
        ] {
            assert_eq!(active(epoch), expected, "{epoch}");
        }
    }

    #[test]
    fn fields_are_no_finer_than_what_they_lie_on() {
        let shape = FieldSize::Medium.shape(2, 3, 30.0, 600.0);
        assert_eq!((shape.grid.levels, shape.grid.log2_entries), (5, 10));
        let shape = FieldSize::Medium.shape(2, 3, 1e5, 1e9);
        assert_eq!((shape.grid.levels, shape.grid.log2_entries), (12, 15));
    }
}
