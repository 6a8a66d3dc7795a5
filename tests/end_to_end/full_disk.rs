//! Full disk: exit code 1, one line, and whole files only. With free space again, the job resumes.

use crate::support::{SmallDisk, assert_all_whole, run, sample};

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
