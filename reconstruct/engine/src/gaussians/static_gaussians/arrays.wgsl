// Arrays of static Gaussians in a table.

struct StaticArrays {
    // Number of Gaussians, and index of the first among all activated ones.
    len: u32,
    first: u32,
    // Number of non-constant coefficients per Gaussian.
    rest: u32,
    // Number of those that the table stores; the others are zero.
    stored_rest: u32,
    // Offset of each array in the table, in values.
    positions: u32,
    log_scales: u32,
    quaternions: u32,
    opacity_logits: u32,
    sh_constant: u32,
    sh_rest: u32,
}

