//! Predictions as arrays of values instead of 8-bit images.

use omnilife_schemas::npy::Array;

/// The bytes that are scored of an array of shape (height, width, 3) with values in [0, 1]: 255 times the value, rounded
/// to nearest, half up, so that a method loses nothing and gains nothing by not writing a PNG.
/// Values outside of [0, 1] become the nearest that an image can hold.
///
/// # Errors
/// The reason, without the file: another shape, a value that is no finite number, or values that
/// are of another range, which a mean above 1 shows.
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
    let byte = |value: &f64| (255.0 * value.clamp(0.0, 1.0) + 0.5).floor() as u8;
    Ok(values.iter().map(byte).collect())
}
