//! The `omnilife` binary.
fn main() {}
