//! GPU renderer: the chain of kernels that renders a view, and its backward pass.

use std::sync::Arc;

use omnilife_schemas::RgbImage;

use crate::{
    camera::View,
    gaussians::ActivatedGaussians,
    render::{
        Visible,
        bin::gpu::Binning,
        project::{
            by_camera::{
                PoseGradient,
                gpu::{PoseGradients, sum},
            },
            gpu::Projection,
        },
        raster::{Raster, RasterGradient, gpu::Rasterization},
        settings::RenderSettings,
    },
};
use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Program},
    render::buffers::{DeviceStatus, HALTED_RUNNING, RenderBuffers, RenderShape},
};

/// Capacity in entries relative to the number needed, so that growing is rare.
const ENTRY_SLACK: f64 = 1.5;

/// Kernels of a render for a number of channels.
#[derive(Debug)]
struct Stages {
    channels: usize,
    projection: Projection,
    binning: Binning,
    rasterization: Rasterization,
}

impl Stages {
    fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        Ok(Self {
            channels: shape.channels(),
            projection: Projection::new(gpu, shape)?,
            binning: Binning::new(gpu, shape)?,
            rasterization: Rasterization::new(gpu, shape)?,
        })
    }
}

/// Buffers of one shape, and the program that renders with them.
#[derive(Debug)]
pub(crate) struct Chain {
    pub(crate) buffers: RenderBuffers,
    pub(crate) forward: Program,
}

/// Creates chains, compiling each kernel once.
#[derive(Debug, Default)]
pub(crate) struct Chains {
    stages: Option<Stages>,
}

impl Chains {
    fn stages(&mut self, gpu: &Gpu, shape: &RenderShape) -> Result<&Stages, GpuError> {
        let stages = match self.stages.take() {
            Some(stages) if stages.channels == shape.channels() => stages,
            _ => Stages::new(gpu, shape)?,
        };
        Ok(self.stages.insert(stages))
    }

    /// Creates a chain for this number of Gaussians in buffers of this shape; chains that share `status` halt
    /// together.
    pub(crate) fn chain(
        &mut self,
        gpu: &Gpu,
        (shape, gaussians): (RenderShape, usize),
        status: DeviceBuffer<DeviceStatus>,
    ) -> Result<Chain, GpuError> {
        let stages = self.stages(gpu, &shape)?;
        let buffers = RenderBuffers::new(gpu, (shape, gaussians), status)?;
        let mut forward = Program::default();
        forward.begin_stage("project");
        stages.projection.forward(gpu, &mut forward, &buffers);
        stages.binning.forward(gpu, &mut forward, &buffers)?;
        forward.begin_stage("raster");
        stages.rasterization.forward(gpu, &mut forward, &buffers);
        Ok(Chain { buffers, forward })
    }

    /// Records the backward pass from `upstream`, the gradient by the image, to the Gaussians.
    pub(crate) fn backward(
        &mut self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
        upstream: &DeviceBuffer<f32>,
    ) -> Result<(), GpuError> {
        self.backward_to_splats(gpu, program, buffers, upstream)?;
        let stages = self.stages(gpu, &buffers.shape)?;
        program.begin_stage("project backward");
        stages.projection.backward(gpu, program, buffers);
        Ok(())
    }

    /// Records the backward pass from `upstream`, the gradient by the image, to the splats.
    pub(crate) fn backward_to_splats(
        &mut self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
        upstream: &DeviceBuffer<f32>,
    ) -> Result<(), GpuError> {
        let stages = self.stages(gpu, &buffers.shape)?;
        program.begin_stage("raster backward");
        let rasterization = &stages.rasterization;
        rasterization.backward(gpu, program, buffers, upstream);
        Ok(())
    }
}

/// A chain with its backward pass.
#[derive(Debug)]
struct RoundTrip {
    chain: Chain,
    upstream: DeviceBuffer<f32>,
    backward: Program,
}

/// Renders views on a GPU; the twin of [`crate::render::cpu::Renderer`].
#[derive(Debug)]
pub struct GpuRenderer {
    /// Render settings; may be changed from view to view.
    pub settings: RenderSettings,
    gpu: Arc<Gpu>,
    chains: Chains,
    round_trip: Option<RoundTrip>,
}

impl GpuRenderer {
    /// Creates a renderer; memory is allocated by the first view.
    pub fn new(gpu: Arc<Gpu>, settings: RenderSettings) -> Self {
        Self {
            settings,
            gpu,
            chains: Chains::default(),
            round_trip: None,
        }
    }

