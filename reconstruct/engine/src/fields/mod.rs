//! Functions of position and time that are learnt: networks.

pub mod mlp;
