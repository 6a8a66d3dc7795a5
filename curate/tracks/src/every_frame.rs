//! Frames of a scene's video at its own rate, with poses between those of the samples.
//!
//! Detectors and trackers of video need its rate, and a scene keeps samples of it. Each frame of the video between the
//! first sample and the last is written for the time of the tracking, with an interpolated pose (`pose_interpolation`).
//! A frame is used if the sample nearest in time is: novel views of a split and the frames around them stay unseen.
//! Frames are numbered as in the video from 0, so that boxes of another program for the whole video fit them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::DQuat;
use omnilife_schemas::{
    Pose, RgbImage,
    camera::Camera,
    ground_plane::Plane,
    layout::{SEQUENCE_FILE, STRAIGHT_FRAMES_FOLDER},
    posed_view::PosedView,
    progress::Progress,
    records::{Detection, Scene, SceneFrame, Sequence, Tracks},
    staging::Staging,
    store::{self, StoreError},
};
use omnilife_video::{Converter, Scaling, VideoReader, probe};

use crate::{TrackRequest, distance::has_estimates, error::TracksError, pose_interpolation};

/// Name of the folder of the frames while they are needed.
const FOLDER: &str = "video-frames";
/// Timestamps closer than this are one, seconds.
const SAME_INSTANT_SECONDS: f64 = 1e-6;
/// Largest mean difference of a sample and its frame in the video, of 255.
const MOST_DIFFERENCE: f64 = 0.5;

/// Checks that the video of a request is that of the sequence beside the scene; returns its SHA-256, `None` without a
/// video.
///
/// # Errors
/// When the lens is taken out of the scene's frames, or there is no sequence beside the scene, or that of another
/// video.
pub(super) fn check_video(
    request: &TrackRequest,
    scene: &Scene,
) -> Result<Option<String>, TracksError> {
    let Some(video) = &request.options.video else {
        return Ok(None);
    };
    request.options.check_every_frame()?;
    let is_straight =
        |frame: &&SceneFrame| Path::new(&frame.image).starts_with(STRAIGHT_FRAMES_FOLDER);
    if let Some(frame) = scene.frames.iter().find(is_straight) {
        let reason = "--every-frame needs frames as the video has them; the lens is taken out of those of the scene";
        let image = request.scene_folder.join(&frame.image);
        return Err(TracksError::input(&image, reason));
    }
    let file = request.scene_folder.join(SEQUENCE_FILE);
    let sequence: Sequence = store::read_record(&file)?;
    let sha256 = store::sha256_file(video)?;
    if sequence.source.sha256 != sha256 {
        let reason = format!(
            "must be the video of {}, which is {} with the SHA-256 {}, got {sha256}",
            file.display(),
            sequence.source.file_name,
            sequence.source.sha256
        );
        return Err(TracksError::input(video, reason));
    }
    Ok(Some(sha256))
}

/// Samples of a scene that the frames of its video lie between.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples<'a> {
    pub(super) scene: &'a Scene,
    /// Usable samples, in order of time.
    pub(super) views: &'a [PosedView],
}

/// Every frame of a video, as a scene. Its images are removed on drop.
pub(super) struct EveryFrame {
    /// One frame for each of the video, in its order; those without a pose have no image.
    pub(super) scene: Scene,
    /// Usable frames.
    pub(super) views: Vec<PosedView>,
    /// Those of them that are samples.
    pub(super) sample_views: Vec<PosedView>,
    /// Evidence, for the record.
    pub(super) reason: String,
    /// Samples by their frames in the video.
    samples: BTreeMap<u32, u32>,
    _images: Staging,
}

impl EveryFrame {
    /// Decodes the video of a request and interpolates the poses of its frames; images go into a hidden folder of its
    /// output. Returns `None` without a video.
    ///
    /// # Errors
    /// When poses between the samples are wrong by more than the limit, or the video cannot be decoded or is not that
    /// of the samples.
    pub(super) fn of_request(
        request: &TrackRequest,
        samples: Samples<'_>,
        ground: Plane,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, TracksError> {
        let Some(video) = &request.options.video else {
            return Ok(None);
        };
        let refuse = |reason: String| TracksError::input(video, reason);
        if !matches!(samples.scene.camera, Camera::Pinhole(_)) {
            let reason = "--every-frame needs perspective frames, and the scene has panoramas";
            return Err(refuse(reason.to_owned()));
        }
        let evidence = pose_interpolation::check(samples.views, ground);
        let evidence = evidence.map_err(refuse)?;
        store::create_folder(&request.out)?;
        let images = Staging::new(&request.out, FOLDER)?;
        let folder = std::path::absolute(&images.folder)
            .map_err(|source| StoreError::read(&images.folder, source))?;
        progress.begin("frames of the video", None);
        let reading = Reading::new(samples, &request.scene_folder, folder);
        let read = reading.and_then(|reading| reading.run(video, progress));
        progress.end();
        let reading = read?;
        let scene = Scene {
            frames: reading.frames,
            ..samples.scene.clone()
        };
        let frames: Vec<u32> = (0..scene.frames.len() as u32).collect();
        let views = PosedView::of_scene(&scene, &frames);
        let of_sample = |view: &&PosedView| reading.samples.contains_key(&view.frame);
        let sample_views: Vec<PosedView> = views.iter().filter(of_sample).copied().collect();
        if let Some(missing) = samples.views.iter().find(|view| {
            let mut found = reading.samples.values();
            !found.any(|sample| *sample == view.frame)
        }) {
            return Err(refuse(format!(
                "must have the frame at {:.6} s of the scene, and has none at that time",
                missing.seconds
            )));
        }
        let left_out = if has_estimates(samples.scene, samples.views) {
            "; estimated distances of the samples are left out"
        } else {
            ""
        };
        let reason = format!(
            "{} of {} frames of the video, {} of them samples; {evidence}{left_out}",
            views.len(),
            scene.frames.len(),
            sample_views.len()
        );
        Ok(Some(Self {
            scene,
            views,
            sample_views,
            reason,
            samples: reading.samples,
            _images: images,
        }))
    }

    /// Returns tracks with the frame numbers of the scene. Boxes between the samples are left out; paths rest on them.
    pub(super) fn at_samples(&self, tracks: Tracks) -> Tracks {
        let renumbered = |one: Detection| {
            let frame = *self.samples.get(&one.frame)?;
            Some(Detection { frame, ..one })
        };
        Tracks {
            frames: (self.sample_views.iter())
                .filter_map(|view| self.samples.get(&view.frame).copied())
                .collect(),
            detections: tracks
                .detections
                .into_iter()
                .filter_map(renumbered)
                .collect(),
            ..tracks
        }
    }
}

/// A pass over a video.
struct Reading<'a> {
    given: Samples<'a>,
    scene_folder: &'a Path,
    /// Numbers of usable samples.
    usable: BTreeSet<u32>,
    /// Absolute path of the images, as records have it.
    folder: String,
    frames: Vec<SceneFrame>,
    samples: BTreeMap<u32, u32>,
}

