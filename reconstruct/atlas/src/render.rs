//! Colours of rays: hits with every node, the appearance there, layers.

use glam::DVec3;
use omnilife_engine::{
    camera::{Camera, View},
    surfaces::{
        compose::{Layer, compose, sort},
        plane::Ray,
    },
    trajectories::rigid_spline::RigidPose,
};
use omnilife_schemas::RgbImage;
use rayon::prelude::*;

use super::{
    clip::{camera_direction, pixel_centre, pose_of, ray_of},
    graph::{FootageFrame, Graph, Visibility},
    shade::{Detail, Sample, Shading},
};

/// A moment that rays of a batch share.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// In [0, 1].
    pub time: f64,
    /// The camera's pose, without its correction.
    pub given: RigidPose,
}

/// Rays of an image that are rendered at once: as many as keep fields' rows in the caches.
pub(super) const RAYS: usize = 1 << 14;

/// Rays of a batch.
#[derive(Debug, Default)]
pub struct Rays {
    /// Moments.
    pub moments: Vec<Moment>,
    /// The moment of each ray.
    pub moment_of: Vec<usize>,
    /// The unit direction of each ray in its camera's frame.
    pub directions: Vec<DVec3>,
}

/// Hits and appearance of rays.
#[derive(Debug)]
pub struct RenderedRays {
    /// The rays in the scene.
    pub rays: Vec<Ray>,
    /// Hits, node by node.
    pub samples: Vec<Vec<Sample>>,
    /// Their appearance, node by node.
    pub shaded: Vec<Shading>,
    /// Poses of each node at each moment.
    pub poses: Vec<Vec<RigidPose>>,
    /// Node and sample number of each hit, ray by ray.
    pub links: Vec<Vec<(usize, usize)>>,
}

impl RenderedRays {
    /// Returns the layers of a ray, nearest first, with their links.
    pub fn layers(&self, ray: usize) -> (Vec<Layer>, Vec<(usize, usize)>) {
        let mut links = self.links[ray].clone();
        let layer = |&(node, sample): &(usize, usize)| {
            let shade = &self.shaded[node].shades[sample];
            Layer {
                distance: self.samples[node][sample].hit.distance(),
                surface: node,
                colour: shade.colour,
                opacity: shade.opacity,
            }
        };
        let mut layers: Vec<Layer> = links.iter().map(layer).collect();
        sort(&mut layers);
        links.sort_by_key(|&(node, _)| layers.iter().position(|layer| layer.surface == node));
        (layers, links)
    }
}

impl FootageFrame {
    pub(super) fn moment(&self) -> Moment {
        Moment {
            time: self.time,
            given: self.pose,
        }
    }
}

impl Rays {
    /// Returns the rays of some pixels of an image, row-major.
    pub(super) fn of_pixels(
        camera: &Camera,
        moment: Moment,
        pixels: impl IntoIterator<Item = usize>,
    ) -> Self {
        let width = camera.width() as usize;
        let direction = |pixel| camera_direction(camera, pixel_centre(pixel, width));
        let directions: Vec<DVec3> = pixels.into_iter().map(direction).collect();
        Self {
            moments: vec![moment],
            moment_of: vec![0; directions.len()],
            directions,
        }
    }

    pub(super) fn times(&self) -> Vec<f64> {
        self.moments.iter().map(|moment| moment.time).collect()
    }
}

impl Graph {
    /// Returns the appearance of the nodes that `is_shown` names along rays. If `keep` is true, fields store the
    /// activations for gradients.
    pub fn see(
        &mut self,
        rays: &Rays,
        detail: &Detail,
        keep: bool,
        is_shown: &dyn Fn(usize) -> bool,
    ) -> RenderedRays {
        let mut seen = self.hits(rays, is_shown);
        let times = rays.times();
        seen.shaded = self
            .nodes
            .iter_mut()
            .zip(&seen.samples)
            .map(|(node, samples)| node.shade(samples, &times, detail, keep))
            .collect();
        seen
    }

    pub(super) fn moment_of(&self, view: &View) -> Moment {
        Moment {
            time: self.clock.time(view.time_seconds),
            given: pose_of(view),
        }
    }

    /// Returns the hits of the nodes that `is_shown` names along rays, without their appearance.
    pub(super) fn hits(&self, rays: &Rays, is_shown: &dyn Fn(usize) -> bool) -> RenderedRays {
        let times = rays.times();
        let cameras: Vec<RigidPose> = rays
            .moments
            .iter()
            .map(|moment| self.camera_pose(&moment.given, moment.time))
            .collect();
        let poses: Vec<Vec<RigidPose>> = self
            .nodes
            .iter()
            .map(|node| times.iter().map(|&time| node.pose(time)).collect())
            .collect();
        let placed: Vec<Ray> = rays
            .moment_of
            .iter()
            .zip(&rays.directions)
            .map(|(&moment, &direction)| ray_of(&cameras[moment], direction))
            .collect();
        let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); self.nodes.len()];
        let mut links = vec![Vec::new(); placed.len()];
        for (number, node) in self.nodes.iter().enumerate() {
            if !is_shown(number) {
                continue;
            }
            let is_there: Vec<bool> = times.iter().map(|&time| node.is_there(time)).collect();
            for (ray, placed) in placed.iter().enumerate() {
                let moment = rays.moment_of[ray];
                if !is_there[moment] {
                    continue;
                }
                if let Some(hit) = node.hit(placed, &poses[number][moment]) {
                    links[ray].push((number, samples[number].len()));
                    samples[number].push(Sample { ray, moment, hit });
                }
            }
        }
        RenderedRays {
            rays: placed,
            samples,
            shaded: Vec::new(),
            poses,
            links,
        }
    }

    /// Returns the image of a view, in [0, 1], and the number of its rays without a hit.
    pub fn image(&mut self, view: &View, shown: &Visibility) -> (RgbImage, usize) {
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let named = match shown {
            Visibility::All => None,
            Visibility::Only(id)
            | Visibility::Opacity(id)
            | Visibility::Matte(id)
            | Visibility::Without(id) => self.find(id),
        };
        let is_shown = |node: usize| match shown {
            Visibility::All | Visibility::Matte(_) => true,
            Visibility::Only(_) | Visibility::Opacity(_) => Some(node) == named,
            Visibility::Without(_) => Some(node) != named,
        };
        let moment = self.moment_of(view);
        let mut image = RgbImage::black(width, height);
        let mut missed = 0;
        for (chunk, out) in image.data.chunks_mut(3 * RAYS).enumerate() {
            let pixels = chunk * RAYS..chunk * RAYS + out.len() / 3;
            let rays = Rays::of_pixels(&view.camera, moment, pixels);
            let seen = self.see(&rays, &Detail::FULL, false, &is_shown);
            missed += seen.links.iter().filter(|links| links.is_empty()).count();
            out.par_chunks_exact_mut(3)
                .enumerate()
                .for_each(|(ray, out)| {
                    let (mut layers, _) = seen.layers(ray);
                    if let Visibility::Matte(_) | Visibility::Opacity(_) = shown {
                        for layer in &mut layers {
                            let is_it = Some(layer.surface) == named;
                            layer.colour = if is_it { DVec3::ONE } else { DVec3::ZERO };
                        }
                    }
                    let colour = compose(&layers);
                    for (out, value) in out.iter_mut().zip(colour.to_array()) {
                        *out = value as f32;
                    }
                });
        }
        (image, missed)
    }
}
