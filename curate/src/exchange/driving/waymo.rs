//! Segments of the Waymo Open Dataset, version 2 (`src/waymo_open_dataset/v2/perception` of
//! `waymo-research/waymo-open-dataset`).
//!
//! ```text
//! camera_image/SEGMENT.parquet         a JPEG a row, with the pose of the vehicle at its time
//! camera_calibration/SEGMENT.parquet   intrinsics, lens (k1, k2, p1, p2, k3), camera to vehicle
//! vehicle_pose/SEGMENT.parquet         vehicle to world at each frame, 10 Hz
//! lidar/SEGMENT.parquet                range images of five LiDARs
//! lidar_calibration/SEGMENT.parquet    beams, LiDAR to vehicle
//! lidar_pose/SEGMENT.parquet           a pose of the vehicle for each pixel of the LiDAR on the roof
//! lidar_box/SEGMENT.parquet            boxes in the frame of the vehicle, with the id of their track
//! ```
//!
//! Vehicle, cameras and LiDARs have x forward, y left, z up; matrices are 4x4, row by row. Boxes are upright in the frame
//! of the vehicle. Pixel 0 begins at the left side of the first one, as ours does. Here the world begins at the first
//! place of the vehicle: that of the dataset begins kilometres away. Images and points are unpacked into a temporary
//! folder, which goes with the scene.

mod calibration;
mod labels;
mod range_image;
mod table;
mod unpacked;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    sync::Arc,
};

use glam::DVec3;
use omnilife_schemas::store::{self, StoreError};

use self::{table::Table, unpacked::Unpacked};
use super::{Layout, RigCamera, choice::Choice, parts_left_out, rigid::Rigid};
use crate::{
    error::CurateError,
    exchange::{ForeignScene, Format, stem},
};

/// The format.
pub const FORMAT: Format = Format {
    id: "waymo",
    about: "a segment of the Waymo Open Dataset 2 (FOLDER/SEGMENT, FOLDER/SEGMENT/FRONT): Parquet tables in \
            camera_image/, camera_calibration/, vehicle_pose/, lidar/, lidar_calibration/, lidar_pose/, lidar_box/",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const IMAGES: &str = "camera_image";
const ENDING: &str = ".parquet";
/// Cameras by their numbers, from 1.
const CAMERAS: [&str; 5] = [
    "FRONT",
    "FRONT_LEFT",
    "FRONT_RIGHT",
    "SIDE_LEFT",
    "SIDE_RIGHT",
];
/// Components that are there and not read.
const NOT_READ: [(&str, &str); 9] = [
    ("camera_box", "boxes in images"),
    ("camera_hkp", "key points of people in images"),
    ("camera_segmentation", "classes of pixels"),
    ("camera_to_lidar_box_association", "boxes in images"),
    ("lidar_camera_projection", "pixels of points"),
    (
        "lidar_camera_synced_box",
        "boxes shifted to the time of an image",
    ),
    ("lidar_hkp", "key points of people"),
    ("lidar_segmentation", "classes of points"),
    ("projected_lidar_box", "boxes in images"),
];
/// Seconds between an image and its frame, at most: a turn of the LiDAR, during which the cameras are triggered.
const REACH_SECONDS: f64 = 0.1;
const MICROSECONDS: f64 = 1e-6;

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let is_root = |folder: &Path| folder.join(IMAGES).is_dir();
    let must_hold = "camera_image/, as the Parquet tables of the Waymo Open Dataset 2 do (TFRecord files of version 1 \
                     are not read)";
    let choice = Choice::read(folder, is_root, must_hold)?;
    let segment = choice.sequence(&segments(&choice.root)?)?;
    let segment = Segment::open(&choice.root, segment)?;
    let cameras = calibration::cameras(&segment.needed("camera_calibration")?)?;
    let known: Vec<String> = (1_i64..)
        .zip(CAMERAS)
        .filter(|(number, _)| cameras.contains_key(number))
        .map(|(_, name)| name.to_owned())
        .collect();
    let chosen = choice.cameras(&known, known.clone())?;
    let mut notes = vec![
        "times are those of the images; cameras read an image out in some ten milliseconds, and a pose counts for all of \
         it; a LiDAR sweep counts as taken at one moment but for its own motion"
            .to_owned(),
        segment.place_note(),
    ];
    let mut unpacked = Unpacked::new(&segment)?;
    let rig = (1_i64..)
        .zip(CAMERAS)
        .filter(|(_, name)| chosen.iter().any(|one| one == name));
    let mut rig_cameras = Vec::new();
    let mut numbers = BTreeMap::new();
    for (number, name) in rig {
        let Some(one) = cameras.get(&number) else {
            continue;
        };
        numbers.insert(number, rig_cameras.len());
        notes.extend(
            one.remark
                .as_ref()
                .map(|remark| format!("{name}: {remark}")),
        );
        rig_cameras.push(RigCamera {
            name: name.to_owned(),
            camera: one.camera,
        });
    }
    let images = unpacked.images(&segment, &cameras, &numbers)?;
    let sweeps = unpacked.sweeps(&segment, &mut notes)?;
    let objects = labels::read(&segment, &mut notes)?;
    notes.extend(parts_left_out(&choice.root, &NOT_READ));
    let scene = Layout {
        format: FORMAT.id,
        root: &choice.root,
        cameras: rig_cameras,
        images,
        sweeps,
        objects,
        label_reach_seconds: REACH_SECONDS,
        missing_images: Vec::new(),
        notes,
    }
    .scene()?;
    Ok(ForeignScene {
        unpacked: Some(Arc::new(unpacked.folder)),
        ..scene
    })
}

