//! The small video of the page: every frame of the original at its time, at a low bit rate.

use std::{fs, path::Path};

use base64::{Engine, engine::general_purpose::STANDARD};
use omnilife_schemas::store::{self, StoreError, Unfinished};
use omnilife_video::{Projection, Quality, Rgb8Image, ViewVideoWriter};

use crate::error::CurateError;

/// Width of the small video at most, pixels.
pub(super) const WIDTH_PIXELS: u32 = 640;
/// A small video up to this size is embedded in the page. Phones hold a page whole in memory.
pub const EMBEDDED_BYTES: u64 = 24 << 20;

/// Encodes the small video while the original is decoded.
pub(super) struct ProxyWriter {
    /// File that is written before its final path is known.
    temporary: Unfinished,
    first_seconds: f64,
    video: Option<ViewVideoWriter>,
}

/// Place of the small video of a page.
pub(super) enum Proxy {
    /// Embedded in the page, as Base64.
    Embedded(String),
    /// Beside the page, by this path relative to it, with `/` between folders.
    Beside { file: String, bytes: u64 },
}

impl ProxyWriter {
    /// Starts a video for the page at `page`, whose first frame is shown at `first_seconds`.
    pub(super) fn new(page: &Path, first_seconds: f64) -> Self {
        let mut name = page.file_name().unwrap_or_default().to_owned();
        name.push(".mp4");
        Self {
            temporary: Unfinished::beside(&page.with_file_name(name)),
            first_seconds,
            video: None,
        }
    }

    pub(super) fn push(&mut self, image: &Rgb8Image, seconds: f64) -> Result<(), CurateError> {
        if self.video.is_none() {
            let size = [image.width as u32, image.height as u32];
            self.video = Some(ViewVideoWriter::with_quality(
                self.temporary.path(),
                size,
                Projection::Flat,
                Quality::Proxy,
            )?);
        }
        let Some(video) = &mut self.video else {
            return Err(CurateError::internal(self.temporary.path(), "no encoder"));
        };
        Ok(video.push(&image.data, seconds - self.first_seconds)?)
    }

    /// Ends the video and moves it into the page, or into the folder `<page>-proxy` beside it under a name made from
    /// its content's hash.
    pub(super) fn finish(
        self,
        page: &Path,
        end_seconds: f64,
        embedded_bytes: u64,
    ) -> Result<Proxy, CurateError> {
        let Some(video) = self.video else {
            return Err(CurateError::internal(page, "the video has no frames"));
        };
        video.finish(end_seconds - self.first_seconds)?;
        Ok(place(self.temporary.path(), page, embedded_bytes)?)
    }
}

fn place(video: &Path, page: &Path, embedded_bytes: u64) -> Result<Proxy, StoreError> {
    let unreadable = |error| StoreError::read(video, error);
    let bytes = fs::metadata(video).map_err(unreadable)?.len();
    if bytes <= embedded_bytes {
        let content = fs::read(video).map_err(unreadable)?;
        return Ok(Proxy::Embedded(STANDARD.encode(content)));
    }
    let sha256 = store::sha256_file(video)?;
    let stem = page.file_stem().unwrap_or_default().to_string_lossy();
    let (folder, name) = (format!("{stem}-proxy"), format!("{}.mp4", &sha256[..16]));
    let file = page.with_file_name(&folder).join(&name);
    // A file under the name of its content is that content, or foreign.
    if file.exists() {
        if store::sha256_file(&file)? != sha256 {
            return Err(StoreError::refused(
                &file,
                "is in the way of the page's video; move it or choose another name for the page",
            ));
        }
    } else {
        store::create_folder(&page.with_file_name(&folder))?;
        store::rename(video, &file).map_err(|error| StoreError::write(&file, error))?;
    }
    Ok(Proxy::Beside {
        file: format!("{folder}/{name}"),
        bytes,
    })
}
