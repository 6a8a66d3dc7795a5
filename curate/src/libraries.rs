//! Versions of the foreign libraries in this build.

use ffmpeg_next as ffmpeg;

/// Returns name and version of every library.
pub fn libraries() -> Vec<(String, String)> {
    // FFmpeg packs major, minor and micro into one number.
    let ffmpeg_version = |packed: u32| {
        format!(
            "{}.{}.{}",
            packed >> 16,
            (packed >> 8) & 0xff,
            packed & 0xff
        )
    };
    let opencv_version = opencv::core::get_version_string()
        .unwrap_or_else(|error| format!("of unknown version ({error})"));
    vec![
        (
            "libavutil".to_owned(),
            ffmpeg_version(ffmpeg::util::version()),
        ),
        (
            "libavcodec".to_owned(),
            ffmpeg_version(ffmpeg::codec::version()),
        ),
        (
            "libavformat".to_owned(),
            ffmpeg_version(ffmpeg::format::version()),
        ),
        (
            "libswscale".to_owned(),
            ffmpeg_version(ffmpeg::software::scaling::version()),
        ),
        ("OpenCV".to_owned(), opencv_version),
    ]
}
