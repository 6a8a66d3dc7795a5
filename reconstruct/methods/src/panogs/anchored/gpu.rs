//! Centres near their anchors on a GPU.

use std::sync::Arc;

use omnilife_engine::{
    device::{
        Buffer, COMMON_WGSL, DeviceBuffer, Gpu, GpuError, Kernel, Program, STATUS_WGSL, Shader,
        Uniform,
    },
    gaussians::{
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceRows, DeviceTwin,
            NewDevicePart, PartBuffers,
        },
        parameterization::Viewpoint,
        static_gaussians::{POSITIONS, StaticGaussians},
    },
    losses::scaffold::gpu::{DeviceScaffold, DeviceScaffoldLoss, ScaffoldCentres},
    parameters::device_table::TableBuffers,
};

use super::{Anchored, CentreRefinement, ScaffoldWeight};

/// Kernels of the gradients and the bounds of centres.
#[derive(Debug)]
struct AnchoredKernels {
    hold_centres: Kernel,
    keep_near_anchors: Kernel,
}

impl AnchoredKernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = Shader {
            file: "anchored.wgsl",
            constants: String::new(),
            parts: &[COMMON_WGSL, STATUS_WGSL, include_str!("anchored.wgsl")],
        };
        let [hold_centres, keep_near_anchors] =
            Kernel::compile(gpu, &shader, ["hold_centres", "keep_near_anchors"])?;
        Ok(Self {
            hold_centres,
            keep_near_anchors,
        })
    }
}

impl DeviceTwin for Anchored {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        StaticGaussians.compile(gpu, kernels)?;
        kernels.get(gpu, AnchoredKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        let own = StaticGaussians.open(part)?;
        Ok(match &self.refinement {
            // Frozen centres have no steps.
            None => own,
            Some(refinement) => Box::new(AnchoredPart::new(own, refinement, part)?),
        })
    }
}

/// Gaussians of a part with centres that move.
#[derive(Debug)]
struct AnchoredPart {
    own: Box<dyn DeviceParameterization>,
    kernels: Arc<AnchoredKernels>,
    /// `CentreBounds` in WGSL.
    uniform: Uniform<[u32; 4]>,
    anchors: DeviceBuffer<[f32; 4]>,
    /// The loss on the scaffold, and the centres that have it once they move.
    scaffold: Option<(DeviceScaffoldLoss, ScaffoldCentres)>,
    begin_iteration: u64,
    positions: u32,
    len: usize,
}

impl AnchoredPart {
    fn new(
        own: Box<dyn DeviceParameterization>,
        refinement: &CentreRefinement,
        part: &NewDevicePart<'_>,
    ) -> Result<Self, GpuError> {
        let NewDevicePart { gpu, table, .. } = *part;
        let anchors = refinement.anchors.iter().zip(refinement.reach.iter());
        let anchors: Vec<[f32; 4]> = anchors
            .map(|(&[x, y, z], &reach)| [x, y, z, reach])
            .collect();
        let on_device: DeviceBuffer<[f32; 4]> = DeviceBuffer::zeros(gpu, "anchors", anchors.len())?;
        on_device.write(gpu, 0, &anchors);
        let scaffold = refinement.scaffold.as_ref().map(|scaffold| {
            // One copy for all shards.
            let field = part
                .kernels
                .get(gpu, |gpu| DeviceScaffold::new(gpu, &scaffold.field))?;
            let of = |&reach: &f32| scaffold.weight.of(reach);
            let weights: Vec<f32> = refinement.reach.iter().map(of).collect();
            let centres = match scaffold.weight {
                ScaffoldWeight::Mean(_) => ScaffoldCentres::All,
                ScaffoldWeight::Seen(_) => ScaffoldCentres::Seen,
            };
            let loss = DeviceScaffoldLoss::new(gpu, field, table, &weights)?;
            Ok::<_, GpuError>((loss, centres))
        });
        Ok(Self {
            own,
            kernels: part.kernels.get(gpu, AnchoredKernels::new)?,
            uniform: Uniform::of(gpu, "anchored centres", &[0; 4])?,
            anchors: on_device,
            scaffold: scaffold.transpose()?,
            begin_iteration: refinement.begin_iteration,
            positions: table.begin(POSITIONS),
            len: part.entries.len,
        })
    }
}

impl DeviceParameterization for AnchoredPart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.own.activate(gpu, program, part)
    }

    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.own.activate_vjp(gpu, program, part)?;
        let (table, rows) = (part.table, &part.rows.rows);
        let buffers = [&self.uniform.raw, &table.gradients.raw];
        program.run(gpu, &self.kernels.hold_centres, rows, &buffers);
        if let Some((scaffold, _)) = &self.scaffold {
            scaffold.record(gpu, program, table, rows);
        }
        Ok(())
    }

    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.own.place(gpu, entries, first_alone);
        self.len = entries.len;
    }

    fn set_moment(&self, gpu: &Gpu, at: &Viewpoint) {
        self.own.set_moment(gpu, at);
        let moves = at.scheduled >= Some(self.begin_iteration);
        let bounds = [self.len as u32, self.positions, u32::from(moves), 0];
        self.uniform.write(gpu, &bounds);
        if let Some((scaffold, centres)) = &self.scaffold {
            let centres = if moves {
                *centres
            } else {
                ScaffoldCentres::None
            };
            scaffold.set(gpu, self.len, centres);
        }
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
            &self.kernels.keep_near_anchors,
            &rows.rows,
            &[
                &self.uniform.raw,
                &self.anchors.raw,
                &table.values.raw,
                &table.first_moments.raw,
                status,
            ],
        );
    }
}
