//! Kernels, and programs composed of them.
//!
//! A program is recorded once for given buffers and run as often as wanted. Running it allocates nothing and
//! looks nothing up.

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use crate::device::{
    buffer::DeviceBuffer,
    device::{Gpu, WORKGROUP},
    error::GpuError,
    shader::Shader,
    timer::{StageCost, StageTimer, Stages},
};

/// One entry point of a WGSL file. Its bindings are numbered from 0 in group 0, without gaps, and it uses each
/// of them; at most 8 are storage buffers.
#[derive(Debug)]
pub struct Kernel {
    pipeline: wgpu::ComputePipeline,
}

/// Declares a structure of the kernels of a shader, named as their entry points, with `new`, which compiles them.
macro_rules! kernels {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident($($argument:ident: $kind:ty)?) = $shader:expr => [$($entry:ident),+ $(,)?];
    ) => {
        $(#[$meta])*
        #[derive(Debug)]
        $vis struct $name {
            $($entry: $crate::device::Kernel,)+
        }

        impl $name {
            $vis fn new(
                gpu: &$crate::device::Gpu,
                $($argument: $kind,)?
            ) -> Result<Self, $crate::device::GpuError> {
                let [$($entry),+] =
                    $crate::device::Kernel::compile(gpu, &$shader, [$(stringify!($entry)),+])?;
                Ok(Self { $($entry),+ })
            }
        }
    };
}
pub(crate) use kernels;

impl Kernel {
    /// Compiles the entry points of one file, of workgroups of 256 threads.
    ///
    /// # Errors
    /// If the source is not valid; the error names the file and the reason.
    pub fn compile<const N: usize>(
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

/// Number of rows that a program works on. Clones share the number: a program recorded with it uses the value
/// at the time it runs.
#[derive(Debug, Clone)]
pub struct Rows(Arc<AtomicUsize>);

impl Rows {
    pub(crate) fn new(rows: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(rows)))
    }

    pub(crate) fn get(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    pub(crate) fn set(&self, rows: usize) {
        self.0.store(rows, Ordering::Relaxed);
    }
}

/// Minimum number of threads that run a kernel.
#[derive(Debug, Clone, Copy)]
pub enum Threads<'a> {
    /// A fixed number.
    Fixed(usize),
    /// A number per row.
    ForRows(&'a Rows, usize),
}

impl From<usize> for Threads<'_> {
    fn from(threads: usize) -> Self {
        Self::Fixed(threads)
    }
}

impl<'a> From<&'a Rows> for Threads<'a> {
    fn from(rows: &'a Rows) -> Self {
        Self::ForRows(rows, 1)
    }
}

