//! What the integration tests of this crate share.

pub(crate) mod reference;
pub(crate) mod scenes;
