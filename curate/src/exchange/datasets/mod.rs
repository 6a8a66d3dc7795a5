//! Layouts of data sets: folders that their publishers or the loaders of papers define, which are read alone.

pub mod omniphotos;
mod panoramas;
pub mod roam360;
mod text_file;
