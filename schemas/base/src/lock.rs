//! Locks: one process at a time writes into a folder or works on a unit.
//!
//! The lock is the system's (`flock`), so it ends with its process in any case. The file that carries it names the
//! holder, and is removed on release.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, Read, Seek, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
    thread,
    time::{Duration, SystemTime},
};

use crate::{
    process,
    progress::Progress,
    provenance,
    store::{self, StoreError},
};

/// Name of the lock's file in a locked folder.
pub const LOCK_FILE: &str = ".omnilife.lock";
/// First words of the file.
const TAG: &str = "omnilife writes here: ";
/// Largest number of characters of the file that a message repeats.
const LONGEST_HOLDER: usize = 300;
/// Number of times, and the interval, at which a lock is read whose holder has not written its text yet.
const HOLDER_TRIES: u32 = 10;
const HOLDER_WAIT: Duration = Duration::from_millis(20);

/// Locks of this process. Stages of one job lock folders that the job has locked already.
static HELD: Mutex<BTreeMap<PathBuf, Weak<HeldFolder>>> = Mutex::new(BTreeMap::new());

/// Locked file; the lock lasts as long as it, or a copy that another process has inherited, is open.
#[derive(Debug)]
pub struct LockFile {
    path: PathBuf,
    file: File,
}

/// Result of an attempt to lock a file.
#[derive(Debug)]
pub enum Attempt {
    /// This process has the lock.
    Locked(LockFile),
    /// Another process has it; its text can be read from the file.
    Held(File),
    /// The file system has no locks, or fails to lock.
    Failed(io::Error),
}

impl LockFile {
    /// Creates the file where it is missing and locks it, without waiting. Content of an earlier holder stays.
    ///
    /// # Errors
    /// When the path is a link, or the file cannot be opened for reading and writing.
    pub fn take(path: &Path) -> Result<Attempt, StoreError> {
        let failed = |error| StoreError::write(path, error);
        loop {
            if path.is_symlink() {
                return Err(StoreError::refused(path, "is a link, not our lock"));
            }
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let file = options.open(path).map_err(failed)?;
            return Ok(match file.try_lock() {
                // The previous holder may have removed it between opening and locking.
                Ok(()) if !is_still_there(&file, path).map_err(failed)? => continue,
                Ok(()) => Attempt::Locked(Self {
                    path: path.to_owned(),
                    file,
                }),
                Err(TryLockError::WouldBlock) => Attempt::Held(file),
                Err(TryLockError::Error(error)) => Attempt::Failed(error),
            });
        }
    }

    /// Returns the open file, which is read from its beginning when it has just been locked.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Replaces the content.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(&self, content: &[u8]) -> io::Result<()> {
        let mut file = &self.file;
        file.set_len(0)?;
        file.rewind()?;
        file.write_all(content)
    }

    /// Removes the file and releases the lock, even if another process has inherited it.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub fn release(&self) -> Result<(), StoreError> {
        // Removed before the release: a process that locks a removed file finds that out.
        store::remove(&self.path)?;
        let unlocked = self.file.unlock();
        unlocked.map_err(|error| StoreError::write(&self.path, error))
    }
}

/// Lock that keeps other processes from writing into a folder until it is dropped.
#[derive(Debug)]
pub struct FolderLock {
    _held: Arc<HeldFolder>,
}

/// Lock of a folder.
#[derive(Debug)]
struct HeldFolder {
    /// `None` where the file system has no locks.
    lock: Option<LockFile>,
    /// Folders that were created for the lock, the innermost first.
    created: Vec<PathBuf>,
}

impl FolderLock {
    /// Creates the folder where it is missing, locks it, and removes half-written files of killed processes from it,
    /// but not from folders below. On a file system without locks a note says so and no process is kept out.
    ///
    /// A folder that was created, and into which nothing was written, is removed with the lock.
    ///
    /// # Errors
    /// [`StoreError::Refused`] with the process that holds the folder, and when the folder cannot be written into.
    pub fn take(folder: &Path, progress: &dyn Progress) -> Result<Self, StoreError> {
        let missing = folder.ancestors().take_while(|at| !at.exists());
        // A relative path ends in an empty one, which is the working directory.
        let created = missing.filter(|at| !at.as_os_str().is_empty());
        let created = created.map(Path::to_owned).collect();
        store::create_folder(folder)?;
        let folder = fs::canonicalize(folder).map_err(|error| StoreError::read(folder, error))?;
        let mut all = all_held();
        if let Some(held) = all.get(&folder).and_then(Weak::upgrade) {
            return Ok(Self { _held: held });
        }
        let path = folder.join(LOCK_FILE);
        let lock = lock(&folder, &path)?;
        if lock.is_none() {
            progress.note(&format!(
                "{}: its file system has no locks; let no other process write into it",
                folder.display()
            ));
        }
        let held = Arc::new(HeldFolder { lock, created });
        all.insert(folder.clone(), Arc::downgrade(&held));
        drop(all);
        store::remove_abandoned(&folder)?;
        Ok(Self { _held: held })
    }

