//! Hash grids: features of a position, read from tables at several resolutions (Müller et al. 2022, "Instant
//! Neural Graphics Primitives"; sizes and rounding as in tiny-cuda-nn `encodings/grid.h`).
//!
//! ```text
//! scale_l = base growth^l - 1        res_l = ceil(scale_l) + 1
//! position = x scale_l + 1/2         cell = floor(position)        fraction = position - cell
//! index = sum cell_d stride_l^d                       where a level has an entry for every cell
//!       = xor_d (cell_d prime_d mod 2^32)             otherwise; both modulo its entries
//! ```
//!
//! A level's features are interpolated linearly between the corners of the cell; those of all levels are
//! concatenated, coarse first. Positions are clamped to the unit cube.
//!
//! * [`levels`]: sizes of the levels. [`passes`]: features, and gradients by table and position. `gpu`: the same
//!   on a GPU.

pub(crate) mod gpu;
pub mod levels;
pub mod passes;

pub use levels::{HashGrid, HashGridShape, UpperEdge};

#[cfg(test)]
mod tests;
