//! Appearance of surfaces, layers of rays and their loss on a GPU.
//!
//! The host intersects rays with surfaces, in f64, sorts the hits of each ray, and moves trajectories. A step
//! uploads 32 bytes for each hit, 8 for its place among its ray's, and 20 for each ray and 4 for each of its
//! objects; it reads back 20 bytes for each hit and 8 for each ray, in one wait. All else of a step stays on the
//! device: fields with their gradients and Adam, textures, and the composition of layers.

pub(crate) mod surface;

use std::sync::Arc;

use self::surface::{DeviceSurface, Networks};
pub use self::surface::{NewSurface, SurfaceSample};
pub use crate::fields::grid_field::gpu::FieldStep;
use crate::{
    device::{
        BufferDemand, DeviceBuffer, Gpu, GpuError, Kernel, Program, Rows, Shader, Uniform,
        wgsl_struct,
    },
    fields::{
        grid_field::{GridField, gpu::FieldKernels},
        hash_grid::{HashGrid, gpu::GridScratch},
    },
    trajectories::catmull_rom::KnotWeights,
};

/// Values of the gradient by a sample: its place and its view angle.
pub const SAMPLE_VALUES: usize = 5;
/// Words of the status of steps: three, then 16 counters of refused gradients.
const STATUS_WORDS: usize = 19;
/// First counter.
const FIRST_COUNTER: usize = 3;

wgsl_struct! {
    /// Sizes of a batch of rays, and the weights of its losses.
    pub(crate) struct RayBatch {
        rays: u32,
        objects: u32,
        colour_weight: f32,
        mask_weight: f32,
    }
}

/// Returns the kernels of appearance. `field_weight` is the factor of all fields.
pub(crate) fn shader(field_weight: f32) -> Shader {
    Shader {
        file: "surfaces.wgsl",
        constants: format!(
            "const FIELD_WEIGHT: f32 = {field_weight:e};\n\
             const SAMPLE_VALUES: u32 = {SAMPLE_VALUES}u;\n"
        ),
        parts: &[
            include_str!("../device/common.wgsl"),
            include_str!("../device/arc_tangent.wgsl"),
            include_str!("surfaces.wgsl"),
        ],
    }
}

/// Returns the kernels of layers.
pub(crate) fn compose_shader() -> Shader {
    Shader {
        file: "compose.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../device/common.wgsl"),
            include_str!("compose.wgsl"),
        ],
    }
}

#[derive(Debug)]
struct SurfaceKernels {
    fields: FieldKernels,
    place_samples: Kernel,
    move_samples: Kernel,
    shade: Kernel,
    shade_vjp: Kernel,
    move_samples_vjp: Kernel,
    compose: Kernel,
    compose_vjp: Kernel,
}

impl SurfaceKernels {
    fn new(gpu: &Gpu, field_weight: f32) -> Result<Self, GpuError> {
        let [
            place_samples,
            move_samples,
            shade,
            shade_vjp,
            move_samples_vjp,
        ] = Kernel::compile(
            gpu,
            &shader(field_weight),
            [
                "place_samples",
                "move_samples",
                "shade",
                "shade_vjp",
                "move_samples_vjp",
            ],
        )?;
        let [compose, compose_vjp] =
            Kernel::compile(gpu, &compose_shader(), ["compose", "compose_vjp"])?;
        Ok(Self {
            fields: FieldKernels::new(gpu)?,
            place_samples,
            move_samples,
            shade,
            shade_vjp,
            move_samples_vjp,
            compose,
            compose_vjp,
        })
    }
}

/// Hits of a batch of rays.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceBatch<'a> {
    /// Samples, surface by surface; at most one for each ray.
    pub samples: &'a [Vec<SurfaceSample>],
    /// Weights of the flow's control points at each moment, surface by surface; empty without a flow.
    pub knots: &'a [Vec<KnotWeights>],
    /// Features in use of each evaluated field, surface by surface.
    pub in_use: &'a [[Option<usize>; 4]],
    /// Surface and sample number of each hit, ray by ray, nearest first.
    pub hits: &'a [Vec<(usize, usize)>],
}

/// Targets of a batch's rays.
#[derive(Debug, Clone, Copy)]
pub struct RayTargets<'a> {
    /// Colours, [0, 1].
    pub colours: &'a [[f32; 3]],
    /// The share of each ray that an object covers, ray by ray and object by object; below 0 where it is unknown.
    /// Objects are the first surfaces.
    pub covered: &'a [f32],
    /// Weight of the mean absolute error of the objects' opacities.
    pub mask_weight: f64,
}

/// Results of a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SurfaceGradients {
    /// Loss of each ray, without what a missed object adds to it, and its squared error; means over the batch are
    /// their sums.
    pub losses: Vec<[f32; 2]>,
    /// Gradients by the samples, surface by surface: by the place, and by the view angle in radians.
    pub by_samples: Vec<Vec<[f32; SAMPLE_VALUES]>>,
}

