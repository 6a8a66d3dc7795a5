//! Folder of a sweep: the plan, and the state of every unit.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    iter,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::SCENE_FILE,
    records::{Scene, SweepPlan, SweepUnit, UnitInput, UnitOutcome, UnitRunner},
    stage::StageOutput,
    store::{self, StoreError},
};

use crate::{
    error::SweepError,
    host,
    lock::{self, Holder},
    plan,
};

const UNITS_FOLDER: &str = "units";
const NANOSECONDS: u64 = 1_000_000_000;
/// Outcome of a unit that is done.
const DONE_FILE: &str = "done.json";
/// Outcome of a unit whose last attempt failed.
const FAILED_FILE: &str = "failed.json";

/// Sweep with its folder and its plan.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// The folder, absolute.
    pub folder: PathBuf,
    /// The plan.
    pub plan: SweepPlan,
}

/// State of a unit.
#[derive(Debug, Clone, PartialEq)]
pub enum UnitState {
    /// Done, with the present inputs.
    Done(Box<UnitOutcome>),
    /// Its last attempt failed, or its record is broken.
    Failed(Box<UnitOutcome>),
    /// A live runner works on it.
    Running(Box<UnitRunner>),
    /// To be run.
    Missing {
        /// Reason, other than that it was never run.
        reason: Option<String>,
    },
}

/// Completion of a unit.
pub(crate) enum Finished {
    /// Done, or failed.
    As(UnitState),
    /// Not finished.
    Not {
        /// Difference to the finished state, if it was finished once.
        changed: Option<String>,
    },
}

impl UnitState {
    /// Returns `done`, `failed`, `running` or `missing`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Done(_) => "done",
            Self::Failed(_) => "failed",
            Self::Running(_) => "running",
            Self::Missing { .. } => "missing",
        }
    }
}

impl Sweep {
    /// Opens a sweep.
    ///
    /// # Errors
    /// When its plan cannot be read or was changed.
    pub fn open(folder: &Path) -> Result<Self, SweepError> {
        let plan = plan::read(folder)?;
        let folder = fs::canonicalize(folder).map_err(|source| StoreError::read(folder, source))?;
        Ok(Self { folder, plan })
    }

    /// Returns the unit of an id.
    ///
    /// # Errors
    /// When the id is unknown.
    pub fn unit(&self, id: &str) -> Result<&SweepUnit, SweepError> {
        let mut units = self.plan.units.iter();
        units
            .find(|unit| unit.id == id)
            .ok_or_else(|| SweepError::UnknownUnit { id: id.to_owned() })
    }

    /// Returns the folder of a unit's lock, logs and outcome.
    pub fn unit_folder(&self, unit: &SweepUnit) -> PathBuf {
        self.folder.join(UNITS_FOLDER).join(&unit.id)
    }

