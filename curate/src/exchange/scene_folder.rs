//! Import of a scene from another tool's format.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    camera::Camera,
    image_file::ImageFile,
    layout::{
        FRAMES_FOLDER, IGNORE_MASKS_FOLDER, POINTS_FILE, SCENE_FILE, SCENE_MASKS_FOLDER,
        TRACKS_FILE,
    },
    mask_file::{self, MarkedGreys},
    mask_survey::MaskSurvey,
    records::{PoseSource, Scene, SceneFrame},
    rgb::Mask,
    store::{self, StoreError},
};

use super::{
    ForeignFrame, ForeignScene, distances, format,
    frame_images::{FrameImage, UnusualFrames},
    frame_times::frame_times,
    left_out,
    own_record::OwnRecord,
    published_split::{self, SplitFrames},
};
use crate::{
    error::CurateError,
    frame_order,
    poses::{agreement, given, lens::Straightening},
};

/// Input and options of an import.
#[derive(Debug, Clone)]
pub struct ImportRequest<'a> {
    /// Folder in the other tool's format.
    pub folder: &'a Path,
    /// Its format, see [`FORMATS`](super::FORMATS).
    pub format: &'a str,
    /// Name of the scene.
    pub id: &'a str,
    /// Frames per second, if the folder has no `times.csv`.
    pub frames_per_second: Option<f64>,
    /// Meaning of masks in formats with one kind of masks.
    pub masks: MaskMeaning,
    /// Folder to fill; must not exist or be empty.
    pub out: &'a Path,
}

impl<'a> ImportRequest<'a> {
    /// Makes a request to import a folder whose masks are of moving content.
    pub fn new(folder: &'a Path, format: &'a str, id: &'a str, out: &'a Path) -> Self {
        Self {
            folder,
            format,
            id,
            frames_per_second: None,
            masks: MaskMeaning::Moving,
            out,
        }
    }
}

/// Meaning of masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskMeaning {
    /// Moving content: part of the scene.
    Moving,
    /// Pixels outside the scene, such as the camera operator.
    Ignored,
}

/// Imports a scene: `scene.json`, `frames/`, `masks/`, `depth/` and `points.ply`; of a drive `depth-prior/` and
/// `tracks.json` too.
///
/// Poses are taken as they are and marked unchecked; a record of ours in the folder is kept entirely. The scale is
/// arbitrary unless the format states it. Images are copied, with three exceptions: a lens is undistorted, transparent
/// pixels become no part of the scene, and images are turned by their orientation. Decisions, assumptions and omissions
/// are listed as problems in the scene's validation, a line each.
///
/// # Errors
/// [`CurateError::Input`] for an unknown format, missing times, images that are missing or of another size, and a
/// non-empty output; [`CurateError::Store`] for malformed files.
pub fn import(request: &ImportRequest<'_>) -> Result<Scene, CurateError> {
    let format = format(request.format, request.folder)?;
    super::refuse_filled(request.out)?;
    super::refuse_file(request.folder)?;
    let mut foreign = (format.import)(request.folder)?;
    let broken_links = left_out::broken_links(&foreign);
    left_out::expect_images(request.folder, &foreign, &broken_links)?;
    let own = OwnRecord::read(format, &foreign.root)?;
    if own.is_none() {
        foreign
            .frames
            .sort_by(|a, b| frame_order::natural_paths(&a.image, &b.image));
    }
    for frame in &foreign.frames {
        check_size(&foreign, frame)?;
    }
    let beside = left_out::images_beside(&foreign)?;
    let times = match &own {
        Some(own) => own.times(&foreign.frames),
        None => frame_times(request, &foreign, &beside)?,
    };
    let split = published_split::find(&foreign)?;
    let beside: Vec<String> = beside.iter().map(|path| below(&foreign, path)).collect();
    let notes: Vec<String> = (foreign.notes.iter().cloned())
        .chain(foreign.camera.remark())
        .chain(left_out::line(
            &foreign.missing_images,
            "poses left out, whose images are not there",
        ))
        .chain(left_out::line(
            &broken_links,
            "of these, links whose target is missing",
        ))
        .chain(left_out::line(
            &beside,
            "images left out, which have no pose",
        ))
        .chain(distances::missing(&foreign))
        .chain(foreign.failed_registration())
        .chain(left_out::unread_lists(&foreign))
        .chain(split.note)
        .chain(times.notes)
        .collect();
    let source = Source {
        straightening: foreign.camera.straightening(),
        scene: &foreign,
        split: split.frames,
        own,
    };
    let names = image_names(request.folder, &source)?;
    super::fill_folder(request.out, |folder| {
        write(request, &source, (&names, &times.seconds), notes, folder)
    })
}

