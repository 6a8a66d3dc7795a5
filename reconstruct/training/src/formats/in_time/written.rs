//! Closed forms of a model's parts, for files in time.
#![expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "the columns of a model are as long as its tables"
)]

use glam::DVec3;
use omnilife_engine::{
    clock::TimeSpan,
    gaussians::{
        ActivatedGaussians,
        omni4dgs::DirectionOrigin,
        sh_rest_count, static_gaussians,
        temporal::VelocityModel,
        temporal_gaussians::TemporalGaussians,
        tracked::{OBJECT_NUMBERS, ObjectGaussians, TrackedObject},
    },
    model::Part,
    parameters::SharedParameters,
};
use omnilife_schemas::records::InvalidGaussians;

use super::{
    FrameTransform,
    arrays::{ArrayHeader, Kind, Map, columns},
    header::{Motion, PartHeader},
    played,
    tracks::{ObjectTrack, quaternion, wxyz},
};
use crate::formats::{
    axes::HarmonicTurn,
    validity::{self, FileGaussian},
};

/// Opacity that rounds to 0 in 8 bits.
const LEAST_OPACITY: f32 = 0.5 / 255.0;

/// Columns of a motion, a value or a row per Gaussian; empty without the array.
#[derive(Debug, Default)]
struct MotionColumns {
    velocities: Vec<[f32; 3]>,
    peaks: Vec<f32>,
    durations: Vec<f32>,
    objects: Vec<f32>,
    /// Units of the objects' coordinates.
    units: Vec<f32>,
}

/// Parts on their way into a file.
#[derive(Debug)]
pub(super) struct PartWriter<'a> {
    pub(super) placed: FrameTransform,
    pub(super) span: TimeSpan,
    pub(super) degree: usize,
    pub(super) invalid: &'a mut InvalidGaussians,
    /// Number of Gaussians that are left out because their opacity rounds to 0.
    pub(super) transparent: u64,
    /// The arrays of all parts.
    pub(super) bytes: Vec<u8>,
}

