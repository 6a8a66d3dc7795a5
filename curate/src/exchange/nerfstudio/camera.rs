//! The camera of a `transforms.json`: its entries, of the file or of every frame, as one camera.
//!
//! `ns-process-data` writes them once where it knows one camera, and with each frame where there are several,
//! even equal ones. An `EQUIRECTANGULAR` image has half a turn for each `fl_x` pixels to the left and to the
//! right of `cx`, and half a turn for `fl_y` pixels in height.

use std::collections::BTreeSet;

use omnilife_schemas::camera::{ErpCamera, PinholeCamera};
use serde_json::{Map, Value};

use super::Frame;
use crate::poses::{
    frame_camera::FrameCamera,
    lens::{Distortion, Lens, Projection},
};

/// Entries of a file or a frame that have no field of their own.
pub(super) type Entries = Map<String, Value>;

/// Entries that are read as the camera, with the default of a missing one.
const CAMERA_ENTRIES: [(&str, Option<f64>); 12] = [
    ("w", None),
    ("h", None),
    ("fl_x", None),
    ("fl_y", None),
    ("cx", None),
    ("cy", None),
    ("k1", Some(0.0)),
    ("k2", Some(0.0)),
    ("k3", Some(0.0)),
    ("k4", Some(0.0)),
    ("p1", Some(0.0)),
    ("p2", Some(0.0)),
];
const MODEL_ENTRY: &str = "camera_model";
/// instant-ngp's mark of a fisheye lens.
const FISHEYE_ENTRY: &str = "is_fisheye";
/// Fields of view, which instant-ngp writes beside the focal lengths that they follow from.
const ANGLE_ENTRIES: [&str; 2] = ["camera_angle_x", "camera_angle_y"];
/// Entries without effect on the import. The transform and the scale have been applied already, to the cameras and to
/// the points of `ply_file_path` alike.
const HARMLESS_ENTRIES: [&str; 13] = [
    "applied_transform",
    "applied_scale",
    "orientation_override",
    "auto_scale_poses_override",
    "colmap_im_id",
    "sharpness",
    "aabb_scale",
    "aabb",
    "scale",
    "offset",
    "from_na",
    "n_extra_learnable_dims",
    "version",
];
/// Names of entries about a camera: whole names, and parts of them.
const CAMERA_NAMES: [&str; 10] = [
    "width",
    "height",
    "fx",
    "fy",
    "b1",
    "b2",
    "skew",
    "crop",
    "resolution",
    "pp",
];
const CAMERA_PARTS: [&str; 14] = [
    "camera",
    "fl_",
    "focal",
    "intrinsic",
    "distort",
    "lens",
    "fov",
    "fisheye",
    "shutter",
    "calib",
    "sensor",
    "principal",
    "pixel",
    "projection",
];

/// Supported camera models.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Model {
    Sphere,
    Perspective,
    Fisheye,
}

/// Entries of a frame about its camera.
struct CameraEntries<'a> {
    file: &'a str,
    model: Model,
    /// Values in the order of [`CAMERA_ENTRIES`].
    numbers: [Option<f64>; 12],
}

/// Returns the camera of all frames, and the names of unread entries that do not concern it.
///
/// # Errors
/// For other models, entries that are missing or unknown, and frames whose cameras differ, with the reason.
pub(super) fn camera(
    entries: &Entries,
    frames: &[Frame],
) -> Result<(FrameCamera, Vec<String>), String> {
    let mut left = unread("the file", entries)?;
    let mut common: Option<CameraEntries<'_>> = None;
    for frame in frames {
        left.append(&mut unread(&frame.file_path, &frame.others)?);
        let stated = CameraEntries::of(entries, frame)?;
        match &common {
            Some(first) => first.expect_same(&stated)?,
            None => common = Some(stated),
        }
    }
    let stated = common.ok_or("has no frames")?;
    Ok((stated.camera()?, left.into_iter().collect()))
}

/// Entries that are not read.
///
/// # Errors
/// For an unread entry about a camera.
fn unread(place: &str, entries: &Entries) -> Result<BTreeSet<String>, String> {
    let is_known = |name: &str| {
        CAMERA_ENTRIES.iter().any(|(known, _)| *known == name)
            || [MODEL_ENTRY, FISHEYE_ENTRY].contains(&name)
            || HARMLESS_ENTRIES.contains(&name)
            || ANGLE_ENTRIES.contains(&name) && entries.contains_key("fl_x")
    };
    let unread: BTreeSet<String> = entries
        .keys()
        .filter(|name| !is_known(name))
        .cloned()
        .collect();
    match unread.iter().find(|name| speaks_of_a_camera(name)) {
        Some(name) => Err(format!(
            "{name} of {place} speaks of a camera and is not known; known are {MODEL_ENTRY}, {}",
            CAMERA_ENTRIES.map(|(known, _)| known).join(", ")
        )),
        None => Ok(unread),
    }
}

fn speaks_of_a_camera(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let is_term = name
        .strip_prefix(['k', 'p', 's'])
        .is_some_and(|number| number.parse::<u8>().is_ok());
    is_term
        || CAMERA_NAMES.contains(&name.as_str())
        || CAMERA_PARTS.iter().any(|part| name.contains(*part))
}

