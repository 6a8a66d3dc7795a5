//! Tracking of moving objects in a posed scene: from boxes in its images to paths in its world.
//!
//! Stages, each with its evidence in the record: a detector ([`detectors`]), the distance of each detection
//! ([`distance`], on the ground by [`rings`] or by [`alignment`] of estimates), the grouping by object
//! ([`association`]), its path ([`spline_fit`]), its heading and size ([`boxes`]). Objects that do not move remain part
//! of the static scene. For a hovering camera a plane replaces the scene (`hover`). [`dense`] measures points and
//! distances of scenes whose poses come with too few. [`exports`] writes tracks for traffic tools, with the place of the
//! scene on the Earth ([`georeference`]).
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod alignment;
pub mod appearance;
pub mod association;
pub mod boxes;
mod decisions;
pub mod dense;
pub mod detectors;
pub mod distance;
pub mod error;
mod every_frame;
pub mod exports;
pub mod georeference;
mod hover;
mod image_boxes;
pub mod options;
mod overlay;
mod page;
mod path;
mod pose_interpolation;
pub mod rings;
pub mod spline_fit;
pub mod stability;
mod vehicle_scale;

use std::path::{Path, PathBuf};

use glam::{DVec3, dvec2};
use omnilife_schemas::{
    elapsed::Stopwatch,
    ground_plane::Plane,
    layout::{SCENE_FILE, TRACKS_FILE},
    plain_text::counted,
    posed_view::{PosedView, frames_of},
    progress::Progress,
    records::{Detection, Scale, Scene, Track, TrackStage, Tracks},
    scene_points::ScenePoints,
    stage::StagePlan,
    store,
    trajectory::GroundAxes,
};

pub use decisions::{TracksPlan, plan_tracks};
pub use error::TracksError;
pub use options::TrackOptions;

use association::{Association, Sighting, deepsort};
use detectors::{Detector, DetectorInput};
use every_frame::{EveryFrame, Samples};
use image_boxes::{is_cut, middle, within_image};

/// The page for viewing, beside the tracks.
pub const PAGE_FILE: &str = "tracks.html";
/// The frames with overlaid detections and tracks, beside the tracks.
pub const OVERLAY_FILE: &str = "tracks.mp4";
const FILES: [&str; 3] = [TRACKS_FILE, PAGE_FILE, OVERLAY_FILE];

/// Input and options of tracking.
#[derive(Debug, Clone)]
pub struct TrackRequest {
    /// Folder of the scene.
    pub scene_folder: PathBuf,
    /// A split whose input views alone are used; all frames if `None`.
    pub split: Option<PathBuf>,
    /// Detector, distances and association.
    pub options: TrackOptions,
    /// Folder of the result.
    pub out: PathBuf,
}

/// Tracks moving objects in a scene; skipped, with a note, while nothing has changed.
///
/// # Errors
/// When the scene is missing, not posed or of unknown scale, boxes do not fit its frames, or a file
/// cannot be written.
pub fn make_tracks(request: &TrackRequest, progress: &dyn Progress) -> Result<Tracks, TracksError> {
    let asked = TrackInputs::read(request)?;
    let plan = asked.stage(request)?;
    let skipped = format!("{}: tracks unchanged, skipped", asked.scene.id);
    plan.make((TRACKS_FILE, &skipped), FILES, progress, |out| {
        let tracks = asked.track(request, progress)?;
        for (write, file) in [
            (page::write as WriteView, PAGE_FILE),
            (overlay::write, OVERLAY_FILE),
        ] {
            let path = out.path(file);
            write(
                &path,
                &request.scene_folder,
                &asked.scene,
                &asked.views,
                &tracks,
            )?;
            out.add_all(path.is_file().then_some(file));
        }
        Ok(tracks)
    })
}

/// Writes a view for people: to a path, from a scene's folder, the scene, its views and its tracks.
type WriteView = fn(&Path, &Path, &Scene, &[PosedView], &Tracks) -> Result<(), TracksError>;

/// A request with its inputs, read and checked.
struct TrackInputs {
    scene_path: PathBuf,
    scene: Scene,
    /// Numbers of the usable frames.
    frames: Vec<u32>,
    views: Vec<PosedView>,
    /// Metres per unit of the world, if stated.
    known_scale: Option<f64>,
    /// Points of static content.
    points: Option<ScenePoints>,
    /// SHA-256 of the video whose frames are all used.
    video_sha256: Option<String>,
}

