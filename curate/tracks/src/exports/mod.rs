//! Tracks in formats of traffic tools.
//!
//! To add a format: one file with a writer, and one line in [`TRACK_FORMATS`].

pub mod geojson;
mod moments;
pub mod mot;
pub mod orthophoto;
pub mod speeds;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{GEOREFERENCE_FILE, SCENE_FILE, TRACKS_FILE},
    ownership::{NameState, OwnFile},
    progress::Progress,
    records::{Georeference, Scene, Tracks},
    stage::StagePlan,
    store,
};

use crate::{
    error::TracksError,
    georeference::{self, RecordedPositions},
};

/// Format of tracks.
#[derive(Debug, Clone, Copy)]
pub struct TrackFormat {
    /// Name on the command line.
    pub id: &'static str,
    /// One line: its content.
    pub about: &'static str,
    /// Name of its file.
    pub file: &'static str,
    /// Maker of the file.
    pub content: Content,
}

/// Contents of files with their names.
pub type NamedFiles = Vec<(&'static str, Vec<u8>)>;

/// Maker of the files of a format.
#[derive(Debug, Clone, Copy)]
pub enum Content {
    /// Returns the text of the file, or one line on what the tracks lack.
    Text(fn(&TrackExport<'_>) -> Result<String, String>),
    /// Returns the file, with others beside it.
    Files(fn(&TrackExport<'_>) -> Result<NamedFiles, TracksError>),
}

impl TrackFormat {
    fn files(&self, export: &TrackExport<'_>) -> Result<NamedFiles, TracksError> {
        match self.content {
            Content::Text(write) => match write(export) {
                Ok(text) => Ok(vec![(self.file, text.into_bytes())]),
                Err(reason) => Err(TracksError::input(&export.folder.join(TRACKS_FILE), reason)),
            },
            Content::Files(write) => write(export),
        }
    }
}

/// All formats.
pub const TRACK_FORMATS: &[TrackFormat] = &[
    mot::FORMAT,
    speeds::FORMAT,
    geojson::FORMAT,
    orthophoto::FORMAT,
];

/// Tracks to export.
#[derive(Debug, Clone, Copy)]
pub struct TrackExport<'a> {
    /// Folder of the scene.
    pub scene_folder: &'a Path,
    /// Folder of the tracks.
    pub folder: &'a Path,
    /// The tracks.
    pub tracks: &'a Tracks,
    /// Their scene.
    pub scene: &'a Scene,
    /// Its place on the Earth; `None` where it is not known.
    pub georeference: Option<&'a Georeference>,
}

/// Input and options of an export.
#[derive(Debug, Clone)]
pub struct TrackExportRequest {
    /// Folder of the scene.
    pub scene_folder: PathBuf,
    /// Folder of the tracks, and of the result.
    pub folder: PathBuf,
    /// Formats.
    pub formats: Vec<&'static TrackFormat>,
    /// Subtitles of a drone's video; `None` for the positions of stills, if they have any.
    pub telemetry: Option<PathBuf>,
}

/// Writes tracks in some formats beside their record, and the place of the scene where it is known. Returns the files
/// and the place. Earlier exports of the same scene, tracks and telemetry stay; others are removed with a note.
///
/// # Errors
/// When a record or the telemetry cannot be read, telemetry does not fit the scene, tracks lack something that a format
/// needs, or a file cannot be written.
pub fn export_tracks(
    request: &TrackExportRequest,
    progress: &dyn Progress,
) -> Result<(Vec<PathBuf>, Option<Georeference>), TracksError> {
    let scene_path = request.scene_folder.join(SCENE_FILE);
    let tracks_path = request.folder.join(TRACKS_FILE);
    let scene: Scene = store::read_record(&scene_path)?;
    let missing = || TracksError::input(&tracks_path, "is missing: curate tracks makes it");
    let tracks = Tracks::beside_split(&scene.id, &request.folder)?.ok_or_else(missing)?;
    let georeference = place(request, &scene, progress)?;
    let contradiction = georeference
        .as_ref()
        .and_then(|place| georeference::scale_note(place.metres_per_unit, tracks.metres_per_unit));
    if let Some(line) = contradiction {
        progress.note(&format!("{}: {line}", scene.id));
    }
    let export = TrackExport {
        scene_folder: &request.scene_folder,
        folder: &request.folder,
        tracks: &tracks,
        scene: &scene,
        georeference: georeference.as_ref(),
    };
    let written = request.formats.iter().map(|format| format.files(&export));
    let written: Vec<NamedFiles> = written.collect::<Result<_, TracksError>>()?;
    let contents: NamedFiles = written.into_iter().flatten().collect();
    let mut plan = StagePlan::new(&request.folder, "track-exports")
        .with_file(&scene_path)?
        .with_file(&tracks_path)?;
    if let Some(file) = &request.telemetry {
        plan = plan.with_file(file)?;
    }
    let place = georeference.iter().map(|_| GEOREFERENCE_FILE);
    let files: Vec<&str> = contents
        .iter()
        .map(|(file, _)| *file)
        .chain(place)
        .collect();
    let (is_same, earlier) = (plan.is_done(), plan.own_files());
    plan.run(&files, progress, |out| {
        for (file, content) in &contents {
            out.write_bytes(file, content)?;
        }
        if let Some(georeference) = &georeference {
            out.write_record(GEOREFERENCE_FILE, georeference)?;
        }
        for OwnFile { file, .. } in earlier.files() {
            if out.has(&file) || earlier.standing(&file)? != NameState::Ours {
                continue;
            }
            if is_same {
                out.add(file);
            } else {
                // Beside these files it would be of other tracks or of another place.
                let path = request.folder.join(&file);
                progress.note(&format!(
                    "{}: removed, an export of another scene, tracks or telemetry",
                    path.display()
                ));
                store::remove(&path)?;
            }
        }
        Ok::<_, TracksError>(())
    })?;
    let files = files.iter().map(|file| request.folder.join(file));
    Ok((files.collect(), georeference))
}

/// Returns the place of the scene on the Earth. Positions of stills that do not determine it are left out with a note.
fn place(
    request: &TrackExportRequest,
    scene: &Scene,
    progress: &dyn Progress,
) -> Result<Option<Georeference>, TracksError> {
    let found = match &request.telemetry {
        Some(file) => {
            let recorded = RecordedPositions::of_telemetry(scene, file)?;
            let fitted = recorded.georeference(scene);
            Some(fitted.map_err(|reason| TracksError::input(file, reason))?)
        }
        None => match RecordedPositions::of_stills(scene).map(|one| one.georeference(scene)) {
            Some(Err(reason)) => {
                progress.note(&format!(
                    "{}: positions in EXIF are left out: {reason}",
                    scene.id
                ));
                None
            }
            Some(Ok(fitted)) => Some(fitted),
            None => None,
        },
    };
    if let Some(georeference) = &found {
        progress.note(&format!(
            "{}: {}",
            scene.id,
            georeference::words(georeference)
        ));
    }
    Ok(found)
}