/// A scene as read, with the resampling of its frames to a camera without a lens.
struct Source<'a> {
    scene: &'a ForeignScene,
    straightening: Option<Straightening>,
    split: Option<SplitFrames>,
    own: Option<OwnRecord>,
}

/// Writes the scene into an empty folder.
fn write(
    request: &ImportRequest<'_>,
    source: &Source<'_>,
    (names, times): (&[String], &[f64]),
    notes: Vec<String>,
    out: &Path,
) -> Result<Scene, CurateError> {
    store::create_folder(&out.join(FRAMES_FOLDER))?;
    let mut frames = Vec::new();
    let (mut unusual, mut masks) = (UnusualFrames::default(), MaskSurvey::default());
    let camera = source.scene.camera.camera();
    for ((frame, name), time_seconds) in source.scene.frames.iter().zip(names).zip(times) {
        let still = source.scene.stills.get(&frame.image);
        let still = still.map(|(still, _)| still);
        let placement = still.and_then(|still| still.placement.as_ref());
        let lens = source.straightening.as_ref();
        let view = (source.scene.drive.as_ref()).and_then(|drive| drive.view(&frame.image));
        let own_camera = view.and_then(|view| view.own_camera.as_ref());
        let image = match (own_camera, &camera) {
            (Some(own), Camera::Pinhole(common)) => {
                FrameImage::resampled(frame, name, (own, common), out)?
            }
            _ => {
                let pixels = source.scene.pixels.of(&frame.image, camera.size())?;
                FrameImage::import(frame, name, (lens, placement, pixels), out)?
            }
        };
        unusual.add(name, &image);
        look_at_masks(source, (frame, request.masks), &mut masks)?;
        let ignored = ignored(source, frame, request)?;
        if let Some(mask) = &ignored {
            masks.add_ignored_share(mask.marked_share(&camera));
        }
        let ignored = united(ignored, image.ignored);
        let mut entry = SceneFrame {
            image: image.file,
            time_seconds: *time_seconds,
            // A frame that shows nothing of the scene can be neither learned from nor scored.
            pose: frame
                .pose
                .filter(|_| !ignored.as_ref().is_some_and(Mask::is_full)),
            mask: import_mask(
                source,
                (frame, name),
                (ignored.as_ref(), request.masks),
                out,
            )?,
            ignore_mask: write_mask(ignored, IGNORE_MASKS_FOLDER, name, out)?,
            classes: [].into(),
            objects: match request.masks {
                MaskMeaning::Moving => import_objects(source, (frame, name), out)?,
                MaskMeaning::Ignored => [].into(),
            },
            boxes: view.map(|view| view.boxes.clone()).unwrap_or_default(),
            depth: distances::import(source.scene, frame, name, out)?,
            depth_prior: match view {
                Some(view) => view.write_ranges(&camera, name, out)?,
                None => None,
            },
            capture: still
                .map(|still| still.capture.clone())
                .filter(|capture| !capture.is_empty()),
        };
        if let Some(own) = &source.own {
            own.complete((frame, name), &mut entry, out)?;
        }
        frames.push(entry);
    }
    frames.sort_by(|a, b| a.time_seconds.total_cmp(&b.time_seconds));
    let points = if source.scene.points.is_empty() {
        None
    } else {
        source.scene.points.write_ply(&out.join(POINTS_FILE))?;
        Some(POINTS_FILE.to_owned())
    };
    let poses: Vec<_> = frames.iter().map(|frame| frame.pose).collect();
    let unchecked = given::unchecked(&poses);
    let mut validation = match &source.own {
        Some(own) => own.validation(unchecked),
        None => unchecked,
    };
    if matches!(camera, Camera::Erp(_)) && source.own.is_none() {
        let images: Vec<&str> = frames.iter().map(|frame| &*frame.image).collect();
        agreement::check(out, &images, &poses, &mut validation)?;
    }
    validation.problems.extend(notes);
    validation.problems.extend(unusual.notes());
    validation.problems.extend(masks.notes());
    let scene = Scene {
        id: request.id.to_owned(),
        camera: source.scene.camera.camera(),
        scale: source.scene.scale,
        frames,
        points,
        pose_source: (source.scene.pose_source)
            .clone()
            .unwrap_or_else(|| PoseSource::Given {
                file: file_name(request.folder),
            }),
        validation,
        published_split: source.split.as_ref().map(|split| split.record(times)),
        objects: match request.masks {
            MaskMeaning::Moving => source.scene.objects.clone(),
            MaskMeaning::Ignored => [].into(),
        },
    };
    store::write_record(&out.join(SCENE_FILE), &scene)?;
    let drive = source.scene.drive.as_ref();
    if let Some(tracks) = drive.and_then(|drive| drive.tracks(&scene)) {
        store::write_record(&out.join(TRACKS_FILE), &tracks)?;
    }
    Ok(scene)
}

