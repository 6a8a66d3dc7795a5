//! Camera of any model that scenes may have.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::{CameraModel, ErpCamera, PinholeCamera};

/// The camera of a scene, of known model. Who reads it decides what to do with each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "model", rename_all = "kebab-case")]
pub enum Camera {
    /// The whole sphere; columns wrap.
    Erp(ErpCamera),
    /// A perspective image without distortion.
    Pinhole(PinholeCamera),
}

impl Camera {
    /// Returns the pixels per row.
    pub fn width(&self) -> u32 {
        match self {
            Self::Erp(camera) => camera.width,
            Self::Pinhole(camera) => camera.width,
        }
    }

    /// Returns the rows of pixels.
    pub fn height(&self) -> u32 {
        match self {
            Self::Erp(camera) => camera.height,
            Self::Pinhole(camera) => camera.height,
        }
    }

    /// Returns the columns and rows of pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width() as usize, self.height() as usize]
    }

    /// Returns whether the first column follows the last.
    pub fn wraps(&self) -> bool {
        match self {
            Self::Erp(_) => true,
            Self::Pinhole(_) => false,
        }
    }

    /// Returns the name of the model in files and on the command line.
    pub fn model(&self) -> &'static str {
        match self {
            Self::Erp(_) => "erp",
            Self::Pinhole(_) => "pinhole",
        }
    }

    /// Returns the camera with images of another size: focal lengths and principal point scale with it.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        match self {
            Self::Erp(_) => Self::Erp(ErpCamera { width, height }),
            Self::Pinhole(camera) => {
                let x = f64::from(width) / f64::from(camera.width);
                let y = f64::from(height) / f64::from(camera.height);
                Self::Pinhole(PinholeCamera {
                    width,
                    height,
                    fx: camera.fx * x,
                    fy: camera.fy * y,
                    cx: camera.cx * x,
                    cy: camera.cy * y,
                })
            }
        }
    }
}

impl CameraModel for Camera {
    fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        match self {
            Self::Erp(camera) => camera.project(point_camera),
            Self::Pinhole(camera) => camera.project(point_camera),
        }
    }

    fn unproject(&self, pixel: DVec2) -> DVec3 {
        match self {
            Self::Erp(camera) => camera.unproject(pixel),
            Self::Pinhole(camera) => camera.unproject(pixel),
        }
    }
}

impl From<ErpCamera> for Camera {
    fn from(camera: ErpCamera) -> Self {
        Self::Erp(camera)
    }
}

impl From<PinholeCamera> for Camera {
    fn from(camera: PinholeCamera) -> Self {
        Self::Pinhole(camera)
    }
}

/// Models by their names in files.
#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Model {
    Erp,
    Pinhole,
}

/// Camera as stored in a file. The first version of scenes names no model: all were ERP.
#[derive(Deserialize)]
struct Entry {
    model: Option<Model>,
    width: u32,
    height: u32,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
}

impl TryFrom<Entry> for Camera {
    type Error = String;

    fn try_from(entry: Entry) -> Result<Self, String> {
        let Entry { width, height, .. } = entry;
        if entry.model.unwrap_or(Model::Erp) == Model::Erp {
            return match entry.fx.or(entry.fy) {
                Some(_) => Err("an ERP camera has no focal length".to_owned()),
                None => Ok(Self::Erp(ErpCamera { width, height })),
            };
        }
        let [Some(fx), Some(fy), Some(cx), Some(cy)] = [entry.fx, entry.fy, entry.cx, entry.cy]
        else {
            return Err("a pinhole camera needs fx, fy, cx and cy, in pixels".to_owned());
        };
        if width == 0 || height == 0 {
            return Err(format!("a pinhole camera of {width}x{height} pixels"));
        }
        if !(fx > 0.0 && fy > 0.0) {
            return Err(format!(
                "a pinhole camera with the focal lengths {fx} and {fy}, expected positive ones"
            ));
        }
        Ok(Self::Pinhole(PinholeCamera::new(
            [width, height],
            [fx, fy],
            [cx, cy],
        )))
    }
}

impl<'de> Deserialize<'de> for Camera {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let entry = Entry::deserialize(deserializer)?;
        Self::try_from(entry).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Camera, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_camera_without_a_model_is_erp() {
        let erp = Camera::Erp(ErpCamera::new(64, 32));
        assert_eq!(read(r#"{"width": 64, "height": 32}"#), Ok(erp));
        assert_eq!(
            read(r#"{"model": "erp", "width": 64, "height": 32}"#),
            Ok(erp)
        );
    }

    #[test]
    fn cameras_come_back_from_their_file() {
        let pinhole = Camera::Pinhole(PinholeCamera {
            width: 640,
            height: 360,
            fx: 502.3,
            fy: 501.9,
            cx: 320.25,
            cy: 179.0,
        });
        for camera in [pinhole, pinhole.resized(320, 180)] {
            let text = serde_json::to_string(&camera).map_err(|error| error.to_string());
            assert_eq!(text.and_then(|text| read(&text)), Ok(camera));
        }
    }

    #[test]
    fn what_is_no_camera_is_refused_with_the_reason() {
        for (text, expected) in [
            (
                r#"{"model": "pinhole", "width": 64, "height": 32}"#,
                "needs fx",
            ),
            (
                r#"{"model": "pinhole", "width": 64, "height": 32, "fx": -1, "fy": 1, "cx": 0, "cy": 0}"#,
                "positive",
            ),
            (
                r#"{"model": "pinhole", "width": 0, "height": 32, "fx": 1, "fy": 1, "cx": 0, "cy": 0}"#,
                "0x32",
            ),
            (
                r#"{"model": "erp", "width": 64, "height": 32, "fx": 1}"#,
                "no focal length",
            ),
            (
                r#"{"model": "fisheye", "width": 64, "height": 32}"#,
                "unknown variant",
            ),
        ] {
            let message = read(text).map_or_else(|error| error, |camera| format!("{camera:?}"));
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    #[test]
    fn a_resized_pinhole_sees_the_same() {
        let camera = Camera::Pinhole(PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1));
        let point = DVec3::new(0.3, -0.2, 1.7);
        let half = camera.resized(320, 180);
        let [pixel, of_half] = [camera, half].map(|camera| camera.project(point));
        let close = pixel
            .zip(of_half)
            .is_some_and(|(pixel, of_half)| (pixel / 2.0 - of_half).length() < 1e-12);
        assert!(close, "{pixel:?} {of_half:?}");
    }
}
