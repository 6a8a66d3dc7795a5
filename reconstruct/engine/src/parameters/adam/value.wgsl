// Adam's step on one value. The kernel's file binds the buffers.

struct AdamStep {
    // Number of values of the trained arrays, without unused capacity.
    len: u32,
    arrays: u32,
    // 1 / sqrt(1 - beta2^t)
    inverse_root: f32,
    // Decay of second moments.
    beta_2: f32,
    // End of each array among these values, which a frozen array lacks, and its shift to its offset in the
    // table.
    ends: array<vec4<u32>, 4>,
    shifts: array<vec4<u32>, 4>,
    // Step size of each array, divided by 1 - beta1^t.
    rates: array<vec4<f32>, 4>,
    // Index of each array's counter of refused gradients.
    numbers: array<vec4<u32>, 4>,
}

// Updates the value with this index in the table, which belongs to this array.
fn update_value(array_number: u32, index: u32, gradient: f32) {
    let rate = adam_step.rates[array_number / 4u][array_number % 4u];
    var g = gradient;
    // A gradient that is not finite counts as zero.
    if !is_finite(g) {
        let number = adam_step.numbers[array_number / 4u][array_number % 4u];
        atomicAdd(&status.refused[number], 1u);
        g = 0.0;
    }
    let m = BETA_1 * first_moments[index] + (1.0 - BETA_1) * g;
    let v = adam_step.beta_2 * second_moments[index] + (1.0 - adam_step.beta_2) * g * g;
    first_moments[index] = m;
    second_moments[index] = v;
    values[index] -= rate * m / (sqrt(v) * adam_step.inverse_root + EPSILON);
}