fn image_name(frame: &ForeignFrame) -> String {
    file_name(&frame.image)
}

pub(super) fn file_name(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Returns the file names of the frames in one folder: their own, with that of their folder before it if those collide
/// (faces of cubes). Undistorted frames become PNG files.
///
/// # Errors
/// If names still collide.
fn image_names(folder: &Path, source: &Source<'_>) -> Result<Vec<String>, CurateError> {
    let written = |name: String| match source.straightening {
        Some(_) => format!("{}.png", super::stem(&name)),
        None => name,
    };
    let repeated = |names: &[String]| {
        let mut seen = BTreeSet::new();
        names.iter().find(|name| !seen.insert(*name)).cloned()
    };
    let frames = &source.scene.frames;
    let drive = source.scene.drive.as_ref();
    let own = frames.iter().map(|frame| {
        let view = drive.and_then(|drive| drive.view(&frame.image));
        view.map_or_else(|| image_name(frame), |view| view.name.clone())
    });
    let mut names: Vec<String> = own.map(written).collect();
    if repeated(&names).is_some() {
        let of_folders = frames.iter().map(|frame| name_with_folder(&frame.image));
        names = of_folders
            .map(|name| written(name.replace('/', "_")))
            .collect();
    }
    match repeated(&names) {
        Some(name) => Err(CurateError::input(
            folder,
            format!("has two images named {name}"),
        )),
        None => Ok(names),
    }
}

/// Returns the file with the folder that it lies in, `front/000000.png`.
pub(super) fn name_with_folder(image: &Path) -> String {
    let folder = image.parent().and_then(Path::file_name);
    format!(
        "{}/{}",
        folder.unwrap_or_default().to_string_lossy(),
        file_name(image)
    )
}

/// Returns the place of a file in the folder of a scene.
fn below(scene: &ForeignScene, file: &Path) -> String {
    let place = file.strip_prefix(&scene.root).unwrap_or(file);
    place.display().to_string()
}

fn check_size(scene: &ForeignScene, frame: &ForeignFrame) -> Result<(), CurateError> {
    if scene.stills.contains_key(&frame.image) {
        // Checked already; they may show a part of their sphere.
        return Ok(());
    }
    let view = (scene.drive.as_ref()).and_then(|drive| drive.view(&frame.image));
    let expected = view.map_or_else(|| scene.camera.camera().size(), |view| view.size);
    let pixels = scene.pixels.of(&frame.image, expected)?;
    let [width, height] = pixels.size(ImageFile::open(&frame.image)?)?;
    if [width, height] == expected {
        return Ok(());
    }
    let [across, down] = expected;
    let reason = format!("is {width}x{height}, its scene says {across}x{down}");
    Err(CurateError::input(&frame.image, reason))
}

/// Returns the pixels outside the scene in a frame: the mask of one of our exports, or the frame's one mask, if masks
/// are declared to mark them.
fn ignored(
    source: &Source<'_>,
    frame: &ForeignFrame,
    request: &ImportRequest<'_>,
) -> Result<Option<Mask>, CurateError> {
    if let Some(own) = own_ignore_mask(source, frame) {
        return Ok(Some(read_mask(source, &own, MarkedGreys::AboveHalf)?));
    }
    match request.masks {
        MaskMeaning::Moving => Ok(None),
        MaskMeaning::Ignored if frame.objects.is_empty() => given_mask(source, frame),
        MaskMeaning::Ignored => {
            let mut all: Option<Mask> = None;
            for file in frame.objects.values() {
                all = united(all, Some(read_mask(source, file, MarkedGreys::AboveHalf)?));
            }
            Ok(all)
        }
    }
}

/// Returns the mask of pixels outside the scene in a frame of one of our exports.
fn own_ignore_mask(source: &Source<'_>, frame: &ForeignFrame) -> Option<PathBuf> {
    if let Some(own) = &source.own {
        return own.ignore_mask(frame);
    }
    // Below the folder of the images: faces of cubes lie in folders of their own.
    let below = frame.image.strip_prefix(&source.scene.root).ok();
    let name: PathBuf = below
        .into_iter()
        .flat_map(|path| path.iter().skip(1))
        .collect();
    let own = super::masks::ignore_mask_path(&source.scene.root, &name.to_string_lossy());
    own.is_file().then_some(own)
}

/// Returns the union of two masks.
fn united(one: Option<Mask>, other: Option<Mask>) -> Option<Mask> {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.united(&other)),
        (one, other) => one.or(other),
    }
}

