//! The frames of a dataset as `WebDataset` shards: tar archives that loaders read from end to end
//! (<https://github.com/webdataset/webdataset>).
//!
//! ```text
//! shards/frames-000000.tar
//!   street/seq-000/000004.png        the frame
//!   street/seq-000/000004.mask.png   moving content, if every frame of the dataset has a mask
//!   street/seq-000/000004.ignore.png pixels outside the scene, if every frame has such a mask
//!   street/seq-000/000004.json       sequence, time, camera, pose and tags
//! ```
//!
//! Everything before the first point of a name is the key of a sample, so points in names of videos are written as
//! `%2E`. Loaders need the same kinds of files for every sample. The bytes depend on the dataset alone: archives hold
//! no time, user or machine.

use std::{
    collections::BTreeMap,
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    camera::Camera,
    layout::{SCENE_FILE, SEQUENCE_FILE},
    progress::Progress,
    records::{Scale, Scene, SceneFrame, Sequence},
    store::{self, StoreError},
};
use serde::Serialize;

use super::{SequenceRow, Statistics};
use crate::error::CurateError;

/// Folder of the shards, in the dataset.
const FOLDER: &str = "shards";
/// Bytes of a header of an archive, and alignment of every entry.
const BLOCK: u64 = 512;

/// A shard: its file in the dataset and its samples.
pub(super) struct Shard {
    pub(super) file: String,
    samples: Vec<Sample>,
}

/// One frame with all that belongs to it.
struct Sample {
    key: String,
    files: Vec<(&'static str, PathBuf)>,
    json: Vec<u8>,
}

/// Metadata of a frame.
#[derive(Serialize)]
struct Description<'a> {
    sequence: &'a str,
    /// Its place among the frames of the sequence, from 0.
    frame: usize,
    /// Presentation timestamp in the source, seconds.
    time_seconds: f64,
    /// Camera, if there is a scene.
    camera: Option<&'a Camera>,
    /// Pose, if the frame has one.
    pose: Option<Pose>,
    /// Unit of the pose's centre.
    scale: Option<Scale>,
    group: &'a str,
    scene: &'a str,
    action: &'a str,
    ego_motion: &'a str,
    dynamics: &'a str,
}

/// Plans the shards of a dataset: frames in its order, as many to a shard as fit in `bytes`, at least one.
///
/// # Errors
/// When a record or frame is missing or malformed.
pub(super) fn plan(
    folder: &Path,
    statistics: &Statistics,
    bytes: u64,
) -> Result<Vec<Shard>, CurateError> {
    let mut samples = Vec::new();
    for row in &statistics.rows {
        samples.extend(samples_of(folder, row)?);
    }
    let in_all = |kind: &str| {
        let has_kind = |sample: &Sample| sample.files.iter().any(|(other, _)| *other == kind);
        samples.iter().all(has_kind)
    };
    let kinds = ["png", "mask.png", "ignore.png"];
    let kinds: Vec<&str> = kinds.into_iter().filter(|kind| in_all(kind)).collect();
    let mut shards: Vec<Shard> = Vec::new();
    let mut filled = 0;
    for mut sample in samples {
        sample.files.retain(|(kind, _)| kinds.contains(kind));
        let size = sample.archived_bytes()?;
        match shards.last_mut() {
            Some(shard) if size <= bytes.saturating_sub(filled) => shard.samples.push(sample),
            _ => {
                filled = 0;
                shards.push(Shard {
                    file: file_name(shards.len()),
                    samples: vec![sample],
                });
            }
        }
        filled = size.saturating_add(filled);
    }
    Ok(shards)
}

/// Returns true if a dataset has shards.
pub(super) fn are_in(folder: &Path) -> bool {
    folder.join(file_name(0)).exists()
}

fn file_name(index: usize) -> String {
    format!("{FOLDER}/frames-{index:06}.tar")
}