    /// Renders one view.
    ///
    /// # Errors
    /// If the device fails or its memory does not suffice.
    pub fn forward(
        &mut self,
        view: &View,
        gaussians: &ActivatedGaussians,
    ) -> Result<Raster, GpuError> {
        let mut shape = RenderShape {
            gaussians: gaussians.len(),
            sh_degree: gaussians.sh_degree,
            features: gaussians.feature_count,
            width: view.camera.width() as usize,
            height: view.camera.height() as usize,
            entries: RenderShape::first_entries(gaussians.len()),
        };
        if let Some(last) = &self.round_trip {
            shape.entries = shape.entries.max(last.chain.buffers.shape.entries);
        }
        loop {
            let fitting = self.fitting(shape)?;
            let RoundTrip { chain, .. } = self.round_trip.insert(fitting);
            let (gpu, buffers) = (&*self.gpu, &chain.buffers);
            buffers.status.write(gpu, 0, &[DeviceStatus::default()]);
            buffers.set_view(gpu, view, &self.settings);
            buffers.activated.write(gpu, gaussians);
            chain.forward.submit(gpu);
            let status = buffers.status.read(gpu)?[0];
            if status.halted == HALTED_RUNNING {
                return Ok(split_image(&shape, &buffers.image.read(gpu)?));
            }
            shape.entries = with_slack(status.entries);
        }
    }

    /// Takes the buffers and programs of this shape, or creates them.
    fn fitting(&mut self, shape: RenderShape) -> Result<RoundTrip, GpuError> {
        // One of another shape is freed first: both may not fit.
        let last = self.round_trip.take();
        if let Some(last) = last.filter(|last| last.chain.buffers.shape == shape) {
            return Ok(last);
        }
        let gpu = &*self.gpu;
        let status = DeviceBuffer::zeros(gpu, "status", 1)?;
        let chain = self.chains.chain(gpu, (shape, shape.gaussians), status)?;
        let upstream = DeviceBuffer::zeros(gpu, "gradient by the image", shape.image_values())?;
        let mut backward = Program::default();
        self.chains
            .backward(gpu, &mut backward, &chain.buffers, &upstream)?;
        Ok(RoundTrip {
            chain,
            upstream,
            backward,
        })
    }

    /// Computes gradients by the Gaussians of the view rendered last, from the gradient by its raster. `out`
    /// is overwritten.
    ///
    /// # Errors
    /// If the device fails, or no view was rendered before.
    pub fn backward(
        &mut self,
        upstream: &RasterGradient<'_>,
        out: &mut ActivatedGaussians,
    ) -> Result<(), GpuError> {
        let gpu = &*self.gpu;
        let Some(last) = &self.round_trip else {
            return Err(gpu.failed("a backward pass was started before any view was rendered"));
        };
        let pixels = last.chain.buffers.shape.pixels();
        let mut values = vec![0.0; last.upstream.len()];
        values[..pixels * 3].copy_from_slice(upstream.colour);
        // Empty if the loss does not use the features.
        values[pixels * 4..][..upstream.features.len()].copy_from_slice(upstream.features);
        last.upstream.write(gpu, 0, &values);
        last.backward.submit(gpu);
        last.chain.buffers.activated.read_gradient(gpu, out)
    }

    /// Returns the visible Gaussians of the view rendered last, with the gradients of its last backward pass.
    ///
    /// # Errors
    /// If the device fails.
    pub fn visible(&self) -> Result<Vec<Visible>, GpuError> {
        let Some(RoundTrip { chain, .. }) = &self.round_trip else {
            return Ok(Vec::new());
        };
        let sums = chain.buffers.splat_gradients.read(&self.gpu)?;
        Ok(sums
            .chunks(chain.buffers.shape.splat_sums())
            .enumerate()
            .filter(|(_, sums)| sums[0] > 0.0)
            .map(|(gaussian, sums)| Visible {
                gaussian,
                centre_gradient: [sums[12], sums[13]],
            })
            .collect())
    }

    /// Returns the gradient by the pose of the view rendered last, from its last backward pass.
    ///
    /// # Errors
    /// If the device fails, or no view was rendered before.
    pub fn pose_gradient(&self) -> Result<PoseGradient, GpuError> {
        let gpu = &*self.gpu;
        let Some(RoundTrip { chain, .. }) = &self.round_trip else {
            return Err(gpu.failed("a view must be rendered before the gradient by its pose"));
        };
        let buffers = &chain.buffers;
        let mut program = Program::default();
        let kernel = PoseGradients::new(gpu, &buffers.shape)?;
        let parts = kernel.record(gpu, &mut program, buffers)?;
        program.submit(gpu);
        Ok(sum(&parts.read(gpu)?))
    }

    /// Renders one view as an image clamped to `[0, 1]`.
    ///
    /// # Errors
    /// If the device fails or its memory does not suffice.
    pub fn image(
        &mut self,
        view: &View,
        gaussians: &ActivatedGaussians,
    ) -> Result<RgbImage, GpuError> {
        let raster = self.forward(view, gaussians)?;
        Ok(RgbImage {
            width: raster.width,
            height: raster.height,
            data: raster
                .colour
                .iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        })
    }
}

/// Returns a capacity with slack for this number of entries.
pub(crate) fn with_slack(entries: u32) -> usize {
    (f64::from(entries) * ENTRY_SLACK) as usize
}

fn split_image(shape: &RenderShape, values: &[f32]) -> Raster {
    let pixels = shape.pixels();
    Raster {
        width: shape.width,
        height: shape.height,
        colour: values[..pixels * 3].to_vec(),
        transmittance: values[pixels * 3..pixels * 4].to_vec(),
        features: values[pixels * 4..].to_vec(),
    }
}
