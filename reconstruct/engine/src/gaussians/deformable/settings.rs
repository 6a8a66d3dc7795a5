//! Training settings of a deformation; methods without a network have none.

use serde::{Deserialize, Serialize};

use crate::{clock::Clock, gaussians::deformable::DeformationModel};

/// Network, warm-up and time noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeformationSettings {
    /// Conversion from seconds to frames.
    pub clock: Clock,
    /// The network.
    pub model: DeformationModel,
    /// Iterations of the schedule that train the canonical Gaussians alone.
    pub warm_up_iterations: u64,
    /// Noise on the time of training views.
    pub time_noise: Option<TimeNoise>,
}

/// Annealed smoothing: noise on the network's time, normal, with a scale that falls to 0 while the network is
/// trained.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimeNoise {
    /// Standard deviation at the beginning, frames.
    pub begin_frames: f32,
    /// Iteration of the schedule at which the noise has fallen to 0.
    pub end_iteration: u64,
}

impl TimeNoise {
    /// Returns the standard deviation at an iteration of the schedule, frames.
    pub fn frames_at(&self, scheduled: u64) -> f32 {
        let over = scheduled as f32 / self.end_iteration.max(1) as f32;
        self.begin_frames * (1.0 - over).max(0.0)
    }
}

impl DeformationSettings {
    /// Returns the network's time `shift_frames` before a moment: 0 at the clip's first frame, 1 at its last.
    pub fn unit_time(&self, seconds: f64, shift_frames: f32) -> f32 {
        let frames = self.clock.frame(seconds) - f64::from(shift_frames);
        (frames / f64::from(self.clock.duration_frames.max(1.0)) + 0.5) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_runs_from_0_to_1_and_its_noise_ends() {
        let settings = DeformationSettings {
            clock: Clock::new(12.0, 0.1, 40.0),
            model: DeformationModel::published(1.0),
            warm_up_iterations: 10,
            time_noise: None,
        };
        for (seconds, expected) in [(10.0, 0.0), (12.0, 0.5), (14.0, 1.0)] {
            assert!((settings.unit_time(seconds, 0.0) - expected).abs() < 1e-6);
        }
        assert!((settings.unit_time(12.0, 4.0) - 0.4).abs() < 1e-6);
        let noise = TimeNoise {
            begin_frames: 0.2,
            end_iteration: 100,
        };
        assert_eq!(noise.frames_at(0), 0.2);
        assert!((noise.frames_at(50) - 0.1).abs() < 1e-7);
        assert_eq!([noise.frames_at(100), noise.frames_at(1_000)], [0.0; 2]);
        let one_frame = Clock {
            duration_frames: 0.0,
            ..settings.clock
        };
        let settings = DeformationSettings {
            clock: one_frame,
            ..settings
        };
        assert_eq!(settings.unit_time(12.0, 0.0), 0.5);
    }
}
