//! Attaching to an imported scene, by the command line.

use std::fs;

use omnilife_schemas::{records::Scene, store};

use crate::support::{SEQUENCE, omnilife, sample, scratch, small_run};

#[test]
fn an_imported_scene_gets_masks_of_files_and_of_a_program() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let sequence = small_run().out.join(SEQUENCE);
    let sequence = sequence.to_str().unwrap();
    let (colmap, scene) = (at("colmap"), at("scene"));
    let export = [
        "curate", "export", sequence, "--format", "colmap", "--out", &colmap,
    ];
    omnilife(export).succeeded();
    let import = [
        "curate", "import", &colmap, "--format", "colmap", "--out", &scene,
    ];
    omnilife(import).succeeded();

    let masks = sample("masks");
    let masks = masks.to_str().unwrap();
    let class = format!("mover={masks}");
    let attach = [
        "curate",
        "attach",
        &scene,
        "--masks",
        masks,
        "--class",
        &class,
        "--ignore-mask",
        "nadir:20",
    ];
    let ended = omnilife(attach).succeeded();
    assert!(
        ended.stdout.contains("10 with ignore masks") && ended.stdout.contains("class mover"),
        "{}",
        ended.stdout
    );
    let read = || -> Scene { store::read_record(&folder.path().join("scene/scene.json")).unwrap() };
    let first = read();
    assert!(first.frames.iter().all(|frame| frame.mask.is_some()));

    let script = at("net.sh");
    fs::write(&script, format!("cp {masks}/* $2/ && ls $1")).unwrap();
    let command = format!("sh {script} {{frames}} {{out}}");
    let attach = ["curate", "attach", &scene, "--masks-command", &command];
    let ended = omnilife(attach).succeeded();
    assert!(ended.stderr.contains("replaced"), "{}", ended.stderr);
    // The same masks; the scene names their source.
    let second = read();
    assert_eq!(second.frames, first.frames);
    let problems = second.validation.problems;
    assert!(problems.iter().any(|line| line.contains("net.sh")));

    let poses = sample("poses.json");
    let poses = poses.to_str().unwrap();
    let attach = ["--quiet", "curate", "attach", &scene, "--poses", poses];
    let ended = omnilife(attach);
    let message = ended.failed_quietly(2);
    assert!(message.contains("has poses of 10 of 10"), "{message}");
}