impl<'a> Reading<'a> {
    fn new(
        given: Samples<'a>,
        scene_folder: &'a Path,
        folder: PathBuf,
    ) -> Result<Self, TracksError> {
        let folder = folder.into_os_string().into_string().map_err(|folder| {
            TracksError::input(Path::new(&folder), "must have a path that is UTF-8")
        })?;
        Ok(Self {
            given,
            scene_folder,
            usable: given.views.iter().map(|view| view.frame).collect(),
            folder,
            frames: Vec::new(),
            samples: BTreeMap::new(),
        })
    }

    /// Decodes the whole video, because its frames are counted.
    fn run(mut self, video: &Path, progress: &dyn Progress) -> Result<Self, TracksError> {
        let turns = probe(video)?.clockwise_quarter_turns();
        let [width, height] = self.given.scene.camera.size();
        let mut reader = VideoReader::open(video)?;
        let mut converter = Converter::new(Scaling::Native);
        while let Some(frame) = reader.next_frame()? {
            let number = self.frames.len() as u32;
            let mut entry = self.entry(number, frame.time_seconds);
            if entry.pose.is_some() {
                let image = converter.convert(video, &frame.image)?.turned(turns);
                let image = RgbImage::from_rgb8(image.width, image.height, &image.data)
                    .resized_by_area(width, height);
                if let Some(&sample) = self.samples.get(&number) {
                    self.compare(video, &image, sample)?;
                }
                image.write_png(Path::new(&entry.image))?;
            } else {
                entry.image = format!("{number:06}.png");
            }
            self.frames.push(entry);
            progress.advance(1);
        }
        Ok(self)
    }

    /// Returns a frame with its pose, if it is to be used; a sample is noted as such.
    fn entry(&mut self, number: u32, seconds: f64) -> SceneFrame {
        let nearest = self.nearest_sample(seconds);
        let usable = nearest.filter(|(sample, _)| self.usable.contains(sample));
        let pose = usable.and_then(|(sample, frame)| {
            if (frame.time_seconds - seconds).abs() <= SAME_INSTANT_SECONDS {
                self.samples.insert(number, sample);
                return frame.pose;
            }
            let view = pose_interpolation::between(self.given.views, seconds)?;
            let pose = Pose::new(DQuat::from_mat3(&view.to_world), view.centre);
            Some(pose).filter(Pose::is_valid)
        });
        let mask = usable.and_then(|(_, frame)| frame.ignore_mask.clone());
        SceneFrame {
            image: format!("{}/{number:06}.png", self.folder),
            time_seconds: seconds,
            capture: None,
            pose,
            mask: None,
            ignore_mask: mask,
            classes: BTreeMap::new(),
            objects: BTreeMap::new(),
            boxes: BTreeMap::new(),
            depth: None,
            depth_prior: None,
        }
    }

    /// Returns the sample that is nearest in time, usable or not, with its number.
    fn nearest_sample(&self, seconds: f64) -> Option<(u32, &'a SceneFrame)> {
        let apart = |frame: &SceneFrame| (frame.time_seconds - seconds).abs();
        let samples = (0..).zip(&self.given.scene.frames);
        samples.min_by(|(_, a), (_, b)| apart(a).total_cmp(&apart(b)))
    }

    /// Refuses a video whose frame differs from the sample: its poses would be those of another image.
    fn compare(&self, video: &Path, image: &RgbImage, sample: u32) -> Result<(), TracksError> {
        let Some(frame) = self.given.scene.frames.get(sample as usize) else {
            return Ok(());
        };
        let file = self.scene_folder.join(&frame.image);
        let [own, given] = [image.to_rgb8(), RgbImage::read(&file)?.to_rgb8()];
        let differences = own
            .iter()
            .zip(&given)
            .map(|(a, b)| f64::from(a.abs_diff(*b)));
        let mean = differences.sum::<f64>() / own.len().max(1) as f64;
        if own.len() == given.len() && mean <= MOST_DIFFERENCE {
            return Ok(());
        }
        let reason = format!(
            "must show {} at {:.6} s, and differs from it by {mean:.1} of 255 in the mean",
            file.display(),
            frame.time_seconds
        );
        Err(TracksError::input(video, reason))
    }
}
