//! Gaussians of rigid objects that move along paths: each object has its own coordinates, in which its
//! Gaussians rest.
//!
//! Source: Fischer et al., "Dynamic 3D Gaussian Fields for Urban Areas", 2024, and its repository (4DGF,
//! `model/gauss_splat.py`, `get_object_geometry`). For a Gaussian `(x, s, q)` of an object whose box has the
//! largest side `m`, at the pose `(R, X)` of its path ([`crate::trajectories::rigid_path`]):
//!
//! ```text
//! mu = m R x + X       scale = m exp(s)       rotation = q_R * q/|q|
//! ```
//!
//! With `g` the gradient by `mu` and `G` that by the rotation:
//!
//! ```text
//! dx = m R^T g     dX = sum g     d(q/|q|) = conj(q_R) * G     ds = scale . d(scale)
//! dheading = sum g . (up x (mu - X)) + G . ((0, up)/2 * rotation)
//! ```
//!
//! Colours do not depend on direction, because harmonics would have to turn with the object. An object is
//! invisible before and after its path.

pub(crate) mod gpu;

use glam::{Quat, Vec3};
use rayon::prelude::*;

use super::{
    ActivatedGaussians,
    device_twin::DeviceTwin,
    parameterization::{Parameterization, Viewpoint},
    sh_rest_count,
    static_gaussians::{self, InitialGaussians, POSITIONS},
    temporal::TemporalFeatures,
};
use crate::{
    clock::TimeSpan,
    parameters::{ParameterTable, SharedParameters},
    trajectories::rigid_path::{RigidPath, RigidPose},
};

/// Name of the corrections of the objects' paths among the arrays of a model.
pub const OBJECT_POSES: &str = "object_poses";
/// Name of the array of centres in the objects' coordinates.
pub const OBJECT_POSITIONS: &str = "object_positions";
/// Name of the array with the object number of each Gaussian; it is not trained.
pub const OBJECT_NUMBERS: &str = "object_numbers";
/// Index of [`OBJECT_NUMBERS`] in the table.
const NUMBERS: usize = 5;
/// Margin of an object's box in which its Gaussians may lie, as a share of its sides.
const MARGIN: f32 = 0.1;

/// An object with its box.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedObject {
    /// Id in the tracks.
    pub id: u32,
    /// Length, width and height of the box, normalized units.
    pub dimensions: [f32; 3],
    /// Path of the object.
    pub path: RigidPath,
}

impl TrackedObject {
    /// Returns the largest side of the box, which is the unit of the object's coordinates.
    pub fn unit(&self) -> f32 {
        self.dimensions
            .iter()
            .copied()
            .fold(f32::MIN_POSITIVE, f32::max)
    }

    /// Returns half the sides of the box, in the object's coordinates.
    pub fn half_box(&self) -> [f32; 3] {
        self.dimensions.map(|side| 0.5 * side / self.unit())
    }
}

/// Gaussians that belong to rigid objects.
pub trait ObjectGaussians {
    /// Returns the objects.
    fn objects(&self) -> &[TrackedObject];

    /// Returns the object ids of a table's Gaussians.
    fn ids(&self, table: &ParameterTable) -> Vec<u32>;
}

/// The parameterization of a table of [`table`].
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedGaussians {
    /// The objects.
    pub objects: Vec<TrackedObject>,
    /// Corrections of their paths, object after object.
    pub corrections: SharedParameters,
    /// True if corrections are trained.
    pub refines_poses: bool,
    /// True if the last step gave gradients to corrections.
    has_gradients: bool,
}

/// Creates a table of Gaussians of objects, each in the coordinates of its object, whose number is in
/// `numbers`.
pub fn table(initial: &InitialGaussians, numbers: &[usize]) -> ParameterTable {
    let mut table = static_gaussians::table(initial, 0);
    table.arrays[POSITIONS].name = OBJECT_POSITIONS;
    let numbers = numbers.iter().map(|&number| number as f32).collect();
    let array = table.add(OBJECT_NUMBERS, 1, numbers, 0.0);
    table.freeze(array);
    table
}

impl TrackedGaussians {
    /// Creates objects on uncorrected paths.
    pub fn new(objects: Vec<TrackedObject>, refines_poses: bool) -> Self {
        let values = objects
            .iter()
            .map(|object| object.path.correction_len())
            .sum();
        Self {
            objects,
            corrections: SharedParameters::new(OBJECT_POSES, vec![0.0; values]),
            refines_poses,
            has_gradients: false,
        }
    }

    /// Returns the range of every object's corrections among all.
    fn correction_ranges(&self) -> Vec<std::ops::Range<usize>> {
        let mut begin = 0;
        let range = |object: &TrackedObject| {
            let from = begin;
            begin += object.path.correction_len();
            from..begin
        };
        self.objects.iter().map(range).collect()
    }

    /// Returns the poses of the objects at a time; `None` for an object that is not on its path then.
    pub fn poses(&self, seconds: f64) -> Vec<Option<RigidPose>> {
        let values = &self.corrections.array.values;
        self.objects
            .iter()
            .zip(self.correction_ranges())
            .map(|(object, range)| object.path.pose(seconds, &values[range]))
            .collect()
    }

    /// Returns the object numbers of a table's Gaussians.
    pub fn numbers<'t>(&self, table: &'t ParameterTable) -> impl Iterator<Item = usize> + 't {
        let last = self.objects.len().saturating_sub(1);
        let numbers = table.arrays[NUMBERS].values.iter();
        numbers.map(move |&number| (number as usize).min(last))
    }
}

impl ObjectGaussians for TrackedGaussians {
    fn objects(&self) -> &[TrackedObject] {
        &self.objects
    }

