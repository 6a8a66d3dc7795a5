//! Offsets, rectification and column sums of a block of rows.

pub(super) fn add(sums: &mut [f32], values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
    }
}

pub(super) fn add_offset(values: &mut [f32], offset: &[f32]) {
    for row in values.chunks_exact_mut(offset.len()) {
        add(row, offset);
    }
}

/// Computes `max(x + offset, 0)` in place.
pub(super) fn add_offset_and_clip(values: &mut [f32], offset: &[f32]) {
    for row in values.chunks_exact_mut(offset.len()) {
        for (value, offset) in row.iter_mut().zip(offset) {
            *value = (*value + offset).max(0.0);
        }
    }
}

/// Adds the column sums of `values` to `sums`.
pub(super) fn sum_columns(values: &[f32], sums: &mut [f32]) {
    for row in values.chunks_exact(sums.len()) {
        add(sums, row);
    }
}

/// Turns the gradient by a `ReLU`'s outputs into that by its inputs, in place.
pub(super) fn clip(gradient: &mut [f32], outputs: &[f32]) {
    for (gradient, output) in gradient.iter_mut().zip(outputs) {
        *gradient = if *output > 0.0 { *gradient } else { 0.0 };
    }
}

/// Does the same and adds the column sums of the gradient, in one pass.
pub(super) fn clip_and_sum_columns(gradient: &mut [f32], outputs: &[f32], sums: &mut [f32]) {
    let width = sums.len();
    for (gradient, outputs) in gradient
        .chunks_exact_mut(width)
        .zip(outputs.chunks_exact(width))
    {
        for ((gradient, output), sum) in gradient.iter_mut().zip(outputs).zip(&mut *sums) {
            *gradient = if *output > 0.0 { *gradient } else { 0.0 };
            *sum += *gradient;
        }
    }
}
