//! Predicted views of methods, read without any repair.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    io::Cursor,
    path::{Path, PathBuf},
};

use image::{ColorType, ImageDecoder, codecs::png::PngDecoder};
use omnilife_schemas::{
    colour_profile::is_srgb,
    image_file::{self, NotPlain},
    npy,
    padded_frame::PaddedFrame,
    plain_text,
    store::{self, StoreError},
};

mod arrays;

pub use arrays::scored_bytes;

/// File name endings of images that are never read as predictions, in lower case.
const OTHER_FORMATS: [&str; 9] = [
    "bmp", "exr", "hdr", "jpeg", "jpg", "npz", "tif", "tiff", "webp",
];
/// Folder of predicted distances in a folder of predictions.
const DEPTH_FOLDER: &str = "depth";

/// The files of a folder of predictions.
#[derive(Debug)]
pub(crate) struct PredictionFolder {
    folder: PathBuf,
    /// Reason why no file of it is scored.
    refusal: Option<String>,
    /// Frames with a prediction as an array of values.
    arrays: BTreeSet<u32>,
    /// Names of images with the number of a frame in another form than its file name.
    other_names: BTreeMap<u32, String>,
    /// Names of images with the number of a frame in a format that is not read.
    other_formats: BTreeMap<u32, String>,
    /// Frames that predictions may fill, whose padding is cut off.
    padded: Option<PaddedFrame>,
    /// Images in place of the predictions, in words, where no frame has one.
    seen: Option<String>,
    /// Names of images of predicted frames that are not read, beside the files that are.
    pub(crate) unread: Vec<String>,
    /// Images in a format that is read, but of no scored frame.
    pub(crate) strays: Vec<String>,
}

impl PredictionFolder {
    /// Lists a folder with predictions of `frames`.
    pub(crate) fn open(folder: &Path, frames: &[u32]) -> Result<Self, StoreError> {
        let mut found = Self::refused(folder, None);
        let mut predicted = BTreeSet::new();
        let mut others = Vec::new();
        for name in store::names_in(folder)? {
            let Some((stem, is_read)) = image_stem(&name) else {
                continue;
            };
            let of_frame = stem.parse().ok().filter(|frame| frames.contains(frame));
            if !is_read {
                if let Some(frame) = of_frame {
                    found.other_formats.insert(frame, name.clone());
                }
                others.push(name);
                continue;
            }
            if let Some(&frame) = frames.iter().find(|&&frame| name == file_name(frame)) {
                predicted.insert(frame);
                continue;
            }
            if let Some(&frame) = frames.iter().find(|&&frame| name == array_name(frame)) {
                found.arrays.insert(frame);
                predicted.insert(frame);
                continue;
            }
            if let Some(frame) = of_frame {
                found.other_names.insert(frame, name.clone());
            }
            found.strays.push(name);
        }
        if predicted.is_empty() {
            found.seen = seen_in(folder, &[&found.strays[..], &others[..]].concat());
        }
        let beside = found.other_formats.iter();
        let beside = beside.filter(|(frame, _)| predicted.contains(*frame));
        found.unread = beside.map(|(_, name)| name.clone()).collect();
        Ok(found)
    }

    /// Returns a folder without a listing, which is not read if there is a reason.
    pub(crate) fn refused(folder: &Path, reason: Option<String>) -> Self {
        Self {
            folder: folder.to_owned(),
            refusal: reason,
            arrays: BTreeSet::new(),
            other_names: BTreeMap::new(),
            other_formats: BTreeMap::new(),
            padded: None,
            seen: None,
            unread: Vec::new(),
            strays: Vec::new(),
        }
    }

    /// Sets the padded frames that predictions may fill; their content in the padding does not count.
    pub(crate) fn in_frames(mut self, padded: Option<PaddedFrame>) -> Self {
        self.padded = padded;
        self
    }

    /// Returns the folder itself.
    pub(crate) fn path(&self) -> &Path {
        &self.folder
    }

    /// Returns false if none of its files is read.
    pub(crate) fn is_read(&self) -> bool {
        self.refusal.is_none()
    }

    /// Returns the name of a file of it, with `/` between folders.
    pub(crate) fn relative(&self, file: &Path) -> String {
        let relative = file.strip_prefix(&self.folder).unwrap_or(file);
        let names = relative
            .components()
            .map(|name| name.as_os_str().to_string_lossy());
        names.collect::<Vec<_>>().join("/")
    }

    /// Returns the name of the file with a frame's prediction, existing or expected.
    pub(crate) fn name(&self, frame: u32) -> String {
        if self.arrays.contains(&frame) {
            array_name(frame)
        } else {
            file_name(frame)
        }
    }