impl TrackInputs {
    fn read(request: &TrackRequest) -> Result<Self, TracksError> {
        let scene_path = request.scene_folder.join(SCENE_FILE);
        let scene: Scene = store::read_record(&scene_path)?;
        let frames = frames_of(&scene, request.split.as_deref())?;
        let files = request.options.detector.check_files(&request.options);
        files.map_err(|reason| TracksError::input(&scene_path, reason))?;
        let views = PosedView::of_scene(&scene, &frames);
        distance::check_estimates(&scene_path, &scene, &views, request.options.distance)?;
        let known_scale = metres_per_unit(&scene_path, &scene, request.options.metres_per_unit)?;
        let beside = request.split.as_deref().and_then(Path::parent);
        let beside = beside.unwrap_or(&request.scene_folder);
        let points = ScenePoints::find(&scene, &request.scene_folder, beside)?;
        Ok(Self {
            video_sha256: every_frame::check_video(request, &scene)?,
            scene_path,
            scene,
            frames,
            views,
            known_scale,
            points,
        })
    }

    fn record(&self, request: &TrackRequest) -> PathBuf {
        request.out.join(TRACKS_FILE)
    }

    /// Lists everything that tracks depend on.
    fn stage(&self, request: &TrackRequest) -> Result<StagePlan, TracksError> {
        let mut plan = StagePlan::new(&request.out, "tracks")
            .with_file(&self.scene_path)?
            .with_text("detector", request.options.detector.id)
            .with_text("distance", request.options.distance.id())
            .with_text("association", request.options.association.id())
            .with_settings("frames", &self.frames)
            .with_settings("metres per unit", &self.known_scale);
        if let Some(file) = &request.options.detections {
            plan = plan.with_file(file)?;
        }
        if let Some(sha256) = &self.video_sha256 {
            plan = plan.with_hash("video", sha256.clone());
        }
        if let Some(file) = &request.options.program {
            plan = detectors::command::with_inputs(plan, file)?;
        }
        for &frame in &self.frames {
            if let Some(entry) = self.scene.frames.get(frame as usize) {
                let prior = entry.depth_prior.iter().map(|prior| &prior.file);
                let masks = entry.ignore_mask.iter();
                for file in std::iter::once(&entry.image).chain(masks).chain(prior) {
                    plan = plan.with_file(&request.scene_folder.join(file))?;
                }
            }
        }
        match &self.points {
            Some(points) => Ok(plan.with_file(&points.file)?),
            None => Ok(plan),
        }
    }

    /// Computes the tracks, without writing them.
    fn track(
        &self,
        request: &TrackRequest,
        progress: &dyn Progress,
    ) -> Result<Tracks, TracksError> {
        if request.options.association == Association::DeepSort {
            // Before the boxes are looked for whose appearance it compares.
            appearance::published_weights()?;
        }
        let points = self.points.as_ref();
        let (points, warnings) = hover::static_points(points, &self.scene, &self.views)?;
        let centres: Vec<DVec3> = self.views.iter().map(|view| view.centre).collect();
        let (plane, _) = Plane::dominant(&points, &centres).ok_or_else(|| {
            TracksError::input(
                &self.scene_path,
                "has too few points to find the ground by; poses from structure from motion bring them",
            )
        })?;
        let mut stages = Vec::new();
        let begun = Stopwatch::with_children();
        let samples = Samples {
            scene: &self.scene,
            views: &self.views,
        };
        let every = EveryFrame::of_request(request, samples, plane, progress)?;
        if let Some(every) = &every {
            stages.push(stage("frames", "every-frame", every.reason.clone(), begun));
        }
        let (scene, views, scale_views) = match &every {
            // Programs run once, on all frames.
            Some(every) if request.options.detector.keeps_files => {
                (&every.scene, &every.views, &every.views)
            }
            Some(every) => (&every.scene, &every.views, &every.sample_views),
            None => (&self.scene, &self.views, &self.views),
        };
        let mut input = DetectorInput {
            folder: &request.scene_folder,
            scene,
            views: scale_views,
            points: &points,
            ground: plane,
            metres_per_unit: self.known_scale.unwrap_or(1.0),
            file: request.options.detections.as_ref(),
            program: request.options.program.as_ref(),
            out: &request.out,
        };
        if self.known_scale.is_none() {
            let begun = Stopwatch::with_children();
            let (metres, evidence) = vehicle_scale::by_vehicles(
                &self.scene_path,
                plane,
                request.options.detector,
                &input,
                progress,
            )?;
            progress.note(&format!("{}: scale by vehicles: {evidence}", self.scene.id));
            stages.push(stage("scale", "vehicle-length", evidence, begun));
            input.metres_per_unit = metres;
        }
        input.views = views;
        let work = Tracking {
            scene,
            views,
            points: &points,
            plane,
            metres_per_unit: input.metres_per_unit,
            request,
            warnings,
        };
        let tracks = work.run(stages, request.options.detector, &input, progress)?;
        Ok(match &every {
            Some(every) => every.at_samples(tracks),
            None => tracks,
        })
    }
}

