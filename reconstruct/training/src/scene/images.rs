//! Images and masks of a scene's frames, at a method's size.

use std::{collections::BTreeMap, path::Path};

use omnilife_engine::{camera::View, training_view::TrainingView};
use omnilife_schemas::{
    RgbImage, Similarity,
    camera::Camera,
    image_file::ImageFile,
    object_regions::{self, Region},
    records::Scene,
    rgb::Mask,
};

use crate::error::ReconstructError;

pub(super) fn load_view(
    scene: &Scene,
    scene_path: &Path,
    folder: &Path,
    camera: Camera,
    normalization: &Similarity,
    frame: u32,
) -> Result<TrainingView, ReconstructError> {
    let entry = scene.frames.get(frame as usize).ok_or_else(|| {
        ReconstructError::scene(scene_path, format!("has no frame {frame} of the split"))
    })?;
    let view = entry
        .pose
        .and_then(|pose| View::new(camera, &pose, normalization, entry.time_seconds))
        .ok_or_else(|| {
            ReconstructError::scene(
                scene_path,
                format!("frame {frame} of the split has no usable pose"),
            )
        })?;
    let image = read_image(&folder.join(&entry.image), scene, camera)?;
    let expected = scene.camera.size();
    let read = |file: &str| read_mask(&folder.join(file), expected);
    let mask = Region::Moving
        .source(scene, entry)
        .map(|source| source.mask(&scene.camera, expected, read))
        .transpose()?
        .map(|mask| averaged(&mask, camera));
    let ignored = entry
        .ignore_mask
        .as_ref()
        .map(|mask| load_ignore_mask(&folder.join(mask), expected, camera))
        .transpose()?;
    Ok(TrainingView {
        frame,
        view,
        pixels: image.to_rgb8(),
        mask: mask.map(|mask| without(mask, ignored.as_deref())),
        ignored,
    })
}

/// Loads the masks of single objects in some frames.
pub(super) fn load_objects(
    scene: &Scene,
    folder: &Path,
    camera: Camera,
    views: &[TrainingView],
) -> Result<BTreeMap<String, BTreeMap<u32, Vec<u8>>>, ReconstructError> {
    let mut objects: BTreeMap<String, BTreeMap<u32, Vec<u8>>> = BTreeMap::new();
    for TrainingView { frame, ignored, .. } in views {
        let frame = *frame;
        let expected = scene.camera.size();
        let entry = scene.frames.get(frame as usize);
        for (name, shape) in entry.map(object_regions::shapes).unwrap_or_default() {
            let read = |file: &str| read_mask(&folder.join(file), expected);
            let mask = shape.mask(&scene.camera, expected, read)?;
            let mask = without(averaged(&mask, camera), ignored.as_deref());
            let of_object = objects.entry(name.to_owned()).or_default();
            of_object.insert(frame, mask);
        }
    }
    Ok(objects)
}

/// Reads a frame's image and resizes it to `camera` by area averaging.
///
/// # Errors
/// When the file is unreadable or not of the size of the scene's camera.
pub fn read_image(
    path: &Path,
    scene: &Scene,
    camera: Camera,
) -> Result<RgbImage, ReconstructError> {
    let file = ImageFile::open(path)?;
    let [width, height] = file.size();
    let expected = scene.camera.size();
    if [width, height] != expected {
        return Err(ReconstructError::scene(
            path,
            format!(
                "is {width}x{height}, the scene's camera is {}x{}",
                expected[0], expected[1]
            ),
        ));
    }
    let image = RgbImage::decode(file)?;
    Ok(image.resized_by_area(camera.width() as usize, camera.height() as usize))
}

/// Returns a mask of the scene's images at the size of `camera`, by area averaging.
fn averaged(mask: &Mask, camera: Camera) -> Vec<u8> {
    let grey: Vec<u8> = mask.data.iter().flat_map(|&value| [value; 3]).collect();
    let resized = RgbImage::from_rgb8(mask.width, mask.height, &grey)
        .resized_by_area(camera.width() as usize, camera.height() as usize);
    resized.to_rgb8().into_iter().step_by(3).collect()
}

/// Loads the ignored region of the scene's images, `expected` wide and high, at the size of `camera`: every pixel
/// that overlaps a marked one.
fn load_ignore_mask(
    path: &Path,
    expected: [usize; 2],
    camera: Camera,
) -> Result<Vec<u8>, ReconstructError> {
    let mask = read_mask(path, expected)?;
    let [width, height] = camera.size();
    let ignored = mask.resized_to_any(width, height).data;
    if ignored.iter().all(|&mark| mark != 0) {
        let reason = "leaves nothing of its frame to learn from";
        return Err(ReconstructError::scene(path, reason));
    }
    Ok(ignored)
}

fn read_mask(path: &Path, [width, height]: [usize; 2]) -> Result<Mask, ReconstructError> {
    let file = ImageFile::open(path)?;
    let [found_width, found_height] = file.size();
    if [found_width, found_height] == [width, height] {
        return Ok(Mask::decode(file)?);
    }
    Err(ReconstructError::scene(
        path,
        format!("is {found_width}x{found_height}, the images that it masks are {width}x{height}"),
    ))
}

/// Removes the ignored region from a dynamic mask, or from an object's.
fn without(mut mask: Vec<u8>, ignored: Option<&[u8]>) -> Vec<u8> {
    let marks = ignored.unwrap_or_default();
    for (value, _) in mask.iter_mut().zip(marks).filter(|(_, mark)| **mark != 0) {
        *value = 0;
    }
    mask
}
