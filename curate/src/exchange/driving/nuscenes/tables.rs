//! Tables of nuScenes, row by row: those of all scenes are larger than a computer's memory may be.

use std::{fmt, fs::File, io::BufReader, marker::PhantomData, path::Path};

use omnilife_schemas::store::StoreError;
use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, DeserializeSeed, SeqAccess, Visitor},
};

/// Row of `scene`.
#[derive(Debug, Deserialize)]
pub(super) struct SceneRow {
    pub(super) token: String,
    pub(super) name: String,
    pub(super) first_sample_token: String,
}

/// Row of `sample`.
#[derive(Debug, Deserialize)]
pub(super) struct Sample {
    pub(super) token: String,
    /// Microseconds.
    pub(super) timestamp: i64,
    /// Token of the following sample; empty for the last.
    pub(super) next: String,
    pub(super) scene_token: String,
}

/// Row of `sample_data`.
#[derive(Debug, Deserialize)]
pub(super) struct SampleData {
    pub(super) token: String,
    pub(super) sample_token: String,
    pub(super) ego_pose_token: String,
    pub(super) calibrated_sensor_token: String,
    /// Microseconds.
    pub(super) timestamp: i64,
    pub(super) is_key_frame: bool,
    /// Relative to the folder of the dataset.
    pub(super) filename: String,
    /// Pixels; 0 for other sensors than cameras.
    pub(super) width: u32,
    pub(super) height: u32,
}

/// Row of `ego_pose`: the vehicle in the world.
#[derive(Debug, Deserialize)]
pub(super) struct EgoPose {
    pub(super) token: String,
    /// Metres.
    pub(super) translation: [f64; 3],
    /// w, x, y, z.
    pub(super) rotation: [f64; 4],
}

/// Row of `calibrated_sensor`: a sensor on the vehicle.
#[derive(Debug, Deserialize)]
pub(super) struct CalibratedSensor {
    pub(super) token: String,
    pub(super) sensor_token: String,
    /// Metres.
    pub(super) translation: [f64; 3],
    /// w, x, y, z.
    pub(super) rotation: [f64; 4],
    /// Rows of a 3x3 matrix; empty for other sensors than cameras.
    pub(super) camera_intrinsic: Vec<Vec<f64>>,
}

/// Row of `sensor`.
#[derive(Debug, Deserialize)]
pub(super) struct Sensor {
    pub(super) token: String,
    /// `CAM_FRONT`, `LIDAR_TOP` and others.
    pub(super) channel: String,
    /// `camera`, `lidar` or `radar`.
    pub(super) modality: String,
}

/// Row of `sample_annotation`: a box in the world.
#[derive(Debug, Deserialize)]
pub(super) struct Annotation {
    pub(super) token: String,
    pub(super) sample_token: String,
    pub(super) instance_token: String,
    /// Centre, metres.
    pub(super) translation: [f64; 3],
    /// Width, length and height, metres.
    pub(super) size: [f64; 3],
    /// w, x, y, z.
    pub(super) rotation: [f64; 4],
}

/// Row of `instance`: an object.
#[derive(Debug, Deserialize)]
pub(super) struct Instance {
    pub(super) token: String,
    pub(super) category_token: String,
}

/// Row of `category`.
#[derive(Debug, Deserialize)]
pub(super) struct Category {
    pub(super) token: String,
    /// Such as `vehicle.car`.
    pub(super) name: String,
}

/// Reads the rows of a table that are wanted.
///
/// # Errors
/// When the file is missing, or no list of such rows.
pub(super) fn read<T: DeserializeOwned>(
    tables: &Path,
    name: &str,
    is_wanted: impl Fn(&T) -> bool,
) -> Result<Vec<T>, StoreError> {
    let path = tables.join(format!("{name}.json"));
    let file = File::open(&path).map_err(|source| StoreError::read(&path, source))?;
    let mut reader = serde_json::Deserializer::from_reader(BufReader::new(file));
    let rows = Rows {
        is_wanted,
        row: PhantomData,
    };
    let found = rows.deserialize(&mut reader);
    let found = found.and_then(|found| reader.end().map(|()| found));
    found.map_err(|error| {
        StoreError::malformed(&path, format!("must be a list of rows of {name}: {error}"))
    })
}

/// Reader of a list that keeps some of its rows.
struct Rows<T, F> {
    is_wanted: F,
    row: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>, F: Fn(&T) -> bool> DeserializeSeed<'de> for Rows<T, F> {
    type Value = Vec<T>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<T>, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, T: Deserialize<'de>, F: Fn(&T) -> bool> Visitor<'de> for Rows<T, F> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<Vec<T>, A::Error> {
        let mut found = Vec::new();
        while let Some(row) = rows.next_element()? {
            if (self.is_wanted)(&row) {
                found.push(row);
            }
        }
        Ok(found)
    }
}
