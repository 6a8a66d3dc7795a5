//! Buffers between the stages of a render, in GPU memory.

use std::cell::Cell;

use crate::camera::{CONE_RHO, CONE_WIDTH, CameraKernels, LOW_PASS, pinhole::SLOPE_MARGIN};
use crate::device::{DeviceBuffer, Gpu, GpuError, Rows, Uniform, wgsl_struct};
use crate::render::settings::{ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN};
use crate::{
    camera::{Camera, View, rays::Rays},
    gaussians::activated_buffers::ActivatedBuffers,
    render::{
        settings::{Footprint, RenderSettings},
        sort::gpu::{PairBuffers, Pairs},
    },
};

wgsl_struct! {
    /// Camera and all other inputs of a render's kernels; `View` in WGSL.
    pub(crate) struct ViewUniform {
        rotation: [[f32; 4]; 3],
        centre: [f32; 3],
        near: f32,
        focal: [f32; 2],
        principal: [f32; 2],
        width: u32,
        height: u32,
        camera: u32,
        stored_sh_degree: u32,
        sh_degree: u32,
        gaussians: u32,
        entry_capacity: u32,
        footprint: u32,
        background: [f32; 3],
        angular_low_pass: f32,
    }

    /// A Gaussian in image coordinates; `Splat` in WGSL.
    pub(crate) struct DeviceSplat {
        centre: [f32; 2],
        extent: [f32; 2],
        first: [f32; 3],
        opacity: f32,
        second: [f32; 3],
        depth_variance: f32,
        third: [f32; 3],
        shape: u32,
    }

    /// Status of the device's training steps; `Status` in WGSL.
    pub(crate) struct DeviceStatus {
        halted: u32,
        steps: u32,
        entries: u32,
        refused: [u32; 16],
    }
}

/// Side of a tile on the device, pixels: one thread per pixel.
pub(crate) const TILE: usize = 16;

/// Status of a running device; see `status.wgsl`.
pub(crate) const HALTED_RUNNING: u32 = 0;
/// Status after a view with more tile entries than the buffers hold.
pub(crate) const HALTED_FULL: u32 = 1;

/// Initial capacity of tile entries per Gaussian.
const ENTRIES_PER_GAUSSIAN: usize = 4;

/// Bits of distances as sort keys.
pub(crate) const DISTANCE_BITS: u32 = 32;

/// Numbers that determine the sizes of buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RenderShape {
    /// Capacity in Gaussians.
    pub(crate) gaussians: usize,
    /// Degree of the stored harmonics.
    pub(crate) sh_degree: usize,
    /// Feature channels.
    pub(crate) features: usize,
    /// Pixels per row.
    pub(crate) width: usize,
    /// Rows of pixels.
    pub(crate) height: usize,
    /// Capacity in (splat, tile) pairs.
    pub(crate) entries: usize,
}

impl RenderShape {
    /// Returns the initial capacity in entries.
    pub(crate) fn first_entries(gaussians: usize) -> usize {
        gaussians * ENTRIES_PER_GAUSSIAN
    }

    pub(crate) fn channels(&self) -> usize {
        3 + self.features
    }

    pub(crate) fn pixels(&self) -> usize {
        self.width * self.height
    }

    pub(crate) fn tiles(&self) -> usize {
        self.width.div_ceil(TILE) * self.height.div_ceil(TILE)
    }

    /// Returns the bits of the tiles' indices.
    pub(crate) fn tile_bits(&self) -> u32 {
        (usize::BITS - (self.tiles() - 1).leading_zeros()).max(1)
    }

    /// Returns the values of an image on the device: colour, transmittance, features.
    pub(crate) fn image_values(&self) -> usize {
        self.pixels() * (1 + self.channels())
    }

    /// Returns the values that an entry sums over its pixels: eleven moments and the channels.
    pub(crate) fn entry_sums(&self) -> usize {
        11 + self.channels()
    }