/// Number of workgroups that run a kernel; its `workgroup_number` counts them through.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Workgroups<'a> {
    /// At least this number, laid out in two dimensions if one is not enough.
    Fixed(usize),
    /// One per this number of rows.
    ForRows(&'a Rows, usize),
    /// This number per row.
    ForEach(&'a Rows, usize),
    /// A count that the device writes before the kernel runs: three numbers, of which this is the index of
    /// the first. The buffer is one of [`DeviceBuffer::indirect`].
    Counted(&'a DeviceBuffer<u32>, usize),
}

impl From<usize> for Workgroups<'_> {
    fn from(workgroups: usize) -> Self {
        Self::Fixed(workgroups)
    }
}

/// The same as recorded in a program.
#[derive(Debug, Clone)]
enum Dispatch {
    Fixed(usize),
    /// Threads per row, and threads per workgroup.
    ForRows {
        rows: Rows,
        threads: usize,
        workgroup: usize,
    },
    Counted(wgpu::Buffer, u64),
}

impl Dispatch {
    /// Returns the number of workgroups, if the host knows it.
    fn known(&self) -> Option<usize> {
        match self {
            Self::Counted(..) => None,
            Self::Fixed(workgroups) => Some(*workgroups),
            Self::ForRows {
                rows,
                threads,
                workgroup,
            } => Some((rows.get() * threads).div_ceil(*workgroup)),
        }
    }

    fn run(&self, pass: &mut wgpu::ComputePass<'_>) {
        if let Self::Counted(counts, offset) = self {
            pass.dispatch_workgroups_indirect(counts, *offset);
        }
        if let Some(workgroups) = self.known().filter(|&workgroups| workgroups > 0) {
            let columns = workgroups.min(MOST_COLUMNS);
            pass.dispatch_workgroups(columns as u32, workgroups.div_ceil(columns) as u32, 1);
        }
    }
}

/// Commands in the order in which they run; each sees the writes of those before it.
#[derive(Debug, Default)]
pub struct Program {
    commands: Vec<Command>,
}

#[derive(Debug, Clone)]
enum Command {
    Run {
        pipeline: wgpu::ComputePipeline,
        bindings: wgpu::BindGroup,
        workgroups: Dispatch,
        /// Bytes of the bound buffers.
        bytes: u64,
    },
    Clear(wgpu::Buffer),
    /// Copy between two buffers of the same size.
    Copy(wgpu::Buffer, wgpu::Buffer),
    /// Beginning of a stage.
    Stage(&'static str),
}

/// Most workgroups in one dimension that every WebGPU adapter allows.
const MOST_COLUMNS: usize = 65_535;
/// Stage of commands before the first named stage.
const UNNAMED: &str = "other";

impl Program {
    /// Runs a kernel with at least `threads` threads, rounded up to workgroups of 256. `buffers` are its
    /// bindings in order.
    pub fn run<'a>(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        threads: impl Into<Threads<'a>>,
        buffers: &[&wgpu::Buffer],
    ) {
        let workgroup = WORKGROUP as usize;
        let dispatch = match threads.into() {
            Threads::Fixed(threads) => Dispatch::Fixed(threads.div_ceil(workgroup)),
            Threads::ForRows(rows, threads) => Dispatch::ForRows {
                rows: rows.clone(),
                threads,
                workgroup,
            },
        };
        self.dispatch(gpu, kernel, dispatch, buffers);
    }

    /// Runs a kernel with these workgroups. `buffers` are its bindings in order.
    pub(crate) fn run_workgroups<'a>(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        workgroups: impl Into<Workgroups<'a>>,
        buffers: &[&wgpu::Buffer],
    ) {
        let dispatch = match workgroups.into() {
            Workgroups::Fixed(workgroups) => Dispatch::Fixed(workgroups),
            Workgroups::ForRows(rows, each) => Dispatch::ForRows {
                rows: rows.clone(),
                threads: 1,
                workgroup: each,
            },
            Workgroups::ForEach(rows, workgroups) => Dispatch::ForRows {
                rows: rows.clone(),
                threads: workgroups,
                workgroup: 1,
            },
            Workgroups::Counted(counts, first) => {
                Dispatch::Counted(counts.raw.clone(), (first * size_of::<u32>()) as u64)
            }
        };
        self.dispatch(gpu, kernel, dispatch, buffers);
    }

    fn dispatch(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        workgroups: Dispatch,
        buffers: &[&wgpu::Buffer],
    ) {
        if matches!(workgroups, Dispatch::Fixed(0)) {
            return;
        }
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        gpu.count_made();
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        self.commands.push(Command::Run {
            pipeline: kernel.pipeline.clone(),
            bindings,
            workgroups,
            bytes: buffers.iter().map(|buffer| buffer.size()).sum(),
        });
    }

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

    /// Copies all of a buffer over another of the same size.
    pub(crate) fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer) {
        self.commands.push(Command::Copy(from.clone(), to.clone()));
    }

    /// Adds all commands to `encoder`.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        self.encode_timed(encoder, &mut None);
    }

    /// Adds all commands to `encoder`; a timer records when stages begin and end.
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
                Command::Copy(from, to) => {
                    encoder.copy_buffer_to_buffer(from, 0, to, 0, to.size());
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
            // Without a timer, one pass continues over several stages.
            while let Some(command) = commands.next_if(|command| match command {
                Command::Run { .. } => true,
                Command::Stage(_) => !is_timed,
                Command::Clear(_) | Command::Copy(..) => false,
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
                    workgroups.run(&mut pass);
                }
            }
        }
    }

    /// Adds the costs of its stages, except their times, to `stages`.
    pub(crate) fn add_costs(&self, stages: &mut Stages) {
        let mut stage = UNNAMED;
        for command in &self.commands {
            match command {
                Command::Stage(name) => stage = name,
                Command::Clear(_) | Command::Copy(..) => {}
                Command::Run { workgroups, .. } if workgroups.known() == Some(0) => {}
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

    /// Submits all commands to the device; does not wait for them.
    pub(crate) fn submit(&self, gpu: &Gpu) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.encode(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;

    fn refusal(gpu: &Gpu, text: &'static str) -> GpuError {
        let shader = Shader {
            file: "refused.wgsl",
            constants: text.to_owned(),
            parts: &[],
        };
        let compiled = Kernel::compile(gpu, &shader, ["run"]);
        compiled.map(|_| ()).expect_err("the shader is not valid")
    }

    /// Checks features that an adapter lacks, a fault of types and one of grammar.
    #[test]
    fn a_shader_that_does_not_compile_is_one_line_with_its_file() {
        let Some(gpu) = test_device() else { return };
        let plain = Gpu::open_without_subgroups().expect("the same adapter");
        assert_eq!(plain.subgroup_size(), None);
        for text in [
            "@compute @workgroup_size(256) fn run() { let sum = subgroupAdd(1.0); }",
            "enable f16; @compute @workgroup_size(256) fn run() { let half = 1.0h; }",
            "@compute @workgroup_size(256) fn run() { let sum: u32 = 1.0; }",
            "@compute @workgroup_size(256) fn run( {",
            "",
        ] {
            let error = refusal(&plain, text);
            let message = error.to_string();
            assert!(matches!(error, GpuError::Failed { .. }), "{message}");
            assert_eq!(message.lines().count(), 1, "{message}");
            assert!(message.contains("refused.wgsl"), "{message}");
        }
        // The fault was caught with the call, and the device goes on.
        plain.check().expect("no fault is left");
        refusal(&gpu, "fn");
        gpu.check().expect("no fault is left");
    }
}
