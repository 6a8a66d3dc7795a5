//! A disk that fills up: exit code 1, one line, and whole files only. With room again, the job goes
//! on from where it was.

use std::{
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use tempfile::TempDir;

use crate::support::{assert_all_whole, run, sample, scratch};

/// A small disk in memory.
struct SmallDisk(TempDir);

impl SmallDisk {
    /// `None` where mounting is not permitted.
    fn mount(kibibytes: u32) -> Option<Self> {
        let folder = scratch();
        mount(&format!("size={kibibytes}k"), folder.path()).then(|| Self(folder))
    }

    fn grow(&self) {
        assert!(mount("remount,size=64m", self.0.path()));
    }

    fn out(&self) -> PathBuf {
        self.0.path().join("out")
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        if !quietly(Command::new("umount").arg(self.0.path())) {
            println!("nothing to unmount at {}", self.0.path().display());
        }
    }
}

fn mount(options: &str, folder: &Path) -> bool {
    let mut command = Command::new("mount");
    command.args(["-t", "tmpfs", "-o", options, "tmpfs"]);
    quietly(command.arg(folder))
}

fn quietly(command: &mut Command) -> bool {
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

#[test]
fn whatever_stage_it_hits() {
    let settings = "--quiet --max-frames 10 --width 128 --iterations 5";
    let quiet: Vec<&str> = settings.split(' ').collect();
    // From a disk on which the first record does not fit to one that lacks room for the Gaussians.
    for kibibytes in [8, 60, 400, 1000] {
        let Some(disk) = SmallDisk::mount(kibibytes) else {
            omnilife_schemas::testing::skip("a small disk cannot be mounted here");
            return;
        };
        let ended = run(&sample("street.mp4"), &disk.out(), &quiet);
        let message = ended.failed_quietly(1);
        println!("{kibibytes} KiB: {message}");
        assert!(
            message.contains("cannot be written: No space left"),
            "{message}"
        );
        assert!(message.contains(disk.out().to_str().unwrap()), "{message}");
        assert_all_whole(&disk.out());

        disk.grow();
        run(&sample("street.mp4"), &disk.out(), &quiet).succeeded();
        assert_all_whole(&disk.out());
    }
}