    /// Returns the states of all units, in the order of the plan. Writes nothing.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn states(&self) -> Result<Vec<UnitState>, SweepError> {
        let units = self.plan.units.iter();
        Ok(units
            .map(|unit| self.state(unit))
            .collect::<Result<_, StoreError>>()?)
    }

    /// Returns the state of a unit.
    ///
    /// # Errors
    /// When its folder cannot be read.
    pub fn state(&self, unit: &SweepUnit) -> Result<UnitState, StoreError> {
        let changed = match self.outcome(unit)? {
            Finished::As(state) => return Ok(state),
            Finished::Not { changed } => changed,
        };
        Ok(match lock::holder(&self.unit_folder(unit))? {
            Holder::Runner(runner) => UnitState::Running(runner),
            Holder::Nobody => UnitState::Missing { reason: changed },
            Holder::Lost(runner) => UnitState::Missing {
                reason: Some(lost_runner(runner.as_deref())),
            },
        })
    }

    /// Returns the completion of a unit, regardless of its lock.
    pub(crate) fn outcome(&self, unit: &SweepUnit) -> Result<Finished, StoreError> {
        let folder = self.unit_folder(unit);
        if let Some(outcome) = outcome_in(unit, &folder.join(DONE_FILE))? {
            if outcome.failure.is_some() {
                return Ok(Finished::As(UnitState::Failed(Box::new(outcome))));
            }
            let changed = self.what_changed(unit, &outcome);
            return Ok(match changed {
                None => Finished::As(UnitState::Done(Box::new(outcome))),
                Some(_) => Finished::Not { changed },
            });
        }
        let failed = outcome_in(unit, &folder.join(FAILED_FILE))?;
        Ok(failed.map_or(Finished::Not { changed: None }, |outcome| {
            Finished::As(UnitState::Failed(Box::new(outcome)))
        }))
    }

    /// Returns the difference between a finished unit and its present plan and inputs.
    fn what_changed(&self, unit: &SweepUnit, outcome: &UnitOutcome) -> Option<String> {
        if outcome.unit_sha256 != plan::unit_hash(unit) {
            return Some("it was done by another version".to_owned());
        }
        let mut inputs = outcome.inputs.iter();
        if let Some(input) = inputs.find(|input| !self.is_unchanged(input)) {
            return Some(format!("{}: has changed since", input.file));
        }
        let mut outputs = outcome.outputs.iter();
        let missing = outputs.find(|output| {
            !fs::metadata(self.path(&output.file)).is_ok_and(|held| held.len() == output.bytes)
        });
        missing.map(|output| format!("{}: is not there as it was left", output.file))
    }

    fn is_unchanged(&self, input: &UnitInput) -> bool {
        let files = InputFiles::of(&self.path(&input.file));
        let Ok((bytes, modified_nanoseconds)) = files.size_and_time() else {
            return false;
        };
        bytes == input.bytes
            && (modified_nanoseconds == input.modified_nanoseconds
                || files.sha256().is_ok_and(|sha256| sha256 == input.sha256))
    }

    /// Returns a path of the plan, relative to the working folder of its commands.
    pub(crate) fn path(&self, file: &str) -> PathBuf {
        Path::new(&self.plan.folder).join(file)
    }

    /// Returns the present inputs of a unit.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn inputs(&self, unit: &SweepUnit) -> Result<Vec<UnitInput>, StoreError> {
        unit.inputs
            .iter()
            .map(|file| {
                let files = InputFiles::of(&self.path(file));
                // Examined before they are hashed, so that a later change shows.
                let (bytes, modified_nanoseconds) = files.size_and_time()?;
                Ok(UnitInput {
                    file: file.clone(),
                    bytes,
                    modified_nanoseconds,
                    sha256: files.sha256()?,
                })
            })
            .collect()
    }

    /// Returns the outputs of a unit with their sizes; otherwise the first missing one.
    pub(crate) fn outputs(&self, unit: &SweepUnit) -> Result<Vec<StageOutput>, String> {
        unit.outputs
            .iter()
            .map(|file| match fs::metadata(self.path(file)) {
                Ok(held) => Ok(StageOutput {
                    file: file.clone(),
                    bytes: held.len(),
                    sha256: None,
                }),
                Err(_) => Err(format!("{file}: its commands succeeded without leaving it")),
            })
            .collect()
    }

    /// Writes a unit's outcome, and removes one of the other kind.
    ///
    /// # Errors
    /// When a file cannot be written or removed.
    pub(crate) fn write_outcome(
        &self,
        unit: &SweepUnit,
        outcome: &UnitOutcome,
    ) -> Result<(), StoreError> {
        let folder = self.unit_folder(unit);
        let [mine, other] = match outcome.failure {
            None => [DONE_FILE, FAILED_FILE],
            Some(_) => [FAILED_FILE, DONE_FILE],
        };
        store::write_record(&folder.join(mine), outcome)?;
        store::remove(&folder.join(other))
    }

    /// Makes a failed unit missing again and forgets its lost runners; returns false if it did not fail.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn retry(&self, unit: &SweepUnit) -> Result<bool, SweepError> {
        if !matches!(self.outcome(unit)?, Finished::As(UnitState::Failed(_))) {
            return Ok(false);
        }
        let folder = self.unit_folder(unit);
        lock::clear(&folder)?;
        store::remove(&folder.join(DONE_FILE))?;
        store::remove(&folder.join(FAILED_FILE))?;
        Ok(true)
    }
}

pub(crate) fn lost_runner(runner: Option<&UnitRunner>) -> String {
    match runner {
        Some(runner) => format!("its runner went away ({})", host::described(runner)),
        None => "its runner went away".to_owned(),
    }
}

/// Returns the outcome for an unreadable record: the unit counts as failed until it is done again.
fn unreadable(unit: &SweepUnit, error: &StoreError) -> UnitOutcome {
    UnitOutcome {
        unit: unit.id.clone(),
        failure: Some(error.to_string()),
        exit_code: None,
        unit_sha256: plan::unit_hash(unit),
        inputs: Vec::new(),
        outputs: Vec::new(),
        attempt: 0,
        runner: lock::unknown(),
        begun_unix_seconds: 0.0,
        wall_seconds: 0.0,
        cpu_seconds: None,
        peak_memory_bytes: None,
        log: String::new(),
        left_running: Vec::new(),
    }
}

/// Returns the outcome in a file; `None` without the file.
fn outcome_in(unit: &SweepUnit, path: &Path) -> Result<Option<UnitOutcome>, StoreError> {
    match path.try_exists() {
        Ok(true) => Ok(Some(
            store::read_record(path).unwrap_or_else(|error| unreadable(unit, &error)),
        )),
        Ok(false) => Ok(None),
        Err(source) => Err(StoreError::read(path, source)),
    }
}

/// Returns bytes, and nanoseconds since 1970 at the last change.
/// An input with the files that it names: a scene stands for its images, masks and points.
struct InputFiles {
    own: PathBuf,
    /// Not all need be there.
    named: Vec<PathBuf>,
}

impl InputFiles {
    fn of(path: &Path) -> Self {
        let is_scene = path.file_name().is_some_and(|name| name == SCENE_FILE);
        // The commands of a unit say what is wrong with a scene that cannot be read.
        let scene = is_scene.then(|| store::read_record::<Scene>(path).ok());
        let files = scene.flatten().map(|scene| {
            let files = scene.files().into_iter();
            files.map(|file| path.with_file_name(file)).collect()
        });
        Self {
            own: path.to_owned(),
            named: files.unwrap_or_default(),
        }
    }

