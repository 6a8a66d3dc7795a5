//! Learning rates over time.

use serde::{Deserialize, Serialize};

/// A rate that falls log-linearly from `begin` to `end` over the whole run (3DGS
/// `utils/general_utils.py`; its delay is inactive there).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decay {
    /// Rate at the first iteration; positive, unless both are 0.
    pub begin: f32,
    /// Rate at the last iteration; positive, unless both are 0.
    pub end: f32,
}

impl Decay {
    /// Creates a constant rate.
    pub const fn constant(rate: f32) -> Self {
        Self {
            begin: rate,
            end: rate,
        }
    }

    /// Returns the rate after a share of the run in [0, 1].
    pub fn at(&self, share: f32) -> f32 {
        if self.begin == 0.0 && self.end == 0.0 {
            // 0 has no logarithm.
            return 0.0;
        }
        let share = share.clamp(0.0, 1.0);
        (self.begin.ln() * (1.0 - share) + self.end.ln() * share).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falls_log_linearly() {
        let decay = Decay {
            begin: 1e-2,
            end: 1e-4,
        };
        assert!((decay.at(0.0) - 1e-2).abs() < 1e-8);
        assert!((decay.at(0.5) - 1e-3).abs() < 1e-8);
        assert!((decay.at(2.0) - 1e-4).abs() < 1e-9);
        assert!((Decay::constant(0.3).at(0.7) - 0.3).abs() < 1e-6);
        assert_eq!(Decay::constant(0.0).at(0.7), 0.0);
    }
}
