//! Reading and writing of video with FFmpeg: the metadata of a file ([`probe`](mod@probe)), its frames as a stream
//! ([`decode`]), their conversion to RGB ([`convert`]), its packets ([`packets`]), and new files ([`writing`]).
//!
//! Values in FFmpeg's structures that a file controls are read through three files: `raw_fields.rs` (numbers that C
//! declares as enums), `planes.rs` (pixels) and `scaler.rs`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod convert;
pub mod decode;
pub mod error;
mod luma;
mod matrix;
mod mp4_boxes;
pub mod packets;
mod pixel_format;
mod planes;
pub mod probe;
mod raw_fields;
mod reduce;
mod scaler;
mod spherical_boxes;
mod versions;
pub mod writing;

pub use convert::{Converter, Rgb8Image, Scaling};
pub use decode::{VideoReader, open_container};
pub use error::VideoError;
pub use luma::LumaImage;
pub use pixel_format::PixelFormat;
pub use probe::probe;
pub use raw_fields::Colour;
pub use spherical_boxes::{CUBEMAP, OTHER_CUBEMAP, count_statements};
pub use versions::versions;
pub use writing::{
    mp4::{Projection, Quality},
    spherical_boxes::Orientation,
    view_video::ViewVideoWriter,
};
