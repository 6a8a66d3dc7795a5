//! OpenMVG's `sfm_data`, split into views and extrinsics as ODGS and its successors read it.
//!
//! ```text
//! data_views.json        views and the spherical or pinhole intrinsic, as OpenMVG itself writes it
//! data_extrinsics.json   per pose: rotation (world to camera, row by row) and camera centre
//! images/                the frames
//! images/<stem>_mask.png black where something moves (OpenMVG's convention)
//! train.txt, test.txt    stems of the frames for training and for testing, one per line
//! pcd.ply                world points with (zero) normals, which their reader requires
//! ```
//!
//! A folder with OpenMVG's own `sfm_data.json`, which holds views and extrinsics, is read too. Without `pcd.ply` the
//! points are those of `colorized.ply`, as in ODGS (`scene_perspective/dataset_readers.py` of `esw0116/ODGS`).
//!
//! Axes: OpenMVG's spherical camera has x right, y down and z forward, and its image is ours
//! (`src/openMVG/cameras/Camera_Spherical.hpp`): nothing is turned. `x_c = R (x_w - C)`.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod lists;
mod records;

use std::{collections::BTreeMap, io::Write, path::Path};

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera},
    points::{Coordinates, PointCloud},
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use super::{
    ExportScene, ForeignFrame, ForeignScene, Format, FramePixels, Part, Writer, left_out,
    masks::black_mask, stem,
};
use crate::{error::CurateError, poses::frame_camera::FrameCamera};

/// The format.
pub const FORMAT: Format = Format {
    id: "openmvg",
    about: "OpenMVG views and extrinsics, as ODGS reads them; a pinhole has one focal length",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: export,
        holds: &[Part::Points, Part::Names],
    }),
    import,
};

const VIEWS_FILE: &str = "data_views.json";
const EXTRINSICS_FILE: &str = "data_extrinsics.json";
/// Views and extrinsics in one.
const WHOLE_FILE: &str = "sfm_data.json";
const POINTS_FILE: &str = "pcd.ply";
/// OpenMVG's own points.
const COLOURED_POINTS_FILE: &str = "colorized.ply";
/// Names of intrinsics.
const SPHERICAL: &str = "spherical";
const PINHOLE: &str = "pinhole";
/// cereal marks the first object of a polymorphic type with the highest bit.
const FIRST_OF_ITS_KIND: u32 = 1 << 31;
/// OpenMVG's key of a missing part of a view.
const UNDEFINED: u32 = u32::MAX;
/// cereal's mark for an object of the static type.
const STATIC_TYPE: u32 = 1 << 30;

/// `sfm_data.json` as it is written.
#[derive(Serialize)]
struct SfmData {
    sfm_data_version: String,
    root_path: String,
    views: Vec<KeyedEntry<Polymorphic<View>>>,
    intrinsics: Vec<KeyedEntry<NamedPolymorphic<Intrinsic>>>,
    extrinsics: Vec<KeyedEntry<Extrinsic>>,
    structure: Vec<serde_json::Value>,
    control_points: Vec<serde_json::Value>,
}

#[derive(Serialize, Deserialize)]
struct KeyedEntry<T> {
    key: u32,
    value: T,
}

#[derive(Serialize)]
struct Polymorphic<T> {
    polymorphic_id: u32,
    ptr_wrapper: Pointer<T>,
}

#[derive(Serialize)]
struct NamedPolymorphic<T> {
    polymorphic_id: u32,
    polymorphic_name: String,
    ptr_wrapper: Pointer<T>,
}

#[derive(Serialize)]
struct Pointer<T> {
    id: u32,
    data: T,
}

#[derive(Serialize, Deserialize)]
struct View {
    local_path: String,
    filename: String,
    width: u32,
    height: u32,
    id_view: u32,
    id_intrinsic: u32,
    id_pose: u32,
}

/// Intrinsic as serialized by cereal: a spherical one inside of its base class, a pinhole flat.
#[derive(Serialize)]
#[serde(untagged)]
enum Intrinsic {
    Spherical {
        value0: Size,
    },
    Pinhole {
        width: u32,
        height: u32,
        /// Pixels.
        focal_length: f64,
        principal_point: [f64; 2],
    },
}

#[derive(Serialize)]
struct Size {
    width: u32,
    height: u32,
}

#[derive(Serialize, Deserialize)]
struct Extrinsic {
    rotation: [[f64; 3]; 3],
    center: [f64; 3],
}

