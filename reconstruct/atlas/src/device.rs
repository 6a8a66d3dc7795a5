//! Steps and images of an atlas whose fields are on a GPU; the twin of [`Graph::step`] and [`Graph::image`].
//!
//! The host moves trajectories, intersects rays with nodes, and takes the gradients by hits back to the poses,
//! all in f64. Appearance, fields and layers are the device's: [`omnilife_engine::surfaces::gpu`] states what a
//! step uploads and reads back. Each step waits for the gradients by its hits, because poses move before the
//! next one.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use omnilife_engine::{
    EngineError,
    camera::View,
    device::{Gpu, KernelChoices},
    step::gpu::memory::DevicePlan,
    surfaces::{
        gpu::{
            DeviceSurfaces, FieldStep, NewSurface, RayTargets, SurfaceBatch, SurfaceGradients,
            SurfaceSample,
        },
        plane::PlaneGradient,
    },
    trajectories::catmull_rom::KnotWeights,
};
use omnilife_schemas::{RgbImage, records::Backend};
use rayon::prelude::*;

use super::{
    graph::Graph,
    node::{FIELD_WEIGHT, FieldKind},
    render::{RAYS, Rays, RenderedRays},
    shade::{Detail, Sample},
    step::{PoseGradients, StepOutcome, StepRates, Targets, through_hits},
};

/// Values of fields on a GPU.
#[derive(Debug)]
pub(super) struct AtlasDevice {
    gpu: Arc<Gpu>,
    /// Most rays and moments of a batch.
    room: [usize; 2],
    /// `None` before the first upload, and after the graph's fields changed on the host.
    surfaces: Option<DeviceSurfaces>,
    /// True if the device's parameters are newer than the graph's.
    is_newer: bool,
}

/// Hits of a batch as a device takes them.
struct Batch {
    samples: Vec<Vec<SurfaceSample>>,
    knots: Vec<Vec<KnotWeights>>,
    in_use: Vec<[Option<usize>; 4]>,
    hits: Vec<Vec<(usize, usize)>>,
}

impl Batch {
    fn new(graph: &Graph, rays: &Rays, seen: &RenderedRays, detail: &Detail) -> Self {
        let times = rays.times();
        let uploaded = |samples: &Vec<Sample>| -> Vec<SurfaceSample> {
            samples.par_iter().map(Sample::for_device).collect()
        };
        let nodes = || graph.nodes.iter();
        Self {
            samples: seen.samples.iter().map(uploaded).collect(),
            knots: nodes().map(|node| node.flow_weights(&times)).collect(),
            in_use: nodes()
                .map(|node| {
                    FieldKind::ALL.map(|kind| {
                        let field = node.fields.get(kind)?;
                        let is_evaluated = detail.kinds[kind.number()];
                        is_evaluated.then(|| detail.active(kind, field))
                    })
                })
                .collect(),
            hits: seen
                .links
                .par_iter()
                .map(|links| {
                    let distance = |&(node, sample): &(usize, usize)| {
                        seen.samples[node][sample].hit.distance()
                    };
                    let mut links = links.clone();
                    links.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.0.cmp(&b.0)));
                    links
                })
                .collect(),
        }
    }

    fn borrowed(&self) -> SurfaceBatch<'_> {
        SurfaceBatch {
            samples: &self.samples,
            knots: &self.knots,
            in_use: &self.in_use,
            hits: &self.hits,
        }
    }
}

/// Returns the mean absolute error of objects' opacities if all objects are missed, times its weight.
fn loss_if_missed(targets: &Targets, weight: f64) -> f64 {
    let known = targets.covered.iter().flatten();
    weight * known.sum::<f64>() / targets.covered.len().max(1) as f64
}

/// Opens the first GPU. Choices of kernels concern Gaussians alone.
fn gpu() -> Result<Arc<Gpu>, EngineError> {
    Ok(Arc::new(Gpu::open_with_choices(KernelChoices::default())?))
}

impl AtlasDevice {
    /// Opens the first GPU, for batches of at most so many rays and moments.
    pub(super) fn open(room: [usize; 2]) -> Result<Self, EngineError> {
        Ok(Self {
            gpu: gpu()?,
            room: room.map(|room| room.max(1)),
            surfaces: None,
            is_newer: false,
        })
    }

    /// Returns the entry of the device in a run's record.
    pub(super) fn record(&self) -> Backend {
        self.gpu.record()
    }

    /// Returns the memory of a graph's training.
    pub(super) fn plan(&self, graph: &Graph) -> Result<DevicePlan, EngineError> {
        let surfaces = surfaces_of(graph);
        let buffers = DeviceSurfaces::demand(gpu()?, &surfaces, self.room, FIELD_WEIGHT)?;
        DevicePlan::of_buffers(buffers, None)
    }

    /// Returns the surfaces of a graph, uploaded if they are not there.
    fn surfaces(&mut self, graph: &Graph) -> Result<&mut DeviceSurfaces, EngineError> {
        let surfaces = match self.surfaces.take() {
            Some(surfaces) => surfaces,
            None => {
                let gpu = Arc::clone(&self.gpu);
                DeviceSurfaces::new(gpu, &surfaces_of(graph), self.room, FIELD_WEIGHT)?
            }
        };
        Ok(self.surfaces.insert(surfaces))
    }

