//! An external method: the commands of a `method.toml`, run on a scene and measured.
//!
//! [`manifest`] defines the content of a `method.toml`, `placeholders` the variables in its texts, `gather` copies the
//! views from the method's output to the places where scoring expects them. A failing method is not an error: the
//! record gives the reason, its views stay in place, and each becomes a failure in the result.

mod compose;
mod failure;
mod gather;
pub mod manifest;
mod placeholders;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    child::{self, GRACE, Job},
    layout::{SCENE_FILE, SPLIT_FILE},
    progress::Progress,
    provenance,
    records::{ExternalRun, Phase, Scene, Split},
    stage::StagePlan,
    store,
};

use crate::{error::BenchError, scene_identity::SceneIdentity, split};
pub use failure::{FailureRequest, record_failure};
use manifest::Manifest;
use placeholders::Places;

/// Name of the record in the run's folder.
pub const EXTERNAL_RUN_FILE: &str = "external-run.json";
/// Folder for the method's own use, relative to the run's folder.
const WORK_FOLDER: &str = "work";
const LOG_FOLDER: &str = "logs";
const PREDICTIONS_FOLDER: &str = "predictions";
const INPUT_FOLDER: &str = "predictions/input";
const NOVEL_FOLDER: &str = "predictions/novel";

/// A run's method, inputs and output.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalRequest {
    /// The `method.toml`.
    pub manifest: PathBuf,
    /// The `scene.json`.
    pub scene: PathBuf,
    /// The `split.json` of that scene.
    pub split: PathBuf,
    /// Seed for the method.
    pub seed: u64,
    /// Folder of the run; created if missing.
    pub out: PathBuf,
}

/// Runs a method's commands on a scene and gathers its views, or returns the stored record if nothing has changed. A
/// failed run is repeated.
///
/// Writes into `request.out`: `external-run.json`, `logs/<phase>.log`, `predictions/`, and the
/// method's own `work/`.
///
/// # Errors
/// When manifest, scene and split are unusable or do not belong together, or a file cannot be written. A command that
/// fails, or that does not exist, is noted in the record instead.
pub fn run_external(
    request: &ExternalRequest,
    progress: &dyn Progress,
) -> Result<ExternalRun, BenchError> {
    let manifest = Manifest::read(&request.manifest)?;
    let scene: Scene = store::read_record(&request.scene)?;
    let split: Split = store::read_record(&request.split)?;
    split::check_split(&request.split, &split, &scene)?;
    store::create_folder(&request.out)?;
    let places = Places::new(request, &scene)?;
    let identity = SceneIdentity::of_split(&request.scene, &scene, &split, &[])?;
    let plan = StagePlan::new(&request.out, ExternalRun::STAGE)
        .with_text("seed", &request.seed.to_string())
        .with_file(&request.manifest)?
        .with_file(&request.scene)?
        .with_file(&request.split)?
        .with_hash("frames of the split", identity.sha256);
    let mut inputs = hashes_beside_images(&request.scene, &scene)?;
    let beside: Vec<&str> = inputs.values().map(String::as_str).collect();
    let beside = store::sha256_bytes(beside.join("\n").as_bytes());
    let plan = plan.with_hash("points, masks and distances of the scene", beside);
    let plan = with_own_files(plan, &manifest, |word| places.fill(word))?;
    let label = format!("{} on {}", manifest.id, scene.id);
    let skipped = format!("{label}: skipped, nothing has changed");
    for folder in [WORK_FOLDER, LOG_FOLDER, PREDICTIONS_FOLDER] {
        plan.refuse_foreign_folder(folder)?;
    }
    let made = (EXTERNAL_RUN_FILE, skipped.as_str());
    plan.make(made, [EXTERNAL_RUN_FILE], progress, |out| {
        // What an earlier run left must not be taken for the views of this one.
        for old in [
            EXTERNAL_RUN_FILE,
            WORK_FOLDER,
            LOG_FOLDER,
            PREDICTIONS_FOLDER,
        ] {
            store::remove(&request.out.join(old))?;
        }
        for folder in [WORK_FOLDER, LOG_FOLDER, INPUT_FOLDER, NOVEL_FOLDER] {
            store::create_folder(&request.out.join(folder))?;
        }
        inputs.extend(hashes_of_split(request, &scene, &split)?);
        let (phases, failure) = run_phases(&manifest, &places, &request.out, &label, progress)?;
        // The views of a run that failed stay in its work folder: their state is unknown.
        let gathered = match failure {
            Some(_) => gather::GatheredViews::notes_of(&manifest),
            None => gather::gather(&manifest, &places, &scene, &split, &request.out)?,
        };
        let mut warnings = gathered.warnings;
        for phase in &phases {
            let left = phase.left_running.iter();
            warnings.extend(left.map(|what| format!("{} left running: {what}", phase.name.name())));
        }
        let record = ExternalRun {
            method: manifest.id.clone(),
            source: manifest.source.clone(),
            licence: manifest.licence.clone(),
            manifest_sha256: store::sha256_file(&request.manifest)?,
            scene: scene.id,
            protocol_hash: split.protocol_hash,
            seed: request.seed,
            environment: manifest.environment.describe(),
            hardware: Some(provenance::Hardware::here()),
            versions: provenance::versions(),
            phases,
            failure,
            novel_views: NOVEL_FOLDER.to_owned(),
            input_views: manifest
                .predictions
                .input
                .is_some()
                .then(|| INPUT_FOLDER.to_owned()),
            warnings,
            inputs,
        };
        out.add_all(gathered.files);
        if record.failure.is_some() {
            out.leave_begun();
        }
        Ok(record)
    })
}

