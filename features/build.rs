//! A build script without work: Cargo counts build dependencies of packages alone that have one.

fn main() {}
