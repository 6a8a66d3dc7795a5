//! Adaptive density control of 3DGS: clone, split, prune, reset opacities.
//!
//! Source: 3DGS `scene/gaussian_model.py`, `train.py`. The screen-size prune is left out: it is dead code
//! upstream.
//!
//! * [`settings`]: schedule and thresholds; `sizes.rs`: the unit of sizes.
//! * `moving.rs`: rules for Gaussians that depend on time.
//! * [`order`]: order of Gaussians in memory afterwards. `gpu.rs`: the twin of all this on a GPU.

pub(crate) mod gpu;
mod moving;
pub mod order;
pub mod settings;
mod sizes;

use glam::{Mat3, Quat, Vec3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

pub use crate::density::settings::{DensifySettings, LatitudeOf, SizeUnit, Threshold};
use crate::density::sizes::Sizes;
use crate::model::Statistics;
use crate::training_view::TrainingView;
use crate::{
    camera::{Camera, View},
    gaussians::static_gaussians::{LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, logit},
    model::{Model, Part, dynamic_settings::TemporalDensity},
    parameters::ParameterTable,
};

/// Factor by which a split's children are smaller than their parent (0.8 times 2 children).
const SPLIT_SHRINK: f32 = 1.6;
/// Upper bound of opacities after a reset.
pub(crate) const RESET_OPACITY: f32 = 0.01;

/// Counts of one densification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Densified {
    /// Gaussians copied.
    pub cloned: usize,
    /// Gaussians replaced by their children.
    pub split: usize,
    /// Gaussians removed.
    pub pruned: usize,
}

impl Densified {
    /// Adds the counts of another part.
    pub(crate) fn add(&mut self, other: Self) {
        self.cloned += other.cloned;
        self.split += other.split;
        self.pruned += other.pruned;
    }
}

/// Inputs of density control other than the model.
#[derive(Debug, Clone, Copy)]
pub struct DensityContext<'a> {
    /// The input views.
    pub views: &'a [TrainingView],
    /// Number of the input view that was rendered last.
    pub last_view: usize,
    /// Density control in time.
    pub temporal: Option<TemporalDensity>,
}

/// Densification of a model.
#[derive(Debug, Clone, Copy)]
pub struct Densification<'a> {
    /// Settings of the run.
    pub settings: &'a DensifySettings,
    /// The iteration of the schedule.
    pub scheduled: u64,
    /// Inputs other than the model.
    pub context: DensityContext<'a>,
}

impl Densification<'_> {
    /// Densifies and reorders a model in memory: [`densify`], then [`order::along_sphere`].
    pub fn run(&self, model: &mut Model, random: &mut Pcg64Mcg) -> Densified {
        let done = densify(model, self.settings, self.scheduled, &self.context, random);
        order::along_sphere(model, self.context.views);
        done
    }
}

/// Returns the parts of a model in densification order: those that depend on time or move with an object come
/// first.
pub(crate) fn parts_in_order(model: &Model) -> Vec<usize> {
    let moves = |part: &Part| {
        part.parameterization.temporal().is_some() || part.parameterization.tracked().is_some()
    };
    let (mut first, last): (Vec<usize>, Vec<usize>) =
        (0..model.parts.len()).partition(|&number| moves(&model.parts[number]));
    first.extend(last);
    first
}

/// Clones, splits and prunes the model's Gaussians and resets its statistics. `scheduled` is the iteration of
/// the schedule. If room is scarce, Gaussians that depend on time or move with an object take precedence.
pub fn densify(
    model: &mut Model,
    settings: &DensifySettings,
    scheduled: u64,
    context: &DensityContext<'_>,
    random: &mut Pcg64Mcg,
) -> Densified {
    let maximum = usize::try_from(settings.maximum_gaussians).unwrap_or(usize::MAX);
    let mut done = Densified::default();
    for number in parts_in_order(model) {
        let room = maximum.saturating_sub(model.len());
        let part = &mut model.parts[number];
        let of_part = match part.parameterization.temporal().copied() {
            Some(temporal) => {
                let control = moving::MovingControl {
                    settings,
                    sizes: &Sizes::new(settings, context.views),
                    temporal,
                    scheduled,
                    context,
                    room,
                };
                control.densify(part, random)
            }
            None => densify_static(part, settings, scheduled, context, room, random),
        };
        done.add(of_part);
    }
    done
}