/// Returns metres per unit of the world, if stated.
fn metres_per_unit(
    path: &Path,
    scene: &Scene,
    given: Option<f64>,
) -> Result<Option<f64>, TracksError> {
    match (scene.scale, given) {
        (Scale::Metres, None) => Ok(Some(1.0)),
        (_, Some(metres)) if metres.is_finite() && metres > 0.0 => Ok(Some(metres)),
        (_, Some(metres)) => {
            let reason = format!("{metres} metres make no unit of the world");
            Err(TracksError::input(path, reason))
        }
        (Scale::Arbitrary, None) => Ok(None),
    }
}

/// Returns the record of a finished stage.
fn stage(stage: &str, method: &str, reason: String, begun: Stopwatch) -> TrackStage {
    TrackStage {
        stage: stage.to_owned(),
        method: method.to_owned(),
        reason,
        took: begun.elapsed(),
    }
}

struct Tracking<'a> {
    scene: &'a Scene,
    views: &'a [PosedView],
    points: &'a [DVec3],
    /// The ground of most of the scene.
    plane: Plane,
    metres_per_unit: f64,
    request: &'a TrackRequest,
    warnings: Vec<String>,
}

impl Tracking<'_> {
    fn run(
        self,
        mut stages: Vec<TrackStage>,
        detector: &Detector,
        input: &DetectorInput<'_>,
        progress: &dyn Progress,
    ) -> Result<Tracks, TracksError> {
        let plane = self.plane;
        let begun = Stopwatch::with_children();
        let detected = (detector.detect)(input, progress)?;
        let mut detections = detected.boxes;
        let found = format!("{} boxes in {} frames", detections.len(), self.views.len());
        let found = if detected.said.is_empty() {
            found
        } else {
            format!("{found}; {}", detected.said)
        };
        stages.push(stage(Tracks::DETECTOR_STAGE, detector.id, found, begun));
        let begun = Stopwatch::with_children();
        let lifted = self.lift(&mut detections, input, self.request.options.distance)?;
        stages.push(stage("distance", lifted.method.id(), lifted.reason, begun));
        let begun = Stopwatch::with_children();
        let association = self.request.options.association;
        let groups = match association {
            Association::DeepSort => {
                let (groups, said) = self.associate_by_appearance(&detections, input)?;
                stages.push(stage("appearance", association.id(), said, begun));
                groups
            }
            Association::GroundChains => self.associate(&detections, plane),
        };
        let in_groups: usize = groups.iter().map(Vec::len).sum();
        let reason = format!(
            "{} of {}; detections of no lasting object: {}",
            counted(groups.len(), "object"),
            counted(in_groups, "detection"),
            detections.len() - in_groups
        );
        stages.push(stage("association", association.id(), reason, begun));
        let begun = Stopwatch::with_children();
        let mut warnings = [self.warnings.clone(), lifted.warnings].concat();
        let told = warnings.len();
        let mut tracks: Vec<Track> = Vec::new();
        for group in groups {
            let id = tracks.len() as u32 + 1;
            match self.track(id, &group, &detections, plane, lifted.sigma) {
                Ok(track) => {
                    group
                        .iter()
                        .for_each(|&number| detections[number].track = Some(id));
                    tracks.push(track);
                }
                Err(reason) => warnings.push(reason),
            }
        }
        let filled: Vec<Detection> = tracks
            .iter()
            .flat_map(|track| self.filled(track, &detections, plane))
            .collect();
        let reason = format!(
            "{}, knots by BIC; {} left out; boxes in gaps: {}",
            counted(tracks.len(), "path"),
            counted(warnings.len() - told, "object"),
            filled.len()
        );
        detections.extend(filled);
        stages.push(stage("trajectory", "trajectory-spline", reason, begun));
        for warning in &warnings {
            progress.note(&format!("warning: {}: {warning}", self.scene.id));
        }
        Ok(Tracks {
            scene: self.scene.id.clone(),
            frames: self.views.iter().map(|view| view.frame).collect(),
            image_size: self.scene.camera.size().map(|side| side as u32),
            up: plane.normal.to_array(),
            metres_per_unit: self.metres_per_unit,
            stages,
            detections,
            tracks,
            warnings,
        })
    }

    fn view(&self, frame: u32) -> Option<&PosedView> {
        self.views.iter().find(|view| view.frame == frame)
    }

    /// Groups detections by object.
    fn associate(&self, detections: &[Detection], plane: Plane) -> Vec<Vec<usize>> {
        let axes = GroundAxes::new(plane.normal);
        let mut numbers = Vec::new();
        let mut sightings = Vec::new();
        let mut by_frame = Vec::new();
        for view in self.views {
            let first = sightings.len();
            for (number, detection) in detections.iter().enumerate() {
                if detection.frame == view.frame && detection.position.is_some() {
                    numbers.push(number);
                    sightings.push(self.sighting(view, detection, &axes));
                }
            }
            by_frame.push((first..sightings.len()).collect());
        }
        let groups = association::associate(&sightings, &by_frame);
        groups
            .into_iter()
            .map(|group| {
                group
                    .into_iter()
                    .map(|sighting| numbers[sighting])
                    .collect()
            })
            .collect()
    }

    /// Groups detections as `DeepSORT` does, and returns whether their appearance changed anything.
    fn associate_by_appearance(
        &self,
        detections: &[Detection],
        input: &DetectorInput<'_>,
    ) -> Result<(Vec<Vec<usize>>, String), TracksError> {
        // A detection without a place cannot belong to a path.
        let numbers: Vec<usize> = (0..detections.len())
            .filter(|&number| detections[number].position.is_some())
            .collect();
        let own: Vec<Detection> = numbers.iter().map(|&n| detections[n].clone()).collect();
        let boxes: Vec<[f64; 4]> = own.iter().map(|one| one.box_pixels).collect();
        let of_view = |view: &PosedView| -> Vec<usize> {
            (0..own.len())
                .filter(|&at| own[at].frame == view.frame)
                .collect()
        };
        let frames: Vec<Vec<usize>> = self.views.iter().map(of_view).collect();
        let embeddings = appearance::embeddings(input, &own)?;
        let without = deepsort::associate(&boxes, &frames, None);
        let with = deepsort::associate(&boxes, &frames, Some(&embeddings));
        let changed = association::changed(&without, &with, own.len());
        let (groups, said) = if changed == 0 {
            (without, "left out: it changes no assignment".to_owned())
        } else {
            let said = format!(
                "kept: it changes whom {changed} of {} boxes belong to",
                own.len()
            );
            (with, said)
        };
        let in_all = |group: Vec<usize>| group.into_iter().map(|at| numbers[at]).collect();
        Ok((groups.into_iter().map(in_all).collect(), said))
    }

    /// Returns a lifted detection as input of the association.
    fn sighting(&self, view: &PosedView, detection: &Detection, axes: &GroundAxes) -> Sighting {
        let position = detection.position.map_or(DVec3::ZERO, DVec3::from_array);
        let own = axes.to_world.transpose() * position;
        let [_, _, width, height] = detection.box_pixels;
        let steps = view
            .ray_steps(middle(detection.box_pixels))
            .map(DVec3::length);
        let distance = detection.distance.unwrap_or(0.0) * self.metres_per_unit;
        Sighting {
            seconds: view.seconds,
            place: dvec2(own.x, own.y) * self.metres_per_unit,
            size: (width * height * steps[0] * steps[1]).sqrt() * distance,
            is_cut: is_cut(view, detection.box_pixels),
        }
    }
}
