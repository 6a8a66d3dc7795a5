//! Writing of mp4 files: frames as H.264 ([`mp4`], [`view_video`]), copied sound ([`audio`]) and spherical metadata
//! ([`spherical_boxes`]).

pub mod audio;
pub mod mp4;
pub mod spherical_boxes;
pub mod view_video;