/// Surfaces in GPU memory, with the programs of a step.
#[derive(Debug)]
pub struct DeviceSurfaces {
    gpu: Arc<Gpu>,
    surfaces: Vec<DeviceSurface>,
    rays: Rays,
    status: DeviceBuffer<u32>,
    forward: Program,
    colours: Program,
    backward: Program,
}

/// Buffers of a batch of rays.
#[derive(Debug)]
struct Rays {
    uniform: Uniform<RayBatch>,
    rows: Rows,
    begins: DeviceBuffer<u32>,
    hits: DeviceBuffer<[u32; 2]>,
    layers: DeviceBuffer<[f32; 4]>,
    by_layers: DeviceBuffer<[f32; 4]>,
    targets: DeviceBuffer<[f32; 4]>,
    covered: DeviceBuffer<f32>,
    colours: DeviceBuffer<[f32; 4]>,
    losses: DeviceBuffer<f32>,
}

impl Rays {
    fn new(gpu: &Gpu, room: usize, surfaces: usize) -> Result<Self, GpuError> {
        let layers = room * surfaces;
        Ok(Self {
            uniform: Uniform::of(gpu, "rays", &RayBatch::default())?,
            rows: Rows::new(0),
            begins: DeviceBuffer::zeros(gpu, "first hits of rays", room + 1)?,
            hits: DeviceBuffer::zeros(gpu, "hits of rays", layers)?,
            layers: DeviceBuffer::zeros(gpu, "layers of rays", layers)?,
            by_layers: DeviceBuffer::zeros(gpu, "gradients by layers", layers)?,
            targets: DeviceBuffer::zeros(gpu, "colours of rays", room)?,
            covered: DeviceBuffer::zeros(gpu, "objects of rays", layers)?,
            colours: DeviceBuffer::zeros(gpu, "rendered colours of rays", room)?,
            losses: DeviceBuffer::zeros(gpu, "losses of rays", 2 * room)?,
        })
    }

    /// Sets the hits of rays; `firsts` are the numbers of the surfaces' first layers.
    fn place(&self, gpu: &Gpu, hits: &[Vec<(usize, usize)>], firsts: &[usize]) {
        let mut begins = Vec::with_capacity(hits.len() + 1);
        let mut all: Vec<[u32; 2]> = Vec::new();
        begins.push(0);
        for of_ray in hits {
            let layers = of_ray.iter().map(|&(surface, sample)| {
                let layer = firsts[surface] + sample;
                [layer as u32, surface as u32]
            });
            all.extend(layers);
            begins.push(all.len() as u32);
        }
        self.rows.set(hits.len());
        self.begins.write(gpu, 0, &begins);
        self.hits.write(gpu, 0, &all);
    }

    /// Sets the sizes of a batch, with its targets if it has any.
    fn aim(&self, gpu: &Gpu, rays: usize, targets: Option<&RayTargets<'_>>) {
        let mut batch = RayBatch {
            rays: rays as u32,
            ..RayBatch::default()
        };
        if let Some(targets) = targets {
            let objects = targets.covered.len() / rays.max(1);
            batch.objects = objects as u32;
            batch.colour_weight = (1.0 / (3 * rays.max(1)) as f64) as f32;
            let opacities = rays.max(1) * objects.max(1);
            batch.mask_weight = (targets.mask_weight / opacities as f64) as f32;
            let colours = targets.colours.iter().map(|&[r, g, b]| [r, g, b, 0.0]);
            let colours: Vec<[f32; 4]> = colours.collect();
            self.targets.write(gpu, 0, &colours);
            self.covered.write(gpu, 0, targets.covered);
        }
        self.uniform.write(gpu, &batch);
    }
}

