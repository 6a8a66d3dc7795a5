//! Scenes of nuScenes (`docs/schema_nuscenes.md`, `python-sdk/nuscenes/nuscenes.py` and `utils/data_classes.py` of
//! `nutonomy/nuscenes-devkit`).
//!
//! ```text
//! v1.0-mini/scene.json, sample.json, sample_data.json, ...     tables of rows with tokens that refer to each other
//! samples/CAM_FRONT/NAME.jpg ...                               images at key frames, undistorted, 2 Hz
//! samples/LIDAR_TOP/NAME.pcd.bin                               x, y, z, intensity, ring, 32-bit floats
//! ```
//!
//! `calibrated_sensor` maps a sensor to the vehicle, `ego_pose` the vehicle to the world at the time of each row of
//! `sample_data`; `sample_annotation` has boxes in the world at the time of its sample. Quaternions are w, x, y, z,
//! lengths metres, times microseconds. A camera has x right, y down, z forward; a box x forward, y left, z up, and a
//! size of width, length, height around its centre. Pixels of `camera_intrinsic` have their centres at whole numbers,
//! ours at halves.
//!
//! Cameras of a sample are not taken at once: each image has its own time and pose. Rows between key frames have no
//! boxes and are left out, as are radars.

mod order;
mod rows;
mod tables;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    plain_text,
    store::{self, StoreError},
};

use self::{
    order::samples_of,
    rows::{box_of, camera_of, class_of, rigid},
    tables::{
        Annotation, CalibratedSensor, Category, EgoPose, Instance, SampleData, SceneRow, Sensor,
        read,
    },
};
use super::{
    Layout, RigCamera, RigImage, Sweep, choice::Choice, objects::LabelledObject, rigid::Rigid,
};
use crate::{
    error::CurateError,
    exchange::{ForeignScene, Format, file_of},
};

/// The format.
pub const FORMAT: Format = Format {
    id: "nuscenes",
    about: "a scene of nuScenes (FOLDER/scene-0061, FOLDER/scene-0061/CAM_FRONT): v1.0-*/, samples/",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

/// Begin of the name of the folder of tables.
const VERSION: &str = "v1.0-";
const LIDAR: &str = "LIDAR_TOP";
/// Floats of a LiDAR point.
const VALUES: usize = 5;
/// Seconds between an image and its sample, at most: a turn of the LiDAR, at 20 Hz, and as much again.
const REACH_SECONDS: f64 = 0.1;
const MICROSECONDS: f64 = 1e-6;

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    // A folder that cannot be listed is taken for the root, so that `tables_of` has its error.
    let is_root = |folder: &Path| !versions_in(folder).is_ok_and(|names| names.is_empty());
    let choice = Choice::read(
        folder,
        is_root,
        "one folder of tables v1.0-*, as nuScenes does",
    )?;
    let tables = tables_of(&choice.root)?;
    let scenes: Vec<SceneRow> = read(&tables, "scene", |_| true)?;
    let names: Vec<String> = scenes.iter().map(|scene| scene.name.clone()).collect();
    let name = choice.sequence(&names)?;
    let scene = (scenes.iter().find(|scene| scene.name == name))
        .ok_or_else(|| CurateError::input(&tables, format!("must hold the scene {name}")))?;
    let samples = samples_of(&tables, scene)?;
    let data: Vec<SampleData> = read(&tables, "sample_data", |row: &SampleData| {
        samples.contains_key(&row.sample_token)
    })?;
    Reader::new(&choice, tables, samples, data)?
        .layout()?
        .scene()
}

/// Returns the names of the folders of tables in a folder, in order. Other paths hold none.
///
/// # Errors
/// When the folder cannot be listed.
fn versions_in(folder: &Path) -> Result<Vec<String>, StoreError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut names = store::names_in(folder)?;
    names.retain(|name| name.starts_with(VERSION) && folder.join(name).is_dir());
    Ok(names)
}

/// Returns the folder of tables of a dataset.
///
/// # Errors
/// Unless there is one, and when the root cannot be listed.
fn tables_of(root: &Path) -> Result<PathBuf, CurateError> {
    let names = versions_in(root)?;
    match names.as_slice() {
        [only] => Ok(root.join(only)),
        _ => {
            let reason = format!(
                "must hold one folder of tables v1.0-*, got {} ({})",
                names.len(),
                plain_text::first_of(&names)
            );
            Err(CurateError::input(root, reason))
        }
    }
}

/// Rows of a scene, and those that they refer to.
struct Reader<'a> {
    choice: &'a Choice,
    tables: PathBuf,
    samples: BTreeMap<String, (u64, i64)>,
    /// Key frames.
    data: Vec<SampleData>,
    poses: BTreeMap<String, EgoPose>,
    sensors: BTreeMap<String, CalibratedSensor>,
    /// Channels and modalities by the token of the sensor.
    channels: BTreeMap<String, Sensor>,
    notes: Vec<String>,
    /// Time of the first image or sweep, microseconds.
    begin: i64,
}

