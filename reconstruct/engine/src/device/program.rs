//! Kernels, and programs made of them.
//!
//! A program is recorded once for given buffers and run as often as wanted: running it allocates
//! nothing and looks nothing up.

use crate::device::{
    device::{Gpu, WORKGROUP},
    error::GpuError,
    shader::Shader,
    timer::{StageCost, StageTimer, Stages},
};

/// One entry point of a WGSL file. Its bindings are numbered from 0 in group 0, without gaps.
#[derive(Debug)]
pub(crate) struct Kernel {
    pipeline: wgpu::ComputePipeline,
}

impl Kernel {
    /// Compiles the entry points of one file.
    pub(crate) fn compile<const N: usize>(
        gpu: &Gpu,
        shader: &Shader,
        entry_points: [&'static str; N],
    ) -> Result<[Self; N], GpuError> {
        let compiled = gpu.guarded(|| {
            let module = gpu
                .device
                .create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(shader.file),
                    source: wgpu::ShaderSource::Wgsl(shader.text().into()),
                });
            entry_points.map(|entry_point| Self {
                pipeline: gpu
                    .device
                    .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                        label: Some(entry_point),
                        layout: None,
                        module: &module,
                        entry_point: Some(entry_point),
                        compilation_options: wgpu::PipelineCompilationOptions::default(),
                        cache: None,
                    }),
            })
        });
        compiled.map_err(|error| gpu.failed(&format!("{}: {error}", shader.file)))
    }
}

/// Commands in the order in which they run; each sees what those before it wrote.
#[derive(Debug, Default)]
pub(crate) struct Program {
    commands: Vec<Command>,
}

#[derive(Debug, Clone)]
enum Command {
    Run {
        pipeline: wgpu::ComputePipeline,
        bindings: wgpu::BindGroup,
        workgroups: [u32; 2],
        /// Of the buffers that are bound.
        bytes: u64,
    },
    Clear(wgpu::Buffer),
    /// What follows is of this stage.
    Stage(&'static str),
}

/// Stage of commands before the first that is named.
const UNNAMED: &str = "other";

impl Program {
    /// Runs a kernel with at least `threads` threads. `buffers` are its bindings in order.
    pub(crate) fn run(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        threads: usize,
        buffers: &[&wgpu::Buffer],
    ) {
        self.run_workgroups(gpu, kernel, threads.div_ceil(WORKGROUP as usize), buffers);
    }

    /// Runs a kernel with at least this many workgroups, laid out in two dimensions where one is
    /// not enough: the kernel's `workgroup_number` counts them through.
    pub(crate) fn run_workgroups(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        workgroups: usize,
        buffers: &[&wgpu::Buffer],
    ) {
        if workgroups == 0 {
            return;
        }
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let limit = gpu.device.limits().max_compute_workgroups_per_dimension as usize;
        let columns = workgroups.min(limit);
        self.commands.push(Command::Run {
            pipeline: kernel.pipeline.clone(),
            bindings,
            workgroups: [columns as u32, workgroups.div_ceil(columns) as u32],
            bytes: buffers.iter().map(|buffer| buffer.size()).sum(),
        });
    }

    /// Names what follows, for those who measure.
    pub(crate) fn begin_stage(&mut self, name: &'static str) {
        self.commands.push(Command::Stage(name));
    }

    /// Runs all commands of another program.
    pub(crate) fn append(&mut self, other: &Self) {
        self.commands.extend(other.commands.iter().cloned());
    }

    /// Fills a buffer with zeros.
    pub(crate) fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.commands.push(Command::Clear(buffer.clone()));
    }

    /// Adds all commands to `encoder`.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        self.encode_timed(encoder, &mut None);
    }

    /// The same; where there is a timer it notes when stages begin and end.
    pub(crate) fn encode_timed(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Option<StageTimer>,
    ) {
        let mut stage = UNNAMED;
        let mut commands = self.commands.iter().peekable();
        while let Some(command) = commands.peek() {
            match command {
                Command::Clear(buffer) => {
                    encoder.clear_buffer(buffer, 0, None);
                    commands.next();
                    continue;
                }
                Command::Stage(name) => {
                    stage = name;
                    commands.next();
                    continue;
                }
                Command::Run { .. } => {}
            }
            let is_timed = timer.is_some();
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: None,
                timestamp_writes: timer.as_mut().and_then(|timer| timer.pass(stage)),
            });
            // One pass goes on over stages that nobody times.
            while let Some(command) = commands.next_if(|command| match command {
                Command::Run { .. } => true,
                Command::Stage(_) => !is_timed,
                Command::Clear(_) => false,
            }) {
                if let Command::Run {
                    pipeline,
                    bindings,
                    workgroups,
                    ..
                } = command
                {
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, bindings, &[]);
                    pass.dispatch_workgroups(workgroups[0], workgroups[1], 1);
                }
            }
        }
    }

    /// Adds what its stages cost, but for their times, to others'.
    pub(crate) fn add_costs(&self, stages: &mut Stages) {
        let mut stage = UNNAMED;
        for command in &self.commands {
            match command {
                Command::Stage(name) => stage = name,
                Command::Clear(_) => {}
                Command::Run { bytes, .. } => {
                    let known = stages.iter().position(|(known, _)| *known == stage);
                    let place = known.unwrap_or(stages.len());
                    if place == stages.len() {
                        stages.push((stage, StageCost::default()));
                    }
                    stages[place].1.dispatches += 1;
                    stages[place].1.bytes += bytes;
                }
            }
        }
    }

    /// Gives all commands to the device, which works on them while the host goes on.
    pub(crate) fn submit(&self, gpu: &Gpu) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.encode(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
    }
}
