//! Textured surfaces, ray intersections, and compositing of a ray's hits.
//!
//! * [`plane`], [`sphere`]: hits and their gradients. [`view_angle`]: direction from which a surface is seen.
//! * [`texture`]: images on them. [`compose`]: layers, nearest first. [`gpu`]: appearance, layers and their loss on
//!   a GPU.

pub mod compose;
pub mod gpu;
pub mod plane;
pub mod sphere;
pub mod texture;
pub mod view_angle;

#[cfg(test)]
mod tests;
