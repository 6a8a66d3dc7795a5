//! Known data of a sequence's frames beside their cameras: distances, and masks of classes.
//!
//! Metrics need them: errors of depth, and scores within the masks of a class.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use image::{ImageBuffer, Luma};
use omnilife_schemas::{
    camera::Camera,
    image_file::ImageFile,
    layout::{CLASSES_FOLDER, DEPTH_FOLDER},
    mask_survey::{MaskSurvey, has_shape},
    plain_text,
    progress::Progress,
    records::{DepthImage, PoseConvention, SceneFrame},
    rgb,
    stage::StagePlan,
    staging::Staging,
    store,
};

use super::{
    frame_list::FrameList,
    ground_scale::GroundScale,
    ignored::{IgnoredPixels, IgnoredRegion},
    masks,
    planar_ground::PITCHES,
    prior::{GivenPrior, PriorFiles},
    refuse_missing,
    saturated::SaturatedFiles,
};
use crate::error::CurateError;

/// The user's files for a sequence's frames, named like the frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GivenTruth {
    /// Folder of masks, white for moving content, if poses are given; masks of a poses.json take precedence. Structure
    /// from motion has masks of its own.
    pub masks: Option<PathBuf>,
    /// Region outside the scene.
    pub ignored: Option<IgnoredRegion>,
    /// Distances.
    pub depth: Option<GivenDepth>,
    /// Folder of masks by the name of the class: white for its objects.
    pub classes: BTreeMap<String, PathBuf>,
    /// Depth priors, which methods may use and no score does.
    pub prior: Option<GivenPrior>,
    /// Known size of the world, if the poses do not give it.
    pub scale: Option<GroundScale>,
    /// Direction of the matrices, for poses that are given as matrices.
    pub pose_convention: Option<PoseConvention>,
    /// Mean angle below the horizon of a camera that hovers, degrees; it tilts the assumed ground.
    pub camera_pitch: Option<f64>,
}

/// Images of distances along the rays.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenDepth {
    /// Folder of 16-bit grey PNG files; 0 for an unknown distance.
    pub folder: PathBuf,
    /// Length of a step of 1 in the images, in units of the world frame.
    pub unit: f64,
}

/// [`GivenTruth`] with the file of every frame.
pub(super) struct TruthFiles {
    pub(super) ignored: IgnoredPixels,
    masks: Option<Vec<PathBuf>>,
    depth: Option<(Vec<PathBuf>, f64)>,
    classes: BTreeMap<String, Vec<PathBuf>>,
    prior: Option<PriorFiles>,
}

impl GivenTruth {
    /// Checks everything that needs no sequence.
    ///
    /// # Errors
    /// When a file or folder is missing, a class has a name other than a plain word, or a unit is not
    /// positive.
    pub fn check(&self) -> Result<(), CurateError> {
        let ignored = match &self.ignored {
            Some(IgnoredRegion::Masks(path)) => Some(path),
            _ => None,
        };
        let depth = self.depth.as_ref().map(|depth| &depth.folder);
        let prior = self.prior.as_ref().map(|prior| &prior.folder);
        let given = [self.masks.as_ref(), ignored, depth, prior];
        for path in given.into_iter().flatten().chain(self.classes.values()) {
            refuse_missing(path)?;
        }
        if let Some(depth) = &self.depth
            && !(depth.unit.is_finite() && depth.unit > 0.0)
        {
            let reason = format!("the unit of distances must be positive, got {}", depth.unit);
            return Err(CurateError::input(&depth.folder, reason));
        }
        let [least, most] = PITCHES;
        if let Some(pitch) = self
            .camera_pitch
            .filter(|pitch| !(least..=most).contains(pitch))
        {
            let reason =
                format!("must be {least} to {most} degrees below the horizon, got {pitch}");
            return Err(CurateError::input(Path::new("--camera-pitch"), reason));
        }
        self.classes
            .iter()
            .try_for_each(|(name, folder)| refuse_class(name, folder))
    }

    /// Finds the files.
    ///
    /// # Errors
    /// Those of [`Self::check`], and when a frame has none.
    pub(super) fn find(&self, frames: &FrameList) -> Result<TruthFiles, CurateError> {
        self.check()?;
        let entries = &frames.entries;
        let depth = match &self.depth {
            Some(depth) => Some((masks::find(&depth.folder, entries)?, depth.unit)),
            None => None,
        };
        let mut classes = BTreeMap::new();
        for (name, folder) in &self.classes {
            classes.insert(name.clone(), masks::find(folder, entries)?);
        }
        let prior = self.prior.as_ref();
        let prior = prior.map(|prior| prior.find(entries)).transpose()?;
        let masks = self.masks.as_ref();
        Ok(TruthFiles {
            ignored: IgnoredPixels::find(self.ignored.as_ref(), frames)?,
            masks: masks
                .map(|folder| masks::find(folder, entries))
                .transpose()?,
            depth,
            classes,
            prior,
        })
    }
}

