//! Who works on a unit.
//!
//! A claim is the file `claim-<n>.json` in the unit's folder; the highest number counts. It is made
//! by creating the file, which exactly one process can, and holds while its runner lives: on one
//! machine as long as the process is there, elsewhere until the file has not been written for its
//! expiry. Whoever finds a claim that does not hold makes the next number - and never removes the
//! old one, so that two who find it at once cannot both succeed. A runner that comes back to life
//! sees the higher number and lets go.

use std::{
    fs::{self, File, OpenOptions},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use omnilife_schemas::{
    records::UnitClaim,
    store::{self, StoreError},
};

use crate::host;

/// A unit whose runner went away this often has failed.
pub const MOST_LOST_RUNNERS: u32 = 3;

/// What stands in a unit's folder about who works on it.
#[derive(Debug, Clone, PartialEq)]
pub enum Claimed {
    /// Nobody.
    No,
    /// A runner that lives.
    Held(Box<UnitClaim>),
    /// A runner that went away; with the claim's number, and what it said where that is readable.
    Lost(u32, Option<Box<UnitClaim>>),
}

/// Looks at the claims of a unit's folder. `now` is the time of its file system.
///
/// # Errors
/// When the folder cannot be read.
pub fn look(folder: &Path, now: SystemTime, expiry: Duration) -> Result<Claimed, StoreError> {
    let Some(number) = highest(folder)? else {
        return Ok(Claimed::No);
    };
    let path = file(folder, number);
    let modified = match fs::metadata(&path).and_then(|metadata| metadata.modified()) {
        Ok(modified) => modified,
        // Let go just now.
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Claimed::No),
        Err(error) => return Err(StoreError::read(&path, error)),
    };
    // A claim that cannot be read is being written, or its runner was killed while it was.
    let claim = store::read_record::<UnitClaim>(&path).ok().map(Box::new);
    let promised = claim.as_ref().map_or(expiry, |claim| {
        Duration::try_from_secs_f64(claim.expiry_seconds).unwrap_or(expiry)
    });
    let age = now.duration_since(modified).unwrap_or_default();
    let holds = claim
        .as_ref()
        .and_then(|claim| host::is_running(claim))
        .unwrap_or(age <= promised);
    Ok(match claim {
        Some(claim) if holds => Claimed::Held(claim),
        // Half-written and young: somebody is about to hold it.
        None if holds => Claimed::Held(Box::new(unknown(expiry))),
        claim => Claimed::Lost(number, claim),
    })
}

fn unknown(expiry: Duration) -> UnitClaim {
    UnitClaim {
        runner: omnilife_schemas::records::UnitRunner {
            host: "unknown".to_owned(),
            process: 0,
            slurm_job: None,
        },
        token: String::new(),
        kernel: None,
        process_begun_ticks: None,
        expiry_seconds: expiry.as_secs_f64(),
    }
}

/// A claim of this process.
#[derive(Debug)]
pub struct Claim {
    folder: PathBuf,
    number: u32,
    bytes: Vec<u8>,
    /// Unique to this claim.
    pub token: String,
}

impl Claim {
    /// Takes the claim after `lost` (0 where there is none), and ends what units of lost claims have
    /// left running on this machine; `None` where somebody else has it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn take(folder: &Path, lost: u32, expiry: Duration) -> Result<Option<Self>, StoreError> {
        let number = lost + 1;
        let path = file(folder, number);
        let failed = |source| StoreError::write(&path, source);
        let token = host::token();
        let record = UnitClaim {
            runner: host::runner(),
            token: token.clone(),
            kernel: host::kernel(),
            process_begun_ticks: host::process_begun_ticks(std::process::id()),
            expiry_seconds: expiry.as_secs_f64(),
        };
        let bytes =
            store::record_bytes(&record).map_err(|error| failed(std::io::Error::other(error)))?;
        let mut created = match File::create_new(&path) {
            Ok(created) => created,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(None),
            Err(error) => return Err(failed(error)),
        };
        created.write_all(&bytes).map_err(failed)?;
        for before in 1..number {
            // What cannot be read was not written whole, so its unit had not begun.
            if let Ok(claim) = store::read_record(&file(folder, before)) {
                host::end_leftovers(&claim);
            }
        }
        if lost > 0 {
            store::remove_abandoned(folder)?;
        }
        Ok(Some(Self {
            folder: folder.to_owned(),
            number,
            bytes,
            token,
        }))
    }

    /// Writes the claim again, which dates it; false where it is not this process's any more.
    pub fn renew(&self) -> bool {
        if !self.is_held() {
            return false;
        }
        let written = OpenOptions::new()
            .write(true)
            .open(file(&self.folder, self.number))
            .and_then(|mut file| file.write_all(&self.bytes));
        written.is_ok() && self.is_held()
    }

    /// Whether nobody has taken the unit over.
    pub fn is_held(&self) -> bool {
        matches!(highest(&self.folder), Ok(Some(number)) if number == self.number)
            && fs::read(file(&self.folder, self.number)).is_ok_and(|bytes| bytes == self.bytes)
    }

    /// Lets go of a unit that is not finished.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub fn release(&self) -> Result<(), StoreError> {
        if self.is_held() {
            store::remove(&file(&self.folder, self.number))?;
        }
        Ok(())
    }

    /// Removes all claims of a unit whose outcome stands.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn close(&self) -> Result<(), StoreError> {
        remove_all(&self.folder)
    }
}

