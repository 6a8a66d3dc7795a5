//! Gaussians of rigid objects on a GPU.
//!
//! For each view the host uploads the given pose of every object. The device applies the corrections, which it
//! trains, and sums their gradients: one workgroup per object reads all Gaussians of the part.

use std::sync::Arc;

use super::{MARGIN, NUMBERS, TrackedGaussians, TrackedObject, wxyz};
use crate::{
    device::{Buffer, DeviceBuffer, Gpu, GpuError, Program, Shader, Uniform, kernels, wgsl_struct},
    gaussians::{
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceRows, DeviceTwin,
            NewDevicePart, PartBuffers,
        },
        parameterization::Viewpoint,
        static_gaussians::{POSITIONS, StaticGaussians},
    },
    parameters::device_table::TableBuffers,
    trajectories::rigid_path::CORRECTION_VALUES,
};

wgsl_struct! {
    /// Gaussians of a part, and the offsets of their arrays.
    pub(crate) struct TrackedRows {
        len: u32,
        first: u32,
        objects: u32,
        positions: u32,
        numbers: u32,
    }

    pub(crate) struct ObjectPlace {
        rotation: [f32; 4],
        centre: [f32; 3],
        unit: f32,
        up: [f32; 3],
        lever: f32,
        limit: [f32; 3],
        share: f32,
        first_correction: u32,
        knots: u32,
        before: u32,
        after: u32,
        is_there: u32,
        pad: [u32; 3],
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "tracked.wgsl",
        constants: format!("const CORRECTION_VALUES: u32 = {CORRECTION_VALUES}u;\n"),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../../device/sin_cos.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("tracked.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels of placement, its VJP and bounds.
    struct TrackedKernels() = shader() => [
        place_objects,
        place_objects_vjp,
        sum_by_object,
        keep_in_boxes,
        fix_gauge,
    ];
}

impl DeviceTwin for TrackedGaussians {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        StaticGaussians.compile(gpu, kernels)?;
        kernels.get(gpu, TrackedKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        Ok(Box::new(TrackedPart::new(self, part)?))
    }

    fn uses_shared(&self, _: &Viewpoint) -> bool {
        self.refines_poses
    }
}

/// Returns an object at a time. `first` is the offset of its corrections, and `applied` are those that the host
/// applies.
fn place(object: &TrackedObject, seconds: f64, first: usize, applied: &[f32]) -> ObjectPlace {
    let path = &object.path;
    let ([before, after], share) = path.between_knots(seconds);
    let absent = ObjectPlace {
        unit: object.unit(),
        up: path.up().to_array(),
        lever: path.lever(),
        limit: object.half_box().map(|half| half * (1.0 + MARGIN)),
        share,
        first_correction: first as u32,
        knots: (path.correction_len() / CORRECTION_VALUES) as u32,
        before: before as u32,
        after: after as u32,
        ..ObjectPlace::default()
    };
    match path.pose(seconds, applied) {
        None => absent,
        Some(pose) => ObjectPlace {
            rotation: wxyz(pose.quaternion),
            centre: pose.centre.to_array(),
            is_there: 1,
            ..absent
        },
    }
}

/// Gaussians of a part with their objects at the current moment.
#[derive(Debug)]
struct TrackedPart {
    own: Box<dyn DeviceParameterization>,
    kernels: Arc<TrackedKernels>,
    objects: Vec<TrackedObject>,
    /// Corrections that the host applies: all if they are not trained, otherwise zeros.
    applied: Vec<f32>,
    uniform: Uniform<TrackedRows>,
    rows: TrackedRows,
    places: DeviceBuffer<ObjectPlace>,
    /// Zeros, for programs without the device's corrections.
    no_corrections: DeviceBuffer<f32>,
    /// Gradient by the pose of its object, per Gaussian.
    by_poses: DeviceBuffer<[f32; 4]>,
}

impl TrackedPart {
    fn new(host: &TrackedGaussians, part: &NewDevicePart<'_>) -> Result<Self, GpuError> {
        let NewDevicePart {
            gpu,
            table,
            entries,
            ..
        } = *part;
        let corrections = &host.corrections.array.values;
        let rows = TrackedRows {
            len: entries.len as u32,
            first: entries.first as u32,
            objects: host.objects.len() as u32,
            positions: table.begin(POSITIONS),
            numbers: table.begin(NUMBERS),
        };
        let count = corrections.len();
        Ok(Self {
            own: StaticGaussians.open(part)?,
            kernels: part.kernels.get(gpu, TrackedKernels::new)?,
            objects: host.objects.clone(),
            applied: if host.refines_poses {
                vec![0.0; count]
            } else {
                corrections.clone()
            },
            uniform: Uniform::of(gpu, "Gaussians of objects", &rows)?,
            rows,
            places: DeviceBuffer::zeros(gpu, "objects", host.objects.len())?,
            no_corrections: DeviceBuffer::zeros(gpu, "no corrections", count)?,
            by_poses: DeviceBuffer::zeros(gpu, "gradients by poses of objects", table.capacity)?,
        })
    }

    /// Returns the corrections that the device applies.
    fn corrections<'a>(&'a self, part: &PartBuffers<'a>) -> &'a Buffer {
        let trained = part.shared.map(|shared| &shared.values);
        &trained.unwrap_or(&self.no_corrections).raw
    }
}

impl DeviceParameterization for TrackedPart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.own.activate(gpu, program, part)?;
        program.run(
            gpu,
            &self.kernels.place_objects,
            &part.rows.rows,
            &[
                &self.uniform.raw,
                &self.places.raw,
                self.corrections(part),
                &part.table.values.raw,
                &part.activated.gaussians.raw,
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
        program.run(
            gpu,
            &self.kernels.place_objects_vjp,
            &part.rows.rows,
            &[
                &self.uniform.raw,
                &self.places.raw,
                self.corrections(part),
                &part.table.values.raw,
                &part.activated.gaussians.raw,
                &part.activated.gaussian_gradients.raw,
                &part.activated.harmonic_gradients.raw,
                &self.by_poses.raw,
            ],
        );
        if let Some(corrections) = part.shared {
            program.run_workgroups(
                gpu,
                &self.kernels.sum_by_object,
                self.objects.len(),
                &[
                    &self.uniform.raw,
                    &self.places.raw,
                    &self.by_poses.raw,
                    &part.table.values.raw,
                    &corrections.gradients.raw,
                ],
            );
        }
        self.own.activate_vjp(gpu, program, part)
    }

    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.own.place(gpu, entries, first_alone);
        self.rows.len = entries.len as u32;
        self.rows.first = entries.first as u32;
        self.uniform.write(gpu, &self.rows);
    }

    fn set_moment(&self, gpu: &Gpu, at: &Viewpoint) {
        self.own.set_moment(gpu, at);
        let mut first = 0;
        let place_next = |object: &TrackedObject| {
            let own = first..first + object.path.correction_len();
            first = own.end;
            place(object, at.seconds, own.start, &self.applied[own])
        };
        let places: Vec<ObjectPlace> = self.objects.iter().map(place_next).collect();
        self.places.write(gpu, 0, &places);
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
            &self.kernels.keep_in_boxes,
            &rows.rows,
            &[
                &self.uniform.raw,
                &self.places.raw,
                &table.values.raw,
                status,
            ],
        );
    }

    fn keep_shared_within_bounds(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        shared: &TableBuffers,
        status: &Buffer,
    ) {
        program.run(
            gpu,
            &self.kernels.fix_gauge,
            self.objects.len() * CORRECTION_VALUES,
            &[
                &self.uniform.raw,
                &self.places.raw,
                &shared.values.raw,
                status,
            ],
        );
    }
}