impl SfmData {
    fn empty() -> Self {
        Self {
            sfm_data_version: "0.3".to_owned(),
            root_path: "images".to_owned(),
            views: Vec::new(),
            intrinsics: Vec::new(),
            extrinsics: Vec::new(),
            structure: Vec::new(),
            control_points: Vec::new(),
        }
    }
}

#[expect(
    clippy::arithmetic_side_effects,
    reason = "numbers of frames that are there"
)]
fn export(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    let images = out.join("images");
    super::copy_images(scene, out)?;
    super::masks::write_black_masks(scene, &images, mask_name)?;
    let mut views = SfmData::empty();
    let mut extrinsics = SfmData::empty();
    for (key, frame) in (0..).zip(&scene.frames) {
        views.views.push(KeyedEntry {
            key,
            value: Polymorphic {
                polymorphic_id: STATIC_TYPE,
                ptr_wrapper: Pointer {
                    id: FIRST_OF_ITS_KIND + key + 1,
                    data: View {
                        local_path: String::new(),
                        filename: frame.name.clone(),
                        width: scene.camera.width(),
                        height: scene.camera.height(),
                        id_view: key,
                        id_intrinsic: 0,
                        id_pose: key,
                    },
                },
            },
        });
        // Valid poses have a rotation: frames were selected by that.
        let camera_to_world = DMat3::from_quat(frame.pose.rotation().unwrap_or_default());
        // Columns of camera-to-world are the rows of world-to-camera.
        extrinsics.extrinsics.push(KeyedEntry {
            key,
            value: Extrinsic {
                rotation: camera_to_world.to_cols_array_2d(),
                center: frame.pose.centre,
            },
        });
    }
    views.intrinsics.push(KeyedEntry {
        key: 0,
        value: NamedPolymorphic {
            polymorphic_id: FIRST_OF_ITS_KIND + 1,
            polymorphic_name: match scene.camera {
                Camera::Erp(_) => SPHERICAL,
                Camera::Pinhole(_) => PINHOLE,
            }
            .to_owned(),
            ptr_wrapper: Pointer {
                id: FIRST_OF_ITS_KIND + scene.frames.len() as u32 + 1,
                data: intrinsic(&scene.camera).map_err(|reason| CurateError::input(out, reason))?,
            },
        },
    });
    super::write_json(&out.join(VIEWS_FILE), &views)?;
    super::write_json(&out.join(EXTRINSICS_FILE), &extrinsics)?;
    for (file, inputs) in lists::FILES.into_iter().zip([true, false]) {
        let names: String = scene
            .frames
            .iter()
            .filter(|frame| frame.is_input == inputs)
            .map(|frame| format!("{}\n", stem(&frame.name)))
            .collect();
        store::write_bytes(&out.join(file), names.as_bytes())?;
    }
    Ok(write_points(&out.join(POINTS_FILE), &scene.points)?)
}

/// # Errors
/// For a pinhole whose focal lengths differ.
fn intrinsic(camera: &Camera) -> Result<Intrinsic, String> {
    let (width, height) = (camera.width(), camera.height());
    match camera {
        Camera::Erp(_) => Ok(Intrinsic::Spherical {
            value0: Size { width, height },
        }),
        Camera::Pinhole(camera) if camera.fx == camera.fy => Ok(Intrinsic::Pinhole {
            width,
            height,
            focal_length: camera.fx,
            principal_point: [camera.cx, camera.cy],
        }),
        Camera::Pinhole(camera) => Err(format!(
            "a pinhole of OpenMVG has one focal length, the scene's has {} and {} pixels",
            camera.fx, camera.fy
        )),
    }
}

fn mask_name(image: &str) -> String {
    format!("{}_mask.png", stem(image))
}

/// Writes a PLY with the columns that 3DGS's reader requires.
fn write_points(path: &Path, cloud: &PointCloud) -> Result<(), StoreError> {
    let coordinates = Coordinates::of(&cloud.positions);
    store::write_with(path, |writer| {
        let places = ["x", "y", "z"].map(|name| (coordinates.ply_type(), name));
        let normals = ["nx", "ny", "nz"].map(|name| ("float", name));
        let columns: String = [places, normals]
            .as_flattened()
            .iter()
            .map(|(kind, name)| format!("property {kind} {name}\n"))
            .collect();
        write!(
            writer,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{columns}\
             property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
            cloud.len()
        )?;
        for (position, colour) in cloud.positions.iter().zip(&cloud.colours) {
            coordinates.write(writer, position)?;
            Coordinates::Float.write(writer, &[0.0; 3])?;
            writer.write_all(colour)?;
        }
        Ok(())
    })
}

