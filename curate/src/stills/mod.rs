//! Folders of still panoramas.

mod colours;
mod exif_facts;
mod gpano;
mod placement;
mod repetitions;
mod sequence;

use std::path::{Path, PathBuf};

use omnilife_schemas::{image_file::ImageFile, plain_text, records::Capture, store};

use crate::{error::CurateError, frame_order};
pub(crate) use colours::{Colours, notes as colour_notes};
pub(crate) use placement::Placement;
pub(crate) use sequence::{are_panoramas, curate, identify};

/// Seconds between two stills without a known capture time.
const SECONDS_APART: f64 = 1.0;

/// A still panorama.
#[derive(Debug, Clone)]
pub(crate) struct Still {
    pub(crate) path: PathBuf,
    /// Width and height of the whole sphere, pixels, as viewers show it.
    pub(crate) size: [u32; 2],
    /// Metadata of its file.
    pub(crate) capture: Capture,
    /// Its part of the sphere, unless it is all of it.
    pub(crate) placement: Option<Placement>,
    colours: Colours,
    taken: Option<exif_facts::CaptureTime>,
}

/// The stills of a folder in the natural order of their names.
#[derive(Debug, Clone)]
pub(crate) struct Stills {
    pub(crate) stills: Vec<Still>,
    /// Seconds since the first, one for each.
    pub(crate) times: Vec<f64>,
    /// A line on the source of the times.
    pub(crate) times_note: String,
    /// Lines on other decisions.
    pub(crate) notes: Vec<String>,
}

/// Returns true for a folder that holds images and may be one of stills.
pub(crate) fn has_images(folder: &Path) -> Result<bool, CurateError> {
    Ok(!frame_order::images_in(folder)?.is_empty())
}

impl Stills {
    /// Reads the headers of all images in a folder.
    ///
    /// # Errors
    /// [`CurateError::Input`] without images, for an image that is not a panorama by its size or metadata, and
    /// for images of different sizes; [`CurateError::Store`] for files that cannot be read.
    pub(crate) fn read(folder: &Path) -> Result<Self, CurateError> {
        let images = frame_order::images_in(folder)?;
        let stills = images
            .into_iter()
            .map(Still::read)
            .collect::<Result<Vec<_>, _>>()?;
        let first = stills
            .first()
            .ok_or_else(|| CurateError::input(folder, "must hold PNG or JPEG images, got none"))?;
        if let Some(other) = stills.iter().find(|still| still.size != first.size) {
            let [[width, height], [first_width, first_height]] = [other.size, first.size];
            let reason = format!(
                "is a sphere of {width}x{height}, and {} one of {first_width}x{first_height}; panoramas of a scene \
                 have one size",
                first.path.display()
            );
            return Err(CurateError::input(&other.path, reason));
        }
        let (times, times_note) = times(&stills);
        let notes = [
            parts_note(&stills),
            poses_note(&stills),
            repetitions::same_files(&stills)?,
            repetitions::same_names(&stills),
        ];
        Ok(Self {
            notes: notes.into_iter().flatten().collect(),
            stills,
            times,
            times_note,
        })
    }
}

impl Still {
    fn read(path: PathBuf) -> Result<Self, CurateError> {
        let refuse = |reason: String| CurateError::input(&path, reason);
        let mut file = ImageFile::open(&path)?;
        let [width, height] = file.shown_size()?.map(|side| side as u32);
        let (mut capture, taken) = match file.exif()? {
            Some(data) => exif_facts::read(data).map_err(refuse)?,
            None => (Capture::default(), None),
        };
        let panorama = match file.xmp()? {
            Some(data) => gpano::read(&data, [width, height]).map_err(refuse)?,
            None => None,
        };
        let placement = panorama.as_ref().and_then(|panorama| panorama.placement);
        capture.pose_degrees = panorama.and_then(|panorama| panorama.pose_degrees);
        let size = placement.map_or([width, height], |placement| placement.full());
        // A column may be missing.
        if size[0].abs_diff(size[1].saturating_mul(2)) > 1 {
            return Err(refuse(format!(
                "is {width}x{height}; a panorama is twice as wide as high, or its GPano metadata say which part of a \
                 sphere it shows"
            )));
        }
        let colours = Colours::of(&mut file)?;
        drop(file);
        Ok(Self {
            size,
            capture,
            placement,
            colours,
            taken,
            path,
        })
    }

    pub(crate) fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }
}

/// Returns seconds since the first still, and a line on their source: EXIF data, if all have times in their order by
/// one kind of clock, else their order.
fn times(stills: &[Still]) -> (Vec<f64>, String) {
    let taken: Option<Vec<exif_facts::CaptureTime>> =
        stills.iter().map(|still| still.taken).collect();
    if let Some(taken) = &taken
        && let Some(first) = taken.first()
        && taken.iter().all(|other| other.is_utc == first.is_utc)
        && taken
            .windows(2)
            .all(|pair| pair[0].seconds < pair[1].seconds)
    {
        let times = taken.iter().map(|taken| taken.seconds - first.seconds);
        let note = "times are those of the EXIF data of the images".to_owned();
        return (times.collect(), note);
    }
    let reason = match taken {
        Some(_) => {
            "the times in the EXIF data of the images do not follow the order of their names"
        }
        None => "not all images have a time in their EXIF data",
    };
    let times = (0..stills.len()).map(|at| at as f64 * SECONDS_APART);
    let gaps = gaps(stills);
    let skipped = match gaps.is_empty() {
        true => String::new(),
        false => format!(
            ", also where the numbers in their names have gaps: after {}",
            plain_text::first_of(&gaps)
        ),
    };
    let note = format!("{reason}: they are taken to be {SECONDS_APART} s apart{skipped}");
    (times.collect(), note)
}

/// Returns the names of the stills behind which numbers are missing; none where numbers do not count the stills.
fn gaps(stills: &[Still]) -> Vec<String> {
    let numbers: Option<Vec<u64>> = stills
        .iter()
        .map(|still| frame_order::number(&still.path))
        .collect();
    let Some(numbers) = numbers else {
        return Vec::new();
    };
    let steps = numbers
        .windows(2)
        .map(|pair| pair[1].saturating_sub(pair[0]));
    let steps: Vec<u64> = steps.collect();
    let usual = steps.iter().copied().min().unwrap_or(0);
    let behind = stills.iter().zip(&steps);
    let skipped = behind.filter(|&(_, &step)| usual > 0 && step > usual);
    skipped.map(|(still, _)| still.name()).collect()
}

fn parts_note(stills: &[Still]) -> Option<String> {
    let parts = stills.iter().filter(|still| still.placement.is_some());
    let names: Vec<String> = parts.map(Still::name).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{} images show a part of the sphere by their metadata, the rest is ignored: {}",
            names.len(),
            plain_text::first_of(&names)
        )
    })
}

fn poses_note(stills: &[Still]) -> Option<String> {
    let is_turned = |still: &&Still| {
        let pose = still.capture.pose_degrees.unwrap_or_default();
        pose[1..].iter().any(|&degrees| degrees != 0.0)
    };
    let names: Vec<String> = stills.iter().filter(is_turned).map(Still::name).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{} images state a pitch or roll, which is recorded and not taken out: {}",
            names.len(),
            plain_text::first_of(&names)
        )
    })
}

/// Returns the SHA-256 of a folder of stills: of the hashes of its images in their order.
fn sha256(images: &[PathBuf]) -> Result<String, CurateError> {
    let hashes = images
        .iter()
        .map(|image| store::sha256_file(image))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(store::sha256_bytes(hashes.join("\n").as_bytes()))
}
