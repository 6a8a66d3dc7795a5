//! What the integration tests of this crate share.

pub(crate) use omnilife_engine::render::reference;

pub(crate) mod scenes;
