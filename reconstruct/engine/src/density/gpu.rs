//! Density control on a GPU: the device decides, and the host reads three numbers. The kernels in
//! `density.wgsl`, `moving.wgsl` and `order.wgsl` are twins of `mod.rs` with `sizes.rs`, of `moving.rs` and
//! of `order.rs`. The placement of rows and the programs are in `work.rs`.
//!
//! The host draws the random offsets of the children of splits in the same order as the CPU twin, so that one
//! seed gives the same result on both.

mod work;

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

pub(crate) use self::work::{DensityWork, WorkInputs};
use super::{
    Densification, Densified, SPLIT_SHRINK,
    moving::{LIFESPAN_SHRINK, PEAK_MARGIN},
    sizes::Sizes,
};
use crate::{
    camera::{Camera, View},
    density::{order, settings::LatitudeOf},
    device::{DeviceBuffer, Gpu, GpuError, Scan, Shader, kernels, wgsl_struct},
    gaussians::{static_gaussians::logit, temporal::gpu::table_constants},
    model::Part,
    render::sort::gpu::RadixSort,
    training_view::TrainingView,
};

wgsl_struct! {
    /// Parameters of one densification of a part.
    pub(crate) struct DensityStep {
        rows: u32,
        capacity: u32,
        clones: u32,
        extended_rows: u32,
        new_rows: u32,
        room: u32,
        siblings: u32,
        views: u32,
        first_view: u32,
        threshold_views: u32,
        positions: u32,
        log_scales: u32,
        quaternions: u32,
        opacity_logits: u32,
        peaks: u32,
        log_lifespans: u32,
        has_times: u32,
        shortens: u32,
        prunes_sizes: u32,
        threshold_equator: f32,
        threshold_pole: f32,
        clone_size: f32,
        prune_size: f32,
        unit_length: f32,
        least_distance: f32,
        prune_opacity: f32,
        prune_logit: f32,
        time_threshold: f32,
        clone_lifespan: f32,
        half_clip: f32,
        farthest_peak: f32,
        pad: u32,
        centre: [f32; 3],
        pad_end: u32,
    }

    /// An input view.
    pub(crate) struct DensityView {
        rotation_and_centre: [[f32; 4]; 3],
        is_erp: [f32; 4],
    }

    /// Child of a split; before placement, its random draws.
    pub(crate) struct Child {
        position: [f32; 3],
        peak: f32,
        log_scales: [f32; 3],
        log_lifespan: f32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "density.wgsl",
        constants: format!(
            "{}const SPLIT_SHRINK: f32 = {:e};\nconst LIFESPAN_SHRINK: f32 = {:e};\n",
            table_constants(),
            SPLIT_SHRINK.ln(),
            LIFESPAN_SHRINK.ln()
        ),
        parts: &[
            include_str!("../device/common.wgsl"),
            include_str!("../device/sin_cos.wgsl"),
            include_str!("../gaussians/temporal/temporal_table.wgsl"),
            include_str!("density.wgsl"),
            include_str!("moving.wgsl"),
            include_str!("order.wgsl"),
        ],
    }
}

kernels! {
    /// The kernels of the shader.
    struct OwnKernels() = shader() => [
        find_candidates,
        grow_in_space,
        find_restless,
        grow_in_time,
        count_copies,
        append_copies,
        judge_rows,
        keep_rows,
        write_sources,
        write_children,
    ];
}

/// The kernels, which do not depend on the number of Gaussians, and the input views.
#[derive(Debug)]
pub(crate) struct DensityKernels {
    own: OwnKernels,
    sort: RadixSort,
    scan: Scan,
    views: DeviceBuffer<DensityView>,
}

impl DensityKernels {
    /// Compiles the kernels and uploads the input views.
    pub(crate) fn new(gpu: &Gpu, views: &[TrainingView]) -> Result<Self, GpuError> {
        let views: Vec<DensityView> = views.iter().map(|view| density_view(&view.view)).collect();
        Ok(Self {
            own: OwnKernels::new(gpu)?,
            sort: RadixSort::new(gpu)?,
            scan: Scan::new(gpu)?,
            views: DeviceBuffer::of(gpu, "views for density control", &views)?,
        })
    }
}

