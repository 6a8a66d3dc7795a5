//! Versions of the foreign libraries in this build.

/// Returns name and version of every library.
pub fn libraries() -> Vec<(String, String)> {
    let opencv_version = opencv::core::get_version_string()
        .unwrap_or_else(|error| format!("of unknown version ({error})"));
    let mut libraries = omnilife_video::versions();
    libraries.push(("OpenCV".to_owned(), opencv_version));
    libraries
}
