//! Ground truth: the scene's images, masks and depth at the scored size.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    RgbImage,
    distances::DistanceImage,
    image_file::ImageFile,
    mask_file::MarkedGreys,
    mask_survey::MaskSurvey,
    object_regions::{self, Region},
    records::{DepthImage, SceneFrame},
    rgb::{self, Mask},
    store::StoreError,
};

use crate::{
    error::BenchError,
    job::{ScoringJob, View},
    metrics::{Need, ViewPair},
};

/// Returns bytes of a frame's ground truth at the scored size, resized by area averaging if the protocol requires it
/// and rounded to 8 bits, as predictions are.
///
/// # Errors
/// When the image is unusable, transparent in places, to be turned or not of the size that the scene states.
pub(crate) fn read(job: &ScoringJob, frame: u32) -> Result<Vec<u8>, BenchError> {
    let file = job.scene_file(&job.scene.frames[frame as usize].image);
    let image = ImageFile::open(&file)?;
    check_size(job, &file, image.size())?;
    let image = RgbImage::decode(image)?;
    let [width, height] = job.size;
    Ok(image
        .resized_by_area(width as usize, height as usize)
        .to_rgb8())
}

/// Returns a mask of a scene at the scored size, by nearest pixels.
///
/// # Errors
/// Those of [`read`].
pub(crate) fn read_mask(job: &ScoringJob, name: &str) -> Result<Mask, BenchError> {
    let file = job.scene_file(name);
    let mask = ImageFile::open(&file)?;
    check_size(job, &file, mask.size())?;
    let mask = Mask::decode(mask)?;
    let [width, height] = job.size;
    Ok(mask.resized_to_nearest(width as usize, height as usize))
}

/// Returns the mask of moving content in a frame, at the scored size, if it is needed and exists: the scene's own, or
/// else that of the tracks beside the split.
///
/// # Errors
/// Those of [`read`].
pub(crate) fn read_dynamic_mask(job: &ScoringJob, frame: u32) -> Result<Option<Mask>, BenchError> {
    if !job.needs(Need::DynamicMask) {
        return Ok(None);
    }
    let frame = &job.scene.frames[frame as usize];
    if let Some(mask) = read_region(job, frame, Region::Moving)? {
        return Ok(Some(mask));
    }
    let [width, height] = job.size;
    let camera = job.scene.camera.resized(width, height);
    let regions = job.regions.as_ref();
    Ok(regions.and_then(|regions| regions.mask(&camera, frame)))
}

/// Returns the mask of a region at the scored size: the scene's own, or the union of objects; `None` without both.
///
/// # Errors
/// Those of [`read`].
pub(crate) fn read_region(
    job: &ScoringJob,
    frame: &SceneFrame,
    region: Region<'_>,
) -> Result<Option<Mask>, BenchError> {
    let Some(source) = region.source(&job.scene, frame) else {
        return Ok(None);
    };
    let size = job.size.map(|side| side as usize);
    let read = |name: &str| read_mask(job, name);
    source.mask(&job.scene.camera, size, read).map(Some)
}

/// Returns the masks of the objects in a frame, by their names and at the scored size.
///
/// # Errors
/// Those of [`read`].
pub(crate) fn read_objects(
    job: &ScoringJob,
    frame: &SceneFrame,
) -> Result<BTreeMap<String, Mask>, BenchError> {
    let size = job.size.map(|side| side as usize);
    let shapes = object_regions::shapes(frame).into_iter();
    shapes
        .map(|(name, shape)| {
            let read = |file: &str| read_mask(job, file);
            let mask = shape.mask(&job.scene.camera, size, read)?;
            Ok((name.to_owned(), mask))
        })
        .collect()
}