    /// Returns the values of a splat's gradient: a mark, shape (10), opacity, image of the centre (2),
    /// channels.
    pub(crate) fn splat_sums(&self) -> usize {
        14 + self.channels()
    }

    /// Returns the bytes of the largest buffer that grows with the Gaussians.
    pub(crate) fn largest_buffer(&self) -> usize {
        let harmonics = 3 * (self.sh_degree + 1) * (self.sh_degree + 1);
        let of_gaussians = self.gaussians * harmonics.max(self.splat_sums());
        size_of::<f32>() * of_gaussians.max(self.entries * self.entry_sums())
    }

    /// Returns the constants of the render kernels, shared with Rust.
    pub(crate) fn constants(&self) -> String {
        let shared = format!(
            "const ALPHA_MIN: f32 = {ALPHA_MIN:e};\n\
             const ALPHA_MAX: f32 = {ALPHA_MAX:e};\n\
             const TRANSMITTANCE_MIN: f32 = {TRANSMITTANCE_MIN:e};\n\
             const LOW_PASS: f32 = {LOW_PASS:e};\n\
             const CONE_RHO: f32 = {CONE_RHO:e};\n\
             const CONE_WIDTH: f32 = {CONE_WIDTH:e};\n\
             const SLOPE_MARGIN: f32 = {SLOPE_MARGIN:e};\n\
             const TILE: u32 = {TILE}u;\n"
        );
        shared
            + &format!(
                "const CHANNELS: u32 = {}u;\nconst ENTRY_SUMS: u32 = {}u;\nconst SUMS: u32 = {}u;\n",
                self.channels(),
                self.entry_sums(),
                self.splat_sums()
            )
    }
}

#[derive(Debug)]
pub(crate) struct RenderBuffers {
    pub(crate) shape: RenderShape,
    /// Current number of Gaussians.
    pub(crate) rows: Rows,
    pub(crate) view: Uniform<ViewUniform>,
    pub(crate) status: DeviceBuffer<DeviceStatus>,
    pub(crate) activated: ActivatedBuffers,
    pub(crate) splats: DeviceBuffer<DeviceSplat>,
    pub(crate) channels: DeviceBuffer<f32>,
    /// Distances and indices of the splats.
    pub(crate) by_distance: Pairs,
    /// One number: Gaussians.
    pub(crate) gaussian_count: DeviceBuffer<u32>,
    pub(crate) entry_starts: DeviceBuffer<u32>,
    /// One number: entries.
    pub(crate) entry_count: DeviceBuffer<u32>,
    /// Numbers of workgroups of the kernels over entries; see `bin.wgsl`.
    pub(crate) entry_workgroups: DeviceBuffer<u32>,
    /// Tiles and indices of the entries.
    pub(crate) by_tile: Pairs,
    pub(crate) entry_splats: DeviceBuffer<u32>,
    pub(crate) tile_ranges: DeviceBuffer<[u32; 2]>,
    /// Splats and indices of the entries, tile by tile.
    pub(crate) items: DeviceBuffer<[u32; 2]>,
    /// Rays of the pixels; see `rays.wgsl`.
    pub(crate) rays: DeviceBuffer<[f32; 2]>,
    rays_of: Cell<Option<Camera>>,
    pub(crate) image: DeviceBuffer<f32>,
    pub(crate) entry_sums: DeviceBuffer<f32>,
    pub(crate) splat_gradients: DeviceBuffer<f32>,
}

