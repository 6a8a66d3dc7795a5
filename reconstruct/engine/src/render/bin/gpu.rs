//! Binning on a GPU.

use crate::{
    device::{Gpu, GpuError, Kernel, Program, Scan, Shader, Workgroups},
    render::{
        buffers::{DISTANCE_BITS, RenderBuffers, RenderShape},
        sort::gpu::{BLOCK, PairCount, RadixSort},
    },
};

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "bin.wgsl",
        constants: shape.constants() + &format!("const SORT_BLOCK: u32 = {BLOCK}u;\n"),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../../device/arc_tangent.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../camera/rays.wgsl"),
            include_str!("../project/splat.wgsl"),
            include_str!("bin.wgsl"),
        ],
    }
}

/// Kernels from splats to tile lists.
#[derive(Debug)]
pub(crate) struct Binning {
    count_entries: Kernel,
    check_room: Kernel,
    write_entries: Kernel,
    find_tiles: Kernel,
    scan: Scan,
    sort: RadixSort,
}

impl Binning {
    pub(crate) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [count_entries, check_room, write_entries, find_tiles] = Kernel::compile(
            gpu,
            &shader(shape),
            ["count_entries", "check_room", "write_entries", "find_tiles"],
        )?;
        Ok(Self {
            count_entries,
            check_room,
            write_entries,
            find_tiles,
            scan: Scan::new(gpu)?,
            sort: RadixSort::new(gpu)?,
        })
    }

    /// Records sorting of the splats by distance and construction of the tile lists.
    pub(crate) fn forward(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
    ) -> Result<(), GpuError> {
        let shape = &buffers.shape;
        let (view, by_distance, by_tile) =
            (&buffers.view.raw, &buffers.by_distance, &buffers.by_tile);
        program.begin_stage("sort");
        let of = PairCount {
            count: &buffers.gaussian_count,
            blocks: Workgroups::ForRows(&buffers.rows, BLOCK),
        };
        self.sort
            .record(gpu, program, by_distance, of, DISTANCE_BITS)?;
        let by_rank = buffers.by_rank();
        let by_rank = [
            view,
            &by_rank.keys.raw,
            &by_rank.items.raw,
            &buffers.splats.raw,
            &buffers.entry_starts.raw,
            &buffers.rays.raw,
            &by_tile.keys.raw,
            &by_tile.items.raw,
            &buffers.entry_splats.raw,
        ];
        program.begin_stage("bin");
        program.clear(&buffers.entry_starts.raw);
        program.run(gpu, &self.count_entries, &buffers.rows, &by_rank[..6]);
        self.scan.record(gpu, program, &buffers.entry_starts)?;
        program.run_workgroups(
            gpu,
            &self.check_room,
            1,
            &[
                view,
                &buffers.entry_starts.raw,
                &buffers.status.raw,
                &buffers.entry_count.raw,
                &buffers.entry_workgroups.raw,
            ],
        );
        program.run(gpu, &self.write_entries, &buffers.rows, &by_rank);
        program.begin_stage("sort");
        let tile_bits = shape.tile_bits();
        let of = PairCount {
            count: &buffers.entry_count,
            blocks: Workgroups::Counted(&buffers.entry_workgroups, 3),
        };
        self.sort.record(gpu, program, by_tile, of, tile_bits)?;
        let sorted = by_tile.sorted(tile_bits);
        program.begin_stage("bin");
        program.clear(&buffers.tile_ranges.raw);
        program.run_workgroups(
            gpu,
            &self.find_tiles,
            Workgroups::Counted(&buffers.entry_workgroups, 0),
            &[
                &buffers.entry_count.raw,
                &sorted.keys.raw,
                &sorted.items.raw,
                &buffers.entry_splats.raw,
                &buffers.tile_ranges.raw,
                &buffers.items.raw,
            ],
        );
        Ok(())
    }
}
