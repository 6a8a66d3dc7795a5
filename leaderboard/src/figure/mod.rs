//! Figures for papers: rendered views of several methods beside the ground truth, with a part of them
//! enlarged and their errors; and the gallery of a dataset.
//!
//! The images are comparison images of scoring, and frames of sequences. Only this module of the crate decodes any.

mod gallery;
mod panels;
mod svg;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    rgb,
    store::{self, StoreError},
};

use crate::{
    collect::RecordFiles,
    error::LeaderboardError,
    group::{self, Group, MethodRow},
    layouts::standings,
    site::comparisons::{COMPARISONS, SEPARATOR, check_size},
};
use panels::{Canvas, Region, Views};

pub use gallery::{Gallery, GalleryRequest, gallery};

/// Content and files of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct FigureRequest {
    /// Folder to search for `result.json` files.
    pub results: PathBuf,
    /// The figure without its ending: `.png` and `.svg` are written.
    pub out: PathBuf,
    /// Id of a protocol, `per-scene`; the first one if `None`.
    pub protocol: Option<String>,
    /// Rows; all scenes with views if empty.
    pub scenes: Vec<String>,
    /// Columns after the ground truth; if empty all methods with complete results, class by class and by rank.
    pub methods: Vec<String>,
    /// Frame of the novel views; the first one that all methods have if `None`.
    pub frame: Option<u32>,
    /// The enlarged part: left and upper edge and width as shares of the image's width; height is half of the width. If
    /// `None`, the part in which the methods differ most.
    pub inset: Option<[f64; 3]>,
    /// Width of a panel in pixels.
    pub panel_width: usize,
}

/// A figure as drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// Pixels alone.
    pub png: PathBuf,
    /// The same pixels with names.
    pub svg: PathBuf,
    /// Scene and frame of every row.
    pub rows: Vec<(String, u32)>,
    /// The ground truth and the methods.
    pub columns: Vec<String>,
}

/// Name of the first column.
const TRUTH: &str = "Ground truth";

/// Draws a figure.
///
/// # Errors
/// When there are no results with such views, a name is unknown, an image cannot be read, or another figure of that
/// name exists already.
pub fn figure(request: &FigureRequest) -> Result<Figure, LeaderboardError> {
    let results = RecordFiles::below(&request.results)?.results()?;
    let groups = group::groups(&results)?;
    let group = chosen_group(request, &groups)?;
    let folders: BTreeMap<*const _, &Path> = results
        .iter()
        .filter_map(|(file, result)| Some((std::ptr::from_ref(result), file.parent()?)))
        .collect();
    let methods = chosen_methods(request, group)?;
    let scenes = chosen_scenes(request, group)?;
    let mut rows = Vec::new();
    for scene in scenes {
        let found = views_of(request, group, &folders, &scene, &methods)?;
        rows.extend(found.map(|(frame, views)| (scene, frame, views)));
    }
    if rows.is_empty() {
        return Err(unusable(
            &request.results,
            format!("no scene has novel views of {}", methods.join(", ")),
        ));
    }
    let canvas = Canvas::of(&rows, request.inset.map(Region::from), request.panel_width);
    let columns: Vec<String> = [TRUTH.to_owned()].into_iter().chain(methods).collect();
    let rows: Vec<(String, u32)> = (rows.into_iter())
        .map(|(scene, frame, _)| (scene, frame))
        .collect();
    let size = [canvas.width, canvas.height];
    let [png, svg] = write_both(&request.out, size, &canvas.rgb, |pixels| {
        svg::drawing(&canvas, pixels, &columns, &rows)
    })?;
    Ok(Figure {
        png,
        svg,
        rows,
        columns,
    })
}

/// Writes an image as OUT.png, and the result of `svg` on that file's bytes as OUT.svg.
///
/// # Errors
/// When another file of that name exists already, or one cannot be written.
fn write_both(
    out: &Path,
    [width, height]: [usize; 2],
    rgb: &[u8],
    svg: impl FnOnce(&[u8]) -> String,
) -> Result<[PathBuf; 2], LeaderboardError> {
    let names = ["png", "svg"].map(|name| ending(out, name));
    if let Some(folder) = out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        store::create_folder(folder)?;
        store::remove_abandoned(folder)?;
    }
    let temporary = store::temporary_beside(&names[0]);
    let written = rgb::write_rgb8_png(&temporary, width, height, rgb);
    let pixels = written.and_then(|()| {
        std::fs::read(&temporary).map_err(|source| StoreError::read(&temporary, source))
    });
    store::remove(&temporary)?;
    let pixels = pixels?;
    let drawing = svg(&pixels).into_bytes();
    let contents = [pixels, drawing];
    for (file, bytes) in names.iter().zip(&contents) {
        // An equal file comes from a run interrupted between its files.
        if file.exists() && std::fs::read(file).ok().as_ref() != Some(bytes) {
            let reason = "is there already; name another figure";
            return Err(unusable(file, reason.to_owned()));
        }
    }
    for (file, bytes) in names.iter().zip(&contents) {
        store::write_bytes(file, bytes)?;
    }
    Ok(names)
}

