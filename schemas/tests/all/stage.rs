//! Skipped and repeated stages.

use std::{fs, path::Path};

use omnilife_schemas::{
    ownership::FileList,
    progress::Silent,
    stage::{Done, StageOutputs, StagePlan},
    store::{self, StoreError},
};

fn plan(folder: &Path, input: &Path, iterations: u32) -> StagePlan {
    StagePlan::new(folder, "train")
        .with_file(input)
        .unwrap()
        .with_settings("settings", &[iterations])
}

/// Claims outputs, as a process does that is killed afterwards.
fn begin(stage: &StagePlan, outputs: &[&str]) -> Result<(), StoreError> {
    stage.run(outputs, &Silent, |out| {
        out.leave_begun();
        Ok(())
    })
}

/// Returns a folder with an input file and a finished stage.
fn finished() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("input.txt");
    fs::write(&input, "input").unwrap();
    fs::create_dir(folder.path().join("views")).unwrap();
    let outputs = ["model.ply", "views/000004.png"];
    let stage = plan(folder.path(), &input, 7);
    assert!(!stage.is_done());
    begin(&stage, &outputs).unwrap();
    for output in outputs {
        fs::write(folder.path().join(output), "output").unwrap();
    }
    stage.finish(outputs, 1.5).unwrap();
    (folder, input)
}

#[test]
fn the_same_inputs_are_skipped() {
    let (folder, input) = finished();
    assert!(plan(folder.path(), &input, 7).is_done());
    let record: Done = store::read_record(&folder.path().join(".done/train.json")).unwrap();
    assert_eq!(record.stage, "train");
    assert_eq!(record.took.wall_seconds, 1.5);
    let outputs: Vec<_> = record
        .outputs
        .iter()
        .map(|o| (o.file.as_str(), o.bytes))
        .collect();
    assert_eq!(outputs, [("model.ply", 6), ("views/000004.png", 6)]);
}

#[test]
fn a_moved_folder_is_skipped_too() {
    let (folder, _) = finished();
    let parent = tempfile::tempdir().unwrap();
    let moved = parent.path().join("moved");
    fs::rename(folder.path(), &moved).unwrap();
    assert!(plan(&moved, &moved.join("input.txt"), 7).is_done());
}

#[test]
fn changed_inputs_run_again() {
    let (folder, input) = finished();
    assert!(!plan(folder.path(), &input, 8).is_done(), "settings");
    assert!(
        !plan(folder.path(), &input, 7)
            .with_text("more", "")
            .is_done(),
        "one input more"
    );
    let other = StagePlan::new(folder.path(), "render")
        .with_file(&input)
        .unwrap();
    assert!(!other.is_done(), "another stage");
    fs::write(&input, "Input").unwrap();
    assert!(!plan(folder.path(), &input, 7).is_done(), "content");
}

#[test]
fn the_order_of_inputs_counts() {
    let folder = tempfile::tempdir().unwrap();
    let of = |first: &str, second: &str| {
        StagePlan::new(folder.path(), "train")
            .with_text("first", first)
            .with_text("second", second)
            .inputs_sha256()
    };
    assert_eq!(of("a", "b"), of("a", "b"));
    assert_ne!(of("a", "b"), of("b", "a"));
}

#[test]
fn lost_or_cut_outputs_run_again() {
    let (folder, input) = finished();
    fs::write(folder.path().join("model.ply"), "cut").unwrap();
    assert!(!plan(folder.path(), &input, 7).is_done());
    let (folder, input) = finished();
    fs::write(folder.path().join("model.ply"), "oUtput").unwrap();
    assert!(!plan(folder.path(), &input, 7).is_done(), "a flipped bit");
    let (folder, input) = finished();
    fs::remove_file(folder.path().join("views/000004.png")).unwrap();
    assert!(!plan(folder.path(), &input, 7).is_done());
}

#[test]
fn a_stage_that_began_is_not_done() {
    let (folder, input) = finished();
    let stage = plan(folder.path(), &input, 7);
    begin(&stage, &["model.ply"]).unwrap();
    assert!(!stage.is_done());
    begin(&stage, &["model.ply"]).unwrap();
}

#[test]
fn a_broken_done_record_runs_again() {
    let (folder, input) = finished();
    fs::write(folder.path().join(".done/train.json"), "{").unwrap();
    assert!(!plan(folder.path(), &input, 7).is_done());
}

#[test]
fn missing_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let stage = StagePlan::new(folder.path(), "train");
    let message = stage.finish(["model.ply"], 0.0).unwrap_err().to_string();
    assert!(message.contains("model.ply"), "{message}");
    assert!(!stage.is_done());
    assert!(stage.with_file(&folder.path().join("none.mp4")).is_err());
}

fn names(folder: &Path) -> Vec<String> {
    store::names_in(folder).unwrap()
}

