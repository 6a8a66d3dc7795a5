//! Adaptive density control of 3DGS: clone, split, prune, reset opacities.
//!
//! Source: 3DGS `scene/gaussian_model.py`, `train.py`. Two readings differ
//! from the published code, because its thresholds are in scene units:
//!
//! * Sizes are compared with the Gaussian's distance from the mean camera, floored at the cameras'
//!   radius (1 in a normalized scene) - PVG's distance factor without its offset. ODGS adds 100 to
//!   the extent instead.
//! * The screen-size prune is left out: it is dead code upstream.

use glam::{Mat3, Quat, Vec3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::{
    gaussians::{
        GaussianTable,
        static_gaussians::{LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, logit},
    },
    render::Visible,
};

/// When Gaussians are added and removed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DensifySettings {
    /// First iteration at which Gaussians may be added or removed.
    pub begin_iteration: u64,
    /// Last one.
    pub end_iteration: u64,
    /// Iterations from one densification to the next.
    pub interval_iterations: u64,
    /// Iterations from one opacity reset to the next; 0 never resets.
    pub opacity_reset_iterations: u64,
    /// Mean image-space gradient (normalized device coordinates) from which a Gaussian is cloned
    /// or split.
    pub gradient_threshold: f32,
    /// Largest axis over distance up to which a Gaussian is cloned, above which it is split.
    pub clone_size: f32,
    /// Largest axis over distance above which a Gaussian is pruned.
    pub prune_size: f32,
    /// Opacity below which a Gaussian is pruned.
    pub prune_opacity: f32,
    /// No Gaussian is added above this number.
    pub maximum_gaussians: u64,
}

/// A split's children are smaller than their parent by this factor (0.8 times 2 children).
const SPLIT_SHRINK: f32 = 1.6;
/// Opacities are set down to this at a reset.
const RESET_OPACITY: f32 = 0.01;

/// Image-space gradients since the last densification.
#[derive(Debug, Clone, Default)]
pub struct Statistics {
    sums: Vec<f32>,
    views: Vec<u32>,
}

impl Statistics {
    /// Nothing seen yet, for `len` Gaussians.
    pub fn new(len: usize) -> Self {
        Self {
            sums: vec![0.0; len],
            views: vec![0; len],
        }
    }

    /// Adds the visible Gaussians of one view; `half_size` is half the image's width and height.
    pub fn add(&mut self, visible: impl Iterator<Item = Visible>, half_size: [f32; 2]) {
        for visible in visible {
            let index = visible.gaussian;
            let [u, v] = visible.centre_gradient;
            self.sums[index] += (u * half_size[0]).hypot(v * half_size[1]);
            self.views[index] += 1;
        }
    }

    fn mean(&self, index: usize) -> f32 {
        self.sums[index] / self.views[index].max(1) as f32
    }
}

/// What a densification did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Densified {
    /// Gaussians copied.
    pub cloned: usize,
    /// Gaussians replaced by two.
    pub split: usize,
    /// Gaussians removed.
    pub pruned: usize,
}