impl RenderBuffers {
    /// Allocates buffers for renders that share `status`, by which all of them halt.
    pub(crate) fn new(
        gpu: &Gpu,
        (shape, gaussians): (RenderShape, usize),
        status: DeviceBuffer<DeviceStatus>,
    ) -> Result<Self, GpuError> {
        let len = shape.gaussians;
        let splat_sums = len * shape.splat_sums();
        let entry_sums = shape.entries * shape.entry_sums();
        Ok(Self {
            shape,
            rows: Rows::new(gaussians),
            view: Uniform::of(gpu, "view", &ViewUniform::default())?,
            status,
            activated: ActivatedBuffers::new(gpu, len, shape.sh_degree, shape.features)?,
            splats: DeviceBuffer::zeros(gpu, "splats", len)?,
            channels: DeviceBuffer::zeros(gpu, "channels", len * shape.channels())?,
            by_distance: Pairs::new(gpu, len)?,
            gaussian_count: DeviceBuffer::of(gpu, "count of Gaussians", &[gaussians as u32])?,
            entry_starts: DeviceBuffer::zeros(gpu, "entry starts", len + 1)?,
            entry_count: DeviceBuffer::zeros(gpu, "count of entries", 1)?,
            entry_workgroups: DeviceBuffer::indirect(gpu, "workgroups of entries", 6)?,
            by_tile: Pairs::new(gpu, shape.entries)?,
            entry_splats: DeviceBuffer::zeros(gpu, "splats of entries", shape.entries)?,
            tile_ranges: DeviceBuffer::zeros(gpu, "tile ranges", shape.tiles())?,
            items: DeviceBuffer::zeros(gpu, "tile lists", shape.entries)?,
            rays: DeviceBuffer::zeros(gpu, "rays", shape.width + shape.height)?,
            rays_of: Cell::new(None),
            image: DeviceBuffer::zeros(gpu, "image", shape.image_values())?,
            entry_sums: DeviceBuffer::zeros(gpu, "entry sums", entry_sums)?,
            splat_gradients: DeviceBuffer::zeros(gpu, "gradients by splats", splat_sums)?,
        })
    }

    /// Returns distances and indices of the splats, near to far.
    pub(crate) fn by_rank(&self) -> PairBuffers<'_> {
        self.by_distance.sorted(DISTANCE_BITS)
    }

    /// Sets the number of Gaussians for everything that is submitted later.
    pub(crate) fn set_rows(&self, gpu: &Gpu, gaussians: usize) {
        assert!(gaussians <= self.shape.gaussians, "no room");
        self.rows.set(gaussians);
        self.gaussian_count.write(gpu, 0, &[gaussians as u32]);
    }

    /// Sets the view for everything that is submitted later.
    pub(crate) fn set_view(&self, gpu: &Gpu, view: &View, settings: &RenderSettings) {
        let rows = view.rotation.transpose().to_cols_array_2d();
        let (camera, focal, principal) = match view.camera {
            Camera::Erp(_) => (0, [0.0; 2], [0.0; 2]),
            Camera::Pinhole(camera) => (
                1,
                [camera.fx as f32, camera.fy as f32],
                [camera.cx as f32, camera.cy as f32],
            ),
        };
        if self.rays_of.replace(Some(view.camera)) != Some(view.camera) {
            self.rays.write(gpu, 0, &packed_rays(view.camera));
        }
        let shape = &self.shape;
        self.view.write(
            gpu,
            &ViewUniform {
                rotation: rows.map(|[x, y, z]| [x, y, z, 0.0]),
                centre: view.centre.to_array(),
                near: settings.near,
                focal,
                principal,
                width: view.camera.width(),
                height: view.camera.height(),
                camera,
                stored_sh_degree: shape.sh_degree as u32,
                sh_degree: settings.sh_degree.min(shape.sh_degree) as u32,
                gaussians: self.rows.get() as u32,
                entry_capacity: shape.entries as u32,
                footprint: match settings.footprint {
                    Footprint::Projected => 0,
                    Footprint::Ray => 1,
                },
                background: settings.background,
                angular_low_pass: view.camera.angular_low_pass(),
            },
        );
    }
}

/// Returns `(x, z)` of every column, then `(scale, y)` of every row.
fn packed_rays(camera: Camera) -> Vec<[f32; 2]> {
    let rays = Rays::new(camera);
    let columns = rays.x.iter().zip(&rays.z).take(camera.width() as usize);
    let rows = rays.scale.iter().zip(&rays.y);
    columns.chain(rows).map(|(&a, &b)| [a, b]).collect()
}