impl<'a> CameraEntries<'a> {
    /// Reads the camera of a frame: its own entries, and those of the file for missing ones.
    ///
    /// # Errors
    /// When the two contradict each other, or an entry is malformed.
    fn of(entries: &Entries, frame: &'a Frame) -> Result<Self, String> {
        let file = frame.file_path.as_str();
        let entry = |name: &str| -> Result<Option<&Value>, String> {
            match (frame.others.get(name), entries.get(name)) {
                (Some(own), Some(all)) if !same(own, all) => Err(format!(
                    "{name} of {file} is {own} and that of the file {all}; a scene has one camera"
                )),
                (own, all) => Ok(own.or(all)),
            }
        };
        let mut numbers = [None; 12];
        for (number, (name, meant)) in numbers.iter_mut().zip(CAMERA_ENTRIES) {
            *number = match entry(name)? {
                Some(value) => Some(value.as_f64().ok_or_else(|| {
                    format!("{name} of {file} is {value}, and has to be a number")
                })?),
                None => meant,
            };
        }
        let model = match entry(MODEL_ENTRY)? {
            None => Model::Perspective,
            Some(value) => match value.as_str() {
                Some("EQUIRECTANGULAR") => Model::Sphere,
                Some("OPENCV_FISHEYE") => Model::Fisheye,
                Some(
                    "PINHOLE" | "SIMPLE_PINHOLE" | "PERSPECTIVE" | "SIMPLE_RADIAL" | "RADIAL"
                    | "OPENCV",
                ) => Model::Perspective,
                _ => {
                    return Err(format!(
                        "camera model {value} of {file}; known are EQUIRECTANGULAR, PINHOLE, OPENCV and \
                         OPENCV_FISHEYE"
                    ));
                }
            },
        };
        let model = match (entry(FISHEYE_ENTRY)?, model) {
            (None | Some(Value::Bool(false)), model) => model,
            (Some(Value::Bool(true)), Model::Perspective | Model::Fisheye) => Model::Fisheye,
            (Some(value), _) => {
                return Err(format!(
                    "{FISHEYE_ENTRY} of {file} is {value} for a camera that cannot be one"
                ));
            }
        };
        Ok(Self {
            file,
            model,
            numbers,
        })
    }

    /// # Errors
    /// When the cameras of two frames differ; names the entry.
    fn expect_same(&self, other: &Self) -> Result<(), String> {
        let differ = |name: &str, ours: String, others: String| {
            Err(format!(
                "{name} is {ours} for {} and {others} for {}; a scene has one camera",
                self.file, other.file
            ))
        };
        if self.model != other.model {
            return differ(
                MODEL_ENTRY,
                format!("{:?}", self.model),
                format!("{:?}", other.model),
            );
        }
        let shown = |number: Option<f64>| number.map_or("missing".to_owned(), |n| n.to_string());
        let numbers = self.numbers.into_iter().zip(other.numbers);
        for ((ours, others), (name, _)) in numbers.zip(CAMERA_ENTRIES) {
            let is_same = match (ours, others) {
                (Some(ours), Some(others)) => close(ours, others),
                _ => ours == others,
            };
            if !is_same {
                return differ(name, shown(ours), shown(others));
            }
        }
        Ok(())
    }

    /// # Errors
    /// For missing required entries, and an invalid camera.
    fn camera(&self) -> Result<FrameCamera, String> {
        let [w, h, fl_x, fl_y, cx, cy, k1, k2, k3, k4, p1, p2] = self.numbers;
        let (width, height) = (side("w", w)?, side("h", h)?);
        let terms = [k1, k2, k3, k4, p1, p2].map(Option::unwrap_or_default);
        if self.model == Model::Sphere {
            let (w, h) = (f64::from(width), f64::from(height));
            let whole = [w / 2.0, h, w / 2.0, h / 2.0];
            let is_whole = [fl_x, fl_y, cx, cy]
                .into_iter()
                .zip(whole)
                .all(|(stated, whole)| stated.is_none_or(|stated| close(stated, whole)));
            let has_lens = terms.iter().any(|term| *term != 0.0);
            if !is_whole || has_lens {
                let [a, b, c, d] = whole;
                return Err(format!(
                    "an EQUIRECTANGULAR image of {width}x{height} must be a whole sphere without a lens, and has \
                     fl_x {a}, fl_y {b}, cx {c}, cy {d} and no distortion"
                ));
            }
            return Ok(FrameCamera::Straight(ErpCamera { width, height }.into()));
        }
        let given = |name: &str, value: Option<f64>| value.ok_or_else(|| format!("has no {name}"));
        let camera = PinholeCamera {
            width,
            height,
            fx: given("fl_x", fl_x)?,
            fy: given("fl_y", fl_y)?,
            cx: given("cx", cx)?,
            cy: given("cy", cy)?,
        };
        if !(camera.fx > 0.0 && camera.fy > 0.0) {
            return Err(format!(
                "a camera with the focal lengths {} and {}",
                camera.fx, camera.fy
            ));
        }
        let [k1, k2, k3, k4, p1, p2] = terms;
        FrameCamera::behind(Lens {
            camera,
            // The same terms before and behind a fisheye: nerfstudio, nerfstudio/cameras/camera_utils.py.
            distortion: Distortion {
                projection: match self.model {
                    Model::Fisheye => Projection::Equidistant,
                    Model::Perspective | Model::Sphere => Projection::Perspective,
                },
                radial: [k1, k2, k3, k4, 0.0, 0.0],
                tangential: [p1, p2],
                ..Distortion::default()
            },
        })
    }
}

/// Returns a number of pixels, which some programs write with a point.
fn side(name: &str, value: Option<f64>) -> Result<u32, String> {
    let value = value.ok_or_else(|| format!("has no {name}"))?;
    let pixels = value as u32;
    if pixels == 0 || f64::from(pixels) != value {
        return Err(format!(
            "{name} is {value}, and has to be a number of pixels"
        ));
    }
    Ok(pixels)
}

/// Returns true if two entries are equal.
fn same(a: &Value, b: &Value) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => close(a, b),
        _ => a == b,
    }
}

/// Returns true where two numbers differ by no more than rounding.
fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}