/// Removes all claims of a unit.
///
/// # Errors
/// When a file cannot be removed.
pub fn remove_all(folder: &Path) -> Result<(), StoreError> {
    for name in store::names_in(folder)? {
        if number_of(&name).is_some() {
            store::remove(&folder.join(name))?;
        }
    }
    Ok(())
}

fn file(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("claim-{number}.json"))
}

fn number_of(name: &str) -> Option<u32> {
    let number = name.strip_prefix("claim-")?.strip_suffix(".json")?;
    number.parse().ok()
}

fn highest(folder: &Path) -> Result<Option<u32>, StoreError> {
    let names = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        names => names.map_err(|error| StoreError::read(folder, error))?,
    };
    Ok(names
        .filter_map(Result::ok)
        .filter_map(|entry| number_of(entry.file_name().to_str()?))
        .max())
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    const EXPIRY: Duration = Duration::from_secs(5);

    /// Rewrites a claim as if another machine had made it.
    fn make_foreign(folder: &Path, number: u32) -> Result<(), Box<dyn std::error::Error>> {
        let path = file(folder, number);
        let mut claim: UnitClaim = store::read_record(&path)?;
        claim.kernel = Some("another".to_owned());
        store::write_record(&path, &claim)?;
        Ok(())
    }

    #[test]
    fn one_of_many_takes_it() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        for lost in 0..20 {
            let taken: usize = thread::scope(|scope| {
                let all: Vec<_> = (0..8)
                    .map(|_| scope.spawn(|| Claim::take(folder.path(), lost, EXPIRY)))
                    .collect();
                all.into_iter()
                    .filter_map(|one| one.join().ok())
                    .filter(|taken| matches!(taken, Ok(Some(_))))
                    .count()
            });
            assert_eq!(taken, 1);
        }
        Ok(())
    }

    #[test]
    fn a_claim_holds_while_its_process_lives() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let claim = Claim::take(folder.path(), 0, EXPIRY)?.ok_or("taken")?;
        let much_later = SystemTime::now() + Duration::from_secs(1_000_000);
        if cfg!(target_os = "linux") {
            let seen = look(folder.path(), much_later, EXPIRY)?;
            assert!(matches!(seen, Claimed::Held(_)), "{seen:?}");
        }
        // Of a process that has gone, or that began at another time, it does not.
        let path = file(folder.path(), 1);
        let mut record: UnitClaim = store::read_record(&path)?;
        record.process_begun_ticks = Some(1);
        store::write_record(&path, &record)?;
        if cfg!(target_os = "linux") {
            let seen = look(folder.path(), SystemTime::now(), EXPIRY)?;
            assert!(matches!(seen, Claimed::Lost(1, Some(_))), "{seen:?}");
        }
        assert!(!claim.is_held(), "its content is another's");
        Ok(())
    }

    #[test]
    fn a_claim_of_another_machine_expires() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let claim = Claim::take(folder.path(), 0, EXPIRY)?.ok_or("taken")?;
        make_foreign(folder.path(), 1)?;
        let now = host::file_system_time(folder.path())?;
        let seen = look(folder.path(), now, EXPIRY)?;
        assert!(matches!(seen, Claimed::Held(_)), "{seen:?}");
        let seen = look(folder.path(), now + EXPIRY * 2, EXPIRY)?;
        assert!(matches!(seen, Claimed::Lost(1, Some(_))), "{seen:?}");
        // Taken over: the first runner notices, and takes nothing away when it lets go.
        let second = Claim::take(folder.path(), 1, EXPIRY)?.ok_or("taken")?;
        assert!(!claim.renew() && second.renew());
        claim.release()?;
        assert!(second.is_held());
        second.close()?;
        assert_eq!(look(folder.path(), now, EXPIRY)?, Claimed::No);
        Ok(())
    }

    #[test]
    fn half_a_claim_is_given_time() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        fs::write(file(folder.path(), 1), "{\"sch")?;
        let now = host::file_system_time(folder.path())?;
        assert!(matches!(
            look(folder.path(), now, EXPIRY)?,
            Claimed::Held(_)
        ));
        let later = look(folder.path(), now + EXPIRY * 2, EXPIRY)?;
        assert_eq!(later, Claimed::Lost(1, None));
        Ok(())
    }
}