    /// Returns the files that may hold a frame's prediction; one of them should.
    pub(crate) fn files(&self, frame: u32) -> [PathBuf; 2] {
        [file_name(frame), array_name(frame)].map(|name| self.folder.join(name))
    }

    /// Returns the file that may hold a frame's predicted distances.
    pub(crate) fn depth_file(&self, frame: u32) -> PathBuf {
        self.folder
            .join(DEPTH_FOLDER)
            .join(format!("{frame:06}.npy"))
    }

    /// Returns true if distances were predicted.
    pub(crate) fn has_depth(&self) -> bool {
        self.refusal.is_none() && self.folder.join(DEPTH_FOLDER).is_dir()
    }

    /// Returns the bytes of a frame's prediction: an 8-bit RGB PNG of exactly `width` x `height` pixels, or an array of
    /// values, rounded as in [`scored_bytes`]. One of the size of padded frames is cut to the image. An alpha channel
    /// is accepted if every pixel is opaque.
    ///
    /// # Errors
    /// The reason, in one line, why the prediction cannot be scored. It names the file without its folder, so that
    /// results do not depend on the place of predictions.
    pub(crate) fn read(&self, frame: u32, width: u32, height: u32) -> Result<Vec<u8>, String> {
        if let Some(reason) = &self.refusal {
            return Err(reason.clone());
        }
        let name = file_name(frame);
        let other = self.other_names.get(&frame);
        if self.arrays.contains(&frame) {
            return self.read_array(frame, width, height);
        }
        let bytes =
            fs::read(self.folder.join(&name)).map_err(|error| match (error.kind(), other) {
                (io::ErrorKind::NotFound, Some(other)) => {
                    format!("{name} is missing; {other} is not its name")
                }
                (io::ErrorKind::NotFound, None) => {
                    match (self.other_formats.get(&frame), &self.seen) {
                        (Some(other), _) => {
                            format!("{name} is missing; {other} must be PNG or .npy")
                        }
                        (None, Some(seen)) => format!("{name} is missing; {seen}"),
                        (None, None) => format!("{name} is missing"),
                    }
                }
                (kind, _) => format!("{name} cannot be read: {kind}"),
            })?;
        if let Some(other) = other {
            return Err(format!("{name} and {other} are both of frame {frame}"));
        }
        decode(&bytes, [width, height], self.padded).map_err(|reason| format!("{name} {reason}"))
    }

    /// Returns the share of the values of a frame's array below -0.02 or above 1.02. `None` if the frame has no
    /// readable array.
    pub(crate) fn outside_share(&self, frame: u32) -> Option<f64> {
        let name = self.arrays.contains(&frame).then(|| array_name(frame))?;
        let array = npy::read(&self.folder.join(name)).ok()?;
        Some(arrays::outside_share(&arrays::without_padding(
            array,
            self.padded,
        )))
    }

    /// Returns true if the frame's image states other colours than sRGB, by a profile or a gamma: its values are scored
    /// as they are stored. `false` for arrays, and for files that cannot be read.
    pub(crate) fn states_other_colours(&self, frame: u32) -> bool {
        let is_image = self.is_read() && !self.arrays.contains(&frame);
        let file = is_image.then(|| fs::File::open(self.folder.join(file_name(frame))).ok());
        let decoder = file.flatten().map(io::BufReader::new).map(PngDecoder::new);
        decoder.and_then(Result::ok).is_some_and(has_other_colours)
    }

    fn read_array(&self, frame: u32, width: u32, height: u32) -> Result<Vec<u8>, String> {
        let name = array_name(frame);
        let png = file_name(frame);
        let other = self.other_names.get(&frame);
        let exists = self.folder.join(&png).exists();
        if let Some(other) = other.or(exists.then_some(&png)) {
            return Err(format!("{name} and {other} are both of frame {frame}"));
        }
        let array = read_npy(&self.folder.join(&name), &name)?;
        let array = arrays::without_padding(array, self.padded);
        scored_bytes(&array, width, height).map_err(|reason| format!("{name} {reason}"))
    }

    /// Returns distances of a frame along the rays, in units of the world frame: a `NumPy` array of `height` x `width`
    /// in f32 or f64.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub(crate) fn read_depth(
        &self,
        frame: u32,
        width: u32,
        height: u32,
    ) -> Result<Vec<f32>, String> {
        let file = self.depth_file(frame);
        let name = format!("{DEPTH_FOLDER}/{frame:06}.npy");
        if !file.exists() {
            return Err(format!("{name} is missing"));
        }
        let array = arrays::without_padding(read_npy(&file, &name)?, self.padded);
        let expected = [height as usize, width as usize];
        if array.shape != expected {
            let shape = array.shape;
            return Err(format!(
                "{name} is of shape {shape:?}, expected {expected:?}"
            ));
        }
        Ok(array.values.iter().map(|&value| value as f32).collect())
    }
}