/// Determines the assumptions about the masks of a frame.
fn look_at_masks(
    source: &Source<'_>,
    (frame, meaning): (&ForeignFrame, MaskMeaning),
    masks: &mut MaskSurvey,
) -> Result<(), StoreError> {
    let camera = source.scene.camera.camera();
    if let Some(mask) = &frame.mask {
        let marked = masks.add(&mask.file, &camera, mask.marked_greys())?;
        masks.add_moving_share(mask.moving_share(marked, meaning));
    }
    let own = own_ignore_mask(source, frame);
    for file in frame.objects.values().chain(&own) {
        masks.add(file, &camera, MarkedGreys::AboveHalf)?;
    }
    Ok(())
}

fn given_mask(source: &Source<'_>, frame: &ForeignFrame) -> Result<Option<Mask>, CurateError> {
    let Some(found) = &frame.mask else {
        return Ok(None);
    };
    let mask = read_mask(source, &found.file, found.marked_greys())?;
    Ok(Some(if found.black_is_dynamic {
        mask.inverted()
    } else {
        mask
    }))
}

/// Reads a mask, with the lens undistorted.
fn read_mask(source: &Source<'_>, file: &Path, greys: MarkedGreys) -> Result<Mask, CurateError> {
    let image = ImageFile::open(file)?;
    if image.size() != source.scene.camera.camera().size() {
        return Err(CurateError::input(file, "is not of its image's size"));
    }
    let mask = mask_file::decode(image, greys)?.mask;
    Ok(match &source.straightening {
        Some(lens) => lens.mask(&mask),
        None => mask,
    })
}

/// Returns the moving content of a frame.
fn import_mask(
    source: &Source<'_>,
    (frame, name): (&ForeignFrame, &str),
    (ignored, meaning): (Option<&Mask>, MaskMeaning),
    out: &Path,
) -> Result<Option<String>, CurateError> {
    if meaning == MaskMeaning::Ignored {
        return Ok(None);
    }
    let mask = given_mask(source, frame)?;
    let says_where_to_look = (frame.mask.as_ref()).is_some_and(|found| found.black_is_dynamic);
    if !says_where_to_look {
        return write_mask(mask, SCENE_MASKS_FOLDER, name, out);
    }
    // Masks of pixels to use have both kinds in them, and exist even if nothing is hidden.
    let mask = match ignored {
        Some(ignored) => mask.map(|mask| mask.without(ignored)),
        None => mask,
    };
    let mask = mask.filter(|mask| mask.data.iter().any(|&value| value != 0));
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

/// Copies the masks of a frame's objects; empty ones are left out, unless the scene's record has them.
fn import_objects(
    source: &Source<'_>,
    (frame, name): (&ForeignFrame, &str),
    out: &Path,
) -> Result<BTreeMap<String, String>, CurateError> {
    let mut objects = BTreeMap::new();
    for (object, found) in &frame.objects {
        let mask = read_mask(source, found, MarkedGreys::AboveHalf)?;
        if source.own.is_none() && mask.data.iter().all(|&value| value < 128) {
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
