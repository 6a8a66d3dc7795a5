//! Predictions as arrays of values instead of 8-bit images.

use omnilife_schemas::{npy::Array, padded_frame::PaddedFrame};

/// Largest excess outside of [0, 1] of a renderer that overshoots.
const OVERSHOOT: f64 = 0.02;
/// Share of values further outside that shows another range. Views of a renderer with noise or a tenth too bright have
/// 10 % at most, [-1, 1] and the normalization of `ImageNet` 50 % and more.
const ANOTHER_RANGE: f64 = 0.25;

/// Returns the image of an array that fills a padded frame, of shape (height, width) or (height, width, channels);
/// arrays of another size unchanged.
pub(super) fn without_padding(array: Array, padded: Option<PaddedFrame>) -> Array {
    let (Some(frame), [rows, columns, others @ ..]) = (padded, array.shape.as_slice()) else {
        return array;
    };
    if frame.size().map(|side| side as usize) != [*columns, *rows] {
        return array;
    }
    let [width, height] = frame.image().map(|side| side as usize);
    Array {
        shape: [&[height, width], others].concat(),
        values: frame.crop(&array.values, others.iter().product()),
    }
}

/// Returns the share of the values that lie below -0.02 or above 1.02.
pub(super) fn outside_share(array: &Array) -> f64 {
    let is_outside = |value: &&f64| !(-OVERSHOOT..=1.0 + OVERSHOOT).contains(*value);
    let outside = array.values.iter().filter(is_outside).count();
    outside as f64 / array.values.len().max(1) as f64
}

/// Returns the scored bytes of an array of shape (height, width, 3) with values in [0, 1]: 255 times the value, rounded
/// to nearest, half up. So arrays have neither an advantage nor a disadvantage over PNG. Values outside of [0, 1]
/// become the nearest possible ones.
///
/// # Errors
/// The reason, without the file: another shape, a value that is not finite, or values in another range. That shows in a
/// mean above 1, whole numbers above 1, or more than a quarter of the values outside of [0, 1] by more than 0.02.
pub fn scored_bytes(array: &Array, width: u32, height: u32) -> Result<Vec<u8>, String> {
    let Array { shape, values } = array;
    let expected = [height as usize, width as usize, 3];
    if *shape != expected {
        return Err(format!("is of shape {shape:?}, expected {expected:?}"));
    }
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        let (row, column) = (at / 3 / width as usize, at / 3 % width as usize);
        let value = values[at];
        return Err(format!("holds {value} in row {row}, column {column}"));
    }
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    if mean > 1.0 {
        return Err(format!(
            "has a mean of {mean:.1}, expected values in [0, 1]"
        ));
    }
    let largest = values.iter().copied().fold(0.0, f64::max);
    if largest > 1.0 && values.iter().all(|value| value.fract() == 0.0) {
        return Err(format!(
            "holds whole numbers up to {largest}, expected values in [0, 1]"
        ));
    }
    let outside = outside_share(array);
    if outside > ANOTHER_RANGE {
        return Err(format!(
            "has {:.0} % of its values outside of [0, 1]",
            100.0 * outside
        ));
    }
    let byte = |value: &f64| (255.0 * value.clamp(0.0, 1.0) + 0.5).floor() as u8;
    Ok(values.iter().map(byte).collect())
}
