//! Textured surfaces that rays hit, and how the hits of a ray make a colour.
//!
//! * [`plane`], [`sphere`]: hits and their gradients. [`view_angle`]: from where a surface is seen.
//! * [`texture`]: images on them. [`compose`]: layers, nearest first.

pub mod compose;
pub mod plane;
pub mod sphere;
pub mod texture;
pub mod view_angle;

#[cfg(test)]
mod tests;