impl<'a> Reader<'a> {
    fn new(
        choice: &'a Choice,
        tables: PathBuf,
        samples: BTreeMap<String, (u64, i64)>,
        mut data: Vec<SampleData>,
    ) -> Result<Self, CurateError> {
        let all = data.len();
        data.retain(|row| row.is_key_frame);
        data.sort_by(|a, b| (a.timestamp, &a.token).cmp(&(b.timestamp, &b.token)));
        let wanted: BTreeSet<&String> = data.iter().map(|row| &row.ego_pose_token).collect();
        let poses = read(&tables, "ego_pose", |row: &EgoPose| {
            wanted.contains(&row.token)
        })?;
        let wanted: BTreeSet<&String> = data
            .iter()
            .map(|row| &row.calibrated_sensor_token)
            .collect();
        let sensors = read(&tables, "calibrated_sensor", |row: &CalibratedSensor| {
            wanted.contains(&row.token)
        })?;
        let channels = read(&tables, "sensor", |_: &Sensor| true)?;
        let between = all.saturating_sub(data.len());
        let mut notes = vec![
            "times are those of the images, which a sample takes one after the other; a LiDAR sweep counts as taken at \
             one moment"
                .to_owned(),
        ];
        notes.extend((between > 0).then(|| {
            format!("rows of sensors between key frames, which have no boxes, left out: {between}")
        }));
        let first = samples.values().map(|(_, time)| *time).min();
        let begin = data
            .first()
            .map(|row| row.timestamp)
            .into_iter()
            .chain(first)
            .min();
        Ok(Self {
            choice,
            poses: by_token(poses, |row: &EgoPose| &row.token),
            sensors: by_token(sensors, |row: &CalibratedSensor| &row.token),
            channels: by_token(channels, |row: &Sensor| &row.token),
            tables,
            samples,
            notes,
            begin: begin.unwrap_or_default(),
            data,
        })
    }

    /// Returns the time of a row in seconds since the first.
    fn seconds(&self, timestamp: i64) -> f64 {
        timestamp.saturating_sub(self.begin) as f64 * MICROSECONDS
    }

    fn fault(&self, table: &str, reason: impl Into<String>) -> CurateError {
        StoreError::malformed(&self.tables.join(format!("{table}.json")), reason).into()
    }

