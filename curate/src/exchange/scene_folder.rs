//! From a scene in another tool's format to ours.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    image_file::ImageFile,
    layout::{FRAMES_FOLDER, IGNORE_MASKS_FOLDER, POINTS_FILE, SCENE_FILE, SCENE_MASKS_FOLDER},
    records::{PoseSource, Scale, Scene, SceneFrame},
    rgb::Mask,
    store::{self, StoreError},
};

use super::{ForeignFrame, ForeignScene, format, times};
use crate::{error::CurateError, poses::given};

/// What to import.
#[derive(Debug, Clone)]
pub struct ImportRequest<'a> {
    /// Folder in the other tool's format.
    pub folder: &'a Path,
    /// Its format, see [`FORMATS`](super::FORMATS).
    pub format: &'a str,
    /// Name of the scene.
    pub id: &'a str,
    /// Frames per second, where the folder has no `times.csv`.
    pub frames_per_second: Option<f64>,
    /// What the masks mark, of formats that have one kind of masks.
    pub masks: MaskMeaning,
    /// Folder to fill; must not exist or be empty.
    pub out: &'a Path,
}

/// What masks mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskMeaning {
    /// What moves: part of the scene.
    Moving,
    /// What is no part of the scene, such as who holds the camera.
    Ignored,
}

/// Imports a scene: `scene.json`, `frames/`, `masks/` and `points.ply`.
///
/// Poses are taken as they are and marked unchecked, the scale as arbitrary.
///
/// # Errors
/// [`CurateError::Input`] for an unknown format, missing times, images of another size and an
/// output that holds something; [`CurateError::Store`] for malformed files.
pub fn import(request: &ImportRequest<'_>) -> Result<Scene, CurateError> {
    let format = format(request.format, request.folder)?;
    super::refuse_filled(request.out)?;
    let foreign = (format.import)(request.folder)?;
    let names = image_names(request.folder, &foreign)?;
    let times = frame_times(request, &foreign.frames)?;
    super::fill_folder(request.out, |folder| {
        write(request, &foreign, (&names, &times), folder)
    })
}

/// Writes the scene into an empty folder.
fn write(
    request: &ImportRequest<'_>,
    foreign: &ForeignScene,
    (names, times): (&[String], &[f64]),
    out: &Path,
) -> Result<Scene, CurateError> {
    store::create_folder(&out.join(FRAMES_FOLDER))?;
    let mut frames = Vec::new();
    for ((frame, name), time_seconds) in foreign.frames.iter().zip(names).zip(times) {
        let image = format!("{FRAMES_FOLDER}/{name}");
        check_size(foreign, frame)?;
        super::copy(&frame.image, &out.join(&image))?;
        let ignored = ignored(foreign, frame, request)?;
        frames.push(SceneFrame {
            image,
            time_seconds: *time_seconds,
            // Nothing is to be learned from a frame that shows nothing of the scene, or to be scored.
            pose: frame
                .pose
                .filter(|_| !ignored.as_ref().is_some_and(Mask::is_full)),
            mask: import_mask(
                foreign,
                (frame, name),
                (ignored.as_ref(), request.masks),
                out,
            )?,
            ignore_mask: write_mask(ignored, IGNORE_MASKS_FOLDER, name, out)?,
            classes: [].into(),
            objects: match request.masks {
                MaskMeaning::Moving => import_objects(foreign, (frame, name), out)?,
                MaskMeaning::Ignored => [].into(),
            },
            depth: None,
            depth_prior: None,
        });
    }
    frames.sort_by(|a, b| a.time_seconds.total_cmp(&b.time_seconds));
    let points = if foreign.points.is_empty() {
        None
    } else {
        foreign.points.write_ply(&out.join(POINTS_FILE))?;
        Some(POINTS_FILE.to_owned())
    };
    let poses: Vec<_> = frames.iter().map(|frame| frame.pose).collect();
    let scene = Scene {
        id: request.id.to_owned(),
        camera: foreign.camera,
        scale: Scale::Arbitrary,
        frames,
        points,
        pose_source: foreign
            .pose_source
            .clone()
            .unwrap_or_else(|| PoseSource::Given {
                file: request.folder.display().to_string(),
            }),
        validation: given::unchecked(&poses),
    };
    store::write_record(&out.join(SCENE_FILE), &scene)?;
    Ok(scene)
}

