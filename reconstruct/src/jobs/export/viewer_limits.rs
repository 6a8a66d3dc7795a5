//! Limits of web viewers, and the changes that they require.
//!
//! Viewers of `.splat` files keep covariances in half floats. The smallest eigenvalue of thin Gaussians comes out
//! negative, and small Gaussians come out as 0; viewers leave out both. They sort by depth in 16 bits over the
//! whole range.
//!
//! So each axis is at least a tenth of the longest. The 1st percentile of the sizes is 0.003 in the unit of the
//! file. No shell is far outside the scene.

use glam::{DQuat, DVec3};
use omnilife_engine::gaussians::ActivatedGaussians;
use omnilife_schemas::records::{AssetChanges, AssetPlacement, InvalidGaussians};
use rayon::prelude::*;

use super::moments::Moments;
use omnilife_training::formats::{splat::SplatRow, validity::REACH};

/// Minimum ratio of a Gaussian's shortest to its longest axis.
const LEAST_THICKNESS: f32 = 0.1;
/// Minimum 1st percentile of the longest axes, in units of the file.
const LEAST_SIZE: f32 = 0.003;
/// Quantile of the distances at which the scene ends.
const SCENE_QUANTILE: f64 = 0.95;
/// Maximum distance in radii of the scene.
const FARTHEST: f32 = 3.0;

/// Gaussians in the form of files, with counts of the changes.
#[derive(Debug)]
pub(super) struct Drawable {
    /// For viewers of `.splat`; empty in other formats.
    pub(super) rows: Vec<SplatRow>,
    /// Unchanged Gaussians with their harmonics, for other formats.
    pub(super) whole: Option<ActivatedGaussians>,
    /// The Gaussians of other moments, in the same frame.
    pub(super) moments: Option<Moments>,
    pub(super) placement: AssetPlacement,
    pub(super) changes: AssetChanges,
}

impl Drawable {
    /// Returns the number of Gaussians.
    pub(super) fn len(&self) -> usize {
        (self.whole.as_ref()).map_or(self.rows.len(), ActivatedGaussians::len)
    }
}

/// The frame of files: around the origin of a normalized scene, with up on the negative y axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct FileFrame {
    turn: DQuat,
    world: f64,
    offset: DVec3,
}

impl FileFrame {
    /// Returns the frame of a normalized scene with `world` units each, moved by `offset`, in which `up` is up.
    pub(super) fn new(up: DVec3, offset: DVec3, world: f64) -> Self {
        Self {
            turn: DQuat::from_rotation_arc(up.normalize(), DVec3::NEG_Y),
            world,
            offset,
        }
    }

    /// Returns the rotation from the world to it.
    pub(super) fn turn(&self) -> DQuat {
        self.turn
    }

    /// Returns the placement of files with `scale` units for each of the world.
    pub(super) fn placement(&self, scale: f64) -> AssetPlacement {
        let DQuat { x, y, z, w } = self.turn;
        AssetPlacement {
            offset: self.offset.to_array(),
            scale,
            rotation_wxyz: [w, x, y, z],
        }
    }

    /// Returns a Gaussian in that frame.
    pub(super) fn row(&self, gaussians: &ActivatedGaussians, index: usize) -> SplatRow {
        let row = SplatRow::of(gaussians, index);
        let place = self.turn * (DVec3::from_array(row.position.map(f64::from)) * self.world);
        let [w, x, y, z] = row.rotation.map(f64::from);
        let rotation = self.turn * DQuat::from_xyzw(x, y, z, w);
        SplatRow {
            position: place.as_vec3().to_array(),
            scale: row
                .scale
                .map(|scale| (f64::from(scale) * self.world) as f32),
            rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(|q| q as f32),
            ..row
        }
    }
}