    /// Returns the size of all, and a number of their sizes and times in their order: two files that change names change
    /// it as well. That of a single file is its time, nanoseconds since 1970.
    fn size_and_time(&self) -> Result<(u64, u64), StoreError> {
        let own = size_and_time(&self.own).map_err(|source| StoreError::read(&self.own, source))?;
        if self.named.is_empty() {
            return Ok(own);
        }
        // A file that is not there has a place in the order too.
        let named = self.named.iter();
        let named = named.map(|file| size_and_time(file).unwrap_or_default());
        let files: Vec<(u64, u64)> = iter::once(own).chain(named).collect();
        let bytes = files.iter().map(|(bytes, _)| bytes).sum();
        // Another number in another version costs one comparison of content.
        let mut hasher = DefaultHasher::new();
        files.hash(&mut hasher);
        Ok((bytes, hasher.finish()))
    }

    /// Returns the hash of the file, or that of the hashes of all.
    fn sha256(&self) -> Result<String, StoreError> {
        let own = store::sha256_file(&self.own)?;
        if self.named.is_empty() {
            return Ok(own);
        }
        let mut hashes = vec![own];
        for file in &self.named {
            hashes.push(match file.is_file() {
                true => store::sha256_file(file)?,
                false => "not there".to_owned(),
            });
        }
        Ok(store::sha256_bytes(hashes.join("\n").as_bytes()))
    }
}

/// Returns the size of a file, and the time of its last change in nanoseconds since 1970: that of its entry, which
/// programs cannot set back as they can that of its bytes.
fn size_and_time(path: &Path) -> std::io::Result<(u64, u64)> {
    let metadata = fs::metadata(path)?;
    let seconds = u64::try_from(metadata.ctime()).unwrap_or(0);
    let rest = u64::try_from(metadata.ctime_nsec()).unwrap_or(0);
    let nanoseconds = seconds.saturating_mul(NANOSECONDS).saturating_add(rest);
    Ok((metadata.len(), nanoseconds))
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{camera::ErpCamera, records::SceneFrame};

    use super::*;

    /// Images are no part of the record of a scene.
    #[test]
    fn a_scene_stands_for_its_files() -> Result<(), Box<dyn std::error::Error>> {
        let temp = tempfile::tempdir()?;
        let scene_file = temp.path().join(SCENE_FILE);
        let frame = SceneFrame::new("frame.png".to_owned(), 0.0, None);
        let scene = Scene::given("walk", ErpCamera::new(64, 32), vec![frame]);
        store::write_record(&scene_file, &scene)?;
        let read = || -> Result<_, StoreError> {
            let files = InputFiles::of(&scene_file);
            Ok((files.size_and_time()?, files.sha256()?))
        };
        let without = read()?;
        let image = temp.path().join("frame.png");
        store::write_bytes(&image, b"one")?;
        let first = read()?;
        assert_ne!(without, first);
        // Clocks of file systems have ticks of some milliseconds.
        let wait = || std::thread::sleep(std::time::Duration::from_millis(50));
        wait();
        store::write_bytes(&image, b"two")?;
        let second = read()?;
        assert_ne!(first.0.1, second.0.1);
        assert_ne!(first.1, second.1);
        assert_eq!(second, read()?);
        // Bytes of the same length, with the time of the earlier ones.
        wait();
        let time = fs::metadata(&image)?.modified()?;
        store::write_bytes(&image, b"six")?;
        fs::File::options()
            .write(true)
            .open(&image)?
            .set_modified(time)?;
        assert_ne!(second.0.1, read()?.0.1);
        // Other files stand for themselves, also those that are no scene.
        store::write_bytes(&scene_file, b"{}")?;
        assert_eq!(read()?.1, store::sha256_bytes(b"{}"));
        Ok(())
    }

    /// Names of frames that are moved by one, which keeps all sizes and times.
    #[test]
    fn files_that_change_names_change_a_scene() -> Result<(), Box<dyn std::error::Error>> {
        let temp = tempfile::tempdir()?;
        let scene_file = temp.path().join(SCENE_FILE);
        let names = ["a.png", "b.png"];
        let frames = names.map(|name| SceneFrame::new(name.to_owned(), 0.0, None));
        let scene = Scene::given("walk", ErpCamera::new(64, 32), frames.to_vec());
        store::write_record(&scene_file, &scene)?;
        let [first, second] = names.map(|name| temp.path().join(name));
        store::write_bytes(&first, b"one")?;
        std::thread::sleep(std::time::Duration::from_millis(50));
        store::write_bytes(&second, b"two")?;
        let read = || InputFiles::of(&scene_file).size_and_time();
        let before = read()?;
        let aside = temp.path().join("aside");
        fs::rename(&first, &aside)?;
        fs::rename(&second, &first)?;
        fs::rename(&aside, &second)?;
        let after = read()?;
        assert_eq!(before.0, after.0);
        assert_ne!(before.1, after.1);
        Ok(())
    }
}
