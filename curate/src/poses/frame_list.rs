//! Frames that poses and files are matched to: those of a sequence, or of a scene.

use std::path::Path;

use glam::dvec2;
use omnilife_schemas::{
    camera::{Camera, CameraModel, ErpCamera},
    layout::ANALYSIS_FILE,
    records::{FrameEntry, Scene, Sequence, VideoAnalysis},
    rgb::Mask,
    store,
};

use crate::sphere_layouts;

/// Largest time difference between a frame and its pose if the frame interval is unknown, seconds.
const LEAST_TOLERANCE_SECONDS: f64 = 1e-3;
/// Two cameras are equal if the image's corners differ by no more than this, pixels.
const LARGEST_SHIFT_PIXELS: f64 = 0.25;

/// Frames as readers of poses, masks and distances need them.
#[derive(Debug, Clone)]
pub(super) struct FrameList {
    /// Id of the sequence or scene.
    pub(super) id: String,
    /// Columns and rows of the images.
    pub(super) size: [u32; 2],
    /// Files and times, in order of time.
    pub(super) entries: Vec<FrameEntry>,
    /// True for perspective images.
    pub(super) is_pinhole: bool,
    /// The camera, if it is known before the poses are.
    pub(super) camera: Option<Camera>,
    /// Largest difference between the times of a frame and of its pose, seconds.
    pub(super) tolerance_seconds: f64,
    /// Directions that the video does not store.
    pub(super) unrecorded: Option<Mask>,
    /// Time stamp of the first frame of the whole video, seconds, if it is known.
    pub(super) video_begins: Option<f64>,
}

impl FrameList {
    /// Lists the frames of a sequence; their poses must lie within half the source's frame interval.
    pub(super) fn of_sequence(sequence: &Sequence) -> Self {
        let size = [sequence.frames.width, sequence.frames.height];
        let rate = sequence.probe.frames_per_second;
        Self {
            id: sequence.id.clone(),
            size,
            entries: sequence.frames.entries.clone(),
            is_pinhole: sequence.is_pinhole(),
            camera: None,
            tolerance_seconds: if rate > 0.0 {
                0.5 / rate
            } else {
                LEAST_TOLERANCE_SECONDS
            },
            unrecorded: unrecorded(sequence),
            video_begins: None,
        }
    }

    /// Adds the start of the video by the analysis beside the folder of its sequence. Without one, poses are not compared
    /// with it.
    pub(super) fn with_video_of(mut self, sequence_folder: &Path) -> Self {
        let analysis = sequence_folder
            .parent()
            .and_then(|video| store::read_record::<VideoAnalysis>(&video.join(ANALYSIS_FILE)).ok());
        self.video_begins = analysis.map(|analysis| analysis.range.begin_seconds);
        self
    }

    /// Lists the frames of a scene; their poses must lie within half the shortest interval between two frames.
    /// `sequence` is the source of the scene, if it has one.
    pub(super) fn of_scene(scene: &Scene, sequence: Option<&Sequence>) -> Self {
        let entries = scene.frames.iter().map(|frame| FrameEntry {
            file: frame.image.clone(),
            time_seconds: frame.time_seconds,
            capture: frame.capture.clone(),
        });
        let entries: Vec<FrameEntry> = entries.collect();
        let intervals = entries.array_windows().map(|[a, b]: &[FrameEntry; 2]| {
            let interval = b.time_seconds - a.time_seconds;
            if interval > 0.0 {
                interval
            } else {
                f64::INFINITY
            }
        });
        let shortest = intervals.fold(f64::INFINITY, f64::min);
        Self {
            id: scene.id.clone(),
            size: [scene.camera.width(), scene.camera.height()],
            entries,
            is_pinhole: matches!(scene.camera, Camera::Pinhole(_)),
            camera: Some(scene.camera),
            tolerance_seconds: if shortest.is_finite() {
                0.5 * shortest
            } else {
                LEAST_TOLERANCE_SECONDS
            },
            unrecorded: sequence.and_then(unrecorded),
            video_begins: None,
        }
    }

