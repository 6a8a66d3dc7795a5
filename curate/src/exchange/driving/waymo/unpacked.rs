//! Images and LiDAR points of a segment as files.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::{
    image_file::ImageFile,
    store::{self, StoreError},
};
use tempfile::TempDir;

use super::{
    MICROSECONDS, REACH_SECONDS, Segment,
    calibration::{self, VehicleCamera, VehicleLidar, rigid},
    moved,
    range_image::RangeImage,
    table::{Column, Table},
    without,
};
use crate::{
    error::CurateError,
    exchange::{
        driving::{RigImage, Sweep},
        left_out,
    },
};

/// Coordinates of a point in a file.
const VALUES: usize = 3;
/// Step of stored poses from which on it is reported, metres.
const COARSE_METRES: f64 = 0.05;
/// LiDARs by their numbers, from 1.
const LIDARS: [&str; 5] = ["TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR"];
/// First bytes of a JPEG.
const JPEG: [u8; 2] = [0xff, 0xd8];

/// A temporary folder with the parts of a segment.
pub(super) struct Unpacked {
    pub(super) folder: TempDir,
}

impl Unpacked {
    /// Makes an empty folder.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(super) fn new(segment: &Segment<'_>) -> Result<Self, StoreError> {
        let folder = tempfile::Builder::new()
            .prefix("omnilife-waymo-")
            .tempdir()
            .map_err(|source| StoreError::write(segment.root, source))?;
        Ok(Self { folder })
    }

    /// Unpacks the images of cameras, which are entered by their numbers in the rig.
    ///
    /// # Errors
    /// When a row is damaged or of no frame, an image is no JPEG of its camera's size, a camera has two in a frame, or
    /// none is there.
    pub(super) fn images(
        &mut self,
        segment: &Segment<'_>,
        cameras: &BTreeMap<i64, VehicleCamera>,
        rig: &BTreeMap<i64, usize>,
    ) -> Result<Vec<RigImage>, CurateError> {
        let table = segment.needed(super::IMAGES)?;
        let column = |name: &str| table.column(&format!("[CameraImageComponent].{name}"));
        let mut times = table.column("key.frame_timestamp_micros")?;
        let mut numbers = table.column("key.camera_name")?;
        let (mut poses, mut stamps) = (column("pose.transform")?, column("pose_timestamp")?);
        let mut images = column("image")?;
        let mut found = Vec::new();
        let mut seen = BTreeSet::new();
        for row in 0..table.rows {
            let fault = |reason: String| table.fault(row, reason);
            let (time, number) = (times.integer(row)?, numbers.integer(row)?);
            let Some(calibrated) = cameras.get(&number) else {
                let reason = format!("must be of a camera of camera_calibration, got {number}");
                return Err(fault(reason).into());
            };
            let Some(&camera) = rig.get(&number) else {
                continue;
            };
            let (moment, _) = segment.frame(time).map_err(fault)?;
            if !seen.insert((moment, number)) {
                let reason = format!("must be the one image of camera {number} at {time}");
                return Err(fault(reason).into());
            }
            // Times of poses are in seconds.
            let after = stamps.number(row)? - time as f64 * MICROSECONDS;
            if after.abs() > REACH_SECONDS {
                let reason = format!(
                    "the pose of an image must be within {REACH_SECONDS} s of its frame, got {after:.3} s"
                );
                return Err(fault(reason).into());
            }
            let vehicle = moved(rigid(poses.exactly(row)?).map_err(fault)?, segment.origin);
            let bytes = images.bytes(row)?;
            if !bytes.data().starts_with(&JPEG) {
                return Err(fault("an image must be a JPEG".to_owned()).into());
            }
            let file = self.folder.path().join(format!("{number}/{moment:06}.jpg"));
            store::create_folder(&self.folder.path().join(number.to_string()))?;
            store::write_bytes(&file, bytes.data())?;
            let size = calibrated.camera.size();
            ImageFile::open(&file)
                .and_then(|image| image.expect_size(size).map(drop))
                .map_err(|error| fault(error.to_string()))?;
            let pose = vehicle.after(calibrated.to_vehicle).pose();
            found.push(RigImage {
                pose: pose.ok_or_else(|| fault("must have a finite pose".to_owned()))?,
                file,
                camera,
                seconds: segment.seconds(time) + after,
                moment,
            });
        }
        if found.is_empty() {
            return Err(CurateError::input(
                table.path(),
                "must hold images of the cameras, got none",
            ));
        }
        Ok(found)
    }

    /// Unpacks the first returns of all LiDARs: a sweep a frame, in the frame of the vehicle.
    ///
    /// # Errors
    /// When a row is damaged, of no frame, or of a LiDAR without calibration.
    pub(super) fn sweeps(
        &mut self,
        segment: &Segment<'_>,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Sweep>, CurateError> {
        let Some(table) = segment.table("lidar")? else {
            notes.push("no lidar: the scene has neither points nor distances".to_owned());
            return Ok(Vec::new());
        };
        let lidars = calibration::lidars(&segment.needed("lidar_calibration")?)?;
        let poses = segment.table("lidar_pose")?;
        let mut rows = Sweeps::open(segment, &table, &lidars, poses.as_ref())?;
        if poses.is_none() {
            notes.push(
                "no lidar_pose: a sweep counts as taken from one place of the vehicle".to_owned(),
            );
        }
        // Poses of pixels are in 32 bits, in the world of the dataset.
        let step = segment.origin.abs().max_element() * f64::from(f32::EPSILON);
        notes.extend((poses.is_some() && step > COARSE_METRES).then(|| {
            format!("poses of LiDAR pixels are stored in steps of {step:.2} m, so far from the dataset's origin")
        }));
        let second = table.has("[LiDARComponent].range_image_return2.values");
        notes.extend(second.then(|| "second returns of the LiDARs are left out".to_owned()));
        let mut by_time = BTreeMap::<i64, Vec<usize>>::new();
        let mut of_lidars = BTreeMap::<i64, usize>::new();
        let mut times = table.column("key.frame_timestamp_micros")?;
        let mut names = table.column("key.laser_name")?;
        for row in 0..table.rows {
            by_time.entry(times.integer(row)?).or_default().push(row);
            let count = of_lidars.entry(names.integer(row)?).or_default();
            *count = count.saturating_add(1);
        }
        for name in lidars.keys() {
            let label = usize::try_from(name.saturating_sub(1)).ok();
            let label = label
                .and_then(|at| LIDARS.get(at))
                .copied()
                .unwrap_or("of another name");
            let missing = by_time
                .len()
                .saturating_sub(of_lidars.get(name).copied().unwrap_or(0));
            notes.extend((missing > 0).then(|| {
                format!("LiDAR {label}: frames without its range image, beside others that have one: {missing}")
            }));
        }
        let found: BTreeSet<i64> = by_time.keys().copied().collect();
        let missing = without(&segment.vehicle, &found);
        notes.extend(left_out::line(&missing, "frames without a LiDAR sweep"));
        let mut sweeps = Vec::new();
        for (time, of_time) in by_time {
            let mut bytes = Vec::new();
            let first = of_time.first().copied().unwrap_or_default();
            let (moment, to_world) =
                (segment.frame(time)).map_err(|reason| table.fault(first, reason))?;
            for row in of_time {
                for point in rows.points(row, time)? {
                    bytes.extend(
                        point
                            .as_vec3()
                            .to_array()
                            .map(f32::to_le_bytes)
                            .as_flattened(),
                    );
                }
            }
            let file = self.folder.path().join(format!("{moment:06}.bin"));
            store::write_bytes(&file, &bytes)?;
            sweeps.push(Sweep {
                file,
                to_world,
                seconds: segment.seconds(time),
                moment,
                values: VALUES,
            });
        }
        Ok(sweeps)
    }
}

