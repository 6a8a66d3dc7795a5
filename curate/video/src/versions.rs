//! Versions of FFmpeg's libraries in this build.

use ffmpeg_next as ffmpeg;

/// Returns name and version of every library.
pub fn versions() -> Vec<(String, String)> {
    // FFmpeg packs major, minor and micro into one number.
    let version = |packed: u32| {
        format!(
            "{}.{}.{}",
            packed >> 16,
            (packed >> 8) & 0xff,
            packed & 0xff
        )
    };
    let of_libraries = [
        ("libavutil", ffmpeg::util::version()),
        ("libavcodec", ffmpeg::codec::version()),
        ("libavformat", ffmpeg::format::version()),
        ("libswscale", ffmpeg::software::scaling::version()),
    ];
    of_libraries
        .map(|(name, packed)| (name.to_owned(), version(packed)))
        .to_vec()
}
