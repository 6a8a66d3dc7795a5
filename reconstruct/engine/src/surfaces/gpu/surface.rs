//! One surface in GPU memory: textures, fields, and samples of a batch.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::{SAMPLE_VALUES, SurfaceKernels};
use crate::{
    device::{Buffer, DeviceBuffer, Gpu, GpuError, Program, Rows, Threads, Uniform, wgsl_struct},
    fields::{
        grid_field::{
            GridField,
            gpu::{DeviceField, FieldStep},
        },
        hash_grid::gpu::{GridScratch, PositionGradients},
        mlp::{gpu::NetworkBuffers, network::NetworkShape},
    },
    surfaces::texture::Texture,
    trajectories::catmull_rom::KnotWeights,
};

/// Numbers of the fields of a surface.
const COLOUR: usize = 0;
const OPACITY: usize = 1;
const FLOW: usize = 2;
const VIEW: usize = 3;

wgsl_struct! {
    /// Sizes of a surface, and its place among all layers.
    pub(crate) struct SurfaceUniform {
        samples: u32,
        first: u32,
        dimensions: u32,
        has_opacity: u32,
        colour_outputs: u32,
        opacity_outputs: u32,
        flow_outputs: u32,
        view_outputs: u32,
        colour_size: [u32; 2],
        opacity_size: [u32; 2],
    }

    /// A hit of a surface.
    pub struct SurfaceSample {
        place: [f32; 3],
        moment: u32,
        angle: [f32; 2],
        pad: [u32; 2],
    }

    /// Control points of a flow at a moment.
    pub(crate) struct MomentKnots {
        knots: [u32; 4],
        weights: [f32; 4],
    }
}

impl SurfaceSample {
    /// Creates a sample at a place: `uv` on a plane followed by 0, or a unit direction on the sphere. `moment` is
    /// the number of its moment, `angle` the view angle in radians (unused on the sphere).
    pub fn new(place: DVec3, moment: usize, angle: DVec2) -> Self {
        Self {
            place: place.as_vec3().to_array(),
            moment: moment as u32,
            angle: (angle / TAU + 0.5).as_vec2().to_array(),
            pad: [0; 2],
        }
    }
}

/// Surface to upload.
#[derive(Debug, Clone, Copy)]
pub struct NewSurface<'a> {
    /// 2 on a plane, 3 on the sphere.
    pub dimensions: usize,
    /// Base colours.
    pub colour: &'a Texture<3>,
    /// Base opacities of a plane; `None` for an opaque surface.
    pub opacity: Option<&'a Texture<1>>,
    /// Fields of colour, opacity, flow and view, in this order.
    pub fields: [Option<&'a GridField>; 4],
}

/// Memory of the networks of each kind of field, which the surfaces use one after another. `None` for a kind that at
/// most one surface has: its activations are kept.
#[derive(Debug)]
pub(super) struct Networks([Option<NetworkBuffers>; 4]);

impl Networks {
    /// Allocates memory for the largest network of each kind, and `room` rows.
    pub(super) fn new(
        gpu: &Gpu,
        surfaces: &[NewSurface<'_>],
        room: usize,
    ) -> Result<Self, GpuError> {
        let of_kind = |number: usize| {
            let fields = surfaces.iter().filter_map(|surface| surface.fields[number]);
            let shapes: Vec<NetworkShape> = fields.map(GridField::network).collect();
            let largest = shapes.iter().copied().reduce(|a, b| NetworkShape {
                row_inputs: a.row_inputs.max(b.row_inputs),
                depth: a.depth.max(b.depth),
                width: a.width.max(b.width),
                outputs: a.outputs.max(b.outputs),
                ..a
            });
            let shared = largest.filter(|_| shapes.len() > 1);
            let allocate = |shape| NetworkBuffers::new(gpu, shape, room);
            shared.map(allocate).transpose()
        };
        Ok(Self([
            of_kind(COLOUR)?,
            of_kind(OPACITY)?,
            of_kind(FLOW)?,
            of_kind(VIEW)?,
        ]))
    }

    fn of(
        &self,
        gpu: &Gpu,
        number: usize,
        shape: NetworkShape,
        room: usize,
    ) -> Result<NetworkBuffers, GpuError> {
        match &self.0[number] {
            Some(memory) => memory.sharing(gpu, shape),
            None => NetworkBuffers::new(gpu, shape, room),
        }
    }
}

/// A field, or stand-ins for its buffers: every binding of a kernel needs a buffer.
#[derive(Debug)]
struct Slot {
    field: Option<DeviceField>,
    stand_ins: [DeviceBuffer<f32>; 3],
    outputs: u32,
}

impl Slot {
    fn new(
        gpu: &Gpu,
        (field, networks): (Option<&GridField>, &Networks),
        (room, number): (usize, usize),
        by_positions: &PositionGradients,
    ) -> Result<Self, GpuError> {
        let upload = |field: &GridField| {
            let network = networks.of(gpu, number, field.network(), room)?;
            DeviceField::new(gpu, (field, network), (room, number), by_positions)
        };
        let stand_in = || DeviceBuffer::zeros(gpu, "no field", 4);
        Ok(Self {
            field: field.map(upload).transpose()?,
            stand_ins: [stand_in()?, stand_in()?, stand_in()?],
            outputs: field.map_or(0, |field| field.shape().outputs as u32),
        })
    }