/// Moves Gaussians, and those of other moments, into a frame and within the limits of viewers. `invalid` counts
/// Gaussians that a file cannot hold.
pub(super) fn drawable(
    gaussians: &ActivatedGaussians,
    mut moments: Option<Moments>,
    frame: &FileFrame,
    invalid: &mut InvalidGaussians,
) -> Drawable {
    let all = gaussians.len();
    let mut rows: Vec<SplatRow> = (0..all)
        .into_par_iter()
        .map(|index| frame.row(gaussians, index))
        .filter(|row| row.rgba[3] > 0)
        .collect();
    let mut changes = AssetChanges {
        transparent: (all - rows.len()) as u64,
        dropped_sh_degree: gaussians.sh_degree as u32,
        ..AssetChanges::default()
    };
    // Counts are those of the levels.
    keep_valid(&mut rows, invalid);
    for rows in moments.iter_mut().flat_map(Moments::files_mut) {
        keep_valid(rows, &mut InvalidGaussians::default());
    }
    changes.thickened = rows.par_iter_mut().map(thicken).sum();
    let farthest = farthest(&rows);
    changes.pulled_in = (rows.par_iter_mut())
        .map(|row| pull_in(row, farthest))
        .sum();
    if let Some(moments) = &mut moments {
        for row in moments.rows_mut() {
            thicken(row);
            pull_in(row, farthest);
        }
    }
    // One scale for all files: that of the file with the smallest Gaussians.
    let sizes = |rows: &[SplatRow]| enlargement(rows.par_iter().map(longest).collect());
    let of_moments = moments.iter().flat_map(Moments::files).map(sizes);
    let scale = of_moments.fold(sizes(&rows), f32::max);
    let files = moments.iter().flat_map(Moments::files);
    let extent = files.map(extent).fold(extent(&rows), f32::max);
    // Half of the range: rounding must stay within it.
    let scale = scale.min((0.5 * REACH / f64::from(extent)) as f32);
    let enlarge = |row: &mut SplatRow| resize(row, scale);
    rows.par_iter_mut().for_each(enlarge);
    (moments.iter_mut().flat_map(Moments::rows_mut)).for_each(enlarge);
    Drawable {
        rows,
        whole: None,
        moments,
        placement: frame.placement(f64::from(scale)),
        changes,
    }
}

/// Keeps the Gaussians that a file can hold.
fn keep_valid(rows: &mut Vec<SplatRow>, invalid: &mut InvalidGaussians) {
    rows.retain_mut(
        |row| match row.valid(row.position.map(f64::from), invalid) {
            Some(valid) => {
                *row = valid;
                true
            }
            None => false,
        },
    );
}

/// Scales a Gaussian with its distance from the origin. A size that f32 rounds to 0 stays positive.
fn resize(row: &mut SplatRow, factor: f32) {
    row.position = row.position.map(|value| value * factor);
    row.scale = row
        .scale
        .map(|value| (value * factor).max(f32::MIN_POSITIVE));
}

/// Returns the largest coordinate or size.
fn extent(rows: &[SplatRow]) -> f32 {
    let of_row = |row: &SplatRow| {
        row.position
            .into_iter()
            .map(f32::abs)
            .fold(longest(row), f32::max)
    };
    rows.par_iter()
        .map(of_row)
        .reduce(|| f32::MIN_POSITIVE, f32::max)
}

fn longest(row: &SplatRow) -> f32 {
    row.scale.into_iter().fold(0.0, f32::max)
}

/// Makes a thin Gaussian thicker; returns 1 if it was thin.
fn thicken(row: &mut SplatRow) -> u64 {
    let least = LEAST_THICKNESS * longest(row);
    // Rounding slightly below a tenth does no harm.
    let is_thin = row.scale.iter().any(|&scale| scale < 0.999 * least);
    row.scale = row.scale.map(|scale| scale.max(least));
    u64::from(is_thin)
}

fn away(row: &SplatRow) -> f32 {
    glam::Vec3::from_array(row.position).length()
}

/// Returns three radii of the scene. Rows exactly in the middle, such as zeros, do not count; a scene that is one
/// point has no end.
fn farthest(rows: &[SplatRow]) -> f32 {
    let distances = rows.iter().map(away).filter(|&distance| distance > 0.0);
    let radius = quantile(distances.collect(), SCENE_QUANTILE);
    radius.map_or(f32::INFINITY, |radius| FARTHEST * radius)
}

/// Moves a Gaussian beyond `farthest` to that distance and keeps its size in every view from the middle; returns
/// 1 if it moved.
fn pull_in(row: &mut SplatRow, farthest: f32) -> u64 {
    let distance = away(row);
    if distance <= farthest {
        return 0;
    }
    resize(row, farthest / distance);
    1
}

/// Returns the factor on all sizes if they are too small for half floats.
fn enlargement(sizes: Vec<f32>) -> f32 {
    match quantile(sizes, 0.01) {
        Some(size) if size > 0.0 && size < LEAST_SIZE => LEAST_SIZE / size,
        _ => 1.0,
    }
}