fn ending(out: &Path, ending: &str) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    PathBuf::from(name)
}

fn unusable(path: &Path, reason: String) -> LeaderboardError {
    LeaderboardError::Figure {
        path: path.to_owned(),
        reason,
    }
}

fn chosen_group<'g, 'a>(
    request: &FigureRequest,
    groups: &'g [Group<'a>],
) -> Result<&'g Group<'a>, LeaderboardError> {
    let is_wanted = |group: &&Group<'_>| match &request.protocol {
        None => true,
        Some(wanted) => {
            let id = group
                .protocol
                .split_once('/')
                .map_or(group.protocol, |(id, _)| id);
            wanted == id || wanted == group.protocol
        }
    };
    groups.iter().find(is_wanted).ok_or_else(|| {
        let known: Vec<&str> = groups.iter().map(|group| group.protocol).collect();
        let wanted = request.protocol.as_deref().unwrap_or_default();
        let known = known.join(", ");
        unusable(
            &request.results,
            format!("no result is under protocol {wanted}; there are {known}"),
        )
    })
}

fn chosen_methods(
    request: &FigureRequest,
    group: &Group<'_>,
) -> Result<Vec<String>, LeaderboardError> {
    let known: Vec<&str> = group.methods.iter().map(|method| method.method).collect();
    if request.methods.is_empty() {
        let is_shown = |method: &&MethodRow<'_>| {
            let mut rows = group.rows_of(method.method);
            rows.any(|row| row.numbers.complete)
        };
        let methods = standings(group).into_iter().filter(is_shown);
        return Ok(methods.map(|method| method.method.to_owned()).collect());
    }
    known_names(request, "method", &request.methods, &known)
}

fn chosen_scenes(
    request: &FigureRequest,
    group: &Group<'_>,
) -> Result<Vec<String>, LeaderboardError> {
    if request.scenes.is_empty() {
        return Ok(group.scenes.iter().map(|&scene| scene.to_owned()).collect());
    }
    known_names(request, "scene", &request.scenes, &group.scenes)
}

fn known_names(
    request: &FigureRequest,
    what: &str,
    wanted: &[String],
    known: &[&str],
) -> Result<Vec<String>, LeaderboardError> {
    match wanted.iter().find(|name| !known.contains(&name.as_str())) {
        None => Ok(wanted.to_vec()),
        Some(unknown) => Err(unusable(
            &request.results,
            format!("has no {what} {unknown}; there are {}", known.join(", ")),
        )),
    }
}

/// Returns the frame and the methods' views of it; none for a scene not requested by name if some method has no views
/// of it.
fn views_of(
    request: &FigureRequest,
    group: &Group<'_>,
    folders: &BTreeMap<*const omnilife_schemas::records::ResultRecord, &Path>,
    scene: &str,
    methods: &[String],
) -> Result<Option<(u32, Views)>, LeaderboardError> {
    let mut places: Vec<(PathBuf, [u32; 2])> = Vec::new();
    for method in methods {
        let mut rows = group.rows_in(scene).iter();
        let row = rows.find(|row| row.method == method && row.numbers.complete);
        let place = row.and_then(|row| {
            let folder = folders.get(&std::ptr::from_ref(row.results[0]))?;
            Some((folder.join(COMPARISONS), row.results[0].scored_size))
        });
        places.extend(place);
    }
    let missing = |reason: String| {
        if request.scenes.is_empty() {
            Ok(None)
        } else {
            Err(unusable(&request.results, reason))
        }
    };
    if places.len() < methods.len() {
        return missing(format!(
            "not every method has a complete result of scene {scene}"
        ));
    }
    let has = |frame: u32| {
        let file = file_name(frame);
        places
            .iter()
            .all(|(folder, _)| folder.join(&file).is_file())
    };
    let frames = match request.frame {
        Some(frame) => vec![frame],
        None => frames_in(&places[0].0)?,
    };
    let Some(frame) = frames.into_iter().find(|&frame| has(frame)) else {
        return missing(format!("the methods share no novel view of scene {scene}"));
    };
    let mut pairs = Vec::new();
    for (folder, size) in places {
        let file = folder.join(file_name(frame));
        if let Err(reason) = check_size(&file, size)? {
            return Err(unusable(&file, reason));
        }
        pairs.push((rgb::RgbImage::read(&file)?, size));
    }
    Ok(Some((frame, Views::of(&pairs, SEPARATOR as usize))))
}

fn file_name(frame: u32) -> String {
    format!("novel-{frame:06}.png")
}

/// Returns frames of the novel views of a folder, sorted; none if it is missing.
fn frames_in(folder: &Path) -> Result<Vec<u32>, StoreError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let names = store::paths_in(folder)?;
    let mut frames: Vec<u32> = (names.iter())
        .filter_map(|path| {
            let name = path.file_name()?.to_str()?;
            name.strip_prefix("novel-")?
                .strip_suffix(".png")?
                .parse()
                .ok()
        })
        .collect();
    frames.sort_unstable();
    Ok(frames)
}
