//! Import of a folder of frames with the record of its scene, as exports write it: all of the scene is restored.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    layout::{CLASSES_FOLDER, DEPTH_FOLDER, DEPTH_PRIOR_FOLDER, IGNORE_MASKS_FOLDER, SCENE_FILE},
    points::PointCloud,
    records::{PosedFrame, Poses, PublishedSplit, Scene, SceneFrame},
    store::{self, StoreError},
};

use super::{MASK_FOLDER, OBJECTS_FOLDER, POSES_FILE, expect_folder_name};
use crate::{
    error::CurateError,
    exchange::{
        ForeignFrame, ForeignMask, ForeignScene, ForeignSplit, file_name, file_of, image_of,
        left_out::folders_below,
        times::{TIMES_FILE, TimeTable},
    },
};

/// Folders whose files belong to frames by the record alone.
const FOLDERS_OF_FRAMES: [&str; 6] = [
    MASK_FOLDER,
    OBJECTS_FOLDER,
    IGNORE_MASKS_FOLDER,
    CLASSES_FOLDER,
    DEPTH_FOLDER,
    DEPTH_PRIOR_FOLDER,
];

/// Reads a folder of frames by its record.
///
/// # Errors
/// When a file is missing, malformed or outside the folder, or another file contradicts the record.
pub(super) fn import(folder: &Path, record: &Scene) -> Result<ForeignScene, CurateError> {
    if record.frames.is_empty() {
        return Err(StoreError::malformed(&folder.join(SCENE_FILE), "has no frames").into());
    }
    expect_agreement(folder, record)?;
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    for frame in &record.frames {
        match image_of(folder, &frame.image)? {
            Some(image) => frames.push(foreign_frame(folder, frame, image)?),
            None => missing_images.push(frame.image.clone()),
        }
    }
    Ok(ForeignScene {
        scale: record.scale,
        points: match &record.points {
            Some(file) => PointCloud::read_ply(&file_of(folder, file)?)?,
            None => PointCloud::default(),
        },
        pose_source: Some(record.pose_source.clone()),
        missing_images,
        objects: record.objects.clone(),
        published_split: match &record.published_split {
            Some(split) => Some(named_split(folder, record, split)?),
            None => None,
        },
        ..ForeignScene::new(record.camera.into(), frames, folder)
    })
}

fn foreign_frame(
    folder: &Path,
    frame: &SceneFrame,
    image: PathBuf,
) -> Result<ForeignFrame, CurateError> {
    for name in frame.objects.keys().chain(frame.classes.keys()) {
        expect_folder_name(folder, name)?;
    }
    let unsound = frame.boxes.iter().find(|(_, sides)| !is_box(**sides));
    if let Some((name, _)) = unsound {
        let reason = format!("{} has no sound box of {name:?}", frame.image);
        return Err(StoreError::malformed(&folder.join(SCENE_FILE), reason).into());
    }
    for file in frame.files() {
        file_of(folder, file)?;
    }
    let objects = frame.objects.iter();
    let objects = objects.map(|(object, file)| (object.clone(), folder.join(file)));
    Ok(ForeignFrame {
        image,
        mask: frame.mask.as_ref().map(|mask| ForeignMask {
            file: folder.join(mask),
            black_is_dynamic: false,
        }),
        objects: objects.collect(),
        pose: frame.pose.filter(Pose::is_valid),
        // It is copied as it is.
        distance: None,
        moment: None,
    })
}

/// Returns true for a box with an area: left, top, width and height.
fn is_box([left, top, width, height]: [f64; 4]) -> bool {
    let is_finite = [left, top, width, height]
        .iter()
        .all(|side| side.is_finite());
    is_finite && width > 0.0 && height > 0.0
}

fn named_split(
    folder: &Path,
    record: &Scene,
    split: &PublishedSplit,
) -> Result<ForeignSplit, CurateError> {
    let names = |views: &[u32]| -> Result<Vec<String>, CurateError> {
        let name = |view: &u32| -> Result<String, CurateError> {
            let frame = record.frames.get(*view as usize).ok_or_else(|| {
                let reason = format!("its published split has frame {view}, which is not there");
                StoreError::malformed(&folder.join(SCENE_FILE), reason)
            })?;
            Ok(frame.image.clone())
        };
        views.iter().map(name).collect()
    };
    Ok(ForeignSplit {
        source: split.source.clone(),
        input: names(&split.input_views)?,
        novel: names(&split.novel_views)?,
    })
}

/// Refuses poses, times, masks and distances beside the record that differ from it: one of the two is outdated, and it
/// is unknown which.
fn expect_agreement(folder: &Path, record: &Scene) -> Result<(), CurateError> {
    let refuse = |path: &Path, what: String| {
        let reason =
            format!("{what}, other than {SCENE_FILE} beside it: remove the one that is outdated");
        Err(CurateError::input(path, reason))
    };
    let poses = folder.join(POSES_FILE);
    if poses.is_file() {
        let given: Poses = store::read_record(&poses)?;
        let is_same = |(frame, found): (&SceneFrame, &PosedFrame)| {
            frame.pose == Some(found.pose) && frame.time_seconds == found.time_seconds
        };
        let posed = record.frames.iter();
        let posed = posed.filter(|frame| frame.pose.as_ref().is_some_and(Pose::is_valid));
        let posed: Vec<&SceneFrame> = posed.collect();
        let agrees = posed.len() == given.frames.len()
            && posed.into_iter().zip(&given.frames).all(is_same)
            && given.camera.is_none_or(|camera| camera == record.camera)
            && given.scale == record.scale;
        if !agrees {
            return refuse(&poses, "has poses, times, a camera or a scale".to_owned());
        }
    }
    if let Some(table) = TimeTable::read(folder)? {
        for frame in &record.frames {
            let name = file_name(&frame.image);
            if let Some(seconds) = table.seconds_of(&name)
                && seconds != frame.time_seconds
            {
                return refuse(
                    folder,
                    format!("has {seconds} s for {name} in {TIMES_FILE}"),
                );
            }
        }
    }
    expect_named_files(folder, record)
}

/// Refuses files of frames that the record does not name, which would be left out.
fn expect_named_files(folder: &Path, record: &Scene) -> Result<(), CurateError> {
    let named: BTreeSet<PathBuf> = (record.frames.iter().flat_map(SceneFrame::files))
        .map(|file| folder.join(file))
        .collect();
    for name in FOLDERS_OF_FRAMES {
        let below = folder.join(name);
        if !below.is_dir() {
            continue;
        }
        for inner in folders_below(&below)? {
            let mut files = store::paths_in(&inner)?.into_iter();
            if let Some(file) = files.find(|path| !path.is_dir() && !named.contains(path)) {
                let reason = format!("is not named in {SCENE_FILE}: name it there, or remove it");
                return Err(CurateError::input(&file, reason));
            }
        }
    }
    Ok(())
}
