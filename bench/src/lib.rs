//! From rendered views and a manifest to scores.