    /// Returns the camera of the frames from the one that their poses come with.
    ///
    /// # Errors
    /// The reason: frames and camera differ in projection (ERP or pinhole) or aspect ratio, or the frames have another
    /// camera already.
    pub(super) fn camera_with(&self, given: Option<Camera>) -> Result<Camera, String> {
        let ([width, height], id) = (self.size, &self.id);
        match (self.is_pinhole, given, self.camera) {
            (false, None | Some(Camera::Erp(_)), _) => Ok(ErpCamera { width, height }.into()),
            (false, Some(Camera::Pinhole(_)), _) => Err(format!(
                "has a pinhole camera, and the frames of {id} are ERP; --projection pinhole takes a video as \
                 an ordinary perspective one"
            )),
            (true, None, Some(known)) => Ok(known),
            (true, None, None) | (true, Some(Camera::Erp(_)), _) => Err(format!(
                "has no pinhole camera, and the frames of {id} are those of one: it needs a \"camera\" with \
                 \"model\": \"pinhole\", width, height, fx, fy, cx and cy"
            )),
            (true, Some(camera @ Camera::Pinhole(_)), known) => {
                // A row gained or lost by rounding keeps the aspect ratio.
                let rows =
                    f64::from(width) * f64::from(camera.height()) / f64::from(camera.width());
                if (rows - f64::from(height)).abs() > 1.0 {
                    return Err(format!(
                        "has a camera of {}x{} pixels, the frames of {id} are {width}x{height}: another shape",
                        camera.width(),
                        camera.height()
                    ));
                }
                let camera = camera.resized(width, height);
                match known {
                    Some(known) if !is_same(&known, &camera) => Err(format!(
                        "has another camera than the frames of {id}: {camera:?}, expected {known:?}"
                    )),
                    Some(known) => Ok(known),
                    None => Ok(camera),
                }
            }
        }
    }
}

/// Returns the directions that the video of a sequence does not store.
fn unrecorded(sequence: &Sequence) -> Option<Mask> {
    let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
    let layout = sequence.frames.converted_from?;
    sphere_layouts::unrecorded(layout, sequence.probe.upright_size(), size)
}

/// Returns true if two cameras of one size see the same at the corners of the image.
fn is_same(one: &Camera, other: &Camera) -> bool {
    let (width, height) = (f64::from(one.width()), f64::from(one.height()));
    [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
        .into_iter()
        .all(|(u, v)| {
            let corner = dvec2(u, v);
            let seen = one.project(other.unproject(corner));
            seen.is_some_and(|pixel| pixel.distance(corner) <= LARGEST_SHIFT_PIXELS)
        })
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    #[test]
    fn frames_keep_the_camera_that_they_have() {
        let pinhole = |f: f64| Camera::from(PinholeCamera::new([64, 32], [f, f], [32.0, 16.0]));
        let frames = |camera: Option<Camera>| FrameList {
            id: "walk".to_owned(),
            size: [64, 32],
            entries: Vec::new(),
            is_pinhole: true,
            camera,
            tolerance_seconds: 0.1,
            unrecorded: None,
            video_begins: None,
        };
        let known = frames(Some(pinhole(50.0)));
        assert_eq!(known.camera_with(None), Ok(pinhole(50.0)));
        // The corners move by 0.07 pixels, and by 0.7.
        assert_eq!(known.camera_with(Some(pinhole(50.1))), Ok(pinhole(50.0)));
        assert!(known.camera_with(Some(pinhole(51.0))).is_err());
        let erp = Camera::from(ErpCamera::new(64, 32));
        assert!(known.camera_with(Some(erp)).is_err());
        assert!(frames(None).camera_with(None).is_err());
        assert_eq!(
            frames(None).camera_with(Some(pinhole(51.0))),
            Ok(pinhole(51.0))
        );
    }
}
