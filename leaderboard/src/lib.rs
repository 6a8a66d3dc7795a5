//! From scores to tables.
