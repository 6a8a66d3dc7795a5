//! Golden values of the operations of Neural Atlas Graphs, written by `scripts/golden/neural_atlas.py`.

use std::sync::LazyLock;

use glam::DVec3;
use serde_json::Value;

pub(crate) fn golden() -> &'static Value {
    static GOLDEN: LazyLock<Value> = LazyLock::new(|| {
        let text = include_str!("../tests/golden/neural_atlas.json");
        serde_json::from_str(text).expect("the golden values are JSON")
    });
    &GOLDEN
}

/// Returns a list of numbers.
pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().expect("a list");
    let number = |value: &Value| value.as_f64().expect("a number");
    values.iter().map(number).collect()
}

/// Returns a list of three numbers as a vector.
pub(crate) fn vector(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

/// Returns parameters as the script generates them: `size sin(1.3 i + phase)`.
pub(crate) fn wave(count: usize, phase: f64, size: f64) -> Vec<f32> {
    (0..count)
        .map(|at| (size * (1.3 * at as f64 + phase).sin()) as f32)
        .collect()
}
