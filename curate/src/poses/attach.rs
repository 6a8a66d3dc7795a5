//! Files attached to a scene of any origin: masks, distances, and poses if it has none.
//!
//! A scene made by `curate poses` keeps its done-record. Any other, such as an imported one, gets a record of the files
//! that it names, so that later attachments replace earlier ones.

use std::{
    collections::BTreeSet,
    mem,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{POINTS_FILE, SCENE_FILE, SEQUENCE_FILE},
    lock::FolderLock,
    mask_survey::{is_of_class, is_of_ignored, is_of_moving},
    ownership::{OwnFile, OwnFiles},
    plain_text,
    progress::Progress,
    records::{Scene, Sequence},
    stage::StagePlan,
    staging::Staging,
    store,
};

use super::{
    GivenTruth, PosedSequence, STAGE, check_given, files_named_by,
    frame_list::FrameList,
    frame_programs::{FramePrograms, ProgramOutputs, source_of_program},
    given, masks,
    truth::TruthFiles,
};
use crate::error::CurateError;

/// Name of the stage that keeps the files of scenes not made by `curate poses`.
const OWN_STAGE: &str = "attach";

/// Start of the line on the program that made the masks.
const MASKS_BY: &str = "masks of what moves are by ";

/// Files and programs of a request to attach.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AttachRequest {
    /// Poses for a scene that has none, in any form of [`PoseRequest::Given`](super::PoseRequest::Given).
    pub poses: Option<PathBuf>,
    /// Masks and distances.
    pub given: GivenTruth,
    /// Programs that make missing files.
    pub programs: FramePrograms,
}

/// Attaches files to the scene in a folder: masks, distances, and poses if no frame has one. Files of the same kind are
/// replaced, with a note; images, times and poses stay. Returns the scene.
///
/// # Errors
/// When nothing is given, a posed scene is given poses, a program fails, or the scene or a file cannot be read. Also
/// when a frame lacks its file, a file does not fit the frames, or a foreign file would be replaced. Nothing has
/// changed then.
pub fn attach(
    folder: &Path,
    request: &AttachRequest,
    progress: &dyn Progress,
) -> Result<Scene, CurateError> {
    let _lock = FolderLock::take_existing(folder, progress)?;
    let scene_path = folder.join(SCENE_FILE);
    let scene: Scene = store::read_record(&scene_path)?;
    let sequence_path = folder.join(SEQUENCE_FILE);
    let sequence: Option<Sequence> = match sequence_path.is_file() {
        true => Some(store::read_record(&sequence_path)?),
        false => None,
    };
    let mut frames = FrameList::of_scene(&scene, sequence.as_ref());
    if sequence.is_some() {
        frames = frames.with_video_of(folder);
    }
    let gets_poses = request.poses.is_some() || request.programs.poses.is_some();
    if gets_poses {
        refuse_posed(&scene_path, &scene)?;
    }
    // Before a program runs for hours.
    let files = request.given.find(&frames)?;
    let mut staging = Staging::new(folder, "attached")?;
    let made = (request.programs).run((folder, &scene), &frames, &staging, progress)?;
    let attachment = Attachment::of((&scene_path, &scene), request, &frames, files, &made)?;
    let (bare, replaced) = attachment.without_earlier(&scene);
    let attached = attachment.stage(&mut staging, folder, bare.clone(), progress)?;
    let target = Target::of(folder, &scene)?;
    target.refuse_foreign(&staging)?;
    for what in &replaced {
        progress.note(&format!("{}: its {what} are replaced", scene.id));
    }
    target.adopt()?;
    if !replaced.is_empty() {
        // A process killed while files change must not leave a scene that takes new files for old ones.
        store::write_record(&scene_path, &bare)?;
    }
    let mut outputs = target.plan.publish(&staging.folder, &staging.files)?;
    outputs.push(OwnFile {
        file: SCENE_FILE.to_owned(),
        sha256: Some(store::write_record_hashed(&scene_path, &attached)?),
    });
    let named = files_named_by(&attached);
    let before = files_named_by(&scene);
    let is_gone = |file: &str| {
        let file = file.to_owned();
        before.contains(&file) && !named.contains(&file)
    };
    target.plan.own_files().remove(is_gone)?;
    target.plan.amend(outputs, is_gone)?;
    Ok(attached)
}