/// Refuses a name of a class that is not a plain word.
fn refuse_class(name: &str, folder: &Path) -> Result<(), CurateError> {
    let is_word = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit();
    if !name.is_empty() && name.bytes().all(|byte| is_word(byte) || byte == b'-') {
        return Ok(());
    }
    let reason = format!("{name:?}: names of classes are lower-case letters, digits and hyphens");
    Err(CurateError::input(folder, reason))
}

impl TruthFiles {
    /// Returns true if there are images of anything except masks of moving content.
    pub(super) fn has_images(&self) -> bool {
        self.depth.is_some() || !self.classes.is_empty() || self.prior.is_some()
    }

    /// Adds masks of moving content, a file for every frame.
    pub(super) fn set_masks(&mut self, files: Vec<PathBuf>) {
        self.masks = Some(files);
    }

    /// Adds depth priors.
    pub(super) fn set_prior(&mut self, prior: PriorFiles) {
        self.prior = Some(prior);
    }

    /// Removes the distances and masks of classes of a frame that are to be replaced; returns their kinds, in words.
    pub(super) fn take_from(&self, frame: &mut SceneFrame) -> Vec<String> {
        let mut had = Vec::new();
        if self.depth.is_some() && frame.depth.take().is_some() {
            had.push("true distances".to_owned());
        }
        if self.prior.is_some() && frame.depth_prior.take().is_some() {
            had.push("estimated distances".to_owned());
        }
        for class in self.classes.keys() {
            if frame.classes.remove(class).is_some() {
                had.push(format!("masks of {class}"));
            }
        }
        had
    }

    /// Adds their dependencies to a plan.
    pub(super) fn add_inputs(&self, mut plan: StagePlan) -> Result<StagePlan, CurateError> {
        for file in self.masks.iter().flatten() {
            plan = plan.with_file(file)?;
        }
        plan = self.ignored.add_inputs(plan)?;
        if let Some((files, unit)) = &self.depth {
            plan = plan.with_settings("depth unit", unit);
            for file in files {
                plan = plan.with_file(file)?;
            }
        }
        for (name, files) in &self.classes {
            plan = plan.with_text("class", name);
            for file in files {
                plan = plan.with_file(file)?;
            }
        }
        match &self.prior {
            Some(prior) => prior.add_inputs(plan),
            None => Ok(plan),
        }
    }

    /// Returns the names of the classes with masks.
    pub(super) fn classes(&self) -> impl Iterator<Item = &str> {
        self.classes.keys().map(String::as_str)
    }

    /// Gives a mask to every frame that has none yet.
    pub(super) fn complete_masks(&self, masks: &mut [Option<PathBuf>]) {
        for (mask, given) in masks.iter_mut().zip(self.masks.iter().flatten()) {
            mask.get_or_insert_with(|| given.clone());
        }
    }

    /// Returns lines on assumptions about these masks and those of moving content, on ignore masks that look inverted,
    /// and on surplus files beside those of the frames.
    ///
    /// # Errors
    /// When a mask or a folder cannot be read.
    pub(super) fn notes(
        &self,
        moving: &[Option<PathBuf>],
        camera: &Camera,
    ) -> Result<Vec<String>, CurateError> {
        let mut survey = MaskSurvey::default();
        for file in moving.iter().flatten() {
            survey.add_moving(file, camera)?;
        }
        for (class, files) in &self.classes {
            for file in files {
                survey.add_of_class(class, file, camera)?;
            }
        }
        for file in self.ignored.given_files() {
            survey.add_ignored(file, camera)?;
        }
        let mut notes = survey.notes();
        notes.extend(self.surplus()?);
        Ok(notes)
    }

    /// Returns lines on files that belong to no frame.
    fn surplus(&self) -> Result<Vec<String>, CurateError> {
        let depth = self.depth.iter().flat_map(|(files, _)| files);
        let prior = self.prior.iter().flat_map(PriorFiles::files);
        let mut kinds: Vec<(String, Vec<&PathBuf>)> = vec![
            ("masks".to_owned(), self.masks.iter().flatten().collect()),
            (
                "ignore masks".to_owned(),
                self.ignored.files_of_frames().iter().collect(),
            ),
            ("distances".to_owned(), depth.collect()),
            ("distances of the prior".to_owned(), prior.collect()),
        ];
        for (class, files) in &self.classes {
            kinds.push((format!("masks of {class}"), files.iter().collect()));
        }
        let mut lines = Vec::new();
        for (what, files) in kinds {
            let files: Vec<&Path> = files.into_iter().map(PathBuf::as_path).collect();
            lines.extend(masks::surplus(&files, &what)?);
        }
        Ok(lines)
    }

