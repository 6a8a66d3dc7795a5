//! Names of unfinished files and folders, and the removal of leftovers of killed processes.
//!
//! A name identifies the process and the machine that write it, because folders are shared between machines and
//! containers, where process ids repeat.

use std::{
    fs,
    hash::{BuildHasher, RandomState},
    io,
    path::{Path, PathBuf},
    sync::LazyLock,
};

use crate::{
    process,
    store::{self, StoreError},
};

const PREFIX: &str = ".tmp-";
/// Longest file name of the file systems in use, bytes.
const LONGEST_NAME: usize = 255;

/// `<host>-<process>-<random>`, the same for the life of this process.
static OWN: LazyLock<String> = LazyLock::new(|| {
    // The standard library seeds its hashers from the system's randomness.
    let random = RandomState::new().hash_one(std::process::id()) as u32;
    format!("{}-{}-{random:08x}", *HOST, std::process::id())
});

/// Eight digits for this machine and its process namespace: within both, a process id names one
/// process at a time.
static HOST: LazyLock<String> = LazyLock::new(|| {
    let namespace = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    let text = format!("{} {}", process::host_name(), namespace.display());
    store::sha256_bytes(text.as_bytes())[..8].to_owned()
});

/// Returns the path under which a file is written until it gets its final name; the same for every call of a process.
///
/// The final extension is kept last, because image encoders choose the format by it. A name that would be too long
/// loses its beginning.
pub fn temporary_beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!("{PREFIX}{}-", *OWN);
    if prefix.len() + name.len() <= LONGEST_NAME {
        return path.with_file_name(prefix + &name);
    }
    let short = &store::sha256_bytes(name.as_bytes())[..8];
    let least = prefix.len() + short.len() + name.len() - LONGEST_NAME;
    let cut = (least..=name.len()).find(|&at| name.is_char_boundary(at));
    let rest = &name[cut.unwrap_or(name.len())..];
    path.with_file_name(format!("{prefix}{short}{rest}"))
}

/// File or folder that is removed with its content on drop, unless it has got its final name by then.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Returns a free place beside `path`, see [`temporary_beside`]; creates nothing.
    pub fn beside(path: &Path) -> Self {
        Self(temporary_beside(path))
    }

    /// Creates an empty folder beside `path`, see [`temporary_beside`].
    ///
    /// # Errors
    /// When an old one cannot be removed, or the folder cannot be created.
    pub fn folder_beside(path: &Path) -> Result<Self, StoreError> {
        let folder = Self::beside(path);
        store::remove(&folder.0)?;
        store::create_folder(&folder.0)?;
        Ok(folder)
    }

    /// Gives it its final name, see [`store::rename`].
    ///
    /// # Errors
    /// When the system refuses; it is removed then.
    pub fn rename(mut self, path: &Path) -> io::Result<()> {
        store::rename(&self.0, path)?;
        // Another thread may begin to write the same by now.
        self.0 = PathBuf::new();
        Ok(())
    }

    /// Returns its path.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.0.as_os_str().is_empty() {
            // The work is done or has failed already: leftovers that cannot be removed are hidden and harmless.
            drop(store::remove(&self.0));
        }
    }
}

/// Removes leftovers of killed processes of this machine from a folder: entries named by [`temporary_beside`] in a
/// process that no longer runs. Leftovers of other machines or unknown programs stay.
///
/// # Errors
/// When the folder cannot be listed or an entry cannot be removed; a missing folder holds nothing.
pub fn remove_abandoned(folder: &Path) -> Result<(), StoreError> {
    let failed = |source| StoreError::read(folder, source);
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(failed)?,
    };
    for entry in entries {
        let entry = entry.map_err(failed)?;
        if entry.file_name().to_str().is_some_and(is_abandoned) {
            store::remove(&entry.path())?;
        }
    }
    Ok(())
}

fn is_abandoned(name: &str) -> bool {
    let Some(rest) = name.strip_prefix(PREFIX) else {
        return false;
    };
    let mut parts = rest.splitn(4, '-');
    let (Some(host), Some(id), Some(random), Some(_)) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return false;
    };
    let Ok(id) = id.parse::<u32>() else {
        return false;
    };
    let is_own = format!("{host}-{id}-{random}") == *OWN;
    // Another random part under this process's own id belongs to an earlier process.
    host == *HOST && !is_own && (id == std::process::id() || !process::is_running(id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_keep_their_extension_and_stay_apart() {
        let of = |name: &str| temporary_beside(Path::new(&format!("/out/{name}")));
        let (a, b) = ("ä".repeat(120) + ".png", "ä".repeat(119) + "öx.png");
        for name in [&a, &b, &("x".repeat(251) + ".png")] {
            let temporary = of(name);
            let length = temporary.file_name().map(std::ffi::OsStr::len);
            assert!(
                length.is_some_and(|length| length <= LONGEST_NAME),
                "{length:?}"
            );
            assert_eq!(temporary.extension(), Some("png".as_ref()));
        }
        assert_ne!(of(&a), of(&b));
        assert_eq!(of("000004.png"), of("000004.png"));
    }

    #[test]
    #[cfg(unix)]
    fn only_what_dead_processes_of_this_machine_left_is_abandoned() {
        let name =
            |host: &str, id: u32, random: &str| format!("{PREFIX}{host}-{id}-{random}-x.json");
        let parent = std::os::unix::process::parent_id();
        // Ids are handed out from 1 to at most 2^22.
        let dead = 1 << 23;
        assert!(is_abandoned(&name(&HOST, dead, "00000000")));
        assert!(is_abandoned(&name(&HOST, std::process::id(), "not-ours")));
        assert!(!is_abandoned(&name(&HOST, parent, "00000000")), "it runs");
        assert!(
            !is_abandoned(&name("0123abcd", dead, "00000000")),
            "another host"
        );
        assert!(!is_abandoned(&format!("{PREFIX}{}-x.json", *OWN)));
        assert!(!is_abandoned(".tmp-notes"));
        assert!(!is_abandoned(".tmp-12-notes"));
    }
}
