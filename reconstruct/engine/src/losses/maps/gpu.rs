//! Losses on feature maps on a GPU.

use super::OPACITY_EPSILON;
use crate::device::{
    DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader, Uniform, WORKGROUP, wgsl_struct,
};

wgsl_struct! {
    /// Settings of the losses on the maps of a view.
    pub(crate) struct MapLosses {
        pixels: u32,
        counted: f32,
        velocity_planes: u32,
        masked: u32,
        velocity_weight: f32,
        lifespan_weight: f32,
        opacity_weight: f32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "maps.wgsl",
        constants: format!("const OPACITY_EPSILON: f32 = {OPACITY_EPSILON:e};\n"),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/workgroup_sum.wgsl"),
            include_str!("maps.wgsl"),
        ],
    }
}

/// Losses on maps of one size.
#[derive(Debug)]
pub(crate) struct Maps {
    temporal_maps: Kernel,
    opacity_map: Kernel,
    settings: Uniform<MapLosses>,
    pixels: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MapLoss {
    /// Velocities and lifespans of all Gaussians.
    Temporal,
    /// Opacity of the dynamic Gaussians drawn alone.
    Opacity,
}

impl Maps {
    pub(crate) fn new(gpu: &Gpu, pixels: usize) -> Result<Self, GpuError> {
        let [temporal_maps, opacity_map] =
            Kernel::compile(gpu, &shader(), ["temporal_maps", "opacity_map"])?;
        Ok(Self {
            temporal_maps,
            opacity_map,
            settings: Uniform::of(gpu, "map losses", &MapLosses::default())?,
            pixels,
        })
    }

    /// Sets the losses for everything that is submitted later.
    pub(crate) fn set(&self, gpu: &Gpu, losses: MapLosses) {
        let pixels = self.pixels as u32;
        self.settings.write(gpu, &MapLosses { pixels, ..losses });
    }

    /// Records the gradients into the planes of `upstream`; returns the buffer of the weighted value's
    /// partial sums.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        loss: MapLoss,
        [image, upstream]: [&DeviceBuffer<f32>; 2],
        target: &DeviceBuffer<u32>,
    ) -> Result<DeviceBuffer<f32>, GpuError> {
        let groups = self.pixels.div_ceil(WORKGROUP as usize);
        let partials = DeviceBuffer::zeros(gpu, "sums of losses on maps", groups)?;
        let kernel = match loss {
            MapLoss::Temporal => &self.temporal_maps,
            MapLoss::Opacity => &self.opacity_map,
        };
        program.run(
            gpu,
            kernel,
            self.pixels,
            &[
                &self.settings.raw,
                &image.raw,
                &target.raw,
                &upstream.raw,
                &partials.raw,
            ],
        );
        Ok(partials)
    }
}
