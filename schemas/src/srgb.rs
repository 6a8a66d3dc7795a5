//! The transfer function of sRGB (IEC 61966-2-1), between coded levels and linear light.
//!
//! Levels and light are in `[0, 1]`; the curve goes on above 1, and as a line below 0.

/// Returns the linear light of a level.
pub fn to_linear(level: f32) -> f32 {
    if level <= 0.040_45 {
        level / 12.92
    } else {
        ((level + 0.055) / 1.055).powf(2.4)
    }
}

/// Returns the level of linear light.
pub fn from_linear(light: f32) -> f32 {
    if light <= 0.003_130_8 {
        12.92 * light
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

/// Returns the level of `gain` times the light of a level.
pub fn brightened(level: f32, gain: f32) -> f32 {
    from_linear(gain * to_linear(level))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_and_light_belong_together() {
        // The level 0.5 and the middle of the linear part, by the standard's formulas.
        for (level, light) in [
            (0.0, 0.0),
            (0.5, 0.214_041_14),
            (0.02, 0.001_547_988),
            (1.0, 1.0),
        ] {
            assert!((to_linear(level) - light).abs() < 1e-6, "{level}");
            assert!((from_linear(light) - level).abs() < 1e-6, "{light}");
        }
        for level in [-0.1, 0.01, 0.04, 0.05, 0.7, 1.3] {
            assert!(
                (from_linear(to_linear(level)) - level).abs() < 1e-5,
                "{level}"
            );
            assert!((brightened(brightened(level, 8.0), 0.125) - level).abs() < 1e-5);
        }
    }
}