/// Returns the names of the segments, in order.
fn segments(root: &Path) -> Result<Vec<String>, StoreError> {
    let mut names = store::names_in(&root.join(IMAGES))?;
    names.retain(|name| name.ends_with(ENDING) && !store::is_hidden(Path::new(name)));
    names.sort();
    Ok(names.iter().map(|name| stem(name).to_owned()).collect())
}

/// A segment, with the poses of its vehicle.
struct Segment<'a> {
    root: &'a Path,
    name: String,
    /// Poses of the vehicle in the world of the scene, by the time of the frame, microseconds.
    vehicle: BTreeMap<i64, Rigid>,
    /// Place of that world's origin in the world of the dataset, metres.
    origin: DVec3,
    /// Time of the first frame, microseconds.
    begin: i64,
}

impl<'a> Segment<'a> {
    /// Reads the poses of the vehicle.
    fn open(root: &'a Path, name: String) -> Result<Self, CurateError> {
        let mut segment = Self {
            root,
            name,
            vehicle: BTreeMap::new(),
            origin: DVec3::ZERO,
            begin: 0,
        };
        let table = segment.needed("vehicle_pose")?;
        let vehicle = calibration::vehicle_poses(&table)?;
        let (begin, origin) = (vehicle.first_key_value())
            .map(|(time, pose)| (*time, pose.translation))
            .ok_or_else(|| CurateError::input(table.path(), "must hold a pose, got none"))?;
        let moved = vehicle
            .into_iter()
            .map(|(time, pose)| (time, moved(pose, origin)));
        segment.vehicle = moved.collect();
        (segment.begin, segment.origin) = (begin, origin);
        Ok(segment)
    }

    /// Opens the table of a component; `None` where it is not there.
    fn table(&self, component: &str) -> Result<Option<Table>, StoreError> {
        let path = self
            .root
            .join(component)
            .join(format!("{}{ENDING}", self.name));
        if !path.is_file() {
            return Ok(None);
        }
        Table::open(path).map(Some)
    }

    /// Opens the table of a component.
    fn needed(&self, component: &str) -> Result<Table, CurateError> {
        self.table(component)?.ok_or_else(|| {
            let path = self.root.join(component);
            CurateError::input(&path, format!("must hold {}{ENDING}", self.name))
        })
    }

    /// Returns the time of a frame in seconds since the first.
    fn seconds(&self, time: i64) -> f64 {
        time.saturating_sub(self.begin) as f64 * MICROSECONDS
    }

    /// Returns the number of a frame, and the pose of the vehicle at its time.
    ///
    /// # Errors
    /// With the reason, for a time that has no pose.
    fn frame(&self, time: i64) -> Result<(u64, Rigid), String> {
        let pose = self.vehicle.get(&time).copied();
        let number = self.vehicle.range(..time).count() as u64;
        pose.map(|pose| (number, pose))
            .ok_or_else(|| format!("must be of a frame of vehicle_pose, got one at {time}"))
    }

    fn place_note(&self) -> String {
        let [x, y, z] = self.origin.to_array();
        format!(
            "the world begins at the first place of the vehicle, ({x:.3}, {y:.3}, {z:.3}) m in that of the dataset"
        )
    }
}

/// Returns a transform to the world by that of a world with another origin.
fn moved(pose: Rigid, origin: DVec3) -> Rigid {
    Rigid {
        translation: pose.translation - origin,
        ..pose
    }
}

/// Returns the frames of a set that no row has, as text.
fn without(all: &BTreeMap<i64, Rigid>, found: &BTreeSet<i64>) -> Vec<String> {
    let missing = all.keys().filter(|time| !found.contains(*time));
    missing.map(i64::to_string).collect()
}