    /// Makes one step on a batch. Counts of refused gradients are those of the trajectories; see
    /// [`AtlasDevice::take_refused`] for others.
    pub(super) fn step(
        &mut self,
        graph: &mut Graph,
        (rays, targets): (&Rays, &Targets),
        detail: &Detail,
        rates: &StepRates,
    ) -> Result<StepOutcome, EngineError> {
        let seen = graph.hits(rays, &|_| true);
        let batch = Batch::new(graph, rays, &seen, detail);
        let surfaces = self.surfaces(graph)?;
        let colours: Vec<[f32; 3]> = targets
            .colours
            .iter()
            .map(|colour| colour.as_vec3().to_array())
            .collect();
        let covered: Vec<f32> = targets
            .covered
            .iter()
            .map(|covered| covered.map_or(-1.0, |covered| covered as f32))
            .collect();
        let steps = next_steps(graph, &seen, detail, rates);
        let made = surfaces.step(
            &batch.borrowed(),
            &RayTargets {
                colours: &colours,
                covered: &covered,
                mask_weight: rates.mask_weight,
            },
            &steps,
        )?;
        self.is_newer = true;
        let sum = |which: usize| -> f64 {
            let losses = made.losses.iter();
            losses.map(|losses| f64::from(losses[which])).sum()
        };
        let mut outcome = StepOutcome {
            loss: loss_if_missed(targets, rates.mask_weight) + sum(0),
            squared_error: sum(1),
            samples: seen.samples.iter().map(Vec::len).sum(),
            missed: seen.links.iter().filter(|links| links.is_empty()).count(),
            ..StepOutcome::default()
        };
        let (by_poses, by_camera) = by_poses(graph, rays, &seen, &made);
        let by_poses = (&by_poses[..], &by_camera[..]);
        outcome.refused[4] = graph.step_poses(rays, &seen, by_poses, rates.poses);
        Ok(outcome)
    }

    /// Returns the numbers of refused gradients of each kind of field since the last call.
    pub(super) fn take_refused(&mut self) -> Result<[u64; 4], EngineError> {
        match &mut self.surfaces {
            Some(surfaces) => Ok(surfaces.take_refused()?),
            None => Ok([0; 4]),
        }
    }

    /// Returns the image of a view, in [0, 1].
    pub(super) fn image(&mut self, graph: &Graph, view: &View) -> Result<RgbImage, EngineError> {
        let moment = graph.moment_of(view);
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let mut image = RgbImage::black(width, height);
        let at_once = RAYS.min(self.room[0]);
        let surfaces = self.surfaces(graph)?;
        for (chunk, out) in image.data.chunks_mut(3 * at_once).enumerate() {
            let pixels = chunk * at_once..chunk * at_once + out.len() / 3;
            let rays = Rays::of_pixels(&view.camera, moment, pixels);
            let seen = graph.hits(&rays, &|_| true);
            let batch = Batch::new(graph, &rays, &seen, &Detail::FULL);
            let colours = surfaces.colours(&batch.borrowed())?;
            out.copy_from_slice(colours.as_flattened());
        }
        Ok(image)
    }

    /// Copies the fields' parameters and moments to the graph if the device's are newer.
    pub(super) fn download(&mut self, graph: &mut Graph) -> Result<(), EngineError> {
        let Some(surfaces) = self.surfaces.as_ref().filter(|_| self.is_newer) else {
            return Ok(());
        };
        for (number, node) in graph.nodes.iter_mut().enumerate() {
            for kind in FieldKind::ALL {
                if let Some(field) = node.fields.slot_mut(kind) {
                    surfaces.read(number, kind.number(), field)?;
                }
            }
        }
        self.is_newer = false;
        Ok(())
    }

    /// Drops the device's parameters: the next step uploads those of the graph.
    pub(super) fn forget(&mut self) {
        self.surfaces = None;
        self.is_newer = false;
    }
}

fn surfaces_of(graph: &Graph) -> Vec<NewSurface<'_>> {
    let nodes = graph.nodes.iter();
    nodes
        .map(|node| NewSurface {
            dimensions: node.dimensions(),
            colour: &node.colour,
            opacity: node.opacity.as_ref(),
            fields: FieldKind::ALL.map(|kind| node.fields.get(kind)),
        })
        .collect()
}

/// Counts a step of each field that is trained and lies on a node that rays hit, and returns them.
fn next_steps(
    graph: &mut Graph,
    seen: &RenderedRays,
    detail: &Detail,
    rates: &StepRates,
) -> Vec<[Option<FieldStep>; 4]> {
    let nodes = graph.nodes.iter_mut().zip(&seen.samples);
    nodes
        .map(|(node, samples)| {
            FieldKind::ALL.map(|kind| {
                let is_trained = detail.kinds[kind.number()] && !samples.is_empty();
                let field = node.fields.slot_mut(kind).as_mut();
                let field = field.filter(|_| is_trained)?;
                field.table.steps += 1;
                field.weights.steps += 1;
                Some(FieldStep {
                    numbers: [field.table.steps, field.weights.steps],
                    rates: [rates.tables, rates.networks],
                })
            })
        })
        .collect()
}

/// Returns the gradients by the poses of nodes and of the camera from those by samples.
fn by_poses(
    graph: &Graph,
    rays: &Rays,
    seen: &RenderedRays,
    made: &SurfaceGradients,
) -> PoseGradients {
    let of_hits: Vec<Vec<PlaneGradient>> = graph
        .nodes
        .iter()
        .enumerate()
        .map(|(number, node)| {
            let samples = seen.samples[number].par_iter();
            samples
                .zip(&made.by_samples[number])
                .map(|(sample, by)| {
                    let [x, y, z, u, v] = by.map(f64::from);
                    let pose = &seen.poses[number][sample.moment];
                    let ray = &seen.rays[sample.ray];
                    node.hit_vjp(sample, ray, pose, DVec3::new(x, y, z), DVec2::new(u, v))
                })
                .collect()
        })
        .collect();
    through_hits(rays, seen, &of_hits, None)
}

#[cfg(test)]
mod tests;
