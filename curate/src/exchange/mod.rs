//! Scenes in other tools' formats: export and import.
//!
//! To add a format: one file with a reader and, unless it is the layout of a data set, a writer, and one line in
//! [`FORMATS`]. The module doc states the format's axes. Poses survive the round trip to 1e-6 of the scene's size. Only
//! our format holds the times of frames, so every export has a `times.csv` beside it, which others ignore.

mod collect;
pub mod colmap;
mod cube_faces;
pub mod datasets;
mod distances;
pub mod driving;
mod foreign;
mod frame_images;
mod frame_times;
pub mod frames;
pub mod hm3d;
mod left_out;
mod masks;
pub mod nerfstudio;
pub mod openmvg;
mod own_record;
mod padding;
mod panoramas;
mod parts;
mod published_split;
mod scene_folder;
mod times;
mod trajectory;

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    camera::{Camera, cube::CUBE_FACES},
    names,
    padded_frame::PaddedFrame,
    points::PointCloud,
    progress::Progress,
    records::{Scale, Scene},
    store::{self, StoreError, Unfinished},
};

pub use cube_faces::CubeFaces;
pub(crate) use cube_faces::face_image;
pub use distances::{DistanceEncoding, ForeignDistance};
pub use foreign::{ForeignFrame, ForeignMask, ForeignScene, FramePixels, FrameRate};
pub use own_record::scene_id;
pub use parts::Part;
pub use published_split::ForeignSplit;
pub use scene_folder::{ImportRequest, MaskMeaning, import};
pub use trajectory::{Trajectory, read_trajectory};

use crate::error::CurateError;

/// The writer of a format.
#[derive(Debug, Clone, Copy)]
pub struct Writer {
    /// Writes a scene into an empty folder.
    pub write: fn(&ExportScene, &Path) -> Result<(), CurateError>,
    /// Parts of a scene that are written; an export lists the parts it omits.
    pub holds: &'static [Part],
}

impl Writer {
    /// Returns the parts of a scene that are written, with its images unchanged or redrawn: as faces, or padded.
    fn held(&self, is_redrawn: bool) -> Vec<Part> {
        let parts = self.holds.iter().copied();
        parts
            .filter(|part| !is_redrawn || part.is_of_any_images())
            .collect()
    }
}

/// A scene format.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Name on the command line.
    pub id: &'static str,
    /// One line: its readers and its limits.
    pub about: &'static str,
    /// True if its readers know perspective rigs, so that it can hold the faces of cubes.
    pub holds_cube_faces: bool,
    /// True if it states the place of a panorama in an image, so that it can hold padded ones.
    pub holds_padded_panoramas: bool,
    /// Writes a scene into an empty folder; `None` for layouts of data sets, which are only read.
    pub export: Option<Writer>,
    /// Reads a folder.
    pub import: fn(&Path) -> Result<ForeignScene, CurateError>,
}

/// All formats.
pub const FORMATS: &[Format] = &[
    openmvg::FORMAT,
    colmap::FORMAT,
    colmap::BINARY_FORMAT,
    nerfstudio::FORMAT,
    hm3d::FORMAT,
    frames::FORMAT,
    datasets::omniblender::FORMAT,
    datasets::ricoh360::FORMAT,
    datasets::ob3d::FORMAT,
    datasets::tartanair::FORMAT,
    datasets::roam360::FORMAT,
    datasets::omniphotos::FORMAT,
    panoramas::FORMAT,
    driving::kitti::FORMAT,
    driving::nuscenes::FORMAT,
    driving::waymo::FORMAT,
];

/// Returns the formats that can be exported.
pub fn written_formats() -> impl Iterator<Item = &'static Format> {
    FORMATS.iter().filter(|format| format.export.is_some())
}

/// Looks a format up by its name.
///
/// # Errors
/// [`CurateError::Input`] that lists the formats, for an unknown name.
pub fn format(id: &str, folder: &Path) -> Result<&'static Format, CurateError> {
    names::find("format", id, FORMATS, |format| format.id)
        .map_err(|unknown| CurateError::input(folder, unknown.to_string()))
}

/// Names of the formats of a kind.
fn formats_where(is_one: impl Fn(&Format) -> bool) -> String {
    let formats = FORMATS.iter().filter(|format| is_one(format));
    let names: Vec<&str> = formats.map(|format| format.id).collect();
    names.join(", ")
}

/// A frame to be exported.
#[derive(Debug, Clone)]
pub struct ExportFrame {
    /// File name in the export.
    pub name: String,
    /// The image.
    pub image: PathBuf,
    /// The mask, white for moving content.
    pub mask: Option<PathBuf>,
    /// The mask of pixels outside the scene (white).
    pub ignore_mask: Option<PathBuf>,
    /// The camera.
    pub pose: Pose,
    /// Timestamp in the source video, seconds.
    pub time_seconds: f64,
    /// True if methods may use it; the others are for scoring.
    pub is_input: bool,
}

