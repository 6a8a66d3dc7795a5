//! Atomic reading and writing of files: whole or not at all.
//!
//! Every file is written beside its final name, synced and renamed, so that a killed process or a full disk never
//! leaves a partial file under a final name. JSON records ([`Record`]) carry their schema's
//! name and version.
#![cfg_attr(
    not(test),
    expect(
        clippy::disallowed_methods,
        reason = "this is what others call instead"
    )
)]

mod growing;
mod records;
mod temporary;

use std::{
    fs::{self, DirEntry, File},
    io::{self, BufWriter, Read, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::error_kind::{self, Classified, ErrorKind};
pub use growing::GrowingFile;
pub use records::{
    Record, is_read_as, json_fault, read_record, record_bytes, record_line, schema_of,
    update_record, write_record, write_record_hashed,
};
pub use temporary::{Unfinished, remove_abandoned, temporary_beside};

/// Error of reading or writing a file. Messages name the file.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file is missing or cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file cannot be written (a full disk, missing permissions).
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The content does not match the format.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Fault of the content.
        reason: String,
    },
    /// A foreign file is in the way, or another process is at work.
    #[error("{}: {reason}", path.display())]
    Refused {
        /// The file or folder.
        path: PathBuf,
        /// Obstacle and remedy.
        reason: String,
    },
}

impl StoreError {
    /// Returns the message with the name of the file alone, without its folders.
    pub fn without_folders(&self) -> String {
        let (path, reason) = match self {
            Self::Read { path, source } => (path, format!("cannot be read: {source}")),
            Self::Write { path, source } => (path, format!("cannot be written: {source}")),
            Self::Malformed { path, reason } | Self::Refused { path, reason } => {
                (path, reason.clone())
            }
        };
        let name = path.file_name().unwrap_or_default();
        format!("{}: {reason}", name.to_string_lossy())
    }

    /// Makes the error of a refusal, which leaves `path` as it is.
    pub fn refused(path: &Path, reason: impl Into<String>) -> Self {
        Self::Refused {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// Makes the error of a `path` whose content does not match its format.
    pub fn malformed(path: &Path, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// Makes the error of a `path` that cannot be read. Where its folder is missing, or is a file, the reason says so.
    pub fn read(path: &Path, source: io::Error) -> Self {
        let fault = folder_fault(path)
            .or_else(|| is_broken_link(path).then_some("it is a link whose target is missing"));
        let source = match fault {
            Some(fault) if is_not_there(source.kind()) => io::Error::new(source.kind(), fault),
            _ if is_not_text(&source) => io::Error::new(source.kind(), "must be text in UTF-8"),
            _ => source,
        };
        Self::Read {
            path: path.to_owned(),
            source,
        }
    }

    /// Makes the error of a `path` that cannot be written.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Write {
            path: path.to_owned(),
            source,
        }
    }
}

impl Classified for StoreError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Read { source, .. } if is_of_machine(source) => ErrorKind::Internal,
            Self::Read { .. } | Self::Malformed { .. } | Self::Refused { .. } => ErrorKind::User,
            Self::Write { source, .. } if is_bad_path(source.kind()) => ErrorKind::User,
            Self::Write { .. } => ErrorKind::Internal,
        }
    }
}

/// Returns true if the cause is the machine, whatever the file: no memory, too many open files, a broken disk.
pub(crate) fn is_of_machine(error: &io::Error) -> bool {
    #[cfg(unix)]
    if let Some(code) = error.raw_os_error() {
        use nix::errno::Errno;
        return [Errno::EMFILE, Errno::ENFILE, Errno::ENOMEM, Errno::EIO]
            .iter()
            .any(|errno| *errno as i32 == code);
    }
    error.kind() == io::ErrorKind::OutOfMemory
}

/// Returns whether the requested path is why nothing can be written.
fn is_bad_path(kind: io::ErrorKind) -> bool {
    matches!(
        kind,
        io::ErrorKind::NotADirectory
            | io::ErrorKind::IsADirectory
            | io::ErrorKind::AlreadyExists
            | io::ErrorKind::DirectoryNotEmpty
            | io::ErrorKind::InvalidFilename
    )
}

