//! One step: rays of a batch, their loss, its gradients, Adam.
//!
//! ```text
//! L = mean |C - C_image| + weight mean |alpha_o - M_o|
//! ```
//!
//! over rays, and over rays and objects (Neural Atlas Graphs, supplement A.3). `alpha_o` is a plane's own opacity
//! at the hit, 0 where it is missed. `M_o` is the visible mask. Rays that another object's mask covers are left
//! out (the published code counts them: [`super::published`]).

use glam::{DMat3, DVec3};
use omnilife_engine::{
    parameters::adam,
    surfaces::{
        compose::{LayerGradient, compose, compose_vjp},
        plane::{PlaneGradient, RayGradient, outer},
    },
    trajectories::rigid_spline::{PoseGradient, RigidPose},
};
use rayon::prelude::*;

use super::{
    graph::Graph,
    node::{FieldKind, LearntOffsets},
    published,
    render::{Rays, RenderedRays},
    shade::{Detail, ShadeGradient},
};

/// Targets of a batch's rays.
#[derive(Debug, Default)]
pub struct Targets {
    /// Colours, [0, 1].
    pub colours: Vec<DVec3>,
    /// The share of each ray that an object covers, ray by ray and object by object; `None` where another object
    /// hides it. Empty without a mask loss.
    pub covered: Vec<Option<f64>>,
}

/// Step sizes and options of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepRates {
    /// Step size of poses.
    pub poses: f32,
    /// Step size of hash tables.
    pub tables: f32,
    /// Step size of networks.
    pub networks: f32,
    /// Weight of the mask loss.
    pub mask_weight: f64,
    /// True if gradients by planes are rescaled as published.
    pub rescales_gradients: bool,
}

/// Results of a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepOutcome {
    /// The loss.
    pub loss: f64,
    /// The mean squared error of the colours.
    pub squared_error: f64,
    /// Gradients that were not finite, by the names of [`super::graph::ARRAYS`].
    pub refused: [u64; 5],
    /// Hits of all nodes.
    pub samples: usize,
    /// Rays that hit nothing.
    pub missed: usize,
}

/// Gradients by each node's pose at each moment, and by the camera's.
pub type PoseGradients = (Vec<Vec<PoseGradient>>, Vec<PoseGradient>);

struct OfRay {
    loss: f64,
    squared_error: f64,
    /// Node, number of its sample, gradient.
    layers: Vec<(usize, usize, ShadeGradient)>,
}

impl Graph {
    /// Returns the loss of a batch, and gradients by the appearance of nodes, node by node.
    pub fn loss(
        &self,
        seen: &RenderedRays,
        targets: &Targets,
        mask_weight: f64,
    ) -> (StepOutcome, Vec<Vec<ShadeGradient>>) {
        let rays = targets.colours.len();
        let objects = targets.covered.len() / rays.max(1);
        let of_ray = |ray: usize| -> OfRay {
            let (layers, links) = seen.layers(ray);
            let error = compose(&layers) - targets.colours[ray];
            let upstream = sign(error) / (3 * rays) as f64;
            let mut gradients: Vec<LayerGradient> = Vec::new();
            compose_vjp(&layers, upstream, &mut gradients);
            let mut loss = error.abs().element_sum() / (3 * rays) as f64;
            let weight = mask_weight / (rays * objects.max(1)) as f64;
            let mut hit = vec![false; objects];
            let layers = links
                .iter()
                .zip(&gradients)
                .map(|(&(node, sample), gradient)| {
                    let mut gradient = ShadeGradient {
                        colour: gradient.colour,
                        opacity: gradient.opacity,
                    };
                    if node < objects {
                        hit[node] = true;
                        if let Some(covered) = targets.covered[ray * objects + node] {
                            let excess = seen.shaded[node].shades[sample].opacity - covered;
                            loss += weight * excess.abs();
                            gradient.opacity += weight * sign_of(excess);
                        }
                    }
                    (node, sample, gradient)
                })
                .collect();
            for (node, hit) in hit.iter().enumerate() {
                let covered = targets.covered[ray * objects + node];
                loss += if *hit {
                    0.0
                } else {
                    weight * covered.unwrap_or(0.0)
                };
            }
            OfRay {
                loss,
                squared_error: error.length_squared() / (3 * rays) as f64,
                layers,
            }
        };
        let of_rays: Vec<OfRay> = (0..rays).into_par_iter().map(of_ray).collect();
        let mut outcome = StepOutcome {
            samples: seen.samples.iter().map(Vec::len).sum(),
            missed: seen.links.iter().filter(|links| links.is_empty()).count(),
            ..StepOutcome::default()
        };
        let none = |samples: &Vec<_>| vec![ShadeGradient::default(); samples.len()];
        let mut gradients: Vec<Vec<ShadeGradient>> = seen.samples.iter().map(none).collect();
        for ray in of_rays {
            outcome.loss += ray.loss;
            outcome.squared_error += ray.squared_error;
            for (node, sample, gradient) in ray.layers {
                gradients[node][sample] = gradient;
            }
        }
        (outcome, gradients)
    }

