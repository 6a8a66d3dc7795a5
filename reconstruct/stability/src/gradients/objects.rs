//! Gradient of an object's Gaussians and of the corrections of its path.

use glam::{DQuat, DVec3, Vec3};
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians,
        parameterization::Viewpoint,
        static_gaussians::{InitialGaussians, LOG_SCALES, POSITIONS, QUATERNIONS},
        tracked::{self, TrackedGaussians, TrackedObject},
    },
    model::Part,
    parameters::ParameterTable,
    trajectories::rigid_path::{CORRECTION_VALUES, RigidPath},
};
use omnilife_schemas::{
    Similarity,
    trajectory::{BSpline, GroundAxes, ObjectPath},
};

use super::{difference, relative_error};
use crate::{devices::Device, largest_or_nan, special::CaseResult};

const SECONDS: f64 = 0.7;
const DURATION: f64 = 2.0;
const GAUSSIANS: usize = 4;
/// Values of a Gaussian with a gradient: position, log sizes, quaternion.
const VALUES: usize = 10;
/// Knots of the corrections, at both ends of the path.
const KNOTS: usize = 2;

/// An object with the loss `sum w . (centre, scale, rotation)` of its Gaussians; centre and scale in its own unit.
struct Object {
    size: f64,
    path: ObjectPath,
    up: DVec3,
    lever: f64,
    weights: Vec<[f64; VALUES]>,
    /// Quaternions of the kernel, whose sign the definition takes.
    signs: Vec<DQuat>,
}

impl Object {
    fn new(size: f64) -> Self {
        let wave = |at: usize| (1.9 * at as f64 + 0.4).sin();
        Self {
            size,
            path: ObjectPath {
                centre: BSpline {
                    degree: 1,
                    knots: vec![0.0, 0.0, DURATION, DURATION],
                    coefficients: vec![[0.1, -0.2, 0.3], [1.1, 0.4, 0.2]],
                },
                heading_seconds: vec![0.0, DURATION],
                headings: vec![3.0, -3.0],
            },
            up: DVec3::new(0.2, -0.1, 1.0).normalize(),
            lever: f64::from(0.5 * size as f32),
            weights: (0..GAUSSIANS)
                .map(|index| std::array::from_fn(|value| wave(VALUES * index + value)))
                .collect(),
            signs: Vec::new(),
        }
    }

    fn tracked(&self) -> TrackedObject {
        let as_is = Similarity {
            offset: [0.0; 3],
            scale: 1.0,
        };
        TrackedObject {
            id: 1,
            dimensions: [
                self.size as f32,
                0.4 * self.size as f32,
                0.3 * self.size as f32,
            ],
            path: RigidPath::new(&self.path, self.up, self.lever as f32, KNOTS, &as_is),
        }
    }

    /// Returns the loss by the definition in f64: values of each Gaussian, then corrections.
    fn loss(&self, values: &[f64]) -> f64 {
        let (rows, corrections) = values.split_at(VALUES * GAUSSIANS);
        let share = SECONDS / DURATION;
        let correction = |value: usize| {
            (1.0 - share) * corrections[value] + share * corrections[CORRECTION_VALUES + value]
        };
        let Some((centre, heading)) = self.path.at(SECONDS) else {
            return f64::NAN;
        };
        let centre = centre + DVec3::new(correction(0), correction(1), correction(2));
        let heading = heading + correction(3) / self.lever;
        let rotation = GroundAxes::new(self.up).rotation(heading);
        let turn = DQuat::from_mat3(&rotation);
        let rows = rows.as_chunks::<VALUES>().0.iter();
        rows.zip(&self.weights)
            .zip(&self.signs)
            .map(|((row, weight), sign)| {
                let [x, y, z, a, b, c, qw, qx, qy, qz] = *row;
                let place = rotation * (self.size * DVec3::new(x, y, z)) + centre;
                let scale = DVec3::new(a.exp(), b.exp(), c.exp());
                let own = turn * DQuat::from_xyzw(qx, qy, qz, qw).normalize();
                let own = if own.dot(*sign) < 0.0 { -own } else { own };
                let by_place = DVec3::new(weight[0], weight[1], weight[2]).dot(place) / self.size;
                let by_scale = DVec3::new(weight[3], weight[4], weight[5]).dot(scale);
                let by_rotation =
                    weight[6] * own.w + weight[7] * own.x + weight[8] * own.y + weight[9] * own.z;
                by_place + by_scale + by_rotation
            })
            .sum()
    }
}

