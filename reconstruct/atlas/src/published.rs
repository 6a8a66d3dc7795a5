//! Deviations of the published code from this implementation, on request.
//!
//! * Its mask loss: weight 0.005, and pixels that another object covers count as not covered
//!   (`loss/l1_mask_loss.py`).
//! * Its gradients by planes (`model/hooks.py`, not in the paper): [`scales_of_gradients`].
//! * Its schedule: one step size for everything, halved on plateaus of the loss ([`Plateau`]).

use serde::{Deserialize, Serialize};

use super::{graph::Graph, render::RenderedRays};

/// Epochs of the published schedule; an epoch is the same share of a run here, whatever the run's length.
pub const EPOCHS: f64 = 80.0;
/// Weight of the mask loss in all published configurations.
pub const MASK_WEIGHT: f64 = 0.005;
/// Step size of all trained parameters, before the first plateau.
pub const STEP_SIZE: f32 = 1e-3;

/// Transmittances below this one divide nothing (`model/hooks.py`).
const LEAST_TRANSMITTANCE: f64 = 1e-6;
/// Maximum factor of a division by a transmittance. The published code has no maximum: a layer that is nearly
/// hidden has gradients a million times their size there.
const MOST_BY_TRANSMITTANCE: f64 = 1e3;

/// Parts that follow the published code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PublishedParts {
    /// The mask loss.
    pub mask_loss: bool,
    /// Gradients by planes.
    pub gradients: bool,
    /// The schedule of step sizes.
    pub schedule: bool,
}

/// Returns the factors of the gradients by poses through distances of hits, node by node, sample by sample.
///
/// At every moment an object that few rays hit gets as large a gradient as one that many hit. Each is scaled by
/// one over its hits, relative to the mean of that over the objects that are hit. While poses are trained alone,
/// gradients are divided by the transmittance before the layer.
pub fn scales_of_gradients(graph: &Graph, seen: &RenderedRays, poses_alone: bool) -> Vec<Vec<f64>> {
    let moments = seen.poses.first().map_or(0, Vec::len);
    let is_object = |node: usize| graph.nodes[node].opacity.is_some();
    let mut by_hits = vec![vec![0.0; moments]; graph.nodes.len()];
    for (node, hits) in by_hits.iter_mut().enumerate() {
        for sample in &seen.samples[node] {
            hits[sample.moment] += 1.0;
        }
    }
    for moment in 0..moments {
        let shares: Vec<f64> = (0..graph.nodes.len())
            .filter(|&node| is_object(node) && by_hits[node][moment] > 0.0)
            .map(|node| 1.0 / by_hits[node][moment])
            .collect();
        let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        for (node, hits) in by_hits.iter_mut().enumerate() {
            let is_scaled = is_object(node) && hits[moment] > 0.0;
            hits[moment] = if is_scaled {
                1.0 / (hits[moment] * mean)
            } else {
                1.0
            };
        }
    }
    let mut scales: Vec<Vec<f64>> = seen
        .samples
        .iter()
        .zip(&by_hits)
        .map(|(samples, scales)| samples.iter().map(|s| scales[s.moment]).collect())
        .collect();
    if poses_alone {
        for ray in 0..seen.links.len() {
            let (layers, links) = seen.layers(ray);
            let mut transmittance = 1.0;
            for (layer, (node, sample)) in layers.iter().zip(links) {
                scales[node][sample] *= by_transmittance(transmittance);
                transmittance *= 1.0 - layer.opacity;
            }
        }
    }
    scales
}

fn by_transmittance(transmittance: f64) -> f64 {
    if transmittance < LEAST_TRANSMITTANCE {
        1.0
    } else {
        (1.0 / transmittance).min(MOST_BY_TRANSMITTANCE)
    }
}

/// Halves step sizes after epochs without a smaller loss: `ReduceLROnPlateau` of `PyTorch` with the published
/// settings, from epoch 20 on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plateau {
    /// Factor of the step sizes.
    factor: f32,
    /// The smallest loss of an epoch.
    best: Option<f64>,
    /// Epochs without a smaller one.
    bad_epochs: u32,
    /// Epochs that count as good, after a halving.
    cooldown: u32,
    /// The epoch whose losses are summed, with their sum and number.
    epoch: u32,
    sum: f64,
    steps: u64,
}

impl Default for Plateau {
    fn default() -> Self {
        Self {
            factor: 1.0,
            best: None,
            bad_epochs: 0,
            cooldown: 0,
            epoch: 0,
            sum: 0.0,
            steps: 0,
        }
    }
}

impl Plateau {
    const FIRST_EPOCH: u32 = 20;
    const PATIENCE: u32 = 4;
    const COOLDOWN: u32 = 4;
    /// Minimum relative decrease of a smaller loss.
    const THRESHOLD: f64 = 0.01;

    /// Returns the current step size.
    pub fn step_size(&self) -> f32 {
        self.factor * STEP_SIZE
    }

    /// Adds the loss of a step at a share of the run.
    pub fn add(&mut self, share: f64, loss: f64) {
        let epoch = (EPOCHS * share) as u32;
        if epoch > self.epoch {
            if self.epoch >= Self::FIRST_EPOCH && self.steps > 0 {
                self.end_epoch(self.sum / self.steps as f64);
            }
            (self.epoch, self.sum, self.steps) = (epoch, 0.0, 0);
        }
        self.sum += loss;
        self.steps += 1;
    }

    fn end_epoch(&mut self, loss: f64) {
        let is_better = self
            .best
            .is_none_or(|best| loss < best * (1.0 - Self::THRESHOLD));
        if is_better {
            self.best = Some(loss);
            self.bad_epochs = 0;
        } else {
            self.bad_epochs += 1;
        }
        if self.cooldown > 0 {
            self.cooldown -= 1;
            self.bad_epochs = 0;
        }
        if self.bad_epochs > Self::PATIENCE {
            self.factor *= 0.5;
            self.cooldown = Self::COOLDOWN;
            self.bad_epochs = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Follows `torch.optim.lr_scheduler.ReduceLROnPlateau(factor=0.5, patience=4, threshold=0.01, cooldown=4)`:
    /// the fifth bad epoch halves, then four are not counted.
    #[test]
    fn a_plateau_halves_step_sizes_after_patience_and_cooldown() {
        let mut plateau = Plateau::default();
        let mut halved_after = Vec::new();
        for epoch in 0..80 {
            let before = plateau.step_size();
            // Falls until epoch 30, then stays.
            let loss = if epoch < 30 {
                1.0 - 0.03 * f64::from(epoch)
            } else {
                0.1
            };
            for step in 0..3 {
                plateau.add((f64::from(epoch) + f64::from(step) / 3.0) / EPOCHS, loss);
            }
            if plateau.step_size() < before {
                halved_after.push(epoch - 1);
            }
        }
        // The loss of epoch 30 is the last that is smaller: 31 to 35 are bad. Of the nine epochs that
        // follow a halving four are not counted.
        assert_eq!(halved_after, [35, 44, 53, 62, 71]);
        assert_eq!(plateau.step_size(), STEP_SIZE / 32.0);
    }

    #[test]
    fn what_a_transmittance_divides_by_is_bounded() {
        assert_eq!(by_transmittance(0.5), 2.0);
        assert_eq!(by_transmittance(1e-5), 1e3);
        assert_eq!(by_transmittance(1e-7), 1.0);
        assert_eq!(by_transmittance(0.0), 1.0);
    }
}
