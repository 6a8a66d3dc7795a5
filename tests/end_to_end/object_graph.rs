//! What object graphs refuse, in one line.

use std::fs;

use crate::support::{SEQUENCE, copy_of_small_run, omnilife, scratch};

/// A camera that hovers shows what moves and no space: nothing can be reconstructed of it.
#[test]
fn a_scene_of_a_hovering_camera_is_refused() {
    let copy = copy_of_small_run();
    let scene = copy.path().join(SEQUENCE).join("scene.json");
    let mut record: serde_json::Value = serde_json::from_slice(&fs::read(&scene).unwrap()).unwrap();
    record["pose_source"] = serde_json::json!({
        "kind": "registered", "reason": "97 % of the pixels fit a turn", "succeeded": true
    });
    fs::write(&scene, record.to_string()).unwrap();
    let out = copy.path().join("graph");
    let split = copy.path().join(SEQUENCE).join("per-scene/split.json");
    let ended = omnilife([
        "reconstruct".as_ref(),
        "train".as_ref(),
        scene.as_os_str(),
        "--split".as_ref(),
        split.as_os_str(),
        "--method".as_ref(),
        "object-graph".as_ref(),
        "--out".as_ref(),
        out.as_os_str(),
    ]);
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("hovers or turns (97 % of the pixels fit a turn)")
            && message.contains("nothing can be reconstructed"),
        "{message}"
    );
    assert!(!out.exists());
}

#[test]
fn edits_of_objects_that_are_no_numbers_are_refused_in_one_line() {
    let folder = scratch();
    let out = folder.path().join("edited");
    for (option, value) in [
        ("--move", "3=nan"),
        ("--move", "3=1,inf,0"),
        ("--move", "3=1,2"),
        ("--copy", "3"),
        ("--copy", "-1=1,2"),
        ("--delay", "3=NaN"),
    ] {
        let arguments = ["reconstruct", "edit", "run", option, value, "--out"];
        let ended = omnilife(
            arguments
                .map(std::ffi::OsStr::new)
                .iter()
                .chain([&out.as_os_str()]),
        );
        let message = ended.failed_quietly(2);
        let expected = format!("not \"{value}\"");
        assert!(
            message.contains(option) && message.contains(&expected),
            "{message}"
        );
        assert!(!out.exists());
    }
}
