//! What the integration tests of this crate share.

pub(crate) use omnilife_reconstruct::reference;

pub(crate) mod scenes;