/// Returns whether the system did not find the path.
fn is_not_there(kind: io::ErrorKind) -> bool {
    matches!(kind, io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// Returns true for the standard library's error of a file without valid UTF-8; errors of other origin hold their own.
fn is_not_text(source: &io::Error) -> bool {
    source.kind() == io::ErrorKind::InvalidData && source.get_ref().is_none()
}

/// Returns the fault of the folder of `path`; `None` where it is a folder.
fn folder_fault(path: &Path) -> Option<&'static str> {
    let folder = path.parent()?;
    if folder.as_os_str().is_empty() || folder.is_dir() {
        None
    } else if folder.exists() {
        Some("its folder is a file")
    } else {
        Some("its folder does not exist")
    }
}

/// Creates a folder and its parents; a power cut afterwards loses none of them.
///
/// # Errors
/// When the path is that of a file, and when the system refuses.
pub fn create_folder(path: &Path) -> Result<(), StoreError> {
    if path.is_file() {
        return Err(StoreError::refused(
            path,
            "is a file; the output needs a folder",
        ));
    }
    let missing: Vec<&Path> = path.ancestors().take_while(|at| !at.exists()).collect();
    fs::create_dir_all(path)
        .and_then(|()| {
            missing
                .iter()
                .rev()
                .try_for_each(|made| sync_folder_of(made))
        })
        .map_err(|source| StoreError::write(path, source))
}

/// Gives a file or folder its final name, and syncs that name to the disk. A power cut afterwards loses neither the
/// name nor the content, where that was synced earlier.
///
/// # Errors
/// When the system refuses.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    sync_folder_of(to)
}

/// Copies a file atomically, as [`write_with`] writes one.
///
/// # Errors
/// When the file cannot be read, or the copy cannot be written.
pub fn copy_atomically(from: &Path, to: &Path) -> Result<(), StoreError> {
    let mut source = File::open(from).map_err(|error| StoreError::read(from, error))?;
    write_with(to, |writer| io::copy(&mut source, writer).map(drop))
}

/// Copies a file into a temporary folder of ours: a power cut may lose the copy.
///
/// # Errors
/// When the file cannot be read, or the copy cannot be written.
pub fn copy(from: &Path, to: &Path) -> Result<(), StoreError> {
    let failed = |source| match File::open(from) {
        Ok(_) => StoreError::write(to, source),
        Err(_) => StoreError::read(from, source),
    };
    fs::copy(from, to).map(drop).map_err(failed)
}

/// Syncs the entries of the folder that holds `path` to the disk.
#[cfg(unix)]
fn sync_folder_of(path: &Path) -> io::Result<()> {
    let parent = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty());
    match File::open(parent.unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all()) {
        // Some folders may be written into but not listed, and some file systems sync no folders.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::PermissionDenied
                    | io::ErrorKind::InvalidInput
                    | io::ErrorKind::Unsupported
            ) =>
        {
            Ok(())
        }
        synced => synced,
    }
}

/// Does nothing: folders cannot be opened on this system; the file system's journal keeps renames in order.
#[cfg(not(unix))]
fn sync_folder_of(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Returns the folder into which `scripts/setup` installs data and programs of others: `$OMNILIFE_DATA`, else
/// `$XDG_DATA_HOME/omnilife`, else `~/.local/share/omnilife`. Returns `None` where none of them is set.
pub fn data_folder() -> Option<PathBuf> {
    let set = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    set("OMNILIFE_DATA")
        .or_else(|| set("XDG_DATA_HOME").map(|data| data.join("omnilife")))
        .or_else(|| set("HOME").map(|home| home.join(".local/share/omnilife")))
}

/// Removes a file or a link, or a folder with its content; a missing one is accepted.
///
/// # Errors
/// When it exists and cannot be removed.
pub fn remove(path: &Path) -> Result<(), StoreError> {
    let removed = if path.is_dir() && !path.is_symlink() {
        fs::remove_dir_all(path)
    } else {
        fs::remove_file(path)
    };
    match removed {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(StoreError::write(path, source))
        }
        _ => Ok(()),
    }
}

/// Returns the names of the entries of a folder, sorted; parts that are not UTF-8 are replaced.
///
/// # Errors
/// When the folder or an entry cannot be read.
pub fn names_in(folder: &Path) -> Result<Vec<String>, StoreError> {
    entries_in(folder, |entry| {
        entry.file_name().to_string_lossy().into_owned()
    })
}