/// Returns a table of Gaussians in the object's coordinates.
fn table() -> ParameterTable {
    let mut initial = InitialGaussians::default();
    for index in 0..GAUSSIANS {
        let place = 0.3 * (2.3 * index as f32).sin();
        initial.push_isotropic([place, 0.4 * place, -0.1], 0.05, [0.5; 3], 0.5);
    }
    let mut table = tracked::table(&initial, &[0; GAUSSIANS]);
    for array in [LOG_SCALES, QUATERNIONS] {
        for (at, value) in table.arrays[array].values.iter_mut().enumerate() {
            *value += 0.4 * (1.3 * at as f32).sin();
        }
    }
    table
}

/// Judges the gradients by every value of an object of this size, relative to the largest of their kind.
pub(super) fn judge(device: &Device, size: f64, limit: f64) -> CaseResult {
    let mut object = Object::new(size);
    let table = table();
    let mut tracked = TrackedGaussians::new(vec![object.tracked()], true);
    for (at, value) in tracked.corrections.array.values.iter_mut().enumerate() {
        *value = 0.1 * size as f32 * (at as f32).cos();
    }
    let at = Viewpoint {
        seconds: SECONDS,
        shift_frames: 0.0,
        centre: Vec3::ZERO,
        down: Vec3::Y,
        scheduled: Some(1),
    };
    let mut values = Vec::new();
    for index in 0..GAUSSIANS {
        for array in [POSITIONS, LOG_SCALES, QUATERNIONS] {
            values.extend(
                table
                    .row(array, index)
                    .iter()
                    .map(|&value| f64::from(value)),
            );
        }
    }
    let corrections = &tracked.corrections.array.values;
    values.extend(corrections.iter().map(|&value| f64::from(value)));
    let taken_back = device.activated_part(Part::new(tracked, table), &at, |activated| {
        let rotations = activated.rotations.iter();
        object.signs = rotations
            .map(|q| {
                let [w, x, y, z] = q.map(f64::from);
                DQuat::from_xyzw(x, y, z, w)
            })
            .collect();
        let mut gradient = ActivatedGaussians::default();
        gradient.clear_to_zero(activated);
        for (index, weight) in object.weights.iter().enumerate() {
            gradient.positions[index] = [0, 1, 2].map(|axis| (weight[axis] / size) as f32);
            gradient.scales[index] = [3, 4, 5].map(|axis| (weight[axis] / size) as f32);
            gradient.rotations[index] = [6, 7, 8, 9].map(|axis| weight[axis] as f32);
        }
        gradient
    });
    let part = match taken_back {
        Ok((_, part)) => part,
        Err(error) => return CaseResult::failed(error),
    };
    let table = &part.table;
    let mut found = Vec::new();
    for index in 0..GAUSSIANS {
        for array in [POSITIONS, LOG_SCALES, QUATERNIONS] {
            let array = &table.arrays[array];
            let row = &array.gradients[index * array.width..(index + 1) * array.width];
            found.extend(row.iter().map(|&value| f64::from(value)));
        }
    }
    let shared = part.parameterization.shared();
    let of_corrections = shared.iter().flat_map(|shared| &shared.array.gradients);
    found.extend(of_corrections.map(|&value| f64::from(value)));
    // Positions, log sizes, quaternions, and corrections.
    let mut kinds: [Vec<[f64; 2]>; 4] = Default::default();
    for (place, &found) in found.iter().enumerate() {
        let is_correction = place >= VALUES * GAUSSIANS;
        let unit = if is_correction { size } else { 1.0 };
        let moved = |shift: f64| {
            let mut values = values.clone();
            values[place] += shift * unit;
            object.loss(&values)
        };
        let kind = match place % VALUES {
            _ if is_correction => 3,
            0..3 => 0,
            3..6 => 1,
            _ => 2,
        };
        kinds[kind].push([found * unit, difference(moved, 1e-4)]);
    }
    let errors = kinds.iter().map(|pairs| relative_error(pairs));
    let worst = errors.fold(0.0, largest_or_nan);
    CaseResult::of_errors(
        "compared with differences of the definition in f64",
        None,
        Some([worst, device.limit(limit)]),
    )
}
