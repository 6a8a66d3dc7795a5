//! The parameterization of Gaussians with their own times (PVG, Omni4DGS).

use glam::Vec3;

use super::{
    ActivatedGaussians,
    device_twin::DeviceTwin,
    omni4dgs::{DirectionOrigin, Observer},
    parameterization::{Parameterization, Viewpoint},
    periodic::FrameTime,
    temporal::{TemporalFeatures, TimeModel, VelocityModel, ViewContext},
};
use crate::{
    clock::{Clock, TimeSpan},
    parameters::ParameterTable,
};

/// Parameterization of a table of [`super::temporal`] in a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalGaussians {
    /// Conversion from seconds to frames.
    pub clock: Clock,
    /// Dependence of Gaussians on time.
    pub time: TimeModel,
    /// The mean vertical of the input cameras, from zenith to nadir.
    pub down: [f32; 3],
    /// `theta_dgm`: Gaussians whose staticness is below it are dynamic.
    pub dynamic_below_staticness: f32,
}

impl TemporalGaussians {
    /// Returns the time of a viewpoint in frames, and the observer of decomposed velocities.
    pub fn look(&self, at: &Viewpoint) -> ViewContext {
        let origin = match self.time.velocity {
            VelocityModel::Decomposed(decomposition) => decomposition.origin,
            _ => DirectionOrigin::World,
        };
        ViewContext {
            frame_time: FrameTime {
                frame: self.clock.frame(at.seconds),
                shift: at.shift_frames,
            },
            observer: match origin {
                DirectionOrigin::World => self.world_observer(),
                DirectionOrigin::Camera => Observer {
                    centre: at.centre,
                    down: at.down,
                },
            },
        }
    }

    /// Returns the observer at the origin of the world.
    pub fn world_observer(&self) -> Observer {
        Observer {
            centre: Vec3::ZERO,
            down: Vec3::from_array(self.down),
        }
    }

    /// Returns the indices of the Gaussians of a table whose staticness is below the threshold (`dynamic`),
    /// or those of the others.
    pub fn members(&self, table: &ParameterTable, look: &ViewContext, dynamic: bool) -> Vec<usize> {
        let temporal_table = self.time.temporal_table(table, look.observer);
        (0..table.len())
            .filter(|&index| {
                (temporal_table.staticness(index) < self.dynamic_below_staticness) == dynamic
            })
            .collect()
    }
}

impl Parameterization for TemporalGaussians {
    fn id(&self) -> &'static str {
        "temporal"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        let look = self.look(at);
        self.time.activate_from(table, &look, features, first, out);
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        let look = self.look(at);
        self.time
            .activate_from_vjp(table, &look, features, first, activated, gradient);
    }

    fn keep_within_bounds(&mut self, table: &mut ParameterTable) {
        self.time.keep_within_bounds(table);
    }

    fn temporal(&self) -> Option<&TemporalGaussians> {
        Some(self)
    }

    fn time_span(&self) -> Option<TimeSpan> {
        Some(self.clock.span())
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        Some(self)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(*self)
    }
}
