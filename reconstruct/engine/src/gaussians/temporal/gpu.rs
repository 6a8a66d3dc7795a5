//! Gaussians with their own times on a GPU: activation, its VJP, and selection of the dynamic ones.

use std::sync::Arc;

use crate::{
    device::{
        Buffer, DeviceBuffer, Gpu, GpuError, Program, Rows, Shader, Uniform, kernels, wgsl_struct,
    },
    gaussians::{
        activated_buffers::ActivatedBuffers,
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceRows, DeviceTwin,
            NewDevicePart, PartBuffers,
        },
        omni4dgs::{LEAST_COSINE, LEAST_DISTANCE, LEAST_WEIGHT, VelocityForm},
        parameterization::Viewpoint,
        periodic::FrameTime,
        static_gaussians::{OPACITY_LOGITS, POSITIONS, StaticGaussians},
        temporal::{
            LOG_LIFESPANS, PEAK_TIMES, RADIAL_VELOCITIES, TANGENTIAL_VELOCITIES, VELOCITIES,
            VelocityModel,
        },
        temporal_gaussians::TemporalGaussians,
    },
    parameters::device_table::TableBuffers,
};

/// Offset of an array that the table lacks.
pub(crate) const NONE: u32 = u32::MAX;

wgsl_struct! {
    /// A table's temporal parameters at a moment.
    pub(crate) struct TemporalView {
        moments: [[f32; 4]; 3],
        observer: [f32; 3],
        shift: f32,
        down: [f32; 3],
        len: u32,
        first: u32,
        first_alone: u32,
        channels: u32,
        positions: u32,
        opacity_logits: u32,
        peaks: u32,
        log_lifespans: u32,
        velocities: u32,
        tangential_velocities: u32,
        velocity_model: u32,
        gamma: f32,
        cycle: f32,
        cycle_high: f32,
        cycle_low: f32,
        log_least: f32,
        log_largest: f32,
        least_marginal: f32,
        dynamic_below: f32,
        velocity_unit: f32,
        lifespan_unit: f32,
        lifespan_largest: f32,
        pad: [u32; 3],
    }
}

/// Returns the constants of the WGSL that reads temporal parameters.
pub(crate) fn table_constants() -> String {
    format!(
        "const TAU: f32 = 6.28318530717959;\n\
         const LEAST_DISTANCE: f32 = {LEAST_DISTANCE:e};\n\
         const LEAST_COSINE: f32 = {LEAST_COSINE:e};\n\
         const LEAST_WEIGHT: f32 = {LEAST_WEIGHT:e};\n"
    )
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "temporal.wgsl",
        constants: table_constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../../device/sin_cos.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("temporal_table.wgsl"),
            include_str!("temporal.wgsl"),
        ],
    }
}

