//! Adam (Kingma and Ba 2015), dense: every Gaussian moves in every step, as in 3DGS.
//!
//! ```text
//! m = b1 m + (1 - b1) g        v = b2 v + (1 - b2) g^2
//! x = x - lr (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)
//! ```
//!
//! with `b1 = 0.9`, `b2 = 0.999`, `eps = 1e-15` (3DGS `scene/gaussian_model.py`).

pub mod cpu;