fn refuse_posed(scene_path: &Path, scene: &Scene) -> Result<(), CurateError> {
    let known = scene.frames.iter().filter(|frame| frame.pose.is_some());
    match known.count() {
        0 => Ok(()),
        known => {
            let reason = format!(
                "has poses of {known} of {} frames, and poses are attached to a scene that has none",
                scene.frames.len()
            );
            Err(CurateError::input(scene_path, reason))
        }
    }
}

fn new_poses(
    path: &Path,
    given: &GivenTruth,
    frames: &FrameList,
) -> Result<PosedSequence, CurateError> {
    let mut posed = given::read(path, given.pose_convention, frames)?;
    if posed.camera.lens().is_some() {
        let reason =
            "has a camera with a lens, which would have to be taken out of the scene's frames";
        return Err(CurateError::input(path, reason));
    }
    if let Some(scale) = given.scale {
        let scaled = scale.apply(&mut posed);
        scaled.map_err(|reason| CurateError::input(path, reason))?;
    }
    Ok(posed)
}

/// Reads given poses, or those that a program left.
fn poses_of(
    request: &AttachRequest,
    frames: &FrameList,
    made: &ProgramOutputs,
) -> Result<Option<PosedSequence>, CurateError> {
    let given = &request.given;
    match (&request.poses, &made.poses) {
        (Some(path), _) => new_poses(path, given, frames).map(Some),
        (None, Some((path, command))) => {
            let mut posed = new_poses(path, given, &made.frames)?;
            posed.source = source_of_program(posed.source, plain_text::without_folders(command));
            Ok(Some(posed))
        }
        (None, None) => Ok(None),
    }
}

/// Attached files, found and checked.
struct Attachment {
    /// True with ignore masks in the request; `files` always has the directions that the video does not store.
    has_ignored: bool,
    files: TruthFiles,
    posed: Option<PosedSequence>,
    /// Lines on the makers of masks, and on assumptions about these.
    notes: Vec<String>,
    /// The mask of moving content of every frame that gets one.
    moving: Vec<Option<PathBuf>>,
}

impl Attachment {
    /// Adds the output of programs to the given files, and checks all of it.
    fn of(
        (scene_path, scene): (&Path, &Scene),
        request: &AttachRequest,
        frames: &FrameList,
        mut files: TruthFiles,
        made: &ProgramOutputs,
    ) -> Result<Self, CurateError> {
        let mut posed = poses_of(request, frames, made)?;
        if let Some(posed) = &mut posed {
            let folder = scene_path.parent().unwrap_or(Path::new("."));
            check_given(folder, frames, posed)?;
        }
        let mut notes = Vec::new();
        if let Some((folder, command)) = &made.masks {
            files.set_masks(masks::find(folder, &made.frames.entries)?);
            let command = plain_text::without_folders(command);
            notes.push(format!("{MASKS_BY}{command}"));
        }
        if let Some(prior) = &made.prior {
            files.set_prior(prior.find(&made.frames.entries)?);
        }
        let mut moving = match &posed {
            Some(posed) => posed.masks.clone(),
            None => vec![None; frames.entries.len()],
        };
        files.complete_masks(&mut moving);
        let has_ignored = request.given.ignored.is_some();
        let is_nothing = posed.is_none()
            && !files.has_images()
            && !has_ignored
            && moving.iter().all(Option::is_none);
        if is_nothing {
            let reason = "gets nothing: give masks, distances or poses to be attached";
            return Err(CurateError::input(scene_path, reason));
        }
        notes.extend(files.notes(&moving, &scene.camera)?);
        Ok(Self {
            has_ignored,
            files,
            posed,
            notes,
            moving,
        })
    }

    fn has_moving(&self) -> bool {
        self.moving.iter().any(Option::is_some)
    }

    /// Returns the scene without its earlier files of the attached kinds, and those kinds in words.
    fn without_earlier(&self, scene: &Scene) -> (Scene, BTreeSet<String>) {
        let mut bare = scene.clone();
        let mut had = BTreeSet::new();
        for frame in &mut bare.frames {
            if self.has_moving() && frame.mask.take().is_some() {
                had.insert("masks of what moves".to_owned());
            }
            if self.has_ignored && frame.ignore_mask.take().is_some() {
                had.insert("ignore masks".to_owned());
            }
            had.extend(self.files.take_from(frame));
        }
        if self.has_points() && bare.points.take().is_some() {
            had.insert("points".to_owned());
        }
        (bare, had)
    }

    fn has_points(&self) -> bool {
        let points = self.posed.as_ref().and_then(|posed| posed.points.as_ref());
        points.is_some_and(|cloud| !cloud.is_empty())
    }