pub(crate) fn dynamic_shader() -> Shader {
    Shader {
        file: "dynamic.wgsl",
        constants: table_constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/sin_cos.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("temporal_table.wgsl"),
            include_str!("dynamic.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels that move and fade Gaussians; they do not depend on their number.
    struct TemporalKernels() = shader() => [
        activate_temporal,
        activate_temporal_vjp,
        keep_within_bounds,
    ];
}

kernels! {
    /// Kernels of the dynamic Gaussians alone.
    struct DynamicKernels() = dynamic_shader() => [gather_dynamic, gather_dynamic_vjp];
}

/// Temporal parameters of a part on a device: their location in its table, and the current viewpoint.
#[derive(Debug)]
pub struct DeviceTime {
    pub(crate) uniform: Uniform<TemporalView>,
    pub(crate) rows: Rows,
    kernels: Arc<TemporalKernels>,
    dynamic: Arc<DynamicKernels>,
    temporal: TemporalGaussians,
    /// Values that do not depend on the viewpoint.
    places: TemporalView,
}

impl DeviceTime {
    fn new(temporal: TemporalGaussians, part: &NewDevicePart<'_>) -> Result<Self, GpuError> {
        let NewDevicePart {
            gpu,
            table,
            features,
            entries,
            ..
        } = *part;
        let host = part.host;
        let place = |name: &str| host.position(name).map_or(NONE, |array| table.begin(array));
        let time = &temporal.time;
        let (velocity_model, gamma) = match time.velocity {
            VelocityModel::None => (0, 0.0),
            VelocityModel::Free => (1, 0.0),
            VelocityModel::Decomposed(decomposition) => match decomposition.form {
                VelocityForm::Literal => (2, decomposition.gamma),
                VelocityForm::Projected => (3, decomposition.gamma),
            },
        };
        let (log_least, log_largest) = time
            .lifespans
            .map_or((0.0, 0.0), |range| range.logarithms());
        let cycle_high = f32::from_bits(time.cycle_frames.to_bits() & 0xffff_f000);
        let places = TemporalView {
            len: entries.len as u32,
            first: entries.first as u32,
            first_alone: part.first_alone as u32,
            channels: features.count() as u32,
            positions: table.begin(POSITIONS),
            opacity_logits: table.begin(OPACITY_LOGITS),
            peaks: place(PEAK_TIMES),
            log_lifespans: place(LOG_LIFESPANS),
            velocities: place(VELOCITIES).min(place(RADIAL_VELOCITIES)),
            tangential_velocities: place(TANGENTIAL_VELOCITIES),
            velocity_model,
            gamma,
            cycle: time.cycle_frames,
            cycle_high,
            cycle_low: time.cycle_frames - cycle_high,
            log_least,
            log_largest,
            least_marginal: time.least_marginal,
            dynamic_below: temporal.dynamic_below_staticness,
            velocity_unit: features.velocity_unit.unwrap_or(0.0),
            lifespan_unit: features.lifespan.map_or(0.0, |feature| feature.unit_frames),
            lifespan_largest: features
                .lifespan
                .map_or(0.0, |feature| feature.largest_frames),
            ..TemporalView::default()
        };
        Ok(Self {
            uniform: Uniform::of(gpu, "temporal parameters", &places)?,
            rows: part.rows.rows.clone(),
            kernels: part.kernels.get(gpu, TemporalKernels::new)?,
            dynamic: part.kernels.get(gpu, DynamicKernels::new)?,
            temporal,
            places,
        })
    }

    /// Changes the entries; takes effect with the next [`DeviceTime::set`].
    pub(crate) fn place(&mut self, entries: DeviceEntries, first_alone: usize) {
        self.places.len = entries.len as u32;
        self.places.first = entries.first as u32;
        self.places.first_alone = first_alone as u32;
    }

    /// Returns the offset of peak times in the table, in values; [`NONE`] without them.
    pub(crate) fn peaks(&self) -> u32 {
        self.places.peaks
    }

    /// Sets the viewpoint for everything that is submitted later.
    pub(crate) fn set(&self, gpu: &Gpu, at: &Viewpoint) {
        let look = self.temporal.look(at);
        let cycle = f64::from(self.temporal.time.cycle_frames);
        let moment = |exact: f64| {
            let (frame, cycles) = (exact as f32, exact / cycle);
            let rest = (exact - f64::from(frame)) as f32;
            [frame, rest, (cycles - cycles.round()) as f32, 0.0]
        };
        let FrameTime { frame, shift } = look.frame_time;
        let moment = TemporalView {
            moments: [frame - f64::from(shift), frame, frame + 1.0].map(moment),
            observer: look.observer.centre.to_array(),
            shift,
            down: look.observer.down.to_array(),
            ..self.places
        };
        self.uniform.write(gpu, &moment);
    }

    /// Records copies of the part's Gaussians into `alone`, static ones with opacity 0, and counts the dynamic
    /// ones.
    pub(crate) fn gather_dynamic(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        [all, alone]: [&ActivatedBuffers; 2],
        member_count: &DeviceBuffer<u32>,
    ) {
        program.run(
            gpu,
            &self.dynamic.gather_dynamic,
            &self.rows,
            &[
                &self.uniform.raw,
                &table.values.raw,
                &all.gaussians.raw,
                &all.harmonics.raw,
                &alone.gaussians.raw,
                &alone.harmonics.raw,
                &member_count.raw,
            ],
        );
    }

    /// Records the VJP of [`DeviceTime::gather_dynamic`]: adds to the gradient by all.
    pub(crate) fn gather_dynamic_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        [all, alone]: [&ActivatedBuffers; 2],
    ) {
        program.run(
            gpu,
            &self.dynamic.gather_dynamic_vjp,
            &self.rows,
            &[
                &self.uniform.raw,
                &alone.gaussian_gradients.raw,
                &alone.harmonic_gradients.raw,
                &all.gaussian_gradients.raw,
                &all.harmonic_gradients.raw,
            ],
        );
    }
}

impl DeviceTwin for TemporalGaussians {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        StaticGaussians.compile(gpu, kernels)?;
        kernels.get(gpu, TemporalKernels::new)?;
        kernels.get(gpu, DynamicKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        Ok(Box::new(TemporalPart {
            canonical: StaticGaussians.open(part)?,
            time: DeviceTime::new(*self, part)?,
        }))
    }
}

/// Gaussians of a part with their own times at the current viewpoint.
#[derive(Debug)]
struct TemporalPart {
    canonical: Box<dyn DeviceParameterization>,
    time: DeviceTime,
}

impl DeviceParameterization for TemporalPart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.canonical.activate(gpu, program, part)?;
        program.run(
            gpu,
            &self.time.kernels.activate_temporal,
            &part.rows.rows,
            &[
                &self.time.uniform.raw,
                &part.table.values.raw,
                &part.activated.gaussians.raw,
                &part.activated.features.raw,
            ],
        );
        Ok(())
    }

    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.canonical.activate_vjp(gpu, program, part)?;
        program.run(
            gpu,
            &self.time.kernels.activate_temporal_vjp,
            &part.rows.rows,
            &[
                &self.time.uniform.raw,
                &part.table.values.raw,
                &part.activated.gaussian_gradients.raw,
                &part.activated.feature_gradients.raw,
                &part.table.gradients.raw,
            ],
        );
        Ok(())
    }

    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.canonical.place(gpu, entries, first_alone);
        self.time.place(entries, first_alone);
    }

    fn set_moment(&self, gpu: &Gpu, at: &Viewpoint) {
        self.time.set(gpu, at);
    }

    fn keep_within_bounds(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        (table, rows): (&TableBuffers, &DeviceRows),
        status: &Buffer,
    ) {
        program.run(
            gpu,
            &self.time.kernels.keep_within_bounds,
            &rows.rows,
            &[&self.time.uniform.raw, &table.values.raw, status],
        );
    }

    fn time(&self) -> Option<&DeviceTime> {
        Some(&self.time)
    }
}