    /// Returns gradients by each node's pose at each moment and by the camera's; those by the fields stay in the
    /// fields. `scales` multiply the gradients by poses through distances of hits, node by node and sample by
    /// sample; `None` leaves them unscaled.
    pub fn backward(
        &mut self,
        rays: &Rays,
        seen: &RenderedRays,
        upstream: &[Vec<ShadeGradient>],
        scales: Option<&[Vec<f64>]>,
    ) -> PoseGradients {
        let nodes = self.nodes.iter_mut().enumerate();
        let of_hits: Vec<Vec<PlaneGradient>> = nodes
            .map(|(number, node)| {
                node.shade_vjp(
                    &seen.samples[number],
                    &seen.shaded[number],
                    &upstream[number],
                    &seen.poses[number],
                    &seen.rays,
                )
            })
            .collect();
        through_hits(rays, seen, &of_hits, scales)
    }

    /// Makes one step on a batch.
    pub fn step(
        &mut self,
        rays: &Rays,
        targets: &Targets,
        detail: &Detail,
        rates: &StepRates,
    ) -> StepOutcome {
        let seen = self.see(rays, detail, true, &|_| true);
        let (mut outcome, upstream) = self.loss(&seen, targets, rates.mask_weight);
        let scales = rates.rescales_gradients.then(|| {
            let are_poses_alone = !detail.kinds[FieldKind::Colour.number()];
            published::scales_of_gradients(self, &seen, are_poses_alone)
        });
        let (by_poses, by_camera) = self.backward(rays, &seen, &upstream, scales.as_deref());
        for (number, node) in self.nodes.iter_mut().enumerate() {
            // Parameters of a node that no ray hit stay as they are, moments included.
            if seen.samples[number].is_empty() {
                continue;
            }
            for kind in FieldKind::ALL {
                if let Some(field) = node.fields.slot_mut(kind)
                    && detail.kinds[kind.number()]
                {
                    let refused = field.step([rates.tables, rates.networks]);
                    outcome.refused[kind.number()] += refused as u64;
                }
            }
        }
        outcome.refused[4] += self.step_poses(rays, &seen, (&by_poses, &by_camera), rates.poses);
        outcome
    }

