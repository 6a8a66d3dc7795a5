//! Locks on units and on whole sweeps.
//!
//! `running.json` names the holder, and the system's lock on that file shows whether it is alive. A unit's lock is
//! inherited by its commands, so that it ends when they and all their child processes are gone, for any reason. No
//! clock or list of processes is needed. A file without a lock was left by a runner that has gone.

use std::{
    fs::{File, OpenOptions, TryLockError},
    io::{self, ErrorKind, Read, Seek, Write},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    lock::is_still_there,
    records::{RunnerLock, UnitRunner},
    store::{self, StoreError},
};

use crate::host;

/// Name of the file in the folder of a unit or a sweep.
pub(crate) const LOCK_FILE: &str = "running.json";

/// State of a folder's lock.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Holder {
    /// Not locked.
    Nobody,
    /// Held by this runner, or by processes that its commands left running.
    Runner(Box<UnitRunner>),
    /// Left by a runner that has gone, with its record if that is complete.
    Lost(Option<Box<UnitRunner>>),
}

/// Reads the state of a folder's lock and writes nothing.
///
/// # Errors
/// When the file cannot be read, or its file system has no locks.
pub(crate) fn holder(folder: &Path) -> Result<Holder, StoreError> {
    let path = folder.join(LOCK_FILE);
    let mut file = match File::open(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Holder::Nobody),
        Err(error) => return Err(StoreError::read(&path, error)),
    };
    let held = match file.try_lock_shared() {
        Ok(()) => false,
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Error(error)) => return Err(StoreError::read(&path, no_locks(error))),
    };
    let record = content(&mut file).map_err(|error| StoreError::read(&path, error))?;
    let runner = record.flatten().map(|record| Box::new(record.runner));
    Ok(if held {
        Holder::Runner(runner.unwrap_or_else(|| Box::new(unknown())))
    } else {
        Holder::Lost(runner)
    })
}

/// Removes the file of a lost runner, unless the lock is held.
///
/// # Errors
/// When it cannot be locked or removed.
pub(crate) fn clear(folder: &Path) -> Result<(), StoreError> {
    if !folder.join(LOCK_FILE).exists() {
        return Ok(());
    }
    match HeldLock::take(folder)? {
        Some(lock) => lock.release(),
        None => Ok(()),
    }
}

/// The lock of this process on a folder.
#[derive(Debug)]
pub(crate) struct HeldLock {
    path: PathBuf,
    /// The locked file; every process with a copy of it holds the lock.
    pub(crate) file: File,
    /// Number of consecutive runners that held it before and have gone.
    pub(crate) lost_runners: u32,
}

impl HeldLock {
    /// Locks an existing folder; `None` if it is locked already.
    ///
    /// # Errors
    /// When the file cannot be written, or its file system has no locks.
    pub(crate) fn take(folder: &Path) -> Result<Option<Self>, StoreError> {
        let path = folder.join(LOCK_FILE);
        let failed = |error| StoreError::write(&path, error);
        loop {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options.open(&path).map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) => return Err(failed(no_locks(error))),
            }
            // The previous holder may have removed it between opening and locking.
            if !is_still_there(&file, &path).map_err(failed)? {
                continue;
            }
            let lost_runners = match content(&mut file).map_err(failed)? {
                None => 0,
                Some(None) => 1,
                Some(Some(record)) => record.lost_runners.saturating_add(1),
            };
            if lost_runners > 0 {
                store::remove_abandoned(folder)?;
            }
            let record = RunnerLock {
                runner: host::runner(),
                lost_runners,
            };
            let bytes =
                store::record_bytes(&record).map_err(|error| failed(io::Error::other(error)))?;
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| file.write_all(&bytes))
                .map_err(failed)?;
            return Ok(Some(Self {
                path,
                file,
                lost_runners,
            }));
        }
    }

    /// Releases the lock, even if a command has left processes running.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub(crate) fn release(&self) -> Result<(), StoreError> {
        // Removed before the release: another process that locks a removed file notices that.
        store::remove(&self.path)?;
        self.file
            .unlock()
            .map_err(|error| StoreError::write(&self.path, error))
    }
}

/// Returns the content of the file: `None` if it is empty, `Some(None)` if it is incomplete.
fn content(file: &mut File) -> io::Result<Option<Option<RunnerLock>>> {
    let mut bytes = Vec::new();
    file.rewind()?;
    file.read_to_end(&mut bytes)?;
    Ok((!bytes.is_empty()).then(|| serde_json::from_slice(&bytes).ok()))
}

/// Returns an unknown runner.
pub(crate) fn unknown() -> UnitRunner {
    UnitRunner {
        host: "unknown".to_owned(),
        process: 0,
        slurm_job: None,
    }
}

fn no_locks(error: io::Error) -> io::Error {
    io::Error::new(
        error.kind(),
        format!("cannot be locked ({error}); a sweep needs a file system with locks"),
    )
}

#[cfg(test)]
mod tests {
    use std::{
        fs, thread,
        time::{Duration, SystemTime},
    };

    use super::*;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn one_of_many_takes_it() -> Outcome {
        let folder = tempfile::tempdir()?;
        for _ in 0..20 {
            let taken: Vec<HeldLock> = thread::scope(|scope| {
                let all: Vec<_> = (0..8)
                    .map(|_| scope.spawn(|| HeldLock::take(folder.path())))
                    .collect();
                let taken = all.into_iter().filter_map(|one| one.join().ok());
                taken.filter_map(Result::ok).flatten().collect()
            });
            assert_eq!(taken.len(), 1);
            assert!(matches!(holder(folder.path())?, Holder::Runner(_)));
            taken[0].release()?;
            assert_eq!(holder(folder.path())?, Holder::Nobody);
        }
        Ok(())
    }

    #[test]
    fn runners_that_went_away_are_counted() -> Outcome {
        let folder = tempfile::tempdir()?;
        for lost in 0..4 {
            let lock = HeldLock::take(folder.path())?.ok_or("held")?;
            assert_eq!(lock.lost_runners, lost);
            drop(lock);
            assert_eq!(
                holder(folder.path())?,
                Holder::Lost(Some(Box::new(host::runner())))
            );
        }
        clear(folder.path())?;
        assert_eq!(holder(folder.path())?, Holder::Nobody);
        Ok(())
    }

    /// A file without a lock holds nothing: half-written, of the future, or of any process.
    #[test]
    fn a_file_without_a_lock_holds_nothing() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join(LOCK_FILE);
        fs::write(&path, "{\"sch")?;
        let file = File::options().write(true).open(&path)?;
        file.set_modified(SystemTime::now() + Duration::from_secs(1_000_000_000))?;
        assert_eq!(holder(folder.path())?, Holder::Lost(None));
        let lock = HeldLock::take(folder.path())?.ok_or("held")?;
        assert_eq!(lock.lost_runners, 1);
        Ok(())
    }
}
