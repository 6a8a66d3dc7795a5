//! Reading videos with FFmpeg: what a file says about itself ([`probe`](mod@probe)), its frames as
//! a stream ([`decode`]) and their conversion to RGB ([`convert`]).

pub mod convert;
pub mod decode;
mod luma;
pub(crate) mod mp4_boxes;
pub mod probe;
mod reduce;
mod spherical_boxes;

pub use convert::{Converter, Rgb8Picture, Scaling};
pub(crate) use decode::open_container;
pub use decode::{PacketChoice, VideoReader};
pub(crate) use luma::LumaPicture;
pub use probe::probe;