impl PartWriter<'_> {
    /// Appends the arrays of a part. `None` if all its Gaussians are left out; an error gives the reason in one line
    /// if it has no closed form.
    pub(super) fn add(&mut self, part: &Part) -> Result<Option<PartHeader>, String> {
        let parameterization = &part.parameterization;
        let tracked = parameterization.tracked().zip(parameterization.shared());
        let (motion, of_motion) = if let Some(temporal) = parameterization.temporal() {
            self.temporal(temporal, part)?
        } else if let Some((tracked, corrections)) = tracked {
            self.rigid(tracked, corrections, part)?
        } else if parameterization.id() == played::ID {
            return Err("is a file in time already".to_owned());
        } else if parameterization.time_span().is_some() {
            return Err(format!(
                "{} Gaussians have no closed form in time; --format spz-sequence writes a file for each frame",
                parameterization.id()
            ));
        } else {
            (Motion::Static, MotionColumns::default())
        };
        let mut base = ActivatedGaussians::default();
        static_gaussians::activate(&part.table, &mut base);
        let is_rigid = matches!(motion, Motion::Rigid { .. });
        if is_rigid {
            for (index, &unit) in of_motion.units.iter().enumerate() {
                base.positions[index] = base.positions[index].map(|value| value * unit);
                base.scales[index] = base.scales[index].map(|value| value * unit);
            }
        }
        // Objects have axes of their own.
        let placed = if is_rigid {
            self.placed.of_objects()
        } else {
            self.placed
        };
        let kept = self.kept(&base, &placed);
        if kept.is_empty() {
            return Ok(None);
        }
        let mut arrays = self.base_arrays(&base, &kept)?;
        arrays.extend(self.motion_arrays(&of_motion, &kept)?);
        Ok(Some(PartHeader {
            count: kept.len(),
            motion,
            arrays,
        }))
    }

    fn temporal(
        &self,
        temporal: &TemporalGaussians,
        part: &Part,
    ) -> Result<(Motion, MotionColumns), String> {
        let (model, clock) = (&temporal.time, &temporal.clock);
        if let VelocityModel::Decomposed(decomposition) = model.velocity
            && decomposition.origin == DirectionOrigin::Camera
        {
            return Err(
                "velocities depend on the camera's place, which has no closed form in time; \
                 --format spz-sequence writes a file for each frame"
                    .to_owned(),
            );
        }
        let (moves, fades) = (
            model.velocity != VelocityModel::None,
            model.lifespans.is_some(),
        );
        if !moves && !fades {
            return Ok((Motion::Static, MotionColumns::default()));
        }
        let table = model.temporal_table(&part.table, temporal.world_observer());
        let mut found = MotionColumns::default();
        for index in 0..part.table.len() {
            let own = table.temporal_parameters(index);
            let peak = clock.origin_seconds + f64::from(own.peak) * clock.frame_seconds;
            found.peaks.push((peak - self.span.begin_seconds) as f32);
            if moves {
                let velocity = own.velocity.as_dvec3() / clock.frame_seconds;
                let velocity = self.placed.vector(velocity).as_vec3();
                found.velocities.push(velocity.to_array());
            }
            if fades {
                let seconds = f64::from(own.lifespan) * clock.frame_seconds;
                found.durations.push(seconds as f32);
            }
        }
        let motion = Motion::Periodic {
            cycle: f64::from(model.cycle_frames) * clock.frame_seconds,
            least: model.least_marginal.clamp(0.0, 1.0 - f32::EPSILON),
        };
        Ok((motion, found))
    }

    fn rigid(
        &self,
        tracked: &dyn ObjectGaussians,
        corrections: &SharedParameters,
        part: &Part,
    ) -> Result<(Motion, MotionColumns), String> {
        let objects = tracked.objects();
        let mut rest = &corrections.array.values[..];
        let mut tracks = Vec::new();
        for object in objects {
            let (own, others) = rest.split_at(object.path.correction_len());
            rest = others;
            let begin = self.span.begin_seconds;
            tracks.push(ObjectTrack::of(object, own, &self.placed, begin)?);
        }
        let units: Vec<f32> = objects.iter().map(TrackedObject::unit).collect();
        let numbers = part.table.position(OBJECT_NUMBERS);
        let numbers = numbers.map_or(&[][..], |array| &part.table.arrays[array].values[..]);
        let last = objects.len().saturating_sub(1);
        let numbers: Vec<usize> = (numbers.iter())
            .map(|&number| (number as usize).min(last))
            .collect();
        let columns = MotionColumns {
            objects: numbers.iter().map(|&number| number as f32).collect(),
            units: numbers.iter().map(|&number| units[number]).collect(),
            ..MotionColumns::default()
        };
        Ok((Motion::Rigid { objects: tracks }, columns))
    }

    /// Returns the Gaussians that a file can hold and that are visible, in its frame.
    fn kept(
        &mut self,
        base: &ActivatedGaussians,
        placed: &FrameTransform,
    ) -> Vec<(usize, FileGaussian)> {
        let mut kept = Vec::new();
        for index in 0..base.len() {
            let opacity = f64::from(base.opacities[index]);
            if base.opacities[index] < LEAST_OPACITY {
                self.transparent += 1;
                continue;
            }
            let position = DVec3::from_array(base.positions[index].map(f64::from));
            let rotation = placed.turn * quaternion(base.rotations[index].map(f64::from));
            let log_factor = placed.factor.ln();
            let given = FileGaussian {
                position: placed.place(position).to_array(),
                log_scales: base.scales[index].map(|scale| f64::from(scale).ln() + log_factor),
                opacity_logit: (opacity / (1.0 - opacity)).ln(),
                quaternion: wxyz(rotation),
            };
            if let Some(valid) = validity::valid(&given, self.invalid) {
                kept.push((index, valid));
            }
        }
        kept
    }

    fn base_arrays(
        &mut self,
        base: &ActivatedGaussians,
        kept: &[(usize, FileGaussian)],
    ) -> Result<Vec<ArrayHeader>, String> {
        let float = |value: f64| value as f32;
        let rows = |row: &dyn Fn(&(usize, FileGaussian)) -> [f32; 3]| -> Vec<f32> {
            kept.iter().flat_map(row).collect()
        };
        let places = rows(&|(_, valid)| valid.position.map(float));
        let sizes = rows(&|(_, valid)| valid.log_scales.map(|log| float(log.exp())));
        let turns = kept.iter().flat_map(|(_, valid)| {
            let length = valid.quaternion.iter().map(|part| part * part).sum::<f64>();
            valid.quaternion.map(|part| float(part / length.sqrt()))
        });
        let turns: Vec<f32> = turns.collect();
        let opacities: Vec<f32> = kept.iter().map(|(at, _)| base.opacities[*at]).collect();
        let colours = rows(&|(at, _)| base.sh_constant[*at]);
        let mut arrays = vec![
            self.array(columns::POSITION, 3, (Kind::U24, Map::Linear), &places)?,
            self.array(columns::SIZE, 3, (Kind::U16, Map::Exp), &sizes)?,
            self.array(columns::ROTATION, 4, (Kind::U16, Map::Linear), &turns)?,
            self.array(columns::OPACITY, 1, (Kind::U8, Map::Linear), &opacities)?,
            self.array(columns::COLOUR, 3, (Kind::U16, Map::Linear), &colours)?,
        ];
        let own = sh_rest_count(base.sh_degree);
        if own > 0 {
            let count = sh_rest_count(self.degree);
            let turn = HarmonicTurn::new(self.placed.turn);
            let harmonics = kept.iter().flat_map(|(at, _)| {
                let mut row = base.sh_rest[own * at..own * (at + 1)].to_vec();
                turn.apply(&mut row);
                row.resize(count, [0.0; 3]);
                row.into_iter().flatten()
            });
            let harmonics: Vec<f32> = harmonics.collect();
            let kind = (Kind::U8, Map::Linear);
            arrays.push(self.array(columns::HARMONICS, 3 * count, kind, &harmonics)?);
        }
        Ok(arrays)
    }

    fn motion_arrays(
        &mut self,
        found: &MotionColumns,
        kept: &[(usize, FileGaussian)],
    ) -> Result<Vec<ArrayHeader>, String> {
        let of = |values: &[f32]| -> Vec<f32> {
            let chosen = kept.iter().filter_map(|(at, _)| values.get(*at));
            chosen.copied().collect()
        };
        let velocities = kept.iter().filter_map(|(at, _)| found.velocities.get(*at));
        let velocities: Vec<f32> = velocities.flatten().copied().collect();
        let arrays = [
            (columns::VELOCITY, 3, Kind::U16, Map::Linear, velocities),
            (columns::PEAK, 1, Kind::U24, Map::Linear, of(&found.peaks)),
            (
                columns::DURATION,
                1,
                Kind::U16,
                Map::Exp,
                of(&found.durations),
            ),
            // A number has to come back as it is.
            (
                columns::OBJECT,
                1,
                Kind::F32,
                Map::Linear,
                of(&found.objects),
            ),
        ];
        let mut headers = Vec::new();
        for (name, width, kind, map, values) in arrays {
            if !values.is_empty() {
                headers.push(self.array(name, width, (kind, map), &values)?);
            }
        }
        Ok(headers)
    }

    fn array(
        &mut self,
        name: &str,
        width: usize,
        kind: (Kind, Map),
        values: &[f32],
    ) -> Result<ArrayHeader, String> {
        ArrayHeader::encode(name, width, kind, values, &mut self.bytes)
    }
}
