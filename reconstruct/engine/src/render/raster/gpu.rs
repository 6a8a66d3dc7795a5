//! Rasterization on a GPU.

use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Kernel, PixelSums, Program, Shader, WORKGROUP},
    render::buffers::{DeviceSplat, RenderBuffers, RenderShape},
};

/// Workgroup memory of the backward pass with subgroups, bytes; 256 are reserved for counters, up to the
/// limit of every adapter.
const MEMORY: usize = 16 * 1024 - 256;
/// Splats that a workgroup stages.
const BATCH: usize = 64;
/// Maximum number of splats between two barriers.
const LONGEST_ROUND: usize = 8;

/// Returns the kernels, whose backward pass sums over pixels in this form.
pub(crate) fn shader(shape: &RenderShape, sums: PixelSums) -> Shader {
    let (constants, parts) = match sums {
        PixelSums::Subgroups(size) => (subgroup_constants(shape, size), SUBGROUP_PARTS),
        PixelSums::Workgroups => (String::new(), WORKGROUP_PARTS),
        PixelSums::Splats => (String::new(), SPLAT_PARTS),
    };
    Shader {
        file: "raster.wgsl",
        constants: shape.constants() + &constants,
        parts,
    }
}

fn subgroup_constants(shape: &RenderShape, size: u32) -> String {
    let subgroups = WORKGROUP.div_ceil(size) as usize;
    let staged = BATCH * (size_of::<DeviceSplat>() + shape.channels() * size_of::<f32>());
    let sums_of_splat = subgroups * (shape.entry_sums() * size_of::<f32>() + size_of::<u32>());
    let fitting = MEMORY.saturating_sub(staged) / (2 * sums_of_splat);
    // A power of two, so that rounds fill a batch.
    let round = 1 << fitting.clamp(1, LONGEST_ROUND).ilog2();
    format!("const SUBGROUPS: u32 = {subgroups}u;\nconst ROUND: u32 = {round}u;\n")
}

macro_rules! parts {
    ($way_back:literal) => {
        &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/arc_tangent.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../camera/rays.wgsl"),
            include_str!("../project/splat.wgsl"),
            include_str!("tile.wgsl"),
            include_str!("raster.wgsl"),
            include_str!($way_back),
        ]
    };
}

const SUBGROUP_PARTS: &[&str] = parts!("raster_vjp_subgroups.wgsl");
const WORKGROUP_PARTS: &[&str] = parts!("raster_vjp.wgsl");
const SPLAT_PARTS: &[&str] = parts!("raster_vjp_splats.wgsl");

/// Kernels from tile lists to an image, and their backward pass.
#[derive(Debug)]
pub(crate) struct Rasterization {
    composite: Kernel,
    composite_vjp: Kernel,
    sum_entries: Kernel,
}

impl Rasterization {
    pub(crate) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [composite, composite_vjp, sum_entries] = Kernel::compile(
            gpu,
            &shader(shape, gpu.pixel_sums()),
            ["composite", "composite_vjp", "sum_entries"],
        )?;
        Ok(Self {
            composite,
            composite_vjp,
            sum_entries,
        })
    }

    pub(crate) fn forward(&self, gpu: &Gpu, program: &mut Program, buffers: &RenderBuffers) {
        program.run_workgroups(
            gpu,
            &self.composite,
            buffers.shape.tiles(),
            &[
                &buffers.view.raw,
                &buffers.tile_ranges.raw,
                &buffers.items.raw,
                &buffers.rays.raw,
                &buffers.splats.raw,
                &buffers.channels.raw,
                &buffers.image.raw,
            ],
        );
    }

    /// Records gradients by the splats from the gradient by the image, which has the layout of the image.
    pub(crate) fn backward(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
        upstream: &DeviceBuffer<f32>,
    ) {
        program.run_workgroups(
            gpu,
            &self.composite_vjp,
            buffers.shape.tiles(),
            &[
                &buffers.view.raw,
                &buffers.tile_ranges.raw,
                &buffers.items.raw,
                &buffers.rays.raw,
                &buffers.splats.raw,
                &buffers.channels.raw,
                &buffers.image.raw,
                &upstream.raw,
                &buffers.entry_sums.raw,
            ],
        );
        let by_rank = buffers.by_rank();
        program.run(
            gpu,
            &self.sum_entries,
            &buffers.rows,
            &[
                &buffers.view.raw,
                &by_rank.keys.raw,
                &by_rank.items.raw,
                &buffers.entry_starts.raw,
                &buffers.splats.raw,
                &buffers.entry_sums.raw,
                &buffers.splat_gradients.raw,
            ],
        );
    }
}