/// A scene to be exported: its frames with a pose, in order of time.
#[derive(Debug, Clone)]
pub struct ExportScene {
    /// The camera of all frames; of padded panoramas with the size of their frames.
    pub camera: Camera,
    /// Place of panoramas in padded frames.
    pub panorama: Option<PaddedFrame>,
    /// The frames.
    pub frames: Vec<ExportFrame>,
    /// World points.
    pub points: PointCloud,
    /// True if a split selects the training frames; without one all are.
    pub has_split: bool,
    /// True if the frames are the faces of cubes, each in the folder of its face.
    pub is_rig: bool,
    /// Length of a unit of the world.
    pub scale: Scale,
    /// The full source; `None` if the images are redrawn.
    pub source: Option<SceneSource>,
}

/// Source scene of an export.
#[derive(Debug, Clone)]
pub struct SceneSource {
    /// Folder of the scene.
    pub folder: PathBuf,
    /// Its record, without frames excluded as test frames.
    pub record: Scene,
}

/// Input and options of an export.
#[derive(Debug, Clone, Copy)]
pub struct ExportRequest<'a> {
    /// Folder of the scene.
    pub scene_folder: &'a Path,
    /// Name of the format.
    pub format: &'a str,
    /// Selects training and test frames, if the format can express it; without a split all are for training.
    pub split: Option<&'a Path>,
    /// Omits the test views: not every trainer knows of them.
    pub given_only: bool,
    /// Writes the faces of cubes in place of panoramas.
    pub cube_faces: Option<CubeFaces>,
    /// Resizes images to fit into frames of this width and height in pixels, and pads them; by default as the protocol
    /// of the split requires.
    pub pad_to: Option<[u32; 2]>,
    /// Folder to fill; it must not exist or be empty.
    pub out: &'a Path,
}

impl<'a> ExportRequest<'a> {
    /// Makes a request to export all frames of a scene as they are.
    pub fn new(scene_folder: &'a Path, format: &'a str, out: &'a Path) -> Self {
        Self {
            scene_folder,
            format,
            split: None,
            given_only: false,
            cube_faces: None,
            pad_to: None,
            out,
        }
    }
}