/// Densifies a part in space only.
fn densify_static(
    part: &mut Part,
    settings: &DensifySettings,
    scheduled: u64,
    context: &DensityContext<'_>,
    room: usize,
    random: &mut Pcg64Mcg,
) -> Densified {
    let settings = &settings.of_part(part);
    let sizes = Sizes::new(settings, context.views);
    let Part {
        table, statistics, ..
    } = part;
    let (mut clones, mut parents) = (Vec::new(), Vec::new());
    for index in candidates(table, statistics, settings, context, room) {
        if sizes.is_at_most(table, index, settings.clone_size) {
            clones.push(index);
        } else {
            parents.push(index);
        }
    }
    table.append_copies(&clones);
    let children: Vec<usize> = parents
        .iter()
        .flat_map(|&parent| [parent, parent])
        .collect();
    let first_child = table.len();
    table.append_copies(&children);
    for child in first_child..table.len() {
        scatter_child(table, child, random);
        shrink(table, child);
    }
    let pruned = remove(table, &parents, |table, index| {
        is_useful(table, index, settings, &sizes, scheduled)
    });
    part.forget_statistics();
    Densified {
        cloned: clones.len(),
        split: parents.len(),
        pruned,
    }
}

/// Removes `parents` and prunes useless Gaussians; returns the number of the latter.
fn remove(
    table: &mut ParameterTable,
    parents: &[usize],
    is_useful: impl Fn(&ParameterTable, usize) -> bool,
) -> usize {
    let mut keep = vec![true; table.len()];
    for &parent in parents {
        keep[parent] = false;
    }
    let mut pruned = 0;
    for (index, keep) in keep.iter_mut().enumerate() {
        if *keep && !is_useful(table, index) {
            *keep = false;
            pruned += 1;
        }
    }
    table.retain(&keep);
    pruned
}

/// Returns false for a Gaussian to prune. A NaN opacity or size fails the comparison and is pruned.
fn is_useful(
    table: &ParameterTable,
    index: usize,
    settings: &DensifySettings,
    sizes: &Sizes,
    scheduled: u64,
) -> bool {
    table.arrays[OPACITY_LOGITS].values[index] >= logit(settings.prune_opacity)
        && (scheduled <= settings.prune_size_begin_iteration
            || sizes.is_at_most(table, index, settings.prune_size))
}

/// Returns the Gaussians to clone or split, in order of their index. If `room` is scarce, those with the
/// largest ratio of gradient to threshold.
fn candidates(
    table: &ParameterTable,
    statistics: &Statistics,
    settings: &DensifySettings,
    context: &DensityContext<'_>,
    room: usize,
) -> Vec<usize> {
    let len = table.len();
    let positions = table.arrays[POSITIONS].values.as_chunks::<3>().0;
    let excess = |index: usize| {
        let threshold = threshold(positions[index], &settings.gradient_threshold, context);
        statistics.mean(index) / threshold
    };
    // A NaN statistic fails the comparison and changes nothing.
    let candidates: Vec<(usize, f32)> = (0..len)
        .filter(|&index| statistics.views[index] > 0)
        .map(|index| (index, excess(index)))
        .filter(|&(_, excess)| excess >= 1.0)
        .collect();
    strongest(candidates, room)
}

/// Returns the `room` candidates with the largest ratios to their threshold, in order of their index.
fn strongest(mut candidates: Vec<(usize, f32)>, room: usize) -> Vec<usize> {
    if candidates.len() > room {
        candidates.sort_by(|a, b| b.1.total_cmp(&a.1));
        candidates.truncate(room);
        candidates.sort_unstable_by_key(|&(index, _)| index);
    }
    candidates.into_iter().map(|(index, _)| index).collect()
}

/// Returns the gradient at which a Gaussian at `position` is cloned or split.
fn threshold(position: [f32; 3], threshold: &Threshold, context: &DensityContext<'_>) -> f32 {
    if threshold.equator == threshold.pole {
        return threshold.equator;
    }
    let views = context.views;
    let cosine = match threshold.latitude {
        LatitudeOf::LastView => cos_latitude(position, &views[context.last_view].view),
        LatitudeOf::AllViews => {
            let sum: f32 = views
                .iter()
                .map(|view| cos_latitude(position, &view.view))
                .sum();
            sum / views.len() as f32
        }
    };
    threshold.at(cosine)
}

