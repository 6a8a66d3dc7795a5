//! Gaussians of a file in time, as tables in normalized coordinates.

use glam::DVec3;
use omnilife_engine::{
    gaussians::{MAX_SH_DEGREE, sh_rest_count, static_gaussians},
    parameters::ParameterTable,
};
use omnilife_schemas::records::InvalidGaussians;

use super::{
    FrameTransform,
    arrays::columns,
    header::{Motion, PartHeader},
    tracks::{ObjectTrack, quaternion, wxyz},
};
use crate::formats::{
    axes::HarmonicTurn,
    validity::{self, FileGaussian},
};

/// A part with the values of its arrays.
pub(super) struct DecodedPart<'a> {
    pub(super) header: &'a PartHeader,
    /// Values of its arrays, by name.
    pub(super) arrays: Vec<(&'a str, Vec<f32>)>,
}

/// Columns of motions in a table, with the reason to refuse a value.
const OF_MOTIONS: [(&str, &str, usize); 4] = [
    (columns::VELOCITY, "a velocity that is not finite", 3),
    (columns::PEAK, "a peak that is not finite", 1),
    (
        columns::DURATION,
        "a duration that is not positive and finite",
        1,
    ),
    (
        columns::OBJECT,
        "the number of an object that is not there",
        1,
    ),
];

impl DecodedPart<'_> {
    fn values(&self, name: &str) -> Option<&[f32]> {
        let mut arrays = self.arrays.iter();
        let (_, values) = arrays.find(|(known, _)| *known == name)?;
        Some(values)
    }

    /// Returns the motion in normalized coordinates.
    pub(super) fn motion(&self, placed: &FrameTransform) -> Motion {
        let place = |place: &[f64; 3]| placed.place(DVec3::from_array(*place)).to_array();
        let moved = |object: &ObjectTrack| ObjectTrack {
            positions: object.positions.iter().map(place).collect(),
            rotations: (object.rotations.iter())
                .map(|&rotation| wxyz(placed.turn * quaternion(rotation)))
                .collect(),
            ..object.clone()
        };
        match &self.header.motion {
            Motion::Rigid { objects } => Motion::Rigid {
                objects: objects.iter().map(moved).collect(),
            },
            other => other.clone(),
        }
    }

    /// Returns the valid Gaussians as a table, in normalized coordinates.
    pub(super) fn table(
        &self,
        placed: &FrameTransform,
        invalid: &mut InvalidGaussians,
    ) -> Result<ParameterTable, String> {
        let objects = match &self.header.motion {
            Motion::Rigid { objects } => Some(objects.len() as f32),
            _ => None,
        };
        let placed = match objects {
            Some(_) => placed.of_objects(),
            None => *placed,
        };
        let kept = self.kept(&placed, invalid)?;
        let float = |value: f64| value as f32;
        let base = kept.iter().map(|(_, valid)| valid);
        let mut columns_of_base: Vec<Vec<f32>> = vec![
            base.clone()
                .flat_map(|valid| valid.position.map(float))
                .collect(),
            base.clone()
                .flat_map(|valid| valid.log_scales.map(float))
                .collect(),
            base.clone()
                .flat_map(|valid| valid.quaternion.map(float))
                .collect(),
            base.map(|valid| float(valid.opacity_logit)).collect(),
            self.chosen(columns::COLOUR, 3, &kept).unwrap_or_default(),
        ];
        let harmonics = self
            .arrays
            .iter()
            .find(|(name, _)| *name == columns::HARMONICS);
        let coefficients = harmonics.map_or(0, |(_, values)| {
            values.len().checked_div(self.header.count).unwrap_or(0)
        });
        let degree = (0..=MAX_SH_DEGREE)
            .find(|&degree| sh_rest_count(degree).saturating_mul(3) >= coefficients)
            .unwrap_or(0);
        if let Some(mut rows) = self.chosen(columns::HARMONICS, coefficients, &kept) {
            let turn = HarmonicTurn::new(placed.turn);
            for row in rows.chunks_exact_mut(coefficients.max(1)) {
                turn.apply(row.as_chunks_mut().0);
            }
            columns_of_base.push(rows);
        }
        let finite = columns_of_base
            .iter()
            .flatten()
            .all(|value| value.is_finite());
        if !finite {
            return Err("has a number that is not finite, where its frame places it".to_owned());
        }
        let mut table = ParameterTable::new(kept.len());
        for (shape, values) in (static_gaussians::shapes(degree).iter()).zip(columns_of_base) {
            table.add(shape.name, shape.width, values, 0.0);
        }
        for (name, refused, width) in OF_MOTIONS {
            let Some(mut values) = self.chosen(name, width, &kept) else {
                continue;
            };
            let is_sound = |value: &f32| match name {
                columns::DURATION => value.is_finite() && *value > 0.0,
                columns::OBJECT => objects.is_some_and(|count| (0.0..count).contains(value)),
                _ => value.is_finite(),
            };
            if name == columns::OBJECT {
                for value in &mut values {
                    *value = value.round();
                }
            }
            if name == columns::VELOCITY {
                for value in values.as_chunks_mut::<3>().0 {
                    let velocity = DVec3::from_array(value.map(f64::from));
                    *value = placed.vector(velocity).as_vec3().to_array();
                }
            }
            if !values.iter().all(is_sound) {
                return Err(format!("has {refused}"));
            }
            table.add(name, width, values, 0.0);
        }
        Ok(table)
    }

    /// Returns the rows of an array of these Gaussians.
    fn chosen(&self, name: &str, width: usize, kept: &[(usize, FileGaussian)]) -> Option<Vec<f32>> {
        let values = self.values(name)?;
        let row = |index: usize| {
            let begin = width.checked_mul(index)?;
            values.get(begin..begin.checked_add(width)?)
        };
        let rows = kept.iter().filter_map(|(index, _)| row(*index));
        Some(rows.flatten().copied().collect())
    }

    /// Returns the valid Gaussians with their numbers.
    fn kept(
        &self,
        placed: &FrameTransform,
        invalid: &mut InvalidGaussians,
    ) -> Result<Vec<(usize, FileGaussian)>, String> {
        let values = |name| self.values(name).unwrap_or_default();
        let rows = (values(columns::POSITION).as_chunks::<3>().0.iter())
            .zip(values(columns::SIZE).as_chunks::<3>().0)
            .zip(values(columns::ROTATION).as_chunks::<4>().0)
            .zip(values(columns::OPACITY));
        let log_factor = placed.factor.ln();
        let mut kept = Vec::new();
        for (index, (((position, size), rotation), opacity)) in rows.enumerate() {
            let is_sound = position
                .iter()
                .chain(rotation)
                .all(|value| value.is_finite())
                && size.iter().all(|value| value.is_finite() && *value >= 0.0)
                && (0.0..=1.0).contains(opacity);
            if !is_sound {
                return Err(format!(
                    "has a Gaussian {index} whose place, size, rotation or opacity is not possible"
                ));
            }
            let opacity = f64::from(*opacity);
            let own = quaternion(rotation.map(f64::from));
            let place = placed.place(DVec3::from_array(position.map(f64::from)));
            let given = FileGaussian {
                position: place.to_array(),
                log_scales: size.map(|size| f64::from(size).ln() + log_factor),
                opacity_logit: (opacity / (1.0 - opacity)).ln(),
                quaternion: wxyz(placed.turn * own),
            };
            if let Some(valid) = validity::valid(&given, invalid) {
                kept.push((index, valid));
            }
        }
        Ok(kept)
    }
}