    /// Moves the trajectories of nodes that rays hit, and the camera's; returns the number of gradients that were
    /// not finite.
    pub(super) fn step_poses(
        &mut self,
        rays: &Rays,
        seen: &RenderedRays,
        (by_poses, by_camera): (&[Vec<PoseGradient>], &[PoseGradient]),
        rate: f32,
    ) -> u64 {
        let times = rays.times();
        let mut refused = 0;
        for (number, node) in self.nodes.iter_mut().enumerate() {
            if seen.samples[number].is_empty() {
                continue;
            }
            let own_times: Vec<f64> = times.iter().map(|time| time - node.delay).collect();
            let given: Vec<RigidPose> = own_times.iter().map(|&t| node.given_pose(t)).collect();
            if let Some(offsets) = &mut node.offsets {
                refused += offsets.step(&given, &own_times, &by_poses[number], rate) as u64;
            }
        }
        if let Some(offsets) = &mut self.camera {
            let given: Vec<RigidPose> = rays.moments.iter().map(|moment| moment.given).collect();
            refused += offsets.step(&given, &times, by_camera, rate) as u64;
        }
        refused
    }
}

/// Returns gradients by each node's pose at each moment and by the camera's from those by hits, node by node; see
/// [`Graph::backward`].
pub(super) fn through_hits(
    rays: &Rays,
    seen: &RenderedRays,
    of_hits: &[Vec<PlaneGradient>],
    scales: Option<&[Vec<f64>]>,
) -> PoseGradients {
    let moments = rays.moments.len();
    let mut by_rays = vec![RayGradient::default(); rays.directions.len()];
    let mut by_poses = Vec::with_capacity(of_hits.len());
    for (number, of_hits) in of_hits.iter().enumerate() {
        let mut by_pose = vec![PoseGradient::default(); moments];
        for (row, (sample, gradient)) in seen.samples[number].iter().zip(of_hits).enumerate() {
            let scale = scales.map_or(1.0, |scales| scales[number][row]);
            by_pose[sample.moment].add(&gradient.through_place);
            by_pose[sample.moment].add(&gradient.through_distance.scaled(scale));
            let by_ray = &mut by_rays[sample.ray];
            by_ray.origin += gradient.ray.origin;
            by_ray.direction += gradient.ray.direction;
        }
        by_poses.push(by_pose);
    }
    let mut by_camera = vec![PoseGradient::default(); moments];
    for (ray, gradient) in by_rays.iter().enumerate() {
        by_camera[rays.moment_of[ray]].add(&PoseGradient {
            centre: gradient.origin,
            rotation: outer(gradient.direction, rays.directions[ray]),
        });
    }
    (by_poses, by_camera)
}

impl LearntOffsets {
    /// Returns gradients by the parameters from those by poses.
    pub fn gradients(&mut self, given: &[RigidPose], times: &[f64], by_poses: &[PoseGradient]) {
        let offsets = self.offsets();
        let count = offsets.positions.len();
        let mut by_positions = vec![DVec3::ZERO; count];
        let mut by_vectors = vec![DVec3::ZERO; count];
        for ((given, &time), by_pose) in given.iter().zip(times).zip(by_poses) {
            let is_nothing = by_pose.centre == DVec3::ZERO && by_pose.rotation == DMat3::ZERO;
            if !is_nothing {
                let out = [&mut by_positions[..], &mut by_vectors[..]];
                offsets.applied_vjp(given, time, by_pose, out);
            }
        }
        if !self.with_rotation {
            by_vectors.fill(DVec3::ZERO);
        }
        let all = by_positions.iter().chain(&by_vectors);
        let values = all.flat_map(DVec3::to_array);
        for (gradient, value) in self.parameters.array.gradients.iter_mut().zip(values) {
            *gradient = value as f32;
        }
    }

    fn step(
        &mut self,
        given: &[RigidPose],
        times: &[f64],
        by_poses: &[PoseGradient],
        rate: f32,
    ) -> usize {
        self.gradients(given, times, by_poses);
        self.parameters.array.learning_rate = rate;
        self.parameters.steps += 1;
        adam::cpu::step(
            &mut self.parameters.array,
            self.parameters.steps,
            adam::SecondMomentDecay::PUBLISHED,
        )
    }
}

/// Returns the derivative of the absolute value; 0 at 0.
fn sign_of(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

fn sign(error: DVec3) -> DVec3 {
    DVec3::new(sign_of(error.x), sign_of(error.y), sign_of(error.z))
}