    fn row<'r, T>(
        &self,
        table: &str,
        rows: &'r BTreeMap<String, T>,
        token: &str,
    ) -> Result<&'r T, CurateError> {
        rows.get(token)
            .ok_or_else(|| self.fault(table, format!("must hold the row {token:?}, got none")))
    }

    /// Returns the sensor of a row of data, its calibration, and its transform to the world.
    fn sensor(&self, row: &SampleData) -> Result<(&Sensor, &CalibratedSensor, Rigid), CurateError> {
        let token = &row.calibrated_sensor_token;
        let calibration = self.row("calibrated_sensor", &self.sensors, token)?;
        let sensor = self.row("sensor", &self.channels, &calibration.sensor_token)?;
        let ego = self.row("ego_pose", &self.poses, &row.ego_pose_token)?;
        let to_world = rigid(ego.rotation, ego.translation)
            .map_err(|reason| self.fault("ego_pose", format!("row {}: {reason}", ego.token)))?;
        let to_vehicle = rigid(calibration.rotation, calibration.translation)
            .map_err(|reason| self.fault("calibrated_sensor", format!("row {token}: {reason}")))?;
        Ok((sensor, calibration, to_world.after(to_vehicle)))
    }

    fn moment(&self, row: &SampleData) -> u64 {
        self.samples
            .get(&row.sample_token)
            .map_or(0, |(number, _)| *number)
    }

    /// Returns the drive of the scene.
    fn layout(mut self) -> Result<Layout<'a>, CurateError> {
        let mut known = BTreeSet::new();
        for row in &self.data {
            let (sensor, ..) = self.sensor(row)?;
            if sensor.modality == "camera" {
                known.insert(sensor.channel.clone());
            }
        }
        let known: Vec<String> = known.into_iter().collect();
        let chosen = self.choice.cameras(&known, known.clone())?;
        let (mut cameras, mut images, mut sweeps) =
            (Vec::<RigCamera>::new(), Vec::new(), Vec::new());
        let (mut missing_images, mut missing_sweeps) = (Vec::new(), Vec::new());
        let (mut others, root) = (BTreeSet::new(), self.choice.root.as_path());
        for row in &self.data {
            let (sensor, calibration, to_world) = self.sensor(row)?;
            let is_camera = chosen.contains(&sensor.channel);
            if !is_camera && sensor.channel != LIDAR {
                others.insert(sensor.channel.clone());
                continue;
            }
            if !root.join(&row.filename).is_file() {
                let missing = if is_camera {
                    &mut missing_images
                } else {
                    &mut missing_sweeps
                };
                missing.push(row.filename.clone());
                continue;
            }
            let file = file_of(root, &row.filename)?;
            let (seconds, moment) = (self.seconds(row.timestamp), self.moment(row));
            if !is_camera {
                sweeps.push(Sweep {
                    file,
                    to_world,
                    seconds,
                    moment,
                    values: VALUES,
                });
                continue;
            }
            let camera = camera_of(calibration, [row.width, row.height]).map_err(|reason| {
                self.fault(
                    "calibrated_sensor",
                    format!("row {}: {reason}", calibration.token),
                )
            })?;
            let there = cameras.iter().position(|one| one.name == sensor.channel);
            let number = there.unwrap_or(cameras.len());
            match cameras.get(number) {
                Some(known) if known.camera != camera.into() => {
                    let reason = format!("must have one calibration of {} in a scene", known.name);
                    return Err(self.fault("calibrated_sensor", reason));
                }
                Some(_) => {}
                None => cameras.push(RigCamera {
                    name: sensor.channel.clone(),
                    camera: camera.into(),
                }),
            }
            images.push(RigImage {
                pose: (to_world.pose())
                    .ok_or_else(|| CurateError::input(&file, "must have a finite pose"))?,
                file,
                camera: number,
                seconds,
                moment,
            });
        }
        let objects = self.objects()?;
        let mut notes = std::mem::take(&mut self.notes);
        for (names, what) in [
            (
                others.into_iter().collect::<Vec<String>>(),
                "sensors that are not read",
            ),
            (
                missing_sweeps,
                "LiDAR sweeps left out, whose files are not there",
            ),
        ] {
            notes.extend(crate::exchange::left_out::line(&names, what));
        }
        if sweeps.is_empty() {
            notes.push(format!(
                "no {LIDAR}: the scene has neither points nor distances"
            ));
        }
        if let (true, Some(first)) = (images.is_empty(), missing_images.first()) {
            let reason = format!("must hold the images of its tables, got none, such as {first}");
            return Err(CurateError::input(root, reason));
        }
        Ok(Layout {
            format: FORMAT.id,
            root,
            cameras,
            images,
            sweeps,
            objects,
            label_reach_seconds: REACH_SECONDS,
            missing_images,
            notes,
        })
    }

    /// Reads the labelled objects of the scene, with ids in the order of their first boxes.
    fn objects(&self) -> Result<Vec<LabelledObject>, CurateError> {
        let mut rows: Vec<Annotation> =
            read(&self.tables, "sample_annotation", |row: &Annotation| {
                self.samples.contains_key(&row.sample_token)
            })?;
        let time = |row: &Annotation| {
            self.samples
                .get(&row.sample_token)
                .map_or(0, |(_, time)| *time)
        };
        rows.sort_by(|a, b| (time(a), &a.token).cmp(&(time(b), &b.token)));
        let wanted: BTreeSet<&String> = rows.iter().map(|row| &row.instance_token).collect();
        let instances = read(&self.tables, "instance", |row: &Instance| {
            wanted.contains(&row.token)
        })?;
        let instances = by_token(instances, |row: &Instance| &row.token);
        let categories = read(&self.tables, "category", |_: &Category| true)?;
        let categories = by_token(categories, |row: &Category| &row.token);
        let (mut objects, mut ids) = (Vec::<LabelledObject>::new(), BTreeMap::new());
        for row in &rows {
            let instance = self.row("instance", &instances, &row.instance_token)?;
            let category = self.row("category", &categories, &instance.category_token)?;
            let number = *ids.entry(&row.instance_token).or_insert(objects.len());
            if objects.get(number).is_none() {
                objects.push(LabelledObject {
                    id: u32::try_from(number).unwrap_or(u32::MAX),
                    name: Some(row.instance_token.clone()),
                    class: class_of(&category.name),
                    boxes: Vec::new(),
                });
            }
            let of_row = |reason: String| {
                self.fault("sample_annotation", format!("row {}: {reason}", row.token))
            };
            let labelled = box_of(row).map_err(of_row)?;
            let seconds = self.seconds(time(row));
            if let Some(object) = objects.get_mut(number) {
                if object
                    .boxes
                    .last()
                    .is_some_and(|(last, _)| *last >= seconds)
                {
                    let reason = format!("is the second box of {} in a sample", row.instance_token);
                    return Err(of_row(reason));
                }
                object.boxes.push((seconds, labelled));
            }
        }
        Ok(objects)
    }
}

fn by_token<T>(rows: Vec<T>, token: impl Fn(&T) -> &String) -> BTreeMap<String, T> {
    rows.into_iter()
        .map(|row| (token(&row).clone(), row))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_folder_of_tables_is_taken_and_several_are_named()
    -> Result<(), Box<dyn std::error::Error>> {
        let temp = tempfile::tempdir()?;
        let root = temp.path();
        assert!(versions_in(&root.join("none")).is_ok_and(|names| names.is_empty()));
        store::create_folder(&root.join("v1.0-mini"))?;
        assert!(tables_of(root).is_ok_and(|folder| folder.ends_with("v1.0-mini")));
        store::create_folder(&root.join("v1.0-test"))?;
        let refusal = import(&root.join("scene-0061")).err();
        let refusal = refusal.map(|error| error.to_string()).unwrap_or_default();
        assert!(
            refusal.contains("got 2 (v1.0-mini, v1.0-test)"),
            "{refusal}"
        );
        Ok(())
    }
}