/// Returns the excluded pixels of a frame, at the scored size: every pixel that covers a marked one.
///
/// # Errors
/// Those of [`read`], and when nothing of the frame would count.
pub(crate) fn read_ignore_mask(job: &ScoringJob, frame: u32) -> Result<Option<Mask>, BenchError> {
    let Some(name) = &job.scene.frames[frame as usize].ignore_mask else {
        return Ok(None);
    };
    let file = job.scene_file(name);
    let mask = ImageFile::open(&file)?;
    check_size(job, &file, mask.size())?;
    let [width, height] = job.size;
    let mask = Mask::decode(mask)?.resized_to_any(width as usize, height as usize);
    if mask.data.iter().all(|&value| value != 0) {
        let reason = format!("leaves nothing of frame {frame} to score");
        return Err(StoreError::malformed(&file, reason).into());
    }
    Ok(Some(mask))
}

/// Returns lines on assumptions about the masks used for scores of these views, and on ignore masks that look inverted.
///
/// # Errors
/// When a mask cannot be read.
pub(crate) fn mask_notes(job: &ScoringJob, views: &[View]) -> Result<Vec<String>, BenchError> {
    let mut survey = MaskSurvey::default();
    let camera = &job.scene.camera;
    for view in views {
        let frame = &job.scene.frames[view.frame as usize];
        let regions = job.regions_of_metrics().into_iter();
        let sources = regions.filter_map(|region| region.source(&job.scene, frame));
        let objects = frame.objects.values().map(String::as_str);
        let objects = objects.filter(|_| job.needs(Need::ObjectMasks));
        let of_regions = sources.flat_map(|source| source.files());
        // An object may be part of several regions.
        let files: BTreeSet<&str> = of_regions.chain(objects).collect();
        for &name in &files {
            survey.add(&job.scene_file(name), camera, MarkedGreys::AboveHalf)?;
        }
        if let Some(name) = frame.mask.as_ref().filter(|name| files.contains(&***name)) {
            survey.add_moving(&job.scene_file(name), camera)?;
        }
        for (class, name) in frame
            .classes
            .iter()
            .filter(|(_, name)| files.contains(&***name))
        {
            survey.add_of_class(class, &job.scene_file(name), camera)?;
        }
        if let Some(name) = &frame.ignore_mask {
            survey.add_ignored(&job.scene_file(name), camera)?;
        }
    }
    Ok(survey.notes())
}

/// Returns the pair of a prediction (8-bit RGB) and the ground truth of a frame, without excluded pixels.
pub(crate) fn pair(
    job: &ScoringJob,
    prediction: Vec<u8>,
    truth: Vec<u8>,
    ignored: Option<&Mask>,
) -> Option<ViewPair> {
    let [width, height] = job.size.map(|side| side as usize);
    let pair = ViewPair::new(width, height, prediction, truth)?;
    match ignored {
        Some(mask) => pair.ignoring(mask),
        None => Some(pair),
    }
}

/// Returns distances along the rays at the scored size, in units of the world frame, by nearest pixels (a mean over an
/// edge would be the distance of nothing); 0 if unknown.
///
/// # Errors
/// Those of [`read`], and when the file is neither 16-bit grey nor an array of distances or its unit is not positive.
pub(crate) fn read_depth(job: &ScoringJob, depth: &DepthImage) -> Result<Vec<f32>, BenchError> {
    let file = job.scene_file(&depth.file);
    if !(depth.unit.is_finite() && depth.unit > 0.0) {
        let reason = format!("has the unit {}, not a positive one", depth.unit);
        return Err(StoreError::malformed(&file, reason).into());
    }
    let image = DistanceImage::read_if_any(&file, depth.unit, false)?;
    let size = [image.width, image.height];
    check_size(job, &file, size)?;
    let nearest = rgb::nearest_pixels(size, job.size.map(|side| side as usize));
    Ok(nearest.map(|index| image.values[index]).collect())
}

/// Checks the size of a frame's file, which must be that of the scene's camera.
fn check_size(
    job: &ScoringJob,
    file: &Path,
    [width, height]: [usize; 2],
) -> Result<(), BenchError> {
    let expected = job.scene.camera.size();
    if [width, height] == expected {
        return Ok(());
    }
    let (scene, [expected_width, expected_height]) = (&job.scene.id, expected);
    Err(BenchError::mismatch(
        file,
        format!(
            "is {width}x{height} pixels, scene {scene} says {expected_width}x{expected_height}"
        ),
    ))
}
