//! Gaussians of a file in time, as a parameterization for rendering: the motions of the specification.
#![expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "columns are as long as the table, and tracks were checked"
)]

use std::{ops::Range, sync::Arc};

use glam::{Quat, Vec3};
use omnilife_engine::{
    clock::TimeSpan,
    gaussians::{
        ActivatedGaussians,
        parameterization::{Parameterization, Viewpoint},
        sh_rest_count, static_gaussians,
        temporal::TemporalFeatures,
    },
    parameters::ParameterTable,
};
use rayon::prelude::*;

use super::{
    arrays::columns,
    header::{Motion, Time},
    tracks::ObjectTrack,
};

/// Name of the parameterization.
pub(super) const ID: &str = "in-time";

/// Gaussians of one motion. Their tables have the arrays of static Gaussians and those of the motion, in seconds
/// from the begin of the file.
#[derive(Debug, Clone)]
pub(super) struct PlayedGaussians {
    pub(super) motion: Arc<Motion>,
    pub(super) time: Time,
}

impl PlayedGaussians {
    /// Moves Gaussians along their velocities by `way` (s) of the time from their peaks, and fades them.
    fn move_in_time(
        table: &ParameterTable,
        time: f64,
        (way, least): (impl Fn(f64) -> f64 + Sync, f32),
        (entries, out): (Range<usize>, &mut ActivatedGaussians),
    ) {
        let column = |name: &str| Some(&table.arrays[table.position(name)?].values[..]);
        let (velocities, peaks) = (column(columns::VELOCITY), column(columns::PEAK));
        let durations = column(columns::DURATION);
        let positions = out.positions[entries.clone()].par_iter_mut();
        let both = positions.zip(&mut out.opacities[entries]).enumerate();
        both.with_min_len(1024)
            .for_each(|(index, (position, opacity))| {
                let distance = time - peaks.map_or(0.0, |peaks| f64::from(peaks[index]));
                if let Some(velocities) = velocities {
                    let velocity = Vec3::from_slice(&velocities[3 * index..3 * index + 3]);
                    let moved = Vec3::from_array(*position) + velocity * way(distance) as f32;
                    *position = moved.to_array();
                }
                if let Some(durations) = durations {
                    let ratio = distance / f64::from(durations[index]);
                    let share = (-0.5 * ratio * ratio).exp() as f32;
                    *opacity *= if share > least { share } else { 0.0 };
                }
            });
    }

    /// Places Gaussians with their objects; those of absent objects are invisible.
    fn move_with_objects(
        table: &ParameterTable,
        time: f64,
        objects: &[ObjectTrack],
        (entries, out): (Range<usize>, &mut ActivatedGaussians),
    ) {
        let pose = |object: &ObjectTrack| {
            let pose = object.pose(time)?;
            Some((pose.rotation.as_quat(), pose.centre.as_vec3()))
        };
        let poses: Vec<Option<(Quat, Vec3)>> = objects.iter().map(pose).collect();
        let numbers = table.position(columns::OBJECT);
        let numbers = numbers.map_or(&[][..], |array| &table.arrays[array].values[..]);
        for (entry, number) in entries.zip(numbers) {
            let Some(Some((turn, centre))) = poses.get(*number as usize) else {
                out.opacities[entry] = 0.0;
                continue;
            };
            let placed = *turn * Vec3::from_array(out.positions[entry]) + *centre;
            out.positions[entry] = placed.to_array();
            let [w, x, y, z] = out.rotations[entry];
            let turned = *turn * Quat::from_xyzw(x, y, z, w);
            out.rotations[entry] = [turned.w, turned.x, turned.y, turned.z];
        }
    }
}

impl Parameterization for PlayedGaussians {
    fn id(&self) -> &'static str {
        ID
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
        let entries = first..first + table.len();
        let rows = |width: usize| width * entries.start..width * entries.end;
        if static_gaussians::sh_degree(table) == 0 {
            out.sh_rest[rows(sh_rest_count(out.sh_degree))].fill([0.0; 3]);
        }
        let channels = features.count();
        if channels > 0 {
            for row in out.features[rows(channels)].chunks_mut(channels) {
                features.write(Vec3::ZERO, f32::INFINITY, row);
            }
        }
        let time = at.seconds - self.time.begin;
        match &*self.motion {
            Motion::Static => {}
            Motion::Linear => {
                Self::move_in_time(table, time, (|distance: f64| distance, 0.0), (entries, out));
            }
            Motion::Periodic { cycle, least } => {
                let way = |distance: f64| {
                    let cycles = distance / cycle;
                    let angle = std::f64::consts::TAU * (cycles - cycles.round());
                    cycle / std::f64::consts::TAU * angle.sin()
                };
                Self::move_in_time(table, time, (way, *least), (entries, out));
            }
            Motion::Rigid { objects } => {
                Self::move_with_objects(table, time, objects, (entries, out));
            }
        }
    }

    /// Writes gradients of zero: files are rendered and not trained.
    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        _: &Viewpoint,
        _: &TemporalFeatures,
        _: usize,
        _: &mut ActivatedGaussians,
        _: &mut ActivatedGaussians,
    ) {
        for array in &mut table.arrays {
            array.gradients.fill(0.0);
        }
    }

    fn tells_static_from_dynamic(&self) -> bool {
        *self.motion == Motion::Static
    }

    fn time_span(&self) -> Option<TimeSpan> {
        (*self.motion != Motion::Static).then_some(TimeSpan {
            begin_seconds: self.time.begin,
            end_seconds: self.time.begin + self.time.seconds,
            frames: self.time.frames,
        })
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(self.clone())
    }
}