    /// Stages the files and enters them in a scene without earlier ones.
    fn stage(
        self,
        staging: &mut Staging,
        folder: &Path,
        mut scene: Scene,
        progress: &dyn Progress,
    ) -> Result<Scene, CurateError> {
        let size = scene.camera.size();
        if self.has_moving() {
            let placed = masks::stage(staging, folder, &self.moving, size.into(), None)?;
            for (frame, mask) in scene.frames.iter_mut().zip(placed) {
                frame.mask = mask;
            }
            let problems = &mut scene.validation.problems;
            problems.retain(|line| !line.starts_with(MASKS_BY) && !is_of_moving(line));
        }
        let problems = &mut scene.validation.problems;
        problems.retain(|line| {
            let mut classes = self.files.classes();
            let is_of_earlier = self.has_ignored && is_of_ignored(line)
                || classes.any(|class| is_of_class(line, class));
            !is_of_earlier
        });
        (self.files).stage(staging, folder, &mut scene.frames, size, progress)?;
        if self.has_ignored {
            let ignored = &self.files.ignored;
            ignored.stage(staging, folder, &mut scene.frames, None)?;
        }
        let validated = match self.posed {
            Some(mut posed) => {
                if let Some(cloud) = posed.points.take().filter(|cloud| !cloud.is_empty()) {
                    cloud.write_ply(&staging.begin(POINTS_FILE)?)?;
                    scene.points = Some(POINTS_FILE.to_owned());
                }
                enter_poses(&mut scene, posed)
            }
            None => Vec::new(),
        };
        for problem in validated.into_iter().chain(self.notes) {
            progress.note(&format!("{}: {problem}", scene.id));
            if !scene.validation.problems.contains(&problem) {
                scene.validation.problems.push(problem);
            }
        }
        Ok(scene)
    }
}

/// Enters poses in a scene without; returns the lines of their validation. Earlier lines stay, except for the one that
/// says that poses are missing.
fn enter_poses(scene: &mut Scene, posed: PosedSequence) -> Vec<String> {
    let missing = given::unchecked(&vec![None; scene.frames.len()]).problems;
    for (frame, pose) in scene.frames.iter_mut().zip(posed.poses) {
        frame.pose = pose;
    }
    scene.scale = posed.scale;
    scene.pose_source = posed.source;
    let mut earlier = mem::replace(&mut scene.validation, posed.validation).problems;
    earlier.retain(|line| !missing.contains(line));
    mem::replace(&mut scene.validation.problems, earlier)
}

/// The folder of a scene, and the files in it that may be replaced.
struct Target {
    plan: StagePlan,
    own: OwnFiles,
    /// Files of a scene without a record, which gets one.
    unrecorded: Vec<OwnFile>,
}

impl Target {
    fn of(folder: &Path, scene: &Scene) -> Result<Self, CurateError> {
        for stage in [STAGE, OWN_STAGE] {
            let plan = StagePlan::new(folder, stage);
            let own = plan.own_files();
            if own.files().any(|own| own.file == SCENE_FILE) {
                return Ok(Self {
                    plan,
                    own,
                    unrecorded: Vec::new(),
                });
            }
        }
        let images: BTreeSet<&String> = scene.frames.iter().map(|frame| &frame.image).collect();
        let mut files: Vec<String> = files_named_by(scene)
            .into_iter()
            .filter(|file| !images.contains(file) && folder.join(file).is_file())
            .cloned()
            .collect();
        files.push(SCENE_FILE.to_owned());
        let mut unrecorded = Vec::with_capacity(files.len());
        for file in files {
            let sha256 = Some(store::sha256_file(&folder.join(&file))?);
            unrecorded.push(OwnFile { file, sha256 });
        }
        Ok(Self {
            plan: StagePlan::new(folder, OWN_STAGE),
            own: OwnFiles::new(folder, unrecorded.iter().cloned()),
            unrecorded,
        })
    }

    /// Refuses to replace foreign files, before anything has changed.
    fn refuse_foreign(&self, staging: &Staging) -> Result<(), CurateError> {
        for file in &staging.files {
            let sha256 = store::sha256_file(&staging.folder.join(file))?;
            self.own.refuse_changed(file, &sha256)?;
        }
        Ok(())
    }

    /// Records the files of a scene that has no record yet.
    fn adopt(&self) -> Result<(), CurateError> {
        if self.unrecorded.is_empty() {
            return Ok(());
        }
        let files = self.unrecorded.iter().cloned();
        Ok(self.plan.finish_hashed(files, 0.0_f64)?)
    }
}