/// Returns the paths of the entries of a folder, sorted.
///
/// # Errors
/// When the folder or an entry cannot be read.
pub fn paths_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    entries_in(folder, DirEntry::path)
}

/// Returns true for an entry whose name begins with a dot. macOS leaves such a file (`._clip.mp4`) beside each of its
/// files on the cards of cameras, under the same extension and with other content.
pub fn is_hidden(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    name.as_encoded_bytes().starts_with(b".")
}

/// Returns true for a link whose target is missing.
pub fn is_broken_link(path: &Path) -> bool {
    path.is_symlink() && !path.exists()
}

fn entries_in<T: Ord>(folder: &Path, of: impl Fn(&DirEntry) -> T) -> Result<Vec<T>, StoreError> {
    let failed = |source| StoreError::read(folder, source);
    let entries = fs::read_dir(folder).map_err(failed)?;
    let found = entries.map(|entry| entry.map(|entry| of(&entry)));
    let mut found = found.collect::<io::Result<Vec<T>>>().map_err(failed)?;
    found.sort();
    Ok(found)
}

/// Writes a file through `fill`: beside its final name, synced, then renamed.
///
/// On any error the temporary file is removed and the final name stays as it was.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), StoreError> {
    // A device or a pipe would be replaced by a file.
    if fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return Err(StoreError::refused(
            path,
            "must be a regular file; a device, socket or pipe is not replaced",
        ));
    }
    let temporary = Unfinished::beside(path);
    let written = (|| {
        let mut writer = BufWriter::new(File::create(temporary.path())?);
        fill(&mut writer)?;
        let file = writer
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        temporary.rename(path)
    })();
    written.map_err(|source| StoreError::write(path, source))
}

/// Returns the bytes of a file that holds at most `most_bytes`.
///
/// # Errors
/// When the file is missing, cannot be read or is larger.
pub fn read_limited(path: &Path, most_bytes: u64) -> Result<Vec<u8>, StoreError> {
    error_kind::reading(path);
    let failed = |source| StoreError::read(path, source);
    let file = File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    // One more, so that a file that is too large is told from one that just fits. It also limits sources without a
    // stated length, such as pipes.
    file.take(most_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(failed)?;
    if bytes.len() as u64 > most_bytes {
        let reason = format!("holds more than {most_bytes} bytes");
        return Err(StoreError::malformed(path, reason));
    }
    Ok(bytes)
}

/// Returns the text of a file, without the byte order mark with which some programs begin files.
///
/// # Errors
/// When the file is missing, cannot be read or is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, StoreError> {
    error_kind::reading(path);
    let text = fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// Writes bytes whole or not at all.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_with(path, |writer| writer.write_all(bytes))
}

/// Writes a CSV table through `fill`, whole or not at all.
pub fn write_csv(
    path: &Path,
    fill: impl FnOnce(&mut csv::Writer<&mut BufWriter<File>>) -> csv::Result<()>,
) -> Result<(), StoreError> {
    write_with(path, |writer| {
        let mut table = csv::Writer::from_writer(writer);
        fill(&mut table).map_err(io::Error::other)?;
        table.flush()
    })
}

/// Writes rows as a CSV table whose columns are their fields, whole or not at all. Without rows the
/// file is empty.
pub fn write_csv_rows(
    path: &Path,
    rows: impl IntoIterator<Item = impl Serialize>,
) -> Result<(), StoreError> {
    write_csv(path, |table| {
        rows.into_iter().try_for_each(|row| table.serialize(row))
    })
}

/// Returns the SHA-256 of bytes in lower-case hexadecimal.
pub fn sha256_bytes(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Returns the SHA-256 of a file, read as a stream, in lower-case hexadecimal.
pub fn sha256_file(path: &Path) -> Result<String, StoreError> {
    let failed = |source| StoreError::read(path, source);
    let mut file = File::open(path).map_err(failed)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0_u8; 1 << 16];
    loop {
        let count = file.read(&mut buffer).map_err(failed)?;
        if count == 0 {
            return Ok(hexadecimal(&hasher.finalize()));
        }
        hasher.update(&buffer[..count]);
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