/// Returns the cosine of the latitude at which a view sees a point: `rho / d`; 1 for a pinhole, which
/// stretches nothing the way an ERP image stretches its poles.
fn cos_latitude(position: [f32; 3], view: &View) -> f32 {
    match view.camera {
        Camera::Erp(_) => {
            let point = view.rotation * (Vec3::from_array(position) - view.centre);
            point.x.hypot(point.z) / point.length().max(f32::MIN_POSITIVE)
        }
        Camera::Pinhole(_) => 1.0,
    }
}

/// Clamps all opacities to at most 0.01 and clears their moments.
pub fn reset_opacities(model: &mut Model) {
    for part in &mut model.parts {
        let array = &mut part.table.arrays[OPACITY_LOGITS];
        let limit = logit(RESET_OPACITY);
        for value in &mut array.values {
            *value = value.min(limit);
        }
        array.first_moments.fill(0.0);
        array.second_moments.fill(0.0);
    }
}

fn row<const N: usize>(table: &ParameterTable, array: usize, index: usize) -> [f32; N] {
    table.arrays[array].values.as_chunks::<N>().0[index]
}

/// Moves a child to a random position inside its parent's ellipsoid.
fn scatter_child(table: &mut ParameterTable, child: usize, random: &mut Pcg64Mcg) {
    let log_scales: [f32; 3] = row(table, LOG_SCALES, child);
    let [w, x, y, z]: [f32; 4] = row(table, QUATERNIONS, child);
    let quaternion = Quat::from_xyzw(x, y, z, w);
    let rotation = if quaternion.length_squared() > 1e-24 {
        Mat3::from_quat(quaternion.normalize())
    } else {
        Mat3::IDENTITY
    };
    let offset = log_scales.map(|log_scale| {
        let normal: f32 = StandardNormal.sample(random);
        normal * log_scale.exp()
    });
    let offset = rotation * Vec3::from_array(offset);
    let position = &mut table.arrays[POSITIONS].values.as_chunks_mut::<3>().0[child];
    *position = (Vec3::from_array(*position) + offset).to_array();
}

