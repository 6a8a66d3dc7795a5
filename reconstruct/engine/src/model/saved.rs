//! Format of a model in a checkpoint: a header in JSON, and a body of 32-bit words.
//!
//! ```text
//! body: f32, little-endian; for each part: of each array its values, first and second moments (of a frozen
//!       one its values alone); then the sums of its density statistics, their views as u32, and the
//!       sums of its time gradients, if it has any; then its shared parameters, with moments.
//!       Then the response of the camera with its moments, array by array, if it is learnt, and the
//!       corrections of poses with theirs, if poses are refined.
//! ```
//!
//! Gradients are not kept: every step overwrites them.

use serde::{Deserialize, Serialize};

use super::{Model, Part, Statistics, camera_response::CameraResponse};
use crate::parameters::{ParameterArray, ParameterTable, SharedParameters};

/// Header: layout of the body's words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedModel {
    parts: Vec<SavedPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    response: Option<SavedResponse>,
    /// Optimizer steps of each input view's pose.
    pose_steps: Option<Vec<u64>>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedPart {
    parameterization: String,
    gaussians: usize,
    arrays: Vec<SavedArray>,
    with_times: bool,
    shared: Option<SavedShared>,
    /// Optimizer steps of a shard.
    #[serde(default, skip_serializing_if = "is_zero")]
    steps: u64,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature that serde calls"
)]
fn is_zero(steps: &u64) -> bool {
    *steps == 0
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedArray {
    name: String,
    width: usize,
    /// True for an array without moments.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    frozen: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct SavedShared {
    values: usize,
    steps: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SavedResponse {
    /// Optimizer steps of each input view's gain.
    gain_steps: Vec<u64>,
    shared: SavedShared,
}

impl SavedResponse {
    fn of(response: &CameraResponse) -> Self {
        Self {
            gain_steps: response.steps.clone(),
            shared: saved_shared(&response.shared),
        }
    }

    /// Returns the numbers of gains and of shared values.
    fn lengths(&self) -> [usize; 2] {
        [self.gain_steps.len(), self.shared.values]
    }

    /// Returns the number of its words; `None` if it overflows.
    fn words(&self) -> Option<usize> {
        let gains = self.gain_steps.len().checked_mul(3)?;
        gains.checked_add(self.shared.values)?.checked_mul(3)
    }
}

/// Error in restoring a saved model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LoadError {
    /// The saved model has other parts.
    Other,
    /// The file is damaged; the reason.
    Damaged(String),
}

impl SavedModel {
    /// Returns the header and the body of a model.
    pub fn of(model: &Model) -> (Self, Vec<u8>) {
        let header = Self {
            parts: model.parts.iter().map(saved_part).collect(),
            response: model.response.as_ref().map(SavedResponse::of),
            pose_steps: model.poses.as_ref().map(|poses| poses.steps.clone()),
        };
        let mut body = Vec::new();
        for part in &model.parts {
            part.table
                .arrays
                .iter()
                .for_each(|array| push_array(&mut body, array));
            push_floats(&mut body, &part.statistics.sums);
            let views = part.statistics.views.iter();
            body.extend(views.flat_map(|views| views.to_le_bytes()));
            push_floats(&mut body, &part.statistics.time_gradients);
            if let Some(shared) = part.parameterization.shared() {
                push_array(&mut body, &shared.array);
            }
        }
        let response = model.response.iter().flat_map(CameraResponse::arrays);
        let poses = model.poses.iter().flat_map(|poses| &poses.table.arrays);
        for array in response.chain(poses) {
            push_array(&mut body, array);
        }
        (header, body)
    }

    /// Restores the saved values into `model`, which must have the same parts and arrays as at the start of
    /// the run.
    ///
    /// # Errors
    /// If its parts differ, or the body is truncated or not finite; then `model` must not be used.
    pub fn restore(&self, body: &[u8], model: &mut Model) -> Result<(), LoadError> {
        let is_alike = self.parts.len() == model.parts.len()
            && self
                .parts
                .iter()
                .zip(&model.parts)
                .all(|(saved, part)| saved.is_of(part))
            && self.response.as_ref().map(SavedResponse::lengths)
                == (model.response.as_ref()).map(|response| SavedResponse::of(response).lengths())
            && self.pose_steps.as_ref().map(Vec::len)
                == model.poses.as_ref().map(|poses| poses.steps.len());
        if !is_alike {
            return Err(LoadError::Other);
        }
        let expected = self
            .body_bytes()
            .ok_or_else(|| LoadError::Damaged("its header is not possible".to_owned()))?;
        if body.len() != expected {
            return Err(LoadError::Damaged(format!(
                "is truncated: {} of {expected} bytes of Gaussians",
                body.len()
            )));
        }
        let mut words = Words(body.as_chunks::<4>().0.iter());
        for (saved, part) in self.parts.iter().zip(&mut model.parts) {
            part.table = words.table(saved.gaussians, &part.table);
            part.statistics = Statistics {
                sums: words.floats(saved.gaussians),
                views: words
                    .take(saved.gaussians)
                    .map(u32::from_le_bytes)
                    .collect(),
                time_gradients: words.floats(saved.times()),
            };
            part.steps = saved.steps;
            if let (Some(saved), Some(shared)) = (saved.shared, part.parameterization.shared_mut())
            {
                *shared = words.shared(saved, shared.array.name);
            }
        }
        if let (Some(response), Some(saved)) = (&mut model.response, &self.response) {
            response.gains = words.table(saved.gain_steps.len(), &response.gains);
            response.steps.clone_from(&saved.gain_steps);
            response.shared = words.shared(saved.shared, response.shared.array.name);
        }
        if let (Some(poses), Some(steps)) = (&mut model.poses, &self.pose_steps) {
            *poses = poses.with_values(words.table(steps.len(), &poses.table), steps.clone());
        }
        model
            .not_finite()
            .map_or(Ok(()), |reason| Err(LoadError::Damaged(reason)))
    }

    /// Returns the length of the body; `None` if it overflows.
    fn body_bytes(&self) -> Option<usize> {
        // Each array has values and two moments.
        let poses = self.pose_steps.as_ref().map_or(0, Vec::len);
        let response = self
            .response
            .as_ref()
            .map_or(Some(0), SavedResponse::words)?;
        let mut words = poses.checked_mul(3 * 6)?.checked_add(response)?;
        for part in &self.parts {
            let values = part.arrays.iter().try_fold(0_usize, |sum, array| {
                let columns = if array.frozen { 1 } else { 3 };
                sum.checked_add(array.width.checked_mul(columns)?)
            })?;
            // Each Gaussian also has a sum and a view count.
            let of_one = values.checked_add(2)?;
            let of_table = part.gaussians.checked_mul(of_one)?;
            let of_shared = part.shared.map_or(0, |shared| shared.values);
            words = words
                .checked_add(of_table)?
                .checked_add(part.times())?
                .checked_add(of_shared.checked_mul(3)?)?;
        }
        words.checked_mul(size_of::<f32>())
    }
}

impl SavedPart {
    /// Returns the number of Gaussians with time gradients.
    fn times(&self) -> usize {
        if self.with_times { self.gaussians } else { 0 }
    }

    /// Returns true if a part has the same kind, for any number of Gaussians.
    fn is_of(&self, part: &Part) -> bool {
        let shared = |saved: &Self| saved.shared.map(|shared| shared.values);
        let expected = saved_part(part);
        self.parameterization == expected.parameterization
            && self.arrays == expected.arrays
            && self.with_times == expected.with_times
            && shared(self) == shared(&expected)
    }
}

fn saved_part(part: &Part) -> SavedPart {
    let array = |array: &ParameterArray| SavedArray {
        name: array.name.to_owned(),
        width: array.width,
        frozen: array.is_frozen(),
    };
    SavedPart {
        parameterization: part.parameterization.id().to_owned(),
        gaussians: part.table.len(),
        arrays: part.table.arrays.iter().map(array).collect(),
        with_times: part.parameterization.temporal().is_some(),
        shared: part.parameterization.shared().map(saved_shared),
        steps: part.steps,
    }
}

fn saved_shared(shared: &SharedParameters) -> SavedShared {
    SavedShared {
        values: shared.array.values.len(),
        steps: shared.steps,
    }
}

fn push_array(body: &mut Vec<u8>, array: &ParameterArray) {
    for column in [&array.values, &array.first_moments, &array.second_moments] {
        push_floats(body, column);
    }
}

fn push_floats(body: &mut Vec<u8>, values: &[f32]) {
    body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

/// Unread words of a body, whose length matches its header.
struct Words<'a>(std::slice::Iter<'a, [u8; 4]>);

impl Words<'_> {
    fn take(&mut self, count: usize) -> impl Iterator<Item = [u8; 4]> {
        self.0.by_ref().take(count).copied()
    }

    fn floats(&mut self, count: usize) -> Vec<f32> {
        self.take(count).map(f32::from_le_bytes).collect()
    }

    fn shared(&mut self, saved: SavedShared, name: &'static str) -> SharedParameters {
        let mut shared = SharedParameters::new(name, self.floats(saved.values));
        shared.array.first_moments = self.floats(saved.values);
        shared.array.second_moments = self.floats(saved.values);
        shared.steps = saved.steps;
        shared
    }

    fn table(&mut self, gaussians: usize, template: &ParameterTable) -> ParameterTable {
        let mut table = ParameterTable::new(gaussians);
        for array in &template.arrays {
            let count = gaussians * array.width;
            let added = table.add(array.name, array.width, self.floats(count), 0.0);
            if array.is_frozen() {
                table.freeze(added);
                continue;
            }
            table.arrays[added].first_moments = self.floats(count);
            table.arrays[added].second_moments = self.floats(count);
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        clock::Clock,
        gaussians::{
            deformable::{Deformable, DeformationModel, settings::DeformationSettings},
            static_gaussians::{self, InitialGaussians, POSITIONS, StaticGaussians},
            temporal::{InitialTimes, TimeModel, VelocityModel},
            temporal_gaussians::TemporalGaussians,
        },
        model::pose_corrections::PoseCorrections,
    };
    use omnilife_schemas::camera::PinholeCamera;

    const CLOCK: Clock = Clock::new(0.0, 1.0, 4.0);

    fn initial() -> InitialGaussians {
        InitialGaussians {
            positions: vec![[1.0, 2.0, 3.0]; 4],
            scales: vec![[0.5; 3]; 4],
            rotations: vec![static_gaussians::NO_ROTATION; 4],
            colours: vec![[0.5; 3]; 4],
            opacities: vec![0.5; 4],
        }
    }

    /// Returns a model with a part of each kind, a camera's response, and poses.
    fn model() -> Model {
        let temporal = TemporalGaussians {
            clock: CLOCK,
            time: TimeModel {
                cycle_frames: 10.0,
                lifespans: None,
                velocity: VelocityModel::Free,
                least_marginal: 0.0,
            },
            down: [0.0, 1.0, 0.0],
            dynamic_below_staticness: 1.0,
        };
        let deformation = DeformationSettings {
            clock: CLOCK,
            model: DeformationModel::published(1.0),
            warm_up_iterations: 0,
            time_noise: None,
        };
        let table = static_gaussians::table(&initial(), 1);
        let times = InitialTimes::constant(4, 0.0, 1.0);
        let moving = temporal.time.table(&initial(), &times, 1);
        let mut model = Model::new(vec![
            Part::new(StaticGaussians, table.clone()),
            Part::new(Deformable::new(deformation, vec![0.5; 9]), table),
            Part::new(temporal, moving),
        ]);
        let camera = PinholeCamera::with_horizontal_field_of_view(8, 6, 1.0).into();
        model.response = Some(CameraResponse::new(vec![0.5, 0.0], &camera, None));
        model.poses = Some(PoseCorrections::new(vec![0.5, 0.0]));
        model
    }

    #[test]
    fn what_is_saved_is_restored_to_the_bit() {
        let mut trained = model();
        trained.parts[0].table.arrays[2].second_moments[5] = f32::MIN_POSITIVE / 3.0;
        trained.parts[0].statistics.views[1] = u32::MAX;
        let moving = &mut trained.parts[2];
        moving.table.retain(&[true, false, true, true]);
        moving.forget_statistics();
        moving.statistics.time_gradients[2] = 0.25;
        if let Some(weights) = trained.parts[1].parameterization.shared_mut() {
            weights.array.second_moments[8] = 0.125;
            weights.steps = 6;
        }
        if let Some(response) = &mut trained.response {
            response.gains.arrays[0].values[5] = -0.25;
            response.steps[0] = 7;
            response.shared.array.first_moments[4] = 1e-9;
            response.shared.steps = 9;
        }
        if let Some(poses) = &mut trained.poses {
            poses.table.arrays[1].values[4] = -1e-7;
            poses.steps[1] = 3;
        }
        let (header, body) = SavedModel::of(&trained);
        let mut restored = model();
        assert_eq!(header.restore(&body, &mut restored), Ok(()));
        assert!(restored == trained);
    }

    #[test]
    fn other_models_short_bodies_and_poison_are_refused() {
        let (header, body) = SavedModel::of(&model());
        let mut other = Model::new(model().parts[..1].to_vec());
        assert_eq!(header.restore(&body, &mut other), Err(LoadError::Other));
        let short = header.restore(&body[..body.len() - 4], &mut model());
        assert!(matches!(short, Err(LoadError::Damaged(reason)) if reason.contains("truncated")));
        let mut poisoned = model();
        poisoned.parts[0].table.arrays[POSITIONS].first_moments[10] = f32::NAN;
        let (header, body) = SavedModel::of(&poisoned);
        assert_eq!(
            header.restore(&body, &mut model()),
            Err(LoadError::Damaged(
                "row 3 of positions is not finite".to_owned()
            ))
        );
    }
}
