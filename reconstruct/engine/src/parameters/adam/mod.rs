//! Adam (Kingma and Ba 2015), dense: every Gaussian moves in every step, as in 3DGS.
//!
//! ```text
//! m = b1 m + (1 - b1) g        v = b2 v + (1 - b2) g^2
//! x = x - lr (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)
//! ```
//!
//! with `b1 = 0.9`, `b2 = 0.999`, `eps = 1e-15` (3DGS `scene/gaussian_model.py`); `b2` may be smaller
//! ([`SecondMomentDecay`]).

pub mod cpu;
pub(crate) mod gpu;

/// `b2`: second moments are means over about `1 / (1 - b2)` steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondMomentDecay(pub f32);

impl SecondMomentDecay {
    /// Decay of 3DGS.
    pub const PUBLISHED: Self = Self(0.999);
}

impl Default for SecondMomentDecay {
    fn default() -> Self {
        Self::PUBLISHED
    }
}

/// Bias corrections of one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corrections {
    correction_1: f64,
    /// `b2`.
    pub(crate) beta_2: f32,
    /// `1 / sqrt(1 - b2^t)`.
    pub(crate) inverse_root: f32,
}

impl Corrections {
    /// Returns the step size divided by `1 - b1^t`.
    pub(crate) fn rate(&self, learning_rate: f32) -> f32 {
        (f64::from(learning_rate) / self.correction_1) as f32
    }
}

/// Returns the corrections of step number `step`, from 1.
pub(crate) fn corrections(step: u64, decay: SecondMomentDecay) -> Corrections {
    // The corrections are 1 to the last bit long before this number of steps.
    let exponent = step.min(100_000) as i32;
    Corrections {
        correction_1: 1.0 - f64::from(BETA_1).powi(exponent),
        beta_2: decay.0,
        inverse_root: (1.0 / (1.0 - f64::from(decay.0).powi(exponent)).sqrt()) as f32,
    }
}

const BETA_1: f32 = 0.9;
const EPSILON: f32 = 1e-15;