/// Clones, splits and prunes the table's Gaussians.
pub fn densify(
    table: &mut GaussianTable,
    statistics: &Statistics,
    settings: &DensifySettings,
    random: &mut Pcg64Mcg,
) -> Densified {
    let before = table.len();
    let (mut clones, mut parents) = (Vec::new(), Vec::new());
    for index in candidates(statistics, settings, before) {
        if relative_size(table, index) <= settings.clone_size {
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
    }
    let mut keep = vec![true; table.len()];
    for &parent in &parents {
        keep[parent] = false;
    }
    let mut pruned = 0;
    let least_logit = logit(settings.prune_opacity);
    for (index, keep) in keep.iter_mut().enumerate() {
        // Written so that a NaN opacity or size is pruned.
        let useful = table.arrays[OPACITY_LOGITS].values[index] >= least_logit
            && relative_size(table, index) <= settings.prune_size;
        if *keep && !useful {
            *keep = false;
            pruned += 1;
        }
    }
    table.retain(&keep);
    Densified {
        cloned: clones.len(),
        split: parents.len(),
        pruned,
    }
}

/// The Gaussians to clone or split, in order of their index. Where there is no room for all, those
/// with the largest gradients.
fn candidates(statistics: &Statistics, settings: &DensifySettings, len: usize) -> Vec<usize> {
    let room = usize::try_from(settings.maximum_gaussians)
        .unwrap_or(usize::MAX)
        .saturating_sub(len);
    // A NaN statistic fails the comparison and changes nothing.
    let mut candidates: Vec<usize> = (0..len)
        .filter(|&index| statistics.mean(index) >= settings.gradient_threshold)
        .collect();
    if candidates.len() > room {
        candidates.sort_by(|&a, &b| statistics.mean(b).total_cmp(&statistics.mean(a)));
        candidates.truncate(room);
        candidates.sort_unstable();
    }
    candidates
}

/// Sets all opacities down to 0.01 and forgets their moments.
pub fn reset_opacities(table: &mut GaussianTable) {
    let array = &mut table.arrays[OPACITY_LOGITS];
    let limit = logit(RESET_OPACITY);
    for value in &mut array.values {
        *value = value.min(limit);
    }
    array.first_moments.fill(0.0);
    array.second_moments.fill(0.0);
}

fn row<const N: usize>(table: &GaussianTable, array: usize, index: usize) -> [f32; N] {
    table.arrays[array].values.as_chunks::<N>().0[index]
}

/// Largest axis over the distance from the mean camera, floored at the cameras' radius.
fn relative_size(table: &GaussianTable, index: usize) -> f32 {
    let distance = Vec3::from_array(row(table, POSITIONS, index)).length();
    let [a, b, c] = row::<3>(table, LOG_SCALES, index);
    a.max(b).max(c).exp() / distance.max(1.0)
}

/// Moves a child to a random place inside its parent's ellipsoid and shrinks it.
fn scatter_child(table: &mut GaussianTable, child: usize, random: &mut Pcg64Mcg) {
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
    let scales = &mut table.arrays[LOG_SCALES].values.as_chunks_mut::<3>().0[child];
    *scales = log_scales.map(|log_scale| log_scale - SPLIT_SHRINK.ln());
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::gaussians::static_gaussians::{self, InitialGaussians, sigmoid};

    fn settings() -> DensifySettings {
        DensifySettings {
            begin_iteration: 0,
            end_iteration: 1,
            interval_iterations: 1,
            opacity_reset_iterations: 0,
            gradient_threshold: 1.0,
            clone_size: 0.1,
            prune_size: 1.0,
            prune_opacity: 0.005,
            maximum_gaussians: 100,
        }
    }

    /// A small one, a large one, a faint one and a huge one.
    fn four() -> GaussianTable {
        static_gaussians::table(&InitialGaussians {
            positions: vec![[0.0; 3], [5.0, 0.0, 0.0], [0.0; 3], [0.0; 3]],
            scales: vec![0.01, 1.0, 0.01, 3.0],
            colours: vec![[0.5; 3]; 4],
            opacities: vec![0.5, 0.5, 0.001, 0.5],
        })
    }

    #[test]
    fn clones_small_splits_large_prunes_faint_and_huge() {
        let mut table = four();
        let statistics = Statistics {
            sums: vec![4.0, 4.0, 0.0, 0.0],
            views: vec![2, 2, 1, 1],
        };
        let done = densify(
            &mut table,
            &statistics,
            &settings(),
            &mut Pcg64Mcg::seed_from_u64(0),
        );
        assert_eq!(
            done,
            Densified {
                cloned: 1,
                split: 1,
                pruned: 2
            }
        );
        // The small one, its copy and two children.
        assert_eq!(table.len(), 4);
        let child: [f32; 3] = row(&table, LOG_SCALES, 3);
        assert!((child[0].exp() - 1.0 / 1.6).abs() < 1e-6);
        let [a, b]: [[f32; 3]; 2] = [row(&table, POSITIONS, 2), row(&table, POSITIONS, 3)];
        assert!(a != b && (a[0] - 5.0).abs() < 5.0);
    }

    #[test]
    fn respects_the_maximum() {
        let mut table = four();
        let statistics = Statistics {
            sums: vec![4.0, 5.0, 4.0, 4.0],
            views: vec![1; 4],
        };
        let with_room = |maximum_gaussians| DensifySettings {
            maximum_gaussians,
            ..settings()
        };
        assert_eq!(candidates(&statistics, &with_room(4), 4), [0; 0]);
        assert_eq!(candidates(&statistics, &with_room(5), 4), [1]);
        assert_eq!(candidates(&statistics, &with_room(9), 4), [0, 1, 2, 3]);
        let done = densify(
            &mut table,
            &statistics,
            &with_room(4),
            &mut Pcg64Mcg::seed_from_u64(0),
        );
        assert_eq!((done.cloned, done.split), (0, 0));
    }

    #[test]
    fn reset_lowers_opacities_and_keeps_lower_ones() {
        let mut table = four();
        table.arrays[OPACITY_LOGITS].first_moments.fill(1.0);
        reset_opacities(&mut table);
        let opacities: Vec<f32> = table.arrays[OPACITY_LOGITS]
            .values
            .iter()
            .map(|&raw| sigmoid(raw))
            .collect();
        assert!((opacities[0] - 0.01).abs() < 1e-6 && (opacities[2] - 0.001).abs() < 1e-6);
        assert_eq!(table.arrays[OPACITY_LOGITS].first_moments, [0.0; 4]);
    }
}