/// Range images and the poses of their pixels.
struct Sweeps<'a> {
    segment: &'a Segment<'a>,
    table: &'a Table,
    lidars: &'a BTreeMap<i64, VehicleLidar>,
    names: Column<'a>,
    images: ImageColumns<'a>,
    /// Rows with poses by their time and LiDAR, and their columns.
    posed: BTreeMap<(i64, i64), usize>,
    poses: Option<ImageColumns<'a>>,
}

/// Columns of images and their shapes.
struct ImageColumns<'a> {
    values: Column<'a>,
    shapes: Column<'a>,
}

impl<'a> ImageColumns<'a> {
    fn open(table: &'a Table, component: &str) -> Result<Self, StoreError> {
        let column =
            |name: &str| table.column(&format!("[{component}].range_image_return1.{name}"));
        Ok(Self {
            values: column("values")?,
            shapes: column("shape")?,
        })
    }

    fn read(&mut self, row: usize) -> Result<(Vec<f64>, [f64; 3]), StoreError> {
        Ok((self.values.numbers(row)?, self.shapes.exactly(row)?))
    }
}

impl<'a> Sweeps<'a> {
    fn open(
        segment: &'a Segment<'a>,
        table: &'a Table,
        lidars: &'a BTreeMap<i64, VehicleLidar>,
        poses: Option<&'a Table>,
    ) -> Result<Self, StoreError> {
        let mut posed = BTreeMap::new();
        if let Some(poses) = poses {
            let mut times = poses.column("key.frame_timestamp_micros")?;
            let mut names = poses.column("key.laser_name")?;
            for row in 0..poses.rows {
                posed.insert((times.integer(row)?, names.integer(row)?), row);
            }
        }
        let open = |poses| ImageColumns::open(poses, "LiDARPoseComponent");
        Ok(Self {
            segment,
            table,
            lidars,
            names: table.column("key.laser_name")?,
            images: ImageColumns::open(table, "LiDARComponent")?,
            posed,
            poses: poses.map(open).transpose()?,
        })
    }

    /// Returns the points of a row in the frame of the vehicle at a time, metres.
    fn points(&mut self, row: usize, time: i64) -> Result<Vec<glam::DVec3>, StoreError> {
        let fault = |reason: String| self.table.fault(row, reason);
        let name = self.names.integer(row)?;
        let lidar = self.lidars.get(&name);
        let lidar = lidar.ok_or_else(|| {
            fault(format!(
                "must be of a LiDAR of lidar_calibration, got {name}"
            ))
        })?;
        let (values, shape) = self.images.read(row)?;
        let image = RangeImage {
            values: &values,
            shape,
        };
        let (_, vehicle) = self.segment.frame(time).map_err(fault)?;
        let poses = match (self.posed.get(&(time, name)), &mut self.poses) {
            (Some(&posed), Some(columns)) => Some(columns.read(posed)?),
            (None, Some(_)) if self.posed.keys().any(|(_, other)| *other == name) => {
                let reason = format!(
                    "must have its poses in lidar_pose, as LiDAR {name} has at other times"
                );
                return Err(fault(reason));
            }
            _ => None,
        };
        let poses = poses.as_ref().map(|(values, shape)| RangeImage {
            values,
            shape: *shape,
        });
        // Poses of pixels are in the world of the dataset.
        let vehicle = moved(vehicle, -self.segment.origin);
        lidar.points(&image, poses.as_ref(), vehicle).map_err(fault)
    }
}