/// Returns the hashes of points, masks and distances of the scene, which a method may read beside its images.
fn hashes_beside_images(
    scene_file: &Path,
    scene: &Scene,
) -> Result<BTreeMap<String, String>, BenchError> {
    let images: BTreeSet<&str> = scene.frames.iter().map(|frame| &*frame.image).collect();
    let mut hashes = BTreeMap::new();
    for file in scene.files().difference(&images) {
        let path = scene_file.with_file_name(file);
        if path.is_file() {
            hashes.insert((*file).to_owned(), store::sha256_file(&path)?);
        }
    }
    Ok(hashes)
}

/// Returns the hashes of the split, of its frames and of the scene's record, for the record of a run.
fn hashes_of_split(
    request: &ExternalRequest,
    scene: &Scene,
    split: &Split,
) -> Result<BTreeMap<String, String>, BenchError> {
    let mut hashes = BTreeMap::from([
        (SCENE_FILE.to_owned(), store::sha256_file(&request.scene)?),
        (SPLIT_FILE.to_owned(), store::sha256_file(&request.split)?),
    ]);
    for &number in split.input_views.iter().chain(&split.novel_views) {
        let frame = &scene.frames[number as usize];
        let hash = store::sha256_file(&request.scene.with_file_name(&frame.image))?;
        hashes.insert(frame.image.clone(), hash);
    }
    Ok(hashes)
}

/// Adds the method's own scripts.
fn with_own_files(
    mut plan: StagePlan,
    manifest: &Manifest,
    fill: impl Fn(&str) -> String,
) -> Result<StagePlan, BenchError> {
    for path in files_of_folder(manifest, fill) {
        plan = plan.with_file(&path)?;
    }
    Ok(plan)
}

/// Returns the files beside a manifest that its commands name: the method's own scripts, but for names with other
/// placeholders.
///
/// # Errors
/// When the manifest cannot be read.
pub fn own_files(manifest: &Path) -> Result<Vec<PathBuf>, BenchError> {
    let folder = manifest.parent().filter(|folder| *folder != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));
    let fill = |word: &str| word.replace(OWN_FOLDER, &folder.to_string_lossy());
    Ok(files_of_folder(&Manifest::read(manifest)?, fill))
}

/// Placeholder of the folder of a manifest.
const OWN_FOLDER: &str = "{folder}";

/// Returns the files that commands name below the folder of their manifest, also within a word such as
/// `--config={folder}/a.toml`.
fn files_of_folder(manifest: &Manifest, fill: impl Fn(&str) -> String) -> Vec<PathBuf> {
    let words = manifest.phases().flat_map(|(_, command)| command.iter());
    let named =
        words.filter_map(|word| Some(PathBuf::from(fill(word.get(word.find(OWN_FOLDER)?..)?))));
    named.filter(|path| path.is_file()).collect()
}

/// Runs the commands one after another until one fails; returns the reason.
fn run_phases(
    manifest: &Manifest,
    places: &Places,
    out: &Path,
    label: &str,
    progress: &dyn Progress,
) -> Result<(Vec<Phase>, Option<String>), BenchError> {
    let mut phases = Vec::new();
    for (name, template) in manifest.phases() {
        progress.begin(&format!("{label}: {}", name.name()), None);
        let words = template.iter().map(|word| places.fill(word)).collect();
        let container = manifest.environment.container();
        let job = Job {
            command: manifest.environment.wrap(words, places, container.as_ref()),
            variables: manifest.environment.variables(),
            folder: places.work.clone(),
            log: out.join(LOG_FOLDER).join(format!("{}.log", name.name())),
            time_limit: manifest.time_limit(),
            grace: GRACE,
            container,
        };
        let outcome = child::run(&job);
        progress.end();
        let outcome = outcome?;
        for what in &outcome.left_running {
            progress.note(&format!("{label}: {} left running: {what}", name.name()));
        }
        let failed = (!outcome.succeeded).then(|| format!("{} {}", name.name(), outcome.failure()));
        phases.push(Phase {
            name,
            command: job.command,
            log: format!("{LOG_FOLDER}/{}.log", name.name()),
            ending: outcome.ending,
            left_running: outcome.left_running,
            wall_seconds: outcome.wall_seconds,
            cpu_seconds: outcome.cpu_seconds,
            peak_memory_bytes: outcome.peak_memory_bytes,
        });
        if failed.is_some() {
            return Ok((phases, failed));
        }
    }
    Ok((phases, None))
}