/// Exports a scene, with a note on every part of it that the format cannot hold.
///
/// # Errors
/// [`CurateError::Input`] for an unknown or read-only format, a scene without posed frames, and a non-empty output
/// folder. Also for cube faces of a perspective scene or in a format without them, and padded panoramas in a format
/// that takes them for whole spheres. [`CurateError::Store`] when a file cannot be read or written.
pub fn export(
    request: &ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportScene, CurateError> {
    export_as(format(request.format, request.out)?, request, progress)
}

/// Exports a scene as [`export`] does, in this format.
///
/// # Errors
/// Those of [`export`], but for the name of the format, which is not looked at.
pub fn export_as(
    format: &Format,
    request: &ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportScene, CurateError> {
    let out = request.out;
    let writer = writer(format, out)?;
    if request.cube_faces.is_some() && !format.holds_cube_faces {
        let reason = format!(
            "is to have cube faces, which {} does not hold; {} do",
            format.id,
            formats_where(|format| format.holds_cube_faces)
        );
        return Err(CurateError::input(out, reason));
    }
    refuse_filled(out)?;
    let (mut scene, of_split) = collect::collect(request, progress)?;
    let padded = padding::frame(request, format, (&scene.camera, of_split), progress)?;
    let is_redrawn = padded.is_some() || request.cube_faces.is_some();
    let left_out = match &scene.source {
        Some(source) => parts::left_out(format, &writer.held(is_redrawn), &source.record),
        None => Vec::new(),
    };
    for note in masks::notes(&scene)?.iter().chain(&left_out) {
        progress.note(note);
    }
    fill_folder(out, |folder| {
        let scratch = folder.join("scratch");
        masks::unite_objects(&mut scene, &scratch.join("united"))?;
        if let Some(faces) = request.cube_faces {
            let all = CUBE_FACES.len() * scene.frames.len();
            scene = cube_faces::as_faces(&scene, faces, &scratch)?;
            if scene.frames.len() < all {
                progress.note(&format!(
                    "{} of {all} faces show nothing of the scene and are left out",
                    all - scene.frames.len()
                ));
            }
        }
        if let Some(frame) = padded {
            scene = padding::padded(&scene, frame, &scratch)?;
        }
        (writer.write)(&scene, folder)?;
        // From here on the scene is what the format has of it.
        if !writer.holds.contains(&Part::Points) {
            scene.points = PointCloud::default();
        }
        if !writer.holds.contains(&Part::Names) {
            for (number, frame) in scene.frames.iter_mut().enumerate() {
                frame.name = parts::numbered_name(number);
            }
        }
        store::remove(&scratch)?;
        if scene.is_rig {
            cube_faces::write_rig(folder)?;
        }
        Ok(times::write(&scene.frames, folder)?)
    })?;
    Ok(scene)
}

/// Returns the writer of a format.
fn writer(format: &Format, out: &Path) -> Result<Writer, CurateError> {
    format.export.ok_or_else(|| {
        let can: Vec<&str> = written_formats().map(|format| format.id).collect();
        let reason = format!(
            "is to be in the layout of a data set, {}, which is only read; written are {}",
            format.id,
            can.join(", ")
        );
        CurateError::input(out, reason)
    })
}

/// Fills a folder through `fill`, atomically. `out` must be missing or empty.
fn fill_folder<T>(
    out: &Path,
    fill: impl FnOnce(&Path) -> Result<T, CurateError>,
) -> Result<T, CurateError> {
    let temporary = store::temporary_beside(out);
    let filled = (|| -> Result<T, CurateError> {
        let _unfinished = Unfinished::folder_beside(out)?;
        let value = fill(&temporary)?;
        if out.is_dir() {
            fs::remove_dir(out).map_err(|error| StoreError::write(out, error))?;
        }
        store::rename(&temporary, out).map_err(|error| StoreError::write(out, error))?;
        Ok(value)
    })();
    filled.map_err(|error| error.in_place_of(&temporary, out))
}

/// Refuses a file in place of the folder of a format.
fn refuse_file(folder: &Path) -> Result<(), CurateError> {
    match folder.is_file() {
        true => Err(CurateError::input(folder, "must be a folder, got a file")),
        false => Ok(()),
    }
}

/// Refuses a non-empty output folder and one without a name (`.`), which nothing can be moved to; removes leftovers of
/// killed processes beside it.
fn refuse_filled(out: &Path) -> Result<(), CurateError> {
    let parent = match (out.parent(), out.file_name()) {
        (Some(parent), Some(_)) if parent.as_os_str().is_empty() => Path::new("."),
        (Some(parent), Some(_)) => parent,
        _ => {
            let reason = "must end with the name of a folder, which is filled at once; choose one with a name";
            return Err(CurateError::input(out, reason));
        }
    };
    if parent.is_dir() {
        store::remove_abandoned(parent)?;
    }
    if !out.exists() {
        return Ok(store::create_folder(parent)?);
    }
    if !out.is_dir() {
        return Err(CurateError::input(
            out,
            "is a file; the output needs a folder",
        ));
    }
    let mut entries = fs::read_dir(out).map_err(|error| StoreError::read(out, error))?;
    if entries.next().is_some() {
        return Err(CurateError::input(
            out,
            "is not empty; choose another output",
        ));
    }
    Ok(())
}

/// Returns a file that another tool's record names, which must lie in the folder of the record.
fn file_of(folder: &Path, file: &str) -> Result<PathBuf, CurateError> {
    let path = folder.join(file);
    let canonical = |path: &Path| fs::canonicalize(path).map_err(|e| StoreError::read(path, e));
    if !canonical(&path)?.starts_with(canonical(folder)?) {
        return Err(CurateError::input(
            folder,
            format!("{file:?} leads out of the folder"),
        ));
    }
    Ok(path)
}

/// Returns an image that another tool's record names, which must lie in the folder; `None` if it is missing.
fn image_of(folder: &Path, file: &str) -> Result<Option<PathBuf>, CurateError> {
    if !folder.join(file).is_file() {
        return Ok(None);
    }
    file_of(folder, file).map(Some)
}

/// Refuses to write a second file of one name into an export.
fn refuse_second(path: &Path) -> Result<(), CurateError> {
    if path.exists() {
        let reason = "two files of the export would have this name";
        return Err(CurateError::input(path, reason));
    }
    Ok(())
}

/// Faces of cubes lie in folders of their own.
fn create_parent(path: &Path) -> Result<(), StoreError> {
    path.parent().map_or(Ok(()), store::create_folder)
}

/// Returns the last part of a path in a record.
fn file_name(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned()
}

/// Returns a file name without its extension.
fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Copies the images of a scene into `images`, under their names, and beside it the masks of pixels outside the scene.
fn copy_images(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    let folder = out.join("images");
    store::create_folder(&folder)?;
    for frame in &scene.frames {
        let path = folder.join(&frame.name);
        refuse_second(&path)?;
        create_parent(&path)?;
        store::copy_atomically(&frame.image, &path)?;
        masks::copy_ignore_mask(frame, &frame.name, out)?;
    }
    Ok(())
}

/// Writes the images for training and for testing, one per line, if there is a split.
fn write_split_lists(scene: &ExportScene, out: &Path) -> Result<(), StoreError> {
    if !scene.has_split {
        return Ok(());
    }
    for (file, is_input) in [("train.txt", true), ("test.txt", false)] {
        let names = scene
            .frames
            .iter()
            .filter(|frame| frame.is_input == is_input);
        let lines: String = names.map(|frame| format!("{}\n", frame.name)).collect();
        store::write_bytes(&out.join(file), lines.as_bytes())?;
    }
    Ok(())
}

/// Parses a JSON file of another tool.
fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, StoreError> {
    let text = store::read_text(path)?;
    serde_json::from_str(&text).map_err(|error| {
        let fault = store::json_fault(&text, &error);
        StoreError::malformed(path, format!("not what the format asks for: {fault}"))
    })
}

/// Writes a JSON file for another tool.
fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), StoreError> {
    let mut bytes = serde_json::to_vec_pretty(value)
        .map_err(|error| StoreError::write(path, std::io::Error::other(error)))?;
    bytes.push(b'\n');
    store::write_bytes(path, &bytes)
}