fn density_view(view: &View) -> DensityView {
    let centre = view.centre.to_array();
    let row = |axis: usize| {
        let row = view.rotation.row(axis);
        [row.x, row.y, row.z, centre[axis]]
    };
    let is_erp = matches!(view.camera, Camera::Erp(_));
    DensityView {
        rotation_and_centre: [row(0), row(1), row(2)],
        is_erp: [f32::from(u8::from(is_erp)), 0.0, 0.0, 0.0],
    }
}

/// Returns the parameters of a part's densification, except rows and array offsets.
fn density_step(asked: &Densification<'_>, part: &Part, room: usize) -> DensityStep {
    let settings = asked.settings.of_part(part);
    let context = &asked.context;
    let threshold = settings.gradient_threshold;
    let [first_view, threshold_views] = match threshold.latitude {
        LatitudeOf::LastView => [context.last_view, 1],
        LatitudeOf::AllViews => [0, context.views.len()],
    };
    let (unit_length, least_distance) = match Sizes::new(&settings, context.views) {
        Sizes::Distance { least, .. } => (0.0, least),
        Sizes::Length(length) => (length, 0.0),
    };
    let temporal = part.parameterization.temporal();
    let shortens = temporal.is_some()
        && (context.temporal).is_some_and(|density| density.shortens(asked.scheduled));
    let duration = temporal.map_or(0.0, |temporal| temporal.clock.duration_frames);
    let prunes_sizes = asked.scheduled > settings.prune_size_begin_iteration;
    // A split into three adds two.
    let room = if shortens { room / 2 } else { room };
    DensityStep {
        room: u32::try_from(room).unwrap_or(u32::MAX),
        siblings: if shortens { 3 } else { 2 },
        views: context.views.len() as u32,
        first_view: first_view as u32,
        threshold_views: threshold_views as u32,
        has_times: u32::from(temporal.is_some()),
        shortens: u32::from(shortens),
        prunes_sizes: u32::from(prunes_sizes),
        threshold_equator: threshold.equator,
        threshold_pole: threshold.pole,
        clone_size: settings.clone_size,
        prune_size: settings.prune_size,
        unit_length,
        least_distance,
        prune_opacity: settings.prune_opacity,
        prune_logit: logit(settings.prune_opacity),
        time_threshold: context
            .temporal
            .map_or(0.0, |density| density.gradient_threshold),
        clone_lifespan: context
            .temporal
            .map_or(0.0, |density| density.clone_lifespan_frames),
        half_clip: 0.5 * duration,
        farthest_peak: (0.5 + PEAK_MARGIN) * duration,
        centre: order::centre(context.views).to_array(),
        ..DensityStep::default()
    }
}

/// Draws the random numbers for the children of splits, child by child.
fn draw(children: usize, in_time: bool, random: &mut Pcg64Mcg) -> Vec<Child> {
    let mut normal = || -> f32 { StandardNormal.sample(random) };
    let child = |_| Child {
        position: [normal(), normal(), normal()],
        peak: if in_time { normal() } else { 0.0 },
        ..Child::default()
    };
    (0..children).map(child).collect()
}

/// Decides which rows of a part on the device are copied and which are removed. At most `room` rows are
/// added. Returns the counts and the number of rows that remain; the rows are moved later.
pub(crate) fn decide(
    gpu: &Gpu,
    work: &mut DensityWork,
    (asked, part, room): (&Densification<'_>, &Part, usize),
    random: &mut Pcg64Mcg,
) -> Result<(Densified, usize), GpuError> {
    let rows = part.table.len();
    let step = density_step(asked, part, room);
    let [cloned, added] = work.grow(gpu, rows, &step, asked.context.temporal.is_some())?;
    let children = added - cloned;
    let split = children / step.siblings as usize;
    let drawn = draw(children, work.draws_times(), random);
    let left = work.judge(gpu, [cloned, added], &drawn)?;
    let done = Densified {
        cloned,
        split,
        pruned: rows + added - split - left,
    };
    Ok((done, left))
}