fn image_name(frame: &ForeignFrame) -> String {
    frame
        .image
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// File names that the frames get in one folder: their own, and where those collide (faces of cubes)
/// with that of their folder before it.
///
/// # Errors
/// Where that does not tell them apart either.
fn image_names(folder: &Path, foreign: &ForeignScene) -> Result<Vec<String>, CurateError> {
    let repeated = |names: &[String]| {
        let mut seen = BTreeSet::new();
        names.iter().find(|name| !seen.insert(*name)).cloned()
    };
    let mut names: Vec<String> = foreign.frames.iter().map(image_name).collect();
    if repeated(&names).is_some() {
        let of_folders = foreign.frames.iter().map(name_with_folder);
        names = of_folders.map(|name| name.replace('/', "_")).collect();
    }
    match repeated(&names) {
        Some(name) => Err(CurateError::input(
            folder,
            format!("has two images named {name}"),
        )),
        None => Ok(names),
    }
}

/// The file with the folder that it lies in, `front/000000.png`.
fn name_with_folder(frame: &ForeignFrame) -> String {
    let folder = frame
        .image
        .parent()
        .and_then(Path::file_name)
        .unwrap_or_default();
    format!("{}/{}", folder.to_string_lossy(), image_name(frame))
}

/// Times from `times.csv`, else from the frame rate given.
fn frame_times(
    request: &ImportRequest<'_>,
    frames: &[ForeignFrame],
) -> Result<Vec<f64>, CurateError> {
    let Some(times) = times::read(request.folder)? else {
        let rate = request
            .frames_per_second
            .filter(|rate| rate.is_finite() && *rate > 0.0);
        let rate = rate.ok_or_else(|| {
            CurateError::input(
                request.folder,
                format!(
                    "has no {}, so nothing says when its frames were shown; give --fps",
                    times::TIMES_FILE
                ),
            )
        })?;
        let times: Vec<f64> = (0..frames.len()).map(|index| index as f64 / rate).collect();
        if times.last().is_some_and(|last| !last.is_finite()) {
            let reason = format!("--fps {rate} gives times beyond all numbers");
            return Err(CurateError::input(request.folder, reason));
        }
        return Ok(times);
    };
    frames
        .iter()
        .enumerate()
        .map(|(index, frame)| {
            time_of(&times, frame, index).ok_or_else(|| {
                CurateError::input(
                    &request.folder.join(times::TIMES_FILE),
                    format!("has no time for {}", image_name(frame)),
                )
            })
        })
        .collect()
}

/// By name; by number where the format has renamed the frames (the table is in order of time, and
/// names count upwards).
fn time_of(times: &BTreeMap<String, f64>, frame: &ForeignFrame, index: usize) -> Option<f64> {
    times
        .get(&image_name(frame))
        .or_else(|| times.get(&name_with_folder(frame)))
        .or_else(|| times.values().nth(index))
        .copied()
}

fn check_size(foreign: &ForeignScene, frame: &ForeignFrame) -> Result<(), CurateError> {
    let [width, height] = ImageFile::open(&frame.image)?.size();
    if [width, height] == size_of(foreign) {
        return Ok(());
    }
    Err(CurateError::input(
        &frame.image,
        format!(
            "is {width}x{height}, its scene says {}x{}",
            foreign.camera.width(),
            foreign.camera.height()
        ),
    ))
}

/// Width and height of a scene's images.
fn size_of(foreign: &ForeignScene) -> [usize; 2] {
    foreign.camera.size()
}

/// What is no part of the scene in a frame: the mask that one of our exports has of it, or the frame's one
/// mask, where that is what masks are said to mark.
fn ignored(
    foreign: &ForeignScene,
    frame: &ForeignFrame,
    request: &ImportRequest<'_>,
) -> Result<Option<Mask>, CurateError> {
    // Below the folder of the images: faces of cubes lie in folders of their own.
    let below = frame.image.strip_prefix(request.folder).ok();
    let name: PathBuf = below
        .into_iter()
        .flat_map(|path| path.iter().skip(1))
        .collect();
    let own = super::masks::ignore_mask_path(request.folder, &name.to_string_lossy());
    if own.is_file() {
        return Ok(Some(read_mask(foreign, &own)?));
    }
    match request.masks {
        MaskMeaning::Moving => Ok(None),
        MaskMeaning::Ignored if frame.objects.is_empty() => given_mask(foreign, frame),
        MaskMeaning::Ignored => {
            let mut all: Option<Mask> = None;
            for file in frame.objects.values() {
                let mask = read_mask(foreign, file)?;
                all = Some(match all {
                    Some(all) => all.united(&mask),
                    None => mask,
                });
            }
            Ok(all)
        }
    }
}

/// The one mask that a frame comes with.
fn given_mask(foreign: &ForeignScene, frame: &ForeignFrame) -> Result<Option<Mask>, CurateError> {
    let Some(found) = &frame.mask else {
        return Ok(None);
    };
    let mask = read_mask(foreign, &found.file)?;
    Ok(Some(if found.black_is_dynamic {
        mask.inverted()
    } else {
        mask
    }))
}

fn read_mask(foreign: &ForeignScene, file: &Path) -> Result<Mask, CurateError> {
    let image = ImageFile::open(file)?;
    if image.size() != size_of(foreign) {
        return Err(CurateError::input(file, "is not of its image's size"));
    }
    Ok(Mask::decode(image)?)
}

/// What moves in a frame.
fn import_mask(
    foreign: &ForeignScene,
    (frame, name): (&ForeignFrame, &str),
    (ignored, meaning): (Option<&Mask>, MaskMeaning),
    out: &Path,
) -> Result<Option<String>, CurateError> {
    if meaning == MaskMeaning::Ignored {
        return Ok(None);
    }
    let mask = given_mask(foreign, frame)?;
    let has_both_kinds = frame
        .mask
        .as_ref()
        .is_some_and(|found| found.black_is_dynamic);
    let mask = match ignored {
        // Masks of what to look at have both kinds in them, where there is only the other one as well.
        Some(ignored) if has_both_kinds => (mask.map(|mask| mask.without(ignored)))
            .filter(|mask| mask.data.iter().any(|&value| value != 0)),
        _ => mask,
    };
    write_mask(mask, SCENE_MASKS_FOLDER, name, out)
}

/// Writes the mask of a frame into a folder of the scene; returns its place there.
fn write_mask(
    mask: Option<Mask>,
    folder: &str,
    name: &str,
    out: &Path,
) -> Result<Option<String>, CurateError> {
    let Some(mask) = mask else {
        return Ok(None);
    };
    store::create_folder(&out.join(folder))?;
    let file = format!("{folder}/{}.png", super::stem(name));
    mask.write_png(&out.join(&file))?;
    Ok(Some(file))
}

/// Copies the masks of a frame's objects; those that show nothing are left out.
fn import_objects(
    foreign: &ForeignScene,
    (frame, name): (&ForeignFrame, &str),
    out: &Path,
) -> Result<BTreeMap<String, String>, CurateError> {
    let mut objects = BTreeMap::new();
    for (object, found) in &frame.objects {
        let mask = Mask::decode(ImageFile::open(found)?.expect_size(size_of(foreign))?)?;
        if mask.data.iter().all(|&value| value < 128) {
            continue;
        }
        let folder = format!("{SCENE_MASKS_FOLDER}/{object}");
        store::create_folder(&out.join(&folder))?;
        let file = format!("{folder}/{}.png", super::stem(name));
        mask.write_png(&out.join(&file))?;
        objects.insert(object.clone(), file);
    }
    Ok(objects)
}

/// The image files of a folder in order of their names.
pub(super) fn sorted_files(folder: &Path) -> Result<Vec<PathBuf>, CurateError> {
    let failed = |error| StoreError::read(folder, error);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let is_image = path
            .extension()
            .is_some_and(|extension| ["png", "jpg", "jpeg"].iter().any(|e| extension == *e));
        if is_image {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