impl DeviceSurfaces {
    /// Uploads surfaces, with room for `rays` rays at `moments` moments. `field_weight` is the factor of all
    /// fields.
    ///
    /// # Errors
    /// If a buffer is larger than the adapter allows, memory does not suffice, or the device fails.
    pub fn new(
        gpu: Arc<Gpu>,
        surfaces: &[NewSurface<'_>],
        [rays, moments]: [usize; 2],
        field_weight: f64,
    ) -> Result<Self, GpuError> {
        let fields = surfaces.iter().flat_map(|surface| surface.fields);
        let grids: Vec<&HashGrid> = fields.flatten().map(GridField::grid).collect();
        let scratch = GridScratch::new(&gpu, &grids, rays)?;
        let networks = Networks::new(&gpu, surfaces, rays)?;
        let upload = |surface| DeviceSurface::new(&gpu, (surface, &networks), [rays, moments]);
        let mut made = Self {
            surfaces: surfaces.iter().map(upload).collect::<Result<_, _>>()?,
            rays: Rays::new(&gpu, rays, surfaces.len())?,
            status: DeviceBuffer::zeros(&gpu, "status", STATUS_WORDS)?,
            forward: Program::default(),
            colours: Program::default(),
            backward: Program::default(),
            gpu,
        };
        let kernels = SurfaceKernels::new(&made.gpu, field_weight as f32)?;
        made.record(&kernels, &scratch)?;
        Ok(made)
    }

    /// Returns the sizes of the buffers of surfaces, which are not allocated. The device is of no further use.
    ///
    /// # Errors
    /// If the device fails.
    pub fn demand(
        gpu: Arc<Gpu>,
        surfaces: &[NewSurface<'_>],
        room: [usize; 2],
        field_weight: f64,
    ) -> Result<BufferDemand, GpuError> {
        gpu.only_plan();
        let made = Self::new(gpu, surfaces, room, field_weight)?;
        made.gpu.check()?;
        Ok(made.gpu.buffer_demand())
    }

    fn record(&mut self, kernels: &SurfaceKernels, scratch: &GridScratch) -> Result<(), GpuError> {
        let at = (&*self.gpu, kernels);
        let rays = &self.rays;
        let (layers, by_layers) = (&rays.layers.raw, &rays.by_layers.raw);
        let of_rays = [&rays.uniform.raw, &rays.begins.raw, &rays.hits.raw, layers];
        for surface in &self.surfaces {
            surface.forward(at, &mut self.forward, layers)?;
        }
        let [batch, begins, hits, layers] = of_rays;
        self.colours.run(
            at.0,
            &kernels.compose,
            &rays.rows,
            &[batch, begins, hits, layers, &rays.colours.raw],
        );
        self.backward.run(
            at.0,
            &kernels.compose_vjp,
            &rays.rows,
            &[
                batch,
                begins,
                hits,
                layers,
                &rays.targets.raw,
                &rays.covered.raw,
                by_layers,
                &rays.losses.raw,
            ],
        );
        for surface in &self.surfaces {
            surface.backward(at, &mut self.backward, by_layers, scratch)?;
        }
        for surface in &self.surfaces {
            surface.step(at, &mut self.backward, &self.status.raw);
        }
        Ok(())
    }

    fn place(&mut self, batch: &SurfaceBatch<'_>) {
        let mut firsts = Vec::with_capacity(self.surfaces.len());
        let mut first = 0;
        for (number, surface) in self.surfaces.iter_mut().enumerate() {
            let samples = &batch.samples[number];
            let of_surface = (&samples[..], first);
            let (knots, in_use) = (&batch.knots[number], &batch.in_use[number]);
            surface.place(&self.gpu, of_surface, knots, in_use);
            firsts.push(first);
            first += samples.len();
        }
        self.rays.place(&self.gpu, batch.hits, &firsts);
    }

    /// Returns the colours of rays, [0, 1].
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If there are more rays or moments than there is room for.
    pub fn colours(&mut self, batch: &SurfaceBatch<'_>) -> Result<Vec<[f32; 3]>, GpuError> {
        let rays = batch.hits.len();
        self.place(batch);
        self.rays.aim(&self.gpu, rays, None);
        self.forward.submit(&self.gpu);
        self.colours.submit(&self.gpu);
        let colours = self.rays.colours.read_range(&self.gpu, 0..rays)?;
        Ok(colours.iter().map(|&[r, g, b, _]| [r, g, b]).collect())
    }

    /// Takes a step on a batch of rays: losses, gradients, and Adam for the fields that have one in `steps`, surface
    /// by surface.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If there are more rays or moments than there is room for.
    pub fn step(
        &mut self,
        batch: &SurfaceBatch<'_>,
        targets: &RayTargets<'_>,
        steps: &[[Option<FieldStep>; 4]],
    ) -> Result<SurfaceGradients, GpuError> {
        let rays = batch.hits.len();
        self.place(batch);
        self.rays.aim(&self.gpu, rays, Some(targets));
        for (surface, steps) in self.surfaces.iter().zip(steps) {
            surface.set_steps(&self.gpu, steps);
        }
        self.forward.submit(&self.gpu);
        self.backward.submit(&self.gpu);
        let mut wanted = vec![(&self.rays.losses, 0..2 * rays)];
        for (surface, samples) in self.surfaces.iter().zip(batch.samples) {
            wanted.push((&surface.by_samples, 0..SAMPLE_VALUES * samples.len()));
        }
        let mut read = DeviceBuffer::read_ranges(&self.gpu, &wanted)?.into_iter();
        let losses = read.next().unwrap_or_default();
        Ok(SurfaceGradients {
            losses: losses.as_chunks::<2>().0.to_vec(),
            by_samples: read
                .map(|values| values.as_chunks::<SAMPLE_VALUES>().0.to_vec())
                .collect(),
        })
    }

    /// Returns the numbers of gradients of each field that were not finite and were not applied since the last
    /// call.
    ///
    /// # Errors
    /// If the device fails.
    pub fn take_refused(&mut self) -> Result<[u64; 4], GpuError> {
        let status = self.status.read(&self.gpu)?;
        self.status.write(&self.gpu, 0, &[0; STATUS_WORDS]);
        Ok(std::array::from_fn(|field| {
            u64::from(status[FIRST_COUNTER + field])
        }))
    }

    /// Copies the parameters and moments of a surface's field back.
    ///
    /// # Errors
    /// If the device fails.
    pub fn read(
        &self,
        surface: usize,
        number: usize,
        field: &mut GridField,
    ) -> Result<(), GpuError> {
        self.surfaces[surface].read(&self.gpu, number, field)
    }
}

#[cfg(test)]
mod tests;
