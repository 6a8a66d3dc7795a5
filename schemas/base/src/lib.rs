//! Files, stages and processes.
//!
//! Records, cameras, poses and images are in `omnilife_schemas`, which exports these modules too. Other crates import
//! them from there. Modules from the top down (each imports only from those below it, which a test checks):
//!
//! * [`stage`]: work that is skipped while its inputs have not changed.
//! * [`ownership`]: the files of a folder that this program made. [`lock`]: one writer per folder. [`staging`]: folders
//!   of incomplete files. [`child`]: programs of others, ended with everything that they start.
//! * [`npy`]: arrays. [`toml_file`]: settings. [`testing`]: skipped tests.
//! * [`store`]: files and records that reach the disk whole or not at all.
//! * [`elapsed`], [`process`], [`progress`], [`provenance`]: time, processes, reports to the user, origin of records.
//!   [`error_kind`]: kinds of errors. [`foreign_code`]: libraries that panic.
//! * [`names`], [`placeholders`], [`plain_text`]: text. [`assignment`], [`band_matrix`], [`statistics`]: numbers.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod assignment;
pub mod band_matrix;
pub mod child;
pub mod elapsed;
pub mod error_kind;
pub mod foreign_code;
pub mod lock;
pub mod names;
pub mod natural_order;
pub mod npy;
pub mod ownership;
pub mod placeholders;
pub mod plain_text;
pub mod process;
pub mod progress;
pub mod provenance;
pub mod stage;
pub mod staging;
pub mod statistics;
pub mod store;
pub mod testing;
pub mod toml_file;

pub use error_kind::{Classified, ErrorKind};