    fn outputs(&self) -> &Buffer {
        let field = self.field.as_ref();
        field.map_or(&self.stand_ins[0].raw, DeviceField::outputs)
    }

    fn upstream(&self) -> &Buffer {
        let field = self.field.as_ref();
        field.map_or(&self.stand_ins[1].raw, DeviceField::upstream)
    }

    fn positions(&self) -> &Buffer {
        let field = self.field.as_ref();
        field.map_or(&self.stand_ins[2].raw, |field| &field.positions.raw)
    }
}

/// A surface with room for a number of samples.
#[derive(Debug)]
pub(super) struct DeviceSurface {
    uniform: Uniform<SurfaceUniform>,
    sizes: SurfaceUniform,
    rows: Rows,
    texels: DeviceBuffer<f32>,
    slots: [Slot; 4],
    samples: DeviceBuffer<SurfaceSample>,
    moments: DeviceBuffer<MomentKnots>,
    queries: DeviceBuffer<[f32; 4]>,
    flows: DeviceBuffer<[f32; 4]>,
    appearances: DeviceBuffer<[f32; 16]>,
    /// Gradients by the samples, [`SAMPLE_VALUES`] each.
    pub(super) by_samples: DeviceBuffer<f32>,
}

impl DeviceSurface {
    /// Uploads a surface, with room for samples and moments.
    pub(super) fn new(
        gpu: &Gpu,
        (surface, networks): (&NewSurface<'_>, &Networks),
        [room, moments]: [usize; 2],
    ) -> Result<Self, GpuError> {
        let size = |width: usize, height: usize| [width as u32, height as u32];
        let sizes = SurfaceUniform {
            dimensions: surface.dimensions as u32,
            has_opacity: surface.opacity.is_some().into(),
            colour_size: size(surface.colour.width, surface.colour.height),
            opacity_size: surface
                .opacity
                .map_or([1; 2], |texture| size(texture.width, texture.height)),
            ..SurfaceUniform::default()
        };
        let mut texels = surface.colour.texels.as_flattened().to_vec();
        if let Some(opacity) = surface.opacity {
            texels.extend(opacity.texels.as_flattened());
        }
        let scale = if surface.dimensions == 2 { 1.0 } else { 0.5 };
        let slot = |number: usize| {
            let by_place = PositionGradients {
                width: SAMPLE_VALUES,
                places: [0, 1, 2, 3],
                scales: [scale; 4],
            };
            let per_turn = (1.0 / TAU) as f32;
            let by_positions = if number == VIEW {
                PositionGradients {
                    places: [0, 1, 3, 4],
                    scales: [1.0, 1.0, per_turn, per_turn],
                    ..by_place
                }
            } else {
                by_place
            };
            let field = (surface.fields[number], networks);
            Slot::new(gpu, field, (room, number), &by_positions)
        };
        Ok(Self {
            uniform: Uniform::of(gpu, "surface", &sizes)?,
            sizes,
            rows: Rows::new(0),
            texels: DeviceBuffer::of(gpu, "texels of a surface", &texels)?,
            slots: [slot(COLOUR)?, slot(OPACITY)?, slot(FLOW)?, slot(VIEW)?],
            samples: DeviceBuffer::zeros(gpu, "samples of a surface", room)?,
            moments: DeviceBuffer::zeros(gpu, "moments of a surface", moments)?,
            queries: DeviceBuffer::zeros(gpu, "queries of a surface", room)?,
            flows: DeviceBuffer::zeros(gpu, "flow of samples", room)?,
            appearances: DeviceBuffer::zeros(gpu, "appearance of samples", room)?,
            by_samples: DeviceBuffer::zeros(gpu, "gradients by samples", room * SAMPLE_VALUES)?,
        })
    }

    /// Sets the samples for everything that is submitted later. `first` is the number of their first layer;
    /// `in_use` are the features in use of each evaluated field.
    pub(super) fn place(
        &mut self,
        gpu: &Gpu,
        (samples, first): (&[SurfaceSample], usize),
        knots: &[KnotWeights],
        in_use: &[Option<usize>; 4],
    ) {
        self.samples.write(gpu, 0, samples);
        let moments: Vec<MomentKnots> = knots
            .iter()
            .map(|at| MomentKnots {
                knots: at.knots.map(|knot| knot as u32),
                weights: at.weights.map(|weight| weight as f32),
            })
            .collect();
        self.moments.write(gpu, 0, &moments);
        self.rows.set(samples.len());
        let mut outputs = [0; 4];
        for ((slot, in_use), outputs) in self.slots.iter_mut().zip(in_use).zip(&mut outputs) {
            if let Some(field) = &mut slot.field {
                // A field that is not evaluated has no rows.
                let rows = if in_use.is_some() { samples.len() } else { 0 };
                field.place(gpu, rows, in_use.unwrap_or(0));
                *outputs = if in_use.is_some() { slot.outputs } else { 0 };
            }
        }
        let [colour_outputs, opacity_outputs, flow_outputs, view_outputs] = outputs;
        let sizes = SurfaceUniform {
            samples: samples.len() as u32,
            first: first as u32,
            colour_outputs,
            opacity_outputs,
            flow_outputs,
            view_outputs,
            ..self.sizes
        };
        self.uniform.write(gpu, &sizes);
    }

    /// Sets the next step of each field; without one, its parameters stay as they are.
    pub(super) fn set_steps(&self, gpu: &Gpu, steps: &[Option<FieldStep>; 4]) {
        for (slot, step) in self.slots.iter().zip(steps) {
            if let Some(field) = &slot.field {
                field.set_step(gpu, step.as_ref());
            }
        }
    }

    /// Records the layers of its samples.
    pub(super) fn forward(
        &self,
        (gpu, kernels): (&Gpu, &SurfaceKernels),
        program: &mut Program,
        layers: &Buffer,
    ) -> Result<(), GpuError> {
        let [colour, opacity, flow, view] = &self.slots;
        let uniform = &self.uniform.raw;
        if let Some(field) = &flow.field {
            program.run(
                gpu,
                &kernels.place_samples,
                Threads::ForRows(&self.rows, self.sizes.dimensions as usize),
                &[uniform, &self.samples.raw, flow.positions()],
            );
            field.forward((gpu, &kernels.fields), program)?;
        }
        program.run(
            gpu,
            &kernels.move_samples,
            &self.rows,
            &[
                uniform,
                &self.samples.raw,
                &self.moments.raw,
                flow.outputs(),
                &self.queries.raw,
                colour.positions(),
                opacity.positions(),
                view.positions(),
                &self.flows.raw,
            ],
        );
        for slot in [colour, opacity, view] {
            if let Some(field) = &slot.field {
                field.forward((gpu, &kernels.fields), program)?;
            }
        }
        program.run(
            gpu,
            &kernels.shade,
            &self.rows,
            &[
                uniform,
                &self.queries.raw,
                &self.texels.raw,
                colour.outputs(),
                opacity.outputs(),
                view.outputs(),
                layers,
                &self.appearances.raw,
            ],
        );
        Ok(())
    }

    /// Records the gradients by its samples and fields from those by its layers.
    pub(super) fn backward(
        &self,
        (gpu, kernels): (&Gpu, &SurfaceKernels),
        program: &mut Program,
        by_layers: &Buffer,
        scratch: &GridScratch,
    ) -> Result<(), GpuError> {
        let [colour, opacity, flow, view] = &self.slots;
        let (uniform, by_samples) = (&self.uniform.raw, &self.by_samples.raw);
        program.run(
            gpu,
            &kernels.shade_vjp,
            &self.rows,
            &[
                uniform,
                &self.appearances.raw,
                by_layers,
                colour.upstream(),
                opacity.upstream(),
                view.upstream(),
                by_samples,
            ],
        );
        for slot in [colour, opacity, view] {
            if let Some(field) = &slot.field {
                field.backward((gpu, &kernels.fields), program, scratch, by_samples)?;
            }
        }
        if let Some(field) = &flow.field {
            program.run(
                gpu,
                &kernels.move_samples_vjp,
                &self.rows,
                &[
                    uniform,
                    &self.samples.raw,
                    &self.moments.raw,
                    &self.flows.raw,
                    flow.upstream(),
                    by_samples,
                ],
            );
            field.backward((gpu, &kernels.fields), program, scratch, by_samples)?;
        }
        Ok(())
    }

    /// Records the steps of its fields, which [`DeviceSurface::set_steps`] sets.
    pub(super) fn step(
        &self,
        (gpu, kernels): (&Gpu, &SurfaceKernels),
        program: &mut Program,
        status: &Buffer,
    ) {
        for field in self.slots.iter().filter_map(|slot| slot.field.as_ref()) {
            field.step((gpu, &kernels.fields), program, status);
        }
    }

    /// Copies a field's parameters and moments back. A field that the surface lacks stays as it is.
    pub(super) fn read(
        &self,
        gpu: &Gpu,
        number: usize,
        field: &mut GridField,
    ) -> Result<(), GpuError> {
        match &self.slots[number].field {
            Some(on_device) => on_device.read(gpu, field),
            None => Ok(()),
        }
    }
}
