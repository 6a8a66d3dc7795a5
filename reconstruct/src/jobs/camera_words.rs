//! Cameras by words: around a middle, towards a point or an object, from above, in one place, along a file's path.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec3};
use omnilife_engine::camera::Camera;
use omnilife_schemas::{
    Pose,
    statistics::{median, quantile},
    trajectory::GroundAxes,
};
use omnilife_training::{error::ReconstructError, models::OpenedModel};

use super::camera_path::{PlacedFrame, read_path};

/// Share of cameras and points, by their horizontal distance from the middle, that a view from above shows.
const SHOWN_SHARE: f64 = 0.9;
/// Smallest sine of the angle between two directions that makes them different.
const LEAST_SINE: f64 = 1e-6;

/// Cameras of a rendering; by default those of the poses.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraWords {
    /// Places of the cameras.
    pub places: CameraPlaces,
    /// Target of all cameras; by default the middle of the scene for [`CameraPlaces::Orbit`] and
    /// [`CameraPlaces::FromAbove`].
    pub target: Option<LookAt>,
    /// Direction up in the world; by default that of the model's objects, else the mean of the cameras'.
    pub up: Option<[f64; 3]>,
    /// Split whose input views count as seen; all frames of the poses without one.
    pub split: Option<PathBuf>,
}

/// Places of cameras.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum CameraPlaces {
    /// Those of the poses.
    #[default]
    OfPoses,
    /// That of the frame with this number alone, at its time.
    Frame(usize),
    /// A circle around the target over so many degrees, at the median distance and height of the poses' cameras.
    Orbit(f64),
    /// Above the target, with the image's upper edge where the poses' cameras look.
    FromAbove,
    /// The camera of the frame with this number, while time goes on.
    Stationary(usize),
    /// The poses and times of a file ([`read_path`]).
    Path(PathBuf),
}

/// Target of cameras.
#[derive(Debug, Clone, PartialEq)]
pub enum LookAt {
    /// World point.
    Point([f64; 3]),
    /// Id of an object of the model.
    Object(String),
}

impl CameraWords {
    /// Returns true where the cameras are those of the poses, all or one.
    pub fn are_of_poses(&self) -> bool {
        let is_given = matches!(self.places, CameraPlaces::OfPoses | CameraPlaces::Frame(_));
        is_given && self.target.is_none()
    }
}

impl fmt::Display for CameraWords {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.places {
            CameraPlaces::OfPoses => write!(formatter, "poses"),
            CameraPlaces::Frame(frame) => write!(formatter, "frame {frame}"),
            CameraPlaces::Orbit(degrees) => write!(formatter, "orbit {degrees}"),
            CameraPlaces::FromAbove => write!(formatter, "from above"),
            CameraPlaces::Stationary(frame) => write!(formatter, "stationary {frame}"),
            CameraPlaces::Path(file) => {
                let name = file.file_name().unwrap_or_default();
                write!(formatter, "path {}", name.to_string_lossy())
            }
        }?;
        match &self.target {
            None => Ok(()),
            Some(LookAt::Point([x, y, z])) => write!(formatter, ", look at {x},{y},{z}"),
            Some(LookAt::Object(id)) => write!(formatter, ", look at object {id}"),
        }
    }
}

/// Returns the posed frames of a file with `count` frames, or the one that is asked for.
///
/// # Errors
/// When there is no such frame, or it has no pose: one line.
pub(super) fn of_poses(
    places: &CameraPlaces,
    file: &Path,
    count: usize,
    posed: &[PlacedFrame],
) -> Result<Vec<PlacedFrame>, ReconstructError> {
    let CameraPlaces::Frame(number) = *places else {
        return Ok(posed.to_vec());
    };
    let found = posed.iter().find(|frame| frame.number == number);
    let found = found.ok_or_else(|| {
        let last = count.saturating_sub(1);
        let reason = if number > last {
            format!("has no frame {number}: there are 0 to {last}")
        } else {
            format!("frame {number} has no usable pose")
        };
        ReconstructError::scene(file, reason)
    });
    Ok(vec![*found?])
}

