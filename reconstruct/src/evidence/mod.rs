//! What a scene shows of itself before it is trained.
//!
//! * [`pilot`]: a short static training, and what is seen in it.
//! * [`motion`]: whether anything moves. [`poses`]: how far poses are off. [`view_dependence`]: whether
//!   colours depend on the direction.

pub mod motion;
pub mod pilot;
pub mod poses;
pub mod view_dependence;