/// Returns the file name of a frame's prediction.
fn file_name(frame: u32) -> String {
    format!("{frame:06}.png")
}

/// Returns the expected name of a prediction that a method wrote as `source`.
pub(crate) fn name_for(frame: u32, source: &Path) -> String {
    let is_array = source.extension().is_some_and(|ending| ending == "npy");
    if is_array {
        array_name(frame)
    } else {
        file_name(frame)
    }
}

/// Returns the file name of a frame's prediction as an array of values.
fn array_name(frame: u32) -> String {
    format!("{frame:06}.npy")
}

/// Returns the name of a visible image or array without its ending, and true if its format is read.
fn image_stem(name: &str) -> Option<(&str, bool)> {
    let (stem, ending) = name.rsplit_once('.')?;
    let is_one_of = |endings: &[&str]| {
        let mut known = endings.iter();
        known.any(|known| ending.eq_ignore_ascii_case(known))
    };
    let is_read = is_one_of(&["png", "npy"]);
    let is_image = is_read || is_one_of(&OTHER_FORMATS);
    (is_image && !name.starts_with('.')).then_some((stem, is_read))
}

/// Returns the images of a folder without predictions in words: those with other names, or else those of the first of
/// its folders with images; `None` without any.
fn seen_in(folder: &Path, strays: &[String]) -> Option<String> {
    if !strays.is_empty() {
        return Some(format!("its folder holds {}", plain_text::first_of(strays)));
    }
    let mut names = store::names_in(folder).ok()?.into_iter();
    names.find_map(|name| {
        if name == DEPTH_FOLDER || name.starts_with('.') {
            return None;
        }
        // Files have no names below them.
        let mut images = store::names_in(&folder.join(&name)).unwrap_or_default();
        images.retain(|image| image_stem(image).is_some());
        let first = plain_text::first_of(&images);
        (!images.is_empty()).then(|| format!("the folder {name} beside it holds {first}"))
    })
}

fn read_npy(file: &Path, name: &str) -> Result<npy::Array, String> {
    npy::read(file).map_err(|error| match error {
        StoreError::Malformed { reason, .. } => format!("{name}: {reason}"),
        _ => format!("{name} cannot be read"),
    })
}

/// Returns true for a profile other than sRGB, or without one for a gamma far from that of sRGB, 1 / 2.2.
fn has_other_colours<R: io::BufRead + io::Seek>(mut decoder: PngDecoder<R>) -> bool {
    if let Ok(Some(profile)) = decoder.icc_profile() {
        return !is_srgb(&profile);
    }
    let gamma = decoder.gamma_value().ok().flatten();
    gamma.is_some_and(|gamma| !(0.4..=0.5).contains(&gamma))
}

fn decode(
    bytes: &[u8],
    [width, height]: [u32; 2],
    padded: Option<PaddedFrame>,
) -> Result<Vec<u8>, String> {
    let undecodable = |error: image::ImageError| {
        let text = error.to_string();
        format!("is not a usable PNG: {}", text.lines().next().unwrap_or(""))
    };
    let decoder = PngDecoder::new(Cursor::new(bytes)).map_err(undecodable)?;
    // Checked before decoding: a wrong header must not cause an allocation of its size.
    let found = <[u32; 2]>::from(decoder.dimensions());
    let filled = padded.filter(|frame| frame.size() == found);
    if found != [width, height] && filled.is_none() {
        let [found_width, found_height] = found;
        let with_padding = padded.map_or(String::new(), |frame| {
            let [width, height] = frame.size();
            format!(", or {width}x{height} with padding")
        });
        return Err(format!(
            "is {found_width}x{found_height} pixels, expected {width}x{height}{with_padding}"
        ));
    }
    let colour = decoder.color_type();
    if !matches!(colour, ColorType::Rgb8 | ColorType::Rgba8) {
        return Err(format!("is {colour:?}, expected 8-bit RGB"));
    }
    let rgb = image_file::plain_rgb8(decoder).map_err(|error| match error {
        NotPlain::Damaged(error) => undecodable(error),
        NotPlain::Turned | NotPlain::Transparent => error.to_string(),
    })?;
    Ok(match filled {
        Some(frame) => frame.crop(&rgb, 3),
        None => rgb,
    })
}
