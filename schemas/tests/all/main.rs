//! Records and files from outside.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod camera;
mod image_file;
mod json_schemas;
mod mask_files;
mod points;
mod pose;
mod rgb;
mod stage;
mod store;