/// Scene that words refer to.
pub(super) struct SceneContext<'a> {
    pub(super) file: &'a Path,
    /// Times of all frames, seconds.
    pub(super) seconds: &'a [f64],
    /// Its posed frames, one at least.
    pub(super) posed: &'a [PlacedFrame],
    /// Its points; may be empty.
    pub(super) points: &'a [DVec3],
    /// Camera of the rendered images.
    pub(super) camera: Camera,
    /// Camera of the poses, where their file has one.
    pub(super) posed_camera: Option<Camera>,
}

impl SceneContext<'_> {
    /// Returns the frames to render.
    ///
    /// # Errors
    /// When the words do not suit the scene or the model: one line.
    pub(super) fn frames(
        &self,
        words: &CameraWords,
        model: &dyn OpenedModel,
    ) -> Result<Vec<PlacedFrame>, ReconstructError> {
        match &words.places {
            CameraPlaces::OfPoses | CameraPlaces::Frame(_) | CameraPlaces::Stationary(_) => {
                let frames = match &words.places {
                    CameraPlaces::Stationary(number) => self.in_place_of(*number)?,
                    places => of_poses(places, self.file, self.seconds.len(), self.posed)?,
                };
                match &words.target {
                    None => Ok(frames),
                    Some(_) => self.turned(frames, words, model),
                }
            }
            CameraPlaces::Path(file) => {
                let rows = read_path(file)?.into_iter().enumerate();
                Ok(rows
                    .map(|(number, (seconds, pose))| PlacedFrame {
                        number,
                        seconds,
                        pose,
                    })
                    .collect())
            }
            CameraPlaces::Orbit(degrees) => self.orbit(*degrees, words, model),
            CameraPlaces::FromAbove => self.above(words, model),
        }
    }

    fn refused(&self, reason: impl Into<String>) -> ReconstructError {
        ReconstructError::scene(self.file, reason)
    }

    /// Returns all frames with the pose of one.
    fn in_place_of(&self, number: usize) -> Result<Vec<PlacedFrame>, ReconstructError> {
        let of_frame = CameraPlaces::Frame(number);
        let found = of_poses(&of_frame, self.file, self.seconds.len(), self.posed)?;
        let poses: Vec<Pose> = found.iter().map(|frame| frame.pose).collect();
        Ok(poses
            .first()
            .map_or_else(Vec::new, |pose| self.moments(|_| *pose)))
    }

    /// Returns a frame for each time of the scene.
    fn moments(&self, pose: impl Fn(usize) -> Pose) -> Vec<PlacedFrame> {
        let times = self.seconds.iter().enumerate();
        times
            .map(|(number, &seconds)| PlacedFrame {
                number,
                seconds,
                pose: pose(number),
            })
            .collect()
    }

    /// Returns frames turned towards the target.
    fn turned(
        &self,
        frames: Vec<PlacedFrame>,
        words: &CameraWords,
        model: &dyn OpenedModel,
    ) -> Result<Vec<PlacedFrame>, ReconstructError> {
        let seconds: Vec<f64> = frames.iter().map(|frame| frame.seconds).collect();
        let targets = self.targets(words, model, &seconds)?;
        self.towards(frames, &targets, self.up(words, model)?)
    }

    /// Returns frames turned towards a target each.
    fn towards(
        &self,
        mut frames: Vec<PlacedFrame>,
        targets: &[DVec3],
        up: DVec3,
    ) -> Result<Vec<PlacedFrame>, ReconstructError> {
        for (frame, target) in frames.iter_mut().zip(targets) {
            let turned = looking_at(frame.pose.centre(), *target, up);
            frame.pose = turned.ok_or_else(|| {
                self.refused(format!(
                    "the camera of frame {} stands at its target",
                    frame.number
                ))
            })?;
        }
        Ok(frames)
    }

    fn orbit(
        &self,
        degrees: f64,
        words: &CameraWords,
        model: &dyn OpenedModel,
    ) -> Result<Vec<PlacedFrame>, ReconstructError> {
        let axes = GroundAxes::new(self.up(words, model)?);
        let up = axes.to_world.z_axis;
        let offsets = self.offsets(words, model)?;
        let along = |offset: DVec3| offset - up * offset.dot(up);
        let radii: Vec<f64> = offsets
            .iter()
            .map(|&offset| along(offset).length())
            .collect();
        let heights: Vec<f64> = offsets.iter().map(|&offset| offset.dot(up)).collect();
        let (radius, height) = (median(&radii), median(&heights));
        let (radius, height) = (radius.unwrap_or(0.0), height.unwrap_or(0.0));
        if radius <= LEAST_SINE * height.abs() || !radius.is_normal() {
            return Err(self.refused(
                "the cameras are at the middle or straight above it: --look-at says what to go around",
            ));
        }
        let begin = offsets.first().map_or(0.0, |&offset| axes.heading(offset));
        let count = self.seconds.len();
        // Whole turns end one step before their beginning, an arc at its end.
        let steps = if degrees.abs() >= 360.0 && degrees % 360.0 == 0.0 {
            count
        } else {
            count.saturating_sub(1)
        };
        let targets = self.targets(words, model, self.seconds)?;
        let on_circle = self.moments(|number| {
            let share = number as f64 / steps.max(1) as f64;
            let angle = begin + degrees.to_radians() * share;
            let offset = radius * (axes.rotation(angle) * DVec3::X) + height * up;
            Pose::new(DQuat::IDENTITY, targets[number] + offset)
        });
        self.towards(on_circle, &targets, up)
    }

    fn above(
        &self,
        words: &CameraWords,
        model: &dyn OpenedModel,
    ) -> Result<Vec<PlacedFrame>, ReconstructError> {
        let up = self.up(words, model)?;
        let height = match words.target {
            Some(_) => {
                let offsets = self.offsets(words, model)?;
                let distances: Vec<f64> = offsets.iter().map(|offset| offset.length()).collect();
                median(&distances).unwrap_or(0.0)
            }
            None => self.radius(self.middle()?, up) / half_view(&self.camera),
        };
        if !height.is_normal() || height < 0.0 {
            return Err(self.refused(
                "the cameras and points are in one place: there is no height to look from",
            ));
        }
        let targets = self.targets(words, model, self.seconds)?;
        let forward = self.forward(up);
        let rotation = DMat3::from_cols(forward.cross(up), -forward, -up);
        let rotation = DQuat::from_mat3(&rotation);
        Ok(self.moments(|number| Pose::new(rotation, targets[number] + height * up)))
    }

    /// Returns the targets at some times.
    fn targets(
        &self,
        words: &CameraWords,
        model: &dyn OpenedModel,
        seconds: &[f64],
    ) -> Result<Vec<DVec3>, ReconstructError> {
        match &words.target {
            Some(LookAt::Point(point)) => Ok(vec![DVec3::from_array(*point); seconds.len()]),
            Some(LookAt::Object(id)) => model.object_centres(id, seconds),
            None => Ok(vec![self.middle()?; seconds.len()]),
        }
    }

    /// Returns the offsets of the posed cameras from the target at their times.
    fn offsets(
        &self,
        words: &CameraWords,
        model: &dyn OpenedModel,
    ) -> Result<Vec<DVec3>, ReconstructError> {
        let seconds: Vec<f64> = self.posed.iter().map(|frame| frame.seconds).collect();
        let targets = self.targets(words, model, &seconds)?;
        let pairs = self.posed.iter().zip(targets);
        Ok(pairs
            .map(|(frame, target)| frame.pose.centre() - target)
            .collect())
    }

    /// Returns the middle of the scene: the median of its points along each axis, or without points the place
    /// nearest to the viewing directions of perspective cameras.
    fn middle(&self) -> Result<DVec3, ReconstructError> {
        let along = |axis: usize| {
            let coordinates: Vec<f64> = self.points.iter().map(|point| point[axis]).collect();
            median(&coordinates)
        };
        if let (Some(x), Some(y), Some(z)) = (along(0), along(1), along(2)) {
            return Ok(DVec3::new(x, y, z));
        }
        self.met().ok_or_else(|| {
            self.refused("has no points to take a middle of: --look-at X,Y,Z says where to look")
        })
    }

    /// Returns the place nearest to all viewing directions by least squares; `None` for parallel ones and panoramas.
    fn met(&self) -> Option<DVec3> {
        // Panoramas look everywhere, whatever is rendered in their places.
        if !matches!(self.posed_camera, Some(Camera::Pinhole(_))) {
            return None;
        }
        let (mut sum, mut moved) = (DMat3::ZERO, DVec3::ZERO);
        for frame in self.posed {
            let ray = frame.pose.rotation()? * DVec3::Z;
            let outer = DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
            let across = DMat3::IDENTITY - outer;
            sum += across;
            moved += across * frame.pose.centre();
        }
        let count = self.posed.len() as f64;
        let is_parallel = (sum * (1.0 / count)).determinant() < 1e-4;
        let met = sum.inverse() * moved;
        (!is_parallel && met.is_finite()).then_some(met)
    }

    /// Returns the unit vector up.
    fn up(&self, words: &CameraWords, model: &dyn OpenedModel) -> Result<DVec3, ReconstructError> {
        let up = match (words.up, model.up()?) {
            (Some(up), _) => DVec3::from_array(up).try_normalize(),
            (None, Some(up)) => Some(up),
            (None, None) => {
                let rotations = self.posed.iter().filter_map(|frame| frame.pose.rotation());
                let sum: DVec3 = rotations.map(|rotation| rotation * DVec3::NEG_Y).sum();
                let has_one = sum.length() > 1e-3 * self.posed.len() as f64;
                has_one.then(|| sum.normalize())
            }
        };
        up.ok_or_else(|| self.refused("has no common direction up: --up X,Y,Z says which it is"))
    }

    /// Returns the mean horizontal viewing direction of the cameras; that of their path, or an axis of the ground,
    /// where they have none.
    fn forward(&self, up: DVec3) -> DVec3 {
        let along = |direction: DVec3| {
            let flat = direction - up * direction.dot(up);
            (flat.length() > 1e-3 * direction.length())
                .then(|| flat.try_normalize())
                .flatten()
        };
        let rotations = self.posed.iter().filter_map(|frame| frame.pose.rotation());
        let looked: DVec3 = rotations.map(|rotation| rotation * DVec3::Z).sum();
        let ends = self.posed.first().zip(self.posed.last());
        let path = ends.map(|(first, last)| last.pose.centre() - first.pose.centre());
        along(looked)
            .or_else(|| path.and_then(along))
            .unwrap_or(GroundAxes::new(up).to_world.x_axis)
    }

    /// Returns the horizontal distance from the middle within which most cameras and points are.
    fn radius(&self, middle: DVec3, up: DVec3) -> f64 {
        let centres = self.posed.iter().map(|frame| frame.pose.centre());
        let places = centres.chain(self.points.iter().copied());
        let distances: Vec<f64> = places
            .map(|place| up.cross(place - middle).length())
            .collect();
        quantile(&distances, SHOWN_SHARE).unwrap_or(0.0)
    }
}

/// Returns the tangent of half the smaller field of view; 1 for panoramas.
fn half_view(camera: &Camera) -> f64 {
    match camera {
        Camera::Erp(_) => 1.0,
        Camera::Pinhole(camera) => {
            let across = 0.5 * f64::from(camera.width) / camera.fx;
            across.min(0.5 * f64::from(camera.height) / camera.fy)
        }
    }
}

/// Returns the pose of an upright camera that looks at a target; `None` where it stands there.
fn looking_at(centre: DVec3, target: DVec3, up: DVec3) -> Option<Pose> {
    let forward = (target - centre).try_normalize()?;
    let right = forward.cross(up);
    let right = if right.length() > LEAST_SINE {
        right
    } else {
        // Straight up or down: the ground's first axis is to the right.
        GroundAxes::new(up).to_world.x_axis
    };
    let right = right.normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward);
    Some(Pose::new(DQuat::from_mat3(&rotation), centre))
}

#[cfg(test)]
mod tests;
