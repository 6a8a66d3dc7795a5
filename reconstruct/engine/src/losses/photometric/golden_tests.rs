//! The loss against values by `scripts/golden/ssim.py`.

use serde_json::Value;

use super::{Columns, cpu::Loss, reference::ReferencePair};
use crate::golden_tests::numbers;

/// Returns an image as the script generates it.
fn image(count: usize, phase: f64) -> Vec<f64> {
    (0..count)
        .map(|at| 0.5 + 0.4 * (1.3 * at as f64 + phase).sin())
        .collect()
}

#[test]
fn value_and_gradient_are_those_of_another_program() {
    let text = include_str!("../../../tests/golden/ssim.json");
    let golden: Value = serde_json::from_str(text).expect("the golden values are JSON");
    let [width, height] =
        ["width", "height"].map(|side| golden[side].as_u64().expect("a size") as usize);
    let lambda = golden["lambda"].as_f64().expect("a weight");
    let (render, target) = (
        image(3 * width * height, 0.2),
        image(3 * width * height, 1.1),
    );
    let narrow = |image: &[f64]| -> Vec<f32> { image.iter().map(|&value| value as f32).collect() };
    for case in golden["cases"].as_array().expect("a list") {
        let columns = if case["wraps"] == true {
            Columns::Wrap
        } else {
            Columns::End
        };
        let expected = numbers(&case["gradient"]);
        let pair = ReferencePair {
            width,
            height,
            columns,
            render: &render,
            target: &target,
            mask: &vec![1.0; width * height],
        };
        let reference = pair.value_and_gradient(lambda);
        let mut loss = Loss::new(width, height, columns);
        let (value, gradient) =
            loss.forward_backward(&narrow(&render), &narrow(&target), lambda as f32);
        for (found, tolerance) in [(reference.0, 1e-9), (value, 1e-6)] {
            for (found, name) in [
                (found.l1, "l1"),
                (found.ssim, "ssim"),
                (found.total, "total"),
            ] {
                let expected = case[name].as_f64().expect("a number");
                let error = (found - expected).abs();
                assert!(error < tolerance, "{columns:?} {name}: {found} {expected}");
            }
        }
        // Differences of the script are exact to 1e-8.
        for (at, expected) in expected.iter().enumerate() {
            for (found, tolerance) in [(reference.1[at], 1e-8), (f64::from(gradient[at]), 2e-7)] {
                let error = (found - expected).abs();
                assert!(error < tolerance, "{columns:?} {at}: {found} {expected}");
            }
        }
    }
    let of = |case: usize| numbers(&golden["cases"][case]["gradient"]);
    assert!(of(0) != of(1), "borders make a difference");
}