/// Shrinks a child by [`SPLIT_SHRINK`].
fn shrink(table: &mut ParameterTable, child: usize) {
    for log_scale in &mut table.arrays[LOG_SCALES].values.as_chunks_mut::<3>().0[child] {
        *log_scale -= SPLIT_SHRINK.ln();
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;
    use omnilife_schemas::camera::ErpCamera;
    use rand::SeedableRng;

    use super::*;
    use crate::{
        gaussians::static_gaussians::{self, InitialGaussians, sigmoid},
        training_view::TrainingView,
    };

    pub(super) fn settings() -> DensifySettings {
        DensifySettings {
            gradient_threshold: Threshold::constant(1.0),
            size_unit: SizeUnit::Distance,
            clone_size: 0.1,
            prune_size: 1.0,
            prune_size_begin_iteration: 0,
            maximum_gaussians: 100,
            ..settings::tests::published()
        }
    }

    /// Returns two upright views, one unit below and one above the origin.
    pub(super) fn views() -> [TrainingView; 2] {
        let camera = ErpCamera::new(8, 4);
        let view = |height: f32| TrainingView {
            frame: 0,
            view: View {
                camera: camera.into(),
                rotation: Mat3::IDENTITY,
                centre: Vec3::new(0.0, height, 0.0),
                time_seconds: 0.0,
            },
            pixels: vec![0; 96],
            mask: None,
            ignored: None,
        };
        [view(-1.0), view(1.0)]
    }

    /// Returns a small, a large, a faint and a huge Gaussian with sums of gradients over some views.
    pub(super) fn four(sums: [f32; 4], views: [u32; 4]) -> Model {
        let table = static_gaussians::table(
            &InitialGaussians::isotropic(
                vec![[0.0; 3], [5.0, 0.0, 0.0], [0.0; 3], [0.0; 3]],
                &[0.01, 1.0, 0.01, 3.0],
                vec![[0.5; 3]; 4],
                vec![0.5, 0.5, 0.001, 0.5],
            ),
            0,
        );
        let mut model = Model::of_static(table);
        model.parts[0].statistics = Statistics {
            sums: sums.into(),
            views: views.into(),
            time_gradients: Vec::new(),
        };
        model
    }

    fn densified(model: &mut Model, settings: &DensifySettings, scheduled: u64) -> Densified {
        let views = views();
        let context = DensityContext {
            views: &views,
            last_view: 0,
            temporal: None,
        };
        let mut random = Pcg64Mcg::seed_from_u64(0);
        densify(model, settings, scheduled, &context, &mut random)
    }

    #[test]
    fn clones_small_splits_large_prunes_faint_and_huge() {
        let mut model = four([4.0, 4.0, 0.0, 0.0], [2, 2, 1, 1]);
        let done = densified(&mut model, &settings(), 1);
        assert_eq!(
            done,
            Densified {
                cloned: 1,
                split: 1,
                pruned: 2
            }
        );
        // The small one, its copy and two children.
        let Part {
            table, statistics, ..
        } = &model.parts[0];
        assert_eq!((table.len(), statistics.views.len()), (4, 4));
        let child: [f32; 3] = row(table, LOG_SCALES, 3);
        assert!((child[0].exp() - 1.0 / 1.6).abs() < 1e-6);
        let [a, b]: [[f32; 3]; 2] = [row(table, POSITIONS, 2), row(table, POSITIONS, 3)];
        assert!(a != b && (a[0] - 5.0).abs() < 5.0);
    }

    #[test]
    fn a_length_as_unit_makes_sizes_absolute_and_a_begin_spares_the_huge() {
        let absolute = DensifySettings {
            size_unit: SizeUnit::Length(20.0),
            prune_size_begin_iteration: 3_000,
            prune_size: 0.1,
            ..settings()
        };
        // 1 of 20 is small, 3 of 20 are large.
        let mut model = four([4.0, 4.0, 0.0, 4.0], [2, 2, 1, 2]);
        let done = densified(&mut model, &absolute, 3_000);
        assert_eq!((done.cloned, done.split, done.pruned), (2, 1, 1));
        let mut model = four([0.0; 4], [1; 4]);
        assert_eq!(densified(&mut model, &absolute, 3_001).pruned, 2);
    }

    #[test]
    fn a_threshold_by_latitude_asks_whose_latitude() {
        let views = views();
        let context = |last_view| DensityContext {
            views: &views,
            last_view,
            temporal: None,
        };
        let by = |latitude| Threshold {
            equator: 1.0,
            pole: 3.0,
            latitude,
        };
        // 45 degrees below the first view (y points down), at the height of the second.
        let position = [0.0, 1.0, 2.0];
        let last = |view| threshold(position, &by(LatitudeOf::LastView), &context(view));
        assert!((last(0) - (3.0 - 2.0 * 0.5_f32.sqrt())).abs() < 1e-6);
        assert!((last(1) - 1.0).abs() < 1e-6);
        let own = threshold(position, &by(LatitudeOf::AllViews), &context(0));
        assert!((own - 0.5 * (last(0) + last(1))).abs() < 1e-6);
    }

    #[test]
    fn respects_the_maximum() {
        let sums = [4.0, 5.0, 4.0, 4.0];
        let with_room = |maximum_gaussians| DensifySettings {
            maximum_gaussians,
            ..settings()
        };
        let views = views();
        let context = DensityContext {
            views: &views,
            last_view: 0,
            temporal: None,
        };
        let found = |maximum| {
            let model = four(sums, [1; 4]);
            let part = &model.parts[0];
            let room = maximum - part.table.len();
            candidates(&part.table, &part.statistics, &settings(), &context, room)
        };
        assert_eq!(found(4), [0; 0]);
        assert_eq!(found(5), [1]);
        assert_eq!(found(9), [0, 1, 2, 3]);
        let done = densified(&mut four(sums, [1; 4]), &with_room(4), 1);
        assert_eq!((done.cloned, done.split), (0, 0));
    }

    #[test]
    fn reset_lowers_opacities_and_keeps_lower_ones() {
        let mut model = four([0.0; 4], [0; 4]);
        model.parts[0].table.arrays[OPACITY_LOGITS]
            .first_moments
            .fill(1.0);
        reset_opacities(&mut model);
        let table = &model.parts[0].table;
        let opacities: Vec<f32> = table.arrays[OPACITY_LOGITS]
            .values
            .iter()
            .map(|&raw| sigmoid(raw))
            .collect();
        assert!((opacities[0] - 0.01).abs() < 1e-6 && (opacities[2] - 0.001).abs() < 1e-6);
        assert_eq!(table.arrays[OPACITY_LOGITS].first_moments, [0.0; 4]);
    }
}