/// Returns the camera of all views. Intrinsics that no view uses do not count.
///
/// # Errors
/// When views differ in their size or camera, or their camera cannot be read, with the reason.
fn common_camera(data: &records::SfmData) -> Result<FrameCamera, String> {
    let cameras = records::cameras(data);
    let mut common: Option<(FrameCamera, &str)> = None;
    let views = data.views.iter().map(|view| view.value.data());
    for view in views.filter(|view| cameras.is_empty() || view.id_intrinsic != UNDEFINED) {
        let camera = if cameras.is_empty() {
            // ODGS reads the views alone, and all of them as spherical.
            Camera::Erp(ErpCamera {
                width: view.width,
                height: view.height,
            })
            .into()
        } else {
            let camera = cameras.get(&view.id_intrinsic).ok_or_else(|| {
                format!(
                    "has no intrinsic {} of {}",
                    view.id_intrinsic, view.filename
                )
            })?;
            camera.clone()?.resized(view.width, view.height)
        };
        let (first, name) = *common.get_or_insert((camera, view.filename.as_str()));
        if first != camera {
            return Err(format!(
                "the cameras of {name} and {} differ; a scene has one camera",
                view.filename
            ));
        }
    }
    Ok(common.ok_or("has no views")?.0)
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let whole = folder.join(WHOLE_FILE);
    let is_whole = whole.is_file() && !folder.join(VIEWS_FILE).is_file();
    let [views_path, extrinsics_path] = if is_whole {
        [whole.clone(), whole]
    } else {
        [VIEWS_FILE, EXTRINSICS_FILE].map(|name| folder.join(name))
    };
    let views: records::SfmData = super::read_json(&views_path)?;
    let extrinsics: records::SfmData = super::read_json(&extrinsics_path)?;
    let mut poses = BTreeMap::new();
    for KeyedEntry { key, value } in &extrinsics.extrinsics {
        let world_to_camera = DMat3::from_cols_array_2d(&value.rotation).transpose();
        let centre = DVec3::from_array(value.center);
        let pose = Pose::from_matrix(world_to_camera.transpose(), centre).ok_or_else(|| {
            StoreError::malformed(
                &extrinsics_path,
                format!("pose {key} must be a rotation and a centre"),
            )
        })?;
        if poses.insert(*key, pose).is_some() {
            let reason = format!("has two poses with the key {key}");
            return Err(StoreError::malformed(&extrinsics_path, reason).into());
        }
    }
    let camera =
        common_camera(&views).map_err(|reason| StoreError::malformed(&views_path, reason))?;
    let images = folder.join("images");
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    for view in &views.views {
        let view = view.value.data();
        let Some(image) = super::image_of(&images, &view.filename)? else {
            missing_images.push(view.filename.clone());
            continue;
        };
        frames.push(ForeignFrame {
            image,
            mask: black_mask(&images, &mask_name(&view.filename)),
            objects: BTreeMap::new(),
            pose: poses.get(&view.id_pose).copied(),
            moment: None,
            distance: None,
        });
    }
    let landmarks = views.structure.len().max(extrinsics.structure.len());
    let mut notes = left_out::unread_images(folder, &frames)?;
    if landmarks > 0 {
        notes.push(format!(
            "{landmarks} landmarks of the structure are not read: points come from {POINTS_FILE}"
        ));
    }
    let views = views.views.iter();
    let images = views.map(|view| view.value.data().filename.as_str());
    Ok(ForeignScene {
        // OpenMVG does not turn images (`ReadJpgStream` in `src/openMVG/image/image_io.cpp`).
        pixels: FramePixels::Stored,
        missing_images,
        published_split: lists::published_split(folder, images, &mut notes)?,
        points: read_points(folder, &mut notes)?,
        notes,
        ..ForeignScene::new(camera, frames, folder)
    })
}

fn read_points(folder: &Path, notes: &mut Vec<String>) -> Result<PointCloud, StoreError> {
    let [points, coloured] = [POINTS_FILE, COLOURED_POINTS_FILE].map(|name| folder.join(name));
    if points.is_file() {
        return PointCloud::read_ply(&points);
    }
    if !coloured.is_file() {
        return Ok(PointCloud::default());
    }
    notes.push(format!(
        "points are those of {COLOURED_POINTS_FILE}, among which OpenMVG puts a green one at every camera"
    ));
    PointCloud::read_ply(&coloured)
}
