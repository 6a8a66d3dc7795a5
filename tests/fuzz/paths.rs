//! Readers of paths: of cameras, and of drones.

use std::fs;

use omnilife_reconstruct::jobs::camera_path;

use crate::{
    samples::names,
    targets::{Reader::Folder, Target},
};

/// Readers of paths.
pub(crate) const PATHS: &[Target] = &[Target {
    id: "camera-path",
    words: &[
        "time_seconds,x,y,z,qw,qx,qy,qz",
        "[]",
        "null",
        "1e999",
        "NaN",
        "\"pose\":",
        "\"rotation_wxyz\":",
    ],
    cost: 1,
    seeds: |folder| {
        let table = "time_seconds,x,y,z,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n0.5,1,2,4,1,0,0,0\n";
        fs::write(folder.join("a.csv"), table).unwrap();
        let list = r#"[{"time_seconds": 0, "pose": {"rotation_wxyz": [1, 0, 0, 0], "centre": [1, 2, 3]}}]"#;
        fs::write(folder.join("a.json"), list).unwrap();
        names(&["a.csv", "a.json"])
    },
    reader: Folder(|input, seed| drop(camera_path::read_path(&input.path(seed)))),
}];
