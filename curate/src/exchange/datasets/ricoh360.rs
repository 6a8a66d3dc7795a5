//! `Ricoh360`: outdoor panoramas by a camera on a pole, of `EgoNeRF`
//! (`dataLoader/dataset_egocentric_video.py` and `ColmapPoseDescriptor` in `dataLoader/pose_descriptor.py` of
//! `changwoonchoi/EgoNeRF`).
//!
//! ```text
//! imgs/                              the panoramas, PNG (mask.png is not a panorama)
//! output_dir/colmap/images.txt       poses as COLMAP has them, world to camera
//! output_dir/colmap/points3D.txt     world points
//! train.txt, test.txt                names of images without their extension
//! ```
//!
//! Axes: the loader turns cameras by `rays2cam`, from those of COLMAP (x right, y down, z forward), which are ours, to
//! those of its rays. It also scales all centres to a mean distance of 1 from their middle. Here poses are taken as
//! `images.txt` has them. The image of an entry is the PNG of its name up to the first point. `cameras.txt` is ignored:
//! the images are panoramas.

use std::path::Path;

use omnilife_schemas::points::PointCloud;

use super::{folders_not_read, panorama_camera, plain_frame};
use crate::{
    error::CurateError,
    exchange::{ForeignScene, ForeignSplit, Format, FrameRate, image_of},
    poses::colmap,
};

/// The format.
pub const FORMAT: Format = Format {
    id: "ricoh360",
    about: "a scene of Ricoh360 (EgoNeRF): imgs/, output_dir/colmap/images.txt, train.txt and test.txt",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const IMAGES_FOLDER: &str = "imgs";
const MODEL_FOLDER: &str = "output_dir";

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let model = folder.join(MODEL_FOLDER).join("colmap");
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    for image in colmap::text_images(&model.join("images.txt"))? {
        let stem = (image.name.split_once('.')).map_or(image.name.as_str(), |(stem, _)| stem);
        let name = format!("{IMAGES_FOLDER}/{stem}.png");
        match image_of(folder, &name)? {
            Some(file) => frames.push(plain_frame(file, image.pose(), None)),
            None => missing_images.push(name),
        }
    }
    let mut notes: Vec<String> = (folders_not_read(folder, &[IMAGES_FOLDER, MODEL_FOLDER])?)
        .into_iter()
        .collect();
    let lists: [&Path; 2] = [&folder.join("train.txt"), &folder.join("test.txt")];
    let published_split = ForeignSplit::from_lists("Ricoh360", lists, &mut notes)?;
    let points = model.join("points3D.txt");
    let camera = panorama_camera(folder, &frames, &missing_images)?;
    Ok(ForeignScene {
        points: if points.is_file() {
            colmap::text_points(&points)?
        } else {
            PointCloud::default()
        },
        image_folders: vec![folder.join(IMAGES_FOLDER)],
        missing_images,
        published_split,
        frame_rate: Some(FrameRate::STATIC),
        notes,
        ..ForeignScene::new(camera, frames, folder)
    })
}