    /// Takes the lock of a folder as [`FolderLock::take`] does, but does not create it; returns `None` where it is
    /// missing.
    ///
    /// # Errors
    /// Those of [`FolderLock::take`].
    pub fn take_existing(
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, StoreError> {
        folder
            .is_dir()
            .then(|| Self::take(folder, progress))
            .transpose()
    }
}

impl Drop for HeldFolder {
    fn drop(&mut self) {
        // Another thread must not find the lock half released.
        let mut all = all_held();
        if let Some(lock) = self.lock.take() {
            // A file that cannot be removed is hidden and taken over by the next process.
            drop(lock.release());
        }
        for folder in &self.created {
            // The system refuses to remove a folder with files.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
        all.retain(|_, held| held.strong_count() > 0);
    }
}

fn all_held() -> MutexGuard<'static, BTreeMap<PathBuf, Weak<HeldFolder>>> {
    // The map is consistent even if a thread panicked while it held the lock.
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Locks the file; returns `None` where the file system cannot.
fn lock(folder: &Path, path: &Path) -> Result<Option<LockFile>, StoreError> {
    let failed = |error| StoreError::write(path, error);
    let lock = match LockFile::take(path)? {
        Attempt::Locked(lock) => lock,
        Attempt::Held(mut file) => return Err(refusal(folder, &mut file)),
        Attempt::Failed(error) if has_no_locks(&error) => return Ok(None),
        Attempt::Failed(error) => return Err(failed(error)),
    };
    let mut text = String::new();
    let read = lock.file().take(TAG.len() as u64).read_to_string(&mut text);
    if read.is_err() || !TAG.starts_with(text.as_str()) {
        return Err(StoreError::refused(path, "is not our lock"));
    }
    if let Err(error) = lock.write(holder().as_bytes()) {
        drop(lock.release());
        return Err(failed(error));
    }
    Ok(Some(lock))
}

/// Returns the lock's text; a process that has just taken a lock writes it a moment later.
fn said_by_holder(file: &mut File) -> String {
    let mut text = String::new();
    for _ in 0..HOLDER_TRIES {
        text.clear();
        // An unreadable file counts as empty.
        let _ = file
            .rewind()
            .and_then(|()| Read::by_ref(file).take(4096).read_to_string(&mut text));
        if text.len() > TAG.len() {
            break;
        }
        thread::sleep(HOLDER_WAIT);
    }
    text
}

/// Returns the error that repeats the text of the holder.
fn refusal(folder: &Path, file: &mut File) -> StoreError {
    let text = said_by_holder(file);
    let holder: String = text
        .strip_prefix(TAG)
        .unwrap_or("another process")
        .chars()
        .filter(|character| !character.is_control())
        .take(LONGEST_HOLDER)
        .collect();
    StoreError::refused(
        folder,
        format!("is being written by {holder}; wait for it or choose another output"),
    )
}

/// Returns the text of a holder: process, machine, command, time.
fn holder() -> String {
    let words: Vec<String> = std::env::args_os()
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    format!(
        "{TAG}process {} on {} since {} (`{}`)\n",
        std::process::id(),
        process::host_name(),
        provenance::utc(SystemTime::now()),
        words.join(" ")
    )
}

fn has_no_locks(error: &io::Error) -> bool {
    #[cfg(unix)]
    if error.raw_os_error() == Some(nix::errno::Errno::ENOLCK as i32) {
        return true;
    }
    error.kind() == io::ErrorKind::Unsupported
}

/// Returns whether `path` still names the open file: a holder may remove a lock's file between opening and locking.
///
/// # Errors
/// When the system does not tell.
#[cfg(unix)]
pub fn is_still_there(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let open = file.metadata()?;
    match fs::symlink_metadata(path) {
        Ok(there) => Ok((there.dev(), there.ino()) == (open.dev(), open.ino())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Returns whether `path` is a file: open files cannot be removed on this system.
#[cfg(not(unix))]
pub fn is_still_there(_: &File, path: &Path) -> io::Result<bool> {
    Ok(path.is_file())
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;
    use crate::progress::Silent;

    #[test]
    fn a_folder_is_locked_once_and_named_in_one_line() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("out");
        let lock = FolderLock::take(&folder, &Silent).unwrap();
        let path = folder.join(LOCK_FILE);
        // Another open file stands for another process.
        let message = super::lock(&folder, &path).unwrap_err().to_string();
        let own = format!("process {}", std::process::id());
        assert!(
            message.contains(&own) && message.lines().count() == 1,
            "{message}"
        );
        assert!(message.contains(" UTC (`"), "{message}");
        let again = FolderLock::take(&folder, &Silent).unwrap();
        drop(lock);
        assert!(super::lock(&folder, &path).is_err(), "one holder is left");
        drop(again);
        assert!(!path.exists());
        drop(FolderLock::take(&folder, &Silent).unwrap());
    }

    #[test]
    fn a_folder_that_was_created_for_nothing_is_removed() {
        let temp = tempfile::tempdir().unwrap();
        let (outer, existing) = (temp.path().join("a"), temp.path().join("existing"));
        fs::create_dir(&existing).unwrap();
        drop(FolderLock::take(&existing, &Silent).unwrap());
        assert!(existing.is_dir(), "it was there before");
        let inner = outer.join("b");
        drop(FolderLock::take(&inner, &Silent).unwrap());
        assert!(!outer.exists());
        let lock = FolderLock::take(&inner, &Silent).unwrap();
        fs::write(outer.join("file"), "").unwrap();
        drop(lock);
        assert!(!inner.exists() && outer.is_dir());
    }

    #[test]
    fn what_a_killed_process_left_is_taken_over_and_a_foreign_file_is_not() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join(LOCK_FILE);
        for left in ["", TAG, "omnilife writes here: process 1 on x"] {
            fs::write(&path, left).unwrap();
            drop(FolderLock::take(temp.path(), &Silent).unwrap());
        }
        fs::write(&path, "my notes").unwrap();
        assert!(FolderLock::take(temp.path(), &Silent).is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "my notes");
    }
}
