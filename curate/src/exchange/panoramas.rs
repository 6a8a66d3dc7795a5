//! Still panoramas without poses: a folder of equirectangular images from cameras and phones.
//!
//! Times are those of the EXIF data, if all images have them; a part of a sphere is put at the place in its GPano
//! metadata. Poses are attached later.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::camera::{Camera, ErpCamera};

use super::{ForeignFrame, ForeignScene, Format};
use crate::{error::CurateError, stills::Stills};

pub(super) const FORMAT: Format = Format {
    id: "panoramas",
    about: "still panoramas without poses, with the times, places and crops of their EXIF and GPano metadata",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let found = Stills::read(folder)?;
    let [width, height] = found.stills[0].size;
    let camera: Camera = ErpCamera { width, height }.into();
    let frames = found.stills.iter().map(|still| ForeignFrame {
        image: still.path.clone(),
        mask: None,
        objects: BTreeMap::new(),
        pose: None,
        distance: None,
        moment: None,
    });
    let frames = frames.collect();
    let times = found.times.iter().copied();
    let stills = found.stills.into_iter().zip(times);
    Ok(ForeignScene {
        stills: stills
            .map(|(still, time)| (still.path.clone(), (still, time)))
            .collect(),
        stills_note: found.times_note,
        notes: found.notes,
        ..ForeignScene::new(camera.into(), frames, folder)
    })
}