/// Foreign files under the names of outputs stop a stage before it writes. Its own files do not, whether it has
/// finished or was killed on the way.
#[test]
fn outputs_are_claimed_before_they_are_written() {
    let (folder, input) = finished();
    let stage = plan(folder.path(), &input, 8);
    fs::write(folder.path().join("notes.md"), "mine").unwrap();
    let message = begin(&stage, &["model.ply", "notes.md"]).unwrap_err();
    assert!(message.to_string().contains("notes.md: is in the way"));
    assert!(plan(folder.path(), &input, 7).is_done(), "nothing happened");
    begin(&stage, &["model.ply", "trace.csv"]).unwrap();
    fs::write(folder.path().join("trace.csv"), "half").unwrap();
    // Killed here: the next process finds what this one made.
    let next = plan(folder.path(), &input, 9);
    begin(&next, &["model.ply", "trace.csv"]).unwrap();
    fs::write(folder.path().join("trace.csv"), "whole").unwrap();
    next.finish(["model.ply", "trace.csv"], 0.0).unwrap();
    assert!(next.is_done());
    assert_eq!(names(&folder.path().join(".done")), ["train.json"]);
    // The views were not made again and are still known as ours only until then.
    assert!(folder.path().join("views/000004.png").is_file());
}

/// Published files, such as masks, are replaced only where they are unchanged.
#[test]
fn published_files_replace_only_unchanged_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let stage = StagePlan::new(folder.path(), "poses");
    let stage_files = |content: &str| {
        let staged = path("staged/masks");
        fs::create_dir_all(&staged).unwrap();
        let files = ["masks/0.png", "masks/1.png"].map(str::to_owned);
        for file in &files {
            fs::write(path("staged").join(file), content).unwrap();
        }
        stage.publish(&path("staged"), &files)
    };
    fs::create_dir(path("masks")).unwrap();
    fs::write(path("masks/1.png"), "mine").unwrap();
    let message = stage_files("a").unwrap_err().to_string();
    assert!(message.contains("masks/1.png: is in the way"), "{message}");
    assert!(!path("masks/0.png").exists(), "all or none");
    let own = stage_files("mine").unwrap();
    let own: Vec<_> = own.iter().map(|own| own.file.as_str()).collect();
    assert_eq!(own, ["masks/0.png"], "the same content stays the user's");
    // Killed before it finished: its published files are its own.
    fs::remove_file(path("masks/1.png")).unwrap();
    assert_eq!(stage_files("b").unwrap().len(), 2);
    fs::write(path("masks/0.png"), "touched up").unwrap();
    assert!(stage_files("c").is_err());
    assert_eq!(fs::read(path("masks/0.png")).unwrap(), b"touched up");
    assert_eq!(fs::read(path("masks/1.png")).unwrap(), b"b");
}

/// A process may be killed between the last record and its own clean-up.
#[test]
fn a_finished_stage_takes_away_what_its_killed_process_left() {
    let (folder, input) = finished();
    let left = [".done/train.begun.json", ".omnilife.lock"].map(|name| folder.path().join(name));
    fs::write(&left[0], "{}").unwrap();
    fs::write(&left[1], "omnilife writes here: process 1 on x").unwrap();
    assert!(plan(folder.path(), &input, 7).is_done());
    assert!(!left.iter().any(|file| file.exists()));
    let notes = "my notes";
    fs::write(&left[1], notes).unwrap();
    assert!(plan(folder.path(), &input, 7).is_done());
    assert_eq!(
        fs::read_to_string(&left[1]).unwrap(),
        notes,
        "it is not our lock"
    );
}

/// The record is written last, and failed work is tried again.
#[test]
fn a_record_is_made_once_and_again_after_a_failure() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("out");
    let stage = StagePlan::new(&folder, "list");
    let make = |work: &dyn Fn(&mut StageOutputs<'_>) -> Result<FileList, StoreError>| {
        let claimed = ["model.ply", "list.json"];
        stage.make(("list.json", "skipped"), claimed, &Silent, work)
    };
    let list = FileList { files: Vec::new() };
    make(&|out| {
        out.write_bytes("model.ply", b"half")?;
        Err(StoreError::refused(&out.path("model.ply"), "is half"))
    })
    .unwrap_err();
    assert!(!stage.is_done() && stage.has_begun());
    assert_eq!(names(&folder), [".done", "model.ply"]);

    let whole = |out: &mut StageOutputs<'_>| {
        out.write_bytes("model.ply", b"whole")?;
        assert!(!out.path("list.json").exists());
        Ok::<_, StoreError>(list.clone())
    };
    assert_eq!(make(&whole).unwrap(), list);
    assert!(stage.is_done(), "the hashes are those of the files");
    let again = make(&|_| Err(StoreError::refused(&folder, "is not called")));
    assert_eq!(again.unwrap(), list);
}
