//! Export of a scene as a folder of frames, with everything in its record.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    layout::{
        CLASSES_FOLDER, DEPTH_FOLDER, DEPTH_PRIOR_FOLDER, IGNORE_MASKS_FOLDER, POINTS_FILE,
        SCENE_FILE,
    },
    records::{DepthImage, DepthPrior, PosedFrame, Poses, Scene, SceneFrame},
    store,
};

use super::{
    IMAGES_FOLDER, MASK_FOLDER, OBJECTS_FOLDER, POSES_FILE, UNPOSED_FOLDER, expect_folder_name,
};
use crate::{
    error::CurateError,
    exchange::{
        ExportScene, SceneSource, create_parent, file_name, masks::copy_ignore_mask,
        own_record::extension, refuse_second, stem, write_split_lists,
    },
};

pub(super) fn export(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    write_split_lists(scene, out)?;
    let has_points = !scene.points.is_empty();
    if has_points {
        scene.points.write_ply(&out.join(POINTS_FILE))?;
    }
    let points = has_points.then(|| POINTS_FILE.to_owned());
    let posed = scene.frames.iter().map(|frame| PosedFrame {
        time_seconds: frame.time_seconds,
        pose: frame.pose,
        mask: None,
    });
    let poses = Poses {
        scale: scene.scale,
        camera: Some(scene.camera),
        frames: posed.collect(),
        points: points.clone(),
    };
    store::write_record(&out.join(POSES_FILE), &poses)?;
    match &scene.source {
        Some(source) => write_all(source, points, out),
        None => write_frames(scene, out),
    }
}

/// Writes the record of a scene and every file that it names.
fn write_all(source: &SceneSource, points: Option<String>, out: &Path) -> Result<(), CurateError> {
    let files = Files {
        from: &source.folder,
        out,
    };
    let frames = source.record.frames.iter();
    let frames = frames.map(|frame| files.copied(frame));
    let record = Scene {
        frames: frames.collect::<Result<_, CurateError>>()?,
        points,
        ..source.record.clone()
    };
    Ok(store::write_record(&out.join(SCENE_FILE), &record)?)
}

/// Writes redrawn images and their masks.
fn write_frames(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    let place = |file: String| -> Result<PathBuf, CurateError> {
        let path = out.join(file);
        refuse_second(&path)?;
        create_parent(&path)?;
        Ok(path)
    };
    for frame in &scene.frames {
        let name = &frame.name;
        store::copy_atomically(&frame.image, &place(format!("{IMAGES_FOLDER}/{name}"))?)?;
        if let Some(mask) = &frame.mask {
            store::copy_atomically(mask, &place(format!("{MASK_FOLDER}/{}.png", stem(name)))?)?;
        }
        copy_ignore_mask(frame, name, out)?;
    }
    Ok(())
}

/// Files of a scene on their way to an export.
struct Files<'a> {
    from: &'a Path,
    out: &'a Path,
}

impl Files<'_> {
    /// Copies a file to its place in the export; returns that place.
    fn copy(&self, file: &str, to: String) -> Result<String, CurateError> {
        let path = self.out.join(&to);
        refuse_second(&path)?;
        create_parent(&path)?;
        store::copy_atomically(&self.from.join(file), &path)?;
        Ok(to)
    }

    /// Copies all files of a frame; returns the frame as the export has it.
    fn copied(&self, frame: &SceneFrame) -> Result<SceneFrame, CurateError> {
        let name = file_name(&frame.image);
        let stem = stem(&name);
        let is_posed = frame.pose.as_ref().is_some_and(Pose::is_valid);
        let images = if is_posed {
            IMAGES_FOLDER
        } else {
            UNPOSED_FOLDER
        };
        let mask = |file: Option<&String>, folder: &str| {
            file.map(|file| self.copy(file, format!("{folder}/{stem}.png")))
                .transpose()
        };
        Ok(SceneFrame {
            image: self.copy(&frame.image, format!("{images}/{name}"))?,
            mask: mask(frame.mask.as_ref(), MASK_FOLDER)?,
            ignore_mask: mask(frame.ignore_mask.as_ref(), IGNORE_MASKS_FOLDER)?,
            classes: self.masks(&frame.classes, CLASSES_FOLDER, stem)?,
            objects: self.masks(&frame.objects, OBJECTS_FOLDER, stem)?,
            depth: match &frame.depth {
                Some(depth) => Some(DepthImage {
                    file: self.distances(&depth.file, DEPTH_FOLDER, stem)?,
                    ..depth.clone()
                }),
                None => None,
            },
            depth_prior: match &frame.depth_prior {
                Some(prior) => Some(DepthPrior {
                    file: self.distances(&prior.file, DEPTH_PRIOR_FOLDER, stem)?,
                    ..prior.clone()
                }),
                None => None,
            },
            ..frame.clone()
        })
    }

    /// Copies the masks of objects or classes, by their names.
    fn masks(
        &self,
        masks: &BTreeMap<String, String>,
        folder: &str,
        stem: &str,
    ) -> Result<BTreeMap<String, String>, CurateError> {
        let mut copies = BTreeMap::new();
        for (name, file) in masks {
            expect_folder_name(self.from, name)?;
            let copy = self.copy(file, format!("{folder}/{name}/{stem}.png"))?;
            copies.insert(name.clone(), copy);
        }
        Ok(copies)
    }

    /// Copies distances, in a PNG or an array.
    fn distances(&self, file: &str, folder: &str, stem: &str) -> Result<String, CurateError> {
        self.copy(file, format!("{folder}/{stem}.{}", extension(file)))
    }
}