    /// Stages them at the size of the frames, by nearest pixels, and enters them in the frames of a scene.
    ///
    /// # Errors
    /// When an image is not usable, or a file cannot be written.
    pub(super) fn stage(
        &self,
        staging: &mut Staging,
        sequence_folder: &Path,
        frames: &mut [SceneFrame],
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        if let Some(prior) = &self.prior {
            prior.stage(staging, sequence_folder, frames, size, progress)?;
        }
        let depth_files = self.depth.iter().flat_map(|(files, _)| files);
        refuse_own(depth_files, &sequence_folder.join(DEPTH_FOLDER))?;
        let class_files = self.classes.values().flatten();
        refuse_own(class_files, &sequence_folder.join(CLASSES_FOLDER))?;
        if let Some((files, unit)) = &self.depth {
            let (mut unknown, mut saturated) = (Vec::new(), SaturatedFiles::new(*unit));
            let (mut before, mut repeated) = (Vec::new(), Vec::new());
            for ((number, source), frame) in files.iter().enumerate().zip(frames.iter_mut()) {
                let file = format!("{DEPTH_FOLDER}/{number:06}.png");
                let values = write_depth(source, size, &staging.begin(&file)?)?;
                if values.iter().all(|&value| value == 0) {
                    unknown.push(source.as_path());
                }
                saturated.add(source, values.iter().map(|&value| value == u16::MAX));
                if values == before {
                    repeated.push(source.display().to_string());
                }
                before = values;
                frame.depth = Some(DepthImage { file, unit: *unit });
            }
            tell_unknown_distances(&unknown, files.len(), progress)?;
            if !repeated.is_empty() {
                progress.note(&format!(
                    "{} of {} files of distances repeat the one before them, as of a camera that stands: {}",
                    repeated.len(),
                    files.len(),
                    plain_text::first_of(&repeated)
                ));
            }
            saturated.report(progress);
        }
        for (class, files) in &self.classes {
            for ((number, source), frame) in files.iter().enumerate().zip(frames.iter_mut()) {
                let file = format!("{CLASSES_FOLDER}/{class}/{number:06}.png");
                let mask = rgb::Mask::read(source)?.resized_to_nearest(size[0], size[1]);
                mask.write_png(&staging.begin(&file)?)?;
                frame.classes.insert(class.clone(), file);
            }
        }
        Ok(())
    }
}

/// Refuses files that lie in the folder of staged ones.
pub(super) fn refuse_own<'a>(
    files: impl Iterator<Item = &'a PathBuf>,
    folder: &Path,
) -> Result<(), CurateError> {
    let Ok(folder) = fs::canonicalize(folder) else {
        return Ok(());
    };
    for file in files {
        if fs::canonicalize(file).is_ok_and(|file| file.starts_with(&folder)) {
            let reason =
                "lies in the folder that the sequence's own files go to; keep it elsewhere";
            return Err(CurateError::input(file, reason.to_owned()));
        }
    }
    Ok(())
}

/// Reports which of `all` files of distances hold none, such as those of a sky.
///
/// # Errors
/// When none of them holds any.
fn tell_unknown_distances(
    unknown: &[&Path],
    all: usize,
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    let Some(first) = unknown.first() else {
        return Ok(());
    };
    if unknown.len() == all {
        let reason = format!("holds no distance, nor does any other of {all} files: all are 0");
        return Err(CurateError::input(first, reason));
    }
    progress.note(&format!(
        "{} of {all} files of distances hold none, such as {}",
        unknown.len(),
        first.display()
    ));
    Ok(())
}

/// Writes the values of an image at a size; returns those of the image itself, of which 0 is an unknown distance.
fn write_depth(source: &Path, size: [usize; 2], path: &Path) -> Result<Vec<u16>, CurateError> {
    let malformed = |reason: String| CurateError::input(source, reason);
    let image = ImageFile::open(source)?;
    let given = image.size();
    if !has_shape(given, size) {
        return Err(malformed(format!(
            "must have the shape of the frames, {}x{}, got {}x{} pixels",
            size[0], size[1], given[0], given[1]
        )));
    }
    let values = image.decode_grey16()?;
    let nearest = rgb::nearest_pixels(given, size).map(|index| values[index]);
    let resized: Option<ImageBuffer<Luma<u16>, Vec<u16>>> =
        ImageBuffer::from_raw(size[0] as u32, size[1] as u32, nearest.collect());
    let resized = resized.ok_or_else(|| malformed("has no pixels".to_owned()))?;
    let mut png = std::io::Cursor::new(Vec::new());
    resized
        .write_to(&mut png, image::ImageFormat::Png)
        .map_err(|error| malformed(format!("cannot be written as PNG: {error}")))?;
    store::write_bytes(path, png.get_ref())?;
    Ok(values)
}