fn quantile(mut values: Vec<f32>, share: f64) -> Option<f32> {
    let at = (values.len().checked_sub(1)? as f64 * share) as usize;
    Some(*values.select_nth_unstable_by(at, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Quat, Vec3};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Returns a float as viewers pack it: bits after the tenth of the mantissa are cut off, and values below the
    /// smallest normal half lose more of them.
    fn half(value: f32) -> f64 {
        let magnitude = f64::from(value.abs());
        let exponent = magnitude.log2().floor().max(-14.0);
        let step = (exponent - 10.0).exp2();
        (magnitude / step).floor() * step * f64::from(value.signum())
    }

    /// Returns the smallest eigenvalue of a Gaussian's covariance in a viewer: 4 Sigma in half floats.
    fn least_eigenvalue(row: &SplatRow) -> f64 {
        let [w, x, y, z] = row
            .rotation
            .map(|q| ((128.0 + 128.0 * q).round().min(255.0) - 128.0) / 128.0);
        let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize())
            * Mat3::from_diagonal(Vec3::from_array(row.scale));
        let sigma = axes * axes.transpose() * 4.0;
        let m = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        let packed = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
            .map(|(column, row)| half(sigma.col(column)[row]));
        let a = m.map(|row| row.map(|index| packed[index]));
        // Trisection of the determinant's sign changes finds the smallest root of the characteristic polynomial,
        // from below.
        let determinant = |lambda: f64| {
            let b = |i: usize, j: usize| a[i][j] - if i == j { lambda } else { 0.0 };
            b(0, 0) * (b(1, 1) * b(2, 2) - b(1, 2) * b(2, 1))
                - b(0, 1) * (b(1, 0) * b(2, 2) - b(1, 2) * b(2, 0))
                + b(0, 2) * (b(1, 0) * b(2, 1) - b(1, 1) * b(2, 0))
        };
        let trace = a[0][0] + a[1][1] + a[2][2];
        let minor = |i: usize, j: usize| a[i][i] * a[j][j] - a[i][j] * a[j][i];
        // Sylvester: positive definite where all leading minors are positive.
        let is_positive = a[0][0] > 0.0 && minor(0, 1) > 0.0 && determinant(0.0) > 0.0;
        if is_positive { trace * 1e-9 } else { -1.0 }
    }

    fn flat(scale: f32, thickness: f32, seed: u64, count: usize) -> ActivatedGaussians {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut gaussians = ActivatedGaussians::default();
        gaussians.reshape(count, 0, 0);
        for index in 0..count {
            let mut three = || [0; 3].map(|_| random.random_range(-1.0_f32..1.0));
            gaussians.positions[index] = three();
            let [x, y, z] = three();
            let [w, ..] = three();
            let q = Quat::from_xyzw(x, y, z, w).normalize();
            gaussians.rotations[index] = [q.w, q.x, q.y, q.z];
            gaussians.scales[index] = [scale, scale, thickness * scale];
            gaussians.opacities[index] = 0.9;
        }
        gaussians
    }

    #[test]
    fn nothing_that_is_exported_vanishes_in_half_floats() {
        for (scale, thickness) in [(0.02, 0.1), (0.004, 0.02), (1e-4, 0.1), (1e-4, 1e-3)] {
            let gaussians = flat(scale, thickness, 5, 3_000);
            let bad = |rows: &[SplatRow]| {
                rows.iter()
                    .filter(|row| least_eigenvalue(row) < 0.0)
                    .count()
            };
            let untouched: Vec<SplatRow> = (0..3_000)
                .map(|index| SplatRow::of(&gaussians, index))
                .collect();
            let frame = FileFrame::new(DVec3::Z, DVec3::ZERO, 1.0);
            let drawable = drawable(&gaussians, None, &frame, &mut InvalidGaussians::default());
            assert_eq!(bad(&drawable.rows), 0, "{scale} {thickness}");
            if thickness < 0.1 {
                assert!(
                    bad(&untouched) > 100,
                    "{scale} {thickness}: {}",
                    bad(&untouched)
                );
                assert_eq!(drawable.changes.thickened, 3_000);
            }
        }
    }

    #[test]
    fn up_is_up_and_the_far_and_the_transparent_are_seen_to() {
        let mut gaussians = flat(0.01, 1.0, 6, 400);
        gaussians.positions[0] = [0.0, 0.0, 0.5];
        gaussians.positions[1] = [0.0, 900.0, 0.0];
        gaussians.scales[1] = [9.0; 3];
        gaussians.opacities[2] = 1e-3;
        let frame = FileFrame::new(DVec3::new(0.0, 0.0, 2.0), DVec3::ONE, 2.0);
        let drawable = drawable(&gaussians, None, &frame, &mut InvalidGaussians::default());
        let first = drawable.rows[0].position;
        assert!(Vec3::from_array(first).distance(Vec3::new(0.0, -1.0, 0.0)) < 1e-6);
        let far = &drawable.rows[1];
        let away = Vec3::from_array(far.position).length();
        assert!(away < 12.0, "{away}");
        assert!(
            (far.scale[0] / away - 0.01).abs() < 1e-5,
            "as large as before"
        );
        let changes = drawable.changes;
        assert_eq!(
            (changes.transparent, changes.pulled_in, changes.thickened),
            (1, 1, 0)
        );
        assert_eq!(drawable.placement.scale, 1.0);
    }

    #[test]
    fn a_heap_in_the_middle_pulls_nothing_in() {
        let mut gaussians = flat(0.01, 1.0, 8, 400);
        gaussians.positions[20..].fill([0.0; 3]);
        let frame = FileFrame::new(DVec3::Z, DVec3::ZERO, 1.0);
        let drawable = drawable(&gaussians, None, &frame, &mut InvalidGaussians::default());
        assert_eq!(drawable.changes.pulled_in, 0);
        assert!(drawable.rows.iter().all(|row| longest(row) > 0.009));
    }

    #[test]
    fn all_moments_are_in_one_place_with_the_scene() {
        let gaussians = flat(1e-4, 0.02, 7, 500);
        let frame = FileFrame::new(DVec3::Z, DVec3::ZERO, 1.0);
        let of = |range: std::ops::Range<usize>| -> Vec<SplatRow> {
            range.map(|index| frame.row(&gaussians, index)).collect()
        };
        let moments = Moments {
            still: of(0..400),
            moving: vec![(0.0, of(400..500)), (1.0, of(400..450))],
        };
        let mut invalid = InvalidGaussians::default();
        let drawable = drawable(&gaussians, Some(moments), &frame, &mut invalid);
        assert!(drawable.placement.scale > 1.0);
        let Some(moments) = drawable.moments else {
            panic!("the moments are lost");
        };
        assert_eq!(moments.still, drawable.rows[..400]);
        assert_eq!(moments.moving[0].1, drawable.rows[400..]);
        assert_eq!(moments.moving[1].1, drawable.rows[400..450]);
        assert_eq!(drawable.changes.thickened, 500, "counted once");
    }
    /// Checks rows that a reader of the format takes without changes.
    fn are_sound(rows: &[SplatRow]) -> bool {
        let mut invalid = InvalidGaussians::default();
        let are_kept = rows.iter().all(|row| {
            let sizes_fit = row.scale.iter().all(|size| size.is_finite() && *size > 0.0);
            sizes_fit && row.valid(row.position.map(f64::from), &mut invalid) == Some(*row)
        });
        are_kept && invalid == InvalidGaussians::default()
    }

    #[test]
    fn scenes_of_any_extent_make_rows_that_are_valid() {
        let frame = FileFrame::new(DVec3::Z, DVec3::ZERO, 1.0);
        for (place, size, share) in [
            // Nearly all in one point, as rows of padding are.
            (0.0, 0.1, 0.98),
            (0.0, 1e-13, 0.98),
            (1e-25, 1e-13, 0.98),
            (1e17, 1e-13, 0.02),
            (9e17, 4e8, 0.5),
            (3e17, 0.1, 0.02),
        ] {
            let mut gaussians = flat(0.05, 0.3, 11, 400);
            for index in 0..(share * 400.0) as usize {
                gaussians.positions[index] = gaussians.positions[index].map(|value| value * place);
                gaussians.scales[index] = [size; 3];
            }
            let drawable = drawable(&gaussians, None, &frame, &mut InvalidGaussians::default());
            assert_eq!(drawable.rows.len(), 400, "{place} {size} {share}");
            assert!(are_sound(&drawable.rows), "{place} {size} {share}");
        }
        // The real rows of a scene with padding stay in place.
        let mut gaussians = flat(0.05, 1.0, 12, 400);
        gaussians.positions[5..].fill([0.0; 3]);
        let drawable = drawable(&gaussians, None, &frame, &mut InvalidGaussians::default());
        assert_eq!(drawable.changes.pulled_in, 0);
        assert_eq!(drawable.rows[0], frame.row(&gaussians, 0));
    }

    #[test]
    fn what_a_file_cannot_hold_is_left_out_or_repaired_and_counted() {
        let mut gaussians = flat(0.05, 1.0, 13, 100);
        gaussians.positions[3] = [1e30, 0.0, 0.0];
        gaussians.positions[4] = [f32::NAN, 0.0, 0.0];
        gaussians.rotations[5] = [0.0; 4];
        gaussians.scales[6] = [0.05, 0.0, 0.05];
        let frame = FileFrame::new(DVec3::NEG_Y, DVec3::ZERO, 1.0);
        let mut invalid = InvalidGaussians::default();
        let drawable = drawable(&gaussians, None, &frame, &mut invalid);
        let expected = InvalidGaussians {
            out_of_reach: 2,
            unrotated: 1,
            flat: 1,
            ..InvalidGaussians::default()
        };
        assert_eq!((drawable.rows.len(), invalid), (98, expected));
        assert!(are_sound(&drawable.rows));
    }
}