/// Writes planned shards.
///
/// # Errors
/// When a frame cannot be read or a shard cannot be written.
pub(super) fn write(
    folder: &Path,
    shards: &[Shard],
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    if shards.is_empty() {
        return Ok(());
    }
    store::create_folder(&folder.join(FOLDER))?;
    progress.begin("writing shards", Some(shards.len() as u64));
    for shard in shards {
        store::write_with(&folder.join(&shard.file), |writer| {
            let mut archive = tar::Builder::new(writer);
            for sample in &shard.samples {
                sample.append(&mut archive)?;
            }
            archive.finish()
        })?;
        progress.advance(1);
    }
    progress.end();
    Ok(())
}

/// Returns the frames of one sequence, in its order.
fn samples_of(folder: &Path, row: &SequenceRow) -> Result<Vec<Sample>, CurateError> {
    let place = folder.join(&row.folder);
    let sequence: Sequence = store::read_record(&place.join(SEQUENCE_FILE))?;
    let scene_file = place.join(SCENE_FILE);
    let scene: Option<Scene> = scene_file
        .is_file()
        .then(|| store::read_record(&scene_file))
        .transpose()?;
    let posed: BTreeMap<&str, &SceneFrame> = (scene.iter())
        .flat_map(|scene| &scene.frames)
        .map(|frame| (frame.image.as_str(), frame))
        .collect();
    let entries = sequence.frames.entries.iter().enumerate();
    entries
        .map(|(index, entry)| {
            let frame = posed.get(entry.file.as_str()).copied();
            let description = Description {
                sequence: &sequence.id,
                frame: index,
                time_seconds: entry.time_seconds,
                camera: scene.as_ref().map(|scene| &scene.camera),
                pose: frame.and_then(|frame| frame.pose),
                scale: scene.as_ref().map(|scene| scene.scale),
                group: &row.group,
                scene: &row.scene,
                action: &row.action,
                ego_motion: &row.ego_motion,
                dynamics: &row.dynamics,
            };
            let json = serde_json::to_vec(&description)
                .map_err(|error| StoreError::malformed(&place, error.to_string()))?;
            let mut files = vec![("png", place.join(&entry.file))];
            let masks = |frame: &SceneFrame| {
                let masks = [
                    ("mask.png", &frame.mask),
                    ("ignore.png", &frame.ignore_mask),
                ];
                masks.map(|(kind, mask)| Some((kind, place.join(mask.as_ref()?))))
            };
            files.extend(frame.map(masks).into_iter().flatten().flatten());
            Ok(Sample {
                key: key(&sequence.id, index),
                files,
                json,
            })
        })
        .collect()
}

/// Returns the key of a frame; no two sequences have the same.
fn key(sequence: &str, frame: usize) -> String {
    let id = sequence.replace('%', "%25").replace('.', "%2E");
    format!("{id}/{frame:06}")
}

impl Sample {
    fn archived_bytes(&self) -> Result<u64, CurateError> {
        let mut bytes = archived(self.json.len() as u64);
        for (_, file) in &self.files {
            let size = fs::metadata(file)
                .map_err(|source| StoreError::read(file, source))?
                .len();
            bytes = bytes.saturating_add(archived(size));
        }
        Ok(bytes)
    }

    fn append<W: Write>(&self, archive: &mut tar::Builder<W>) -> io::Result<()> {
        for (ending, file) in &self.files {
            let bytes =
                fs::read(file).map_err(|error| io::Error::other(StoreError::read(file, error)))?;
            append(archive, &format!("{}.{ending}", self.key), &bytes)?;
        }
        append(archive, &format!("{}.json", self.key), &self.json)
    }
}

fn archived(bytes: u64) -> u64 {
    bytes
        .div_ceil(BLOCK)
        .saturating_add(1)
        .saturating_mul(BLOCK)
}

fn append<W: Write>(archive: &mut tar::Builder<W>, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut header = tar::Header::new_gnu();
    header.set_size(bytes.len() as u64);
    header.set_mode(0o644);
    header.set_mtime(0);
    header.set_uid(0);
    header.set_gid(0);
    header.set_entry_type(tar::EntryType::Regular);
    archive.append_data(&mut header, name, bytes)
}
