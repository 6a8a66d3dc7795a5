//! What object graphs refuse, in one line.

use std::fs;

use crate::support::{SEQUENCE, copy_of_small_run, omnilife};

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