    fn ids(&self, table: &ParameterTable) -> Vec<u32> {
        self.numbers(table)
            .map(|number| self.objects[number].id)
            .collect()
    }
}

impl Parameterization for TrackedGaussians {
    fn id(&self) -> &'static str {
        "tracked"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        static_gaussians::activate_from(table, first, out);
        let rows = first..first + table.len();
        features.write_untimed(self.untimed_lifespan(), rows, &mut out.features);
        let entries = first..first + table.len();
        let rest = sh_rest_count(out.sh_degree);
        out.sh_rest[entries.start * rest..entries.end * rest].fill([0.0; 3]);
        let poses = self.poses(at.seconds);
        let units: Vec<f32> = self.objects.iter().map(TrackedObject::unit).collect();
        let numbers: Vec<usize> = self.numbers(table).collect();
        (
            numbers.par_iter(),
            out.positions[entries.clone()].par_iter_mut(),
            out.scales[entries.clone()].par_iter_mut(),
            out.rotations[entries.clone()].par_iter_mut(),
            out.opacities[entries].par_iter_mut(),
        )
            .into_par_iter()
            .with_min_len(1024)
            .for_each(|(&number, position, scale, rotation, opacity)| {
                let Some(pose) = &poses[number] else {
                    *opacity = 0.0;
                    return;
                };
                let unit = units[number];
                let placed = pose.rotation * (Vec3::from_array(*position) * unit) + pose.centre;
                *position = placed.to_array();
                *scale = scale.map(|side| side * unit);
                *rotation = wxyz(pose.quaternion * quaternion(*rotation));
            });
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        _: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        let poses = self.poses(at.seconds);
        let mut by_pose = vec![(Vec3::ZERO, 0.0_f32); self.objects.len()];
        // In order, so that the sums do not depend on the number of threads.
        for (entry, number) in (first..).zip(self.numbers(table)) {
            let object = &self.objects[number];
            let Some(pose) = &poses[number] else {
                gradient.positions[entry] = [0.0; 3];
                gradient.scales[entry] = [0.0; 3];
                gradient.rotations[entry] = [0.0; 4];
                gradient.opacities[entry] = 0.0;
                gradient.sh_constant[entry] = [0.0; 3];
                continue;
            };
            let by_centre = Vec3::from_array(gradient.positions[entry]);
            let rotation = quaternion(activated.rotations[entry]);
            let by_rotation = quaternion(gradient.rotations[entry]);
            let up = object.path.up();
            let from_centre = Vec3::from_array(activated.positions[entry]) - pose.centre;
            let turned = Quat::from_xyzw(0.5 * up.x, 0.5 * up.y, 0.5 * up.z, 0.0) * rotation;
            let (sum, by_heading) = &mut by_pose[number];
            *sum += by_centre;
            *by_heading += by_centre.dot(up.cross(from_centre)) + by_rotation.dot(turned);
            let back = pose.quaternion.conjugate();
            let by_own = pose.rotation.transpose() * by_centre * object.unit();
            gradient.positions[entry] = by_own.to_array();
            gradient.rotations[entry] = wxyz(back * by_rotation);
            activated.rotations[entry] = wxyz(back * rotation);
        }
        static_gaussians::activate_from_vjp(table, first, activated, gradient);
        let ranges = self.correction_ranges();
        let gradients = &mut self.corrections.array.gradients;
        gradients.fill(0.0);
        for ((object, range), (by_centre, by_heading)) in
            self.objects.iter().zip(ranges).zip(by_pose)
        {
            object
                .path
                .pose_vjp(at.seconds, by_centre, by_heading, &mut gradients[range]);
        }
        self.has_gradients = true;
    }

    fn keep_within_bounds(&mut self, table: &mut ParameterTable) {
        let limits: Vec<[f32; 3]> = self
            .objects
            .iter()
            .map(|object| object.half_box().map(|half| half * (1.0 + MARGIN)))
            .collect();
        let numbers: Vec<usize> = self.numbers(table).collect();
        let positions = table.arrays[POSITIONS].values.as_chunks_mut::<3>().0;
        for (position, number) in positions.iter_mut().zip(numbers) {
            for (value, limit) in position.iter_mut().zip(limits[number]) {
                *value = value.clamp(-limit, limit);
            }
        }
        if self.refines_poses {
            let ranges = self.correction_ranges();
            let values = &mut self.corrections.array.values;
            for (object, range) in self.objects.iter().zip(ranges) {
                object.path.fix_gauge(&mut values[range]);
            }
        }
    }

    fn shared(&self) -> Option<&SharedParameters> {
        Some(&self.corrections)
    }

    fn shared_mut(&mut self) -> Option<&mut SharedParameters> {
        Some(&mut self.corrections)
    }

    fn stepped_shared(&mut self) -> Option<&mut SharedParameters> {
        let is_stepped = self.refines_poses && std::mem::take(&mut self.has_gradients);
        is_stepped.then_some(&mut self.corrections)
    }

    fn time_span(&self) -> Option<TimeSpan> {
        let span = |object: &TrackedObject| {
            let [begin_seconds, end_seconds] = object.path.range_seconds();
            TimeSpan {
                begin_seconds,
                end_seconds,
                frames: None,
            }
        };
        self.objects.iter().map(span).reduce(TimeSpan::union)
    }

    fn unit_length(&self) -> Option<f32> {
        Some(1.0)
    }

    fn tracked(&self) -> Option<&dyn ObjectGaussians> {
        Some(self)
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        Some(self)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(self.clone())
    }
}

fn quaternion([w, x, y, z]: [f32; 4]) -> Quat {
    Quat::from_xyzw(x, y, z, w)
}

fn wxyz(quaternion: Quat) -> [f32; 4] {
    [quaternion.w, quaternion.x, quaternion.y, quaternion.z]
}

#[cfg(test)]
mod tests;
