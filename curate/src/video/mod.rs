//! Reading of videos with FFmpeg: the metadata of a file ([`probe`](mod@probe)), its frames as a stream ([`decode`])
//! and their conversion to RGB ([`convert`]).
//!
//! Values in FFmpeg's structures that a file controls are read through three files: `raw_fields.rs` (numbers that C
//! declares as enums), `planes.rs` (pixels) and `scaler.rs`.

pub mod convert;
pub mod decode;
mod luma;
pub(crate) mod mp4_boxes;
mod pixel_format;
mod planes;
pub mod probe;
mod raw_fields;
mod reduce;
mod scaler;
mod spherical_boxes;

pub use convert::{Converter, Rgb8Image, Scaling};
pub use decode::VideoReader;
pub(crate) use decode::{begin_ffmpeg, open_container};
pub(crate) use luma::LumaImage;
pub use pixel_format::PixelFormat;
pub(crate) use planes::{allocated, rows_mut};
pub use probe::probe;
pub use raw_fields::Colour;
pub(crate) use raw_fields::{CodecId, clear_image_kind};
pub(crate) use scaler::{FrameShape, Matrix, Scaler};
pub use spherical_boxes::count_statements;
